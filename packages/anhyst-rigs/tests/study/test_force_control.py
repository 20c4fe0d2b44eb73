"""Test force control from loops and models to the linked firmware and the figures."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from anhyst.cli.app import main
from anhyst.cli.printing import printer, start_printing
from anhyst.cli.shared import print_parts
from anhyst.compensate.block import Block
from anhyst.compensate.methods import MODEL_METHODS
from anhyst.compensate.plan import CompileRequest, make_plan
from anhyst.data import Loops
from anhyst.model.actuator import Model, read_model
from anhyst_rigs.link.firmware import build
from anhyst_rigs.reports import force
from anhyst_rigs.reports.force import draw_all, figure_constant_gap, figure_moving, figure_positions
from anhyst_rigs.reports.studies import study_output
from anhyst_rigs.rig.bench.force import run_firmware
from anhyst_rigs.rig.force import programs
from anhyst_rigs.rig.force.bench import ActuatorStand, add_lead_in
from anhyst_rigs.rig.force.file import read_rig
from anhyst_rigs.rig.force.programs import FirmwareSession, Program, count_differing_ticks
from anhyst_rigs.study.engine.beneficial_conditions import BENEFICIAL_CONDITIONS
from anhyst_rigs.study.force_control import ForceControl, force_control
from anhyst_rigs.study.force_trials import ForceOutcome, judge_stages, strongest_baselines
from tests.cli.command import unwrapped
from tests.refusals import says
from tests.repository import ROOT
from tests.truths import truth

EXAMPLE = ROOT / "examples" / "solenoid"
GAPS = ("0.00100", "0.00160", "0.00280")
TRIAL = """
[[case]]
kind = "held"
gaps_m = [1.3e-3]

[[case]]
kind = "force"
name = "wide"
low = 0.05
high = 0.95
period_s = 0.8
cycles = 1

[[case]]
kind = "moving"
low_m = 1.0e-3
high_m = 2.8e-3
period_s = 1.6
"""


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The bundled rig with three gaps, one position and one short demand."""
    folder = tmp_path_factory.mktemp("rig")
    for name in ("solenoid.toml", "loops.toml"):
        shutil.copy(EXAMPLE / name, folder)
    lines = (EXAMPLE / "loops.csv").read_text().splitlines()
    kept = [line for line in lines if line[0] in "#t" or line.split(",")[3] in GAPS]
    (folder / "loops.csv").write_text("\n".join(kept) + "\n")
    text = (EXAMPLE / "rig.toml").read_text()
    text = text[: text.index("[[case]]")] + TRIAL
    text = text.replace("[loops]", '[loops]\nlaw = "play-cells"')
    (folder / "rig.toml").write_text(text.replace("rate_Hz = 1000.0", "rate_Hz = 500.0"))
    return folder / "rig.toml"


def known(loops: Loops, *_: object, **__: object) -> Model:
    """The model identified from these loops."""
    return truth("solenoid-three-gaps" if len(loops.by_schedule()) > 1 else "solenoid-held")


@pytest.fixture(scope="module")
def run(small: Path, tmp_path_factory: pytest.TempPathFactory) -> ForceControl:
    demand = small.parent / "demand.csv"
    demand.write_text("t_s,F_N\n0,0\n0.2,30\n0.3,30\n0.5,8\n")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(programs, "identify_loops", known)
        result = force_control(small, tmp_path_factory.mktemp("out") / "run", demand=demand)
    draw_all(result)
    return result


@pytest.mark.slow
def test_the_firmware_agrees_with_the_simulated_program_in_every_tick(run: ForceControl) -> None:
    assert run.figures["ticks_that_differ"] == 0
    assert run.figures["firmware_ticks"] > 5_000
    for outcome in run.outcomes:
        for kind in ("full", "simplified"):
            expected, demand = outcome.simulated_force[kind], outcome.trial.demand
            error = (expected - demand.force)[demand.lead_in :]
            assert np.abs(error).max() < (0.4 if kind == "full" else 2.5)


@pytest.mark.slow
def test_its_table_and_its_picture_hold_every_controller(run: ForceControl) -> None:
    table = run.to_dataframe()
    errors = table.groupby("controller")["error_rms_N"].mean()
    assert errors["full"] < errors["single"] < errors["ratio"]
    names = run.plot(Figure().add_subplot()).get_legend_handles_labels()[1]
    assert set(names) == {"demand", *run.outcomes[0].recordings}
    assert "full: force error" in repr(run)


