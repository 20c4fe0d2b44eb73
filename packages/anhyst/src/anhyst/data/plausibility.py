"""Check whether records are physically plausible, to find swapped channels and reversed signs.

The attraction of an electromagnet grows with the square of the flux, flux grows with the field, and
a loop loses energy. Records that contradict this raise an error with the option that corrects it.
Less certain findings become warnings.
"""

from __future__ import annotations

import itertools

import numpy as np

from anhyst.data.estimates import estimate_noise
from anhyst.data.loops import Loop, Loops, fold_input
from anhyst.data.output_map import output_map
from anhyst.data.path import (
    ANHYSTERETIC,
    branch_separation,
    correlation,
    find_branches,
    find_runs,
    is_bipolar,
    is_negative,
)
from anhyst.data.symmetry import check_not_even, recentre_loops
from anhyst.data.verdict import largest_output
from anhyst.support.errors import InputError

_SWAP_ADVICE = "are the columns of current and force swapped?"
_PLAUSIBLE_RANGES: dict[str, tuple[float, float, str, str]] = {
    "current": (1e-5, 1e3, "A, not kA", "mA, not A"),
    "field": (1e-2, 1e7, "kA/m, not A/m", "A/m, not kA/m"),
    "voltage": (1e-5, 1e5, "V, not mV", "mV, not V"),
    "force": (1e-5, 1e5, "N, not uN", "N, not kN, or mN, not N"),
    "flux_linkage": (1e-6, 20.0, "Wb, not mWb", "mWb, not Wb"),
    "flux_density": (1e-5, 4.0, "T, not mT", "mT or G, not T"),
    "displacement": (1e-10, 1.0, "um, not nm", "mm or um, not m"),
}
"""Plausible largest value of each quantity (SI), and the likely unit below and above that range."""
_PLAUSIBLE_GAPS_M = (2e-6, 0.02)
"""Plausible range of the largest gap, m; surfaces are not flat enough for smaller gaps."""
_MIN_RELATIVE_DIFFERENCE = 1e-3
"""Minimum relative difference of scheduling values; closer values are probably equal."""
_MAX_SWAPPED_CORRELATION = 0.3
_MIN_SQUARE_CORRELATION = 0.8
_MAX_SENSOR_OFFSET_SHARE = 0.05
"""Largest negative force that can be a sensor offset, as a fraction of the largest force."""
_MIN_CLIPPED_SAMPLES = 8
_MIN_CLIPPED_SHARE = 0.1
"""Maximum fraction of the input range over which an output that is not clipped can be constant."""
_MIN_SIGMAS = 4.0
"""Number of standard errors by which a slope or an energy must exceed its limit."""


def check_plausible(loopset: Loops) -> tuple[str, ...]:
    """Raise an error for records that cannot be what their headers state, and return warnings.

    The force of an electromagnet never falls as the magnitude of the current grows, and its curve
    starts flat.

    Columns and force signs are checked on the largest loop of each gap, because remanence, offset
    and noise can dominate a small loop. For the same reason, the direction of a bipolar even loop
    is only checked on this loop.
    """
    warnings = _check_schedule(loopset) + _check_magnitude(loopset)
    check_not_even(loopset)
    loopset, is_even = recentre_loops(loopset)
    output = output_map(loopset.output)
    largest_loops: dict[float | None, Loop] = {}  # by gap; None if it changes or is not stated
    for loop in sorted(loopset.loops, key=lambda loop: -float(np.ptp(loop.output))):
        largest_loops.setdefault(loop.schedule_value, loop)
    for loop in loopset.loops:
        name = loopset.describe(loop)
        is_largest = loop is largest_loops[loop.schedule_value]
        if output.is_even and is_largest:
            _check_force_sign(loopset, loop, name)
            # A biased force starts with a slope.
            if loopset.input.name == "current" and (is_even or not is_bipolar(loop.input)):
                warnings += _check_swap(loop, name)
        if output.is_flux_based and not output.is_even and correlation(loop.input, loop.output) < -0.5:
            raise InputError(
                f"{name}: the {loopset.output.words} falls as the {loopset.input.words} grows; reverse the sign "
                f"of one: --flip {loopset.output.symbol}",
                code="flux-falls",
                key=name,
            )
        if is_largest or not (is_even and is_bipolar(loop.input)):
            warnings += _check_loop_direction(loopset, loop, name, is_even=is_even)
        _check_branch_order(loopset, loop, name)
        warnings += _check_clipping(loopset, loop, name)
        if not loop.reverses and loop.history != ANHYSTERETIC:
            warnings.append(f"{name}: the input never reverses, so the record shows no hysteresis")
    return tuple(warnings)


