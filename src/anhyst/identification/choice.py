"""Which law and gap map: those that a controller can use, and that predict what was left out."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache, partial

import numpy as np

from anhyst.data import Loops
from anhyst.data.estimates import noise
from anhyst.data.output_map import is_actuator
from anhyst.identification.bare import add_dead_band, model_of, valid_range, why_dead_band
from anhyst.identification.candidates import (
    Contest,
    Fits,
    ModelCandidate,
    cell_candidates,
    cell_map,
    map_candidates,
    polished,
    require_gaps,
    under,
    without_interaction,
)
from anhyst.identification.cell_kernel import CellKernel, by_weights
from anhyst.identification.cell_search import exact, polish, remapped, search_cells
from anhyst.identification.cross_validation import (
    LeftOut,
    block_places,
    folds,
    inner,
    inner_loops,
    noise_at,
    promise,
    refit,
)
from anhyst.identification.default import (
    SCREENED,
    TO_END,
    Evaluation,
    FoundModel,
    follow,
    join_circuit,
    join_gaps,
    reference_gap,
    search_each_gap,
    search_one_gap,
)
from anhyst.identification.objective import Objective
from anhyst.identification.response import Local
from anhyst.identification.run import Outcome, SearchRun
from anhyst.identification.screening import starts
from anhyst.identification.space import WRITTEN
from anhyst.identification.uncertainty import (
    ALIKE,
    FARTHEST,
    assess,
    bends,
    first_rise,
    is_guessed,
    left_open,
    only_demanded,
)
from anhyst.model.actuator import obstacle
from anhyst.model.left_over import EXACT
from anhyst.model.schema import CHOSEN, CandidateFit, CrossValidation
from anhyst.support.errors import NowhereNearError

FEWEST = 5
"""Samples for each quantity that is fitted, at least: with fewer a fit proves nothing."""

_NOTHING_MORE = 1.05
"""Deviation over the noise of the sensors below which there is nothing to gain."""

_COMPARABLE = 5.0
"""Cross-validation error over the least one's, up to which passing the acceptance test is worth it."""

CARRIED = 24
"""Sets of the screening that are tried at the other gaps beside the optimum of one gap."""


def outcome_of(fit: FoundModel, loopset: Loops, why: str, *, interrupted: bool = False) -> Outcome:
    """Return a fit as the outcome of a search, without the other candidates."""
    return Outcome(
        model_of(fit, loopset),
        assess(fit, loopset),
        fit.theta.size,
        fit.evaluations,
        why,
        interrupted,
        fit=fit,
    )


def search_models(run: SearchRun, loopset: Loops, gap_map: str) -> Outcome:
    """Fit under the wanted map and law, or under all, and keep what predicts best what is left out."""
    gaps = run.searched.gaps
    require_gaps(run.records, gap_map)
    tried = map_candidates(run, loopset, gap_map) if gaps > 1 else []
    run.total = 2 + len(tried) + bool(inner(gaps)) + run.dead_band
    run.total += 4 if run.cells else 0
    fits, known = _known(run)
    if gaps == 1:
        plain = ModelCandidate("none", run.held)
        contest = Contest([plain], {plain: fits}, {}, ())
    else:
        contest = _compared_maps(run, loopset, tried, known)
    best = _accepted(contest, loopset)
    why = _why(contest, best, gap_map, gaps)
    if unable := [candidate.gap_map for candidate in tried if candidate not in contest.entrants]:
        why += (
            "; passed over, because it cannot be compiled, fails the acceptance test, bends between "
            "the gaps or starts far from what was measured: "
            f"{', '.join(dict.fromkeys(WRITTEN.get(name, name) for name in unable))}"
        )
    candidates: tuple[CandidateFit, ...] = ()
    why_law, apart = "", 0.0
    alone = contest.fits[best].lean
    enough = _is_usable(alone, loopset) and not _leaves_something(alone, loopset)
    if run.cells and (run.only_cells or not enough):
        maps = contest.errors_of_maps(best)
        best = _compare_cells(run, loopset, contest, best, tried)
        candidates = _listed(run, contest, best)
        why_law = _why_law(run, contest, best)
        apart = _left_open(contest, best, loopset)
    else:
        maps = contest.errors_of_maps(best)
        run.total -= 4 if run.cells else 0
    fit, why, dead_band = _finished(run, loopset, contest.fits[best].lean, why)
    promised = run.timed("left out", partial(_promised, contest, loopset))
    return replace(
        outcome_of(fit, loopset, why),
        dead_band=dead_band,
        left_out={name: error for name, error in maps.items() if np.isfinite(error)},
        promised=promised,
        candidates=candidates,
        why_law=why_law,
        left_open=apart,
    )


