"""The search for play cells: from the fit of a law of Jiles and Atherton, population by population.

What a law of Jiles and Atherton says of circuit, offsets, shape and pinning is near enough to begin
with. A further population begins as a part of those there are, in a few ways that differ: wider and
as strongly pinned (a slow approach to saturation), wider and pinned otherwise, narrower.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace

from anhyst.identification.candidates import ModelCandidate
from anhyst.identification.cell_kernel import LAW_OF, CellKernel, by_weights
from anhyst.identification.contest import Fits
from anhyst.identification.default import TIE, TIED, FoundModel, follow
from anhyst.identification.fit_records import FitRecords
from anhyst.identification.offsets import only_demanded
from anhyst.identification.response import Local, ResponseForm
from anhyst.identification.space import CoordinateSpace

COARSE, FINE = 40, 100
"""Samples of a loop on which ways to begin are tried, and on which the fit runs, at most."""

_SHORT, _LONG, _POLISHED = 6, 100, 8
_ROUGH, _CLOSE = 1e-3, 1e-5

_PINNINGS = (1.0, 0.4)
"""Thresholds over the pinning ``k`` of a law of Jiles and Atherton."""

_STUCK = 10.0
"""Pinning over width of the curve beyond which a law of Jiles and Atherton hardly moves at all: that
its loops are narrow, and nothing of thresholds."""

_NARROW = (0.25, 8.0, 0.1, 2.0)
"""Share and width of the reversible part, pinning and spread of cells with narrow loops."""

_LANGEVIN = {"langevin": 1.0, "tanh": 3.0}
"""Width of each curve that has the slope of Langevin's of width 1 at its middle."""

_GAIN = 0.98
"""Cost, in parts of that with a population less, from which on a further one says nothing."""

SLOPES = {"tanh": 1.0, "langevin": 1.0 / 3.0}
"""Slope of each curve at its middle."""

_PER_POPULATION = 4
"""Numbers of a set for each: share, width, pinning, spread; those of the first begin with the share
and the width of the reversible part, since its own are the units."""

_LOWER = 0.95
"""Cost, in parts of that before, from which on an exchanged population is taken."""

_BEFORE_JUMPS = 0.8
"""Interaction to begin with, in parts of that at which the magnetisation would jump."""

_FURTHER = (
    (0.5, 8.0, 1.0),
    (0.6, 1.6, 2.0),
    (0.5, 2.0, 0.5),
    (1.0, 0.5, 1.0),
    (0.3, 1.0, 0.15),
    (0.3, 0.5, 3.0),
)
"""Share, width and pinning of a further population, in parts of those of the first."""


def search_cells(
    base: FoundModel,
    records: FitRecords,
    wanted: Sequence[ModelCandidate],
    leaves_something: Callable[[FoundModel], bool],
) -> dict[ModelCandidate, Fits]:
    """Fit play cells of one curve, until a population more gains next to nothing.

    Parameters
    ----------
    base : FoundModel
        Fit of a law of Jiles and Atherton, with its offsets free.
    records : FitRecords
        What is fitted.
    wanted : sequence of ModelCandidate
        By populations, ascending.
    leaves_something : callable
        Whether a fit leaves more than noise.
    """
    fits: dict[ModelCandidate, Fits] = {}
    wide = base
    for one in wanted:
        assert one.cells is not None
        form = replace(base.space.form, law=LAW_OF[one.cells.shape], cells=one.cells, dead_band=0.0)
        if wide is base:
            found = first_population(base, form, records)
        else:
            found = one_more(wide, form, records)
            if leaves_something(found):
                found = exchanged(found, form, records)
        if fits and found.cost > _GAIN * wide.cost:
            break
        wide = found
        fits[one] = Fits(wide, only_demanded(wide, _CLOSE, _LONG))
    return fits


def first_population(found: FoundModel, form: ResponseForm, records: FitRecords) -> FoundModel:
    """Fit cells of one population.

    Parameters
    ----------
    found : FoundModel
        Fit of a law of Jiles and Atherton, whose map and offsets are kept.
    form : ResponseForm
        Of play cells.
    records : FitRecords
        What is fitted.
    """
    assert form.cells is not None
    wide = _LANGEVIN[form.cells.shape]
    slope = SLOPES[form.cells.shape]
    begins = [
        [_begun(local, form.power, wide, slope, part, kept) for local in found.sets]
        for part in _PINNINGS
        for kept in (1.0, 0.0)
        if kept or min(local.omega for local in found.sets) < 0.0
    ]
    if max(local.kappa for local in found.sets) > _STUCK:
        begins.append([_begun_narrow(local, form.power, wide) for local in found.sets])
    return _best(found, form, records, begins)


