"""How a record starts: on the virgin curve, or in a cycle that has been run often."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from anhyst.data.estimates import noise
from anhyst.data.loops import Loop, folded
from anhyst.data.path import DEMAGNETISED, SETTLED, History, branches, crossings
from anhyst.data.speeds import slower_loops
from anhyst.support.numeric import FloatArray

Proposal = tuple[History, str]
_Curve = tuple[FloatArray, FloatArray]
_Sigma = tuple[float, float]

_NEAR = 0.02
"""A start or an end within this share of the range counts as reached."""
_CLOSED = 2e-3
"""Share of the height below which a remanence is not looked for."""
_REST = 0.05
"""A rise from within this share of the largest input is one from zero."""
_NEAR_REST = (0.01, 0.03, 0.1, 0.3)
"""Parts of the first rise over which it is compared: where it differs most, depends on the iron."""
_TOP = 0.9
"""From this part of the first rise on, all rises meet: what they differ by there is drift."""
_FEWEST = 3
"""Samples from which something is estimated."""
_ALIKE = 0.05
"""Rises nearer to each other than this share of the loop's height are one and the same."""
_SURE = 4.5
"""Standard errors from which a difference is not noise."""
_QUIET = 1e-4
"""Share of the height that two records of one thing differ by, however little they scatter."""


@dataclass(frozen=True, slots=True)
class _Rises:
    """The first rise against a later one: mean difference, its standard error, loop's height."""

    apart: float
    error: float
    height: float

    @property
    def clearness(self) -> float:
        """Difference in standard errors; zero if an output without noise or change shows none."""
        return self.apart / self.error if self.error > 0.0 else 0.0

    @property
    def verdict(self) -> Literal["virgin", "settled", "unsure"]:
        """Verdict on the first rise; none where the noise hides it."""
        if self.apart > max(_SURE * self.error, _ALIKE * self.height):
            return "virgin"
        return "settled" if self.apart + 2.0 * self.error < _ALIKE * self.height else "unsure"


def propose_histories(loops: Sequence[Loop], *, even: bool) -> list[Proposal]:
    """Judge from loops recorded alike what happened before each, and say why.

    The virgin curve lies below later rises from the remanent state, and inside the loop where the
    input takes both signs: a first rise that lies there, by more than noise, began demagnetised; so
    did a record that starts at rest and does not come back to its start. Where noise hides it, a
    record is taken for what all the others that start at rest are, and else for settled.
    """
    seen = [_rises(loop, even=even) for loop in loops]
    alike = _all_virgin([parts for parts in seen if parts])
    return [
        _propose(loop, parts, alike, even=even) for loop, parts in zip(loops, seen, strict=True)
    ]


def carry_histories(loops: Sequence[Loop], proposals: Sequence[Proposal]) -> list[Proposal]:
    """Return the proposals, with those of fast loops corrected by the slow loops of their gap.

    Eddy currents make the first cycle of a fast loop differ from later ones, as an initial curve
    would. A slow loop shows without them whether the session began demagnetised. If it did not, the
    slow loop is what happened before the fast one.
    """
    carried = list(proposals)
    for index, slower in enumerate(slower_loops(loops)):
        known = [place for place in slower if proposals[place][0].kind != "demagnetised"]
        if proposals[index][0].kind != "demagnetised" or not slower or len(known) < len(slower):
            continue
        slow = max((loops[place] for place in slower), key=lambda loop: float(np.ptp(loop.input)))
        reason = (
            "it is faster than others of its gap, and their first rise is not the initial curve; "
            "eddy currents alone make its first cycle differ (state --history to change this)"
        )
        carried[index] = _after(slow, loops[index]), reason
    return carried


def _after(slow: Loop, fast: Loop) -> History:
    """Return the history of a loop that begins at rest after a slow one."""
    span, start = float(np.ptp(slow.input)), float(fast.input[0])
    last = [slow.n - 1 - int(pick(slow.input[::-1])) for pick in (np.argmin, np.argmax)]
    ends = [float(f"{slow.input[place]:.4g}") for place in sorted(last)]
    back = [] if abs(ends[-1] - start) <= _NEAR * span else [float(f"{start:.4g}")]
    return History("conditioned", (*ends, *back))


