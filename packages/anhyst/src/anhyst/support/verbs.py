"""Find the installed commands, and the package that contains a missing one."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from importlib import import_module
from pkgutil import iter_modules
from types import ModuleType

from anhyst.support.registry import PROJECT_PACKAGES, entry_points_in, load_entry_point, package_name


def _find_in_folder(folder: object) -> dict[str, str]:
    """Return the module name of each command in a folder; raise ValueError if it is not a folder."""
    if not isinstance(folder, ModuleType) or not hasattr(folder, "__path__"):
        raise ValueError("is no folder of verbs")
    names = (module.name for module in iter_modules(folder.__path__))
    return {name: f"{folder.__name__}.{name}" for name in names if not name.startswith("_")}


@cache
def _find_all(is_project_only: bool) -> tuple[Mapping[str, str], tuple[str, ...]]:
    """Return the module name of each command, of this project or of all packages, and faults."""
    paths_by_name = _find_in_folder(import_module("anhyst.verbs"))
    owner = dict.fromkeys(paths_by_name, "anhyst")
    faults: list[str] = []
    duplicate_names: set[str] = set()
    for point in entry_points_in("anhyst.verbs"):
        package = package_name(point)
        if is_project_only and package not in PROJECT_PACKAGES:
            continue
        try:
            added_paths = _find_in_folder(load_entry_point(point))
        except ValueError as error:
            faults.append(f"{package}: '{point.value}' {error}; update it")
            continue
        for name, path in added_paths.items():
            if name not in paths_by_name:
                paths_by_name[name], owner[name] = path, package
                continue
            faults.append(f"{package}: its verb {name}, which {owner[name]} has too; rename it")
            if owner[name] not in {"anhyst", *PROJECT_PACKAGES}:
                duplicate_names.add(name)
    return {name: paths_by_name[name] for name in sorted(paths_by_name.keys() - duplicate_names)}, tuple(
        faults
    )


def modules(*, is_project_only: bool = False) -> Mapping[str, str]:
    """Return the module name of each installed command, or only of the commands of this project."""
    return _find_all(is_project_only)[0]


def faults() -> tuple[str, ...]:
    """Return texts about the commands that were left out."""
    return _find_all(False)[1]


def missing_package(name: str) -> str:
    """Return the missing package of this project that contains a command; empty otherwise."""
    owners = (package for package, verbs in PROJECT_PACKAGES.items() if name in verbs)
    return "" if name in modules(is_project_only=True) else next(owners, "")
