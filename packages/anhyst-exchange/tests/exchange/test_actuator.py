"""Actuators as FMUs: current and gap in, force out, equal to the stepper of the model."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import anhyst
from anhyst.model.dynamics import Dynamics, Layers
from anhyst.model.parameters import GapMap, Parameter
from anhyst.model.schema import ValidRange
from anhyst.support.numeric import FloatArray
from anhyst.support.units import QUANTITIES
from anhyst_exchange.exporter import export_fmu
from anhyst_exchange.part import FmiVersion
from tests.cli.command import quick as run
from tests.exchange.conftest import Fmu
from tests.exchange.slave import HERE, fmpy, needs_binary, slave
from tests.kept_models.making import MODEL_RECIPES
from tests.refusals import refused, says
from tests.truths import truth

pytestmark = needs_binary

STEP = 1e-4
OUTPUTS = ("iron_flux_density", "iron_field")


RANGE = ValidRange((-4.5, 4.5), (0.0, 300.0), (3e-4, 6e-4))
NODES = (3e-4, 4e-4, 5e-4, 6e-4)
LANGEVIN: dict[str, Parameter] = {"M_s": 1.3e6, "a": 60.0, "k": 45.0, "c": 0.2, "alpha": 2e-5}
CELLS: dict[str, Parameter] = {
    **{"M_0": 4e4, "a_0": 400.0, "M_1": 9e5, "a_1": 90.0, "k_1": 40.0, "s_1": 2.5},
    **{"M_2": 4e5, "a_2": 1500.0, "k_2": 150.0, "s_2": 1.5, "alpha": 1e-5},
}
OVER_GAP: dict[GapMap, dict[str, Parameter]] = {
    "reluctance": {"c_H": 1250.0, "rho": (2.7e-3, 3.5e-3, 4.3e-3, 5.2e-3), "c_out": 170.0},
    "circuit": {"c_H": 1250.0, "rho": (2.7e-3, 3.4e-3, 4.4e-3, 5.2e-3),
                "c_out": (175.0, 170.0, 166.0, 161.0), "out_0": (0.5, 0.4, 0.3, -0.1)},
    "scaling": {"c_H": (900.0, 700.0, 560.0, 470.0), "rho": 1e-4, "c_out": 170.0, "in_0": 0.01},
}  # fmt: skip


def magnet(law: str, gap_map: GapMap) -> anhyst.Model:
    """Return a model of a magnet like the bundled one, without a fit."""
    iron = CELLS if law.startswith("play-cells") else LANGEVIN
    return anhyst.Model(
        *("magnet", QUANTITIES["current"], QUANTITIES["force"], iron | OVER_GAP[gap_map], law),
        *(gap_map, QUANTITIES["gap"], NODES),
        valid=RANGE,
    )


@pytest.fixture(scope="module")
def model() -> anhyst.Model:
    return magnet("effective-field", "reluctance")


@pytest.fixture(scope="module")
def file(model: anhyst.Model, fmu: Fmu) -> Path:
    return fmu(model, "actuator", "2.0")


def drives(model: anhyst.Model, size: int = 600) -> FloatArray:
    """Return a drive in the valid range that decays around zero, negative half the time."""
    assert model.valid is not None
    time = np.arange(size) * STEP
    wave = np.sin(300.0 * time) * np.exp(-20.0 * time)
    return np.asarray(0.98 * max(np.abs(model.valid.input)) * wave)


def gaps(model: anhyst.Model, size: int) -> FloatArray:
    """Return a gap that moves over its range, and a little outside."""
    assert model.valid is not None
    assert model.valid.schedule is not None
    low, high = model.valid.schedule
    return np.asarray(0.5 * (low + high) + 0.55 * (high - low) * np.sin(np.arange(size) / 37.0))


def compare(model: anhyst.Model, path: Path, folder: Path) -> FloatArray:
    """Run a model and its FMU, unpacked in a folder, on the same record; return the output of the
    FMU."""
    drive = drives(model)
    inputs = {model.input.name: drive}
    if model.schedule is not None:
        inputs[model.schedule.name] = gaps(model, drive.size)
    with slave(path, folder) as made:
        found = np.array(made.run(inputs, (model.output.name, *OUTPUTS), STEP))
    stepper = model.stepper(None if model.schedule is None else 0.0, history="demagnetised")
    at = inputs.get(model.schedule.name) if model.schedule is not None else None
    places = [None] * drive.size if at is None else at.tolist()
    rows = zip(drive.tolist(), places, strict=True)
    expected = np.array([stepper.commit(one, place, dt=STEP) for one, place in rows])
    size = float(np.abs(expected).max())
    assert np.abs(found[:, 0] - expected).max() <= 1e-12 * size
    if not model.needs_time:
        record = model.predict(drive, at, history="demagnetised")
        assert np.array_equal(found[:, 0], record.output)
        assert np.array_equal(found[:, 1], record.flux_density)
        assert np.array_equal(found[:, 2], record.field)
    return found[:, 0]


@pytest.mark.slow
@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_the_fmu_gives_the_force_of_the_model_bit_for_bit(
    fmu: Fmu, model: anhyst.Model, tmp_path: Path, fmi: FmiVersion
) -> None:
    force = compare(model, fmu(model, "actuator", fmi), tmp_path)
    assert force.max() > 100.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("law", "gap_map"),
    [
        pytest.param("jiles-atherton-1986", "scaling", marks=pytest.mark.slow),
        ("play-cells", "reluctance"),
        pytest.param("play-cells-langevin", "scaling", marks=pytest.mark.slow),
        ("effective-field", "circuit"),
    ],
)
def test_every_law_and_gap_map_gives_the_force_of_the_model(
    fmu: Fmu, law: str, gap_map: GapMap, tmp_path: Path
) -> None:
    model = magnet(law, gap_map)
    assert compare(model, fmu(model, "actuator", "2.0"), tmp_path).max() > 100.0


@pytest.mark.slow
@pytest.mark.parametrize("example", ["solenoid-three-gaps", "piezo", "electromagnet"])
def test_identified_actuators_give_the_output_of_their_model(fmu: Fmu, example: str, tmp_path: Path) -> None:
    if example in MODEL_RECIPES:
        model = truth(example)
    else:
        loops = anhyst.read_loops(anhyst.example_files(example)["loops.csv"])
        model = anhyst.identify(loops, law="effective-field").model
    assert np.ptp(compare(model, fmu(model, "actuator", "2.0"), tmp_path)) > 0.0


@pytest.mark.slow
def test_an_actuator_without_a_gap_gives_its_output(fmu: Fmu, tmp_path: Path) -> None:
    iron = LANGEVIN | {"c_H": 1.0, "c_out": 3e-4}
    rod = anhyst.Model("rod", QUANTITIES["field"], QUANTITIES["magnetostriction"], iron,
                       valid=ValidRange((-400.0, 400.0), (0.0, 1e-3)))  # fmt: skip
    assert compare(rod, fmu(rod, "actuator", "2.0"), tmp_path).max() > 1e-5


@pytest.mark.slow
@pytest.mark.parametrize("layers", [None, Layers(3, 0.1, 0.2)])
def test_eddy_currents_and_creep_follow_the_time_of_a_step(
    fmu: Fmu, file: Path, model: anhyst.Model, tmp_path: Path, layers: Layers | None
) -> None:
    late = replace(
        model,
        parameters=dict(model.parameters) | {"gamma": 5.0},
        dynamics=Dynamics(times=(0.002, 0.05), shares=(0.03, 0.02)),
        layers=layers,
    )
    found = compare(late, fmu(late, "actuator", "2.0"), tmp_path / "late")
    assert np.abs(found - compare(model, file, tmp_path / "at once")).max() > 1.0


@pytest.mark.slow
@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_the_fmu_is_valid_and_lists_ranges_and_parameters(
    fmu: Fmu, model: anhyst.Model, tmp_path: Path, fmi: FmiVersion
) -> None:
    from fmpy.validation import validate_fmu

    path = fmu(model, "actuator", fmi)
    assert validate_fmu(str(path)) == []
    about = {one.name: one for one in fmpy.read_model_description(path).modelVariables}
    assert (about["current"].unit, about["gap"].unit, about["force"].unit) == ("A", "m", "N")
    assert (float(about["gap"].min), float(about["gap"].max)) == RANGE.schedule
    assert float(about["M_s_A_per_m"].start) == model.parameters["M_s"]
    assert "rho" not in about  # it depends on the gap, so it is not a constant
    with slave(path, tmp_path) as made:
        assert made.read("M_s_A_per_m", "c") == [model.parameters["M_s"], model.parameters["c"]]


def test_a_state_is_restored_and_transferred_to_another_instance(
    file: Path, model: anhyst.Model, tmp_path: Path
) -> None:
    drive, gap = drives(model), gaps(model, 600)
    before = {"current": drive[:400], "gap": gap[:400]}
    after = {"current": drive[400:], "gap": gap[400:]}
    with slave(file, tmp_path) as made, slave(file, tmp_path) as other:
        made.run(before, ["force"], STEP)
        state = made.save()
        there = made.run(after, ["force"], STEP, 400 * STEP)
        made.restore(state)
        assert made.run(after, ["force"], STEP, 400 * STEP) == there
        assert other.run(after, ["force"], STEP, 400 * STEP) != there
        other.restore(other.from_bytes(made.to_bytes(state)))
        assert other.run(after, ["force"], STEP, 400 * STEP) == there


def test_two_instances_do_not_know_of_each_other(file: Path, model: anhyst.Model, tmp_path: Path) -> None:
    drive = drives(model, 200)
    with slave(file, tmp_path) as one, slave(file, tmp_path) as two, slave(file, tmp_path) as alone:
        expected = alone.run({"current": drive}, ["force"], STEP)
        found = []
        for place, current in enumerate(drive):
            found += one.run({"current": [current]}, ["force"], STEP, place * STEP)
            two.run({"current": [-0.7 * current]}, ["force"], STEP, place * STEP)
    assert found == expected


def test_a_step_does_not_depend_on_how_it_is_cut(file: Path, tmp_path: Path) -> None:
    with slave(file, tmp_path) as whole, slave(file, tmp_path) as cut:
        one = whole.run({"current": [2.0, 0.5]}, ["force"], 1.0)[-1]
        many = cut.run({"current": [*np.linspace(0.01, 2.0, 50), *np.linspace(2.0, 0.5, 50)]},
                       ["force"], 1e-3)[-1]  # fmt: skip
        assert one == pytest.approx(many, rel=1e-8)
        held = whole.read("force")
        whole.raw.doStep(2.0, 0.0)
        assert whole.read("force") == held


def test_models_that_give_no_actuator_are_refused(model: anhyst.Model, tmp_path: Path) -> None:
    free = replace(model, gap_map="free", parameters=dict(model.parameters) | {"k": (40.0, 45.0, 50.0, 55.0)})
    with refused("iron-varies: gap"):
        export_fmu(free, tmp_path / "a.fmu", of="actuator")
    with refused("option-not-for-this: --rate"):
        export_fmu(model, tmp_path / "a.fmu", of="actuator", rate=1e4)
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_the_command_writes_it(model: anhyst.Model, tmp_path: Path) -> None:
    model.save(tmp_path / "model.toml")
    completed = run(
        *("export", "model.toml", "--of", "actuator", "--fmi", "3.0", "--out", "a.fmu"),
        *("--platforms", HERE),
        cwd=tmp_path,
    )
    assert completed.returncode == 0, completed.stderr
    names = [one.name for one in fmpy.read_model_description(tmp_path / "a.fmu").modelVariables]
    assert names[:4] == ["time", "current", "gap", "force"]
    completed = run("export", "model.toml", "--of", "actuator", "--rate", "1e4", "-o", "b.fmu",
                  cwd=tmp_path)  # fmt: skip
    assert completed.returncode == 2
    assert says(completed.stderr, "option-not-for-this: --rate")
