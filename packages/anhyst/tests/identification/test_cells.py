"""Play cells are fitted to their own loops, also with sensor drift, and selected if they are
better."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from anhyst.data import Loop, Loops
from anhyst.data.path import History
from anhyst.data.reading import read_loops
from anhyst.identification import identify
from anhyst.identification.cell_kernel import CellKernel
from anhyst.identification.default_search import FoundModel
from anhyst.identification.fit_records import InputHistory, make_fit_records
from anhyst.identification.model_building import make_model, make_response_form
from anhyst.identification.objective import Objective
from anhyst.identification.space import CoordinateSpace
from anhyst.identification.uncertainty import OFFSET_NAMES
from anhyst.laws.cells import Shape
from anhyst.model.actuator import Model
from anhyst.model.parameters import Parameter
from anhyst.support.numeric import FloatArray
from tests.identification.truths import HISTORIES, loops_of, magnet, noisy
from tests.repository import ROOT
from tests.truths import truth as kept

FOLDER = ROOT / "examples" / "electromagnet"
NOISE = 2e-3


def cells_magnet() -> Model:
    """Return the magnet of the other tests with iron of play cells."""
    around = magnet("reluctance", in_0=0.0, out_0=0.0)
    kept = {name: around.parameters[name] for name in ("rho", "c_H", "c_out")}
    scale = around.parameters["a"]
    assert isinstance(scale, float)
    iron = {"M_0": 1e5, "a_0": 3.0 * scale, "M_1": 1.1e6, "a_1": 2.0 * scale, "k_1": 1.2 * scale,
            "s_1": 2.5}  # fmt: skip
    return replace(around, law="play-cells", parameters=kept | iron)


def one_after_another(loopset: Loops, drift: float = 0.0) -> Loops:
    """Give the loops increasing times, and add a drift over each gap, relative to its largest
    output."""
    top = max(float(np.max(np.abs(loop.output))) for loop in loopset.loops)
    found, clock, gap, begun = [], 0.0, -1.0, 0.0
    for loop in loopset.loops:
        time = clock + np.linspace(0.0, 1.0, loop.n)
        value = loop.schedule_value or 0.0
        if value != gap:
            gap, begun = value, clock
        moved = loop.output + drift * top * (time - begun)
        found.append(replace(loop, time=time, output=moved))
        clock += 2.0
    return loopset.with_loops(found)


def predicted(model: Model, loopset: Loops) -> FloatArray:
    """Return the modelled output of all loops."""
    return np.concatenate(
        [model.predict(loop.input, loop.schedule, loop.time, loop.history).output for loop in loopset.loops]
    )


def error(model: Model, loopset: Loops) -> FloatArray:
    """Return the residuals relative to the largest output."""
    measured: FloatArray = np.concatenate([loop.output for loop in loopset.loops])
    off: FloatArray = predicted(model, loopset) - measured
    return off / float(np.max(np.abs(measured)))


def somewhere(loops: Loops, shape: Shape) -> tuple[CoordinateSpace, FloatArray]:
    """Return a space of two populations, and coordinates in it."""
    form = replace(make_response_form(loops.input, loops.output, "effective-field"),
                   cells=CellKernel(shape, 2))  # fmt: skip
    space = CoordinateSpace("reluctance", make_fit_records(loops), form)
    usual = [
        space.to_coordinate(name, space.fit_parameters[name].prior_mean or space.unit(name))
        for name, _ in space.entries
    ]
    # Different pinnings, because the smallest one sets the thresholds.
    return space, np.array(usual) + 0.02 * np.arange(len(usual))


@pytest.mark.parametrize("shape", ["tanh", "langevin"])
def test_derivatives_agree_with_differences_without_drift(shape: Shape) -> None:
    loops = one_after_another(loops_of(cells_magnet(), samples=40), drift=0.01)
    space, theta = somewhere(loops, shape)
    objective = Objective(space)
    values, gradient, matrix = objective.normal_equations(theta)
    assert np.abs(values - objective.deviations(theta)).max() < 1e-10
    step = 1e-5 * np.eye(theta.size)
    numeric = np.stack(
        [(objective.deviations(theta + one) - objective.deviations(theta - one)) / 2e-5 for one in step],
        axis=1,
    )
    columns = np.linalg.norm(numeric, axis=0)
    along = np.abs(gradient - numeric.T @ values)
    assert np.all(along < 1e-3 * columns.max() * np.linalg.norm(values))
    assert np.abs(matrix - numeric.T @ numeric).max() < 1e-3 * columns.max() ** 2


@pytest.mark.parametrize("history", HISTORIES)
def test_a_long_record_in_pieces_is_the_record(history: str) -> None:
    space, theta = somewhere(loops_of(cells_magnet(), history, samples=90), "tanh")
    whole = space.records
    pieces = tuple(piece for loop in whole.loops for piece in loop.make_pieces(7))
    assert len(pieces) > 10 * len(whole.loops)
    cut = replace(space, records=replace(whole, loops=pieces))
    for equation, other in zip(
        Objective(space).normal_equations(theta), Objective(cut).normal_equations(theta), strict=True
    ):
        assert np.abs(equation - other).max() < 1e-9 * np.abs(equation).max()


@pytest.mark.slow
def test_play_cells_are_identified_from_their_own_loops() -> None:
    truth = cells_magnet()
    loops = noisy(loops_of(truth), NOISE, 1)
    model = identify(loops, gap_map="reluctance").model
    assert model.law.startswith("play-cells")
    assert (
        np.mean(np.abs(error(model, loops_of(truth)))) < 1.2e-3
    )  # cells finer than the samples count as free


@pytest.mark.parametrize("law", ["play-cells", "effective-field"])
def test_fit_and_prediction_use_the_same_history_at_other_gaps(law: str) -> None:
    loops = loops_of(cells_magnet(), samples=40)
    cells, kind = (CellKernel("tanh", 2), "settled") if law == "play-cells" else (None, "conditioned")
    space, _ = somewhere(loops, "tanh")
    space = replace(space, form=replace(space.form, law=law, cells=cells), fixed=OFFSET_NAMES)
    theta = np.array(
        [
            space.to_coordinate(name, space.fit_parameters[name].prior_mean or 0.5 * space.unit(name))
            + 0.3 * (gap or 0)
            for name, gap in space.entries
        ]
    )
    drives = [replace(loop, input=0.3 + 0.2 * loop.input) for loop in loops.loops]
    outputs = []
    for past in ("0,0.8@0.0003;0.3", "0,0.8,0.3"):
        known = loops.with_loops(drives).with_history(f"{kind}:{past}")
        found = FoundModel(replace(space, records=make_fit_records(known)), theta, 1.0, 0)
        fitted = Objective(found.space).outputs(found.parameter_sets)
        expected = predicted(make_model(found, known), known)
        np.testing.assert_allclose(fitted, expected, rtol=0, atol=1e-9 * np.ptp(expected))
        outputs.append(fitted)
    assert np.abs(outputs[0] - outputs[1]).max() > 1e-3 * np.ptp(outputs[1])


def test_a_history_at_a_withheld_gap_is_interpolated() -> None:
    past = InputHistory(np.array([0.0, 2.0, 1.0]), np.array([0.0, 1.0, 2.0])).with_renumbered_gaps([0, 2, 3])
    assert past.gap_position.tolist() == [0.0, 0.5, 1.0]


@pytest.mark.slow
def test_a_drift_of_the_sensor_is_no_force() -> None:
    truth = cells_magnet()
    clean = one_after_another(loops_of(truth))
    drifting = one_after_another(noisy(loops_of(truth), NOISE, 1), drift=2e-3)
    model = identify(drifting, law="play-cells", gap_map="reluctance").model
    assert np.max(error(model, drifting)) - np.min(error(model, drifting)) > 5e-3
    assert np.mean(np.abs(error(model, clean))) < 1.2e-3  # cells finer than the samples count as free


@pytest.mark.slow
def test_loops_of_jiles_atherton_give_a_jiles_atherton_law() -> None:
    loops = noisy(loops_of(magnet("reluctance")), NOISE, 1)
    assert identify(loops).model.law == "effective-field"


def test_the_bundled_magnet_is_met_at_gaps_that_were_not_measured() -> None:
    """Its iron is no law of the package, and its force sensor drifts."""
    model = kept("electromagnet")
    truth = read_loops(FOLDER / "unseen_truth.csv")
    off = np.abs(error(model, truth))
    assert model.law.startswith("play-cells")
    assert off.mean() < 1.2e-3
    assert off.max() < 8e-3


@pytest.mark.slow
def test_noise_does_not_decide_in_which_valley_a_fit_of_cells_ends() -> None:
    loops = read_loops(FOLDER.parent / "stage" / "loops.csv").at([0.48e-3])
    left = []
    for seed in (2, 6):
        model = identify(noisy(loops, 4e-4, seed), law="play-cells", dead_band=False).model
        left.append(float(np.sqrt(np.mean(np.square(error(model, loops))))))
    assert max(left) < 1.04 * min(left)


@pytest.mark.slow
def test_a_magnet_that_is_driven_to_both_sides_is_found_without_a_bias() -> None:
    made: dict[str, Parameter] = {
        **{"M_0": 4e4, "a_0": 400.0, "M_1": 9e5, "a_1": 90.0, "k_1": 40.0, "s_1": 2.5},
        **{"M_2": 4e5, "a_2": 1500.0, "k_2": 150.0, "s_2": 1.5, "alpha": 1e-5},
        **{"rho": (2.7e-3, 3.5e-3, 4.3e-3, 5.2e-3), "c_H": 1250.0, "c_out": 170.0},
    }
    gaps = (3e-4, 4e-4, 5e-4, 6e-4)
    truth = replace(cells_magnet(), parameters=made, nodes=gaps)
    wave = np.sin(np.linspace(0.0, 2.0 * np.pi, 201))
    loops = []
    for gap, largest in ((gap, top) for gap in gaps for top in (4.0, 2.0)):
        force = truth.predict(largest * wave, gap, None, "settled").output
        at, history = np.full(wave.size, gap), History.parse("settled")
        loops.append(Loop(f"{gap} {largest}", largest * wave, force, at, history=history))
    both_sides = loops_of(truth).with_loops(loops)
    model = identify(noisy(both_sides, 5e-4, 0)).model
    assert model.parameters["in_0"] == pytest.approx(0.0, abs=0.04)
    assert np.abs(error(model, both_sides)).mean() < 2e-3
