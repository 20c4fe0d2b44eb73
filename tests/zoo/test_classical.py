"""Test that each classical model of the benchmark recovers data made by its own equations."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import pytest

if TYPE_CHECKING:  # mypy reads the folder of benchmarks as a root of its own
    from zoo.model import Factory, Model
    from zoo.models import (
        bouc_wen,
        jiles_atherton,
        prandtl_ishlinskii,
        preisach_nnls,
        single_valued,
        state_space,
    )
    from zoo.models._over_schedule import OverSchedule
    from zoo.records import FloatArray, Record
else:
    from benchmarks.zoo.models import (
        bouc_wen,
        jiles_atherton,
        prandtl_ishlinskii,
        preisach_nnls,
        single_valued,
        state_space,
    )
    from benchmarks.zoo.models._over_schedule import OverSchedule
    from benchmarks.zoo.records import Record

Law = Callable[["Record"], "FloatArray"]
SAMPLES = 160


def cycle(name: str, amplitude: float) -> Record:
    """Return a settled cycle without an output."""
    u = amplitude * np.sin(2.0 * np.pi * np.arange(SAMPLES) / SAMPLES)
    return Record(name, u, np.full(SAMPLES, np.nan))


def meander(name: str, seed: int) -> Record:
    """Return a record from rest with random reversals."""
    rng = np.random.default_rng(seed)
    points = np.concatenate([[0.0], 3.0 * rng.uniform(-1.0, 1.0, 14)])
    travel = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(points)))])
    u = np.interp(np.linspace(0.0, travel[-1], 500), travel, points)
    return Record(name, u, np.full(u.size, np.nan), history="demagnetised")


def with_output(law: Law, records: Sequence[Record]) -> list[Record]:
    return [replace(record, output=law(record)) for record in records]


def make_records(law: Law) -> tuple[list[Record], list[Record]]:
    """Return training and test records of a law."""
    training = [cycle("large", 3.0), cycle("middle", 1.5), cycle("small", 0.6), meander("training", 1)]
    return with_output(law, training), with_output(law, [cycle("between", 2.2), meander("test", 2)])


def relative_error(model: Model, records: Sequence[Record]) -> float:
    """Return the rms error relative to the standard deviation of the output."""
    residual = np.concatenate([model.predict(record.without_output()) - record.output for record in records])
    output = np.concatenate([record.output for record in records])
    return float(np.sqrt(np.mean(residual**2)) / np.std(output))


def preisach(record: Record) -> FloatArray:
    """Integrate relays whose thresholds are spread over a Gaussian density."""
    rng = np.random.default_rng(3)
    centre, half_width = rng.normal(0.0, 0.4, 8000), np.abs(rng.normal(0.8, 0.3, 8000))
    state = np.where(centre > 0.0, -1.0, 1.0)
    output = []
    for u in record.path.input:
        state[u >= centre + half_width] = 1.0
        state[u <= centre - half_width] = -1.0
        output.append(float(np.mean(state)))
    return record.path.cut(np.array(output) + 0.1 * record.path.input)


def plays(record: Record) -> FloatArray:
    """Return weighted plays after a saturating output."""
    thresholds, weights = np.array([0.1, 0.3, 0.6, 1.0, 1.5]), np.array([0.3, 0.3, 0.2, 0.1, 0.1])
    state = np.zeros(5)
    output = []
    for u in record.path.input:
        state = np.clip(state, u - thresholds, u + thresholds)
        output.append(float(np.tanh(weights @ state)))
    return record.path.cut(np.array(output))


def jiles(record: Record) -> FloatArray:
    """Integrate the Jiles-Atherton equations with small steps."""
    m, field, output = 0.0, 0.0, []
    for target in record.path.input:
        for h in np.linspace(field, target, 6)[1:]:
            q = (h + 0.3 * m) / 0.5
            langevin = 1.0 / np.tanh(q) - 1.0 / q if abs(q) > 1e-3 else q / 3.0
            slope = 1.0 - 1.0 / np.tanh(q) ** 2 + 1.0 / q**2 if abs(q) > 1e-2 else 1.0 / 3.0
            sign = np.sign(h - field)
            rise = max(sign * (langevin - m), 0.0) / 0.4 + 0.2 * slope / 0.5
            m += (h - field) * rise / (1.0 - 0.3 * rise)
            field = h
        output.append(m)
    return record.path.cut(1.3 * np.array(output) + 0.05 * record.path.input)


def bouc(record: Record) -> FloatArray:
    """Integrate the Bouc-Wen equation with small steps."""
    z, position, output = 0.0, 0.0, []
    for target in record.path.input:
        step = (target - position) / 10.0
        for _ in range(10):
            z += step / 0.5 * (1.0 - abs(z) ** 1.5 * (0.7 * np.sign(z * step) + 0.3))
        position = target
        output.append(z)
    return record.path.cut(np.array(output) + 0.4 * record.path.input)


LAWS: dict[str, tuple[Mapping[str, Factory], Law, float]] = {
    "Preisach, NNLS": (preisach_nnls.MODELS, preisach, 0.02),
    "Prandtl-Ishlinskii": (prandtl_ishlinskii.MODELS, plays, 0.01),
    "Jiles-Atherton": (jiles_atherton.MODELS, jiles, 0.03),
    "Bouc-Wen": (bouc_wen.MODELS, bouc, 0.01),
}


@pytest.mark.parametrize("name", LAWS)
def test_model_recovers_its_own_law(name: str) -> None:
    models, law, limit = LAWS[name]
    training, test = make_records(law)
    model = models[name]()
    model.fit(training)
    assert relative_error(model, test) < limit
    assert model.n_parameters() > 5
    settled = model.predict(test[0].without_output())
    step = np.max(np.abs(np.diff(settled)))
    assert abs(settled[0] - settled[-1]) < 1.5 * step  # the cycle is closed


def test_single_valued_curve_recovers_a_curve() -> None:
    training, test = make_records(lambda record: np.tanh(record.input))
    model = single_valued.MODELS["single-valued curve"]()
    model.fit(training)
    assert relative_error(model, test) < 1e-3


def test_state_space_recovers_a_linear_system() -> None:
    def law(record: Record) -> FloatArray:
        y = np.zeros(record.path.input.size)
        for index in range(2, y.size):
            y[index] = 1.5 * y[index - 1] - 0.7 * y[index - 2] + 0.2 * record.path.input[index - 1]
        return record.path.cut(y + 0.3)

    training, test = make_records(law)
    model = state_space.MODELS["linear state space"]()
    model.fit(training)
    assert relative_error(model, test) < 1e-4


@pytest.mark.parametrize("gaps", [(1.0,), (1.0, 2.0), (1.0, 2.0, 3.0)])
def test_schedule_may_move(gaps: tuple[float, ...]) -> None:
    records = [
        Record(f"{gap}", u, gap * u, schedule=np.full(SAMPLES, gap))
        for gap in gaps
        for u in [cycle("", 1.0).input]
    ]
    model = OverSchedule(single_valued.SingleValued)
    model.fit(records)
    schedule = np.linspace(gaps[0], gaps[-1] + 1.0, SAMPLES)
    moving = replace(records[0], schedule=schedule)
    expected = moving.input * (schedule if len(gaps) > 1 else 1.0)
    assert np.allclose(model.predict(moving.without_output()), expected, atol=1e-4)
