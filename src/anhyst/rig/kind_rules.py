"""What each kind of rig has in its file, and how the tables of a file refer to each other."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

from anhyst.rig.case_table import (
    DisplacementCase,
    ForceCase,
    HeldCase,
    LoadCase,
    LossCase,
    MovingCase,
    ScanCase,
    StepCase,
    TrajectoryCase,
)
from anhyst.rig.file import RigFile
from anhyst.rig.magnet_table import CLOSES, FROM_LOOPS, OPENS, LikeTable, MagnetTable, SolenoidTable
from anhyst.rig.measurement_table import identify_faults
from anhyst.rig.sensor_table import (
    CurrentSensorTable,
    FluxSensorTable,
    ForceSensorTable,
    GapSensorTable,
    PositionSensorTable,
)
from anhyst.rig.tables import (
    AmplifierTable,
    BodyTable,
    FlexureTable,
    SpreadTable,
    StackAmplifierTable,
    StackTable,
    TimingTable,
    TrackingTable,
    spread_keys,
)
from anhyst.support.atomic import PathLike
from anhyst.support.kinds import NAMES, FileKind
from anhyst.support.toml_file import FileFault, Table, faults_error, read_toml

ONE, SOME, ANY, MANY = (1, 1), (0, 1), (0, math.inf), (1, math.inf)
"""How many tables of a kind a rig has."""


@dataclass(frozen=True)
class KindRule:
    """What the file of one kind of rig holds beside times, sensors and control."""

    tables: Mapping[type[Table], tuple[float, float]]  # lists: how many of each kind of table
    single: Mapping[str, bool]  # other tables and keys that it may have: whether it must
    # keys that a table of it must have though others may leave them out, and those without a use
    needed: Mapping[type[Table], tuple[str, ...]] = field(default_factory=dict)
    unused: Mapping[type[Table], tuple[str, ...]] = field(default_factory=dict)
    # how many tables there are instead where the body is free in several coordinates
    several: Mapping[type[Table], tuple[float, float]] = field(default_factory=dict)


_READ: Mapping[type[Table], tuple[float, float]] = {
    GapSensorTable: ONE,
    CurrentSensorTable: ONE,
    ForceSensorTable: ONE,
}
_BODY_NEEDS: Mapping[type[Table], tuple[str, ...]] = {
    MagnetTable: ("gap_m",),
    AmplifierTable: ("supply_V",),
}
_BODY_UNUSED: Mapping[type[Table], tuple[str, ...]] = {
    AmplifierTable: ("slew_A_per_s",),
    CurrentSensorTable: ("offset_A",),
    PositionSensorTable: ("step_m",),
}


_SEVERAL_NEED: Mapping[type[Table], tuple[str, ...]] = {
    MagnetTable: ("direction", "position_m"),
    LikeTable: ("position_m",),
    PositionSensorTable: ("direction", "position_m"),
}
"""Keys that say where things are on a body of several coordinates."""
_ONE_UNUSED: Mapping[type[Table], tuple[str, ...]] = {
    MagnetTable: ("position_m",),
    LikeTable: ("position_m",),
    PositionSensorTable: ("direction", "position_m", "stands", "dead_path_m", "refraction_ppm"),
    BodyTable: (
        *("centre_m", "inertia_kg_m2", "tilt_rad"),
        *("cable_N_per_m", "cable_N_s_per_m", "cable_m"),
    ),
    ScanCase: ("direction",),
    TrackingTable: (
        "force_min_N",
        "lost_A",
        "lost_s",
        "head_m_per_s",
        "head_s",
        "land_m_per_s",
        "lift_m_per_s",
    ),
    SpreadTable: ("centre_m", "head_m"),
}
"""Keys without a use where there is one coordinate."""
_SEVERAL_UNUSED: Mapping[type[Table], tuple[str, ...]] = {
    SpreadTable: ("eddy_s", "conductivity_percent", "cable_N_per_m")
}


def _no_spread(kind: FileKind) -> tuple[str, ...]:
    """Return the keys of ``[spread]`` that a kind has no use for."""
    used = spread_keys(kind)
    return tuple(key for key in SpreadTable.model_fields if key not in used)


RULES: Mapping[FileKind, KindRule] = {
    FileKind.BEARING: KindRule(
        tables={
            **_READ,
            MagnetTable: ONE,
            LikeTable: SOME,
            AmplifierTable: ONE,
            BodyTable: ONE,
            FluxSensorTable: SOME,
            StepCase: ONE,
            LoadCase: SOME,
            TrajectoryCase: ANY,
        },
        single={
            "loops": True,
            "load": True,
            "measurement": True,
            "excite": False,
            "spread": False,
            "seed": False,
            "noise_seeds": False,
        },
        needed=_BODY_NEEDS,
        unused={**_BODY_UNUSED, BodyTable: ("free",), SpreadTable: _no_spread(FileKind.BEARING)},
    ),
    FileKind.STAGE: KindRule(
        tables={
            **_READ,
            MagnetTable: ONE,
            LikeTable: ONE,
            AmplifierTable: ONE,
            BodyTable: ONE,
            FluxSensorTable: SOME,
            PositionSensorTable: ONE,
            ScanCase: ONE,
        },
        single={
            "loops": True,
            "measurement": True,
            "excite": False,
            "frame": False,
            "spread": False,
            "seed": False,
            "noise_seeds": False,
        },
        needed=_BODY_NEEDS,
        unused={**_BODY_UNUSED, SpreadTable: _no_spread(FileKind.STAGE)},
        several={LikeTable: MANY, PositionSensorTable: MANY, LossCase: SOME},
    ),
    FileKind.FORCE: KindRule(
        tables={
            **_READ,
            MagnetTable: SOME,
            SolenoidTable: SOME,
            AmplifierTable: ONE,
            ForceCase: MANY,
            HeldCase: ONE,
            MovingCase: ONE,
        },
        single={"loops": True, "excite": False, "spread": False, "seed": False},
        needed={AmplifierTable: ("slew_A_per_s",)},
        unused={
            TimingTable: ("substeps", "delay_ticks"),
            MagnetTable: ("gap_m", "direction", "eddy_time_s", "model", "flux_table"),
            AmplifierTable: ("mode", "supply_V", "current_low_A", "delay_s"),
            GapSensorTable: ("delay_s", "gain_error", "offset_m"),
            CurrentSensorTable: ("gain_error",),
            SpreadTable: _no_spread(FileKind.FORCE),
        },
    ),
    FileKind.PIEZO: KindRule(
        tables={
            StackTable: ONE,
            StackAmplifierTable: ONE,
            FlexureTable: ONE,
            PositionSensorTable: ONE,
            DisplacementCase: ONE,
        },
        single={"spread": False, "seed": False},
        needed={PositionSensorTable: ("step_m",)},
        unused={TimingTable: ("substeps", "delay_ticks"), SpreadTable: _no_spread(FileKind.PIEZO)},
    ),
}

_SINGLE = ("loops", "load", "frame", "measurement", "excite", "spread", "seed", "noise_seeds")
_TITLES: Mapping[type[Table], tuple[str, str]] = {
    MagnetTable: ("magnet", "a [[magnet]] with winding and poles"),
    LikeTable: ("magnet", "a second [[magnet]], with like and direction"),
    SolenoidTable: ("magnet", 'a [[magnet]] of kind "solenoid"'),
    StackTable: ("stack", "a [[stack]]"),
    AmplifierTable: ("amplifier", 'an [[amplifier]] with mode "current" or "voltage"'),
    StackAmplifierTable: ("amplifier", 'an [[amplifier]] with mode "stack"'),
    BodyTable: ("body", "a [[body]] with mass_kg and stops"),
    FlexureTable: ("body", "a [[body]] with resonance_Hz"),
    GapSensorTable: ("sensor", 'a [[sensor]] of = "gap"'),
    CurrentSensorTable: ("sensor", 'a [[sensor]] of = "current"'),
    ForceSensorTable: ("sensor", 'a [[sensor]] of = "force"'),
    FluxSensorTable: ("sensor", 'a [[sensor]] of = "flux"'),
    PositionSensorTable: ("sensor", 'a [[sensor]] of = "position"'),
    StepCase: ("case", 'a [[case]] of kind "step"'),
    LoadCase: ("case", 'a [[case]] of kind "load"'),
    TrajectoryCase: ("case", 'a [[case]] of kind "triangle" or "sine"'),
    ScanCase: ("case", 'a [[case]] of kind "scan"'),
    LossCase: ("case", 'a [[case]] of kind "loss"'),
    ForceCase: ("case", 'a [[case]] of kind "force"'),
    HeldCase: ("case", 'a [[case]] of kind "held"'),
    MovingCase: ("case", 'a [[case]] of kind "moving"'),
    DisplacementCase: ("case", 'a [[case]] of kind "displacement"'),
}
"""Key of the list that holds a table, and what messages call it."""


def _count_faults(file: RigFile) -> Iterator[FileFault]:
    rule, whose = RULES[file.kind], NAMES[file.kind][0]
    counts = {**rule.tables, **(rule.several if file.several else {})}
    for kind, (key, title) in _TITLES.items():
        places = [path for path, table in file.tables() if type(table) is kind]
        least, most = counts.get(kind, (0, 0))
        if len(places) < least:
            yield FileFault((key,), f"{whose} needs {title}; add one", code="missing")
        elif len(places) > most:
            text = f"{whose} has no use for {title}" if not most else f"{whose} has one of them"
            yield FileFault(places[int(most)], f"{text}; remove it", code="not-for-this-kind")
    actuators = [kind for kind in (MagnetTable, SolenoidTable) if kind in rule.tables]
    if len(actuators) == 2 and len(file.magnets) != 1:
        text = "needs one magnet: with winding and poles, or a solenoid; correct it"
        yield FileFault(("magnet",), text, code="one-of-two")


def _single_faults(file: RigFile) -> Iterator[FileFault]:
    rule, whose = RULES[file.kind], NAMES[file.kind][0]
    fields = file.model_fields_set
    for key in _SINGLE:
        written = bool({key, f"given_{key}"} & fields)
        if rule.single.get(key, False) and not written:
            yield FileFault((key,), f"{whose} needs it; add it", code="missing")
        if key not in rule.single and written:
            text = f"{whose} has no use for it; remove it"
            yield FileFault((key,), text, code="not-for-this-kind")


def _key_faults(file: RigFile) -> Iterator[FileFault]:
    rule, whose = RULES[file.kind], NAMES[file.kind][0]
    single: list[tuple[Any, Table]] = [
        (("timing",), file.timing),
        (("control",), file.control),
        (("spread",), file.spread),
    ]
    also = _SEVERAL_NEED if file.several else {}
    besides = _SEVERAL_UNUSED if file.several else _ONE_UNUSED
    for path, table in [*file.tables(), *single]:
        for key in (*rule.needed.get(type(table), ()), *also.get(type(table), ())):
            if key not in table.model_fields_set:
                text = f"is missing, {whose} needs it; add it"
                yield FileFault((*path, key), text, code="missing")
        for key in (*rule.unused.get(type(table), ()), *besides.get(type(table), ())):
            if key in table.model_fields_set:
                text = f"{whose} has no use for it; remove it"
                yield FileFault((*path, key), text, code="not-for-this-kind")


def _name_faults(file: RigFile) -> Iterator[FileFault]:
    names = [iron.name for iron in file.irons]
    named = {
        magnet_table.iron for magnet_table in file.magnets if isinstance(magnet_table, MagnetTable)
    }
    named -= {None, FROM_LOOPS}
    for number, name in enumerate(names):
        if name == FROM_LOOPS or name in names[:number]:
            text = f"'{name}' is taken; choose another name"
            yield FileFault(("iron", number, "name"), text, code="name-taken")
        if named <= {*names} and name not in named:
            text = f"no magnet is made of '{name}'; remove it, or name it in one"
            yield FileFault(("iron", number), text, code="not-used")
    called = [magnet.name for magnet in file.magnets]
    for number, name in enumerate(called):
        if name in called[:number]:
            text = f"'{name}' is taken; choose another name"
            yield FileFault(("magnet", number, "name"), text, code="name-taken")
    for path, magnet in file.tables():
        if isinstance(magnet, LossCase) and not set(magnet.magnets or []) <= {*called}:
            text = f"there is no such [[magnet]]; name one or more of {', '.join(called)}"
            yield FileFault((*path, "magnets"), text, code="unknown-name")
        if isinstance(magnet, MagnetTable) and magnet.iron not in (None, FROM_LOOPS, *names):
            text = f"there is no [[iron]] '{magnet.iron}'; correct it"
            yield FileFault((*path, "iron"), text, code="unknown-name")
        if isinstance(magnet, LikeTable):
            yield from _opposite_faults(file, path, magnet)
        elif isinstance(magnet, MagnetTable) and magnet.direction != CLOSES and not file.several:
            text = f"the first magnet pulls along {CLOSES}, towards smaller gaps; write that"
            yield FileFault((*path, "direction"), text, code="wrong-direction")
    yield from _pair_faults(file)


def _pair_faults(file: RigFile) -> Iterator[FileFault]:
    first = next((magnet for magnet in file.magnets if isinstance(magnet, MagnetTable)), None)
    pushes = first is not None and first.both_ways
    if first is not None and pushes and not file.several:
        text = "pushes as well as it pulls; it is for a stage of several coordinates"
        yield FileFault(file.place(first, "kind"), text, code="not-for-this-kind")
    if file.kind not in (FileKind.BEARING, FileKind.STAGE):
        return
    pairs = not pushes and (file.opposite is not None or file.kind is FileKind.STAGE)
    if pairs != (file.bias_N is not None):
        text = "a pair of magnets needs it; add it"
        if not pairs:
            text = "belongs to a pair of magnets; remove it"
        yield FileFault(("control", "bias_N"), text, code="pair-only")
    if first is not None and pushes and isinstance(file.control, TrackingTable):
        yield from _push_faults(file, first, file.control)


def _push_faults(file: RigFile, first: MagnetTable, control: TrackingTable) -> Iterator[FileFault]:
    """Find what magnets that push as well as they pull have no use for."""
    if "force_min_N" in control.model_fields_set:
        text = "is of magnets that only pull; remove it"
        yield FileFault(("control", "force_min_N"), text, code="not-for-this-kind")
    if control.format == "fixed":
        text = 'magnets that push as well as they pull have none; write "f64" or "f32"'
        yield FileFault(("control", "format"), text, code="not-for-this-kind")
    for magnet in file.magnets:
        if isinstance(magnet, LikeTable) and magnet.gap_m != first.gap_m:
            text = f"'{first.name}' is made for {first.gap_m:g} m; write that"
            yield FileFault(file.place(magnet, "gap_m"), text, code="option-differs")


def _opposite_faults(file: RigFile, path: Any, magnet: LikeTable) -> Iterator[FileFault]:
    first = next((table for table in file.magnets if isinstance(table, MagnetTable)), None)
    if first is not None and magnet.like != first.name:
        text = f"names no magnet; write '{first.name}'"
        yield FileFault((*path, "like"), text, code="unknown-name")
    if magnet.direction != OPENS and not file.several:
        text = f"a second magnet pulls against the first, along {OPENS}; write that"
        yield FileFault((*path, "direction"), text, code="wrong-direction")


def read_rig_file(path: PathLike, kinds: Collection[FileKind]) -> RigFile:
    """Read the rig file of one of the given kinds."""
    file = read_toml(path, RigFile, kinds=kinds)
    faults = [*_count_faults(file), *_single_faults(file), *_key_faults(file), *_name_faults(file)]
    if file.given_loops is not None:
        faults += identify_faults(file.loops)
    if faults:
        raise faults_error(path, faults)
    return file
