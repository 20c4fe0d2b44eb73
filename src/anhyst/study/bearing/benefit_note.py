"""What compensation gained on the example bearing, for loops like those that were measured.

``benefit_example.jsonl`` beside this module is a map of :func:`anhyst.study.bearing.benefit.benefit`,
made by ``tools/make_benefit_table.py``.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from importlib.resources import files
from typing import Any

from anhyst.data.loop_set import LoopSet
from anhyst.data.reversal import reversal_share

TABLE = "benefit_example.jsonl"

_SHARE = 0.2
"""Difference in the slope after a reversal that counts as much as loops twice as wide."""
_FAR = 1.0
"""Such a difference makes another magnet."""

Row = dict[str, Any]


@dataclass(frozen=True)
class BenefitNote:
    """What the map says of loops like these.

    Parameters
    ----------
    loop_width_percent : float
        Of the measured loops, % of the largest current.
    after_reversal : float or None
        Slope just after a reversal over the static slope; None where the loops do not tell.
    nearest : tuple of dict
        The rows of the map that were used, one a step height and magnet; none where no magnet of
        the map is alike.
    sentence : str
        The same in words.
    """

    loop_width_percent: float
    after_reversal: float | None
    nearest: tuple[Row, ...]
    sentence: str

    def as_dict(self) -> dict[str, Any]:
        """Return it ready for JSON."""
        return asdict(self)


def benefit_note(loopset: LoopSet, width_relative: float) -> BenefitNote | None:
    """Look up what compensation gained for such loops.

    Parameters
    ----------
    loopset : LoopSet
    width_relative : float
        Largest loop width over the largest range of the current, as the verdict has it.

    Returns
    -------
    BenefitNote or None
        None where the loops are not those of a bearing: force over current at known gaps.
    """
    names = loopset.input.name, loopset.output.name, loopset.schedule and loopset.schedule.name
    fixed = all(loop.schedule_value is not None for loop in loopset.loops)
    if names != ("current", "force", "gap") or not fixed:
        return None
    width, share = 100.0 * width_relative, reversal_share(loopset)
    rows = _nearest(width, share)
    return BenefitNote(width, share, rows, _sentence(width, share, rows))


@lru_cache(maxsize=1)
def table() -> tuple[Row, ...]:
    """Return the map, one row a magnet and step height."""
    text = files("anhyst.study.bearing").joinpath(TABLE).read_text(encoding="utf-8")
    return tuple(json.loads(line) for line in text.splitlines()[1:])


def _nearest(width: float, share: float | None) -> tuple[Row, ...]:
    """Return the rows of the nearest magnet, or of all of that width if nothing else is known."""
    rows = table()

    def distance(row: Row) -> float:
        wider = math.log2(max(width, 1e-9) / row["loop_width_percent"])
        if share is None:
            return abs(wider)
        return math.hypot(wider, (share - _known(row)) / _SHARE)

    if share is None:
        return tuple(row for row in rows if distance(row) < 0.5 * _FAR)
    best = min(distance(row) for row in rows)
    return tuple(row for row in rows if distance(row) == best <= _FAR)


def _sentence(width: float, share: float | None, rows: Sequence[Row]) -> str:
    here = f"{width:.1f} %, {'not told by these loops' if share is None else f'{share:.2f}'}"
    own = "'anhyst simulate --benefit' maps it for your own bearing"
    loops = "loops like these (width in % of the current, slope left at a reversal: "
    if not rows:
        return f"Compensation was mapped for no magnet with {loops}{here}); {own}."
    heights = sorted({1e6 * row["height_m"] for row in rows})
    full, ratio, best = (
        _span(row["overshoot_percent"][name or row["rival"]] for row in rows)
        for name in ("full", "ratio", None)
    )
    flux = _span(row["overshoot_percent"]["flux"] for row in rows)
    widths = _span(row["loop_width_percent"] for row in rows)
    shares = _span(_known(row) for row in rows)
    return (
        f"On the simulated example bearing, a magnet with {loops}{widths} %, {shares}; here {here})"
        f" overshot steps of {heights[0]:g} to {heights[-1]:g} um by {full} % with hysteresis "
        f"compensation, by {ratio} % with a constant force-current ratio, by {best} % with the "
        f"best drive without memory and by {flux} % with a Hall probe: {_conclusion(rows)}; {own}."
    )


def _known(row: Row) -> float:
    """Return the slope after a reversal as loops would tell it, or else as it is."""
    told = row["after_reversal"]
    return float(row["after_reversal_true"] if told is None else told)


def _conclusion(rows: Sequence[Row]) -> str:
    outcomes = [row["outcome"] for row in rows]
    beyond = [row["settling_s"]["full"] / row["settling_s"][row["settling_rival"]] for row in rows]
    gains, losses, total = outcomes.count("gain"), outcomes.count("loss"), len(outcomes)
    if gains == total:
        over = "it gained over the ratio and over the best without memory"
    elif outcomes.count("nothing to gain") == total:
        over = (
            "it gained over the ratio, and beside the best without memory nothing was left to gain"
        )
    else:
        over = (
            f"it gained over the ratio; against the best without memory it gained in {gains} of "
            f"{total} cases and lost in {losses}"
        )
    low, high = f"{min(beyond):.2f}", f"{max(beyond):.2f}"
    return f"{over}, and settled within {low} to {high} of the time of the quickest of them"


def _span(values: Iterable[float]) -> str:
    given = list(values)
    low, high = f"{min(given):.2g}", f"{max(given):.2g}"
    return low if low == high else f"{low} to {high}"
