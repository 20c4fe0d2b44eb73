"""The whole way from loops to a model: checks, search, figures, provenance."""

from __future__ import annotations

import os
import time
from collections import Counter
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from anhyst.data import History, LoopSet
from anhyst.data.plausibility import check_plausible
from anhyst.identify.bare import model_of, valid_range
from anhyst.identify.choice import Choice, search_maps
from anhyst.identify.default import Found
from anhyst.identify.fit_records import records_of
from anhyst.identify.gauge import form_of
from anhyst.identify.objective import Objective
from anhyst.identify.paper.search import check_splines
from anhyst.identify.paper.sequence import search_paper
from anhyst.identify.rest import rest_of
from anhyst.identify.result import IdentifyResult
from anhyst.identify.run import Run
from anhyst.identify.space import IN_SERIES
from anhyst.identify.uncertainty import assess
from anhyst.laws.registry import DEFAULT_LAW, LAWS
from anhyst.model.actuator import ActuatorModel
from anhyst.model.compilable import obstacle
from anhyst.model.fit_record import CrossValidation, Provenance, ReductionStep, fit_figures
from anhyst.model.parameters import GAP_MAPS
from anhyst.support.arrays import FloatArray
from anhyst.support.errors import InputError
from anhyst.support.progress import Progress
from anhyst.support.version import running_version

SEARCHES = ("default", "paper")

FEWEST = 5
"""With fewer samples than this for each quantity that is fitted, a user is warned."""


def identify(
    loopset: LoopSet,
    *,
    law: str = DEFAULT_LAW,
    gap_map: str = "auto",
    search: str = "default",
    seed: int = 1,
    weights: str = "loops",
    offsets: bool = True,
    dead_band: bool = True,
    progress: Progress | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
) -> IdentifyResult:
    """Find the model of an actuator from measured loops.

    Parameters
    ----------
    loopset : LoopSet
        Loops at constant scheduling values; all are fitted together.
    law : str
        One of :data:`anhyst.laws.registry.LAWS`.
    gap_map : str
        ``scaling``, ``reluctance``, ``circuit``, ``free`` or ``auto``, which tries those that a
        controller can use.
    search : str
        ``default``, or ``paper`` for the sequence of the paper's section II.
    seed : int
        Of everything random. Same seed, machine and build: the same model.
    weights : str
        ``loops``: each loop counts the same; ``points``: each sample; ``relative``: each loop by
        its own largest output.
    offsets : bool
        Whether offsets of input and output are taken where the data demand them; else they are
        zero.
    dead_band : bool
        Whether the law is given the widest dead band ``r_d`` that the loops allow, so that small
        movements leave no trace in its memory; the search ``paper`` gives none.
    progress : callable or None
        Told the number of stages done and the total.
    checkpoint : path-like or None
        File that keeps finished stages, so that a killed run goes on where it was.

    Returns
    -------
    IdentifyResult
        After ctrl-C the best so far, marked as interrupted.

    Raises
    ------
    InputError
        Loops that cannot be used or cannot be what they claim, or an unknown law, map, search or
        weighting.
    KeyboardInterrupt
        Ctrl-C before there was any model.
    """
    began = time.perf_counter()
    check_wanted(law, gap_map, search)
    odd = check_plausible(loopset)
    run = Run(
        form=form_of(loopset.input, loopset.output, law),
        records=records_of(
            loopset, weights, rest_of(loopset) if offsets and search == "default" else None
        ),
        seed=seed,
        held=frozenset() if offsets else frozenset({"in_0", "out_0"}),
        dead_band=dead_band and search == "default",
        progress=progress,
        checkpoint=None if checkpoint is None else Path(checkpoint),
        key=f"{search} {law} {dead_band}",
    )
    outcome = _search(run, loopset, gap_map, search)
    found, why = outcome.found, outcome.why
    warnings = [*odd, *_warnings(loopset, run, why, found.theta.size)]
    settings: dict[str, str | bool | int | float] = {
        "search": search,
        "weights": weights,
        "offsets": offsets,
        "gap_map_wanted": gap_map,
        "gap_map_reason": why,
        "dead_band": outcome.dead_band,
    }
    common = {
        "name": _name(loopset),
        "history": _history(loopset),
        "valid": valid_range(loopset),
        "provenance": Provenance(running_version(), seed, loopset.sources, settings),
    }
    model = replace(outcome.model, **common, reduction=outcome.steps)  # type: ignore[arg-type]
    per_gap = outcome.per_gap and replace(outcome.per_gap, **common)  # type: ignore[arg-type]
    acceptance = model.acceptance()
    fitted = outcome.fitted
    model = replace(
        model,
        fit=fit_figures(loopset, fitted, outcome.left_out, acceptance.passed, outcome.promised),
        uncertainty=assess(found, loopset),
    )
    warnings += [reason] if (reason := obstacle(model)) is not None else []
    if not outcome.interrupted:
        run.finish()
    return IdentifyResult(
        model=model,
        loops=loopset,
        fitted=fitted,
        acceptance=acceptance,
        warnings=tuple(warnings),
        per_gap=per_gap,
        splines=None if per_gap is None else check_splines(per_gap),
        seconds=time.perf_counter() - began,
        evaluations=found.evaluations,
        interrupted=outcome.interrupted,
    )


