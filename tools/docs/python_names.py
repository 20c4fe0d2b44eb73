"""The reference of the Python names: what ``import anhyst`` gives."""

from __future__ import annotations

import inspect

import anhyst


def python_names() -> str:
    """Return a page of directives that read the docstrings."""
    names = [name for name in anhyst.__all__ if not name.startswith("_")]
    verbs = [name for name in names if inspect.isfunction(getattr(anhyst, name))]
    nouns = [name for name in names if name not in verbs]
    parts = [
        "# Python\n",
        "What `import anhyst` gives; see [anhyst in Python](../python.md).\n",
        "## Verbs\n",
        *(_directive("autofunction", name) for name in verbs),
        "## Nouns\n",
        *(_directive("autoclass", name) for name in nouns),
    ]
    return "\n".join(parts)


def _directive(kind: str, name: str) -> str:
    found = getattr(anhyst, name)
    place = f"{found.__module__}.{found.__qualname__}"
    members = "   :members:\n   :inherited-members: Exception\n" if kind == "autoclass" else ""
    return f"### anhyst.{name}\n\n```{{eval-rst}}\n.. {kind}:: {place}\n{members}```\n"
