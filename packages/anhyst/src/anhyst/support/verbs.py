"""Which verbs are installed, and in which package a missing one is."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from importlib import import_module
from pkgutil import iter_modules
from types import ModuleType

from anhyst.support.registry import loaded, package_of, points_of

ELSEWHERE: Mapping[str, tuple[str, ...]] = {
    "anhyst-rigs": (
        *("calibrate", "excite", "fleet", "force_control", "init", "live", "simulate", "tune"),
        *("watch", "xcp"),
    ),
    "anhyst-exchange": ("export",),
}
"""The verbs of the other packages of this project: to say which one is not installed."""


@cache
def _read() -> tuple[Mapping[str, str], tuple[str, ...]]:
    """Return the full name of the module of each verb, and which packages cannot be used."""
    own = import_module("anhyst.verbs")
    found = {verb.name: f"anhyst.verbs.{verb.name}" for verb in iter_modules(own.__path__)}
    faults = []
    for point in points_of("anhyst.verbs"):
        try:
            folder = loaded(point)
        except ValueError as error:
            faults.append(f"{package_of(point)}: '{point.value}' {error}; update it")
            continue
        if not isinstance(folder, ModuleType) or not hasattr(folder, "__path__"):
            faults.append(f"{package_of(point)}: '{point.value}' is no folder of verbs; update it")
            continue
        for module in iter_modules(folder.__path__):
            found.setdefault(module.name, f"{folder.__name__}.{module.name}")
    return dict(sorted(found.items())), tuple(faults)


def modules() -> Mapping[str, str]:
    """Return the full name of the module of each verb that is installed."""
    return _read()[0]


def faults() -> tuple[str, ...]:
    """Say which packages have a folder of verbs that cannot be used."""
    return _read()[1]


def package_with(name: str) -> str:
    """Return the package of this project that has a verb and is not installed; else nothing."""
    owners = (package for package, verbs in ELSEWHERE.items() if name in verbs)
    return "" if name in modules() else next(owners, "")
