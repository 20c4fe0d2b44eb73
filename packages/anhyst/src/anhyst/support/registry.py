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

PARTS: Mapping[str, tuple[str, ...]] = {
    "anhyst-rigs": (
        *("calibrate", "excite", "fleet", "force_control", "init", "live", "simulate", "tune"),
        *("watch", "xcp"),
    ),
    "anhyst-exchange": ("export",),
}
"""The other packages of this project, and their verbs; nobody replaces what they add."""

Thing = TypeVar("Thing")


@cache
def _every_point() -> tuple[EntryPoint, ...]:
    """Return the entry points for anhyst of all packages; of two copies of one, those of the first."""
    found: dict[tuple[str, str, str], EntryPoint] = {}
    for package in distributions():
        try:
            points = [one for one in package.entry_points if one.group.startswith("anhyst.")]
            for point in points:
                found.setdefault((package.name, point.group, point.name), point)
        except Exception:  # metadata of any package may be damaged; it then adds nothing
            continue
    return tuple(found.values())


def points_of(group: str) -> list[EntryPoint]:
    """Return the entry points of a group, those of this project first."""
    found = [point for point in _every_point() if point.group == group]
    return sorted(found, key=lambda one: (package_of(one) not in PARTS, package_of(one), one.name))


def package_of(point: EntryPoint) -> str:
    """Return the name of the package that has an entry point."""
    return (point.dist.name if point.dist else None) or point.value


def loaded(point: EntryPoint) -> object:
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


class Registry(Mapping[str, Thing], Generic[Thing]):
    """Own things of a sort, and those of installed packages, which are loaded once they are asked for.

    ``own`` is what no package replaces, nor does it take a name in ``taken``. ``group`` is that of the
    entry points. ``fault_of`` says, of what an entry point leads to and its name, what keeps it from
    being used; an empty text where nothing does. ``prefix`` stands in front of the name of each entry
    point.
    """

    def __init__(
        self,
        group: str,
        own: Mapping[str, Thing],
        fault_of: Callable[[object, str], str],
        *,
        prefix: str = "",
        taken: Collection[str] = (),
    ) -> None:
        self._group, self._own, self._fault_of = group, dict(own), fault_of
        self._prefix, self._taken = prefix, {*own, *taken}

    @cached_property
    def _found(self) -> tuple[dict[str, Thing], dict[str, str]]:
        """What packages add by name, and why something cannot be used."""
        added: dict[str, Thing] = {}
        whose: dict[str, str] = {}
        unusable: dict[str, str] = {}
        for point in points_of(self._group):
            name, package = f"{self._prefix}{point.name}", package_of(point)
            if name in self._taken or whose.get(name) in PARTS:
                continue
            try:
                thing = loaded(point)
            except ValueError as error:
                unusable[name] = f"{package} adds it and {error}; update it"
                continue
            if fault := self._fault_of(thing, point.name):
                unusable[name] = f"{package} adds it, {fault}; update it"
            elif name in added and added[name] is not thing:
                unusable[name] = f"{whose[name]} and {package} both add it; remove one of them"
            else:
                added[name], whose[name] = cast(Thing, thing), package
        return {name: one for name, one in added.items() if name not in unusable}, unusable

    @property
    def added(self) -> Mapping[str, Thing]:
        """What packages add."""
        return self._found[0]

    def why_unusable(self, name: object) -> str:
        """Say why nothing of that name can be used, if a package adds one; empty otherwise."""
        if not isinstance(name, str) or name in self._taken:
            return ""
        return self._found[1].get(name, "")

    def __getitem__(self, name: str) -> Thing:
        """Return the thing of a name; an own one without a look at packages."""
        return self._own[name] if name in self._own else self.added[name]

    def __iter__(self) -> Iterator[str]:
        """Give the names, own ones first."""
        yield from self._own
        yield from self.added

    def __len__(self) -> int:
        """Count them."""
        return len(self._own) + len(self.added)


def package_at_fault(error: BaseException) -> str:
    """Return the package of another author in whose code an error was raised; else nothing."""
    tops = {_top_of(point): package_of(point) for point in _every_point()}
    last, frame = "", error.__traceback__
    while frame is not None:
        top = str(frame.tb_frame.f_globals.get("__name__", "")).partition(".")[0]
        last = tops.get(top, "" if top == "anhyst" else last)
        frame = frame.tb_next
    return "" if last in PARTS else last


def _top_of(point: EntryPoint) -> str:
    return point.value.partition(":")[0].partition(".")[0].strip()


def packages_that_add() -> list[Path]:
    """Return the folders, or the files, of all packages that add something to anhyst."""
    tops = set(map(_top_of, _every_point()))
    specs = [find_spec(name) for name in sorted(tops) if name.isidentifier()]
    folders = (spec.submodule_search_locations or [spec.origin or ""] for spec in specs if spec)
    return [Path(place) for places in folders for place in places if place]
