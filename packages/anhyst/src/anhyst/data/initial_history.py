"""How a record starts: on the virgin curve, or in a cycle that has been run often."""

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
"""A start or an end within this share of the range counts as reached."""
_MIN_REMANENCE_SHARE = 2e-3
"""Share of the height below which a remanence is not looked for."""
_MAX_REST_SHARE = 0.05
"""A rise from within this share of the largest input is one from zero."""
_FIRST_RISE_PARTS = (0.01, 0.03, 0.1, 0.3)
"""Parts of the first rise over which it is compared: where it differs most, depends on the iron."""
_RISES_MEET_SHARE = 0.9
"""From this part of the first rise on, all rises meet: what they differ by there is drift."""
_MIN_SAMPLES = 3
"""Samples from which something is estimated."""
_MAX_RISE_DISTANCE = 0.05
"""Rises nearer to each other than this share of the loop's height are one and the same."""
_MIN_RISE_SIGMAS = 4.5
"""Standard errors from which a difference is not noise."""
_MIN_NOISE_SHARE = 1e-4
"""Share of the height that two records of one thing differ by, however little they scatter."""


@dataclass(frozen=True, slots=True)
class _RiseComparison:
    """The first rise against a later one: mean difference, its standard error, loop's height."""

    difference: float
    standard_error: float
    height: float

    @property
    def difference_sigmas(self) -> float:
        """Difference in standard errors; zero if an output without noise or change shows none."""
        return self.difference / self.standard_error if self.standard_error > 0.0 else 0.0

    @property
    def verdict(self) -> Literal["virgin", "settled", "unsure"]:
        """Verdict on the first rise; none where the noise hides it."""
        if self.difference > max(
            _MIN_RISE_SIGMAS * self.standard_error, _MAX_RISE_DISTANCE * self.height
        ):
            return "virgin"
        return (
            "settled"
            if self.difference + 2.0 * self.standard_error < _MAX_RISE_DISTANCE * self.height
            else "unsure"
        )


def propose_histories(loops: Sequence[Loop], *, even: bool) -> list[HistoryProposal]:
    """Judge from loops recorded alike what happened before each, and say why.

    The virgin curve lies below later rises from the remanent state, and inside the loop where the
    input takes both signs: a first rise that lies there, by more than noise, began demagnetised; so
    did a record that starts at rest and does not come back to its start. Where noise hides it, a
    record is taken for what all the others that start at rest are, and else for settled.
    """
    comparisons = [_compare_rises(loop, even=even) for loop in loops]
    are_all_virgin = _are_all_virgin([parts for parts in comparisons if parts])
    return [
        _propose_history(loop, parts, are_all_virgin, even=even)
        for loop, parts in zip(loops, comparisons, strict=True)
    ]


def correct_fast_histories(
    loops: Sequence[Loop], proposals: Sequence[HistoryProposal]
) -> list[HistoryProposal]:
    """Return the proposals, with those of fast loops corrected by the slow loops of their gap.

    Eddy currents make the first cycle of a fast loop differ from later ones, as an initial curve
    would. A slow loop shows without them whether the session began demagnetised. If it did not, the
    slow loop is what happened before the fast one.
    """
    carried = list(proposals)
    for index, slower in enumerate(find_slower_loops(loops)):
        not_demagnetised = [place for place in slower if proposals[place][0].kind != "demagnetised"]
        if (
            proposals[index][0].kind != "demagnetised"
            or not slower
            or len(not_demagnetised) < len(slower)
        ):
            continue
        slow = max((loops[place] for place in slower), key=lambda loop: float(np.ptp(loop.input)))
        reason = (
            "it is faster than others of its gap, and their first rise is not the initial curve; "
            "eddy currents alone make its first cycle differ (state --history to change this)"
        )
        carried[index] = _history_after_slow(slow, loops[index]), reason
    return carried


def _history_after_slow(slow: Loop, fast: Loop) -> History:
    """Return the history of a loop that begins at rest after a slow one."""
    span, start = float(np.ptp(slow.input)), float(fast.input[0])
    last = [slow.n - 1 - int(pick(slow.input[::-1])) for pick in (np.argmin, np.argmax)]
    ends = [float(f"{slow.input[place]:.4g}") for place in sorted(last)]
    return_point = (
        [] if abs(ends[-1] - start) <= _MAX_END_DISTANCE * span else [float(f"{start:.4g}")]
    )
    return History("conditioned", (*ends, *return_point))


def _are_all_virgin(seen: Sequence[list[_RiseComparison]]) -> bool:
    """Whether records that are unsure one by one are virgin taken together."""
    # Not the clearest part of each: the best of several is never zero on average.
    full_parts = [parts[-1] for parts in seen]
    if not full_parts or any(_select_clearest(parts).verdict == "settled" for parts in seen):
        return False
    mean_sigmas = sum(rises.difference_sigmas for rises in full_parts) / len(full_parts) ** 0.5
    heights = sum(abs(rises.height) for rises in full_parts)
    return (
        mean_sigmas > _MIN_RISE_SIGMAS
        and sum(rises.difference for rises in full_parts) > _MAX_RISE_DISTANCE * heights
    )


