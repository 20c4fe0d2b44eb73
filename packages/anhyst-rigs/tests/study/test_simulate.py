"""Test ``simulate`` as a function: its files, their order, and its errors."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Iterator
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from anhyst.cli.app import main
from anhyst.compensate.methods import METHODS
from anhyst.control.position import PositionLimits
from anhyst.data.table import read_columns
from anhyst.model.writer import write_model
from anhyst.support.errors import NegativeResult
from anhyst.support.jobs import Progress
from anhyst.support.states import Command, Flag, Phase, State
from anhyst.support.units import split_header
from anhyst_rigs.reports.bearing.page import render
from anhyst_rigs.reports.bearing.subject import gather_subject
from anhyst_rigs.rig.bearing import scenario
from anhyst_rigs.rig.bearing.scenario import ScenarioBuilder
from anhyst_rigs.rig.drift import change_rig
from anhyst_rigs.rig.recording import COLUMNS, FAULT_CODE, HOVER_CODE
from anhyst_rigs.study.bearing import simulate as module
from anhyst_rigs.study.bearing.responses import STEP_FIGURES
from anhyst_rigs.study.bearing.simulate import Simulation, simulate_bearing
from tests.refusals import refused, says
from tests.repository import ROOT
from tests.study import bearings
from tests.truths import truth

SHORT = {
    "also_gaps_m = [0.42e-3, 0.48e-3]": "also_gaps_m = []",
    "heights_m = [10e-6, 20e-6, 50e-6, 100e-6]": "heights_m = [50e-6]",
    "frequency_Hz = 1.0": "frequency_Hz = 20.0",
    "noise_seeds = 20": "noise_seeds = 2",
}
STATIC = {'variant = "full"': 'variant = "single-valued"\nmodel = "model.toml"'}


def change(path: Path, changes: dict[str, str]) -> None:
    text = path.read_text()
    for old, new in changes.items():
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    path.write_text(text)


def make_folder(folder: Path) -> Path:
    """The shortened example with a controller that needs little time to fit."""
    for name in ("rig.toml", "controller.toml", "loops.csv", "loops.toml"):
        shutil.copy(bearings.EXAMPLE / name, folder)
    write_model(bearings.knowledge().model, folder / "model.toml")
    change(folder / "rig.toml", SHORT)
    change(folder / "controller.toml", STATIC)
    (folder / "out").mkdir()
    return folder


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return make_folder(tmp_path)


@pytest.fixture(autouse=True, scope="module")
def compared() -> Iterator[None]:
    """Compare the variants that need little time to fit."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "COMPARED_VARIANTS", ("ratio", "flux"))
        yield


def simulate(rig: Path, out: Path, progress: Progress | None = None) -> Simulation:
    """Simulate a bearing and write the results."""
    found = simulate_bearing(rig, out, progress=progress)
    found.save(out)
    return found


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Simulation, list[float]]:
    folder = make_folder(tmp_path_factory.mktemp("bearing"))
    done: list[float] = []
    found = simulate(
        folder / "rig.toml",
        folder / "out" / "run.csv",
        progress=lambda part, whole: done.append(part / whole),
    )
    return folder / "out", found, done


def written(folder: Path) -> set[str]:
    return {path.name for path in (folder / "out").iterdir()}


def test_it_writes_the_recording_as_a_table(run: tuple[Path, Simulation, list[float]]) -> None:
    out, found, _ = run
    table = pd.read_csv(out / "run.csv")
    assert tuple(table.columns) == COLUMNS
    assert len(table) == len(found.recording)
    for name in COLUMNS:
        np.testing.assert_array_equal(table[name].to_numpy(), found.recording[name], name)
    assert np.diff(table["t_s"]) == pytest.approx(1.0 / 20e3)
    assert table["state"].iloc[-1] == 48
    lifted = table[table["state"] == HOVER_CODE]
    assert lifted["gap_m"].between(0.41e-3, 0.49e-3).all()


def test_its_table_and_its_picture_hold_every_variant(run: tuple[Path, Simulation, list[float]]) -> None:
    _, found, _ = run
    table = found.to_dataframe()
    assert set(table["variant"]) == set(found.setups)
    assert table["overshoot_percent"].notna().all()
    assert len(found.plot(Figure().add_subplot()).lines) == len(found.step_recordings)
    assert f"controller: {found.main_variant}" in repr(found)


