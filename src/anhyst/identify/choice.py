"""Which gap map: the one that predicts gaps it has not seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from anhyst.data import LoopSet
from anhyst.errors import InputError, NegativeResult
from anhyst.identify.default import (
    SCREENED,
    TIE,
    TIED,
    Found,
    follow,
    join_circuit,
    join_gaps,
    reference_gap,
    search_each_gap,
    search_one_gap,
)
from anhyst.identify.drives import Records
from anhyst.identify.gauge import physical
from anhyst.identify.response import Local
from anhyst.identify.run import SEARCHED, Run
from anhyst.identify.screening import starts
from anhyst.identify.space import Space
from anhyst.model import ActuatorModel

Floats = NDArray[np.float64]

_AS_GOOD = 1.02
"""A left-out error within this factor of the least counts as equal to it."""

CARRIED = 24
"""Sets of the screening that are tried at the other gaps beside the optimum of one gap."""


def model_of(found: Found, loopset: LoopSet) -> ActuatorModel:
    """Bare model of a fit: parameters and gap map, no records.

    Parameters
    ----------
    found : Found
        The fit.
    loopset : LoopSet
        For the quantities.

    Returns
    -------
    ActuatorModel
    """
    space = found.space
    nodes = tuple(float(node) for node in space.records.nodes)
    single = len(nodes) < 2
    gaps = nodes if loopset.schedule is not None and loopset.schedule.name == "gap" else ()
    return ActuatorModel(
        name="model",
        input=loopset.input,
        output=loopset.output,
        parameters=physical(found.sets, space.gap_map, loopset.input, loopset.output, gaps),
        law=space.form.law,  # type: ignore[arg-type]
        gap_map="none" if single else space.gap_map,  # type: ignore[arg-type]
        schedule=loopset.schedule,
        nodes=nodes,
    )


def _without(found: Found, gap: int) -> tuple[Space, Floats]:
    """Space of the other gaps, and the coordinates of the fit there."""
    space = found.space
    keep = [place for place in range(space.records.gaps) if place != gap]
    renumbered = {old: new for new, old in enumerate(keep)}
    drives = tuple(
        replace(drive, gap=renumbered[drive.gap])
        for drive in space.records.drives
        if drive.gap != gap
    )
    records = Records(
        drives, space.records.nodes[keep], space.records.input_span, space.records.output_span
    )
    left = [place for place, (_, at) in enumerate(space.entries) if at != gap]
    return Space(space.gap_map, records, space.form, space.held), found.theta[left]


def left_out_error(found: Found, loopset: LoopSet, gap: int) -> float:
    """Mean absolute deviation at one gap, predicted from the others.

    Parameters
    ----------
    found : Found
        Fit to all gaps; the fit to the others starts from it.
    loopset : LoopSet
        All loops.
    gap : int
        Place of the gap that is left out.

    Returns
    -------
    float
        Relative to the largest output of all loops; infinite where the model cannot be computed.
    """
    space, theta = _without(found, gap)
    try:
        tie = TIE * found.cost if space.gap_map in TIED else 0.0
        model = model_of(follow(space, theta, 1e-6, 40, tie), loopset)
        deviations = [
            model.predict(loop.input, loop.schedule, loop.time, loop.history).output - loop.output
            for loop in loopset.by_schedule()[float(found.space.records.nodes[gap])]
        ]
    except (InputError, NegativeResult):
        return float("inf")
    mean = float(np.mean(np.abs(np.concatenate(deviations))))
    return mean / found.space.records.output_span


def _maps_to_try(run: Run, loopset: LoopSet) -> tuple[str, ...]:
    """Name the maps that `auto` compares, the simplest first.

    A reluctance in series is physics of a gap only, and does not go with the law of 1986.
    """
    gaps = run.searched.gaps
    if gaps < 2:
        return ("none",)
    is_gap = loopset.schedule is not None and loopset.schedule.name == "gap"
    in_series = is_gap and run.form.law == "effective-field"
    maps = ("scaling", "reluctance") if in_series else ("scaling",)
    return (*maps, "free") if gaps >= 3 else maps


def require_gaps(records: Records, wanted: str) -> None:
    """Refuse a gap map where there is nothing to see of it.

    Raises
    ------
    InputError
        A gap map is wanted and there is one gap only.
    """
    if wanted != "auto" and records.gaps < 2:
        raise InputError(
            f"gap map '{wanted}' needs loops at two gaps or more, there are loops at one; measure "
            "another gap, or use --gap-map auto for a model of this gap alone"
        )


def search_maps(run: Run, loopset: LoopSet, wanted: str) -> tuple[Found, dict[str, float], str]:
    """Fit under the wanted map, or under all and keep the one that predicts left-out gaps best.

    Parameters
    ----------
    run : Run
        Settings and stages.
    loopset : LoopSet
        All loops.
    wanted : str
        A gap map, or ``auto``.

    Returns
    -------
    found : Found
        The fit chosen.
    left_out : dict of str to float
        Left-out error of each map tried, relative to the largest output; empty below three gaps,
        and without those maps that cannot be computed at a gap left out.
    why : str
        The reason, as a sentence.

    Raises
    ------
    InputError
        A gap map is wanted and there is one gap only.
    """
    records = run.searched
    require_gaps(records, wanted)
    tried = _maps_to_try(run, loopset) if wanted == "auto" else (wanted,)
    interior = range(1, records.gaps - 1)
    joined = sum(len(_variants(run, name)) * (1 + len(interior)) for name in tried)
    run.total = 1 + (joined if records.gaps > 1 else 0) + _is_thinned(run)
    known = _known(run)
    if run.best is not None:
        return _finished(run, run.best), {}, "there is one gap only, so nothing runs over it"
    fits, errors = {}, {}
    for gap_map in tried:
        found = [_joined(run, gap_map, known, held) for held in _variants(run, gap_map)]
        missed = [_left_out(run, one, loopset) for one in found]
        best = int(np.argmin(missed if interior else [one.cost for one in found]))
        fits[gap_map] = found[best]
        if interior:
            errors[gap_map] = missed[best]
    chosen, why = _choose(fits, errors, wanted)
    told = {name: error for name, error in errors.items() if np.isfinite(error)}
    return _finished(run, chosen), told, why


def _is_thinned(run: Run) -> bool:
    return any(drive.input.size > SEARCHED for drive in run.records.drives)


def _finished(run: Run, found: Found) -> Found:
    """Follow the fit to its end on every sample, where the search took fewer."""
    if not _is_thinned(run):
        return found
    space = found.on(run.records).space
    tie = TIE * found.cost if space.gap_map in TIED else 0.0
    plain = run.stage(
        f"{space.gap_map} holding {sorted(space.held)} on all samples",
        lambda: follow(space, found.theta, 1e-8, 50, tie).plain,
    )
    return Found.from_plain(space, plain)


def _known(run: Run) -> list[Local]:
    """Give sets at the gap that shows most: its optimum first, then others worth a try."""
    home = run.searched.at(reference_gap(run.searched))
    space = Space("none", home, run.form, run.held)
    plain = run.stage("one gap", lambda: search_one_gap(run.form, home, run.seed, run.held).plain)
    found = Found.from_plain(space, plain)
    if run.searched.gaps == 1:
        run.best = found
        return found.sets
    return [*found.sets, *starts(space, SCREENED, CARRIED, run.seed)]


def _variants(run: Run, gap_map: str) -> tuple[frozenset[str], ...]:
    """Name what to hold at zero: each set is worth a fit of its own.

    With everything free at each gap, interaction and shape of the anhysteretic replace each other
    almost without trace, and what is interpolated of them need not fit together. Without
    interaction the fit is a little worse and may predict much better.
    """
    both = gap_map == "free" and run.searched.gaps >= 3
    return (run.held, run.held | {"omega"}) if both else (run.held,)


def _left_out(run: Run, found: Found, loopset: LoopSet) -> float:
    parts = [
        run.stage(
            f"{found.space.gap_map} holding {sorted(found.space.held)} without {gap}",
            lambda g=gap: left_out_error(found, loopset, g),  # type: ignore[misc]
        )
        for gap in range(1, run.searched.gaps - 1)
    ]
    return float(np.mean(parts)) if parts else float("nan")


def _joined(run: Run, gap_map: str, known: list[Local], held: frozenset[str]) -> Found:
    space = Space(gap_map, run.searched, run.form, held)

    def search() -> dict[str, object]:
        if gap_map == "free":
            return search_each_gap(run.form, run.searched, run.seed, held).plain
        if gap_map == "circuit":
            return join_circuit(run.form, run.searched, known, held).plain
        return join_gaps(run.form, run.searched, gap_map, known, held).plain

    plain = run.stage(f"joined by {gap_map} holding {sorted(held)}", search)
    found = Found.from_plain(space, plain)
    if run.best is None or found.cost < run.best.cost:
        run.best = found
    return found


def _choose(fits: dict[str, Found], errors: dict[str, float], wanted: str) -> tuple[Found, str]:
    if wanted != "auto":
        why = f"gap map '{wanted}' was asked for"
        if not errors:
            why += (
                "; with two gaps none can be left out to test it, so between and beyond them it is "
                "a guess"
            )
        return fits[wanted], why
    if errors:
        # Of maps that are as good as each other, the simplest.
        enough = _AS_GOOD * min(errors.values())
        best = next(name for name, error in errors.items() if error <= enough)
        others = ", ".join(
            f"{n} {100 * e:.2g} %" if np.isfinite(e) else f"{n} cannot be computed there"
            for n, e in errors.items()
            if n != best
        )
        why = (
            f"gap map '{best}' predicts gaps left out of the fit best: mean deviation "
            f"{100 * errors[best]:.2g} % of the largest output ({others})"
        )
        return fits[best], why
    best = min(fits, key=lambda name: fits[name].cost)
    why = (
        f"with two gaps none can be left out to compare maps; '{best}' fits the loops best, but "
        "between and beyond the two gaps that proves nothing"
    )
    return fits[best], why