def _select_clearest(parts: list[_RiseComparison]) -> _RiseComparison:
    return max(parts, key=lambda rises: (rises.verdict == "virgin", rises.difference_sigmas))


def _propose_history(
    loop: Loop, parts: list[_RiseComparison], are_all_virgin: bool, *, even: bool
) -> HistoryProposal:
    if not parts:
        return _propose_from_closure(loop, even=even)
    clearest = _select_clearest(parts)
    if clearest.verdict == "virgin":
        share = clearest.difference / float(np.ptp(loop.output))
        return (
            DEMAGNETISED,
            f"its first rise deviates from later rises by {share:.1%} of the output's range, as an "
            "initial curve does",
        )
    if clearest.verdict == "settled":
        return SETTLED, "its first rise agrees with later rises"
    if are_all_virgin:
        return DEMAGNETISED, "the first rises of all records are, on average, initial curves"
    return SETTLED, "its first rise differs from later rises by noise only"


def _propose_from_closure(loop: Loop, *, even: bool) -> HistoryProposal:
    """Judge a record that has no second rise to compare the first with."""
    drive, answer = loop.input, loop.output
    height = float(np.ptp(answer)) or 1.0
    end_output = _output_at_return(drive, answer)
    closing_error = None if end_output is None else float(end_output - answer[0])
    # Two single samples differ by noise alone now and then.
    noise_limit = 5.0 * estimate_noise(answer)
    is_at_rest = _starts_at_rest(loop, even=even)
    if is_at_rest and even and closing_error is not None:
        is_virgin = closing_error > max(
            _MIN_REMANENCE_SHARE * height, noise_limit
        ) and _has_remanence(loop, closing_error)
    else:
        is_virgin = is_at_rest and (
            closing_error is None
            or abs(closing_error) > max(_MAX_END_DISTANCE * height, noise_limit)
        )
    if is_virgin:
        verb_text = "never comes" if closing_error is None else "does not come"
        return DEMAGNETISED, f"it starts at rest, at zero, and {verb_text} back there"
    if closing_error is None:
        return SETTLED, "it starts away from rest and is no complete cycle: a guess"
    error_text = f"{abs(closing_error) / height:.2%} of its height"
    if abs(closing_error) <= max(_MAX_END_DISTANCE * height, noise_limit):
        return SETTLED, f"it comes back to its start within {error_text}"
    if is_at_rest:
        return SETTLED, f"it misses its start by {error_text}, as a drift would and no remanence"
    return SETTLED, f"it starts away from rest and misses its start by {error_text}: a guess"


def _has_remanence(loop: Loop, closing_error: float) -> bool:
    """Whether what an even output misses its start by is remanence, and no drift.

    The output is the square of a flux. From rest it grows fourfold while the input grows to twice,
    or less, as the virgin curve steepens; and remanence is at least as far above that curve in
    flux there: in output ``(2 + 1)**2 - 2**2`` times what was missed. A drift is as far apart
    everywhere, and a settled rise starts with a slope.
    """
    parts = find_branches(loop.input)
    if len(parts) < 2:
        return False
    rise, fall = ((loop.input[part.rows], loop.output[part.rows]) for part in parts[:2])
    growth = rise[1] - loop.output[0]
    if float(growth.max()) < 4.0 * closing_error:
        return True  # a remanence like that hides all else
    input_at_1, input_at_4 = (
        float(rise[0][np.argmax(growth >= k * closing_error)]) for k in (1.0, 4.0)
    )
    difference = (
        float(_interpolate(fall, np.array([input_at_4]))[0] - loop.output[0]) - 4.0 * closing_error
    )
    start = float(loop.input[0])
    return difference >= 5.0 * closing_error and abs(input_at_4 - start) <= 2.4 * abs(
        input_at_1 - start
    )


def _starts_at_rest(loop: Loop, *, even: bool) -> bool:
    drive, answer = loop.input, loop.output
    if abs(drive[0]) > _MAX_END_DISTANCE * float(np.max(np.abs(drive))):
        return False
    # An even output is least at rest, whatever the offset of its sensor.
    zero = float(answer.min()) if even else 0.0
    distance = abs(answer[0] - zero)
    return bool(
        distance
        <= 2 * _MAX_END_DISTANCE * float(np.max(np.abs(answer - zero)))
        + 5.0 * estimate_noise(answer)
    )


