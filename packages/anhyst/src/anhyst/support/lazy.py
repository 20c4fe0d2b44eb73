"""Import the public names of a package when they are first used."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from importlib import import_module
from pkgutil import iter_modules
from typing import Any


def lazy_names(package: str, class_modules: Mapping[str, str]) -> tuple[list[str], Callable[[str], Any]]:
    """Return all public names of a package, and the function that imports one: its ``__getattr__``.

    The commands are the modules in the folder ``verbs`` of the package. ``class_modules`` contains
    the module of each other name, relative to the package. All packages have the same version.
    """
    folder = import_module(f"{package}.verbs")
    modules = {verb.name: f"verbs.{verb.name}" for verb in iter_modules(folder.__path__)} | dict(
        class_modules
    )

    def load_name(name: str) -> Any:
        if name == "__version__":
            from anhyst.support import running_version

            return running_version()
        if name not in modules:
            raise AttributeError(f"module {package!r} has no attribute {name!r}")
        value = getattr(import_module(f"{package}.{modules[name]}"), name)
        setattr(sys.modules[package], name, value)
        return value

    return sorted({"__version__", *modules}), load_name
