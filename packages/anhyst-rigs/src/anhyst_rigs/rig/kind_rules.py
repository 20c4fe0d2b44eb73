"""Check that a rig file has the tables and keys of its kind, and that all names in it exist.

Grids list, for each kind of rig, the permitted number of tables and the required keys.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

from anhyst.support.atomic import PathLike
from anhyst.support.kinds import rig_kinds
from anhyst.support.toml_file import FileFault, Table, faults_error, read_toml
from anhyst.support.toml_text import KeyPath
from anhyst_rigs.rig import case_table, sensor_table, tables
from anhyst_rigs.rig.file import RigFile
from anhyst_rigs.rig.magnet_table import FROM_LOOPS, OPENS_GAP, LikeTable, MagnetTable, SolenoidTable
from anhyst_rigs.rig.measurement_table import identify_faults
from anhyst_rigs.rig.parts.magnet import COUPLED, PERMANENT_MAGNET

RIG_KINDS = ("levitation", "tracking", "force", "displacement")
"""Kinds of rigs, in the order of the columns of the grids below: values of ``control.kind``."""
_COUNT_LIMITS = {"1": (1, 1), "?": (0, 1), "*": (0, math.inf), "+": (1, math.inf), ".": (0, 0)}
"""Smallest and largest number of tables that each symbol of a grid permits."""

_TABLE_RULES: Mapping[type[Table], tuple[str, str, str]] = {
    MagnetTable: ("1 1 ? .", "magnet", "a [[magnet]] with winding and poles"),
    LikeTable: ("? + . .", "magnet", "a second [[magnet]], with like and direction"),
    SolenoidTable: (". . ? .", "magnet", 'a [[magnet]] of kind "solenoid"'),
    tables.StackTable: (". . . 1", "stack", "a [[stack]]"),
    tables.AmplifierTable: ("1 1 1 .", "amplifier", 'an [[amplifier]] with mode "current" or "voltage"'),
    tables.StackAmplifierTable: (". . . 1", "amplifier", 'an [[amplifier]] with mode "stack"'),
    tables.BodyTable: ("1 1 . .", "body", "a [[body]] with mass_kg and stops"),
    tables.FlexureTable: (". . . 1", "body", "a [[body]] with resonance_Hz"),
    sensor_table.GapSensorTable: ("1 1 1 .", "sensor", 'a [[sensor]] of = "gap"'),
    sensor_table.CurrentSensorTable: ("1 1 1 .", "sensor", 'a [[sensor]] of = "current"'),
    sensor_table.ForceSensorTable: ("1 1 1 .", "sensor", 'a [[sensor]] of = "force"'),
    sensor_table.FluxSensorTable: ("? ? . .", "sensor", 'a [[sensor]] of = "flux"'),
    sensor_table.VoltageSensorTable: ("? ? ? .", "sensor", 'a [[sensor]] of = "voltage"'),
    sensor_table.PositionSensorTable: (". + . 1", "sensor", 'a [[sensor]] of = "position"'),
    case_table.StepCase: ("1 . . .", "case", 'a [[case]] of kind "step"'),
    case_table.LoadCase: ("? . . .", "case", 'a [[case]] of kind "load"'),
    case_table.TrajectoryCase: ("* . . .", "case", 'a [[case]] of kind "triangle" or "sine"'),
    case_table.ScanCase: (". 1 . .", "case", 'a [[case]] of kind "scan"'),
    case_table.LossCase: (". ? . .", "case", 'a [[case]] of kind "loss"'),
    case_table.ForceCase: (". . + .", "case", 'a [[case]] of kind "force"'),
    case_table.HeldCase: (". . 1 .", "case", 'a [[case]] of kind "held"'),
    case_table.MovingCase: (". . 1 .", "case", 'a [[case]] of kind "moving"'),
    case_table.DisplacementCase: (". . . 1", "case", 'a [[case]] of kind "displacement"'),
}
"""For each type of table: permitted number by kind of rig, key of its list, and name in messages.
"""

_SINGLE_KEY_RULES = {
    "loops": "1 1 1 .",
    "load": "1 . . .",
    "frame": ". ? . .",
    "measurement": "1 1 . .",
    "excite": "? ? ? .",
    "spread": "? ? ? ?",
    "seed": "? ? ? ?",
    "noise_seeds": "? ? . .",
}
"""Grid of other tables and top-level keys. 1: required; ?: optional; .: not permitted."""

_TABLE_KEY_RULES: Mapping[type[Table], Mapping[str, str]] = {
    tables.TimingTable: dict.fromkeys(("substeps", "delay_ticks"), "? ? . ."),
    MagnetTable: {
        "gap_m": "1 1 . .",
        "direction": "? ? . .",
        "position_m": ". ? . .",
        **dict.fromkeys(("eddy_time_s", "model", "flux_table"), "? ? . ."),
    },
    LikeTable: {"position_m": ". ? . ."},
    tables.AmplifierTable: {
        "supply_V": "1 1 . .",
        "slew_A_per_s": ". . 1 .",
        "current_low_A": "? ? ? .",
        **dict.fromkeys(("mode", "delay_s"), "? ? . ."),
    },
    tables.BodyTable: {
        "free": ". ? . .",
        **dict.fromkeys(("centre_m", "inertia_kg_m2", "tilt_rad"), ". ? . ."),
        **dict.fromkeys(("cable_N_per_m", "cable_N_s_per_m", "cable_m"), ". ? . ."),
    },
    sensor_table.GapSensorTable: dict.fromkeys(("delay_s", "gain_error", "offset_m"), "? ? . ."),
    sensor_table.CurrentSensorTable: {"offset_A": ". . ? .", "gain_error": "? ? . ."},
    sensor_table.PositionSensorTable: {
        "step_m": ". . . 1",
        **dict.fromkeys(("direction", "position_m"), ". ? . ."),
        **dict.fromkeys(("stands", "dead_path_m", "refraction_ppm"), ". ? . ."),
    },
    case_table.ScanCase: {"direction": ". ? . ."},
    tables.TrackingTable: {
        **dict.fromkeys(("force_min_N", "lost_A", "lost_s"), ". ? . ."),
        **dict.fromkeys(("head_m_per_s", "head_s", "land_m_per_s", "lift_m_per_s"), ". ? . ."),
    },
}
"""Grid of keys that some kinds of rigs require or do not permit. All other keys are optional."""


def _count_limits(file: RigFile, grid_row: str) -> tuple[float, float]:
    """Return the smallest and largest number that a row of a grid permits for the kind of a file."""
    return _COUNT_LIMITS[grid_row.split()[RIG_KINDS.index(file.control.kind)]]


def allows_key(file: RigFile, key: str) -> bool:
    """Whether the kind of a file permits a single table or a top-level key."""
    return _count_limits(file, _SINGLE_KEY_RULES[key])[1] > 0


def _count_faults(file: RigFile) -> Iterator[FileFault]:
    rig_title = file.kind.title
    for table, (grid_row, key, title) in _TABLE_RULES.items():
        table_paths = [path for path, file_table in file.tables() if type(file_table) is table]
        min_count, max_count = _count_limits(file, grid_row)
        if len(table_paths) < min_count:
            yield FileFault((key,), f"{rig_title} needs {title}; add one", code="missing")
        elif len(table_paths) > max_count:
            text = (
                f"{rig_title} does not use {title}" if not max_count else f"{rig_title} has only one of them"
            )
            yield FileFault(table_paths[int(max_count)], f"{text}; remove it", code="not-for-this-kind")
    if file.hall_probe is not None and file.coil_sensor is not None:
        text = 'the flux has one sensor: of = "flux" or of = "voltage"; remove the other'
        yield FileFault(file.key_path(file.coil_sensor, "of"), text, code="both-given")
    if file.coil_sensor is not None and getattr(file.control, "calibrate", False):
        text = "online calibration needs a Hall probe for flux and fused; remove it"
        yield FileFault(("control", "calibrate"), text, code="no-hall-probe")
    if _count_limits(file, _TABLE_RULES[SolenoidTable][0])[1] and len(file.magnets) != 1:
        text = "needs one magnet: with winding and poles, or a solenoid; correct it"
        yield FileFault(("magnet",), text, code="one-of-two")


def _key_faults(file: RigFile) -> Iterator[FileFault]:
    for key, grid_row in _SINGLE_KEY_RULES.items():
        is_given = bool({key, f"given_{key}"} & file.model_fields_set)
        yield from _presence_fault(file, (key,), grid_row, is_given, "needs it; add it")
    single_tables: list[tuple[Any, Table]] = [(("timing",), file.timing), (("control",), file.control)]
    for path, table in [*file.tables(), *single_tables]:
        grid = _TABLE_RULES.get(type(table))
        if grid is not None and not _count_limits(file, grid[0])[1]:
            continue  # The whole table is not permitted, which another fault reports.
        for key, grid_row in _TABLE_KEY_RULES.get(type(table), {}).items():
            is_given = key in table.model_fields_set
            yield from _presence_fault(file, (*path, key), grid_row, is_given, "")
    spread = tables.SPREADS[file.control.kind]
    for key in sorted(file.spread.model_fields_set.difference(spread.keys)):
        yield from _presence_fault(file, ("spread", key), ". . . .", True, "")


def _presence_fault(
    file: RigFile, path: KeyPath, grid_row: str, is_given: bool, need_text: str
) -> Iterator[FileFault]:
    """Find a required key that is missing, or a present key that is not permitted."""
    rig_title, (min_count, max_count) = file.kind.title, _count_limits(file, grid_row)
    if min_count and not is_given:
        text = f"{rig_title} {need_text}" if need_text else f"is missing, {rig_title} needs it; add it"
        yield FileFault(path, text, code="missing")
    if not max_count and is_given:
        text = f"{rig_title} does not use it; remove it"
        yield FileFault(path, text, code="not-for-this-kind")


def _name_faults(file: RigFile) -> Iterator[FileFault]:
    names = [iron.name for iron in file.irons]
    used_irons = {magnet_entry.iron for magnet_entry in file.magnets if isinstance(magnet_entry, MagnetTable)}
    used_irons -= {None, FROM_LOOPS}
    for number, name in enumerate(names):
        if name == FROM_LOOPS or name in names[:number]:
            text = f"'{name}' is already used; choose another name"
            yield FileFault(("iron", number, "name"), text, code="name-taken")
        if used_irons <= {*names} and name not in used_irons:
            text = f"no magnet uses '{name}'; remove it, or name it in a magnet"
            yield FileFault(("iron", number), text, code="not-used")
    magnet_names = [magnet.name for magnet in file.magnets]
    first_magnet = next(
        (listed_names for listed_names in file.magnets if isinstance(listed_names, MagnetTable)), None
    )
    for number, name in enumerate(magnet_names):
        if name in magnet_names[:number]:
            text = f"'{name}' is already used; choose another name"
            yield FileFault(("magnet", number, "name"), text, code="name-taken")
    for path, magnet in file.tables():
        if isinstance(magnet, case_table.LossCase) and not set(magnet.magnets or []) <= {*magnet_names}:
            text = f"there is no such [[magnet]]; name one or more of {', '.join(magnet_names)}"
            yield FileFault((*path, "magnets"), text, code="unknown-name")
        if isinstance(magnet, MagnetTable) and magnet.iron not in (None, FROM_LOOPS, *names):
            text = f"there is no [[iron]] '{magnet.iron}'; correct it"
            yield FileFault((*path, "iron"), text, code="unknown-name")
        if isinstance(magnet, LikeTable) and first_magnet is not None and magnet.like != first_magnet.name:
            text = f"is not the first magnet; write '{first_magnet.name}'"
            yield FileFault((*path, "like"), text, code="unknown-name")
    if hasattr(file.control, "bias_N"):
        yield from _pair_faults(file, first_magnet)


def _circuit_faults(file: RigFile) -> Iterator[FileFault]:
    """Find keys that do not suit a permanent magnet or two coils on one yoke."""
    magnets = [table for table in file.magnets if isinstance(table, MagnetTable)]
    magnet = next((table for table in magnets if table.kind in (COUPLED, PERMANENT_MAGNET)), None)
    is_complete = magnet is not None and not magnet.has_iron_from_loops
    for path, table in file.tables():
        if isinstance(table, tables.AmplifierTable) and magnet is None:
            is_given = "current_low_A" in table.model_fields_set
            yield from _presence_fault(file, (*path, "current_low_A"), "? ? . .", is_given, "")
        elif isinstance(table, tables.AmplifierTable) and magnet is not None and is_complete:
            low = -magnet.poles.magnet_mmf / magnet.poles.turns
            if magnet.kind == PERMANENT_MAGNET and table.current_low_A < low:
                text = f"reverses the flux of the permanent magnet; raise it to {low:.3g} A or more"
                yield FileFault((*path, "current_low_A"), text, code="out-of-range")
        elif magnet and isinstance(table, sensor_table.FluxSensorTable | sensor_table.VoltageSensorTable):
            text = f'is not available for a magnet of kind "{magnet.kind}"; remove it'
            yield FileFault(path, text, code="not-for-this-kind")
    if magnet is not None and not is_complete:
        text = "loops do not separate it from its permanent magnet or shared path; name one of [[iron]]"
        yield FileFault(file.key_path(magnet, "iron"), text, code="not-for-this-kind")
    if magnet is not None and not _suits_magnet(file, magnet):
        text = f"needs a stage that moves along {OPENS_GAP} between two magnets; choose another kind"
        text = text if magnet.kind == COUPLED else "is only for force control; choose another kind"
        yield FileFault(file.key_path(magnet, "kind"), text, code="not-for-this-kind")


def _suits_magnet(file: RigFile, magnet: MagnetTable) -> bool:
    """Whether a rig supports a permanent magnet, or two coils on one yoke."""
    case = case_table.ScanCase if magnet.kind == COUPLED else case_table.ForceCase
    is_right_kind = _count_limits(file, _TABLE_RULES[case][0])[0] > 0
    if magnet.kind == PERMANENT_MAGNET or not is_right_kind:
        return is_right_kind
    copies = [table.direction for table in file.magnets if isinstance(table, LikeTable)]
    is_pair = copies == [OPENS_GAP] and magnet.direction == [-part for part in OPENS_GAP]
    return is_pair and file.body.free == ["x"] and file.scan.direction == OPENS_GAP


def _pair_faults(file: RigFile, first_magnet: MagnetTable | None) -> Iterator[FileFault]:
    is_bidirectional = first_magnet is not None and first_magnet.is_bidirectional
    needs_opposite = _count_limits(file, _TABLE_RULES[LikeTable][0])[0] > 0
    is_pair = not is_bidirectional and (file.opposite is not None or needs_opposite)
    if is_pair != (file.bias_N is not None):
        text = "a pair of magnets needs it; add it"
        if not is_pair:
            text = "belongs to a pair of magnets; remove it"
        yield FileFault(("control", "bias_N"), text, code="pair-only")
    if first_magnet is not None and is_bidirectional:
        yield from _push_faults(file, first_magnet)


def _push_faults(file: RigFile, first_magnet: MagnetTable) -> Iterator[FileFault]:
    """Find keys that are not permitted for bidirectional magnets."""
    if "force_min_N" in file.control.model_fields_set:
        text = "is only for magnets that cannot push; remove it"
        yield FileFault(("control", "force_min_N"), text, code="not-for-this-kind")
    if getattr(file.control, "format", "f64") == "fixed":
        text = 'bidirectional magnets cannot use "fixed"; write "f64" or "f32"'
        yield FileFault(("control", "format"), text, code="not-for-this-kind")
    for magnet in file.magnets:
        if isinstance(magnet, LikeTable) and magnet.gap_m != first_magnet.gap_m:
            text = f"'{first_magnet.name}' has a gap of {first_magnet.gap_m:g} m; make them equal"
            yield FileFault(file.key_path(magnet, "gap_m"), text, code="option-differs")


def read_rig_file(path: PathLike, kind: str) -> RigFile:
    """Read and check the rig file of a kind, which is the value of its key ``control.kind``."""
    file = read_toml(path, RigFile, kinds=[rig_kinds()[kind]])
    faults = [*_count_faults(file), *_key_faults(file), *_circuit_faults(file), *_name_faults(file)]
    if file.given_loops is not None:
        faults += identify_faults(file.loops)
    if faults:
        raise faults_error(path, faults)
    return file