def test_figures_are_valid_json_with_the_returned_values(run: tuple[Path, Simulation, list[float]]) -> None:
    out, found, done = run
    text = (out / "figures.json").read_text()

    def refuse(word: str) -> None:
        raise AssertionError(f"{word} is no JSON")

    figures = json.loads(text, parse_constant=refuse)
    assert set(figures) == set(found.figures)
    assert figures["variant"] == "single-valued"
    assert figures["operating_point"]["gap_m"] == 0.45e-3
    steps: list[dict[str, Any]] = figures["steps"]
    assert [row["variant"] for row in steps] == ["ratio", "flux", "single-valued"]
    for row, cell in zip(steps, found.cells, strict=True):
        assert set(STEP_FIGURES) < set(row)
        assert (row["lost"], row["runs"]) == (0, 2)
        for name in STEP_FIGURES:
            assert row[name]["count"] == 2
            assert row[name]["mean"] == cell.figures[name].mean
    assert steps[0]["overshoot_percent"]["mean"] > steps[2]["overshoot_percent"]["mean"]
    assert set(figures["sensitivity"]) == set(figures["loop"]) == {"ratio", "flux", "single-valued"}
    assert figures["loop"]["ratio"]["stable"]
    assert figures["loop"]["flux"] is figures["loop"]["single-valued"] is None, "one loop for both"
    assert done == sorted(done)
    assert 0.0 < done[0] < done[-1] <= 1.0


def test_nothing_but_recording_and_figures_is_written(run: tuple[Path, Simulation, list[float]]) -> None:
    out, _, _ = run
    assert written(out.parent) == {"run.csv", "figures.json"}


DOCUMENT = (ROOT / "docs" / "simulate.md").read_text()


def documented(heading: str) -> dict[str, str]:
    """First and second cell of every row of the tables below a heading; names without quotes."""
    (part,) = re.findall(rf"^## {re.escape(heading)}$(.*?)(?:^## |\Z)", DOCUMENT, re.M | re.S)
    rows = [line.split("|") for line in part.splitlines() if line.startswith("| ")]
    return {row[1].strip(): row[2].strip() for row in rows}


def test_every_column_is_documented_with_its_unit() -> None:
    rows = {name.strip("`"): unit for name, unit in documented("Recording").items() if "`" in name}
    assert tuple(rows) == COLUMNS
    for name, unit in rows.items():
        _, _, ending = name.removesuffix("_per_s").partition("_")
        own = ending.rpartition("_")[2] + "/s" * name.endswith("_per_s")
        assert unit == (own if ending else ""), name


def test_every_state_phase_and_flag_is_documented() -> None:
    rows = {name: number for name, number in documented("Recording").items() if number.isdigit()}
    members = [*State, *Phase, *(flag for flag in Flag)]
    assert rows == {str(member.name): str(member.value) for member in members}


def names_in(value: Any) -> set[str]:
    """Names of all metrics, without variants."""
    if isinstance(value, list):
        return set().union(*map(names_in, value))
    if not isinstance(value, dict):
        return set()
    return {name for name in value if name not in METHODS}.union(*map(names_in, value.values()))


def test_every_metric_is_documented(run: tuple[Path, Simulation, list[float]]) -> None:
    out, _, _ = run
    figures = json.loads((out / "figures.json").read_text())
    words = {
        word
        for row in documented("figures.json").items()
        for cell in row
        for word in re.findall(r"`([\w ]+)`", cell)
    }
    repeated = {"mean", "half_width", "count", "variants"}
    found = names_in(figures) - repeated
    assert found - words == set(), "not documented"
    assert words - found - {"null"} == set(), "not there"
    for name in repeated:
        assert f"`{name}`" in DOCUMENT