def _left_open(contest: Contest, best: ModelCandidate, loopset: Loops) -> float:
    if len(loopset) > 1:
        return 0.0
    most = ALIKE**2 * contest.fits[best].lean.cost
    alike = [fits.lean for fits in contest.fits.values() if fits.lean.cost <= most]
    models = [model_of(fit, loopset) for fit in alike]
    return left_open(model_of(contest.fits[best].lean, loopset), models, loopset)


def _compared_maps(
    run: SearchRun, loopset: Loops, tried: list[ModelCandidate], known: list[Local]
) -> Contest:
    """Fit every gap map, to all gaps and without some."""
    fits: dict[ModelCandidate, Fits] = {}
    plain = None
    for candidate in tried:
        try:
            fits[candidate] = _joined(run, candidate, known, plain)
            if candidate.gap_map == "reluctance":
                plain = fits[candidate].wide
        except NowhereNearError:
            run.total -= 1
            if candidate is tried[-1] and not fits:
                raise
    usable = [fit for fit in fits if _is_usable(fits[fit].lean, loopset)]
    contest = Contest(usable or list(fits), fits, {}, inner(run.searched.gaps))
    if contest.left_out:
        run.step("left out", partial(_leave_out, contest, loopset, contest.entrants))
    return contest


def _compare_cells(
    run: SearchRun,
    loopset: Loops,
    contest: Contest,
    base: ModelCandidate,
    maps: Sequence[ModelCandidate],
) -> ModelCandidate:
    """Fit play cells under the most flexible map, the best of them under the others, and choose.

    With fewer than three gaps the inner loops are left out, where there are two or more, else
    blocks of samples.
    """
    by: LeftOut = "gap"
    if not contest.left_out:
        by, indices = "loop", inner_loops(run.searched)
        if len(indices) < 2:
            by, indices = "block", block_places(run.searched)
        contest.left_out = indices
        contest.by = by
        contest.entrants[:] = [base]
        run.timed("left out", partial(_leave_out, contest, loopset, [base]))
    new = cell_candidates(cell_map(base, maps), run.cells)
    leaves = partial(_leaves_something, loopset=loopset)
    may_be_chosen = partial(_is_usable, loopset=loopset)
    wide = contest.fits[base].wide
    simpler = (
        [without_interaction(candidate) for candidate in new] if _may_do_without(run, base) else []
    )

    def search() -> dict[ModelCandidate, Fits]:
        fit: dict[ModelCandidate, Fits] = {}
        for some in filter(None, (simpler, new)):
            if all(leaves(fits.lean) for fits in fit.values()):
                fit |= search_cells(wide, run.searched, some, run.seed, leaves, may_be_chosen)
        return fit

    contest.fits.update(run.step("play cells", search))
    new = [candidate for candidate in (*simpler, *new) if candidate in contest.fits]
    run.step("left out", partial(_leave_out, contest, loopset, new))
    best = replace(contest, entrants=new).winner()
    others = [under(best, other) for other in maps if best.gap_map != other.gap_map != "free"]
    for candidate in others:
        again = partial(remapped, contest.fits[best].wide, candidate, run.searched)
        contest.fits[candidate] = run.timed("play cells", again)
    run.timed("left out", partial(_leave_out, contest, loopset, others))
    new += others
    if contest.left_out and base.gap_map != "free" and _bears_weights(contest.fits[best].lean):
        best = min(new, key=lambda candidate: contest.error(candidate) or 0.0)
        further = polished(best)
        fit = run.step("play cells", partial(polish, contest.fits[best].lean, run.searched))
        contest.fits[further] = Fits(fit, fit)
        run.step("left out", partial(_leave_out, contest, loopset, [further]))
        new.append(further)
    else:
        run.total -= 2
    every = new if run.only_cells else [*contest.entrants, *new]
    usable = [entrant for entrant in every if _is_usable(contest.fits[entrant].lean, loopset)]
    contest.entrants[:] = usable or every
    return _accepted(contest, loopset)


def _may_do_without(run: SearchRun, base: ModelCandidate) -> bool:
    """Whether cells are tried without interaction: one loop hardly tells it from pinning, or a gap."""
    alone = len(run.searched.loops) == 1 and base.gap_map == "none"
    return alone and run.form.power == 1 and "omega" not in base.held


def _bears_weights(fit: FoundModel) -> bool:
    """Whether there are samples enough to fit every weight of the cells by itself."""
    kernel = fit.space.form.cells
    assert isinstance(kernel, CellKernel)
    weights = by_weights(kernel, fit.sets[0].law).populations.weights.size
    samples = sum(record.input.size for record in fit.space.records.loops)
    return samples >= FEWEST * (fit.theta.size + weights)


