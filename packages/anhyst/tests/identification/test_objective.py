"""Residuals, their derivatives and their weights."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from anhyst.data import Loop, Loops
from anhyst.identification import identify
from anhyst.identification.default_search import descend_from
from anhyst.identification.fit_records import WEIGHTINGS, FitRecords, make_fit_records
from anhyst.identification.model_building import make_response_form
from anhyst.identification.objective import Objective
from anhyst.identification.response import PARAMETER_NAMES, ParameterSet
from anhyst.identification.screening import sample_sets, screen_sets, screen_starts
from anhyst.identification.space import GAP_DEPENDENT, CoordinateSpace
from anhyst.identification.uncertainty import correlation_length
from anhyst.model.actuator import Model
from anhyst.model.parameters import GapMap
from anhyst.support.errors import NoResponseError
from anhyst.support.numeric import FloatArray
from tests.identification.truths import GAPS, HISTORIES, core, gauge_free, largest, loops_of, magnet, path
from tests.refusals import refused

TWO = GAPS[1:3]
CASES: dict[str, tuple[Model, str]] = {
    "force, one gap": (magnet("none"), "none"),
    "force, scaling": (magnet("scaling", gaps=TWO), "scaling"),
    "force, reluctance": (magnet("reluctance", gaps=TWO), "reluctance"),
    "force, free": (magnet("scaling", gaps=TWO), "free"),
    "flux density, scaling": (magnet("scaling", "flux_density", gaps=TWO), "scaling"),
    "flux density, reluctance": (magnet("reluctance", "flux_density", gaps=TWO), "reluctance"),
    "closed core": (core(), "none"),
}


def space_of(truth: Model, gap_map: str, loops: Loops, weights: str = "loops") -> CoordinateSpace:
    form = make_response_form(loops.input, loops.output, truth.law)
    return CoordinateSpace(gap_map, make_fit_records(loops, weights), form)


def near(space: CoordinateSpace, truth: Model, seed: int) -> FloatArray:
    """Return coordinates at some distance from the truth, each in its own direction."""
    rng = np.random.default_rng(seed)
    theta = space.pack(gauge_free(truth))
    return np.clip(theta + 0.03 * rng.uniform(-1.0, 1.0, theta.size), *space.bounds)


def central_differences(objective: Objective, theta: FloatArray, step: float = 1e-5) -> FloatArray:
    columns = []
    for place in range(theta.size):
        up, down = theta.copy(), theta.copy()
        up[place] += step
        down[place] -= step
        columns.append((objective.deviations(up) - objective.deviations(down)) / (2.0 * step))
    return np.stack(columns, axis=1)


def with_dead_band(space: CoordinateSpace, part: float) -> CoordinateSpace:
    return replace(space, form=replace(space.form, dead_band=part))


@pytest.mark.parametrize("dead_band", [0.0, 0.2])
@pytest.mark.parametrize("history", HISTORIES)
@pytest.mark.parametrize("name", CASES)
def test_analytic_derivatives_agree_with_differences(name: str, history: str, dead_band: float) -> None:
    truth, gap_map = CASES[name]
    plain = space_of(truth, gap_map, loops_of(truth, history, samples=40))
    space = with_dead_band(plain, dead_band)
    objective = Objective(space, smoothness=1e-3)
    theta = near(space, truth, seed=1)
    values, gradient, matrix = objective.normal_equations(theta)
    assert np.abs(values - objective.deviations(theta)).max() < 1e-8
    numeric = central_differences(objective, theta)
    columns = np.linalg.norm(numeric, axis=0)
    along = np.abs(gradient - numeric.T @ values)
    assert np.all(along < 1e-4 * columns * np.linalg.norm(values))
    assert np.all(np.abs(matrix - numeric.T @ numeric) < 1e-4 * np.outer(columns, columns))


@pytest.mark.parametrize("dead_band", [0.0, 0.2])
@pytest.mark.parametrize("name", ["closed core", "force, reluctance"])
def test_settled_cycles_close_alike_with_and_without_derivatives(name: str, dead_band: float) -> None:
    truth, gap_map = CASES[name]
    space = with_dead_band(space_of(truth, gap_map, loops_of(truth, samples=40)), dead_band)
    for seed in range(8):
        theta = near(space, truth, seed)
        fresh, warm = Objective(space), Objective(space)
        for other in range(3):  # start from the end of other parameters
            warm.normal_equations(near(space, truth, 100 * seed + other))
        expected = fresh.deviations(theta)
        assert np.abs(warm.normal_equations(theta)[0] - expected).max() < 1e-8
        assert np.abs(warm.deviations(theta) - expected).max() < 1e-8


def test_a_cycle_that_creeps_is_closed_to_its_end() -> None:
    truth = core(M_s=1e6, a=157.0, k=509.0, c=0.15, alpha=3.3e-4, in_0=0.0, out_0=0.0)
    loops = loops_of(truth)
    space = space_of(truth, "none", loops)
    objective = Objective(space)
    assert np.abs(objective.outputs(gauge_free(truth)) - objective.measured).max() < 1e-8


def test_the_law_of_1986_is_differentiated_numerically() -> None:
    truth = core("jiles-atherton-1986")
    space = space_of(truth, "none", loops_of(truth, "demagnetised", samples=40))
    objective = Objective(space)
    theta = near(space, truth, seed=2)
    expected = central_differences(objective, theta, 3e-6)
    found = objective.numerical_jacobian(theta)
    assert np.abs(found - expected).max() < 1e-4 * np.abs(expected).max()
    at_bound = theta.copy()
    at_bound[1] = space.bounds[0][1]
    assert np.isfinite(objective.numerical_jacobian(at_bound)).all()


@pytest.mark.parametrize("name", CASES)
def test_coordinates_and_parameters_are_one_to_one(name: str) -> None:
    truth, gap_map = CASES[name]
    space = space_of(truth, gap_map, loops_of(truth, samples=20))
    sets = gauge_free(truth)
    found = [local for local, _ in space.unpack(space.pack(sets))]
    for one, other in zip(found, sets, strict=True):
        for parameter in PARAMETER_NAMES:
            expected = getattr(other, parameter)
            assert getattr(one, parameter) == pytest.approx(expected, rel=1e-12, abs=1e-15)


@pytest.mark.parametrize("gap_map", ["none", "scaling", "reluctance", "free"])
def test_each_gap_map_shares_its_documented_parameters(gap_map: GapMap) -> None:
    truth = magnet("reluctance" if gap_map != "none" else "none")
    space = space_of(truth, gap_map, loops_of(truth, samples=20))
    for name in PARAMETER_NAMES:
        count = len([one for one, _ in space.entries if one == name])
        assert count == (len(GAPS) if gap_map == "free" or name in GAP_DEPENDENT[gap_map] else 1)
    assert len(set(space.names)) == space.size
    held = replace(space, fixed=frozenset({"in_0", "out_0"}))
    assert held.size == space.size - (2 if gap_map != "free" else 8)
    assert all(local.in_0 == local.out_0 == 0.0 for local, _ in held.unpack(np.zeros(held.size)))


def pair(factor: float) -> Loops:
    """Return two loops of one core, a large short and a small long one, that cannot both be fitted."""
    truth = core(in_0=0.0, out_0=0.0)
    loops = []
    for label, top, samples, size in (("large", 120.0, 60, 1.0), ("small", 20.0, 600, factor)):
        cycle = path([-top, top, -top], samples)[:-1]
        output = size * truth.predict(cycle, history="settled").output
        loops.append(Loop(label, cycle, output))
    return Loops(tuple(loops), truth.input, truth.output)


def criterion(loops: Loops, outputs: tuple[FloatArray, ...], weights: str) -> float:
    """Return the sum of squares that a weighting defines, computed directly."""
    squares = [
        float(np.mean((output - loop.output) ** 2)) for loop, output in zip(loops.loops, outputs, strict=True)
    ]
    counts = [loop.n for loop in loops.loops]
    if weights == "points":
        return sum(s * n for s, n in zip(squares, counts, strict=True)) / sum(counts)
    if weights == "loops":
        return sum(squares) / len(squares)
    sizes = [float(np.max(np.abs(loop.output))) for loop in loops.loops]
    return sum(s / size**2 for s, size in zip(squares, sizes, strict=True)) / len(squares)


@pytest.mark.parametrize("weights", WEIGHTINGS)
def test_weights_have_their_documented_effect(weights: str) -> None:
    loops = pair(1.3)
    space = space_of(core(), "none", loops, weights)
    objective = Objective(space)
    theta = near(space, core(), seed=3)
    outputs = tuple(np.split(objective.outputs(sets_at(space, theta)), [loops.loops[0].n]))
    unit = 1.0 if weights == "relative" else largest(loops) ** 2
    expected = criterion(loops, outputs, weights) / unit
    assert float(np.sum(objective.deviations(theta) ** 2)) == pytest.approx(expected, rel=1e-9)


def sets_at(space: CoordinateSpace, theta: FloatArray) -> list[ParameterSet]:
    return [local for local, _ in space.unpack(theta)]


def test_each_weighting_minimises_its_own_criterion() -> None:
    loops = pair(1.3)
    ends = {w: identify(loops, law="effective-field", weights=w, offsets=False).fitted for w in WEIGHTINGS}
    for weights in WEIGHTINGS:
        costs = {other: criterion(loops, end, weights) for other, end in ends.items()}
        assert min(costs, key=lambda other: costs[other]) == weights


def test_an_unknown_weighting_is_refused() -> None:
    with refused("unknown-choice"):
        identify(loops_of(core()), weights="heavy")


def test_a_silent_loop_cannot_be_weighed_by_itself() -> None:
    loops = pair(1.0)
    silent = loops.with_loops([loops.loops[0], replace(loops.loops[1], output=np.zeros(599))])
    with refused("no-output"):
        make_fit_records(silent, "relative")
    assert len(make_fit_records(silent).loops) == 2


def test_thinning_keeps_the_fit() -> None:
    """Thinning keeps the reversals, and the weights replace the removed samples."""
    truth = magnet("reluctance", gaps=TWO)
    loops = loops_of(truth, "demagnetised", samples=2000, noise=2e-3)
    space = space_of(truth, "reluctance", loops)
    thin = space.records.thinned(400)
    for record, whole in zip(thin.loops, space.records.loops, strict=True):
        assert 400 <= record.input.size <= 420
        assert record.input.max() == whole.input.max()
        assert record.weight**2 * record.input.size == pytest.approx(whole.weight**2 * whole.input.size)
    begin = near(space, truth, seed=4)
    ends = [descend_from(s, begin) for s in (space, replace(space, records=thin))]
    assert ends[0].cost == pytest.approx(ends[1].cost, rel=0.2)
    costs = [float(np.sum(Objective(space).deviations(end.theta) ** 2)) for end in ends]
    assert costs[1] < 1.01 * costs[0]


def test_loops_are_never_thicker_after_thinning() -> None:
    records = make_fit_records(loops_of(core(), samples=50))
    assert all(
        np.array_equal(loop.input, other.input)
        for loop, other in zip(records.thinned(400).loops, records.loops, strict=True)
    )


def test_parameters_without_a_solution_cost_more_than_any_fit() -> None:
    truth = core()
    space = space_of(truth, "none", loops_of(truth))
    objective = Objective(space)
    plain = gauge_free(truth)[0]
    jumping = replace(plain, omega=-20.0, law=(plain.kappa, 0.9))  # the reversible part would jump
    with pytest.raises(NoResponseError):
        objective.outputs([jumping])
    impossible = objective.deviations(space.pack([jumping]))
    assert np.array_equal(impossible, objective.unsolved_deviations)
    assert float(impossible @ impossible) == pytest.approx(100.0)


def test_ties_count_differences_from_gap_to_gap() -> None:
    truth = magnet("scaling")
    space = space_of(truth, "free", loops_of(truth, samples=20))
    theta = space.pack(gauge_free(truth))
    objective = Objective(space, smoothness=0.25)
    ties = objective.deviations(theta)[objective.measured.size :]
    scales = [theta[place] for place, (name, _) in enumerate(space.entries) if name == "scale"]
    assert float(ties @ ties) == pytest.approx(0.25 * float(np.sum(np.diff(scales) ** 2)))


def one_gap(records: FitRecords) -> FitRecords:
    return records.at_gap(0)


@pytest.mark.parametrize("biased", [False, True])
def test_the_screening_ranks_as_the_objective_does(biased: bool) -> None:
    truth = magnet("reluctance", gaps=TWO)
    loops = loops_of(truth, "demagnetised")
    form = make_response_form(loops.input, loops.output, truth.law)
    space = CoordinateSpace("none", one_gap(make_fit_records(loops)), form)
    sets = sample_sets(space.records, 64, seed=5, is_biased=biased)
    cost, gain, out_0 = screen_sets(form, space.records, sets)
    objective = Objective(space)
    exact = []
    for kappa, c, omega, scale, in_0, size, lift in np.vstack([sets, gain, out_0]).T:
        local = form.make_set([kappa, c, omega, scale, size, in_0, lift])
        error = (objective.outputs([local]) - objective.measured) * objective.weights
        exact.append(float(error @ error))
    usable = np.isfinite(cost)
    assert usable.sum() > 50
    best = np.argsort(np.array(exact)[usable])[:8]
    assert set(np.argsort(cost[usable])[:4]) <= set(best)
    assert np.sqrt(cost[usable][best]) == pytest.approx(np.sqrt(np.array(exact)[usable][best]), rel=0.2)


def test_starts_differ_and_come_from_the_seed() -> None:
    truth = core()
    space = space_of(truth, "none", loops_of(truth))
    first, again, other = (screen_starts(space, 256, 3, seed) for seed in (1, 1, 2))
    assert first == again
    assert first != other
    assert len({local.kappa for local in first}) == 3


def test_the_correlation_length_counts_correlated_samples() -> None:
    rng = np.random.default_rng(0)
    white = rng.standard_normal(4000)
    assert correlation_length(white) == pytest.approx(1.0, abs=0.3)
    smooth = np.convolve(white, np.full(20, 0.05), mode="same")
    assert correlation_length(smooth) == pytest.approx(20.0, rel=0.3)
    assert correlation_length(np.ones(50)) == 1.0