@pytest.mark.slow
def test_a_hysteresis_model_beats_the_best_curve_without_memory(run: ForceControl) -> None:
    summary = run.figures["summary"]
    assert set(summary) == {"end", "end_demagnetised", "positions", "moving"}
    # At a measured gap, and between gaps, which are far apart here.
    for stage, largest in (("end", 0.4), ("positions", 0.7)):
        assert summary[stage]["full"]["of_single"] < largest
        assert summary[stage]["simplified"]["of_single"] < 0.85
        assert summary[stage]["ratio"]["of_single"] > 2.0
    assert summary["end"]["full"]["of_single"] < summary["end"]["simplified"]["of_single"]


@pytest.mark.slow
def test_metrics_separate_true_error_and_noise(run: ForceControl) -> None:
    written = json.loads((run.out / "figures.json").read_text())
    assert written == json.loads(json.dumps(run.figures))
    for trial, outcome in zip(written["trials"], run.outcomes, strict=True):
        counts = slice(outcome.trial.demand.lead_in, None)
        for name, one in trial["controllers"].items():
            recording = outcome.recordings[name]
            error = (recording["force_N"] - outcome.trial.demand.force)[counts]
            assert one["true"]["worst_N"] == pytest.approx(np.abs(error).max())
            assert one["true"]["worst_percent"] == pytest.approx(np.abs(error).max() / 0.4)
            assert one["true"]["rms_N"] == pytest.approx(np.sqrt(np.mean(error**2)))
            read = (recording["force_read_N"] - outcome.trial.demand.force)[counts]
            assert one["read"]["mean_N"] == pytest.approx(np.abs(read).mean())
            assert one["read"]["worst_N"] != one["true"]["worst_N"]


@pytest.mark.slow
def test_everything_is_written(run: ForceControl) -> None:
    for name in ("fig6", "fig7", "fig8", "moving"):
        assert (run.out / f"{name}.png").read_bytes().startswith(b"\x89PNG")
        assert "<svg" in (run.out / f"{name}.svg").read_text()
    for scope in ("end", "stroke"):
        assert (run.out / scope / "full" / "controller" / "manifest.json").is_file()
    table = np.genfromtxt(run.out / "positions_1.30mm_wide.csv", delimiter=",", names=True)
    outcome = next(outcome for outcome in run.outcomes if outcome.trial.name == "positions_1.30mm_wide")
    assert table["F_full_N"] == pytest.approx(outcome.recordings["full"]["force_N"], abs=1e-5)
    assert table["t_s"][outcome.trial.demand.lead_in] == 0.0
    assert {outcome.trial.demand.name for outcome in run.outcomes} == {"wide", "file"}


@pytest.mark.slow
def test_the_verdict_names_the_strongest_baseline(
    run: ForceControl, capsys: pytest.CaptureFixture[str]
) -> None:
    found = run.figures["verdict"]
    for stage, worst in run.figures["summary"].items():
        smallest = min(one["worst_percent"] for name, one in worst.items() if name not in MODEL_METHODS)
        assert worst[found["strongest"][stage]]["worst_percent"] == smallest
    start_printing()
    printer.is_verbose = True
    print_parts(*study_output(run, force.terminal_summary(run), "run"))
    message = unwrapped(capsys.readouterr().out)
    assert found["text"] in message
    assert "strongest baseline without hysteresis model" in message
    assert "of 'best single-valued'" in message


@pytest.mark.parametrize(("full", "level"), [((2.0, 3.0), "yes"), ((7.0, 9.0), "no"),
                                             ((2.0, 9.0), "mixed")])  # fmt: skip
def test_the_verdict_follows_the_errors(full: tuple[float, float], level: str) -> None:
    summary = {
        stage: {
            "full": {"worst_percent": mine},
            "single": {"worst_percent": 6.0},
            "ratio": {"worst_percent": ratio},
        }
        for stage, mine, ratio in zip(("end", "moving"), full, (20.0, 5.0), strict=True)
    }
    judged = judge_stages(summary)
    assert judged.level == level
    assert (BENEFICIAL_CONDITIONS["force"] in judged.text) == (level != "yes")
    assert strongest_baselines(summary) == {"end": "single", "moving": "ratio"}


