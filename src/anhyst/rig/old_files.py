"""Rig files of older formats, brought up to date while they are read.

There were four formats, one for each kind of rig. What moved keeps its line, so that errors name
the line of the file as it is.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable
from itertools import pairwise
from typing import Any

from anhyst.rig.magnet_table import OPENS
from anhyst.support.atomic import PathLike
from anhyst.support.errors import RenamedWarning
from anhyst.support.toml_file import FileFault, TomlFile, TomlFileError, faults_error
from anhyst.support.toml_text import Path as KeyPath


def modernise(file: TomlFile, quiet: bool = False) -> None:
    """Bring a file of an older format up to date, and warn."""
    old = (file.content.get("format"), file.content.get("version"))
    rewrite = _REWRITES.get(old) if all(isinstance(key, str | int) for key in old) else None
    if rewrite is None:
        return
    if not quiet:
        text = f"{file.path}: format {old[0]} is an older one; 'anhyst convert' writes it anew"
        warnings.warn(text, RenamedWarning, stacklevel=4)
    rewrite(_Rewriter(file))
    file.content["format"], file.content["version"] = "anhyst-rig", 2


def rig_error(path: PathLike, faults: Iterable[FileFault]) -> TomlFileError:
    """Say where in a rig file stands what its schema cannot see."""
    return faults_error(path, faults, lambda file: modernise(file, quiet=True))


class _Rewriter:
    """Moves keys and tables of a file, and their lines with them."""

    def __init__(self, file: TomlFile) -> None:
        self.file = file

    def get(self, *path: str | int) -> Any:
        """Return what stands at a place, or None."""
        here: Any = self.file.content
        for part in path:
            if isinstance(here, dict):
                here = here.get(part)
            elif isinstance(here, list) and isinstance(part, int) and part < len(here):
                here = here[part]
            else:
                return None
        return here

    def put(self, path: KeyPath, value: Any) -> bool:
        """Set a value, and the tables that lead to it; not where something else stands there."""
        here: Any = self.file.content
        for part, following in pairwise(path):
            if isinstance(here, list) and isinstance(part, int):
                here.extend({} for _ in range(part + 1 - len(here)))
                here = here[part]
            elif isinstance(here, dict):
                here = here.setdefault(part, [] if isinstance(following, int) else {})
            else:
                return False
        last = path[-1]
        if isinstance(here, list) and isinstance(last, int):
            here[last : last + 1] = [value]
        elif isinstance(here, dict):
            here[last] = value
        else:
            return False
        return True

    def move(self, old: KeyPath, new: KeyPath) -> None:
        """Move a key or a table, if it is there; one of an inline table has the line of that."""
        value = self.get(*old)
        if value is None:
            return
        parent = self.get(*old[:-1])
        if isinstance(parent, list):
            parent[int(old[-1])] = {}
        else:
            del parent[old[-1]]
        if not self.put(new, value):
            parent[old[-1]] = value
            return
        lines = self.file.lines
        line = self.file.line(old)
        for path in [path for path in lines if path[: len(old)] == old]:
            lines[(*new, *path[len(old) :])] = lines.pop(path)
        if line is not None:
            lines.setdefault(new, line)

    def rename(self, table: KeyPath, **keys: str) -> None:
        """Give keys of a table other names."""
        for old, new in keys.items():
            self.move((*table, old), (*table, new))

    def drop(self, *path: str | int) -> Any:
        """Remove a key and return what it was."""
        value = self.get(*path)
        if value is not None:
            del self.get(*path[:-1])[path[-1]]
        return value

    def listed(self, old: str, new: str, **keys: Any) -> None:
        """Make a table the next one of a list, with some keys more, if it is there."""
        if isinstance(self.get(old), dict):
            self.add((old,), new, **keys)

    def add(self, old: KeyPath, new: str, **keys: Any) -> None:
        """Make what stands anywhere the next one of a list."""
        there = () if old == (new,) else self.get(new) or ()
        if (table := self.get(*old)) is not None:
            self.move(old, (new, len(there)))
            if isinstance(table, dict):
                table.update(keys)

    def each(self, old: KeyPath, new: str, **keys: Any) -> None:
        """Make all tables of a list the next ones of another."""
        if isinstance(tables := self.get(*old), list):
            for number in range(len(tables)):
                self.add((*old, number), new, **keys)
            self.drop(*old)


def _loops(rewriter: _Rewriter, *old: str) -> None:
    """Join the files of the loops and how they are identified."""
    rewriter.move(old, (_ASIDE,))
    if isinstance(rewriter.get("identify"), dict):
        rewriter.move(("identify",), ("loops",))
    rewriter.move((_ASIDE,), ("loops", "files"))


_ASIDE = "aside"
"""Where something stands while its place is made."""


def _magnet(rewriter: _Rewriter) -> None:
    """Give a magnet or a pair its place, and its iron a name."""
    magnet = rewriter.get("magnet")
    if not isinstance(magnet, dict):
        return
    if isinstance(magnet.get("iron"), dict):
        rewriter.move(("magnet", "iron"), ("iron", 0))
        rewriter.put(("iron", 0, "name"), "core")
        magnet["iron"] = "core"
    if isinstance(magnet.get("model"), dict):
        rewriter.move(("magnet", "model"), (_ASIDE,))
        for old, new in _MODEL_KEYS.items():
            rewriter.move((_ASIDE, old), ("magnet", new))
        rewriter.drop(_ASIDE)
    rewriter.rename(("magnet",), force="kind")
    if magnet.get("kind") in [*_KINDS]:
        magnet["kind"] = _KINDS[magnet["kind"]]
    magnet.pop("arrangement", None)
    rewriter.move(("magnet", "bias_force_N"), ("control", "bias_N"))
    rewriter.listed("magnet", "magnet", name="magnet")
    rewriter.move(("simulate", "gap_m"), ("magnet", 0, "gap_m"))
    total, line = magnet.get("gap_total_m"), rewriter.file.line(("magnet", 0, "gap_total_m"))
    if not isinstance(total, float):
        return
    gap = magnet.setdefault("gap_m", 0.5 * total)
    rewriter.move(("magnet", 0, "gap_total_m"), ("magnet", 1, "gap_m"))
    if isinstance(gap, float):
        other = {"name": "opposite", "like": "magnet", "direction": OPENS, "gap_m": total - gap}
        rewriter.put(("magnet", 1), other)
    if line is not None:
        rewriter.file.lines["magnet", 1] = line


_KINDS = {"cells": "electromagnet", "model": "law"}
_MODEL_KEYS = {"file": "model", "flux_table": "flux_table"}


def _bearing(rewriter: _Rewriter) -> None:
    rewriter.put(("control",), {"kind": "levitation"})
    _loops(rewriter, "loops")
    _magnet(rewriter)
    _plant(rewriter, "position_sensor")
    rewriter.move(("simulate", "noise_seeds"), ("noise_seeds",))
    rewriter.put(("case", 0), {})
    if rewriter.get("simulate", "load_steps_N"):
        rewriter.put(("case", 1), {"kind": "load"})
        rewriter.move(("simulate", "load_steps_N"), ("case", 1, "forces_N"))
    rewriter.drop("simulate", "load_steps_N")
    rewriter.each(("simulate", "trajectories"), "case")
    rewriter.rename(("simulate",), steps_m="heights_m")
    rewriter.move(("simulate",), ("case", 0))
    rewriter.put(("case", 0, "kind"), "step")
    rewriter.rename(("drift",), gap_offset_m="gap_zero_m")
    rewriter.move(("drift",), ("spread",))
    zero = rewriter.get("spread", "gap_zero_m")
    rewriter.put(("spread", "gap_zero_m"), 2e-6 if zero is None else zero)


def _plant(rewriter: _Rewriter, gap_sensor: str) -> None:
    rewriter.listed("amplifier", "amplifier")
    rewriter.listed("mechanics", "body")
    for name, of in ((gap_sensor, "gap"), *_SENSORS.items()):
        rewriter.listed(name, "sensor", of=of)


_SENSORS = {"current_sensor": "current", "force_sensor": "force", "hall_probe": "flux"}


def _stage(rewriter: _Rewriter) -> None:
    rewriter.put(("control",), {"kind": "tracking"})
    _loops(rewriter, "loops")
    _magnet(rewriter)
    _plant(rewriter, "gap_sensor")
    for key in ("format", "crossover_Hz", "force_max_N"):
        rewriter.move(("tracking", key), ("control", key))
    rewriter.move(("tracking", "stray_m"), ("frame", "stray_m"))
    rewriter.move(("tracking", "noise_seeds"), ("noise_seeds",))
    rewriter.put(("noise_seeds",), rewriter.get("noise_seeds") or 3)
    index = len(rewriter.get("sensor") or [])
    rewriter.move(("tracking", "position_noise_m"), ("sensor", index, "noise_m"))
    if (sensor := rewriter.get("sensor", index)) is not None:
        sensor["of"] = "position"
    rewriter.listed("tracking", "case", kind="scan")
    rewriter.move(("calibration",), ("spread",))


def _force(rewriter: _Rewriter) -> None:
    rewriter.put(("control",), {"kind": "force"})
    rewriter.move(("rate_Hz",), ("timing", "rate_Hz"))
    _loops(rewriter, "force_control", "loops")
    _magnet(rewriter)
    if rewriter.get("solenoid") is not None:
        path = ("magnet", len(rewriter.get("magnet") or []))
        rewriter.put(path, {"name": "solenoid", "kind": "solenoid"})
        rewriter.move(("solenoid",), (*path, "file"))
    rewriter.rename(("amplifier",), current_max_A="current_high_A")
    rewriter.move(("amplifier", "shunt_offset_A"), ("current_sensor", "offset_A"))
    if isinstance(lvdt := rewriter.get("lvdt"), dict):
        lvdt["kind"] = "lvdt"
    _plant(rewriter, "lvdt")
    for key in ("force_max_N", "end_m"):
        rewriter.move(("force_control", key), ("control", key))
    rewriter.each(("force_control", "demand"), "case", kind="force")
    rewriter.add(("force_control", "moving"), "case", kind="moving")
    rewriter.rename(("force_control",), positions_m="gaps_m")
    rewriter.listed("force_control", "case", kind="held")


def _piezo(rewriter: _Rewriter) -> None:
    rewriter.listed("stack", "stack")
    rewriter.listed("stage", "body")
    rewriter.listed("amplifier", "amplifier", mode="stack")
    rewriter.listed("sensor", "sensor", of="position")
    rewriter.move(("control", "rate_Hz"), ("timing", "rate_Hz"))
    rewriter.put(("control", "kind"), "displacement")
    rewriter.listed("reference", "case", kind="displacement")


_REWRITES: dict[tuple[Any, Any], Callable[[_Rewriter], None]] = {
    ("anhyst-bearing", 1): _bearing,
    ("anhyst-stage", 1): _stage,
    ("anhyst-rig", 1): _force,
    ("anhyst-piezo-stage", 1): _piezo,
}
"""What brings each of the older formats up to date."""
