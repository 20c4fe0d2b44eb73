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
from anhyst.support.toml_file import FileFault, TomlFile, TomlFileError
from anhyst.support.toml_text import Path as KeyPath


def modernise(file: TomlFile, quiet: bool = False) -> None:
    """Bring a file of an older format up to date, and warn."""
    old = (file.content.get("format"), file.content.get("version"))
    rewrite = _REWRITES.get(old) if all(isinstance(one, str | int) for one in old) else None
    if rewrite is None:
        return
    if not quiet:
        text = f"{file.path}: format {old[0]} is an older one; 'anhyst convert' writes it anew"
        warnings.warn(text, RenamedWarning, stacklevel=4)
    rewrite(_Rewriter(file))
    file.content["format"], file.content["version"] = "anhyst-rig", 2


def rig_error(path: PathLike, faults: Iterable[FileFault]) -> TomlFileError:
    """Say where in a rig file stands what its schema cannot see."""
    file = TomlFile(path)
    modernise(file, quiet=True)
    for fault in faults:
        file.add(*fault)
    return file.error()


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

    def put(self, path: KeyPath, value: Any) -> None:
        """Set a value, and the tables that lead to it."""
        here: Any = self.file.content
        for part, following in pairwise(path):
            if isinstance(here, list):
                while len(here) <= int(part):
                    here.append({})
                here = here[int(part)]
            else:
                here = here.setdefault(part, [] if isinstance(following, int) else {})
        if isinstance(here, list):
            place = int(path[-1])
            here[place : place + (here[place : place + 1] == [{}])] = [value]
        elif isinstance(here, dict):
            here[path[-1]] = value

    def move(self, old: KeyPath, new: KeyPath) -> None:
        """Move a key or a table, if it is there."""
        value = self.get(*old)
        if value is None:
            return
        del self.get(*old[:-1])[old[-1]]
        self.put(new, value)
        lines = self.file.lines
        for path in [path for path in lines if path[: len(old)] == old]:
            lines[(*new, *path[len(old) :])] = lines.pop(path)

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
        table = self.get(old)
        if isinstance(table, dict):
            self.move((old,), (new, 0 if old == new else len(self.get(new) or [])))
            table.update(keys)


def _loops(rewriter: _Rewriter, *old: str) -> None:
    """Join the files of the loops and how they are identified."""
    found = rewriter.drop(*old)
    if found is None:
        return
    line = rewriter.file.lines.pop(tuple(old), None)
    rewriter.move(("identify",), ("loops",))
    rewriter.put(("loops", "files"), found)
    if line is not None:
        rewriter.file.lines["loops", "files"] = line


def _magnet(rewriter: _Rewriter, gap: Any) -> None:
    """Give a magnet or a pair its place, and its iron a name."""
    magnet = rewriter.get("magnet")
    if not isinstance(magnet, dict):
        return
    if isinstance(magnet.get("iron"), dict):
        rewriter.move(("magnet", "iron"), ("iron", 0))
        rewriter.put(("iron", 0, "name"), "core")
        magnet["iron"] = "core"
    model = rewriter.drop("magnet", "model")
    if isinstance(model, dict):
        magnet.update({new: model[old] for old, new in _MODEL_KEYS.items() if old in model})
    if (force := magnet.pop("force", None)) is not None:
        magnet["kind"] = {"cells": "electromagnet", "model": "law"}.get(force, force)
    magnet.pop("arrangement", None)
    total = magnet.pop("gap_total_m", None)
    rewriter.move(("magnet", "bias_force_N"), ("control", "bias_N"))
    gap = 0.5 * total if gap is None and isinstance(total, float) else gap
    rewriter.listed("magnet", "magnet", name="magnet", **({} if gap is None else {"gap_m": gap}))
    if isinstance(total, float) and isinstance(gap, float):
        other = {"name": "opposite", "like": "magnet", "direction": OPENS, "gap_m": total - gap}
        rewriter.put(("magnet", 1), other)


_MODEL_KEYS = {"file": "model", "flux_table": "flux_table"}


def _bearing(rewriter: _Rewriter) -> None:
    rewriter.put(("control",), {"kind": "levitation"})
    _loops(rewriter, "loops")
    _magnet(rewriter, rewriter.drop("simulate", "gap_m"))
    _plant(rewriter, "position_sensor")
    rewriter.move(("simulate", "noise_seeds"), ("noise_seeds",))
    rewriter.put(("case", 0), {})
    if rewriter.get("simulate", "load_steps_N"):
        rewriter.put(("case", 1), {"kind": "load"})
        rewriter.move(("simulate", "load_steps_N"), ("case", 1, "forces_N"))
    rewriter.drop("simulate", "load_steps_N")
    for trajectory in rewriter.drop("simulate", "trajectories") or []:
        rewriter.put(("case", len(rewriter.get("case"))), trajectory)
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
    _magnet(rewriter, None)
    _plant(rewriter, "gap_sensor")
    for key in ("format", "crossover_Hz", "force_max_N"):
        rewriter.move(("tracking", key), ("control", key))
    rewriter.move(("tracking", "stray_m"), ("frame", "stray_m"))
    rewriter.move(("tracking", "noise_seeds"), ("noise_seeds",))
    rewriter.put(("noise_seeds",), rewriter.get("noise_seeds") or 3)
    place = len(rewriter.get("sensor") or [])
    rewriter.move(("tracking", "position_noise_m"), ("sensor", place, "noise_m"))
    if (sensor := rewriter.get("sensor", place)) is not None:
        sensor["of"] = "position"
    rewriter.listed("tracking", "case", kind="scan")
    rewriter.move(("calibration",), ("spread",))


def _force(rewriter: _Rewriter) -> None:
    control = rewriter.get("force_control")
    rewriter.put(("control",), {"kind": "force"})
    rewriter.move(("rate_Hz",), ("timing", "rate_Hz"))
    _loops(rewriter, "force_control", "loops")
    solenoid = rewriter.drop("solenoid")
    _magnet(rewriter, None)
    if solenoid is not None:
        found = {"name": "solenoid", "kind": "solenoid", "file": solenoid}
        rewriter.put(("magnet", len(rewriter.get("magnet") or [])), found)
    rewriter.rename(("amplifier",), current_max_A="current_high_A")
    rewriter.move(("amplifier", "shunt_offset_A"), ("current_sensor", "offset_A"))
    if isinstance(lvdt := rewriter.get("lvdt"), dict):
        lvdt["kind"] = "lvdt"
    _plant(rewriter, "lvdt")
    if not isinstance(control, dict):
        return
    for key in ("force_max_N", "end_m"):
        rewriter.move(("force_control", key), ("control", key))
    cases: list[tuple[KeyPath, str]] = [
        (("force_control", "demand", number), "force")
        for number in range(len(control.get("demand") or []))
    ]
    for old, kind in [*cases, (("force_control", "moving"), "moving")]:
        if isinstance(table := rewriter.get(*old), dict):
            rewriter.put(("case", len(rewriter.get("case") or [])), {"kind": kind, **table})
    rewriter.drop("force_control", "demand")
    rewriter.drop("force_control", "moving")
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
