"""The search for play cells: many starts in scaled units, population by population.

Starts are drawn over what a loop can show (:mod:`.cell_starts`); what a fit of a law of Jiles and
Atherton suggests is one more. All are compared on few samples, the better ones descend a few steps,
the best of these more, and the last two to their end. Where those do not agree and leave more than
noise, more starts are drawn. A further population starts where it promises most, by the residual of
the fit without it; where none of these gains, it splits off the first.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import groupby, product

import numpy as np

from anhyst.identification.candidates import FAILURES, Fits, ModelCandidate
from anhyst.identification.cell_kernel import EXACT, LAW_OF, CellKernel, by_weights
from anhyst.identification.default import TIE, TIED, FoundModel, follow
from anhyst.identification.fit_records import FitRecords
from anhyst.identification.objective import Objective
from anhyst.identification.response import Local, ResponseForm
from anhyst.identification.screening import SLOPES, draw_starts, placed, possible
from anhyst.identification.space import IN_SERIES, CoordinateSpace
from anhyst.identification.uncertainty import only_demanded
from anhyst.laws.cells import Shape
from anhyst.support.errors import NoResponseError
from anhyst.support.numeric import FloatArray

_ROUGH, COARSE, FINE = 16, 40, 100
"""Samples of a loop on which starts are compared, on which they descend, and on which the last ones
come to their end, at most."""

_NEAR = 1e-8  # error of the tables that fits are compared with, in parts of the saturation
_DRAWN = 48  # starts drawn at a time
_ROUNDS = 2  # times that starts are drawn, at most
_TRIED, _FOLLOWED, _ENDED = 12, 4, 2  # starts that descend a little, further, and to their end
_POLISHED = 8  # steps in which every weight moves by itself, at most

_END = (1e-5, 60)
"""Gain of a step, in parts of the cost, with which a descent has come to its end, and steps at most."""

_PACE, _PATIENT = ((6, 20), _END), ((15, 40), (1e-7, 200))
"""Steps from one sieve to the next, and the end; those of few loops that leave more than noise."""

_FEW = 2
"""Loops that are few: what they leave open is long flat valleys, where descents seem to have ended."""

_FURTHER = 0.8  # cost over that of ends that agree, from which on those were none
_AGREE = 1.1  # cost over the least one up to which an end agrees with the best

_SAME = 0.02
"""Distance of two ends, in any coordinate, from which on they are not on their way to the same."""

_FAR = 2.0  # cost over the least one so far that a further descent must be able to come below

_PINNINGS = (1.0, 0.4)
"""Thresholds over the pinning ``k`` of a law of Jiles and Atherton."""

_STUCK = 10.0
"""Pinning over width of the curve beyond which a law of Jiles and Atherton hardly moves at all: that
its loops are narrow, and nothing of thresholds."""

_NARROW = (0.25, 8.0, 0.1, 2.0)
"""Share and width of the reversible part, pinning and spread of cells with narrow loops."""

_LANGEVIN = {"langevin": 1.0, "tanh": 3.0}
"""Width of each curve that has the slope of Langevin's of width 1 at its middle."""

_BEFORE_JUMPS = 0.8
"""Interaction to begin with, in parts of that at which the magnetisation would jump."""

_GAIN = 0.98
"""Cost, in parts of that with a population less, from which on a further one says nothing."""

_DEAR = 1.2
"""Cost without offsets over that with them, from which on another valley may suit better."""

_BEHIND = 4.0
"""Cost over that of the other curve, with as many populations, up to which one more is tried."""

_WIDTHS, _PINNED = (0.3, 0.6, 1.0, 2.0, 5.0), (0.1, 0.3, 1.0, 3.0)
"""Widths and pinnings of a further population that are weighed by the residual, of the first's."""

_SMALL, _SHARES = 0.03, (0.05, 1.0)
"""Share of a further population by which its effect is computed; and with which it starts."""

_SUGGESTED = 8  # further populations that are tried after one fit

_SPLIT = (0.6, 1.0)
"""Widths of a population that splits off another: nothing is gained to first order, so the residual
says nothing of it."""