def check_wanted(law: str, gap_map: str, search: str) -> None:
    """Refuse what is unknown or does not go together.

    Raises
    ------
    InputError
        As :func:`identify`.
    """
    for what, value, known in (
        ("law", law, LAWS),
        ("gap map", gap_map, (*GAP_MAPS[1:], "auto")),
        ("search", search, SEARCHES),
    ):
        if value not in known:
            raise InputError(f"{what} '{value}' is unknown; use one of {', '.join(known)}")
    kernel = LAWS[law].kernel
    if kernel is not None and kernel.coupled and gap_map in IN_SERIES:
        # There alpha acts on the irreversible part alone, which a reluctance does not: one number
        # would be fitted for two.
        raise InputError(
            f"gap map '{gap_map}' does not go with the law {law}; use --law {DEFAULT_LAW}, or "
            "--gap-map scaling"
        )
    if search == "paper" and gap_map == "circuit":
        raise InputError(
            "gap map 'circuit' is none of the paper's; use --search default, or --gap-map auto"
        )


@dataclass(frozen=True, eq=False)
class _Outcome:
    """What a search has come to; the model is bare yet."""

    found: Found
    model: ActuatorModel
    fitted: tuple[FloatArray, ...]
    why: str
    interrupted: bool
    dead_band: str = "none"
    left_out: dict[str, float] = field(default_factory=dict)
    promised: CrossValidation | None = None
    steps: tuple[ReductionStep, ...] = ()
    per_gap: ActuatorModel | None = None


def _search(run: Run, loopset: LoopSet, gap_map: str, search: str) -> _Outcome:
    if search == "paper":
        end = search_paper(run, loopset, gap_map)
        fitted = tuple(
            end.model.predict(loop.input, loop.schedule, loop.time, loop.history).output
            for loop in loopset.loops
        )
        return _Outcome(
            end.found,
            end.model,
            fitted,
            end.why,
            end.interrupted,
            steps=end.steps,
            per_gap=end.per_gap,
        )
    interrupted = False
    try:
        choice = search_maps(run, loopset, gap_map)
    except KeyboardInterrupt:
        if run.best is None:
            raise
        best, interrupted = run.best.on(run.records), True  # the search may have thinned them
        choice = Choice(best, "the search was interrupted: this is the best so far")
    found = choice.found
    return _Outcome(
        found,
        model_of(found, loopset),
        _fitted(found, loopset),
        choice.why,
        interrupted,
        choice.dead_band,
        choice.left_out,
        choice.promised,
    )


def _fitted(found: Found, loopset: LoopSet) -> tuple[FloatArray, ...]:
    """Modelled outputs in the order of the loops of the set."""
    drives = found.space.records.drives
    ends = np.cumsum([drive.input.size for drive in drives])[:-1]
    offset = found.space.records.rest.output.offset
    outputs = np.split(Objective(found.space).outputs(found.sets) + offset, ends)
    ordered = [id(loop) for group in loopset.by_schedule().values() for loop in group]
    by_loop = dict(zip(ordered, outputs, strict=True))
    return tuple(by_loop[id(loop)] for loop in loopset.loops)


def _warnings(loopset: LoopSet, run: Run, why: str, quantities: int) -> list[str]:
    warnings = [note for note in loopset.notes if "columns not used" in note]
    warnings += [why] if run.records.gaps == 2 else []
    if run.resumed:
        warnings.append(f"went on from a checkpoint: {run.resumed} stages were done already")
    if loopset.schedule is not None and run.records.gaps == 1:
        warnings.append(
            f"loops at one {loopset.schedule.name} only: the model holds there and nowhere else"
        )
    if len(loopset) == 1:
        warnings.append(
            "one loop only: how inner loops run is a guess of the law; measure smaller loops too"
        )
    samples = sum(loop.n for loop in loopset.loops)
    if samples < FEWEST * quantities:
        warnings.append(
            f"{samples} samples for {quantities} quantities to find: that the model fits proves "
            "nothing; record more samples"
        )
    return warnings


def _name(loopset: LoopSet) -> str:
    """Name a model after its file, or after the folder that its files share."""
    paths = [Path(source.path) for source in loopset.sources]
    if len(paths) == 1:
        return paths[0].stem
    folders = {path.parent.name for path in paths}
    return folders.pop() or "actuator" if len(folders) == 1 else "actuator"


def _history(loopset: LoopSet) -> History:
    return Counter(loop.history for loop in loopset.loops).most_common(1)[0][0]
