"""The whole way from loops to a model: checks, search, figures, provenance."""

from __future__ import annotations

import os
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from anhyst.data import Loops
from anhyst.data.lag import lag_line
from anhyst.data.output_map import is_actuator, output_map
from anhyst.data.path import SETTLED
from anhyst.data.plausibility import check_plausible
from anhyst.data.resonance import resonance_line
from anhyst.data.speeds import Speeds, speeds_of, with_spread_times
from anhyst.identification.any_law import fit_any
from anhyst.identification.bare import form_of, model_of, valid_range
from anhyst.identification.candidates import require_gaps
from anhyst.identification.cell_kernel import LAW_OF
from anhyst.identification.cell_problem import LAW as CREEPING_LAW
from anhyst.identification.choice import FEWEST, outcome_of, search_models
from anhyst.identification.creeping import fit_creeping
from anhyst.identification.default import TO_END, follow
from anhyst.identification.fit_records import records_of, rest_of
from anhyst.identification.paper_search import check_splines
from anhyst.identification.paper_sequence import search_paper
from anhyst.identification.rate import fit_rate, without_rate
from anhyst.identification.run import SEARCHED, IdentifyResult, Outcome, SearchRun
from anhyst.identification.space import IN_SERIES
from anhyst.identification.uncertainty import assess, begins_near, resolved
from anhyst.laws import DEFAULT_LAW, LAWS
from anhyst.laws.cells import Shape
from anhyst.model.actuator import obstacle
from anhyst.model.left_over import explain_rejection, left_of, left_over_text
from anhyst.model.parameters import GAP_MAPS
from anhyst.model.schema import Provenance, fit_figures
from anhyst.support import running_version
from anhyst.support.errors import InputError
from anhyst.support.jobs import Progress
from anhyst.support.wording import worded

SEARCHES = ("default", "paper")

AUTO = "auto"  # of laws and gap maps: which one, is found out


