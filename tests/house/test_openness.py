"""The house is open: a law and a file format that stand in this file alone go the whole way."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from anhyst.cli.app import app
from anhyst.data import read_loops
from anhyst.data.formats import FORMATS, MemoryTable
from anhyst.identification import identify
from anhyst.laws.law import Law, ParameterSpec
from anhyst.laws.registry import LAWS
from anhyst.laws.sampled import SampledIron, State
from anhyst.model.actuator import Model
from anhyst.model.file import read_model
from anhyst.model.parameters import Parameter
from anhyst.support.arrays import FloatArray
from anhyst.support.errors import InputError
from anhyst.support.units import QUANTITIES

GAPS = (0.3e-3, 0.5e-3)
RHO = (0.004, 0.009)
TRUE: dict[str, Parameter] = {
    "chi": 350.0,
    "r": 0.21,
    "c_H": 1.0,
    "rho": RHO,
    "c_out": 3e5,
    "out_0": 0.4,
}


@dataclass(frozen=True)
class PlayIron(SampledIron):
    """A single play: the magnetisation follows the field at a distance of ``r``."""

    chi: float
    r: float

    def step(self, state: State, field: float) -> tuple[float, State]:
        play = min(max(state[1], field - self.r), field + self.r)
        return self.chi * play, (field, play)

    def field_of(self, state: State) -> float:
        return state[0]


PLAY = Law(
    name="play",
    title="single play operator",
    parameters=(
        ParameterSpec("chi", "susceptibility", low=0.0, coordinate="log", search=(10.0, 1e4)),
        ParameterSpec(
            "r", "half-width of the play", "A/m", low=0.0, coordinate="log", search=(1e-3, 1.0)
        ),
    ),
    iron=PlayIron,
    states=2,
)


def open_toy(path: Path, _least: int) -> MemoryTable:
    """Open a table of JSON lines: the names of the columns, then row by row."""
    content = path.read_bytes()
    header, *rows = map(json.loads, content.splitlines())
    return MemoryTable(
        str(path), tuple(header), tuple(zip(*rows, strict=True)),
        sha256=sha256(content).hexdigest(),
    )  # fmt: skip


@pytest.fixture(scope="module", autouse=True)
def _registered() -> Iterator[None]:
    LAWS[PLAY.name], FORMATS[".toy"] = PLAY, open_toy
    yield
    del LAWS[PLAY.name], FORMATS[".toy"]


def magnet() -> Model:
    return Model(
        "truth",
        QUANTITIES["current"],
        QUANTITIES["force"],
        TRUE,
        law="play",
        gap_map="reluctance",
        schedule=QUANTITIES["gap"],
        nodes=GAPS,
    )


def cycle(largest: float) -> FloatArray:
    up = np.linspace(0.0, largest, 13)
    return np.concatenate([up, up[-2::-1], up[1:]])


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("toy") / "loops.toy"
    lines = [json.dumps(["I_A", "F_N", "gap_mm", "loop"])]
    for gap in GAPS:
        for name, largest in (("large", 3.0), ("small", 1.2)):
            drive = cycle(largest)
            force = magnet().predict(drive, gap).output.tolist()
            lines += [
                json.dumps([i, f, 1e3 * gap, name])
                for i, f in zip(drive.tolist(), force, strict=True)
            ]
    path.write_text("\n".join(lines))
    return path


def run(*arguments: object) -> str:
    result = CliRunner().invoke(app, [str(one) for one in arguments])
    assert result.exit_code == 0, result.output
    return result.output


@pytest.fixture(scope="module")
def found(measured: Path) -> Path:
    """Return the model file that the command writes."""
    path = measured.with_name("model.toml")
    said = run("identify", measured, "--history", "demagnetised", "--law", "play",
               "--gap-map", "reluctance", "--out", path)  # fmt: skip
    assert "law 'play' cannot be compiled: there is no compensator for it" in said
    return path


def test_the_file_is_read_by_its_own_format(measured: Path) -> None:
    loops = read_loops(measured)
    assert loops.schedule_values == pytest.approx(GAPS)
    assert {loop.label for loop in loops.loops} == {"large", "small"}
    assert loops.sources[0].sha256 == sha256(measured.read_bytes()).hexdigest()
    assert read_loops(measured.parent).schedule_values == loops.schedule_values


def test_the_papers_search_is_for_laws_of_the_core(measured: Path) -> None:
    with pytest.raises(InputError, match="search 'paper' needs a law of the core, play is none"):
        identify(read_loops(measured), law="play", search="paper")


def test_the_law_is_found_again(found: Path) -> None:
    model = read_model(found)
    assert model.law == "play"
    assert model.fit is not None
    assert model.fit.rms < 1e-3 * model.fit.largest_output
    assert model.parameters["r"] == pytest.approx(TRUE["r"], rel=0.05)
    assert model.uncertainty is not None
    assert len(model.uncertainty.names) == len(model.uncertainty.std) == 7


def test_the_model_predicts_between_the_gaps_and_inverts(found: Path) -> None:
    model, drive = read_model(found), cycle(2.0)
    force = model.predict(drive, 0.4e-3, history="demagnetised").output
    true = magnet().predict(drive, 0.4e-3).output
    assert np.abs(force - true).max() < 0.01 * true.max()
    again = model.invert(force[1:13], 0.4e-3, history="demagnetised").drive
    assert again == pytest.approx(drive[1:13], abs=1e-6)
    stepper = model.stepper(0.4e-3, "demagnetised")
    assert [stepper.commit(i) for i in drive[:5]] == pytest.approx(force[:5].tolist())


def test_prediction_report_and_comparison_know_it(
    measured: Path, found: Path, tmp_path: Path
) -> None:
    forces, page = tmp_path / "force.csv", tmp_path / "page.html"
    run("predict", found, measured, "--history", "demagnetised", "--out", forces)
    assert forces.read_text().startswith("I_A,")
    run("report", found, "--out", page)
    text = page.read_text()
    assert "single play operator" in text
    assert "half-width of the play" in text
    assert "the two models compute the same" in run("diff", found, found)
