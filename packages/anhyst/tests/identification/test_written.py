"""Reported figures belong to the saved model, and every saved model can be read."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from anhyst.data import History, Loop, Loops
from anhyst.data.clean import clean
from anhyst.data.formats.text import write_csv
from anhyst.data.reading import read_loops
from anhyst.data.verdict import largest_output
from anhyst.identification import IdentifyResult, candidates, identify
from anhyst.identification.candidates import CandidateComparison, Fits, ModelCandidate
from anhyst.identification.cell_kernel import CellKernel
from anhyst.identification.cross_validation import Refit, WithheldError
from anhyst.identification.default_search import FoundModel
from anhyst.laws import LAWS
from anhyst.model.actuator import Model, read_model
from anhyst.model.parameters import GapMap
from anhyst.model.schema import CHOSEN, CandidateFit, FitFigures
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst.support.units import QUANTITIES
from anhyst.verbs.predict import predict
from tests.identification.truths import GAPS, HISTORIES, core, loops_of, magnet, path, predicted

exactly = partial(pytest.approx, rel=1e-9, abs=1e-12)


def fit_of(model: Model) -> FitFigures:
    assert model.fit is not None
    return model.fit


def written(result: IdentifyResult, place: Path) -> Model:
    """Save and read a result, and check that every reported figure is that of the file."""
    model = read_model(result.save(place / "model.toml"))
    outputs = predicted(model, result.loops)
    error = [output - loop.output for output, loop in zip(outputs, result.loops.loops, strict=True)]
    fit = fit_of(model)
    for deviation, row in zip(error, fit.loops, strict=True):
        assert row.rms == exactly(np.sqrt(np.mean(deviation**2)))
        assert row.worst == exactly(np.abs(deviation).max())
    rms = float(np.sqrt(np.mean(np.concatenate(error) ** 2)))
    assert fit.rms == exactly(rms)
    for candidate in fit.candidates:
        if candidate.note == CHOSEN:
            assert candidate.rms is not None
            assert candidate.rms * largest_output(result.loops) == exactly(rms)
    assert fit == fit_of(result.model)
    return model


MAPS = ("none", "scaling", "reluctance", "circuit", "free")
CASES = [("effective-field", gap_map, history) for gap_map in MAPS for history in HISTORIES]
CASES += [("jiles-atherton-1986", "none", history) for history in HISTORIES]


@pytest.mark.first(1)
@pytest.mark.parametrize(("law", "gap_map", "history"), CASES)
def test_every_reported_metric_is_that_of_the_written_model(
    law: str, gap_map: str, history: str, tmp_path: Path
) -> None:
    """No model fits these loops exactly: their iron differs and the force sensor is noisy."""
    kind: GapMap = "none" if gap_map == "none" else "reluctance"
    truth = magnet(kind, gaps=GAPS[:2], c=0.6)
    loops = loops_of(truth, history, samples=40, noise=2e-3)
    result = identify(loops, law=law, gap_map="auto" if gap_map == "none" else gap_map)
    model = written(result, tmp_path)
    assert model.gap_map == gap_map
    assert fit_of(model).rms > 1e-4 * fit_of(model).largest_output


def accelerator_magnet() -> Model:
    parameters = {"M_0": 1e5, "a_0": 300.0, "M_1": 1.3e6, "a_1": 120.0, "k_1": 60.0, "s_1": 1.0}
    around = {"c_H": 120.0, "rho": 0.006, "c_out": 0.9}
    quantities = QUANTITIES["current"], QUANTITIES["flux_density"]
    return Model("dipole", *quantities, parameters | around, law="play-cells")


def accelerator() -> Loops:
    """Return one unipolar loop of a magnet after other cycles: 63 samples, coarse for its iron."""
    truth = accelerator_magnet()
    before = "conditioned:0,165,0,165,0,165,8"
    drive = path([8.0, 165.0, 8.0], 63)
    output = truth.predict(drive, history=before).output
    output = output + 5e-5 * output.max() * np.random.default_rng(0).standard_normal(drive.size)
    return Loops((Loop("1", drive, output, history=History.parse(before)),), truth.input, truth.output)


@pytest.fixture(scope="module")
def dipole() -> IdentifyResult:
    with pytest.MonkeyPatch.context() as patch:
        # With one loop, one population is enough for this test, and faster.
        patch.setattr(candidates, "MAX_POPULATIONS", 1)
        return identify(accelerator())


@pytest.mark.slow
def test_one_coarse_loop_after_turning_points_is_reported_as_predicted(
    tmp_path: Path, dipole: IdentifyResult
) -> None:
    loops = accelerator()
    model = written(dipole, tmp_path)
    loop = loops.loops[0]
    write_csv(tmp_path / "drive.csv", {"I_A": loop.input, "B_T": loop.output})
    run = predict(model, tmp_path / "drive.csv", tmp_path / "found.csv")
    assert run.deviation is not None
    assert run.history == str(loop.history)
    assert run.deviation.rms == pytest.approx(fit_of(model).rms, rel=1e-9)
    chosen = [candidate.rms for candidate in fit_of(model).candidates if candidate.note == CHOSEN]
    assert chosen == [pytest.approx(run.deviation.rms / run.deviation.largest, rel=1e-9)]


@pytest.mark.slow
def test_with_one_loop_withheld_blocks_of_samples_select_the_law(dipole: IdentifyResult) -> None:
    """The simplest law is not selected if another has a third of its residual; descents are long."""
    loops, truth = accelerator(), accelerator_magnet()
    model = dipole.model
    assert model.law == "play-cells"
    left = {candidate.law: candidate.left_out for candidate in fit_of(model).candidates}
    assert left["effective-field"] is not None
    assert min(one for one in left.values() if one is not None) < left["effective-field"] / 3.0
    before, largest = str(loops.loops[0].history), largest_output(loops)
    assert fit_of(model).rms < 0.001 * largest  # 0.0026 in the flat valley before it
    for turns in ([8.0, 165.0, 80.0, 165.0, 8.0], [8.0, 120.0, 8.0], [8.0, 60.0, 8.0, 165.0]):
        drive = path(turns, 120)
        error = (model.predict(drive, history=before).output
               - truth.predict(drive, history=before).output)  # fmt: skip
        assert np.sqrt(np.mean(error**2)) < 0.002 * largest
        assert np.abs(error).max() < 0.02 * largest


@pytest.mark.slow
def test_the_uncertainty_of_a_single_loop_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    """One loop of a ring with pinning as strong as the drive barely determines inner loops."""
    monkeypatch.setattr(candidates, "MAX_POPULATIONS", 1)
    parameters = {"M_0": 3e4, "a_0": 150.0, "M_1": 1e6, "a_1": 150.0, "k_1": 250.0, "s_1": 2.7}
    truth = replace(accelerator_magnet(), parameters=parameters | {"c_H": 1.0, "c_out": 1.0})
    before = "conditioned:-340,340,-340,340,-340"
    drive = path([-340.0, 340.0, -340.0], 140)
    output = truth.predict(drive, history=before).output
    noise = 3e-3 * np.random.default_rng(0).standard_normal(drive.size)
    measured = output + noise * largest_output(loops_alone(truth, drive, output, before))
    result = identify(loops_alone(truth, drive, measured, before))
    (said,) = (text for text in result.warnings if "differ by" in text)
    apart = float(said.split("differ by ")[1].split(" %")[0]) / 100.0
    turns = path([-340.0, 100.0, -50.0, 250.0, 0.0, 150.0, -200.0], 200)
    error = (result.model.predict(turns, history=before).output
           - truth.predict(turns, history=before).output)  # fmt: skip
    missed = float(np.sqrt(np.mean(error**2))) / largest_output(result.loops)
    assert missed < apart < 10.0 * missed


def loops_alone(truth: Model, drive: FloatArray, output: FloatArray, history: str) -> Loops:
    loop = Loop("1", drive, output, history=History.parse(history))
    return Loops((loop,), truth.input, truth.output)


CELLS: list[Any] = [
    pytest.param("play-cells", "reluctance", history, id=f"reluctance-{history}") for history in HISTORIES
]
CELLS += [
    pytest.param(
        law,
        gap_map,
        history,
        id=f"{law}-{gap_map}-{history}",
        # Each law is tested with each map and each history once, and a campaign tests all
        # combinations.
        marks=[pytest.mark.slow] + [pytest.mark.campaign] * ((i + j + k) % len(HISTORIES) != 0),
    )
    for i, law in enumerate(("play-cells", "play-cells-langevin"))
    for j, gap_map in enumerate(("scaling", "reluctance", "circuit"))
    for k, history in enumerate(HISTORIES)
]


@pytest.mark.first(1)
@pytest.mark.parametrize(("law", "gap_map", "history"), CELLS)
def test_play_cells_are_reported_as_predicted(
    law: str, gap_map: str, history: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(candidates, "MAX_POPULATIONS", 1)
    gaps = GAPS if gap_map == "circuit" else GAPS[:2]  # with three its leakage path is tried too
    loops = loops_of(magnet(gaps=gaps), history, samples=40, noise=1e-3)
    model = written(identify(loops, law=law, gap_map=gap_map), tmp_path)
    assert (model.law, model.gap_map) == (law, gap_map)


@pytest.mark.slow
def test_settled_loops_run_one_after_the_other_are_reported_as_predicted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A small cycle starts from the remanence of the large one, in the fit and in predict."""
    monkeypatch.setattr(candidates, "MAX_POPULATIONS", 1)
    truth = replace(accelerator_magnet(), history=History.parse("demagnetised"))
    cycles = [path([8.0, top, 8.0], 60)[:-1] for top in (165.0, 90.0, 40.0)]
    drive = np.concatenate([np.tile(cycle, 4) for cycle in cycles])
    output = truth.predict(drive).output
    last = [slice(236 * k + 177, 236 * k + 236) for k in range(len(cycles))]
    columns = {
        "loop": np.repeat([1.0, 2.0, 3.0], 59),
        "t_s": np.concatenate([np.arange(236.0 * 3)[part] for part in last]),
        "I_A": np.concatenate([drive[part] for part in last]),
        "B_T": np.concatenate([output[part] for part in last]),
    }
    write_csv(tmp_path / "loops.csv", columns)
    loops = read_loops(tmp_path / "loops.csv", history="settled")
    assert any(loop.history.turning_points for loop in loops.loops)
    model = written(identify(loops, law="play-cells"), tmp_path)
    run = predict(model, tmp_path / "loops.csv", tmp_path / "found.csv")
    assert run.deviation is not None
    assert run.runs == len(cycles)
    assert run.deviation.rms == pytest.approx(fit_of(model).rms, rel=1e-9)


