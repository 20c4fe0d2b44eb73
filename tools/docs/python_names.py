"""Generate the reference of the public Python names of each package."""

from __future__ import annotations

import inspect
from importlib import import_module

PARTS = ("anhyst", "anhyst_rigs", "anhyst_exchange")


def python_names() -> str:
    """Return a page of directives that include the docstrings."""
    page = ["# Python\n", "The public names of each package; see [anhyst in Python](../python.md).\n"]
    for part in PARTS:
        package = import_module(part)
        found = {name: getattr(package, name) for name in package.__all__ if name[0] != "_"}
        own = {name: one for name, one in found.items() if one.__module__.split(".")[0] == part}
        functions = [name for name, one in own.items() if inspect.isfunction(one)]
        page.append(f"## {part}\n")
        page += [_directive("autofunction", part, name, own[name]) for name in functions]
        nouns = [name for name in own if name not in functions]
        page += [_directive("autoclass", part, name, own[name]) for name in nouns]
    return "\n".join(page)


def _directive(kind: str, part: str, name: str, found: object) -> str:
    place = f"{found.__module__}.{found.__qualname__}"  # type: ignore[attr-defined]
    members = "   :members:\n   :inherited-members: Exception\n" if kind == "autoclass" else ""
    return f"### {part}.{name}\n\n```{{eval-rst}}\n.. {kind}:: {place}\n{members}```\n"
