"""Test ``anhyst excite`` and ``anhyst watch`` in the order of their use."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from anhyst.data.reading import read_loops
from anhyst.model.actuator import read_model
from tests.cli.command import contents, quick, refused
from tests.refusals import says
from tests.repository import ROOT
from tests.study.measured_rigs import GAP_MAP, MINOR_REVERSALS, WIDE_REVERSALS, measured_rig

EXAMPLES = ROOT / "examples"
GAPS = {"bearing": "[0.35e-3, 0.45e-3, 0.55e-3]", "solenoid": "[1.0e-3, 1.35e-3, 2.0e-3, 2.8e-3]"}
ALLOWED = {"bearing": 0.005, "solenoid": 0.03}
"""Rms error at unmeasured gaps, as a fraction of the largest force."""


@pytest.mark.slow
@pytest.mark.parametrize("kind", [pytest.param("bearing", marks=pytest.mark.campaign), "solenoid"])
def test_measure_identify_compile_verify_without_a_further_flag(kind: str, tmp_path: Path) -> None:
    rig = measured_rig(kind, tmp_path, extra_lines=f"\n[excite]\ngaps_m = {GAPS[kind]}\n")
    made = quick("excite", "rig.toml", "--out", "new.csv", "--plot", "new.png", cwd=tmp_path)
    assert made.returncode == 0, made
    assert "limited by" in made.stdout
    assert (tmp_path / "new.png").read_bytes().startswith(b"\x89PNG")
    seen = json.loads(quick("inspect", "new.csv", "--json", cwd=tmp_path).stdout)
    assert {loop["history"].split(":")[0] for loop in seen["loops"]} == {"conditioned"}
    law = ("--law", "play-cells", "--gap-map", GAP_MAP[kind])
    found = quick("identify", "new.csv", "--out", "new-model.toml", *law, cwd=tmp_path)
    assert found.returncode == 0, found
    model = read_model(tmp_path / "new-model.toml")
    largest = max(rig.truth((0.0, 1.0), min(rig.campaign.gaps_m))[1])
    for turns in (WIDE_REVERSALS, MINOR_REVERSALS):
        assert rig.errors(model, turns) < ALLOWED[kind] * largest
    compiled = quick("compile", "new-model.toml", "--rate", "1e3", "--out", "c", cwd=tmp_path)
    assert compiled.returncode == 0, compiled
    verified = quick("verify", "c", "--on", "host", cwd=tmp_path)
    assert verified.returncode == 0, verified


@pytest.mark.slow
def test_loops_of_a_piezo_stage_give_a_model_of_unmeasured_loops(tmp_path: Path) -> None:
    rig = EXAMPLES / "piezo" / "rig.toml"
    made = quick("excite", rig, "--out", "new.csv", "--plot", "new.png", "--json", cwd=tmp_path)
    assert made.returncode == 0, made
    figures = json.loads(made.stdout)
    assert figures["gaps"][0]["voltage_max_V"] == 150.0
    assert figures["gaps"][0]["limited_by"] == "amplifier.high_V"
    assert quick("identify", "new.csv", "--out", "m.toml", cwd=tmp_path).returncode == 0
    unseen = read_loops(EXAMPLES / "piezo" / "unseen.csv").loops[0]
    model = read_model(tmp_path / "m.toml")
    error = model.predict(unseen.input, None, unseen.time, unseen.history).output - unseen.output
    # The best curve without memory has an error of 2.8 %.
    assert np.mean(np.abs(error)) < 0.01 * np.ptp(unseen.output)


def test_a_piezo_stage_is_not_measured_through_a_controller_of_force(tmp_path: Path) -> None:
    rig = EXAMPLES / "piezo" / "rig.toml"
    through = ("--folder", tmp_path, "--port", "COM1")
    message = refused("excite", rig, "--out", "new.csv", *through, cwd=tmp_path)
    assert says(message, "option-not-for-this --xcp")


def test_an_impossible_measurement_or_output_is_refused_in_one_line(tmp_path: Path) -> None:
    measured_rig("bearing", tmp_path, extra_lines="\n[excite]\nforce_max_N = 60.0\n")
    message = refused("excite", "rig.toml", "--out", "new.csv", cwd=tmp_path)
    assert says(message, "operating-force-not-reached load.force_N: rig.toml; 150 N")
    assert "excite.force_max_N limits it to" in message
    message = refused("excite", "rig.toml", "--out", "rig.csv", cwd=tmp_path)
    assert says(message, "writes-over-input: rig.toml")
    message = refused("excite", "rig.toml", "--out", "controller.csv", cwd=tmp_path)
    assert says(message, "not-a-sidecar: controller.toml")
    message = refused("excite", "--calibrate", "rig.toml", "-o", "run.csv", "--port", "COM1", cwd=tmp_path)
    assert says(message, "option-not-for-this --calibrate: simulated")
    message = refused("excite", "rig.toml", "--out", "new.txt", cwd=tmp_path)
    assert says(message, "wrong-ending")
    text = (tmp_path / "rig.toml").read_text()
    (tmp_path / "rig.toml").write_text(text + "continuous_A = 1.0\n")
    message = refused("excite", "rig.toml", "--out", "new.csv", cwd=tmp_path)
    assert says(message, "belong-together")


@pytest.mark.slow
def test_a_stage_is_calibrated_on_the_move_that_was_flown_for_it(tmp_path: Path) -> None:
    for name in ("rig.toml", "loops.csv", "loops.toml"):
        shutil.copy(EXAMPLES / "stage" / name, tmp_path)
    rig = tmp_path / "rig.toml"
    rig.write_text(rig.read_text().replace("[loops]", '[loops]\nlaw = "effective-field"'))
    flown = quick("excite", "--calibrate", "rig.toml", "-o", "run.csv", "--plot", "m.png", cwd=tmp_path)
    assert flown.returncode == 0, flown
    assert "not identifiable: gap_zero_1_m, gap_zero_2_m" in flown.stdout
    assert "its own set-point identifies the same parameters" in flown.stdout
    assert "calibrate would reject 'full' on this motion" in flown.stderr
    assert (tmp_path / "m.png").read_bytes().startswith(b"\x89PNG")
    learnt = quick("calibrate", "rig.toml", "run.csv", "-o", "c.toml", "--json", cwd=tmp_path)
    assert learnt.returncode == 0, learnt
    assert "frozen = false" in (tmp_path / "c.toml").read_text()


def test_excite_is_repeatable_and_json_describes_it(tmp_path: Path) -> None:
    measured_rig("bearing", tmp_path, extra_lines="\n[excite]\ngaps_m = [0.4e-3]\n")
    first = quick("excite", "rig.toml", "-o", "one.csv", "--json", cwd=tmp_path)
    quick("excite", "rig.toml", "-o", "two.csv", cwd=tmp_path)
    made = contents(tmp_path)
    assert made["one.csv"] == made["two.csv"]
    assert made["one.toml"] == made["two.toml"]
    figures = json.loads(first.stdout)
    assert figures["loops"] == 4
    assert figures["limits"]["current_A"] == {"value": 4.5, "key": "amplifier.current_high_A"}


@pytest.mark.slow
def test_measured_loops_are_identified_and_monitored(tmp_path: Path) -> None:
    rig = measured_rig("solenoid", tmp_path, extra_lines="\n[excite]\ngaps_m = [1.0e-3, 1.6e-3]\n")
    assert quick("excite", "rig.toml", "--out", "two.csv", cwd=tmp_path).returncode == 0
    given = ("--law", "play-cells", "--gap-map", "reluctance", "--out", "model.toml")
    assert quick("identify", "two.csv", *given, cwd=tmp_path).returncode == 0
    magnet, rng = rig.held.magnet(), np.random.default_rng(1)
    time = np.arange(25 * 200) / 200.0
    current = 0.5 - 0.4 * np.cos(2.0 * np.pi * time)
    force = magnet.run(current, np.full(current.size, 1.3e-3))[:, 0].copy()
    force += 0.06 * rng.standard_normal(force.size)

    def record(name: str) -> None:
        rows = zip(time, current + rig.zero, force, strict=True)
        lines = [f"{t:.4f},{i:.6f},{f:.5f},0.0013" for t, i, f in rows]
        text = "\n".join(["t_s,I_A,F_N,gap_m", *lines]) + "\n"
        (tmp_path / name).write_text(text)

    record("good.csv")
    good = quick("watch", "model.toml", "good.csv", cwd=tmp_path)
    assert (good.returncode, good.stdout.strip()) == (0, "the model fits, over 23 cycles")
    force[18 * 200 :] -= 0.4
    record("bad.csv")
    bad = quick("watch", "model.toml", "bad.csv", "--json", cwd=tmp_path)
    assert bad.returncode == 1
    assert says(bad.stderr, "drifted: -0.4")
    assert json.loads(bad.stdout)["since_s"] == pytest.approx(18.0, abs=1.1)
    time, current, force = time[:1000], current[:1000], force[:1000]
    record("short.csv")
    assert says(refused("watch", "model.toml", "short.csv", cwd=tmp_path), "too-short")