def test_a_missing_withheld_error_is_absent() -> None:
    one, fold = ModelCandidate("free", frozenset()), frozenset({1})
    nothing = Refit(np.inf, {1: WithheldError(np.inf, (np.inf,))})
    contest = CandidateComparison([one], {}, {fold: {one: nothing}}, [1])
    assert contest.finite_withheld_error(one) is None


@pytest.mark.parametrize(("fitted", "populations"), [(0.3, 2), (0.9, 1)])
def test_a_much_better_candidate_is_selected_despite_a_large_standard_error(
    fitted: float, populations: int
) -> None:
    """One block with a large gain makes the standard error of the difference large."""
    one, other = (
        ModelCandidate("none", frozenset(), rank=count, cells=CellKernel("tanh", count)) for count in (1, 2)
    )
    missed = {one: [1.0, 1.0, 1.0, 1.0, 1.0, 20.0], other: [0.5, 0.5, 1.1, 0.5, 0.5, 1.0]}
    refits = {
        frozenset({place}): {
            each: Refit(1.0, {place: WithheldError(squares[place] ** 0.5, (squares[place],))})
            for each, squares in missed.items()
        }
        for place in range(6)
    }
    costs = {one: 1.0, other: fitted}
    nowhere: Any = None  # no space is needed
    found = {each: FoundModel(nowhere, np.zeros(1), cost, 0) for each, cost in costs.items()}
    fits = {each: Fits(end, end) for each, end in found.items()}
    chosen = CandidateComparison([one, other], fits, refits, range(6), "block").select_best()
    assert chosen.cells is not None
    assert chosen.cells.population_count == populations