def _promised(contest: Contest, loopset: Loops) -> CrossValidation | None:
    """Say what the choice misses where it has seen nothing; inner loops left out promise nothing."""
    if contest.by == "loop" or not contest.left_out:
        return None
    if len(contest.entrants) > 1:
        _leave_out(contest, loopset, contest.near(), together=2)
    if contest.by == "block":
        each = float(np.mean(noise_at(loopset)))
        return promise(contest.nested(), [each] * len(contest.left_out), "block")
    return promise(contest.nested(), noise_at(loopset)[1:-1])


def _leave_out(
    contest: Contest, loopset: Loops, some: Sequence[ModelCandidate], together: int = 1
) -> None:
    """Fit some without each place, or without each pair."""
    for fold in folds(contest.left_out, together):
        known = contest.refits.setdefault(fold, {})
        for entrant in some:
            fits = contest.fits[entrant]
            known[entrant] = refit(
                fits.lean if entrant.cells else fits.wide, loopset, fold, contest.by
            )


def _leaves_something(fit: FoundModel, loopset: Loops) -> bool:
    """Whether a fit leaves more than the noise of the sensors, so that another law could gain.

    However smooth noise may be (:mod:`anhyst.model.left_over`), trying costs little: only white noise ends it.
    """
    deviation = Evaluation(Objective(fit.space)).at(fit.theta).deviation
    ordered = [loop for group in loopset.by_schedule().values() for loop in group]
    noises = [
        record.weight**2 * record.input.size * noise(loop.output) ** 2
        for record, loop in zip(fit.space.records.loops, ordered, strict=True)
    ]
    return float(deviation @ deviation) > max(_NOTHING_MORE**2 * sum(noises), EXACT**2)


def _is_usable(fit: FoundModel, loopset: Loops) -> bool:
    """Whether what is to be compensated can be compiled, and starts near what was measured."""
    if not is_actuator(loopset):
        return True
    model = model_of(fit, loopset)
    if obstacle(model) is not None:
        return False
    return not is_guessed(loopset) or first_rise(model, loopset) <= FARTHEST


def _listed(run: SearchRun, contest: Contest, best: ModelCandidate) -> tuple[CandidateFit, ...]:
    """Put all candidates side by side, the simplest first."""
    return tuple(
        CandidateFit(
            law=candidate.title(run.form.law),
            gap_map=WRITTEN.get(candidate.gap_map, candidate.gap_map),
            numbers=fits.lean.theta.size,
            rms=float(np.sqrt(fits.lean.cost)),
            left_out=contest.finite_error(candidate) if candidate in contest.entrants else None,
            note=CHOSEN
            if candidate == best
            else ""
            if candidate in contest.entrants
            else "passed over",
        )
        for candidate, fits in sorted(contest.fits.items(), key=lambda item: item[0].rank)
    )


def _why_law(run: SearchRun, contest: Contest, best: ModelCandidate) -> str:
    name = best.title(run.form.law)
    errors = {model: contest.finite_error(model) for model in contest.entrants if model != best}
    own = contest.finite_error(best)
    if own is None:
        return f"law {name}: none has an answer to all that was left out, so the simplest"
    text = f"law {name} misses {100.0 * own:.2g} % of the largest output on what was left out"
    others = {candidate: error for candidate, error in errors.items() if error is not None}
    if not others:
        return text
    least = min(others, key=lambda candidate: others[candidate])
    text += f", {least.title(run.form.law)} {100.0 * others[least]:.2g} %"
    if others[least] < own:
        text += ": not less by more than its scatter, and less simple"
    return text


def _accepted(contest: Contest, loopset: Loops) -> ModelCandidate:
    """Choose; what fails the acceptance test drops out as long as anything comparable is there."""
    every = list(contest.entrants)
    worst = _COMPARABLE * min(contest.error(candidate) or 0.0 for candidate in every)
    while contest.entrants:
        best = contest.winner()
        able = _passes(contest.fits[best].lean, loopset)
        if len(every) == 1 or (able and not _bends(contest, best, loopset)):
            if (contest.error(best) or 0.0) <= worst:
                return best
            break
        contest.entrants.remove(best)
    contest.entrants.clear()
    contest.entrants.extend(every)
    return contest.winner()