@pytest.mark.slow
def test_errors_are_drawn_under_every_force(run: ForceControl, small: Path) -> None:
    rig = read_rig(small)
    by_stage: dict[str, list[ForceOutcome]] = {}
    for outcome in run.outcomes:
        by_stage.setdefault(outcome.trial.trial_stage, []).append(outcome)
    for figure_of, stage in (
        (figure_constant_gap, "end"), (figure_positions, "positions"), (figure_moving, "moving"),
    ):  # fmt: skip
        axes = figure_of(rig, by_stage[stage]).axes
        forces = [ax for ax in axes if "demand" in labels(ax)]
        errors = [ax for ax in axes if "error, full" in labels(ax)]
        assert len(forces) == len(errors) >= 1
        for above, below in zip(forces, errors, strict=True):
            one, other = above.get_position(), below.get_position()
            assert other.y1 <= one.y0
            assert one.x0 == pytest.approx(other.x0, abs=0.02)
            lines = {str(line.get_label()): line for line in above.lines}
            # The demand is drawn below the measured force, with a line wide enough to be visible.
            assert lines["demand"].get_linewidth() > 2.0 * lines["measured, full"].get_linewidth()
            assert labels(above).index("demand") < labels(above).index("measured, full")


def labels(ax: Axes) -> list[str]:
    return [str(line.get_label()) for line in ax.lines]


def program_of(run: ForceControl, firmware: Path) -> Program:
    """Rebuild the program for the end of the stroke from the written files."""
    folder = run.out / "end" / "full"
    model = read_model(folder / "model.toml")
    sha = json.loads((folder / "controller" / "manifest.json").read_text())["model"]["sha256"]
    block = make_plan(model, CompileRequest("full", "q31", 500.0), int(sha[:8], 16)).block
    assert isinstance(block, Block)
    return Program("full", "full", model, block, 1, firmware)


def short_session(small: Path, program: Program, board: str) -> FirmwareSession:
    demand = add_lead_in("short", np.linspace(0.0, 30.0, 60), 500.0)
    rig = read_rig(small)
    gap = np.full(demand.force.size, 1.0e-3)
    return run_firmware(rig, program, ActuatorStand(rig, [9]), gap, demand, board, True)[1]


@pytest.mark.slow
def test_a_single_other_code_is_found(run: ForceControl, small: Path) -> None:
    program = program_of(run, run.out / "end" / "full" / "firmware")
    session = short_session(small, program, "library")
    assert count_differing_ticks(program, session) == 0
    drive = session.drive.copy()
    drive[session.first_run_tick + 30] += 1
    assert count_differing_ticks(program, replace(session, drive=drive)) == 1
    demand = session.demand.copy()
    demand[-10] += 1 << 20
    assert count_differing_ticks(program, replace(session, demand=demand)) > 0


@pytest.mark.slow
@pytest.mark.needs("qemu-system-arm")
@pytest.mark.slow
def test_an_emulated_controller_does_the_same(run: ForceControl, small: Path, tmp_path: Path) -> None:
    controller = run.out / "end" / "full" / "controller"
    program = program_of(run, build("qemu-mps2", controller, tmp_path / "firmware"))
    assert count_differing_ticks(program, short_session(small, program, "qemu-mps2")) == 0


@pytest.mark.parametrize(
    ("old", "new", "reported"),
    [
        ("end_m = 1.0e-3", "end_m = 1.1e-3", "no-such-loop: 0.0011"),
        ("force_max_N = 40.0", "force_max_N = 48.4", "force-not-reached: 48.4 N"),
        ('files = "loops.csv"', 'files = "none.csv"', "no-such-file: none.csv"),
        ("noise_N", "noise_n", "extra-forbidden: sensor[3].noise_n; noise_N"),
    ],
)
def test_a_wrong_rig_is_one_line_and_exit_code_2(
    small: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], old: str, new: str, reported: str
) -> None:
    for name in ("solenoid.toml", "loops.csv", "loops.toml"):
        shutil.copy(small.parent / name, tmp_path)
    text = small.read_text()
    assert old in text
    rig = tmp_path / "rig.toml"
    rig.write_text(text.replace(old, new, 1))
    assert main(["force-control", str(rig), "--out", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert error.startswith("anhyst: error: ")
    assert error.count("\n") == 1
    assert says(error, reported)


@pytest.mark.parametrize(
    ("text", "reported"),
    [
        ("t_s,F_N\n0,0\n1,41\n", "out-of-range"),
        ("t_s,F_N\n0,0\n200,10\n", "too-long: 200; 120"),
        ("t_s,I_A\n0,0\n1,1\n", "column-missing force"),
    ],
)
def test_a_wrong_demand_is_refused(
    small: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, reported: str
) -> None:
    demand = tmp_path / "demand.csv"
    demand.write_text(text)
    arguments = ["force-control", str(small), "--out", str(tmp_path / "out")]
    assert main([*arguments, "--demand", str(demand)]) == 2
    assert says(capsys.readouterr().err, reported)
