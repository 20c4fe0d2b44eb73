"""Test the properties of every law of the core with hundreds of irons each."""

from __future__ import annotations

import numpy as np
import pytest

from anhyst import _core
from anhyst.support.numeric import FloatArray
from anhyst.support.units import MU_0

from .irons import EVERY, Sample, samples
from .sets import random_walk, sine

every_law = pytest.mark.parametrize("law", EVERY)
with_jumps = pytest.mark.parametrize("jumping", [False, True])


def status_of(sample: Sample, direction: str, given: list[float]) -> tuple[int, int]:
    """Return status and first sample without a result."""
    call = sample.core.forward if direction == "forward" else sample.core.inverse
    zero = np.zeros(len(given))
    _, _, _, status, index = call(np.array(given), zero, zero, sample.demagnetised)
    return status, index


@pytest.mark.first(1)
@every_law
@with_jumps
def test_the_inverse_of_the_forward_law_returns_the_field(law: str, jumping: bool) -> None:
    for sample in samples(law, 400, seed=181, jumping=jumping):
        drive = sine(sample.amplitude, 12, cycles=2)
        back = sample.inverse(sample.forward(drive)[0])[0]
        assert np.max(np.abs(back - drive)) < 1e-9 * sample.amplitude, sample


@pytest.mark.first(2)
@every_law
def test_the_forward_law_of_the_inverse_returns_the_flux_density_without_jumps(law: str) -> None:
    for number, sample in enumerate(samples(law, 400, seed=182)):
        top = MU_0 * sample.saturation
        demand = random_walk(0.9 * top, 12, number)
        drive, _, _ = sample.inverse(demand)
        b, _, _ = sample.forward(drive)
        assert np.max(np.abs(b - demand)) < 1e-9 * top, sample


@pytest.mark.first(1)
@every_law
def test_moving_gap_and_eddy_currents_are_undone_too(law: str) -> None:
    rng = np.random.default_rng(183)
    for number, sample in enumerate(samples(law, 300, seed=183)):
        rho = 10.0 ** rng.uniform(-4.0, -1.0) * (1.0 + 0.4 * np.sin(np.arange(18)))
        eddy = 10.0 ** rng.uniform(-5.0, -1.0) / MU_0
        shear = 1.0 + sample.saturation / sample.amplitude * float(rho[0])
        drive = random_walk(sample.amplitude * shear, 18, number)
        back = sample.inverse(sample.forward(drive, rho, eddy)[0], rho, eddy)[0]
        assert np.max(np.abs(back - drive)) < 1e-9 * np.max(np.abs(drive)), sample


# A cycle within a dead band is reversible.
@pytest.mark.first(3)
@pytest.mark.parametrize("law", [law for law in EVERY if law != "effective-field, dead band"])
@with_jumps
def test_settled_loop_area_is_positive(law: str, jumping: bool) -> None:
    for sample in samples(law, 150, seed=184, jumping=jumping):
        drive, zero = sine(sample.amplitude, 12), np.zeros(12)
        state, _, status = sample.core.settle(
            drive, zero, zero, sample.demagnetised, max_cycles=20000, tol=1e-12
        )
        assert status == 0, sample
        b, h, _ = sample.forward(drive, state=state)
        area = 0.5 * np.sum((np.roll(b, -1) - b) * (np.roll(h, -1) + h))
        assert area > 0.0, sample


@pytest.mark.first(1)
@every_law
def test_magnetisation_rises_with_the_effective_field_by_its_bound_at_most(law: str) -> None:
    for number, sample in enumerate(samples(law, 300, seed=185)):
        b, h, _ = sample.forward(random_walk(sample.amplitude, 30, number))
        m = b / MU_0 - h
        x = h + sample.alpha * m
        dm, dx = np.diff(m), np.diff(x)
        # Allowance for the rounding of M and x.
        slack = 1e-13 * (sample.saturation + sample.steepest * np.max(np.abs(x)))
        assert np.all(dm * np.sign(dx) >= -slack), sample
        assert np.all(np.abs(dm) <= sample.steepest * np.abs(dx) * (1.0 + 1e-9) + slack), sample


@pytest.mark.first(2)
@pytest.mark.parametrize("law", [law for law in EVERY if law != "effective-field, linear step"])
@with_jumps
def test_path_cut_differently_gives_the_same_end(law: str, jumping: bool) -> None:
    accuracy = 3e-6 if law == "jiles-atherton-1986" else 2e-9
    for sample in samples(law, 100, seed=186, jumping=jumping):
        corners = sample.amplitude * np.array([0.3, 1.0, -0.2, -1.0, -0.1, 0.6, 1.0, 0.2])
        starts = np.concatenate([[0.0], corners[:-1]])
        ramps = [np.linspace(p, q, 26)[1:] for p, q in zip(starts, corners, strict=True)]
        coarse = sample.forward(corners)[0]
        fine = sample.forward(np.concatenate(ramps))[0][24::25]
        np.testing.assert_allclose(fine, coarse, rtol=0, atol=accuracy * MU_0 * sample.saturation)


@every_law
def test_law_is_odd(law: str) -> None:
    for number, sample in enumerate(samples(law, 60, seed=187)):
        drive = random_walk(sample.amplitude, 20, number)
        for found, mirrored in zip(sample.forward(drive), sample.forward(-drive), strict=True):
            np.testing.assert_array_equal(mirrored, -found)


@pytest.mark.first(3)
@every_law
@with_jumps
def test_nothing_blows_up(law: str, jumping: bool) -> None:
    for number, sample in enumerate(samples(law, 150, seed=192, jumping=jumping)):
        drive = random_walk(300.0 * sample.amplitude, 12, number)
        b, h, _ = sample.forward(np.concatenate([drive, 1e-6 * drive]))
        m = b / MU_0 - h
        assert np.all(np.abs(m) <= sample.saturation * (1.0 + 1e-9) + 1e-12 * np.abs(b / MU_0)), sample


@every_law
def test_field_beyond_the_tables_is_reported_not_guessed(law: str) -> None:
    one = samples(law, 1, seed=193)[0]
    status, index = status_of(one, "forward", [100.0, 1e15, 100.0])
    assert index == 1
    assert "tables" in _core.status_text(status)


@every_law
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("direction", ["forward", "inverse"])
def test_sample_that_is_not_finite_is_reported(law: str, value: float, direction: str) -> None:
    status, index = status_of(samples(law, 1, seed=194)[0], direction, [0.1, value])
    assert status != 0
    assert index == 1


@every_law
def test_the_core_does_not_change_its_arguments(law: str) -> None:
    one = samples(law, 1, seed=195)[0]
    state: FloatArray = one.forward(random_walk(one.amplitude, 9, 1))[2]
    drive, zero = sine(one.amplitude, 12), np.zeros(12)
    before = state.copy(), drive.copy()
    one.core.forward(drive, zero, zero, state)
    np.testing.assert_array_equal(state, before[0])
    np.testing.assert_array_equal(drive, before[1])