def _begun(local: Local, power: int, wide: float, slope: float, part: float, kept: float) -> Local:
    """Make cells of a set of a law of Jiles and Atherton; its initial slope stays as it is.

    Of an interaction that makes a curve steeper a part may be kept; without it the curve is steeper
    by itself.
    """
    reversible = local.c + 0.05
    omega = local.omega / wide
    steeper = 1.0
    if omega < 0.0:
        omega = max(omega, -_BEFORE_JUMPS / slope)
        steeper = (1.0 + omega * slope) / (1.0 + kept * omega * slope)
        omega *= kept * steeper
    all_of_it = 1.0 + reversible
    return replace(
        local,
        law=(reversible, 1.0, part * local.kappa / (wide * steeper), 2.0),
        omega=omega / all_of_it,
        scale=local.scale * wide * steeper,
        gain=local.gain / all_of_it**power,
    )


def _begun_narrow(local: Local, power: int, wide: float) -> Local:
    """Make cells with narrow loops instead; the initial slope stays as it is."""
    all_of_it = 1.0 + _NARROW[0] / _NARROW[1]
    return replace(
        local,
        law=_NARROW,
        omega=max(local.omega, 0.0) / (wide * all_of_it),
        scale=local.scale * wide,
        gain=local.gain / all_of_it**power,
    )


def one_more(found: FoundModel, form: ResponseForm, records: FitRecords) -> FoundModel:
    """Fit cells of one population more than a fit of cells has."""
    return _best(found, form, records, ([_split(local, form.power, how) for local in found.sets]
                                        for how in _FURTHER))  # fmt: skip


def exchanged(found: FoundModel, form: ResponseForm, records: FitRecords) -> FoundModel:
    """Begin each population but the first anew, and take it where that ends clearly lower.

    A descent may end in a valley beside the lowest one, and noise of the loops decides in which: of
    24 records of one solenoid that differ in noise alone, 8 ended with twice the deviation of the
    others, and with the exchange none.

    Parameters
    ----------
    found : FoundModel
        Fit of cells of two populations or more.
    form : ResponseForm
        Of the same.
    records : FitRecords
        What is fitted.
    """
    spent = found.evaluations
    for place in range(1, len(found.sets[0].law) // _PER_POPULATION):
        fewer = [_without(local, place) for local in found.sets]
        again = _best(found, form, records, ([_split(local, form.power, how) for local in fewer]
                                             for how in _FURTHER))  # fmt: skip
        spent += again.evaluations
        if again.cost < _LOWER * found.cost:
            found = again
    return replace(found, evaluations=spent)


def _without(local: Local, place: int) -> Local:
    """Leave a population out; not the first, which the others are told in parts of."""
    begin = _PER_POPULATION * place
    return replace(local, law=local.law[:begin] + local.law[begin + _PER_POPULATION :])


def _split(local: Local, power: int, how: tuple[float, float, float]) -> Local:
    """Add a population; the initial slope stays as it is."""
    share, width, pinning = how
    all_of_it = 1.0 + share / width
    share_0, width_0, pinning_1, spread_1, *others = local.law
    kept = [value / all_of_it if place % 4 == 0 else value for place, value in enumerate(others)]
    more = (share, width, pinning_1 * pinning, spread_1)
    return replace(
        local,
        law=(share_0 * all_of_it, width_0, pinning_1, spread_1, *kept, *more),
        omega=local.omega / all_of_it,
        gain=local.gain / all_of_it**power,
    )


def _best(
    found: FoundModel,
    form: ResponseForm,
    records: FitRecords,
    begins: Iterable[Sequence[Local]],
) -> FoundModel:
    """Descend a little from each begin, and on from the best of them."""
    old = found.space
    tie = TIE * found.cost if old.gap_map in TIED else 0.0
    coarse, fine = (
        CoordinateSpace(old.gap_map, records.thinned(most), form, old.held, old.common)
        for most in (COARSE, FINE)
    )
    tried = [follow(coarse, coarse.pack(list(sets)), _ROUGH, _SHORT, tie) for sets in begins]
    best = min(tried, key=lambda one: one.cost)
    end = follow(fine, best.theta, _CLOSE, _LONG, tie)
    spent = end.evaluations + sum(one.evaluations for one in tried)
    return replace(end, evaluations=spent)


def polish(found: FoundModel, records: FitRecords) -> FoundModel:
    """Let every weight of the cells of a fit move by itself, near to where it is."""
    form = found.space.form
    assert isinstance(form.cells, CellKernel)
    kernel = by_weights(form.cells, found.sets[0].law)
    law = tuple(kernel.populations.weights.ravel().tolist())
    sets = [replace(local, law=law) for local in found.sets]
    space = replace(
        found.space, records=records.thinned(FINE), form=replace(form, law=form.law, cells=kernel)
    )
    return follow(space, space.pack(sets), _CLOSE, _POLISHED, found.tie)
