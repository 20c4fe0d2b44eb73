"""Force from flux linkage without hysteresis: co-energy of a single-valued table, linear inductance.

Both read the records of ``flux_magnets``. The drift is first removed by the repeated largest currents.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator, RegularGridInterpolator

from anhyst.data.loops import Loop, Loops
from anhyst.data.path import find_turning_points
from anhyst.support.numeric import FloatArray

CURRENT_KNOTS, GAP_KNOTS = 81, 161
LINEAR_SHARE = 0.25
"""Share of the largest current up to which the inductance is measured."""

ForceLaw = Callable[[FloatArray, FloatArray], FloatArray]
"""Function of current, A, and gap, m, to force, N."""


def without_drift(loop: Loop) -> FloatArray:
    """Return the flux linkage without the slope over time that the repeated largest currents show."""
    assert loop.time is not None
    tips = [row for row in find_turning_points(loop.input) if loop.input[row] > 0.99 * loop.input.max()]
    near = [slice(max(row - 1, 0), row + 2) for row in tips]
    times = [float(loop.time[rows].mean()) for rows in near]
    slope = np.polyfit(times, [float(loop.output[rows].mean()) for rows in near], 1)[0]
    return np.asarray(loop.output - slope * (loop.time - loop.time[0]))


def mean_branch(loop: Loop, current: FloatArray) -> FloatArray:
    """Return the mean of the first rising and falling branch of the whole range."""
    psi = without_drift(loop)
    turns = find_turning_points(loop.input)
    start, tip, end = int(turns[0]), int(turns[1]), int(turns[2])
    rising = np.interp(current, loop.input[start : tip + 1], psi[start : tip + 1])
    falling = np.interp(current, loop.input[tip : end + 1][::-1], psi[tip : end + 1][::-1])
    return np.asarray(0.5 * (rising + falling))


def co_energy_laws(loops: Loops) -> dict[str, ForceLaw]:
    """Return the force of the single-valued table for each interpolation over the gap.

    The reciprocal of the co-energy at each current is interpolated, because it is almost linear in
    the gap.
    """
    gaps = np.array(loops.schedule_values)
    largest = max(float(loop.input.max()) for loop in loops)
    current = np.linspace(0.0, largest, CURRENT_KNOTS)
    branches = [mean_branch(loop, current) for gap in gaps for loop in loops if loop.schedule_value == gap]
    steps = 0.5 * np.diff(current) * (np.array(branches)[:, 1:] + np.array(branches)[:, :-1])
    energy = np.cumsum(steps, axis=1)  # J, at each gap and each current above zero
    inverse = 1.0 / energy
    margin = 0.05 * np.ptp(gaps)
    fine = np.linspace(max(gaps[0] - margin, 0.2 * gaps[0]), gaps[-1] + margin, GAP_KNOTS)
    quadratic = np.polyfit(gaps, inverse, 2)
    reciprocals = {
        "quadratic": (quadratic[0] * fine[:, None] ** 2 + quadratic[1] * fine[:, None] + quadratic[2],
                      2.0 * quadratic[0] * fine[:, None] + quadratic[1]),
        "spline": (CubicSpline(gaps, inverse)(fine), CubicSpline(gaps, inverse)(fine, 1)),
        "monotone": (PchipInterpolator(gaps, inverse)(fine), PchipInterpolator(gaps, inverse)(fine, 1)),
    }  # fmt: skip
    return {
        name: _tabulated(current, fine, np.asarray(slope / value**2))
        for name, (value, slope) in reciprocals.items()
    }


def _tabulated(current: FloatArray, gap: FloatArray, force: FloatArray) -> ForceLaw:
    table = np.hstack([np.zeros((gap.size, 1)), force])
    look_up = RegularGridInterpolator((gap, current), table, bounds_error=False, fill_value=None)
    return lambda at_current, at_gap: np.asarray(look_up(np.column_stack([at_gap, at_current])))


def linear_inductance_law(loops: Loops) -> ForceLaw:
    """Return i^2/2 dL/dx with the inductance at small currents; its reciprocal is quadratic in the gap."""
    gaps = np.array(loops.schedule_values)
    current = LINEAR_SHARE * max(float(loop.input.max()) for loop in loops)
    inductances = []
    for gap in gaps:
        loop = next(loop for loop in loops if loop.schedule_value == gap)
        psi = mean_branch(loop, np.array([0.0, current]))
        inductances.append((psi[1] - psi[0]) / current)
    reciprocal = np.polyfit(gaps, 1.0 / np.array(inductances), 2)
    slope = np.polyder(reciprocal)
    return lambda at_current, at_gap: np.asarray(
        0.5 * at_current**2 * np.polyval(slope, at_gap) / np.polyval(reciprocal, at_gap) ** 2
    )