def _check_clipping(loopset: Loops, loop: Loop, name: str) -> list[str]:
    """Warn of an output that is constant at its extreme while the input changes."""
    warnings = []
    for extreme_output in (float(loop.output.max()), float(loop.output.min())):
        spans = [
            float(np.ptp(loop.input[rows]))
            for rows in find_runs(loop.output == extreme_output)
            if rows.stop - rows.start >= _MIN_CLIPPED_SAMPLES
        ]
        range_fraction = max(spans, default=0.0) / (float(np.ptp(loop.input)) or 1.0)
        if extreme_output != 0.0 and range_fraction > _MIN_CLIPPED_SHARE:
            output = loopset.output
            warnings.append(
                f"{name}: the {output.name.replace('_', ' ')} is constant at {extreme_output:.6g} {output.unit} "
                f"over {range_fraction:.0%} of the {loopset.input.name}'s range: the sensor is clipped, and "
                "the model will be wrong there; measure again with a larger range of the sensor"
            )
    return warnings


def _check_schedule(loopset: Loops) -> list[str]:
    warnings: list[str] = []
    quantity, values = loopset.schedule, loopset.schedule_values
    if quantity is None or not values:
        return warnings
    if quantity.name == "gap" and values[-1] >= _PLAUSIBLE_GAPS_M[1]:
        warnings.append(
            f"gaps up to {1e3 * values[-1]:.4g} mm are very wide for an electromagnet; if the "
            "numbers of the file are mm, name the column 'gap_mm'"
        )
    if quantity.name == "gap" and 0.0 < values[-1] < _PLAUSIBLE_GAPS_M[0]:
        warnings.append(
            f"gaps up to {1e3 * values[-1]:.4g} mm are smaller than the flatness of surfaces; if the "
            "numbers of the file are m, name the column 'gap_m'"
        )
    for lower_value, upper_value in itertools.pairwise(values):
        if upper_value - lower_value < _MIN_RELATIVE_DIFFERENCE * max(abs(lower_value), abs(upper_value)):
            warnings.append(
                f"{quantity.name} {lower_value:.9g} and {upper_value:.9g} {quantity.unit} are almost equal; if "
                "they are the same, write one value for both"
            )
    return warnings


def _check_magnitude(loopset: Loops) -> list[str]:
    """Warn of a quantity whose largest value is outside the range of actuators."""
    warnings = []
    for quantity, name in ((loopset.input, "input"), (loopset.output, "output")):
        largest_value = max(float(np.max(np.abs(getattr(loop, name)))) for loop in loopset.loops)
        if quantity.name not in _PLAUSIBLE_RANGES or largest_value == 0.0:
            continue
        min_plausible, max_plausible, unit_if_small, unit_if_large = _PLAUSIBLE_RANGES[quantity.name]
        if not min_plausible <= largest_value <= max_plausible:
            value_text = f"{quantity.name.replace('_', ' ')} is {largest_value:.4g} {quantity.unit}"
            unit = unit_if_small if largest_value < min_plausible else unit_if_large
            warnings.append(f"the largest {value_text}, which is implausible; are the numbers in {unit}?")
    return warnings


def _check_force_sign(loopset: Loops, loop: Loop, name: str) -> None:
    lowest_output, highest_output = float(loop.output.min()), float(loop.output.max())
    if -lowest_output <= _MAX_SENSOR_OFFSET_SHARE * largest_output(loopset):
        return
    is_falling = correlation(loop.input**2, loop.output) < -0.5
    if is_falling or highest_output <= 0.0 or -lowest_output > 5.0 * highest_output:
        drive, force_range = (
            loopset.input.name,
            f"{lowest_output:.4g} to {highest_output:.4g} {loopset.output.unit}",
        )
        if is_negative(loop.input):
            raise InputError(
                f"{name}: the force is negative ({force_range}), and so is the {drive}; attraction must be "
                f"positive: --flip {loopset.input.symbol},{loopset.output.symbol}",
                code="force-negative",
                key=name,
            )
        raise InputError(
            f"{name}: the force is negative ({force_range}) and falls as the {drive} grows; attraction "
            f"must be positive: --flip {loopset.output.symbol}",
            code="force-negative",
            key=name,
        )