def _compare_rises(loop: Loop, *, even: bool) -> list[_RiseComparison]:
    """Compare the first rise with a later one, part by part; ``None`` without a later one."""
    size, answer = fold_input(loop, even=even)
    rest_limit = _MAX_REST_SHARE * float(np.max(np.abs(size)))
    parts = find_branches(size)
    if abs(size[0]) > rest_limit or len(parts) < 3:
        return []
    first = parts[0]
    if not first.is_rising:
        size, answer = -size, answer if even else -answer
    low, end = float(size[0]), float(size[first.stop - 1])
    for index in range(2, len(parts), 2):
        later = parts[index]
        top = min(end, float(size[later.stop - 1]))
        if float(size[later.start]) <= low + rest_limit and top - low >= 0.5 * (end - low):
            break
    else:
        return []
    curves = [(size[part.rows], answer[part.rows]) for part in parts]
    sigma = (
        estimate_noise(loop.input),
        max(estimate_noise(loop.output), _MIN_NOISE_SHARE * float(np.ptp(loop.output))),
    )
    falls = (curves[1], curves[index + 1]) if index + 1 < len(parts) else None
    drift = _estimate_drift(curves[0], curves[index], falls, top, sigma)
    comparisons = _compare_parts(curves[0], curves[index], curves[1], top - low, drift, sigma)
    inputs_between = loop.input[first.stop - 1 : later.stop]
    inputs_between = inputs_between * np.sign(inputs_between[0])
    if not (float(inputs_between.min()) < -0.1 * float(inputs_between.max())):
        return comparisons
    # Inside a loop the virgin curve lies above later rises; but close to rest a square of the flux
    # lies above it, since remanence has the other sign there.
    signs = [
        np.sign(part.difference) if even and part is not comparisons[-1] else -1.0
        for part in comparisons
    ]
    return [
        replace(part, difference=sign * part.difference)
        for part, sign in zip(comparisons, signs, strict=True)
    ]


def _estimate_drift(
    rise: _Curve, later_rise: _Curve, falls: tuple[_Curve, _Curve] | None, top: float, sigma: _Sigma
) -> tuple[float, float]:
    """Mean distance of what must lie on each other if nothing drifts, and its standard error."""
    span = top - float(rise[0][0])
    if falls is not None and abs(falls[0][0][0] - falls[1][0][0]) <= _MAX_REST_SHARE * span:
        (first, second), low = falls, float(falls[1][0].min())
    else:
        first, second, low = rise, later_rise, top - (1.0 - _RISES_MEET_SHARE) * span
    is_in_range = (first[0] >= low) & (first[0] <= min(top, float(second[0].max())))
    size, answer = first[0][is_in_range], first[1][is_in_range]
    if size.size < _MIN_SAMPLES:
        return 0.0, _output_scatter(rise[1], span, sigma)
    difference = _interpolate(second, size) - answer
    error = _output_scatter(answer, span, sigma) * (2.0 / size.size) ** 0.5
    # What is not the same all along is no drift.
    unevenness = float(np.std([part.mean() for part in np.array_split(difference, _MIN_SAMPLES)]))
    return float(difference.mean()), max(error, unevenness)


def _compare_parts(
    rise: _Curve,
    later_rise: _Curve,
    fall: _Curve,
    span: float,
    drift: tuple[float, float],
    sigma: _Sigma,
) -> list[_RiseComparison]:
    """Compare two rises over several parts of the first, all of which begin at rest."""
    size, answer = rise
    share = (size - size[0]) / span
    difference, height = (
        _interpolate(later_rise, size) - answer,
        _interpolate(fall, size) - _interpolate(later_rise, size),
    )
    rises = []
    for part in _FIRST_RISE_PARTS:
        low = share < part
        count = min(np.count_nonzero(low), np.count_nonzero(later_rise[0] < size[0] + part * span))
        if count < _MIN_SAMPLES:
            continue
        error = _output_scatter(answer[low], part * span, sigma) * (2.0 / count) ** 0.5
        mean = float(difference[low].mean()) - drift[0]
        rises.append(
            _RiseComparison(mean, float(np.hypot(error, drift[1])), float(height[low].mean()))
        )
    return rises


def _output_scatter(answer: FloatArray, span: float, sigma: _Sigma) -> float:
    """Return the standard deviation of an output at equal input, by the noise of both."""
    return float(np.hypot(sigma[1], float(np.ptp(answer)) / span * sigma[0]))


def _interpolate(curve: _Curve, size: FloatArray) -> FloatArray:
    order = np.argsort(curve[0], kind="stable")
    return np.interp(size, curve[0][order], curve[1][order])


def _output_at_return(drive: FloatArray, answer: FloatArray) -> float | None:
    """Output when the input last passes its first value in the direction it started in."""
    parts = find_branches(drive)
    if len(parts) < 2:
        return None
    later = slice(parts[0].stop - 1, None)
    outputs_again = find_crossings(
        drive[later], answer[later], float(drive[0]), rising=parts[0].is_rising
    )
    if outputs_again.size:
        return float(outputs_again[-1])
    remaining_input, step = float(drive[0] - drive[-1]), float(drive[-1] - drive[-2])
    if abs(remaining_input) > _MAX_END_DISTANCE * float(np.ptp(drive)):
        return None
    # A cycle without its last sample ends a step before its start: where it was going to.
    steps_ahead = remaining_input / step if step != 0.0 else 0.0
    steps_ahead = steps_ahead if 0.0 < steps_ahead <= 1.5 else 0.0
    return float(answer[-1] + steps_ahead * (answer[-1] - answer[-2]))
