"""What installed packages add to anhyst, by name: laws, formats, kinds of rigs, targets and more.

A package names what it adds in an entry point of the group that a registry is for. One that cannot be
used is left out and its reason kept: it disturbs nothing else.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import redirect_stdout
from functools import cache, cached_property
from importlib.metadata import EntryPoint, distributions
from importlib.util import find_spec
from pathlib import Path
from typing import Generic, TypeVar, cast

PROJECT_PACKAGES: Mapping[str, tuple[str, ...]] = {
    "anhyst-rigs": (
        *("calibrate", "excite", "fleet", "force_control", "init", "live", "simulate", "tune"),
        *("watch", "xcp"),
    ),
    "anhyst-exchange": ("export",),
}
"""The other packages of this project, and their verbs; nobody replaces what they add."""

Entry = TypeVar("Entry")


@cache
def _all_entry_points() -> tuple[EntryPoint, ...]:
    """Return the entry points for anhyst of all packages; of two copies of one, those of the first."""
    first_copies: dict[tuple[str, str, str], EntryPoint] = {}
    for package in distributions():
        try:
            points = [entry for entry in package.entry_points if entry.group.startswith("anhyst.")]
            for point in points:
                first_copies.setdefault((package.name, point.group, point.name), point)
        except Exception:  # metadata of any package may be damaged; it then adds nothing
            continue
    return tuple(first_copies.values())


def entry_points_in(group: str) -> list[EntryPoint]:
    """Return the entry points of a group, those of this project first."""
    found = [point for point in _all_entry_points() if point.group == group]
    return sorted(
        found,
        key=lambda entry: (
            package_name(entry) not in PROJECT_PACKAGES,
            package_name(entry),
            entry.name,
        ),
    )


def package_name(point: EntryPoint) -> str:
    """Return the name of the package that has an entry point."""
    return (point.dist.name if point.dist else None) or point.value


def load_entry_point(point: EntryPoint) -> object:
    """Return what an entry point leads to; ValueError where it cannot be loaded, for any reason.

    What its module prints goes to standard error: standard output is for results.
    """
    if point.pattern.match(point.value) is None:
        raise ValueError(f"its entry point '{point.value}' is no module:name")
    try:
        with redirect_stdout(sys.stderr):
            return point.load()
    except (Exception, SystemExit) as error:
        raise ValueError(f"cannot be loaded ({error})") from error


class Registry(Mapping[str, Entry], Generic[Entry]):
    """Own things of a sort, and those of installed packages, which are loaded once they are asked for.

    ``own`` is what no package replaces, nor does it take a name in ``taken``. ``group`` is that of the
    entry points. ``fault_of`` says, of what an entry point leads to and its name, what keeps it from
    being used; an empty text where nothing does. ``prefix`` stands in front of the name of each entry
    point.
    """

    def __init__(
        self,
        group: str,
        builtin: Mapping[str, Entry],
        find_fault: Callable[[object, str], str],
        *,
        prefix: str = "",
        reserved: Collection[str] = (),
    ) -> None:
        self._group, self._builtin, self._find_fault = group, dict(builtin), find_fault
        self._prefix, self._reserved = prefix, {*builtin, *reserved}

    @cached_property
    def _plugins(self) -> tuple[dict[str, Entry], dict[str, str]]:
        """What packages add by name, and why something cannot be used."""
        added: dict[str, Entry] = {}
        owner: dict[str, str] = {}
        unusable: dict[str, str] = {}
        for point in entry_points_in(self._group):
            name, package = f"{self._prefix}{point.name}", package_name(point)
            if name in self._reserved or owner.get(name) in PROJECT_PACKAGES:
                continue
            try:
                entry = load_entry_point(point)
            except ValueError as error:
                unusable[name] = f"{package} adds it and {error}; update it"
                continue
            if fault := self._find_fault(entry, point.name):
                unusable[name] = f"{package} adds it, {fault}; update it"
            elif name in added and added[name] is not entry:
                unusable[name] = f"{owner[name]} and {package} both add it; remove one of them"
            else:
                added[name], owner[name] = cast(Entry, entry), package
        return {name: usable for name, usable in added.items() if name not in unusable}, unusable

    @property
    def plugins(self) -> Mapping[str, Entry]:
        """What packages add."""
        return self._plugins[0]

    def explain_unusable(self, name: object) -> str:
        """Say why nothing of that name can be used, if a package adds one; empty otherwise."""
        if not isinstance(name, str) or name in self._reserved:
            return ""
        return self._plugins[1].get(name, "")

    def __getitem__(self, name: str) -> Entry:
        """Return the thing of a name; an own one without a look at packages."""
        return self._builtin[name] if name in self._builtin else self.plugins[name]

    def __iter__(self) -> Iterator[str]:
        """Give the names, own ones first."""
        yield from self._builtin
        yield from self.plugins

    def __len__(self) -> int:
        """Count them."""
        return len(self._builtin) + len(self.plugins)


def package_at_fault(error: BaseException) -> str:
    """Return the package of another author in whose code an error was raised; else nothing."""
    package_of_module = {_top_module(point): package_name(point) for point in _all_entry_points()}
    culprit, frame = "", error.__traceback__
    while frame is not None:
        module = str(frame.tb_frame.f_globals.get("__name__", "")).partition(".")[0]
        culprit = package_of_module.get(module, "" if module == "anhyst" else culprit)
        frame = frame.tb_next
    return "" if culprit in PROJECT_PACKAGES else culprit


def _top_module(point: EntryPoint) -> str:
    return point.value.partition(":")[0].partition(".")[0].strip()


def plugin_paths() -> list[Path]:
    """Return the folders, or the files, of all packages that add something to anhyst."""
    modules = set(map(_top_module, _all_entry_points()))
    specs = [find_spec(name) for name in sorted(modules) if name.isidentifier()]
    folders = (spec.submodule_search_locations or [spec.origin or ""] for spec in specs if spec)
    return [Path(place) for places in folders for place in places if place]
