"""Use the extensions of docs/contributing.md in all commands, from a law to a board."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from anhyst.cli.app import app
from anhyst.cli.printing import printer
from anhyst.data import read_loops
from anhyst.identification import identify
from anhyst.model.actuator import Model, read_model
from anhyst.model.parameters import Parameter
from anhyst.support.numeric import FloatArray
from anhyst.support.states import Command
from anhyst.support.units import QUANTITIES
from anhyst_exchange.exporter import export_fmu
from anhyst_rigs.dashboard.serving import open_prepared
from anhyst_rigs.link import firmware
from anhyst_rigs.rig.stage.file import read_stage
from anhyst_rigs.rig.stage.fitted import identify_stage_magnet
from anhyst_rigs.study.bench import prepare_cached
from tests.docs.blocks import blocks
from tests.docs.places import fill, shell
from tests.exchange.slave import HERE, slave
from tests.exchange.test_bearing import scanned_by_axes
from tests.house.outside import PAGE, build_installed_package, installed, page_file
from tests.once import made_once
from tests.refusals import refused
from tests.repository import ROOT

GAPS = (0.3e-3, 0.5e-3)
RHO = (0.004, 0.009)
TRUE_PARAMETERS: dict[str, Parameter] = {
    "chi": 350.0,
    "r": 0.21,
    "c_H": 1.0,
    "rho": RHO,
    "c_out": 3e5,
    "out_0": 0.4,
}


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Folder for loops and models; the package of the page is installed while the module runs."""
    with installed(build_installed_package(tmp_path_factory)):
        yield tmp_path_factory.mktemp("lab")


