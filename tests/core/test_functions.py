"""Compare batch and sensitivities with the scalar core, differences and 50-digit arithmetic."""

from __future__ import annotations

import copy
from decimal import Decimal, localcontext

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anhyst._core import Operator, batch, batch_functions, batch_levels, demagnetised, langevin
from anhyst.support.numeric import FloatArray

Array = FloatArray


def loops(amplitude: float, samples: int, cycles: float = 1.5) -> Array:
    phase = 2.0 * np.pi * np.arange(1, int(samples * cycles) + 1) / samples
    return np.asarray(amplitude * np.sin(phase))


class ParameterSets:
    """Random parameter sets of a batch, the same in every run."""

    def __init__(self, count: int, seed: int, omega: tuple[float, float]) -> None:
        rng = np.random.default_rng(seed)
        self.kappa = 10.0 ** rng.uniform(-1.0, 1.0, count)
        self.c = rng.uniform(0.0, 1.0, count)
        self.omega = rng.uniform(*omega, count)
        self.scale = 10.0 ** rng.uniform(-0.7, 0.0, count)
        self.offset = rng.uniform(-0.1, 0.1, count)

    def run(
        self, drive: Array, *, implicit: bool = True, keep: bool = True
    ) -> tuple[Array, Array, Array, Array]:
        x, y = np.zeros(self.kappa.size), np.zeros(self.kappa.size)
        arguments = (self.kappa, self.c, self.omega, self.scale, self.offset, drive, x, y)
        m_out, x_out = batch(*arguments, implicit=implicit, keep=keep)
        return m_out, x_out, x, y

    def select_set(self, index: int) -> ParameterSets:
        selected = copy.copy(self)
        for name, values in vars(self).items():
            setattr(selected, name, values[[index]])
        return selected

    def run_scalar(self, drive: Array, index: int) -> tuple[Array, Array]:
        law = Operator(self.kappa[index], self.c[index], step="linear")
        r = self.scale[index] * (drive - self.offset[index])
        x, m, _, status, _ = law.run(np.full(r.size, self.omega[index]), r, demagnetised())
        assert status == 0
        return x, m


def test_exp_of_the_batch_is_right_to_1e_11() -> None:
    t = np.concatenate([np.logspace(-12, np.log10(680.0), 3000), np.linspace(0.0, 40.0, 2001)])
    with localcontext() as context:
        context.prec = 50
        exact_value = [(-Decimal(v)).exp() for v in t.tolist()]
        found = [Decimal(v) for v in batch_functions(t)[0].tolist()]
        error = max(abs(f / e - 1) for f, e in zip(found, exact_value, strict=True))
    assert error < Decimal("1e-11")


def test_langevin_of_the_batch_is_right_to_4_4e_9() -> None:
    t = np.concatenate([np.logspace(-9, 5, 20000), np.linspace(-60.0, 60.0, 60001)])
    assert np.max(np.abs(batch_functions(t)[1] - langevin(t)[0])) < 4.4e-9


def test_langevin_of_the_core_agrees_with_50_digits() -> None:
    z = np.concatenate([np.logspace(-6, 3, 400), np.linspace(1.3, 1.7, 101), np.linspace(20, 26, 61)])
    value, slope = (array.tolist() for array in langevin(z))
    with localcontext() as context:
        context.prec = 60
        for at, found, steepness in zip(z.tolist(), value, slope, strict=True):
            t = Decimal(at)
            e = (-2 * t).exp()
            assert abs(Decimal(found) / ((1 + e) / (1 - e) - 1 / t) - 1) < Decimal("4e-16")
            exact_value = 1 / (t * t) - 4 * e / (1 - e) ** 2
            assert abs(Decimal(steepness) / exact_value - 1) < Decimal("1.7e-15")


def test_functions_of_the_batch_are_odd_and_bounded() -> None:
    t = np.concatenate([np.logspace(-300, 30, 331), [0.0]])
    exp_minus, value = batch_functions(t)
    np.testing.assert_array_equal(batch_functions(-t)[1], -value)
    assert np.all((value >= 0.0) & (value <= 1.0))
    assert np.all((exp_minus >= 0.0) & (exp_minus <= 1.0))


def test_implicit_batch_follows_the_scalar_linear_step() -> None:
    sets = ParameterSets(150, seed=1, omega=(-1.5, 10.0))
    drive = loops(3.0, 100)
    m_out, x_out, x, _ = sets.run(drive)
    for index in range(sets.kappa.size):
        x_true, m_true = sets.run_scalar(drive, index)
        assert np.max(np.abs(m_out[:, index] - m_true)) < 1e-5
        assert np.max(np.abs(x_out[:, index] - x_true)) < 1e-4
    np.testing.assert_array_equal(x, x_out[-1])