def _all_virgin(seen: Sequence[list[_Rises]]) -> bool:
    """Whether records that are unsure one by one are virgin taken together."""
    # Not the clearest part of each: the best of several is never zero on average.
    whole = [parts[-1] for parts in seen]
    if not whole or any(_clearest(parts).verdict == "settled" for parts in seen):
        return False
    apart = sum(rises.clearness for rises in whole) / len(whole) ** 0.5
    heights = sum(abs(rises.height) for rises in whole)
    return apart > _SURE and sum(rises.apart for rises in whole) > _ALIKE * heights


def _clearest(parts: list[_Rises]) -> _Rises:
    return max(parts, key=lambda rises: (rises.verdict == "virgin", rises.clearness))


def _propose(loop: Loop, parts: list[_Rises], alike: bool, *, even: bool) -> Proposal:
    if not parts:
        return _by_closure(loop, even=even)
    seen = _clearest(parts)
    if seen.verdict == "virgin":
        share = seen.apart / float(np.ptp(loop.output))
        return (
            DEMAGNETISED,
            f"its first rise deviates from later rises by {share:.1%} of the output's range, as an "
            "initial curve does",
        )
    if seen.verdict == "settled":
        return SETTLED, "its first rise agrees with later rises"
    if alike:
        return DEMAGNETISED, "the first rises of all records are, on average, initial curves"
    return SETTLED, "its first rise differs from later rises by noise only"


def _by_closure(loop: Loop, *, even: bool) -> Proposal:
    """Judge a record that has no second rise to compare the first with."""
    drive, answer = loop.input, loop.output
    height = float(np.ptp(answer)) or 1.0
    back = _return_to_start(drive, answer)
    missed = None if back is None else float(back - answer[0])
    # Two single samples differ by noise alone now and then.
    chance = 5.0 * noise(answer)
    at_rest = _starts_at_rest(loop, even=even)
    if at_rest and even and missed is not None:
        kept = missed > max(_CLOSED * height, chance) and _keeps_remanence(loop, missed)
    else:
        kept = at_rest and (missed is None or abs(missed) > max(_NEAR * height, chance))
    if kept:
        never = "never comes" if missed is None else "does not come"
        return DEMAGNETISED, f"it starts at rest, at zero, and {never} back there"
    if missed is None:
        return SETTLED, "it starts away from rest and is no complete cycle: a guess"
    by = f"{abs(missed) / height:.2%} of its height"
    if abs(missed) <= max(_NEAR * height, chance):
        return SETTLED, f"it comes back to its start within {by}"
    if at_rest:
        return SETTLED, f"it misses its start by {by}, as a drift would and no remanence"
    return SETTLED, f"it starts away from rest and misses its start by {by}: a guess"


def _keeps_remanence(loop: Loop, missed: float) -> bool:
    """Whether what an even output misses its start by is remanence, and no drift.

    The output is the square of a flux. From rest it grows fourfold while the input grows to twice,
    or less, as the virgin curve steepens; and remanence is at least as far above that curve in
    flux there: in output ``(2 + 1)**2 - 2**2`` times what was missed. A drift is as far apart
    everywhere, and a settled rise starts with a slope.
    """
    parts = branches(loop.input)
    if len(parts) < 2:
        return False
    rise, fall = ((loop.input[part.rows], loop.output[part.rows]) for part in parts[:2])
    grown = rise[1] - loop.output[0]
    if float(grown.max()) < 4.0 * missed:
        return True  # a remanence like that hides all else
    once, fourfold = (float(rise[0][np.argmax(grown >= k * missed)]) for k in (1.0, 4.0))
    apart = float(_at(fall, np.array([fourfold]))[0] - loop.output[0]) - 4.0 * missed
    start = float(loop.input[0])
    return apart >= 5.0 * missed and abs(fourfold - start) <= 2.4 * abs(once - start)


def _starts_at_rest(loop: Loop, *, even: bool) -> bool:
    drive, answer = loop.input, loop.output
    if abs(drive[0]) > _NEAR * float(np.max(np.abs(drive))):
        return False
    # An even output is least at rest, whatever the offset of its sensor.
    zero = float(answer.min()) if even else 0.0
    away = abs(answer[0] - zero)
    return bool(away <= 2 * _NEAR * float(np.max(np.abs(answer - zero))) + 5.0 * noise(answer))