def _check_branch_order(loopset: Loops, loop: Loop, name: str) -> None:
    """Raise an error for a table that lists both branches of a loop in the same input direction."""
    branches = find_branches(loop.input)
    if loop.time is not None or len(branches) != 3 or branches[1].stop - branches[1].start > 2:
        return
    branch, later_branch = branches[0], branches[2]
    ends = loop.input[[branch.stop - 1, later_branch.start]]
    # A real step of the drive is fast, and its record has a clock.
    distance = branch_separation(loop.input, loop.output, branch, later_branch)
    min_distance = max(
        _MIN_SIGMAS * estimate_noise(loop.output), _MIN_RELATIVE_DIFFERENCE * float(np.ptp(loop.output))
    )
    if distance is None or float(np.max(np.abs(distance[1]))) < min_distance:
        return
    # If a loop loses energy, its falling branch is the upper one.
    branch_to_reverse = later_branch if float(np.mean(distance[1])) > 0.0 else branch
    largest_end = float(np.max(np.abs(ends)))
    is_closed = abs(loop.output[branch.start] - loop.output[later_branch.start]) < min_distance
    history_option = (
        "" if is_closed else f" and use --history conditioned:{largest_end:g},{-largest_end:g},{ends.min():g}"
    )
    raise InputError(
        f"{name}: the {loopset.input.name} jumps from {ends[0]:.4g} to {ends[1]:.4g} "
        f"{loopset.input.unit} and then runs in the same direction again: the table lists both "
        f"branches in one direction; reverse the order of samples {branch_to_reverse.start + 1} to "
        f"{branch_to_reverse.stop}{history_option}, or add a time column if the drive did jump",
        code="branches-in-one-direction",
        key=name,
    )


def _check_swap(loop: Loop, name: str) -> list[str]:
    drive, output = loop.input, loop.output
    if not is_bipolar(drive) and is_bipolar(output):
        square_correlation = correlation(drive, output**2)
        if (
            abs(correlation(drive, output)) < _MAX_SWAPPED_CORRELATION
            and square_correlation > _MIN_SQUARE_CORRELATION
        ):
            raise InputError(
                f"{name}: the force has both signs at the same current; {_SWAP_ADVICE}",
                code="columns-swapped",
                key=name,
            )
    slope_ratio = _initial_slope_ratio(loop)
    if slope_ratio is None:
        return []
    if slope_ratio > 1.5:
        raise InputError(
            f"{name}: the force rises steepest at the smallest current, as a current over force "
            f"would; {_SWAP_ADVICE}",
            code="columns-swapped",
            key=name,
        )
    if slope_ratio > 1.0:
        return [f"{name}: the force does not start flat as a square would; {_SWAP_ADVICE}"]
    return []


def _initial_slope_ratio(loop: Loop) -> float | None:
    """Return the mean slope over the first tenth of the input relative to the next two tenths.

    The input is folded to one sign, and the noise is subtracted. ``None`` if it cannot be
    determined.
    """
    inputs, output = fold_input(loop, is_even=True)
    if is_bipolar(loop.input) and is_bipolar(output):
        return None
    span = float(np.ptp(inputs))
    if float(inputs.min()) > 0.05 * float(inputs.max()):
        return None  # the record does not start near zero
    heights, variances = [], []
    for level in (0.0, 0.1, 0.3):
        is_near = np.abs(inputs - inputs.min() - level * span) <= 0.02 * span
        if np.count_nonzero(is_near) < 2:
            return None
        heights.append(float(np.mean(output[is_near])))
        variances.append(estimate_noise(output) ** 2 / np.count_nonzero(is_near))
    next_slope = (heights[2] - heights[1]) / 0.2
    uncertainty = _MIN_SIGMAS * float(np.sqrt(variances[0] + variances[1]))
    first_slope = (heights[1] - heights[0] - uncertainty) / 0.1
    return None if next_slope <= 0.02 * float(np.ptp(output)) else first_slope / next_slope


def _check_loop_direction(loopset: Loops, loop: Loop, name: str, *, is_even: bool) -> list[str]:
    """Warn of a loop in the wrong direction: it would gain energy."""
    if not output_map(loopset.output).is_flux_based or not loop.reverses:
        return []
    inputs, output = fold_input(loop, is_even=is_even)
    height = float(np.ptp(output))
    weighted_width = total_span = variance = 0.0
    for branch, next_branch in itertools.pairwise(find_branches(inputs)):
        width = branch_separation(inputs, output, branch, next_branch)
        if width is not None:
            common_span = float(np.ptp(width[0]))
            weighted_width += common_span * float(np.mean(width[1]))
            total_span += common_span
            samples = min(one_branch.size for one_branch in (branch, next_branch))
            variance += 2.0 * (common_span * estimate_noise(output)) ** 2 / samples
    # Noise of the sensor can explain the sign of a narrow loop.
    if weighted_width < -max(0.005 * height * total_span, _MIN_SIGMAS * float(np.sqrt(variance))):
        return [
            f"{name}: the loop has the wrong direction (it would gain energy): a delay between channels, "
            "samples in reverse order, or a reversed sign"
        ]
    return []