def test_an_unavailable_instruction_set_is_refused_without_changing_states() -> None:
    sets = ParameterSets(5, seed=7, omega=(0.0, 1.0))
    x, y = np.full(5, 0.25), np.full(5, 0.125)
    arguments = (sets.kappa, sets.c, sets.omega, sets.scale, sets.offset, np.ones(3), x, y)
    for level in ("avx1024", ""):
        with pytest.raises(ValueError, match="no level"):
            batch(*arguments, level=level)
    np.testing.assert_array_equal(x, 0.25)
    assert batch_levels()[0] == "base"


def test_residual_of_the_implicit_batch_falls_with_the_step() -> None:
    sets = ParameterSets(1000, seed=2, omega=(-1.5, 10.0))
    worst, median = [], []
    for samples in (100, 200):
        drive = loops(3.0, samples)
        m_out, x_out, _, _ = sets.run(drive)
        r = sets.scale * (drive[:, None] - sets.offset)
        residual = np.max(np.abs(x_out + sets.omega * m_out - r), axis=0)
        worst.append(np.max(residual))
        median.append(np.median(residual))
    assert worst[0] < 2.5e-4
    assert worst[1] < 0.5 * worst[0]
    assert median[1] < median[0] / 8.0


def test_explicit_batch_ranks_sets_as_the_exact_one_does() -> None:
    sets = ParameterSets(400, seed=3, omega=(-1.5, 10.0))
    drive = loops(3.0, 100)
    explicit_error, _, _, _ = sets.run(drive, implicit=False)
    exact_error, _, _, _ = sets.run(drive)
    error = np.max(np.abs(explicit_error - exact_error), axis=0)
    assert np.all(np.isfinite(explicit_error))
    assert np.median(error) < 0.01
    assert np.max(error) < 0.1
    target = exact_error[:, :1]
    order = [np.argsort(np.mean((m - target) ** 2, axis=0)) for m in (explicit_error, exact_error)]
    ranks = [np.argsort(set_order) for set_order in order]
    assert np.corrcoef(ranks[0], ranks[1])[0, 1] > 0.999


def test_settling_without_keeping_leads_to_the_same_state() -> None:
    sets = ParameterSets(70, seed=4, omega=(-1.0, 5.0))
    drive = loops(3.0, 60)
    _, _, x, y = sets.run(drive)
    m_out, x_out, x_only, y_only = sets.run(drive, keep=False)
    assert m_out.size == 0
    assert x_out.size == 0
    np.testing.assert_array_equal(x, x_only)
    np.testing.assert_array_equal(y, y_only)


def test_a_set_gives_the_same_alone_and_among_others() -> None:
    sets = ParameterSets(130, seed=5, omega=(-1.0, 5.0))
    drive = loops(2.0, 50)
    results_together = sets.run(drive)[0]
    for index in (0, 63, 64, 129):
        result_alone = sets.select_set(index).run(drive)[0]
        np.testing.assert_array_equal(result_alone[:, 0], results_together[:, index])


@pytest.mark.parametrize(("name", "value"), [("kappa", 0.0), ("c", 1.5), ("omega", -3.0)])
def test_one_invalid_set_refuses_the_batch_without_changing_states(name: str, value: float) -> None:
    sets = ParameterSets(5, seed=6, omega=(0.0, 1.0))
    getattr(sets, name)[3] = value
    x, y = np.full(5, 0.25), np.full(5, 0.125)
    with pytest.raises(ValueError, match="out of range"):
        batch(sets.kappa, sets.c, sets.omega, sets.scale, sets.offset, np.ones(3), x, y)
    np.testing.assert_array_equal(x, 0.25)
    np.testing.assert_array_equal(y, 0.125)


# Parameters of a differentiated path, in this order; the drive is r = (current - offset)/scale.
PARAMETER_NAMES = ("kappa", "c", "omega", "scale", "offset", "play")


def follow_path(theta: Array, current: Array, step: str) -> Array:
    kappa, c, omega, scale, offset, play = theta.tolist()
    law = Operator(kappa, c, play, step=step)
    r = (current - offset) / scale
    _, m, _, status, _ = law.run(np.full(r.size, omega), r, demagnetised())
    assert status == 0
    return m


