"""What a model remembers of how it was found: fit figures, uncertainty, reduction, provenance.

Plain records. Identification fills them, the model file keeps them, the report shows them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Literal

import numpy as np

from anhyst.data.loops import Loops, Source
from anhyst.data.verdict import largest_output
from anhyst.support.numeric import FloatArray

Range = tuple[float, float]

CHOSEN = "chosen"
"""Note of the candidate that became the model."""


@dataclass(frozen=True, slots=True)
class ValidRange:
    """Where the model was seen to hold; outside it computes, but every sample is flagged."""

    input: Range  # smallest and largest measured value, SI
    output: Range
    # smallest and largest value of the scheduling variable, SI; None without one
    schedule: Range | None = None


@dataclass(frozen=True, slots=True)
class LoopFit:
    """How far model and measurement are apart on one loop; deviations in units of the output."""

    label: str  # label of the loop in its file
    schedule: float | None  # scheduling variable of the loop, SI
    samples: int  # number of samples compared
    largest_output: float  # largest absolute output of this loop, SI
    mean_abs: float  # mean absolute (eq. 16), root mean square and largest absolute deviation, SI
    rms: float
    worst: float


@dataclass(frozen=True, slots=True)
class CrossValidation:
    """What to expect at a scheduling value between those measured, or at other samples of few loops."""

    # mean absolute deviation in parts of the largest output, mean over values that were left out of
    # the fit, of the choice of the map and of the decision about offsets alike
    error: float
    low: float  # between them lies the deviation at another such value in about nine of ten cases
    high: float
    folds: tuple[float, ...] = ()  # deviation at each value left out, ascending values
    # ``gap``, or ``block``: blocks of samples were left out, which says nothing of other loops
    left_out: Literal["gap", "block"] = "gap"


@dataclass(frozen=True, slots=True)
class CandidateFit:
    """One law that was fitted and compared with others."""

    law: str  # what it is; the law in words
    gap_map: str
    numbers: int  # how many were fitted
    # root mean square deviation from all loops, in parts of the largest output: of the one chosen
    # that of the model, of the others that of the fits that were compared
    rms: float
    # mean absolute deviation on what was left out of the fit, gaps or loops, in the same parts;
    # None where nothing was, where the law has no answer there, or where it was passed over
    left_out: float | None = None
    note: str = ""  # ``chosen``, ``passed over``, or nothing

    def text(self) -> str:
        """Return the candidate in a line."""
        note = f" ({self.note})" if self.note else ""
        error = "" if self.left_out is None else f", left out {100.0 * self.left_out:.3g} %"
        return (
            f"{self.law}, {self.gap_map}: {self.numbers} numbers, rms {100.0 * self.rms:.3g} %"
            f"{error}{note}"
        )


@dataclass(frozen=True, slots=True)
class FitFigures:
    """How far model and measurement are apart over all loops."""

    # largest absolute output of all loops (of a displacement: largest range), SI; relative figures
    # refer to it
    largest_output: float
    mean_abs: float  # deviations over all samples as in :class:`LoopFit`, SI
    rms: float
    worst: float
    loops: tuple[LoopFit, ...] = ()  # the same loop by loop
    # For each gap map tried, the mean absolute deviation on schedule values that were left out of
    # the fit, relative to the largest output. It chose the map, so it promises too much.
    left_out: Mapping[str, float] = field(default_factory=dict)
    # outcome of the acceptance test over gap and drive; None where it does not apply
    monotone: bool | None = None
    # what to expect at values between those measured; None below three of them
    cross_validation: CrossValidation | None = None
    # the laws that were compared, the simplest first; empty where one was asked for
    candidates: tuple[CandidateFit, ...] = ()
    # root mean square of what is left that is no noise of the sensors, in parts of the largest
    # output; zero where the fit is done, None where nobody looked
    not_noise: float | None = None
    # what is left, in words, and what to do about it; empty where nobody looked
    left_over: str = ""


def fit_figures(
    loopset: Loops,
    fitted: Sequence[FloatArray],
    left_out: Mapping[str, float] = MappingProxyType({}),
    monotone: bool | None = None,
    cross_validation: CrossValidation | None = None,
    candidates: tuple[CandidateFit, ...] = (),
) -> FitFigures:
    """Compare measured and modelled loops."""
    rows, deviations = [], []
    for loop, output in zip(loopset.loops, fitted, strict=True):
        off = np.abs(output - loop.output)
        deviations.append(off)
        rows.append(
            LoopFit(
                label=loop.label,
                schedule=loop.schedule_value,
                samples=loop.n,
                largest_output=float(np.max(np.abs(loop.output))),
                mean_abs=float(off.mean()),
                rms=float(np.sqrt(np.mean(off**2))),
                worst=float(off.max()),
            )
        )
    pooled = np.concatenate(deviations)
    largest, rms = largest_output(loopset), float(np.sqrt(np.mean(pooled**2)))
    return FitFigures(
        largest_output=largest,
        mean_abs=float(pooled.mean()),
        rms=rms,
        worst=float(pooled.max()),
        loops=tuple(rows),
        left_out=dict(left_out),
        monotone=monotone,
        cross_validation=cross_validation,
        candidates=tuple(
            replace(fit, rms=rms / largest) if fit.note == CHOSEN else fit for fit in candidates
        ),
    )


@dataclass(frozen=True, slots=True)
class Uncertainty:
    """What the data say about each fitted quantity, and what they cannot say."""

    # the fitted quantities, with a node in brackets where there is one for each
    names: tuple[str, ...] = ()
    values: tuple[float, ...] = ()  # estimate and standard deviation, in the unit the name states
    std: tuple[float, ...] = ()
    correlation: tuple[tuple[float, ...], ...] = ()  # correlation matrix, one row for each name
    statements: tuple[str, ...] = ()  # plain sentences about what the data do not determine


@dataclass(frozen=True, slots=True)
class ReductionStep:
    """One round of the reduction: a parameter replaced by its mean over the gaps (II.D)."""

    frozen: str  # the parameter that was frozen
    cost_before: float  # mean absolute deviation relative to the largest output, before and after
    cost_after: float
    # cost of freezing each parameter that was tried in this round
    candidates: Mapping[str, float] = field(default_factory=dict)


Setting = str | bool | int | float


@dataclass(frozen=True, slots=True)
class Provenance:
    """Where a model came from."""

    version: str = ""  # version of anhyst that wrote the model
    seed: int | None = None  # seed of the search
    sources: tuple[Source, ...] = ()  # measurement files with their hashes and column mappings
    settings: Mapping[str, Setting] = field(default_factory=dict)  # settings of the identification