def identify(
    loops: Loops,
    *,
    law: str = AUTO,
    gap_map: str = "auto",
    search: str = "default",
    seed: int = 1,
    weights: str = "loops",
    offsets: bool = True,
    dead_band: bool = True,
    rate: bool = True,
    progress: Progress | None = None,
    checkpoint: str | os.PathLike[str] | None = None,
) -> IdentifyResult:
    """Find the model of loops at constant scheduling values: `anhyst.identify`.

    After ctrl-C the best so far, marked as interrupted.
    """
    began, worked = time.perf_counter(), time.process_time()
    spent: dict[str, float] = {}
    check_wanted(law, gap_map, search)
    odd = check_plausible(loops)

    def static(some: Loops, before: Outcome | None) -> Outcome:
        """Find the model of loops at one speed; from an outcome on it is the same choice."""
        own, cells = _compared(some, law, search)
        if _creeps(some, law, search):
            return fit_creeping(some)
        if LAWS[own].kernel is None:
            records = records_of(some, weights)
            require_gaps(records, gap_map)
            return fit_any(some, records.thinned(SEARCHED), own, gap_map, seed, offsets=offsets)
        rest = rest_of(some) if offsets and search == "default" else None
        run = SearchRun(
            form=form_of(some.input, some.output, own),
            cells=cells,
            only_cells=law != AUTO,
            records=records_of(some, weights, rest),
            seed=seed,
            held=frozenset() if offsets else frozenset({"in_0", "out_0"}),
            dead_band=dead_band and search == "default",
            progress=progress,
            spent=spent,
            checkpoint=Path(checkpoint) if checkpoint and search == "paper" else None,
        )
        outcome = _go_on(run, some, before) if before else _search(run, some, gap_map, search)
        freed = resolved(outcome.model, some)
        return replace(outcome, model=freed) if begins_near(freed, some) else outcome

    able = rate and search == "default" and not _creeps(loops, law, search)
    loops = with_spread_times(loops) if able else loops
    outcome = _at_all_speeds(loops, static, speeds_of(loops) if able else None)
    lag = lag_line(loops)
    warnings = [*odd, *([lag] if lag else []), *_warnings(loops, outcome)]
    settings: dict[str, str | bool | int | float] = {
        "search": search,
        "weights": weights,
        "offsets": offsets,
        "law_wanted": law,
        **({"law_reason": outcome.why_law} if outcome.why_law else {}),
        "gap_map_wanted": gap_map,
        "gap_map_reason": outcome.why,
        "dead_band": outcome.dead_band,
        **({"rate": outcome.why_rate} if outcome.why_rate else {}),
    }
    seen = (SETTLED if loop.history.kind == "settled" else loop.history for loop in loops.loops)
    common = {
        "name": _name(loops),
        "history": Counter(seen).most_common(1)[0][0],
        "valid": valid_range(loops),
        "provenance": Provenance(running_version(), seed, loops.sources, settings),
    }
    model = replace(outcome.model, **common, reduction=outcome.steps)  # type: ignore[arg-type]
    per_gap = outcome.per_gap and replace(outcome.per_gap, **common)  # type: ignore[arg-type]
    acceptance = model.acceptance()
    fitted = tuple(map(model.on, loops.loops))
    figures = fit_figures(
        loops, fitted, outcome.left_out, acceptance.passed, outcome.promised, outcome.candidates
    )
    left = left_of(loops, fitted)
    line = left_over_text(left, loops, model)
    figures = replace(figures, not_noise=left.unexplained, left_over=line)
    model = replace(model, fit=figures, uncertainty=outcome.uncertainty)
    warnings += [reason] if (reason := obstacle(model.at_rest)) is not None else []
    spent["all else"] = time.process_time() - worked - sum(spent.values())
    return IdentifyResult(
        model=model,
        loops=loops,
        fitted=fitted,
        acceptance=acceptance,
        warnings=tuple(map(worded, warnings)),
        per_gap=per_gap,
        splines=None if per_gap is None else check_splines(per_gap),
        seconds=time.perf_counter() - began,
        stages=spent,
        evaluations=outcome.evaluations,
        interrupted=outcome.interrupted,
        rejection=resonance_line(loops) or explain_rejection(left, loops),
    )


def check_wanted(law: str, gap_map: str, search: str) -> None:
    """Refuse what is unknown or does not go together."""
    if why := LAWS.why_unusable(law):
        raise InputError(f"law '{law}': {why}", code="not-installed", key="law")
    for what, value, known in (
        ("law", law, (*LAWS, AUTO)),
        ("gap map", gap_map, (*GAP_MAPS[1:], "auto")),
        ("search", search, SEARCHES),
    ):
        if value not in known:
            raise InputError(
                f"{what} '{value}' is unknown; use one of {', '.join(known)}",
                code="unknown-choice",
                key=what,
            )
    kernel = LAWS[DEFAULT_LAW if law == AUTO else law].kernel
    if kernel is not None and kernel.coupled and gap_map in IN_SERIES:
        # There alpha acts on the irreversible part alone, which a reluctance does not: one number
        # would be fitted for two.
        raise InputError(
            f"gap map '{gap_map}' does not go with the law {law}; use --law {DEFAULT_LAW}, or "
            "--gap-map scaling",
            code="choices-together",
            key="gap_map",
        )
    if kernel is None and search == "paper":
        raise InputError(
            f"search 'paper' needs a law of the core, {law} is none; use default",
            code="choices-together",
            key="search",
        )
    if search == "paper" and gap_map == "circuit":
        raise InputError(
            "gap map 'circuit' is none of the paper's; use --search default, or --gap-map auto",
            code="choices-together",
            key="gap_map",
        )


