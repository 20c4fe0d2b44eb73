"""Realistic files: the verdict, the exit code and the figures agree."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from anhyst.data import Loop, Loops
from anhyst.data.verdict import assess_loops
from anhyst.identification import identify
from anhyst.support.numeric import FloatArray
from anhyst.support.units import QUANTITIES
from tests.data.test_clean import play
from tests.refusals import says

from .command import quick, unwrapped


def last_line(text: str) -> str:
    return text.splitlines()[-1]


@pytest.mark.parametrize("verb", ["inspect", "identify"])
def test_butterfly_is_refused(cases: Path, tmp_path: Path, verb: str) -> None:
    out = ["-o", "model.toml"] if verb == "identify" else []
    result = quick(verb, cases / "butterfly.csv", *out, cwd=tmp_path)
    assert result.returncode == 2
    assert says(last_line(result.stderr), "output-even displacement")
    assert list(tmp_path.iterdir()) == []


def test_resonance_is_named_and_its_model_rejected(cases: Path, tmp_path: Path) -> None:
    sentence = "the output resonates near 35 Hz; measure more slowly"
    looked = quick("inspect", cases / "resonance.csv", cwd=tmp_path)
    assert looked.returncode == 0
    assert sentence in unwrapped(looked.stdout)
    assert "worth it:" not in looked.stdout
    found = quick("identify", cases / "resonance.csv", "-o", "model.toml", cwd=tmp_path)
    assert found.returncode == 1
    assert sentence in last_line(found.stderr)
    assert "the fit is complete" not in found.stdout
    assert (tmp_path / "model.toml").exists()


def test_identify_and_predict_refer_to_one_full_scale(cases: Path, tmp_path: Path) -> None:
    file = cases / "displacement_offset.csv"
    found = quick("identify", file, "-o", "model.toml", "--json", cwd=tmp_path)
    fit = json.loads(found.stdout)["fit"]
    assert fit["largest_output"] == pytest.approx(0.0196, rel=1e-3)  # the range, not the offset
    again = quick("predict", "model.toml", file, "-o", "x.csv", "--json", cwd=tmp_path)
    apart = json.loads(again.stdout)["deviation"]
    assert apart["largest"] == pytest.approx(fit["largest_output"], rel=1e-9)
    assert apart["rms"] == pytest.approx(fit["rms"], rel=0.01)
    assert apart["of"] == "the range of the displacement (0.0196 m)"


def test_voltage_of_a_coil_is_a_lag_and_its_worst_error_is_named(cases: Path, tmp_path: Path) -> None:
    looked = quick("inspect", cases / "voltage.csv", "--json", cwd=tmp_path)
    verdict = json.loads(looked.stdout)["verdict"]
    assert verdict["level"] == "unknown"
    assert "record the current instead" in verdict["sentences"][-1]
    found = quick("identify", cases / "voltage.csv", "-o", "model.toml", cwd=tmp_path)
    assert "record the current instead" in found.stderr
    assert "the fit is complete" not in found.stdout


def test_table_of_branches_in_one_direction_is_refused_and_the_remedy_works(
    cases: Path, tmp_path: Path
) -> None:
    file = cases / "first_quadrant.csv"
    result = quick("inspect", file, cwd=tmp_path)
    assert result.returncode == 2
    message = last_line(result.stderr)
    assert "reverse the order of samples 41 to 80" in message
    history = message.split("--history ")[1].split(", or")[0]
    lines = file.read_text().splitlines()
    (tmp_path / "turned.csv").write_text("\n".join([*lines[:41], *lines[:40:-1]]) + "\n")
    result = quick("inspect", "turned.csv", "--history", history, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "wrong direction" not in result.stderr


def noisy(rate: float, density: float) -> Loops:
    """Return a magnet with noise of a density in N per root of the rate in kHz."""
    time = np.arange(0.0, 3.0, 1.0 / rate)
    current = 1.0 - np.cos(2.0 * np.pi * time)
    force = 10.0 * (0.5 * current + 0.5 * play(current, 0.05)) ** 2
    sigma = density * np.sqrt(rate / 1e3)
    force += sigma * np.random.default_rng(1).standard_normal(time.size)
    loop = Loop("1", current, force, None, time)
    return Loops((loop,), QUANTITIES["current"], QUANTITIES["force"])


@pytest.mark.parametrize("density", [0.02, 0.1, 0.2])
def test_verdict_does_not_depend_on_the_sampling_rate(density: float) -> None:
    verdicts = [assess_loops(noisy(rate, density)) for rate in (1e3, 1e4, 1e5)]
    assert len({verdict.level for verdict in verdicts}) == 1
    gains = [verdict.gain for verdict in verdicts]
    assert max(gains) - min(gains) < 0.05
    # The stated noise is that of the samples.
    ratio = verdicts[2].noise_relative / verdicts[0].noise_relative
    assert ratio == pytest.approx(10.0, rel=0.2)


def test_the_same_noise_a_sample_never_lowers_the_gain_at_a_higher_rate() -> None:
    gains = [assess_loops(noisy(rate, 0.1 / np.sqrt(rate / 1e3))).gain for rate in (1e3, 1e4, 1e5)]
    assert gains[0] - 0.02 < gains[1] < gains[2] + 0.02


def displacement(output: FloatArray, drive: FloatArray) -> Loops:
    return Loops((Loop("1", drive, output),), QUANTITIES["voltage"], QUANTITIES["displacement"])


def test_noise_of_a_tenth_is_no_reason_to_reject() -> None:
    drive = 50.0 * (1.0 - np.cos(np.linspace(0.0, 8.0 * np.pi, 800)))
    clean = 1e-7 * (drive + play(drive, 5.0))
    noise = 0.1 * np.ptp(clean) * np.random.default_rng(2).standard_normal(drive.size)
    result = identify(displacement(clean + noise, drive))
    assert result.rejection == ""
    assert result.model.fit is not None
    assert result.model.fit.rms > 0.05 * result.model.fit.largest_output


def test_output_that_depends_on_more_than_its_input_is_rejected() -> None:
    phase = np.linspace(0.0, 8.0 * np.pi, 800)
    drive = 50.0 * (1.0 - np.cos(phase))
    other = 1e-7 * (drive + play(drive, 5.0)) + 2e-6 * np.sin(0.73 * phase)
    result = identify(displacement(other, drive))
    assert "do not use it" in result.rejection
    assert result.model.fit is not None
    assert "the fit is complete" not in result.model.fit.left_over


def test_unrelated_output_is_rejected() -> None:
    drive = 50.0 * (1.0 - np.cos(np.linspace(0.0, 8.0 * np.pi, 800)))
    other = 1e-6 * (np.random.default_rng(8).standard_normal(drive.size) + 0.005 * drive)
    result = identify(displacement(other, drive))
    assert "do not use it" in result.rejection
    assert result.model.fit is not None
    assert "the fit is complete" not in result.model.fit.left_over


def test_single_spike_is_named_with_its_place() -> None:
    drive = 50.0 * (1.0 - np.cos(np.linspace(0.0, 8.0 * np.pi, 800)))
    output = 1e-7 * (drive + play(drive, 5.0))
    output += 1e-3 * np.ptp(output) * np.random.default_rng(4).standard_normal(drive.size)
    output[333] += 0.3 * np.ptp(output)
    fit = identify(displacement(output, drive)).model.fit
    assert fit is not None
    assert "sample 334" in fit.left_over
    assert "the fit is complete" not in fit.left_over