def test_an_unreadable_model_is_not_written(tmp_path: Path) -> None:
    place = tmp_path / "model.toml"
    good = core()
    good.save(place)
    before = place.read_bytes()
    candidate = CandidateFit("effective-field", "free", 30, 0.01, left_out=np.inf)
    with pytest.raises(InputError, match=r"model\.toml:\d+: fit\.candidate\[1\]\.left_out"):
        replace(good, fit=FitFigures(1.0, 0.0, 0.0, 0.0, candidates=(candidate,))).save(place)
    assert place.read_bytes() == before
    assert [one.name for one in tmp_path.iterdir()] == ["model.toml"]


SETS: Mapping[str, Mapping[str, object]] = {
    "ferrite_core_gaps/loops_by_gap.csv": {"columns": {"I_A_scaled": "I_A", "U_M_V": "psi_Wb"}},
    "ferrite_mnzn/mnzn_ferrite_3loops.csv": {},
    "ferrite_mnzn/mnzn_ferrite_4loops.csv": {},
    "ferrite_mnzn/mnzn_hp_ferrite_4loops.csv": {},
    "gadolinium_temperature/gd_T*.csv": {"file_name": "gd_T{T_C}C"},
    "piezo_flexure/model_run.csv": {"columns": {"V_in": "u_V", "y_um": "x_um"}},
    "steel_core1_dc/loops.csv": {"loop": "nominal_Hmax_A_per_m"},
    "steel_m130_27s/m130_27s_steel_raw_3loops.csv": {},
    "steel_m130_27s/m130_27s_steel_symmetrised_3loops.csv": {},
    "steel_team32/loops.csv": {"columns": {"bmax_T": "loop"}},
}


