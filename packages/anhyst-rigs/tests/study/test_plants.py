"""Test random plants of stages, piezo stages and force rigs: results, table and verdict."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from anhyst.cli.app import main
from anhyst.support.kinds import file_kind
from anhyst_rigs.reports.plants import render
from anhyst_rigs.rig.drift import Drift, drifted_file, sample_drift
from anhyst_rigs.rig.kind_rules import read_rig_file
from anhyst_rigs.rig.magnet_table import MagnetTable
from anhyst_rigs.rig.piezo import PiezoRig, read_piezo_rig
from anhyst_rigs.rig.tables import SPREADS, SpreadTable
from anhyst_rigs.study.engine.monte_carlo import MonteCarlo, Plants, monte_carlo
from anhyst_rigs.study.piezo import find_inverses, first_evaluated_tick, follow_reference, make_reference
from anhyst_rigs.study.plants import force_plants, piezo_plants, stage_plants, varied_errors
from tests.refusals import refused
from tests.repository import ROOT
from tests.rig import forces
from tests.study import bearings, stages
from tests.truths import truth

EXAMPLES = ROOT / "examples"


@pytest.fixture(scope="module")
def rig() -> PiezoRig:
    return read_piezo_rig(EXAMPLES / "piezo" / "rig.toml")


@pytest.fixture(scope="module")
def plants(rig: PiezoRig) -> Plants:
    return piezo_plants(rig)


@pytest.fixture(scope="module")
def found(plants: Plants, tmp_path_factory: pytest.TempPathFactory) -> MonteCarlo:
    """Three piezo stages, run in two processes."""
    return monte_carlo(plants, tmp_path_factory.mktemp("piezo") / "p.jsonl", 3, jobs=2)


@pytest.mark.slow
def test_processes_make_no_difference_to_piezo_stages(
    plants: Plants, found: MonteCarlo, tmp_path: Path
) -> None:
    alone = monte_carlo(plants, tmp_path / "p.jsonl", 2, jobs=1)
    assert alone.drifts == found.drifts[:2]
    assert all(runs == found.runs[name][:2] for name, runs in alone.runs.items())


def test_compensation_pays_on_piezo_stages_that_have_drifted(found: MonteCarlo) -> None:
    assert found.verdict.level == "yes"
    assert max(found.values("full", "rms_m")) < min(found.values("ratio", "rms_m"))
    assert found.as_dict()["verdict"]["level"] == "yes"


@pytest.mark.slow
def test_a_piezo_stage_without_drift_is_the_one_that_is_simulated(rig: PiezoRig) -> None:
    wanted, inverse = make_reference(rig), find_inverses(rig)["full"]
    nominal = follow_reference(rig, wanted, inverse)["error_m"]
    assert drifted_file(rig.settings, Drift()) == rig.settings
    longer = drifted_file(rig.settings, Drift(stroke=0.1, creep=0.5, resonance=-0.1))
    assert longer.stack.stroke_m_per_V == pytest.approx(1.1 * rig.settings.stack.stroke_m_per_V)
    assert longer.stack.creep_shares == pytest.approx(
        [1.5 * share for share in rig.settings.stack.creep_shares]
    )
    assert longer.flexure.resonance_Hz == pytest.approx(0.9 * rig.settings.flexure.resonance_Hz)
    assert first_evaluated_tick(rig) < len(nominal)


def test_the_page_shows_every_metric_and_the_drift_of_the_worst_plant(
    found: MonteCarlo, rig: PiezoRig
) -> None:
    page = render(found, [rig.path], "anhyst simulate rig.toml")
    for text in ("deviation, rms (nm)", "Worst plants of full", "resonance", "Worth it"):
        assert text in page


@pytest.mark.slow
def test_a_stage_is_run_with_each_error_alone_and_with_all(tmp_path: Path) -> None:
    plants = stage_plants(stages.stage(), bearings.knowledge(), ("single-valued", "full"))
    found = monte_carlo(plants, tmp_path / "p.jsonl", 2, jobs=2)
    rows = found.as_dict()["variants"]["full"]["average_m"]
    cases = varied_errors(stages.stage().settings)
    assert [row["error"] for row in rows] == [*cases]
    by_error = dict(zip(cases, rows, strict=True))
    assert by_error["none"]["worst"] < by_error["all"]["worst"]
    assert by_error["Hall gain"]["worst"] == by_error["none"]["worst"]  # 'full' uses no probe
    assert found.verdict.level in {"yes", "mixed"}


@pytest.mark.slow
def test_a_force_rig_is_run_in_every_trial_of_the_stroke(tmp_path: Path) -> None:
    plants = force_plants(forces.example(), truth("solenoid-effective-field-reluctance"))
    plants = replace(plants, methods=("full", "ratio"))
    found = monte_carlo(plants, tmp_path / "p.jsonl", 2, jobs=2)
    assert {name.split("_")[0] for name in found.plants.figures[0].case_names} == {"positions", "moving"}
    for case in range(len(found.plants.figures[0].case_names)):
        own, plain = (found.values(name, "rms_N", case) for name in ("full", "ratio"))
        assert max(own) < max(plain)


def test_every_rig_kind_accepts_the_spread_keys_that_it_uses() -> None:
    for name in ("bearing", "stage", "planar", "solenoid", "piezo"):
        path = EXAMPLES / name / "rig.toml"
        file = read_rig_file(path, file_kind(path).word)
        taken = set(SPREADS[file.control.kind].keys)
        if not any(isinstance(magnet, MagnetTable) and magnet.solid for magnet in file.magnets):
            taken -= {"conductivity_percent"}
        for key in SpreadTable.model_fields:
            alone = SpreadTable.model_validate(dict.fromkeys(SpreadTable.model_fields, 0.0) | {key: 0.5})
            given = file.model_copy(update={"spread": alone})
            drawn = sample_drift(given, np.random.default_rng(1)).as_dict()
            assert bool(drawn) == (key in taken), (name, key)


def test_a_key_of_spread_that_a_kind_does_not_draw_is_refused(tmp_path: Path) -> None:
    text = (EXAMPLES / "piezo" / "rig.toml").read_text()
    (tmp_path / "rig.toml").write_text(f"{text}\n[spread]\nmass_percent = 2.0\n")
    with refused("not-for-this-kind spread.mass_percent: rig.toml"):
        read_piezo_rig(tmp_path / "rig.toml")


@pytest.mark.slow
def test_an_unstable_loop_loses_plants_and_exits_with_1(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (EXAMPLES / "piezo" / "rig.toml").read_text()
    text = text.replace("bandwidth_Hz = 100.0", "bandwidth_Hz = 1000.0")
    (tmp_path / "rig.toml").write_text(text.replace("cycles = 6", "cycles = 3"))
    out = tmp_path / "p.jsonl"
    command = ["simulate", str(tmp_path / "rig.toml"), "--out", str(out), "--monte-carlo", "2"]
    assert main(command) == 1
    figures = json.loads((tmp_path / "montecarlo.json").read_text())
    assert figures["variants"]["full"]["lost"] == 2
    assert figures["verdict"]["level"] == "unknown"
    assert "2 of 2" in capsys.readouterr().err


def test_a_seed_of_the_file_makes_other_plants(plants: Plants, rig: PiezoRig) -> None:
    assert plants.seed == rig.settings.seed
    assert replace(plants, seed=99).draw_plant(0)[0] != plants.draw_plant(0)[0]
