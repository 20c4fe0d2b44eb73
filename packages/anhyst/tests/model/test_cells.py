"""The cells of a law in a model: write, read, reject with a reason, show and compare."""

from __future__ import annotations

import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from anhyst.laws.cells import CellWeights, Population, discretise_populations
from anhyst.model.actuator import Model, read_model
from anhyst.model.diff import diff
from anhyst.model.writer import model_text, write_model
from anhyst.reports.page import write_report
from anhyst.support.units import QUANTITIES
from tests.refusals import refused

CIRCUIT = {"c_H": 1000.0, "rho": 0.006, "c_out": 300.0}
NUMBERS = {
    "M_0": 3e4, "a_0": 50.0, "M_1": 3e5, "a_1": 40.0, "k_1": 20.0, "s_1": 1.5,
    "M_2": 1e5, "a_2": 120.0, "k_2": 80.0, "s_2": 2.0,
}  # fmt: skip
CELLS = discretise_populations(
    (3e4, 50.0), [Population(3e5, 40.0, 20.0, 1.5), Population(1e5, 120.0, 80.0, 2)]
)
FEW = CellWeights(
    np.array([0.0, 20.0, 70.0]), np.array([40.0, 120.0]), np.array([[3e4, 0], [2e5, 0], [1e5, 1e5]])
)
DRIVE = np.concatenate([np.linspace(0, 3, 40), np.linspace(3, -1, 40), np.linspace(-1, 2, 40)])


def model(cells: CellWeights | None = FEW, law: str = "play-cells") -> Model:
    numbers = NUMBERS if cells is None else {"alpha": 1e-4}
    return Model(
        "by hand", QUANTITIES["current"], QUANTITIES["force"], numbers | CIRCUIT, law=law, cells=cells
    )


def file_with(path: Path, old: str = "", new: str = "") -> Path:
    text = model_text(model())
    assert old in text
    path.write_text(text.replace(old, new), encoding="utf-8")
    return path


def test_cells_come_back_from_the_file_to_the_last_bit(tmp_path: Path) -> None:
    path = tmp_path / "model.toml"
    write_model(model(), path)
    again = read_model(path)
    assert again == model()
    assert model_text(again) == path.read_text(encoding="utf-8")
    assert pickle.loads(pickle.dumps(again)) == again
    assert again.predict(DRIVE).output.tolist() == model().predict(DRIVE).output.tolist()


def test_the_cells_of_populations_are_the_same_model() -> None:
    one = model(None).predict(DRIVE).output
    other = replace(model(CELLS), parameters=CIRCUIT).predict(DRIVE).output
    np.testing.assert_array_equal(other, one)


def test_the_state_has_one_value_per_cell() -> None:
    assert model().predict(DRIVE).state.size == 3
    stepper = model().stepper()
    outputs = [stepper.commit(float(drive)) for drive in DRIVE[:60]]
    assert outputs == pytest.approx(model().predict(DRIVE).output[:60].tolist(), abs=1e-9)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("thresholds_A_per_m", "thresholds", "unit-missing cells.thresholds"),
        ("[0.0, 20.0, 70.0]", "[0.0, 70.0, 20.0]", "cells-out-of-range cells"),
        ("[40.0, 120.0]", "[40.0]", "wrong-shape cells.weights_A_per_m"),
        ("[40.0, 120.0]", "[40.0, -1.0]", "cells-out-of-range cells"),
        ("200000.0", "-1.0", "cells-out-of-range cells"),
        ("200000.0", '"much"', "float-type cells.weights[2][1]"),
        ('shape = "tanh"', 'shape = "sine"', "literal-error cells.shape: 'tanh'; 'langevin'"),
        ('shape = "tanh"', 'shape = "langevin"', "cells-out-of-range cells: 'play-cells-langevin'"),
        ('shape = "tanh"\n', "", "missing cells.shape"),
        ('law = "play-cells"', 'law = "effective-field"', "cells-out-of-range cells: 'effective-field'"),
        ("alpha = 0.0001", "M_1_A_per_m = 1.0", "extra-forbidden parameters.M_1_A_per_m"),
    ],
)
def test_wrong_cells_are_refused_with_their_place(tmp_path: Path, old: str, new: str, said: str) -> None:
    with refused(said):
        read_model(file_with(tmp_path / "model.toml", old, new))


def test_cells_of_another_law_are_refused() -> None:
    with refused("cells-out-of-range cells: 'effective-field'"):
        model(law="effective-field")
    with refused("cells-out-of-range cells: 'tanh'"):
        model(law="play-cells-langevin")


def test_comparison_and_report_show_the_cells(tmp_path: Path) -> None:
    weights = FEW.weights.copy()
    weights[2, 1] *= 1.1
    other = replace(model(), cells=replace(FEW, weights=weights))
    assert diff(model(), model()).same
    found = diff(model(), other)
    assert [change.name for change in found.settings] == ["cells"]
    write_model(model(), tmp_path / "model.toml")
    write_report(tmp_path / "model.toml", tmp_path / "page.html")
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "3 cells, 4 weights above 0" in text