@dataclass(frozen=True, eq=False)
class _Levels:
    """One problem on few, more and all samples that a search looks at."""

    rough: CoordinateSpace
    coarse: CoordinateSpace
    fine: CoordinateSpace
    tie: float

    @property
    def kernel(self) -> CellKernel:
        """The cells that are fitted."""
        kernel = self.fine.form.cells
        assert isinstance(kernel, CellKernel)
        return kernel

    def ends(
        self,
        starts: Iterable[FloatArray],
        followed: int = _FOLLOWED,
        pace: tuple[tuple[int, int], tuple[float, int]] = _PACE,
    ) -> list[FoundModel]:
        """Descend from starts, fewer and fewer of them; best first.

        What at its pace does not come near the least cost so far, ends early.
        """
        objective = Objective(self.rough, self.tie)
        (short, long), end = pace
        costs = [(_cost(objective, theta), index, theta) for index, theta in enumerate(starts)]
        chosen = [theta for cost, _, theta in sorted(costs, key=lambda tried: tried[:2])[:_TRIED]]
        spent = len(costs)
        ends: list[FoundModel] = []
        for space, kept, tolerance, most in (
            (self.coarse, followed, 1e-3, short),
            (self.coarse, _ENDED, 1e-4, long),
            (self.fine, _ENDED, *end),
        ):
            ends = []
            for index, theta in enumerate(chosen):
                again = (at for at in range(index) if np.max(np.abs(theta - chosen[at])) < _SAME)
                if (same := next(again, None)) is not None:
                    ends.append(ends[same])
                    continue
                near = _FAR * min((end.cost for end in ends), default=np.inf)
                ends.append(follow(space, theta, tolerance, most, self.tie, near))
                spent += ends[-1].evaluations
            ends = sorted(ends, key=lambda end: end.cost)[:kept]
            chosen = [end.theta for end in ends]
        return [replace(ends[0], evaluations=spent), *ends[1:]]


def _cost(objective: Objective, theta: FloatArray) -> float:
    deviation = objective.deviations(theta)
    return float(deviation @ deviation)