def _bends(contest: Contest, candidate: ModelCandidate, loopset: Loops) -> bool:
    """Whether a gap map bends between the gaps, where the same law under simpler maps does not."""
    error = contest.finite_error(candidate)
    if contest.by != "gap" or not error or loopset.schedule is None:
        return False
    simpler = [
        (model_of(contest.fits[other].lean, loopset), missed)
        for other in contest.fits
        if other.gap_map != candidate.gap_map and other.cells == candidate.cells and other.rank < candidate.rank
        and contest.is_tried(other)
        and (missed := contest.finite_error(other)) is not None
    ]  # fmt: skip
    return bends(model_of(contest.fits[candidate].lean, loopset), error, simpler, loopset)


@lru_cache(maxsize=2)  # of one fit it is asked again and again
def _passes(fit: FoundModel, loopset: Loops) -> bool:
    model = replace(model_of(fit, loopset), valid=valid_range(loopset))
    return model.acceptance().passed is not False


def _finished(
    run: SearchRun, loopset: Loops, fit: FoundModel, why: str
) -> tuple[FoundModel, str, str]:
    """Add the dead band and run the fit to convergence on every sample."""
    dead_band = "none: it was not wanted"
    if fit.space.form.cells is not None:
        dead_band = "none: play cells need none"
    elif run.dead_band:
        fit, dead_band = _with_dead_band(run, loopset, fit)
    start = exact(fit)
    last = partial(follow, start.on(run.records).space, start.theta, *TO_END, start.tie)
    end = run.step("last steps", last)
    # The last steps gain little, and may not lead to where nothing would have been chosen.
    left = _is_usable(start, loopset) and not _is_usable(end, loopset)
    return start.on(run.records) if left else end, why, dead_band


def _with_dead_band(run: SearchRun, loopset: Loops, fit: FoundModel) -> tuple[FoundModel, str]:
    def usable(fit: FoundModel) -> bool:
        return obstacle(model_of(fit, loopset)) is None and _passes(fit, loopset)

    def work() -> FoundModel:
        matters = usable(fit)
        return add_dead_band(fit, lambda candidate: not matters or usable(candidate))

    after = run.step("dead band", work)
    return after, why_dead_band(fit, after)


def _known(run: SearchRun) -> tuple[Fits, list[Local]]:
    """Fit the gap that shows most; give sets there: its optimum, then others worth a try."""
    home = run.searched.at(reference_gap(run.searched))
    fits = run.step(
        "one gap", lambda: _pair(search_one_gap(run.form, home, run.seed, run.held), home.gaps == 1)
    )
    if run.searched.gaps == 1:
        run.best = fits.lean
        return fits, fits.lean.sets
    return fits, [*fits.wide.sets, *starts(fits.wide.space, SCREENED, CARRIED, run.seed)]


def _pair(wide: FoundModel, decide: bool = True) -> Fits:
    return Fits(wide, only_demanded(wide) if decide else wide)


def _joined(
    run: SearchRun, candidate: ModelCandidate, known: list[Local], plain: FoundModel | None
) -> Fits:
    def search() -> FoundModel:
        if candidate.gap_map == "free":
            return search_each_gap(run.form, run.searched, run.seed, candidate.held)
        if candidate.gap_map in {"leakage", "circuit"}:
            series = plain or join_gaps(run.form, run.searched, "reluctance", known, candidate.held)
            return join_circuit(series, candidate.gap_map, candidate.common)
        return join_gaps(run.form, run.searched, candidate.gap_map, known, candidate.held)

    fits = run.step("gap maps", lambda: _pair(search()))
    if run.best is None or (candidate.rank == 0 and fits.lean.cost < run.best.cost):
        run.best = fits.lean
    return fits


def _why(contest: Contest, best: ModelCandidate, gap_map: str, gaps: int) -> str:
    if gaps == 1:
        return "there is one gap only, so nothing runs over it"
    errors = contest.errors_of_maps(best)
    if gap_map != "auto":
        why = f"gap map '{gap_map}' was asked for"
        if not errors:
            why += (
                "; with two gaps none can be left out to test it, so between and beyond them it is "
                "a guess"
            )
        return why
    if not errors:
        return (
            f"with two gaps none can be left out to compare maps; '{best.gap_map}' fits the loops "
            "best, but between and beyond the two gaps that proves nothing"
        )
    name = WRITTEN.get(best.gap_map, best.gap_map)
    own = errors.pop(name)
    others = ", ".join(
        f"{other} {100 * error:.2g} %"
        if np.isfinite(error)
        else f"{other} cannot be computed there"
        for other, error in errors.items()
    )
    why = (
        f"gap map '{name}' predicts gaps left out of the fit best: mean deviation "
        f"{100 * own:.2g} % of the largest output"
    )
    why += f" ({others})" if others else ""
    if any(error < own for error in errors.values()):
        why += "; what deviates less does not by more than its scatter, and is less simple"
    return why
