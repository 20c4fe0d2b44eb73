"""The acceptance test of the paper (II.C): at a fixed current the force rises as the gap closes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from anhyst.errors import InputError, NegativeResult

if TYPE_CHECKING:
    from anhyst.model import ActuatorModel

FloatArray = NDArray[np.float64]

GAPS_BETWEEN_NODES = 20
DRIVES_A_BRANCH = 100

TOLERANCE = 1e-4
"""Fall of the output, in parts of the largest, that still counts as none: a tenth of what the
best force sensors resolve, and far above rounding where all gaps share one remanence."""


@dataclass(frozen=True, eq=False)
class GapCheck:
    """Outcome of the acceptance test over the gap.

    Parameters
    ----------
    gaps : ndarray, shape (g,)
        The dense grid of gaps, ascending, m.
    drive : ndarray, shape (n,)
        Settled cycle: the rising branch, then the falling one, in units of the input.
    output : ndarray, shape (g, n)
        Output over that cycle at each gap; NaN where the model could not be computed.
    fall : float
        Largest fall of the output towards a smaller gap, in parts of the largest output.
    gap : float
        Gap at which the output has fallen most, m.
    at_drive : float
        Drive at which it has, in units of the input.
    branch : str
        ``"rising"`` or ``"falling"``.
    towards : float
        1 where a rise is one upward; -1 where output is negative and rises in magnitude.
    trouble : str
        Why a gap could not be computed; empty if all could.
    """

    gaps: FloatArray
    drive: FloatArray
    output: FloatArray
    fall: float
    gap: float
    at_drive: float
    branch: str
    towards: float = 1.0
    trouble: str = ""

    @property
    def failing(self) -> tuple[float, ...]:
        """Gaps where the output has fallen, or could not be computed, m."""
        fallen = np.fmax.reduce(_falls(self.towards * self.output), axis=1, initial=0.0) > TOLERANCE
        return tuple(self.gaps[fallen | np.isnan(self.output).any(axis=1)].tolist())

    @property
    def passed(self) -> bool:
        """Whether the output rises throughout as the gap closes."""
        return not self.trouble and self.fall <= TOLERANCE

    def text(self, unit: str) -> str:
        """One sentence for a person; ``unit`` is that of the drive."""
        span = f"{1e3 * self.gaps[0]:.4g} to {1e3 * self.gaps[-1]:.4g} mm"
        if self.trouble:
            return (
                f"the model cannot be computed at a gap of {1e3 * self.gap:.4g} mm: {self.trouble}"
            )
        if self.passed:
            return f"at every drive the output rises as the gap closes ({span}, both branches)"
        return (
            f"the output falls as the gap closes: by {100 * self.fall:.2g} % of the largest, at "
            f"{1e3 * self.gap:.4g} mm and {self.at_drive:.4g} {unit} on the {self.branch} branch; "
            "no electromagnet with a plain gap does that, do not use the model there"
        )


def check_over_gap(
    model: ActuatorModel, at: Callable[[float], ActuatorModel] | None = None
) -> GapCheck | None:
    """Test that at any fixed drive the output rises as the gap closes.

    The settled cycle between zero (less the offset of the input: below it, what remains in the iron
    is demagnetised, most at the smallest gap) and the largest measured drive is computed on a dense
    grid of gaps over and between all nodes, at 100 drives on each branch.

    Parameters
    ----------
    model : ActuatorModel
        The model. Its largest drive is that of its valid range.
    at : callable, optional
        Gives the model of a single gap, for another interpolation than the model's own.

    Returns
    -------
    GapCheck or None
        None where the test does not apply: the scheduling variable is not a gap, there is one
        node only, nothing varies, or there is no valid range to say how far to drive.
    """
    if model.schedule is None or model.schedule.name != "gap" or not model.varying:
        return None
    if len(model.nodes) < 2 or model.valid is None:
        return None
    nodes = np.array(model.nodes)
    parts = np.arange(GAPS_BETWEEN_NODES) / GAPS_BETWEEN_NODES
    gaps = np.append((nodes[:-1, None] + np.diff(nodes)[:, None] * parts).ravel(), nodes[-1])
    half = np.linspace(_rest(model), _largest_drive(model), DRIVES_A_BRANCH)
    drive = np.concatenate([half, half[-2::-1]])
    towards = -1.0 if model.power == 1 and half[-1] < 0.0 else 1.0  # "rises" means: in magnitude
    output = np.full((gaps.size, drive.size), np.nan)
    troubles: list[tuple[float, str]] = []
    for place, gap in enumerate(gaps.tolist()):
        try:
            if at is None:
                found = model.predict(drive, gap, _slow(drive.size), "settled")
            else:
                found = at(gap).predict(drive, None, _slow(drive.size), "settled")
        except (InputError, NegativeResult) as error:
            troubles.append((gap, str(error)))
        else:
            output[place] = found.output
    if troubles:
        gap, trouble = troubles[0]
        return GapCheck(gaps, drive, output, np.inf, gap, 0.0, "rising", towards, trouble)
    return _judge(gaps, drive, output, towards)


def _largest_drive(model: ActuatorModel) -> float:
    assert model.valid is not None
    low, high = model.valid.input
    return high if abs(high) >= abs(low) else low


def _rest(model: ActuatorModel) -> float:
    """Return the drive, between zero and half of the largest, from which on none is negative."""
    largest = _largest_drive(model)
    shares = np.atleast_1d(model.parameters["in_0"]) / largest
    return largest * float(np.clip(shares.max(), 0.0, 0.5))


def _slow(size: int) -> FloatArray:
    """Return times so far apart that eddy currents do not count."""
    return 1e9 * np.arange(size, dtype=np.float64)


def _falls(output: FloatArray) -> FloatArray:
    """How far the output lies below that of any wider gap, in parts of the largest output."""
    closing = output[::-1]
    best = np.fmax.accumulate(closing, axis=0)
    largest = max(
        float(np.fmax.reduce(np.abs(output), axis=None, initial=0.0)), np.finfo(np.float64).tiny
    )
    return (best - closing)[::-1] / largest


def _judge(gaps: FloatArray, drive: FloatArray, output: FloatArray, towards: float) -> GapCheck:
    fall = _falls(towards * output)
    gap, sample = np.unravel_index(int(np.argmax(fall)), fall.shape)
    return GapCheck(
        gaps=gaps,
        drive=drive,
        output=output,
        fall=float(fall[gap, sample]),
        gap=float(gaps[gap]),
        at_drive=float(drive[sample]),
        branch="rising" if sample < DRIVES_A_BRANCH else "falling",
        towards=towards,
    )