def analytic_derivatives(theta: Array, current: Array, step: str) -> Array:
    kappa, c, omega, scale, offset, play = theta.tolist()
    n, d = current.size, len(PARAMETER_NAMES)
    r = (current - offset) / scale
    omega_t, r_t, law_t = np.zeros((n, d)), np.zeros((n, d)), np.zeros((d, 3))
    omega_t[:, 2] = 1.0
    r_t[:, 3] = -r / scale
    r_t[:, 4] = -1.0 / scale
    law_t[0, 0] = law_t[1, 1] = law_t[5, 2] = 1.0
    law = Operator(kappa, c, play, step=step)
    found = law.sensitivity(np.full(n, omega), r, omega_t, r_t, law_t, demagnetised(), np.zeros((d, 3)))
    assert found[6] == 0
    return found[3]


@pytest.mark.parametrize("step", ["exact", "linear"])
@pytest.mark.parametrize("play", [0.0, 0.3])
def test_sensitivities_agree_with_central_differences(step: str, play: float) -> None:
    rng = np.random.default_rng(7)
    current = loops(3.0, 25, cycles=2.4)
    errors = []
    for _ in range(60):
        theta = np.array(
            [
                10.0 ** rng.uniform(-1.0, 1.0),
                rng.uniform(0.05, 0.95),
                rng.uniform(-2.0, 20.0),
                10.0 ** rng.uniform(-1.0, 0.5),
                rng.uniform(-0.3, 0.3),
                play,
            ]
        )
        found = analytic_derivatives(theta, current, step)
        for j in range(len(PARAMETER_NAMES) if play else len(PARAMETER_NAMES) - 1):
            h = 1e-6 * max(abs(theta[j]), 0.1)
            change = np.zeros(len(PARAMETER_NAMES))
            change[j] = h
            increased, decreased = (follow_path(theta + s * change, current, step) for s in (1.0, -1.0))
            difference = (increased - decreased) / (2.0 * h)
            scale = np.max(np.abs(found[:, j])) + 1e-3
            errors.append(np.max(np.abs(difference - found[:, j])) / scale)
    # In a few of the paths, a difference includes a kink (a reversal, or a play that closes).
    assert np.quantile(errors, 0.95) < 1e-6
    assert np.max(errors) < 1e-3


def test_sensitivity_runs_the_same_path_and_knows_the_initial_state() -> None:
    law = Operator(0.7, 0.2, 0.1)
    r = loops(2.0, 12)
    omega = np.full(r.size, 3.0)
    start = np.array([0.2, 0.1, 0.15])
    x, m, end_state, _, _ = law.run(omega, r, start)
    state_t = np.zeros((1, 3))
    state_t[0, 1] = 1.0
    zeros = np.zeros((r.size, 1))
    found = law.sensitivity(omega, r, zeros, zeros, np.zeros((1, 3)), start, state_t)
    np.testing.assert_array_equal(found[0], x)
    np.testing.assert_array_equal(found[1], m)
    np.testing.assert_array_equal(found[4], end_state)
    h = 1e-6
    nudge = np.array([0.0, h, 0.0])
    difference = (law.run(omega, r, start + nudge)[1] - law.run(omega, r, start - nudge)[1]) / (2 * h)
    np.testing.assert_allclose(found[3][:, 0], difference, rtol=0, atol=1e-7)


def test_the_law_of_1986_refuses_sensitivities() -> None:
    law = Operator(0.7, 0.2, law="jiles-atherton-1986")
    zeros = np.zeros((2, 1))
    found = law.sensitivity(
        np.ones(2), np.ones(2), zeros, zeros, np.zeros((1, 3)), demagnetised(), np.zeros((1, 3))
    )
    assert found[6] == -1


@settings(max_examples=60)
@given(
    kappa=st.floats(0.01, 100.0),
    c=st.floats(0.0, 1.0),
    omega=st.floats(-2.9, 1e4),
    turns=st.lists(st.floats(-50.0, 50.0), min_size=1, max_size=20),
)
def test_any_path_stays_below_saturation_and_satisfies_its_equation(
    kappa: float, c: float, omega: float, turns: list[float]
) -> None:
    r = np.array(turns) * (1.0 + max(omega, 0.0) / 50.0)
    x, m, state, status, _ = Operator(kappa, c).run(np.full(r.size, omega), r, demagnetised())
    assert status == 0
    assert np.all(np.abs(m) < 1.0)
    assert abs(state[1]) < 1.0
    scale = np.abs(x) + np.abs(np.append(0.0, x[:-1])) + np.abs(r) + abs(omega)
    assert np.all(np.abs(x + omega * m - r) <= 8 * 2.3e-16 * scale)