@pytest.fixture(scope="module")
def table(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Folder with the rig of the page; its actuator is registered while the module runs."""
    with installed(build_installed_package(tmp_path_factory)):
        place = tmp_path_factory.mktemp("table")
        (place / "table.toml").write_text(page_file("table.toml"))
        yield place


def magnet() -> Model:
    return Model(
        "truth",
        QUANTITIES["current"],
        QUANTITIES["force"],
        TRUE_PARAMETERS,
        law="play",
        gap_map="reluctance",
        schedule=QUANTITIES["gap"],
        nodes=GAPS,
    )


def current_cycle(peak_current: float) -> FloatArray:
    ascending_current = np.linspace(0.0, peak_current, 13)
    return np.concatenate([ascending_current, ascending_current[-2::-1], ascending_current[1:]])


@pytest.fixture(scope="module")
def measured(lab: Path) -> Path:
    path = lab / "loops.toy"
    lines = [json.dumps(["I_A", "F_N", "gap_mm", "loop"])]
    for gap in GAPS:
        for name, largest in (("large", 3.0), ("small", 1.2)):
            drive = current_cycle(largest)
            force = magnet().predict(drive, gap).output.tolist()
            lines += [
                json.dumps([i, loop_file, 1e3 * gap, name])
                for i, loop_file in zip(drive.tolist(), force, strict=True)
            ]
    path.write_text("\n".join(lines))
    return path


def run_command(*arguments: object) -> str:
    printer.used_lines, printer.is_verbose = 0, True  # `main` starts with a new line count
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert result.exit_code == 0, result.output
    return result.output


@pytest.fixture(scope="module")
def found(measured: Path) -> Path:
    """Return the model file of the identification."""
    path = measured.with_name("model.toml")
    output = run_command("identify", measured, "--history", "demagnetised", "--law", "play",
               "--gap-map", "reluctance", "--out", path)  # fmt: skip
    assert "law 'play' cannot be compiled: there is no compensator for it" in output
    return path


def test_the_file_is_read_by_its_own_format(measured: Path) -> None:
    loops = read_loops(measured)
    assert loops.schedule_values == pytest.approx(GAPS)
    assert {loop.label for loop in loops.loops} == {"large", "small"}
    assert read_loops(measured.parent).schedule_values == loops.schedule_values


def test_the_papers_search_is_for_laws_of_the_core(measured: Path) -> None:
    with refused("choices-together search: play"):
        identify(read_loops(measured), law="play", search="paper")


@pytest.mark.slow
def test_the_law_is_identified_from_its_loops(found: Path) -> None:
    model = read_model(found)
    assert model.law == "play"
    assert model.fit is not None
    assert model.fit.rms < 1e-3 * model.fit.largest_output
    assert model.parameters["r"] == pytest.approx(TRUE_PARAMETERS["r"], rel=0.05)
    assert model.uncertainty is not None
    assert len(model.uncertainty.names) == len(model.uncertainty.std) == 7


def test_the_model_predicts_between_the_gaps_and_inverts(found: Path) -> None:
    model, drive = read_model(found), current_cycle(2.0)
    force = model.predict(drive, 0.4e-3, history="demagnetised").output
    true_force = magnet().predict(drive, 0.4e-3).output
    assert np.abs(force - true_force).max() < 0.01 * true_force.max()
    inverted_current = model.invert(force[1:13], 0.4e-3, history="demagnetised").drive
    assert inverted_current == pytest.approx(drive[1:13], abs=1e-6)
    stepper = model.stepper(0.4e-3, "demagnetised")
    assert [stepper.commit(i) for i in drive[:5]] == pytest.approx(force[:5].tolist())


@pytest.mark.slow
def test_prediction_report_and_comparison_know_it(measured: Path, found: Path, tmp_path: Path) -> None:
    forces, page = tmp_path / "force.csv", tmp_path / "page.html"
    run_command("predict", found, measured, "--history", "demagnetised", "--out", forces)
    assert forces.read_text().startswith("I_A,")
    run_command("report", found, "--out", page)
    text = page.read_text()
    assert "single play operator" in text
    assert "threshold of the play" in text
    assert "the two models give the same results" in run_command("diff", found, found)


@pytest.mark.slow
def test_the_commands_of_the_page_run_with_its_file(measured: Path) -> None:
    commands = [block.code for block in blocks(PAGE) if block.language == "sh"]
    assert len(commands) == 5
    for code in commands[:2]:
        shell(code, measured.parent)
    assert (measured.parent / "report.html").is_file()


@pytest.mark.slow
def test_the_actuator_of_the_page_is_measured_simulated_tuned_and_compiled(table: Path) -> None:
    """Three voice coils move a body in two coordinates; `full` has a third of a curve's error."""
    shell([block.code for block in blocks(PAGE) if block.language == "sh"][2], table)
    found = json.loads((table / "figures.json").read_text())
    assert found["lost_in"] == []
    average = {name: variant["test"]["average_m"]["mean"] for name, variant in found["variants"].items()}
    assert average["full"] < average["single-valued"] / 3.0
    tuned = json.loads((table / "tuned" / "tuning.json").read_text())["variants"]["full"]
    assert tuned["met"]
    output = run_command("verify", table / "controller", "--on", "host")
    assert "identical" in output
    loops = read_loops(table / "loops.csv")
    assert loops.output.name == "thrust"
    assert min(loop.output.min() for loop in loops.loops) < -50.0


def measured_table(table: Path) -> Path:
    """Return the rig of the page with measured loops."""
    if not (table / "loops.csv").is_file():
        run_command("excite", table / "table.toml", "--out", table / "loops.csv")
    return table / "table.toml"


@pytest.mark.slow
def test_the_actuator_of_the_page_is_operated_live(table: Path) -> None:
    with prepare_cached(measured_table(table), None) as prepared:
        bench, _, _ = open_prepared(prepared)
    bench.command(Command.RUN)
    rows = bench.advance(4000)
    names = ["tick", *(signal.name for signal in bench.signals)]
    bench.close()
    currents = rows[:, [names.index(name) for name in ("current", "current_2", "current_3")]]
    assert currents.min() < -0.1 < 0.1 < currents.max()
    assert np.abs(rows[2000:, names.index("error")]).max() < 2e-6


@pytest.mark.slow
def test_the_actuator_of_the_page_flies_as_an_fmu_bit_for_bit(table: Path) -> None:
    path = measured_table(table)
    magnet = identify_stage_magnet(read_stage(path))
    fmu = export_fmu(path, table / "table.fmu", platforms=[HERE])
    output_names = scanned_by_axes(fmu, path, 10.0, magnet)
    names = ("demand_x_N", "command_A", "command_3_A")
    with slave(fmu, table / "flown") as fmu_file:
        rows = np.array(fmu_file.run(output_names.inputs, names, 1e-4))
    assert output_names.recording.loss is None
    for name, values in zip(names, rows.T, strict=True):
        assert np.array_equal(values, output_names.recording[name]), name
    assert np.ptp(rows[:, 1]) > 0.3


@pytest.mark.slow
def test_the_board_of_the_page_is_built_and_driven(
    tmp_path: Path,
    tmp_path_factory: pytest.TempPathFactory,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    firmware_folder = made_once(tmp_path_factory, "what-pages-speak-of", fill)
    shutil.copytree(firmware_folder / "controller", tmp_path / "controller")
    shutil.copytree(ROOT / "firmware", tmp_path / "firmware")
    (tmp_path / "firmware" / "boards" / "desk").mkdir()
    for name in ("board_force.c", "main.c"):
        (tmp_path / "firmware/boards/desk" / name).write_text(page_file(f"firmware/boards/desk/{name}"))
    monkeypatch.setattr(firmware, "firmware_folder", lambda: tmp_path / "firmware")
    monkeypatch.setattr(firmware, "BOARDS", dict(firmware.BOARDS))
    monkeypatch.chdir(tmp_path)
    part = PAGE.partition("## A board")[2]
    code = next(block.code for block in blocks(part) if block.language == "python")
    exec(compile(code, "contributing.md", "exec"), {})
    state, drive = capsys.readouterr().out.split()
    assert state == "RUN"
    assert 0.1 < float(drive) < 1.0
