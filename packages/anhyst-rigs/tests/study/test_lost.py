"""Test that an unstable or lost loop is reported first, without a verdict, with exit code 1."""

from __future__ import annotations

import math
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from anhyst.cli.app import main
from anhyst.cli.printing import printer, start_printing
from anhyst.cli.shared import print_parts
from anhyst.data.table import read_columns
from anhyst.support.errors import NegativeResult
from anhyst_rigs.reports.studies import study_output
from anhyst_rigs.reports.tracking import render, terminal_summary
from anhyst_rigs.rig.force.bench import add_lead_in
from anhyst_rigs.rig.recording import Loss, Recording, SignalBound, find_loss
from anhyst_rigs.rig.stage.loop import Feedforward, track
from anhyst_rigs.study.force_trials import ForceOutcome, ForceTrial, find_losses
from anhyst_rigs.study.tracking import simulate as tracking
from anhyst_rigs.study.tracking.measures import LOST_MEASURES, measure
from tests.cli.command import unwrapped
from tests.repository import ROOT
from tests.study import bearings, stages

EXAMPLES = ROOT / "examples"


def within(values: list[float]) -> SignalBound:
    return SignalBound("too far", np.array(values), -1.0, 1.0)


@pytest.mark.parametrize(
    ("values", "planned", "loss"),
    [
        ([0.0, 0.9, -0.9], 3, None),
        ([0.0, 1.0, 0.0], 3, Loss(1, "too far")),
        ([0.0, 0.0, math.nan], 3, Loss(2, "a value was not finite")),
        ([0.0, 0.5], 3, Loss(2, "the simulation diverged")),
        ([], 0, None),
    ],
)
def test_a_loop_is_lost_at_the_first_tick_beyond_its_bounds(
    values: list[float], planned: int, loss: Loss | None
) -> None:
    assert find_loss([within(values)], planned) == loss
    assert find_loss([within([0.0] * planned), within(values)], planned) == loss


def unstable(folder: Path) -> Path:
    """The bundled stage with short set-points and a crossover that is unstable with its delay."""
    for name in ("rig.toml", "loops.csv", "loops.toml"):
        shutil.copy(EXAMPLES / "stage" / name, folder)
    text = (folder / "rig.toml").read_text()
    for old, new in (
        ("[22.0, 10.0, 18.0, 6.0, 14.0, 22.0]", "[22.0, 18.0]"),
        ("crossover_Hz = 130.0", "crossover_Hz = 6000.0"),
    ):
        assert text.count(old) == 1
        text = text.replace(old, new)
    (folder / "rig.toml").write_text(text)
    return folder / "rig.toml"


@pytest.mark.slow
def test_an_unstable_stage_exits_with_1(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The recording is saved, older figures and reports are deleted, and there is no verdict."""
    monkeypatch.setattr(tracking, "identify_stage_magnet", lambda _: bearings.knowledge())
    rig = unstable(tmp_path)
    for name in ("figures.json", "report.html"):
        (tmp_path / name).write_text("of another run")
    assert main(["simulate", str(rig), "--out", str(tmp_path / "run.mat")]) == 1
    message = capsys.readouterr()
    assert message.out == ""
    assert "lost at 0.0" in message.err
    assert "6000 Hz" in message.err
    assert not (tmp_path / "figures.json").exists()
    assert not (tmp_path / "report.html").exists()
    table = read_columns(tmp_path / "run.mat")
    place = table.source_table.find("gap")
    assert place is not None
    gap = np.asarray(table.columns[place])
    assert gap.min() < 0.35e-3
    assert gap.max() > 0.55e-3


@pytest.mark.slow
def test_a_stage_is_lost_on_its_end_stop_though_all_stays_finite() -> None:
    made = stages.setup("full", crossover_Hz=6000.0)
    motion = stages.evaluation_set_point(made.rig)
    run = track(made, motion, Feedforward())
    assert np.isfinite(run["error_m"]).all()
    assert run.loss is not None
    assert measure(run, motion, 0.01) == LOST_MEASURES
    with pytest.raises(NegativeResult):
        tracking.refuse_unstable(made)


@pytest.mark.slow
def test_a_stage_that_holds_is_not_lost() -> None:
    assert stages.study().lost_in == []
    tracking.refuse_unstable(stages.setup("full"))


@pytest.mark.slow
def test_a_stage_that_was_lost_in_one_run_gets_no_verdict(capsys: pytest.CaptureFixture[str]) -> None:
    study = stages.study()
    own = study.variants["full"]
    once = replace(own, measures=(*own.measures[1:], LOST_MEASURES))
    lost = replace(study, variants=dict(study.variants) | {"full": once})
    assert lost.lost_in == ["test set-point (1 of 2 runs)"]
    assert lost.verdicts == {}
    assert lost.verdict.level == "unknown"
    start_printing()
    printer.is_verbose = True
    print_parts(*study_output(lost, terminal_summary(lost), "run.csv"))
    shown = unwrapped(capsys.readouterr().out)
    assert shown.startswith("lost: ")
    assert "orth it" not in shown
    assert "1 of 2 lost" in shown
    page = render(lost, "anhyst simulate rig.toml")
    assert "orth it" not in page
    assert lost.as_dict()["lost_in"] == lost.lost_in


@pytest.mark.slow
def test_a_baseline_that_was_lost_is_compared_with_nothing() -> None:
    study = stages.study()
    gone = replace(study.variants["play"], measures=(LOST_MEASURES, LOST_MEASURES))
    left = replace(study, variants=dict(study.variants) | {"play": gone})
    assert left.lost_in == []
    assert list(left.verdicts) == ["single-valued"]
    assert "'play'" not in left.verdict.text


@pytest.mark.slow
def test_an_unstable_piezo_stage_exits_with_1(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text = (EXAMPLES / "piezo" / "rig.toml").read_text()
    text = text.replace("bandwidth_Hz = 100.0", "bandwidth_Hz = 1000.0")
    (tmp_path / "rig.toml").write_text(text.replace("cycles = 6", "cycles = 3"))
    out = tmp_path / "run.mf4"
    assert main(["simulate", str(tmp_path / "rig.toml"), "--out", str(out)]) == 1
    message = capsys.readouterr()
    assert message.out.startswith("lost: ")
    assert "worth it" not in message.out
    assert "1000 Hz" in message.err
    assert read_columns(out).source_table.find("x_full") is not None


@pytest.mark.parametrize(("spoilt", "losses"), [(0.5, 0), (41.0, 1), (math.nan, 1)])
def test_a_force_off_by_the_largest_of_the_rig_is_lost(spoilt: float, losses: int) -> None:
    demand = add_lead_in("ramp", np.linspace(0.0, 30.0, 50), 500.0)
    force = demand.force.copy()
    force[-5] += spoilt
    recording = Recording({"force_N": force, "current_A": np.zeros_like(force)})
    outcome = ForceOutcome(ForceTrial("end", demand, 1e-3, "unknown", 0), {"full": recording})
    assert len(find_losses([outcome], 40.0)) == losses