@dataclass(frozen=True, eq=False)
class CellSearch:
    """A search for play cells, and what it starts from."""

    base: FoundModel  # fit of a law without cells
    records: FitRecords
    seed: int
    leaves_something: Callable[[FoundModel], bool]
    is_usable: Callable[[FoundModel], bool]
    drop: Callable[[ModelCandidate, Exception], None]

    def of(self, candidates: Sequence[ModelCandidate]) -> dict[ModelCandidate, Fits]:
        """Fit play cells of every curve, until a population more gains next to nothing."""
        found: dict[ModelCandidate, Fits] = {}
        last: dict[Shape, list[FoundModel]] = {}
        shapes = {candidate.cells.shape for candidate in candidates if candidate.cells}
        for _, alike in groupby(
            candidates, lambda candidate: candidate.cells and candidate.cells.populations
        ):
            new = {}
            for candidate in alike:
                assert candidate.cells is not None
                shape = candidate.cells.shape
                if shape not in shapes:
                    continue
                kernel = replace(candidate.cells, aim=_NEAR)
                form = replace(self.base.space.form, law=LAW_OF[shape], cells=kernel, dead_band=0.0)
                before = last.get(shape, [])
                try:
                    fits = self._fit(self._levels(candidate, form), before)
                    if before and fits[0].cost > _GAIN * before[0].cost:
                        continue
                    lean = self._only_demanded(candidate, fits)
                except FAILURES as error:
                    self.drop(candidate, error)
                    continue
                new[shape] = fits
                found[candidate] = Fits(fits[0], lean)
            least = min((fits[0].cost for fits in new.values()), default=0.0)
            last = {shape: fits for shape, fits in new.items() if fits[0].cost <= _BEHIND * least}
            shapes = set(last)
        return found

    def _fit(self, levels: _Levels, before: list[FoundModel]) -> list[FoundModel]:
        """Fit play cells from what is known: those with a population less, or a law without cells."""
        known = _suggested(levels, before) if before else _begun(levels, self.base)
        fits = self._search(levels, known)
        if before and fits[0].cost > _GAIN * before[0].cost and self.leaves_something(fits[0]):
            objective = Objective(levels.coarse, levels.tie)
            split = [_weighed(objective, before[0], how)[1] for how in product(_SPLIT, _PINNED)]
            fits = _best([*fits, *levels.ends(split, len(split))])
        if not before and not self.is_usable(fits[0]):
            # Follow what begins near Jiles and Atherton to its own end, where that may be chosen.
            near = [follow(levels.fine, theta, *_END, levels.tie) for theta in known]
            able = sorted(filter(self.is_usable, near), key=lambda end: end.cost)
            fits = [*able[:1], *fits][:_ENDED]
        return fits

    def _only_demanded(self, candidate: ModelCandidate, ends: Sequence[FoundModel]) -> FoundModel:
        """Leave out offsets that the loops do not demand; where that is dear, search without them."""
        fit = only_demanded(ends[0], *_END)
        if fit.cost <= _DEAR * ends[0].cost:
            return fit
        levels = self._levels(replace(candidate, held=fit.space.held), ends[0].space.form)
        known = [levels.coarse.pack(end.sets) for end in (fit, *ends)]
        other, *_ = self._search(levels, known)
        return min(fit, other, key=lambda end: end.cost)

    def _levels(self, candidate: ModelCandidate, form: ResponseForm) -> _Levels:
        rough, coarse, fine = (
            CoordinateSpace(candidate.gap_map, some, form, candidate.held, candidate.common)
            for some in map(self.records.thinned, (_ROUGH, COARSE, FINE))
        )
        tie = TIE * self.base.cost if candidate.gap_map in TIED else 0.0
        return _Levels(rough, coarse, fine, tie)

    def _search(self, levels: _Levels, known: list[FloatArray]) -> list[FoundModel]:
        """Draw starts until the last ends agree, or leave nothing.

        Of few loops ends agree on the flat, so what leaves more than noise is followed further from
        all starts; an end that leaves little less is another by chance, and foresees other runs no
        better.
        """
        kernel, ends, begun = levels.kernel, list[FoundModel](), list[FloatArray]()
        drawn = _DRAWN if kernel.populations < 3 else 0
        for turn in range(_ROUNDS):
            starts = draw_starts(kernel, drawn, self.seed + turn, levels.fine.gap_map in IN_SERIES)
            sets = (placed(levels.coarse, start) for start in starts)
            new = [*known, *(levels.coarse.pack(local) for local in sets if possible(local))]
            ends = _best([*ends, *levels.ends(new)])
            begun, known = [*begun, *new], []
            agreed = len(ends) > 1 and ends[-1].cost < _AGREE * ends[0].cost
            if not drawn or agreed or not self.leaves_something(ends[0]):
                break
        if len(levels.fine.records.loops) <= _FEW and self.leaves_something(ends[0]):
            further = levels.ends(begun, pace=_PATIENT)
            if further[0].cost < _FURTHER * ends[0].cost:
                return further
        return ends


def exact(fit: FoundModel) -> FoundModel:
    """Take the tables that a model is computed with."""
    form = fit.space.form
    if not isinstance(form.cells, CellKernel):
        return fit
    form = replace(form, cells=replace(form.cells, aim=EXACT))
    return replace(fit, space=replace(fit.space, form=form))


def _best(ends: Iterable[FoundModel]) -> list[FoundModel]:
    return sorted(ends, key=lambda end: end.cost)[:_ENDED]


def _begun(levels: _Levels, base: FoundModel) -> list[FloatArray]:
    """Make cells of a fit of a law of Jiles and Atherton, in a few ways."""
    wide, slope = _LANGEVIN[levels.kernel.shape], SLOPES[levels.kernel.shape]
    power = base.space.form.power
    begun = [
        [_as_cells(local, power, wide, slope, part, kept) for local in base.sets]
        for part in _PINNINGS
        for kept in (1.0, 0.0)
        if kept or min(local.omega for local in base.sets) < 0.0
    ]
    if max(local.kappa for local in base.sets) > _STUCK:
        begun.append([_as_narrow_cells(local, power, wide) for local in base.sets])
    return [levels.coarse.pack(sets) for sets in begun]


def _as_narrow_cells(local: Local, power: int, wide: float) -> Local:
    """Make cells with narrow loops instead; the initial slope stays as it is."""
    all_of_it = 1.0 + _NARROW[0] / _NARROW[1]
    return replace(
        local,
        law=_NARROW,
        omega=max(local.omega, 0.0) / (wide * all_of_it),
        scale=local.scale * wide,
        gain=local.gain / all_of_it**power,
    )


