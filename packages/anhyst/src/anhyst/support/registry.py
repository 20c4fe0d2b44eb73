"""Registries of the plug-ins of installed packages: laws, file formats, rigs, targets and more.

A package names its plug-ins in entry points of the group of a registry. A plug-in that cannot be
used is left out, and the registry keeps the reason. It does not affect other plug-ins.
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
"""The other packages of this project and their commands, which no other package can replace."""

Entry = TypeVar("Entry")


@cache
def _all_entry_points() -> tuple[EntryPoint, ...]:
    """Return the entry points for anhyst; of a package that is installed twice, the first copy's."""
    first_copies: dict[tuple[str, str, str], EntryPoint] = {}
    for package in distributions():
        try:
            points = [
                entry_point for entry_point in package.entry_points if entry_point.group.startswith("anhyst.")
            ]
            for point in points:
                first_copies.setdefault((package.name, point.group, point.name), point)
        except Exception:  # damaged metadata of a package: ignore the package
            continue
    return tuple(first_copies.values())


def entry_points_in(group: str) -> list[EntryPoint]:
    """Return the entry points of a group; the entry points of this project come first."""
    group_points = [point for point in _all_entry_points() if point.group == group]
    return sorted(
        group_points,
        key=lambda entry: (package_name(entry) not in PROJECT_PACKAGES, package_name(entry), entry.name),
    )


def package_name(point: EntryPoint) -> str:
    """Return the name of the package that defines an entry point."""
    return (point.dist.name if point.dist else None) or point.value


def load_entry_point(point: EntryPoint) -> object:
    """Return the object of an entry point; raise ValueError if it cannot be loaded, for any reason.

    Output that its module prints is sent to standard error, because standard output is for results.
    """
    if point.pattern.match(point.value) is None:
        raise ValueError(f"its entry point '{point.value}' does not have the form module:name")
    try:
        with redirect_stdout(sys.stderr):
            return point.load()
    except (Exception, SystemExit) as error:
        raise ValueError(f"cannot be loaded ({error})") from error


class Registry(Mapping[str, Entry], Generic[Entry]):
    """Builtin entries and the plug-ins of installed packages, by name.

    Plug-ins are loaded when they are first requested. They cannot replace ``builtin`` entries or
    take a name in ``reserved``. ``group`` is the group of the entry points. ``find_fault`` gets an
    object and the name of its entry point, and returns the reason why it cannot be used, or an
    empty text. ``prefix`` is put before the name of each entry point.
    """

    def __init__(
        self,
        group: str,
        builtin: Mapping[str, Entry],
        find_fault: Callable[[object, str], str],
        *,
        prefix: str = "",
        reserved_names: Collection[str] = (),
    ) -> None:
        self._group, self._builtin, self._find_fault = group, dict(builtin), find_fault
        self._prefix, self._reserved = prefix, {*builtin, *reserved_names}

    @cached_property
    def _plugins(self) -> tuple[dict[str, Entry], dict[str, str]]:
        """Usable plug-ins by name, and the reason for each unusable one."""
        added_entries: dict[str, Entry] = {}
        packages: dict[str, str] = {}
        reasons_by_name: dict[str, str] = {}
        for point in entry_points_in(self._group):
            name, package = f"{self._prefix}{point.name}", package_name(point)
            if name in self._reserved or packages.get(name) in PROJECT_PACKAGES:
                continue
            try:
                plugin = load_entry_point(point)
            except ValueError as error:
                reasons_by_name[name] = f"{package} adds it and {error}; update it"
                continue
            if fault := self._find_fault(plugin, point.name):
                reasons_by_name[name] = f"{package} adds it, {fault}; update it"
            elif name in added_entries and added_entries[name] is not plugin:
                reasons_by_name[name] = f"{packages[name]} and {package} both add it; remove one of them"
            else:
                added_entries[name], packages[name] = cast(Entry, plugin), package
        return {
            name: plugin for name, plugin in added_entries.items() if name not in reasons_by_name
        }, reasons_by_name

    @property
    def plugins(self) -> Mapping[str, Entry]:
        """Usable plug-ins by name."""
        return self._plugins[0]

    def explain_unusable(self, name: object) -> str:
        """Return the reason why the plug-in of a name cannot be used; empty without a reason."""
        if not isinstance(name, str) or name in self._reserved:
            return ""
        return self._plugins[1].get(name, "")

    def __getitem__(self, name: str) -> Entry:
        """Return the entry of a name. A builtin entry does not load any plug-ins."""
        return self._builtin[name] if name in self._builtin else self.plugins[name]

    def __iter__(self) -> Iterator[str]:
        """Iterate over the names; builtin names come first."""
        yield from self._builtin
        yield from self.plugins

    def __len__(self) -> int:
        """Return the number of entries."""
        return len(self._builtin) + len(self.plugins)


def package_at_fault(error: BaseException) -> str:
    """Return the package of another author whose code raised an error; empty if none did."""
    package_of_module = {_top_module(point): package_name(point) for point in _all_entry_points()}
    package, frame = "", error.__traceback__
    while frame is not None:
        module = str(frame.tb_frame.f_globals.get("__name__", "")).partition(".")[0]
        package = package_of_module.get(module, "" if module == "anhyst" else package)
        frame = frame.tb_next
    return "" if package in PROJECT_PACKAGES else package


def _top_module(point: EntryPoint) -> str:
    return point.value.partition(":")[0].partition(".")[0].strip()


def plugin_paths() -> list[Path]:
    """Return the folders or files of all packages that add plug-ins."""
    modules = set(map(_top_module, _all_entry_points()))
    specs = [find_spec(name) for name in sorted(modules) if name.isidentifier()]
    folders = (spec.submodule_search_locations or [spec.origin or ""] for spec in specs if spec)
    return [Path(folder_path) for folder_paths in folders for folder_path in folder_paths if folder_path]
