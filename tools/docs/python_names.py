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
        part_names = {
            name: public_name
            for name, public_name in found.items()
            if public_name.__module__.split(".")[0] == part
        }
        functions = [name for name, public_object in part_names.items() if inspect.isfunction(public_object)]
        page.append(f"## {part}\n")
        page += [_directive("autofunction", part, name, part_names[name]) for name in functions]
        nouns = [name for name in part_names if name not in functions]
        page += [_directive("autoclass", part, name, part_names[name]) for name in nouns]
    return "\n".join(page)


def _directive(kind: str, part: str, name: str, public_object: object) -> str:
    qualified_name = f"{public_object.__module__}.{public_object.__qualname__}"  # type: ignore[attr-defined]
    members = "   :members:\n   :inherited-members: Exception\n" if kind == "autoclass" else ""
    return f"### {part}.{name}\n\n```{{eval-rst}}\n.. {kind}:: {qualified_name}\n{members}```\n"
