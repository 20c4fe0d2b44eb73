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
from anhyst.support.arrays import FloatArray

Range = tuple[float, float]

CHOSEN = "chosen"
"""Note of the candidate that became the model."""


@dataclass(frozen=True, slots=True)
class ValidRange:
    """Where the model was seen to hold; outside it computes, but every sample is flagged.

    Parameters
    ----------
    input, output : tuple of two floats
        Smallest and largest measured value, SI.
    schedule : tuple of two floats or None
        Smallest and largest value of the scheduling variable, SI; None without one.
    """

    input: Range
    output: Range
    schedule: Range | None = None


@dataclass(frozen=True, slots=True)
class LoopFit:
    """How far model and measurement are apart on one loop; deviations in units of the output.

    Parameters
    ----------
    label : str
        Label of the loop in its file.
    schedule : float or None
        Scheduling variable of the loop, SI.
    samples : int
        Number of samples compared.
    largest_output : float
        Largest absolute output of this loop, SI.
    mean_abs, rms, worst : float
        Mean absolute (eq. 16), root mean square and largest absolute deviation, SI.
    """

    label: str
    schedule: float | None
    samples: int
    largest_output: float
    mean_abs: float
    rms: float
    worst: float


@dataclass(frozen=True, slots=True)
class CrossValidation:
    """What to expect at a scheduling value between those measured, or at other samples of few loops.

    Parameters
    ----------
    error : float
        Mean absolute deviation in parts of the largest output, mean over values that were left out
        of the fit, of the choice of the map and of the decision about offsets alike.
    low, high : float
        Between them lies the deviation at another such value in about nine of ten cases.
    folds : tuple of float
        Deviation at each value left out, ascending values.
    left_out : str
        ``gap``, or ``block``: blocks of samples were left out, which says nothing of other loops.
    """

    error: float
    low: float
    high: float
    folds: tuple[float, ...] = ()
    left_out: Literal["gap", "block"] = "gap"


@dataclass(frozen=True, slots=True)
class CandidateFit:
    """One law that was fitted and compared with others.

    Parameters
    ----------
    law, gap_map : str
        What it is; the law in words.
    numbers : int
        How many were fitted.
    rms : float
        Root mean square deviation from all loops, in parts of the largest output: of the one chosen
        that of the model, of the others that of the fits that were compared.
    left_out : float or None
        Mean absolute deviation on what was left out of the fit, gaps or loops, in the same parts;
        None where nothing was, where the law has no answer there, or where it was passed over.
    note : str
        ``chosen``, ``passed over``, or nothing.
    """

    law: str
    gap_map: str
    numbers: int
    rms: float
    left_out: float | None = None
    note: str = ""


@dataclass(frozen=True, slots=True)
class FitFigures:
    """How far model and measurement are apart over all loops.

    Parameters
    ----------
    largest_output : float
        Largest absolute output of all loops (of a displacement: largest range), SI; relative
        figures refer to it.
    mean_abs, rms, worst : float
        Deviations over all samples as in :class:`LoopFit`, SI.
    loops : tuple of LoopFit
        The same loop by loop.
    left_out : mapping of str to float
        For each gap map tried, the mean absolute deviation on schedule values that were left out
        of the fit, relative to the largest output. It chose the map, so it promises too much.
    monotone : bool or None
        Outcome of the acceptance test over gap and drive; None where it does not apply.
    cross_validation : CrossValidation or None
        What to expect at values between those measured; None below three of them.
    candidates : tuple of CandidateFit
        The laws that were compared, the simplest first; empty where one was asked for.
    not_noise : float or None
        Root mean square of what is left that is no noise of the sensors, in parts of the largest
        output; zero where the fit is done, None where nobody looked.
    left_over : str
        What is left, in words, and what to do about it; empty where nobody looked.
    """

    largest_output: float
    mean_abs: float
    rms: float
    worst: float
    loops: tuple[LoopFit, ...] = ()
    left_out: Mapping[str, float] = field(default_factory=dict)
    monotone: bool | None = None
    cross_validation: CrossValidation | None = None
    candidates: tuple[CandidateFit, ...] = ()
    not_noise: float | None = None
    left_over: str = ""


def fit_figures(
    loopset: Loops,
    fitted: Sequence[FloatArray],
    left_out: Mapping[str, float] = MappingProxyType({}),
    monotone: bool | None = None,
    cross_validation: CrossValidation | None = None,
    candidates: tuple[CandidateFit, ...] = (),
) -> FitFigures:
    """Compare measured and modelled loops.

    Parameters
    ----------
    loopset : Loops
        The measured loops.
    fitted : sequence of ndarray
        Modelled output of each, SI, in the order of the set.
    left_out, monotone, cross_validation, candidates
        As in :class:`FitFigures`.

    Returns
    -------
    FitFigures
    """
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
            replace(one, rms=rms / largest) if one.note == CHOSEN else one for one in candidates
        ),
    )


@dataclass(frozen=True, slots=True)
class Uncertainty:
    """What the data say about each fitted quantity, and what they cannot say.

    Parameters
    ----------
    names : tuple of str
        The fitted quantities, with a node in brackets where there is one for each.
    values, std : tuple of float
        Estimate and standard deviation, in the unit the name states.
    correlation : tuple of tuple of float
        Correlation matrix, one row for each name.
    statements : tuple of str
        Plain sentences about what the data do not determine.
    """

    names: tuple[str, ...] = ()
    values: tuple[float, ...] = ()
    std: tuple[float, ...] = ()
    correlation: tuple[tuple[float, ...], ...] = ()
    statements: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class ReductionStep:
    """One round of the reduction: a parameter replaced by its mean over the gaps (II.D).

    Parameters
    ----------
    frozen : str
        The parameter that was frozen.
    cost_before, cost_after : float
        Mean absolute deviation relative to the largest output, before and after.
    candidates : mapping of str to float
        Cost of freezing each parameter that was tried in this round.
    """

    frozen: str
    cost_before: float
    cost_after: float
    candidates: Mapping[str, float] = field(default_factory=dict)


Setting = str | bool | int | float


@dataclass(frozen=True, slots=True)
class Provenance:
    """Where a model came from.

    Parameters
    ----------
    version : str
        Version of anhyst that wrote the model.
    seed : int or None
        Seed of the search.
    sources : tuple of Source
        Measurement files with their hashes and column mappings.
    settings : mapping of str to str, bool, int or float
        Settings of the identification.
    """

    version: str = ""
    seed: int | None = None
    sources: tuple[Source, ...] = ()
    settings: Mapping[str, Setting] = field(default_factory=dict)
