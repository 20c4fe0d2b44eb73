"""Allocate the wrench of a stage to its magnets, and find which magnets are dispensable.

The module also computes the largest wrench, and the settings with which a controller detects the
loss of a magnet or a position head.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from scipy.optimize import linprog

from anhyst._core import AXES_ODD, WrenchLayout
from anhyst.control.position import Allocation
from anhyst.support.numeric import FloatArray
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.file import RigFile
from anhyst_rigs.rig.stage.geometry import inverses_without_head, magnet_rows, travel_m, weight_wrench

_AXIS_YIELD_WEIGHTS = {"x": 1e-2, "y": 5e-3, "z": 1e-4, "rx": 3e-3, "ry": 3e-3, "rz": 1e-4}
_MIN_FORCE_MARGIN_TO_RANGE = 1e-6
"""Smallest distance of all forces from their bounds, relative to their range.

The magnets can push a body in any direction only if the forces that carry it have this distance.
"""
_CURRENT_STEPS = 200
"""Number of steps in which the current rises to the limit of the amplifier."""
_LINE_TOLERANCE = 1e-9
"""Largest deviation between the lines of action of two opposing magnets, m or dimensionless."""
LANDING_TRAVEL_TO_STOP_DISTANCE = 1.5
"""Travel of a landing divided by the distance to the end stop; above 1 to reach the end stop."""
_GUARANTEED_TO_NOMINAL_SLEW = 0.5
"""Guaranteed slope of a current, relative to supply voltage divided by inductance."""
MAX_LANDING_TICKS = 65535
"""Largest number of ticks of a landing."""


def wrench_layout(file: RigFile, kind: Allocation, idle: float) -> WrenchLayout:
    """Return the allocation of wrenches to the magnets.

    Raises ValueError if the magnets cannot push along every coordinate.
    """
    min_force, max_force = min_single_force(file), file.tracking.force_max_N
    return WrenchLayout(
        magnet_rows(file),
        opposing_magnets(file),
        kind,
        idle,
        min_force,
        max_force,
        yields=axis_yield_weights(file),
    )


def largest_magnet_forces(rig: BodyRig) -> FloatArray:
    """Return the largest force of each magnet at its gap, N.

    The limits are ``force_max_N`` and the largest current of the amplifier.
    """
    file = rig.settings
    gaps = np.array([magnet.gap_m or file.gap_m for magnet in file.body_magnets])
    low_A, high_A = file.amplifier.current_low_A, file.amplifier.current_high_A
    max_current = min(-low_A, high_A) if file.magnet.is_bidirectional else high_A
    current = np.linspace(0.0, max_current, _CURRENT_STEPS)
    limits = {gap: rig.static_map(current, np.full(_CURRENT_STEPS, gap))[0][-1] for gap in set(gaps)}
    return np.minimum([limits[gap] for gap in gaps], file.tracking.force_max_N)


def axis_yield_weights(file: RigFile) -> list[float]:
    """Return the weights with which the coordinates are given up if a lost magnet is irreplaceable.

    The weights are relative to 1: x yields most, then y, then rx and ry; z and rz yield least.
    """
    return [_AXIS_YIELD_WEIGHTS[axis] for axis in file.body.free]


@cache
def _find_spare_magnets(
    row_bytes: bytes, magnets: int, weight: tuple[float, ...], min_force: float, max_force: float
) -> int:
    rows = np.frombuffer(row_bytes).reshape(magnets, -1)
    spare_magnets = 0
    for lost_magnet in range(magnets):
        remaining_rows = np.delete(rows, lost_magnet, axis=0)
        if np.linalg.matrix_rank(remaining_rows) < len(weight):
            continue
        # Find the forces that carry the weight and have the largest distance from their bounds. If
        # this distance is positive, the body can be pushed in any direction.
        count, margin_column = magnets - 1, np.ones((magnets - 1, 1))
        constraints = np.block([[-np.eye(count), margin_column], [np.eye(count), margin_column]])
        limits = np.repeat([-min_force, max_force], count)
        equalities = np.column_stack([remaining_rows.T, np.zeros(len(weight))])
        solution = linprog(
            [*np.zeros(count), -1.0], constraints, limits, equalities, -np.array(weight), (None, None)
        )
        if solution.status == 0 and solution.x[-1] > _MIN_FORCE_MARGIN_TO_RANGE * (max_force - min_force):
            spare_magnets |= 1 << lost_magnet
    return spare_magnets


def spare_magnets(file: RigFile) -> int:
    """Return a bit mask of the dispensable magnets.

    If any one of them is lost, the others still carry the weight and can push along every
    coordinate in both directions.
    """
    rows = magnet_rows(file)
    bounds = min_single_force(file), file.tracking.force_max_N
    return _find_spare_magnets(rows.tobytes(), len(rows), tuple(weight_wrench(file).tolist()), *bounds)


def usual_allocation(file: RigFile) -> Allocation:
    """Return the allocation CLASS_AB to pairs of magnets, or SINGLE for bidirectional magnets."""
    return Allocation.SINGLE if file.magnet.is_bidirectional else Allocation.CLASS_AB


def min_single_force(file: RigFile) -> float:
    """Return the smallest force of a magnet that has no opposing magnet, N."""
    table = file.tracking
    return -table.force_max_N if file.magnet.is_bidirectional else table.force_min_N


def opposing_magnets(file: RigFile) -> list[int]:
    """Return, for each magnet, the index of the opposing magnet on the same line of action.

    The result is the magnet's own index if there is none, or if the magnets are bidirectional.
    """
    lines = np.array(
        [[*magnet.direction, *np.cross(magnet.position_m, magnet.direction)] for magnet in file.body_magnets]
    )
    remaining_magnets = list(range(len(lines)))
    if file.magnet.is_bidirectional:
        return remaining_magnets
    for i, j in np.argwhere(np.abs(lines[:, None] + lines).max(axis=2) < _LINE_TOLERANCE).tolist():
        if remaining_magnets[i] == i and remaining_magnets[j] in (i, j):
            remaining_magnets[i] = j
    return remaining_magnets


def monitoring_settings(rig: BodyRig) -> dict[str, float]:
    """Return the settings of a controller that detects lost magnets and heads, and lands."""
    table, timing, amplifier = rig.settings.tracking, rig.settings.timing, rig.settings.amplifier
    current_lag = timing.delay_ticks * rig.dt + 1.0 / (math.tau * amplifier.bandwidth_Hz)
    inverses = inverses_without_head(rig.settings)
    landing_ticks = LANDING_TRAVEL_TO_STOP_DISTANCE * travel_m(rig.settings) / (table.land_m_per_s * rig.dt)
    return {
        "follow": 1.0 - math.exp(-rig.dt / current_lag),
        "slew": _GUARANTEED_TO_NOMINAL_SLEW
        * amplifier.supply
        / rig.settings.magnet.poles.inductance(rig.gap)
        * rig.dt,
        "off": table.lost_A or 0.0,
        "off_ticks": max(1, round(table.lost_s / rig.dt)),
        "spare": spare_magnets(rig.settings) if table.lost_A else 0,
        "land_ticks": min(math.ceil(landing_ticks), MAX_LANDING_TICKS),
        "jump": (table.head_m_per_s or 0.0) * rig.dt,
        "doubt": AXES_ODD * max(1, round(table.head_s / rig.dt)),
        "noisy": int(all(sensor.noise_m > sensor.step_m for sensor in rig.settings.position_sensors)),
        "spare_heads": sum(1 << sensor for sensor, rows in enumerate(inverses) if rows.any()),
    }
