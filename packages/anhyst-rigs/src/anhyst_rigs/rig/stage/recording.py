"""What a recording of a stage holds, and where it says that the stage was lost."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from anhyst.support.numeric import FloatArray
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.loop import Scenario
from anhyst_rigs.rig.recording import (
    CURRENTS,
    OUT_OF_PROPORTION,
    Loss,
    Recording,
    SignalBound,
    column,
    find_loss,
    of_magnets,
)
from anhyst_rigs.rig.stage.geometry import (
    error_columns,
    head_rows,
    scan_direction,
    seen_from,
    stops_of,
    unit_of,
)

WRENCH = ("N", "N_m")
"""Units of a force along a coordinate and about one."""


def recorded(rig: BodyRig, run: Recording, scenario: Scenario) -> dict[str, FloatArray]:
    """Return the columns of a recording: along the set-point, of all coordinates and magnets."""
    file, n = rig.settings, len(run)
    reference, along, free = scenario.target[:n], scan_direction(file), file.body.free
    poses = np.column_stack([run[name] for name in of_axes("pose", free)]) + scenario.frame[:n]
    errors = reference - poses
    wrench = of_axes("demand", free, WRENCH)
    demand = np.column_stack([run[name] for name in wrench]) @ along
    ticks, late = np.arange(n, dtype=float), rig.settings.timing.delay_ticks + 0.5
    count = len(file.placed)
    behind = range(count + 1, count + len(file.position_sensors) + 1)
    heads = np.column_stack([run[column("gap_read", "m", number)] for number in behind])
    read = seen_from(file, heads @ np.linalg.pinv(head_rows(file)).T, reference)
    signals = [("gap_read", "m"), *([("flux_read", "T")] if file.hall_probe is not None else [])]
    return {
        "t_s": run["t_s"],
        "reference_m": reference @ along,
        "position_m": poses @ along,
        "error_m": errors @ along,
        "demand_N": demand,
        "force_N": run["force_N"],
        # the force less what was demanded a delay earlier
        "force_error_N": np.asarray(run["force_N"] - np.interp(ticks - late, ticks, demand)),
        **{name: errors[:, k] for k, name in enumerate(error_columns(free))},
        **{name: run[name] for name in of_magnets([("gap", "m"), *CURRENTS], 1, count)},
        **{name: run[name] for name in of_magnets(signals, 1, count)},
        **dict(zip(pose_columns(free), read.T, strict=True)),
        **{name: run[own] for name, own in zip(demand_columns(free), wrench, strict=True)},
    }


def of_axes(signal: str, free: Sequence[str], units: tuple[str, str] = ("m", "rad")) -> list[str]:
    """Return the columns of a signal of every coordinate, in the loop's own record."""
    return [
        column(signal, units[unit_of(axis) == "rad"], number) for number, axis in enumerate(free, 1)
    ]


def stage_loss(rig: BodyRig, run: Recording, planned: int) -> Loss | None:
    """Return where a stage was lost: on an end stop, or its demand out of proportion."""
    file, stop = rig.settings, "an end stop was reached"
    most = OUT_OF_PROPORTION * file.tracking.force_max_N * len(file.placed)
    bounds = [SignalBound("the demanded force left all bounds", run["demand_N"], -most, most)]
    poses = of_axes("pose", file.body.free)
    for name, end in zip(poses, stops_of(file), strict=True):
        bounds.append(SignalBound(stop, run[name], -end, end))
    return find_loss(bounds, planned)


def pose_columns(free: Sequence[str]) -> list[str]:
    """Return the columns of a recording that hold the pose as it was read."""
    return [f"pose_read_{axis}_{unit_of(axis)}" for axis in free]


def demand_columns(free: Sequence[str], signal: str = "demand") -> list[str]:
    """Return the columns of a recording that hold the wrench that was demanded, or another one."""
    return [f"{signal}_{axis}_{WRENCH[unit_of(axis) == 'rad']}" for axis in free]