def _rises(loop: Loop, *, even: bool) -> list[_Rises]:
    """Compare the first rise with a later one, part by part; ``None`` without a later one."""
    size, answer = folded(loop, even=even)
    reach = _REST * float(np.max(np.abs(size)))
    parts = branches(size)
    if abs(size[0]) > reach or len(parts) < 3:
        return []
    first = parts[0]
    if not first.rising:
        size, answer = -size, answer if even else -answer
    low, end = float(size[0]), float(size[first.stop - 1])
    for index in range(2, len(parts), 2):
        later = parts[index]
        top = min(end, float(size[later.stop - 1]))
        if float(size[later.start]) <= low + reach and top - low >= 0.5 * (end - low):
            break
    else:
        return []
    curves = [(size[part.rows], answer[part.rows]) for part in parts]
    sigma = noise(loop.input), max(noise(loop.output), _QUIET * float(np.ptp(loop.output)))
    falls = (curves[1], curves[index + 1]) if index + 1 < len(parts) else None
    drift = _drift(curves[0], curves[index], falls, top, sigma)
    weighed = _weigh(curves[0], curves[index], curves[1], top - low, drift, sigma)
    between = loop.input[first.stop - 1 : later.stop]
    between = between * np.sign(between[0])
    if not (float(between.min()) < -0.1 * float(between.max())):
        return weighed
    # Inside a loop the virgin curve lies above later rises; but close to rest a square of the flux
    # lies above it, since remanence has the other sign there.
    signs = [np.sign(part.apart) if even and part is not weighed[-1] else -1.0 for part in weighed]
    return [
        replace(part, apart=sign * part.apart) for part, sign in zip(weighed, signs, strict=True)
    ]


def _drift(
    rise: _Curve, again: _Curve, falls: tuple[_Curve, _Curve] | None, top: float, sigma: _Sigma
) -> tuple[float, float]:
    """Mean distance of what must lie on each other if nothing drifts, and its standard error."""
    span = top - float(rise[0][0])
    if falls is not None and abs(falls[0][0][0] - falls[1][0][0]) <= _REST * span:
        (first, second), low = falls, float(falls[1][0].min())
    else:
        first, second, low = rise, again, top - (1.0 - _TOP) * span
    inside = (first[0] >= low) & (first[0] <= min(top, float(second[0].max())))
    size, answer = first[0][inside], first[1][inside]
    if size.size < _FEWEST:
        return 0.0, _scatter(rise[1], span, sigma)
    apart = _at(second, size) - answer
    error = _scatter(answer, span, sigma) * (2.0 / size.size) ** 0.5
    # What is not the same all along is no drift.
    uneven = float(np.std([part.mean() for part in np.array_split(apart, _FEWEST)]))
    return float(apart.mean()), max(error, uneven)


def _weigh(
    rise: _Curve,
    again: _Curve,
    fall: _Curve,
    span: float,
    drift: tuple[float, float],
    sigma: _Sigma,
) -> list[_Rises]:
    """Compare two rises over several parts of the first, all of which begin at rest."""
    size, answer = rise
    share = (size - size[0]) / span
    apart, height = _at(again, size) - answer, _at(fall, size) - _at(again, size)
    rises = []
    for part in _NEAR_REST:
        low = share < part
        count = min(np.count_nonzero(low), np.count_nonzero(again[0] < size[0] + part * span))
        if count < _FEWEST:
            continue
        error = _scatter(answer[low], part * span, sigma) * (2.0 / count) ** 0.5
        mean = float(apart[low].mean()) - drift[0]
        rises.append(_Rises(mean, float(np.hypot(error, drift[1])), float(height[low].mean())))
    return rises


def _scatter(answer: FloatArray, span: float, sigma: _Sigma) -> float:
    """Return the standard deviation of an output at equal input, by the noise of both."""
    return float(np.hypot(sigma[1], float(np.ptp(answer)) / span * sigma[0]))


def _at(curve: _Curve, size: FloatArray) -> FloatArray:
    order = np.argsort(curve[0], kind="stable")
    return np.interp(size, curve[0][order], curve[1][order])


def _return_to_start(drive: FloatArray, answer: FloatArray) -> float | None:
    """Output when the input last passes its first value in the direction it started in."""
    parts = branches(drive)
    if len(parts) < 2:
        return None
    later = slice(parts[0].stop - 1, None)
    again = crossings(drive[later], answer[later], float(drive[0]), rising=parts[0].rising)
    if again.size:
        return float(again[-1])
    missing, step = float(drive[0] - drive[-1]), float(drive[-1] - drive[-2])
    if abs(missing) > _NEAR * float(np.ptp(drive)):
        return None
    # A cycle without its last sample ends a step before its start: where it was going to.
    ahead = missing / step if step != 0.0 else 0.0
    ahead = ahead if 0.0 < ahead <= 1.5 else 0.0
    return float(answer[-1] + ahead * (answer[-1] - answer[-2]))