def _compared(loops: Loops, law: str, search: str) -> tuple[str, tuple[Shape, ...]]:
    """Name the law of the search, and the play cells that are fitted from it."""
    shapes = {name: shape for shape, name in LAW_OF.items()}
    if law in shapes:
        return DEFAULT_LAW, (shapes[law],)
    if law != AUTO:
        return law, ()
    # What makes a force is to be compensated, so a law that cannot be compiled is not even tried.
    able = (name for name in shapes if not is_actuator(loops) or LAWS[name].least_slope)
    return DEFAULT_LAW, tuple(shapes[name] for name in able) if search == "default" else ()


def _at_all_speeds(
    loops: Loops, static: Callable[[Loops, Outcome | None], Outcome], speeds: Speeds | None
) -> Outcome:
    """Find the model at rest, and around it how late the iron answers."""
    if speeds is None:
        return static(loops, None)
    outcome = static(speeds.slow, None)
    if outcome.interrupted:
        return outcome
    late = fit_rate(outcome.model, loops, speeds)
    if not late.model.has_eddy_currents:
        return replace(static(loops, None), why_rate=late.why)
    at_rest = without_rate(late.model, outcome.model, speeds.slow)
    if at_rest is not None:
        again = static(at_rest, outcome)
        layers = late.model.layers
        better = fit_rate(again.model, loops, speeds, at_least=layers.count if layers else 1)
        if better.missed < late.missed:
            late = better
            outcome = replace(outcome, uncertainty=again.uncertainty)
    sure = late.among(outcome.uncertainty)
    return replace(outcome, model=late.model, uncertainty=sure, why_rate=late.why)


def _creeps(loops: Loops, law: str, search: str) -> bool:
    """Whether cells are fitted with lag and creep, in one step."""
    able = output_map(loops.output).creeps and loops.schedule is None
    return able and law in {AUTO, CREEPING_LAW} and search == "default"


def _search(run: SearchRun, loops: Loops, gap_map: str, search: str) -> Outcome:
    if search == "paper":
        outcome = search_paper(run, loops, gap_map)
        if not outcome.interrupted:
            run.finish()
        return outcome
    try:
        return search_models(run, loops, gap_map)
    except KeyboardInterrupt:
        if run.best is None:
            raise
    best = run.best.on(run.records)  # the search may have thinned them
    why = "the search was interrupted: this is the best so far"
    return outcome_of(best, loops, why, interrupted=True)


def _go_on(run: SearchRun, loops: Loops, before: Outcome) -> Outcome:
    """Follow the fit of a search to its end on other records of the same loops."""
    start = before.fit
    assert start is not None
    followed = follow(start.on(run.records).space, start.theta, *TO_END, start.tie)
    return replace(
        before, model=model_of(followed, loops), uncertainty=assess(followed, loops), fit=followed
    )


def _warnings(loops: Loops, outcome: Outcome) -> list[str]:
    gaps, quantities = len(loops.schedule_values), outcome.quantities
    warnings = [note for note in loops.notes if "columns not used" in note]
    warnings += [outcome.why] if gaps == 2 else []
    if outcome.resumed:
        warnings.append(f"went on from a checkpoint: {outcome.resumed} stages were done already")
    if loops.schedule is not None and gaps == 1:
        warnings.append(
            f"loops at one {loops.schedule.name} only: the model holds there and nowhere else"
        )
    if len(loops) == 1:
        size = f"{100.0 * outcome.left_open:.2g} % of the largest output"
        alike = f"laws that follow it alike differ by {size} within it, and "
        guess = "how inner loops run is a guess of the law; measure smaller loops too"
        warnings.append("one loop only: " + (alike if outcome.left_open else "") + guess)
    samples = sum(loop.n for loop in loops.loops)
    if samples < FEWEST * quantities:
        warnings.append(
            f"{samples} samples for {quantities} quantities to find: that the model fits proves "
            "nothing; record more samples"
        )
    return warnings


def _name(loops: Loops) -> str:
    """Name a model after its file, or after the folder that its files share."""
    paths = [Path(source.path) for source in loops.sources]
    if len(paths) == 1:
        return paths[0].stem
    folders = {path.parent.name for path in paths}
    return folders.pop() or "actuator" if len(folders) == 1 else "actuator"