@pytest.mark.slow
def test_an_unreached_time_is_null(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The position converter is too coarse to settle; the file must not contain infinity."""
    monkeypatch.setattr(module, "COMPARED_VARIANTS", ("ratio",))
    coarse = {"\nstep_m = 50e-9": "\nstep_m = 4e-6", "noise_seeds = 2": "noise_seeds = 3"}
    change(folder / "rig.toml", coarse)
    found = simulate(folder / "rig.toml", folder / "out" / "run.mat")
    figures = json.loads((folder / "out" / "figures.json").read_text())
    settling = [row["settling_time_s"]["mean"] for row in figures["steps"]]
    means = [cell.figures["settling_time_s"].mean for cell in found.cells]
    assert settling == [mean if np.isfinite(mean) else None for mean in means]
    assert None in settling
    table = read_columns(folder / "out" / "run.mat")
    names = [split_header(name)[0] for name in COLUMNS]
    assert sorted(table.source_table.header) == sorted(names)
    for name, plain in zip(COLUMNS, names, strict=True):
        column = np.asarray(table.columns[table.source_table.header.index(plain)])
        np.testing.assert_array_equal(column, found.recording[name], name)


@pytest.mark.first(1)
@pytest.mark.parametrize(
    ("old", "new", "how"),
    [
        pytest.param("damping = 1.0", "damping = 0.02", "lost", id="ringing"),
        pytest.param("bandwidth_Hz = 120.0", "bandwidth_Hz = 400.0", "lost", id="fast"),
        pytest.param("bandwidth_Hz = 120.0", "bandwidth_Hz = 3.0", "lost", id="weak"),
        pytest.param("force_high_N = 300.0", "force_high_N = 151.0", "lift", id="no reserve"),
        pytest.param("damping = 1.0", "damping = 10.0", "oscillates", id="noisy"),
    ],
)
def test_unstable_gains_are_reported_and_the_recording_is_kept(
    folder: Path, old: str, new: str, how: str
) -> None:
    change(folder / "controller.toml", {old: new})
    out = folder / "out" / "run.csv"
    with refused(f"levitation-lost: {how}; {out}", NegativeResult) as caught:
        simulate(folder / "rig.toml", out)
    assert written(folder) == {"run.csv"}
    table = pd.read_csv(out)
    assert tuple(table.columns) == COLUMNS
    time = re.search(r"at (\d+\.\d+) s", str(caught.value))
    assert time
    # The reported time is rounded to two ticks. One tick later, the armature may have left the
    # stop.
    then = table[np.abs(table["t_s"] - float(time[1])) < 1e-4]
    touches = (then["gap_m"] <= 0.35e-3) | (then["gap_m"] >= 0.55e-3)
    assert how != "lost" or (touches | (then["state"] >= FAULT_CODE)).any()


def test_a_lost_run_removes_results_of_an_earlier_run(folder: Path) -> None:
    """Figures in a folder must belong to the recording in it; otherwise they are deleted."""
    for name in ("figures.json", "report.html"):
        (folder / "out" / name).write_text("of another run")
    change(folder / "controller.toml", {"damping = 1.0": "damping = 0.02"})
    arguments = ["simulate", str(folder / "rig.toml"), "--out", str(folder / "out" / "run.csv")]
    assert main(arguments) == 1
    assert written(folder) == {"run.csv"}


SLOW = {
    "force_rate_N_per_s = 1000.0\ndetect": "force_rate_N_per_s = 200.0\ndetect",
    "detect_m = 2e-6\nspeed_m_per_s = 2e-3": "detect_m = 2e-6\nspeed_m_per_s = 1e-4",
}


@pytest.mark.slow
def test_a_slow_lift_off_is_waited_for(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A lift-off that is much slower than that of the example is not an error."""
    monkeypatch.setattr(module, "COMPARED_VARIANTS", ())
    change(folder / "controller.toml", SLOW)
    found = simulate(folder / "rig.toml", folder / "out" / "run.csv")
    hovers = bearings.hovers_from(found.recording)
    assert hovers is not None
    assert 1.5 < hovers / 20e3 < found.scenario.lift_end_tick / 20e3 < 2.7
    assert found.lost_in == []


@pytest.mark.slow
def test_a_rise_that_never_ends_is_no_fault_of_the_gains(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    change(folder / "controller.toml", SLOW)
    monkeypatch.setattr(scenario, "lift_time", lambda *_: 1.0)
    with refused("levitation-lost: 1.0000 s; speed_m_per_s", NegativeResult):
        simulate(folder / "rig.toml", folder / "out" / "run.csv")


def test_samples_that_are_rejected_are_reported_from_bad_gains(folder: Path) -> None:
    """The noise of the sensor exceeds the largest allowed step between ticks."""
    change(folder / "controller.toml", {"\nstep_m = 20e-6": "\nstep_m = 60e-9"})
    change(folder / "rig.toml", {"noise_m = 5e-9": "noise_m = 200e-9"})
    with refused("levitation-lost: rejected; 4 in a row", NegativeResult):
        simulate(folder / "rig.toml", folder / "out" / "run.csv")


@pytest.mark.parametrize("rate", [100.0, 3000.0, 20e3])
def test_commands_come_after_the_selftest_at_every_rate(rate: float) -> None:
    setup = bearings.single("single-valued")
    table = setup.controller.model_copy(update={"rate_Hz": rate})
    timing = setup.rig.settings.timing.model_copy(update={"rate_Hz": rate})
    rig = change_rig(setup.rig, {"timing": timing})
    script = ScenarioBuilder(rig, bearings.GAP).lift_off(table).build()
    marks = np.flatnonzero(script.command)
    assert list(script.command[marks]) == [Command.DEMAGNETISED, Command.LIFT]
    (selftest,) = (field.default for field in fields(PositionLimits) if field.name == "selftest")
    assert marks[0] > selftest
    assert marks[0] / rate >= 0.005 - 1e-9
    assert script.lift_end_tick == script.ticks >= 0.45 * rate


@pytest.mark.slow
def test_a_lost_controller_variant_is_a_negative_result(
    folder: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A load step exceeds the largest force: runs of steps succeed, runs of load steps fail."""
    monkeypatch.setattr(module, "COMPARED_VARIANTS", ("ratio",))
    change(folder / "rig.toml", {"forces_N = [20.0]": "forces_N = [147.0]"})
    out = folder / "out"
    arguments = ["simulate", str(folder / "rig.toml"), "--out", str(out / "run.csv")]
    assert main(arguments) == 1
    assert written(folder) == {"run.csv", "figures.json", "report.html"}
    figures = json.loads((out / "figures.json").read_text())
    assert figures["load_steps"][0]["variants"]["single-valued"]["lost"] == 2
    assert figures["lost_in"] == ["load steps of the recording", "load step of 147 N (2 runs)"]
    message = capsys.readouterr().err.splitlines()[-1]
    assert says(message, "levitation-lost")


def test_a_loop_that_is_late_is_reported(folder: Path) -> None:
    change(folder / "rig.toml", {"delay_ticks = 1.0": "delay_ticks = 8.0"})
    change(folder / "controller.toml", {"bandwidth_Hz = 120.0": "bandwidth_Hz = 250.0"})
    with refused("levitation-lost", NegativeResult):
        simulate(folder / "rig.toml", folder / "out" / "run.csv")


@pytest.mark.slow
def test_a_variant_that_cannot_be_made_is_reported(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The law of 1986 has no compensator; the report compares the others and states this."""
    model = replace(truth("bearing-jiles-atherton"), law="jiles-atherton-1986")
    write_model(model, folder / "model.toml")
    monkeypatch.setattr(module, "COMPARED_VARIANTS", ("ratio", "full"))
    found = simulate(folder / "rig.toml", folder / "out" / "run.csv")
    figures = json.loads((folder / "out" / "figures.json").read_text())
    assert [row["variant"] for row in figures["steps"]] == ["ratio", "single-valued"]
    assert set(figures["left_out"]) == {"full"}
    assert f"{folder / 'model.toml'}: law 'jiles-atherton-1986'" in figures["left_out"]["full"]
    render(gather_subject(found, "anhyst simulate"))


@pytest.mark.slow
def test_an_unstable_variant_is_reported_with_the_others(folder: Path) -> None:
    """At 50 Hz only variants that cancel the negative stiffness levitate the armature."""
    change(folder / "controller.toml", {"bandwidth_Hz = 120.0": "bandwidth_Hz = 50.0"})
    found = simulate(folder / "rig.toml", folder / "out" / "run.csv")
    figures = json.loads((folder / "out" / "figures.json").read_text())
    lost = {row["variant"]: row["lost"] for row in figures["steps"]}
    assert lost == {"ratio": 2, "flux": 0, "single-valued": 0}
    assert figures["standstill"]["ratio"] == {"lost": 2, "runs": 2}
    assert figures["sensitivity"]["ratio"] is None
    assert figures["sensitivity"]["single-valued"]["peak"] > 1.0
    assert set(found.sensitivity) == {"flux", "single-valued"}
    assert not figures["loop"]["ratio"]["stable"]
    assert found.loops["single-valued"].is_stable
    render(gather_subject(found, "anhyst simulate"))


@pytest.mark.parametrize("name", ["figures.json", "run.csv"])
def test_a_place_that_cannot_be_written_is_reported_before_the_work(folder: Path, name: str) -> None:
    (folder / "out" / name).mkdir()
    with refused(f"cannot-be-written EISDIR: {name}"):
        simulate(folder / "rig.toml", folder / "out" / "run.csv")
    assert written(folder) == {name}


@pytest.mark.parametrize("name", ["loops.csv", "flux.csv"])
def test_a_file_that_is_read_is_not_written_over(folder: Path, name: str) -> None:
    law = 'kind = "law"\nmodel = "model.toml"\nflux_table = "flux.csv"'
    change(folder / "rig.toml", {'kind = "electromagnet"': law})
    (folder / "flux.csv").write_text("here")
    before = (folder / name).read_text()
    with refused("writes-over-input"):
        simulate(folder / "rig.toml", folder / name)
    assert (folder / name).read_text() == before


@pytest.mark.slow
def test_an_interrupted_run_keeps_earlier_files(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (folder / "out" / "figures.json").write_text("before")

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("anhyst.support.atomic.json_text", stop)
    with pytest.raises(KeyboardInterrupt):
        simulate(folder / "rig.toml", folder / "out" / "run.csv")
    assert (folder / "out" / "figures.json").read_text() == "before"
    assert written(folder) == {"run.csv", "figures.json"}