def _as_cells(
    local: Local, power: int, wide: float, slope: float, part: float, kept: float
) -> Local:
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


def _suggested(levels: _Levels, before: Sequence[FoundModel]) -> list[FloatArray]:
    """Add a population to fits, where each would take most off what is left."""
    suggestions = []
    objective = Objective(levels.coarse, levels.tie)
    for end in dict.fromkeys(before):  # ends may have joined
        tried = [_weighed(objective, end, how) for how in product(_WIDTHS, _PINNED)]
        tried.sort(key=lambda start: -start[0])
        suggestions += [theta for _, theta in tried[:_SUGGESTED]]
    return suggestions


def _weighed(
    objective: Objective, fit: FoundModel, how: tuple[float, float]
) -> tuple[float, FloatArray]:
    """Foresee what a population gains, to first order: how much, and the start with its share.

    All other numbers may move with it, so what they explain by themselves counts for nothing.
    """
    power, space = fit.space.form.power, objective.space

    def start(share: float) -> FloatArray:
        return space.pack([_with_population(local, power, (share, *how)) for local in fit.sets])

    theta = start(_SMALL)
    try:
        _, slope, normal = objective.normal(theta)
    except NoResponseError:
        return -np.inf, theta
    share_of_it = f"share_{len(fit.sets[0].law) // 4 + 1}"
    # Of a gap map that leaves everything free there is one a gap; they rise together.
    own_places = np.array([name.partition("[")[0] == share_of_it for name in space.names])
    others = ~own_places
    inner = normal[np.ix_(others, others)]
    inner += 1e-6 * np.diag(np.diag(inner)) + 1e-12 * np.trace(inner) * np.eye(inner.shape[0])
    across = normal[np.ix_(own_places, others)].sum(axis=0)
    carried = np.linalg.solve(inner, np.stack([across, slope[others]], axis=1))
    own = normal[np.ix_(own_places, own_places)].sum() - across @ carried[:, 0]
    pull = slope[own_places].sum() - across @ carried[:, 1]
    step = -pull / max(own, 1e-30)  # of the logarithm, at this small share
    gained = max(step, 0.0) * -pull
    return gained, start(float(np.clip(_SMALL * (1.0 + step), *_SHARES)))


def _with_population(local: Local, power: int, how: tuple[float, float, float]) -> Local:
    """Add a population; the initial slope stays as it is."""
    share, width, pinning = how
    all_of_it = 1.0 + share / width
    share_0, width_0, pinning_1, spread_1, *others = local.law
    kept = [value / all_of_it if index % 4 == 0 else value for index, value in enumerate(others)]
    more = (share, width, pinning_1 * pinning, spread_1)
    return replace(
        local,
        law=(share_0 * all_of_it, width_0, pinning_1, spread_1, *kept, *more),
        omega=local.omega / all_of_it,
        gain=local.gain / all_of_it**power,
    )


def remapped(fit: FoundModel, candidate: ModelCandidate, records: FitRecords) -> Fits:
    """Fit the same cells under another gap map, from where they are."""
    space = CoordinateSpace(
        candidate.gap_map, records.thinned(FINE), fit.space.form, candidate.held, candidate.common
    )
    tie = TIE * fit.cost if candidate.gap_map in TIED else 0.0
    wide = follow(space, space.pack(fit.sets), *_END, tie)
    return Fits(wide, only_demanded(wide, *_END))


def polish(fit: FoundModel, records: FitRecords) -> Fits:
    """Let every weight of the cells of a fit move by itself, near to where it is."""
    form = fit.space.form
    assert isinstance(form.cells, CellKernel)
    kernel = by_weights(form.cells, fit.sets[0].law)
    law = tuple(kernel.populations.weights.ravel().tolist())
    sets = [replace(local, law=law) for local in fit.sets]
    space = replace(
        fit.space, records=records.thinned(FINE), form=replace(form, law=form.law, cells=kernel)
    )
    end = follow(space, space.pack(sets), _END[0], _POLISHED, fit.tie)
    return Fits(end, end)