def identify_options(loops: Loops) -> Iterator[dict[str, str]]:
    """Return every possible law and gap map for some loops."""
    yield {}
    scheduled = len(loops.schedule_values) > 1
    for law in LAWS:
        # Its numerical derivatives take minutes for many temperatures or for a piezo actuator.
        if law != "jiles-atherton-1986" or (loops.input.name == "field" and not scheduled):
            yield {"law": law}
    for gap_map in MAPS[1:] if scheduled else ():
        yield {"law": "effective-field", "gap_map": gap_map}


REPEATS = {
    "ferrite_mnzn/mnzn_ferrite_4loops.csv",
    "ferrite_mnzn/mnzn_hp_ferrite_4loops.csv",
    "steel_m130_27s/m130_27s_steel_raw_3loops.csv",
    "steel_m130_27s/m130_27s_steel_symmetrised_3loops.csv",
    "steel_team32/loops.csv",
}
"""Further ferrites and steels, or the same material again."""


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [pytest.param(one, marks=[pytest.mark.campaign] * (one in REPEATS)) for one in SETS]
)
def test_every_model_of_real_measurements_can_be_read(name: str, measurements: Path, tmp_path: Path) -> None:
    """Every law and map is tried on every set of loops; an impossible combination is rejected."""
    files = sorted(measurements.glob(name))
    files = files[:: max(1, len(files) // 3)]  # every other file of many temperatures
    loops = clean(read_loops(files, **SETS[name]))  # type: ignore[arg-type]
    few = loops.with_loops(
        replace(loop, input=loop.input[::step], output=loop.output[::step],
                schedule=None if loop.schedule is None else loop.schedule[::step],
                time=None if loop.time is None else loop.time[::step])
        for loop in loops.loops
        for step in [max(1, loop.n // 60)]
    )  # fmt: skip
    read = 0
    for way in identify_options(few):
        try:
            result = identify(few, **way)  # type: ignore[arg-type]
        except InputError:
            continue
        written(result, tmp_path)
        read += 1
    assert read > 3
