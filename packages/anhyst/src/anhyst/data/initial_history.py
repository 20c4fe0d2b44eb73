"""Propose the history before a record: demagnetised, or a cycle that was repeated many times.

A rise is an ascending branch of the input, or of its magnitude for an even output. The initial
magnetisation curve differs from later rises. Therefore, the first rise of a record is compared with
a later one, in several parts that all begin at rest. Drift and noise determine the uncertainty. If
a record has only one rise, the closing error of its cycle decides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from anhyst.data.estimates import estimate_noise
from anhyst.data.loops import Loop, fold_input
from anhyst.data.path import DEMAGNETISED, SETTLED, History, find_branches, find_crossings
from anhyst.data.speeds import find_slower_loops
from anhyst.support.numeric import FloatArray

HistoryProposal = tuple[History, str]
_Curve = tuple[FloatArray, FloatArray]
_Sigma = tuple[float, float]

_MAX_END_DISTANCE = 0.02
"""Maximum distance from a start or an end that counts as reached, as a fraction of the range."""
_MIN_REMANENCE_SHARE = 2e-3
"""Minimum remanence that is searched for, as a fraction of the height."""
_MAX_REST_SHARE = 0.05
"""Maximum start of a rise that counts as zero input, as a fraction of the largest input."""
_FIRST_RISE_PARTS = (0.01, 0.03, 0.1, 0.3)
"""Compared parts of the first rise, as fractions of it; the iron determines which differs most."""
_MEETING_RISE_FRACTION = 0.9
"""Fraction of the first rise above which all rises coincide; a difference above it is drift."""
_MIN_SAMPLES = 3
"""Minimum number of samples for an estimate."""
_MAX_RISE_DISTANCE = 0.05
"""Maximum distance of equal rises, as a fraction of the loop height."""
_MIN_RISE_SIGMAS = 4.5
"""Number of standard errors above which a difference is not noise."""
_MIN_NOISE_SHARE = 1e-4
"""Assumed minimum difference of two records of the same state, as a fraction of the height."""


@dataclass(frozen=True, slots=True)
class _RiseComparison:
    """Comparison of the first rise with a later rise."""

    difference: float
    standard_error: float
    height: float

    @property
    def difference_sigmas(self) -> float:
        """Difference in standard errors; zero for an output without noise or change."""
        return self.difference / self.standard_error if self.standard_error > 0.0 else 0.0

    @property
    def verdict(self) -> Literal["virgin", "settled", "unsure"]:
        """Whether the first rise is an initial curve; ``"unsure"`` if the noise hides it."""
        if self.difference > max(_MIN_RISE_SIGMAS * self.standard_error, _MAX_RISE_DISTANCE * self.height):
            return "virgin"
        return (
            "settled"
            if self.difference + 2.0 * self.standard_error < _MAX_RISE_DISTANCE * self.height
            else "unsure"
        )


def propose_histories(loops: Sequence[Loop], *, is_even: bool) -> list[HistoryProposal]:
    """Propose the history before each of several loops of one recording, with a reason.

    The initial curve lies below later rises from the remanent state, or inside the loop if the
    input has both signs. If the first rise deviates like an initial curve by more than noise, the
    record began demagnetised. The same applies if it starts at rest and does not return to its
    start. If noise hides the difference, a common decision is made for all unsure records that
    start at rest, otherwise the proposal is settled.
    """
    comparisons = [_compare_rises(loop, is_even=is_even) for loop in loops]
    are_all_virgin = _are_all_virgin([rises for rises in comparisons if rises])
    return [
        _propose_history(loop, parts, are_all_virgin, is_even=is_even)
        for loop, parts in zip(loops, comparisons, strict=True)
    ]


def correct_histories_of_fast_loops(
    loops: Sequence[Loop], proposals: Sequence[HistoryProposal]
) -> list[HistoryProposal]:
    """Correct the proposals for fast loops by the slow loops of the same gap.

    Eddy currents make the first cycle of a fast loop differ from later ones, as an initial curve
    would. Slow loops show without this effect whether the recording began demagnetised. If it did
    not, the history of the fast loop is the largest slow loop.
    """
    corrected_proposals = list(proposals)
    for index, slower_indices in enumerate(find_slower_loops(loops)):
        not_demagnetised_indices = [
            slower_index
            for slower_index in slower_indices
            if proposals[slower_index][0].kind != "demagnetised"
        ]
        if (
            proposals[index][0].kind != "demagnetised"
            or not slower_indices
            or len(not_demagnetised_indices) < len(slower_indices)
        ):
            continue
        largest_slow_loop = max(
            (loops[slower_index] for slower_index in slower_indices),
            key=lambda loop: float(np.ptp(loop.input)),
        )
        reason = (
            "it is faster than other loops of its gap, whose first rise is not the initial curve; "
            "eddy currents explain its different first cycle (state --history to change this)"
        )
        corrected_proposals[index] = _history_after_slow(largest_slow_loop, loops[index]), reason
    return corrected_proposals


def _history_after_slow(slow_loop: Loop, fast_loop: Loop) -> History:
    """Return the history of a loop that starts at rest after a slow loop."""
    span, start = float(np.ptp(slow_loop.input)), float(fast_loop.input[0])
    last_rows = [
        slow_loop.n - 1 - int(find_extreme(slow_loop.input[::-1])) for find_extreme in (np.argmin, np.argmax)
    ]
    extremes = [float(f"{slow_loop.input[row]:.4g}") for row in sorted(last_rows)]
    return_point = [] if abs(extremes[-1] - start) <= _MAX_END_DISTANCE * span else [float(f"{start:.4g}")]
    return History("conditioned", (*extremes, *return_point))


def _are_all_virgin(comparisons: Sequence[list[_RiseComparison]]) -> bool:
    """Whether records that are unsure individually are initial curves on average."""
    # The full part is used, because the clearest of several parts is biased.
    full_parts = [rises[-1] for rises in comparisons]
    if not full_parts or any(_select_clearest(parts).verdict == "settled" for parts in comparisons):
        return False
    mean_sigmas = sum(comparison.difference_sigmas for comparison in full_parts) / len(full_parts) ** 0.5
    heights = sum(abs(comparison.height) for comparison in full_parts)
    return (
        mean_sigmas > _MIN_RISE_SIGMAS
        and sum(comparison.difference for comparison in full_parts) > _MAX_RISE_DISTANCE * heights
    )


def _select_clearest(comparisons: list[_RiseComparison]) -> _RiseComparison:
    return max(comparisons, key=lambda rise: (rise.verdict == "virgin", rise.difference_sigmas))


def _propose_history(
    loop: Loop, comparisons: list[_RiseComparison], are_all_virgin: bool, *, is_even: bool
) -> HistoryProposal:
    if not comparisons:
        return _propose_from_closure(loop, is_even=is_even)
    clearest_comparison = _select_clearest(comparisons)
    if clearest_comparison.verdict == "virgin":
        difference_share = clearest_comparison.difference / float(np.ptp(loop.output))
        return (
            DEMAGNETISED,
            f"its first rise deviates from later rises by {difference_share:.1%} of the output's range, as an "
            "initial curve does",
        )
    if clearest_comparison.verdict == "settled":
        return SETTLED, "its first rise agrees with later rises"
    if are_all_virgin:
        return DEMAGNETISED, "the first rises of all records are, on average, initial curves"
    return SETTLED, "its first rise differs from later rises by noise only"


def _propose_from_closure(loop: Loop, *, is_even: bool) -> HistoryProposal:
    """Propose a history for a record without a second rise."""
    drive, output = loop.input, loop.output
    height = float(np.ptp(output)) or 1.0
    end_output = _output_at_return(drive, output)
    closing_error = None if end_output is None else float(end_output - output[0])
    # Noise alone explains this difference of two samples.
    noise_limit = 5.0 * estimate_noise(output)
    is_at_rest = _starts_at_rest(loop, is_even=is_even)
    if is_at_rest and is_even and closing_error is not None:
        is_virgin = closing_error > max(_MIN_REMANENCE_SHARE * height, noise_limit) and _has_remanence(
            loop, closing_error
        )
    else:
        is_virgin = is_at_rest and (
            closing_error is None or abs(closing_error) > max(_MAX_END_DISTANCE * height, noise_limit)
        )
    if is_virgin:
        verb_text = "never returns" if closing_error is None else "does not return"
        return DEMAGNETISED, f"it starts at rest, at zero, and {verb_text} there"
    if closing_error is None:
        return SETTLED, "it starts away from rest and is not a complete cycle (uncertain)"
    error_text = f"{abs(closing_error) / height:.2%} of its height"
    if abs(closing_error) <= max(_MAX_END_DISTANCE * height, noise_limit):
        return SETTLED, f"it returns to its start within {error_text}"
    if is_at_rest:
        return (SETTLED, f"its end deviates from its start by {error_text}, which is drift and not remanence")
    return (
        SETTLED,
        f"it starts away from rest, and its end deviates from its start by {error_text} (uncertain)",
    )


def _has_remanence(loop: Loop, closing_error: float) -> bool:
    """Whether the closing error of an even output is remanence and not drift.

    The output is the square of a flux. On the initial curve from rest, it grows by a factor of four
    while the input at most doubles, because the curve steepens. Above this curve, the remanence in
    flux is at least as large, so the output difference is at least ``(2 + 1)**2 - 2**2`` times the
    closing error. A drift is equal at all inputs, and a settled rise starts with a slope.
    """
    branches = find_branches(loop.input)
    if len(branches) < 2:
        return False
    rise_curve, fall_curve = ((loop.input[branch.rows], loop.output[branch.rows]) for branch in branches[:2])
    growth = rise_curve[1] - loop.output[0]
    if float(growth.max()) < 4.0 * closing_error:
        return True  # a remanence of this size hides all other effects
    input_at_1, input_at_4 = (
        float(rise_curve[0][np.argmax(growth >= k * closing_error)]) for k in (1.0, 4.0)
    )
    difference = (
        float(_interpolate_curve(fall_curve, np.array([input_at_4]))[0] - loop.output[0])
        - 4.0 * closing_error
    )
    start = float(loop.input[0])
    return difference >= 5.0 * closing_error and abs(input_at_4 - start) <= 2.4 * abs(input_at_1 - start)


def _starts_at_rest(loop: Loop, *, is_even: bool) -> bool:
    drive, output = loop.input, loop.output
    if abs(drive[0]) > _MAX_END_DISTANCE * float(np.max(np.abs(drive))):
        return False
    # The minimum of an even output is at rest, even with a sensor offset.
    zero_output = float(output.min()) if is_even else 0.0
    distance = abs(output[0] - zero_output)
    return bool(
        distance
        <= 2 * _MAX_END_DISTANCE * float(np.max(np.abs(output - zero_output))) + 5.0 * estimate_noise(output)
    )


def _compare_rises(loop: Loop, *, is_even: bool) -> list[_RiseComparison]:
    """Compare the first rise with a later one, part by part; empty without a later rise."""
    inputs, output = fold_input(loop, is_even=is_even)
    rest_limit = _MAX_REST_SHARE * float(np.max(np.abs(inputs)))
    branches = find_branches(inputs)
    if abs(inputs[0]) > rest_limit or len(branches) < 3:
        return []
    first_rise = branches[0]
    if not first_rise.is_rising:
        inputs, output = -inputs, output if is_even else -output
    start_input, end_input = float(inputs[0]), float(inputs[first_rise.stop - 1])
    for index in range(2, len(branches), 2):
        later_branch = branches[index]
        top_input = min(end_input, float(inputs[later_branch.stop - 1]))
        starts_at_rest = float(inputs[later_branch.start]) <= start_input + rest_limit
        if starts_at_rest and top_input - start_input >= 0.5 * (end_input - start_input):
            break
    else:
        return []
    curves = [(inputs[branch.rows], output[branch.rows]) for branch in branches]
    sigma = (
        estimate_noise(loop.input),
        max(estimate_noise(loop.output), _MIN_NOISE_SHARE * float(np.ptp(loop.output))),
    )
    falls = (curves[1], curves[index + 1]) if index + 1 < len(branches) else None
    drift = _estimate_drift(curves[0], curves[index], falls, top_input, sigma)
    comparisons = _compare_parts(curves[0], curves[index], curves[1], top_input - start_input, drift, sigma)
    inputs_between = loop.input[first_rise.stop - 1 : later_branch.stop]
    inputs_between = inputs_between * np.sign(inputs_between[0])
    if not (float(inputs_between.min()) < -0.1 * float(inputs_between.max())):
        return comparisons
    # Inside a loop, the initial curve lies above later rises. Near rest, a squared flux lies above
    # it instead, because the remanence has the other sign there.
    signs = [
        np.sign(part.difference) if is_even and part is not comparisons[-1] else -1.0 for part in comparisons
    ]
    return [
        replace(part, difference=sign * part.difference)
        for part, sign in zip(comparisons, signs, strict=True)
    ]


def _estimate_drift(
    first_rise: _Curve,
    later_rise: _Curve,
    falls: tuple[_Curve, _Curve] | None,
    top_input: float,
    sigma: _Sigma,
) -> tuple[float, float]:
    """Return the mean distance of curves that coincide without drift, and its standard error."""
    span = top_input - float(first_rise[0][0])
    if falls is not None and abs(falls[0][0][0] - falls[1][0][0]) <= _MAX_REST_SHARE * span:
        (first_curve, second_curve), low_input = falls, float(falls[1][0].min())
    else:
        first_curve, second_curve, low_input = (
            first_rise,
            later_rise,
            top_input - (1.0 - _MEETING_RISE_FRACTION) * span,
        )
    is_in_range = (first_curve[0] >= low_input) & (
        first_curve[0] <= min(top_input, float(second_curve[0].max()))
    )
    inputs, output = first_curve[0][is_in_range], first_curve[1][is_in_range]
    if inputs.size < _MIN_SAMPLES:
        return 0.0, _output_scatter(first_rise[1], span, sigma)
    difference = _interpolate_curve(second_curve, inputs) - output
    error = _output_scatter(output, span, sigma) * (2.0 / inputs.size) ** 0.5
    # A difference that varies along the curve is not drift.
    unevenness = float(
        np.std([difference_section.mean() for difference_section in np.array_split(difference, _MIN_SAMPLES)])
    )
    return float(difference.mean()), max(error, unevenness)


def _compare_parts(
    first_rise: _Curve,
    later_rise: _Curve,
    fall: _Curve,
    span: float,
    drift: tuple[float, float],
    sigma: _Sigma,
) -> list[_RiseComparison]:
    """Compare two rises over several parts of the first rise, all of which begin at rest."""
    inputs, output = first_rise
    share = (inputs - inputs[0]) / span
    difference, height = (
        _interpolate_curve(later_rise, inputs) - output,
        _interpolate_curve(fall, inputs) - _interpolate_curve(later_rise, inputs),
    )
    comparisons = []
    for part in _FIRST_RISE_PARTS:
        is_in_part = share < part
        count = min(np.count_nonzero(is_in_part), np.count_nonzero(later_rise[0] < inputs[0] + part * span))
        if count < _MIN_SAMPLES:
            continue
        error = _output_scatter(output[is_in_part], part * span, sigma) * (2.0 / count) ** 0.5
        mean = float(difference[is_in_part].mean()) - drift[0]
        comparisons.append(
            _RiseComparison(mean, float(np.hypot(error, drift[1])), float(height[is_in_part].mean()))
        )
    return comparisons


def _output_scatter(output: FloatArray, span: float, sigma: _Sigma) -> float:
    """Return the standard deviation of the output at equal input, from the noise of both."""
    return float(np.hypot(sigma[1], float(np.ptp(output)) / span * sigma[0]))


def _interpolate_curve(curve: _Curve, inputs: FloatArray) -> FloatArray:
    sorted_rows = np.argsort(curve[0], kind="stable")
    return np.interp(inputs, curve[0][sorted_rows], curve[1][sorted_rows])


def _output_at_return(drive: FloatArray, output: FloatArray) -> float | None:
    """Return the output where the input last passes its first value in its first direction."""
    branches = find_branches(drive)
    if len(branches) < 2:
        return None
    later_rows = slice(branches[0].stop - 1, None)
    outputs_at_return = find_crossings(
        drive[later_rows], output[later_rows], float(drive[0]), is_rising=branches[0].is_rising
    )
    if outputs_at_return.size:
        return float(outputs_at_return[-1])
    remaining_input, input_step = float(drive[0] - drive[-1]), float(drive[-1] - drive[-2])
    if abs(remaining_input) > _MAX_END_DISTANCE * float(np.ptp(drive)):
        return None
    # A cycle without its last sample ends one step before its start, so the output is extrapolated.
    steps_ahead = remaining_input / input_step if input_step != 0.0 else 0.0
    steps_ahead = steps_ahead if 0.0 < steps_ahead <= 1.5 else 0.0
    return float(output[-1] + steps_ahead * (output[-1] - output[-2]))
