"""Even outputs are refused, and the bias of a force is found."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from anhyst.data import Loop, Loops
from anhyst.data.inspection import inspect
from anhyst.data.symmetry import describe_flux_bias, find_bias
from anhyst.support.numeric import FloatArray
from anhyst.support.units import QUANTITIES
from tests.refusals import refused

from .test_clean import play


def record(drive: FloatArray, output: FloatArray, names: tuple[str, str]) -> Loops:
    loop = Loop("1", drive, output)
    return Loops((loop,), QUANTITIES[names[0]], QUANTITIES[names[1]])


def cycles(seed: int, samples: int) -> FloatArray:
    rng = np.random.default_rng(seed)
    phase = np.linspace(0.0, rng.choice([1.0, 1.5, 3.0]), samples)
    wave = 2.0 * np.abs(2.0 * ((phase + 0.75) % 1.0) - 1.0) - 1.0
    return np.asarray(wave + rng.uniform(-0.1, 0.1))


@pytest.mark.parametrize("names", [("voltage", "displacement"), ("field", "flux_density")])
@pytest.mark.parametrize("seed", range(12))
def test_butterfly_is_refused_and_one_arm_of_it_is_read(seed: int, names: tuple[str, str]) -> None:
    rng = np.random.default_rng(seed)
    drive = cycles(seed, int(rng.choice([200, 900])))
    output = (drive + play(drive, rng.uniform(0.05, 0.4))) ** 2
    output += rng.choice([0.0, 0.01, 0.03]) * np.ptp(output) * rng.standard_normal(drive.size)
    bipolar = record(1e3 * drive, 1e-6 * output, names)
    with refused(f"output-even {names[1]}"):
        inspect(bipolar)
    if names[0] == "voltage":
        one = np.abs(drive) + 0.2
        inspect(record(1e3 * one, 1e-6 * (one + play(one, 0.1)) ** 2, names))


@pytest.mark.parametrize("shape", ["play", "exponential", "saturated", "clipped", "late"])
def test_odd_outputs_are_no_butterflies(shape: str) -> None:
    for seed in range(10):
        rng = np.random.default_rng(seed)
        drive = cycles(seed, 500)
        output = drive + rng.uniform(0.0, 2.0) * play(drive, rng.uniform(0.02, 0.4))
        output = {
            "play": output,
            "exponential": np.exp(2.0 * output),
            "saturated": np.tanh(4.0 * output),
            "clipped": np.maximum(output, 0.2),
            "late": np.roll(output, 20),
        }[shape]
        output = output + 0.02 * np.ptp(output) * rng.standard_normal(drive.size)
        inspect(record(1e3 * drive, 1e-6 * output, ("voltage", "displacement")))


@pytest.mark.parametrize("bias", [-1.3, -0.8, -0.3, 0.3, 0.8, 1.3])
def test_bias_of_a_magnet_is_found_and_the_loop_is_judged_around_it(bias: float) -> None:
    drive = 2.0 * np.sin(np.linspace(0.0, 6.0 * np.pi, 1500))
    flux = 0.7 * (drive - bias) + 0.3 * play(drive - bias, 0.15)
    force = 5.0 * flux**2 + 0.02 * np.random.default_rng(1).standard_normal(drive.size)
    measured = record(drive, force, ("current", "force"))
    assert find_bias(measured) == pytest.approx(bias, abs=0.08)
    found = inspect(measured)
    assert any(f"has its minimum at {find_bias(measured):.3g} A" in note for note in found.notes)
    assert not any("wrong direction" in text for text in found.warnings)
    # Relative to its bias, it is the loop of a magnet without a bias.
    assert found.verdict.width == pytest.approx(0.09, abs=0.03)
    assert found.verdict.single_mean_relative < 0.02


def test_force_beyond_its_bias_follows_the_sign_of_the_current() -> None:
    drive = 2.0 * np.sin(np.linspace(0.0, 6.0 * np.pi, 1500))
    measured = record(drive, (drive + 3.0) ** 2, ("current", "force"))
    assert find_bias(measured) == 0.0
    assert any("follows the sign of the current" in note for note in inspect(measured).notes)
    falling = measured.with_loops(replace(loop, input=-loop.input) for loop in measured.loops)
    assert not any("wrong direction" in text for text in inspect(falling).warnings)


def test_centred_force_has_no_bias() -> None:
    drive = 2.0 * np.sin(np.linspace(0.0, 6.0 * np.pi, 1500))
    measured = record(drive, (drive + play(drive, 0.2)) ** 2, ("current", "force"))
    assert find_bias(measured) == 0.0
    assert inspect(measured).notes == ()


def test_a_non_monotone_branch_gives_an_unknown_verdict() -> None:
    phase = np.linspace(0.0, 4.0 * np.pi, 900)
    delayed = record(np.sin(phase), np.sin(phase - 1.3), ("voltage", "displacement"))
    verdict = inspect(delayed).verdict
    assert verdict.level == "unknown"
    assert "falls and rises again" in verdict.sentences[-1]
    early = record(np.sin(phase), np.sin(phase - 0.2), ("voltage", "displacement"))
    assert inspect(early).verdict.level == "yes"


def flux_loops(seed: int, bias: float, *, is_zeroed: bool) -> Loops:
    """Return loops of flux linkage with hysteresis, noise and drift, around a biased current."""
    rng = np.random.default_rng(seed)
    ends = rng.uniform(0.5, 1.5)
    path = [0.0, ends, -ends, ends, -ends, 0.0]
    drive = np.concatenate([np.linspace(a, b, 200) for a, b in itertools.pairwise(path)])
    field = drive + bias
    output = np.tanh(field - play(field, rng.uniform(0.01, 0.1)) * rng.uniform(0.0, 0.5))
    if is_zeroed:
        output = output - output[0]
    output += np.ptp(output) * (
        0.001 * rng.standard_normal(drive.size) + rng.uniform(-0.005, 0.005) * np.linspace(0, 1, drive.size)
    )
    return record(rng.choice([-1.0, 1.0]) * 3.0 * drive, 0.1 * output, ("current", "flux_linkage"))


@pytest.mark.parametrize("seed", range(20))
def test_a_flux_linkage_without_the_flux_of_its_permanent_magnet_is_recognised(seed: int) -> None:
    """Neither a magnet without bias nor a flux linkage with a known zero is taken for one."""
    bias = float(np.random.default_rng([seed, 1]).choice([-1.0, 1.0])) * 0.8
    assert "permanent magnet" in describe_flux_bias(flux_loops(seed, bias, is_zeroed=True))
    assert not describe_flux_bias(flux_loops(seed, bias, is_zeroed=False))
    for is_zeroed in (True, False):
        assert not describe_flux_bias(flux_loops(seed, 0.0, is_zeroed=is_zeroed))
