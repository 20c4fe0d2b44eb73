"""Which verbs are installed, and in which package a missing one is."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from importlib import import_module
from pkgutil import iter_modules
from types import ModuleType

from anhyst.support.registry import PARTS, loaded, package_of, points_of


def _verbs_in(folder: object) -> dict[str, str]:
    """Return the full name of the module of each verb in a folder; ValueError where it is none."""
    if not isinstance(folder, ModuleType) or not hasattr(folder, "__path__"):
        raise ValueError("is no folder of verbs")
    names = (module.name for module in iter_modules(folder.__path__))
    return {name: f"{folder.__name__}.{name}" for name in names if not name.startswith("_")}


@cache
def _read(of_project: bool) -> tuple[Mapping[str, str], tuple[str, ...]]:
    """Return the module of each verb, of this project or of all packages; and what is left out."""
    found = _verbs_in(import_module("anhyst.verbs"))
    whose = dict.fromkeys(found, "anhyst")
    faults: list[str] = []
    twice: set[str] = set()
    for point in points_of("anhyst.verbs"):
        package = package_of(point)
        if of_project and package not in PARTS:
            continue
        try:
            places = _verbs_in(loaded(point))
        except ValueError as error:
            faults.append(f"{package}: '{point.value}' {error}; update it")
            continue
        for name, place in places.items():
            if name not in found:
                found[name], whose[name] = place, package
                continue
            faults.append(f"{package}: its verb {name}, which {whose[name]} has too; rename it")
            if whose[name] not in {"anhyst", *PARTS}:
                twice.add(name)
    return {name: found[name] for name in sorted(found.keys() - twice)}, tuple(faults)


def modules(*, of_project: bool = False) -> Mapping[str, str]:
    """Return the full name of the module of each verb that is installed, or of this project's."""
    return _read(of_project)[0]


def faults() -> tuple[str, ...]:
    """Say which packages have verbs that are left out."""
    return _read(False)[1]


def package_with(name: str) -> str:
    """Return the package of this project that has a verb and is not installed; else nothing."""
    owners = (package for package, verbs in PARTS.items() if name in verbs)
    return "" if name in modules(of_project=True) else next(owners, "")
