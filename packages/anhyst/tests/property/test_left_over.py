"""Test the classification of a fit's residual as noise or by its shape."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from scipy.signal import lfilter

from anhyst.model.residual_analysis import analyse_residual
from anhyst.model.residual_shapes import Residual
from anhyst.support.numeric import FloatArray

NOISE = 5e-3
Way = Callable[[FloatArray, FloatArray, float, float], FloatArray]


def record(points: list[float], samples: int, gap: int = 0, *, settled: bool = True) -> Residual:
    legs = max(1, len(points) - 1)
    drive = np.concatenate([np.linspace(a, b, samples // legs, endpoint=False) for a, b in pairwise(points)])
    measured = np.tanh(1.5 * drive) / (1.0 + 0.6 * gap)
    return Residual(drive, measured, np.zeros(drive.size), gap, settled)


def nested(samples: int) -> list[Residual]:
    return [record([-top, top, -top], samples) for top in (1.0, 0.7, 0.4)]


def over_gaps(samples: int) -> list[Residual]:
    points = [0.0, 1.0, 0.0, 0.6, 0.2, 1.0, 0.0]
    return [record(points, samples, gap, settled=False) for gap in range(3)]


def alone(samples: int) -> list[Residual]:
    return [record([-1.0, 1.0, -1.0], samples)]


SETS = {"one loop": alone, "nested loops": nested, "records over the gap": over_gaps}


def left_by(records: list[Residual], offs: list[FloatArray]) -> list[Residual]:
    """Records with these residuals of a model; the measurement contains the noise."""
    return [
        Residual(record.drive, record.measured - off, off, record.gap, record.is_cycle)
        for record, off in zip(records, offs, strict=True)
    ]


def filtered(rng: np.random.Generator, samples: int, with_last: float) -> FloatArray:
    white = np.sqrt(1.0 - with_last**2) * rng.standard_normal(samples + 100)
    return np.asarray(lfilter([1.0], [1.0, -with_last], white))[100:]


@pytest.mark.first(1)
@pytest.mark.parametrize("with_last", [0.0, 0.4, 0.7])
@pytest.mark.parametrize("kind", SETS)
def test_noise_is_called_noise(kind: str, with_last: float) -> None:
    """White noise in records of all lengths, and filtered noise in records that are long enough."""
    rng = np.random.default_rng(7)
    lengths = (24, 62, 200, 500) if with_last == 0.0 else (200, 500)
    alarms, tries = 0, 400 if with_last == 0.0 else 60
    for trial in range(tries):
        records = SETS[kind](lengths[trial % len(lengths)])
        offs = [NOISE * filtered(rng, record.drive.size, with_last) for record in records]
        alarms += not analyse_residual(left_by(records, offs), 1.0).is_noise
    assert alarms < 0.02 * tries


@pytest.mark.parametrize("digits", [2, 3, 9])
def test_rounding_is_no_shape(digits: int) -> None:
    """Coarse steps as of a converter, rounded decimals, and almost exact values."""
    for samples in (60, 150, 400):
        records = [
            Residual(
                one.drive,
                np.round(one.measured, digits),
                one.measured - np.round(one.measured, digits),
                one.gap,
                one.is_cycle,
            )
            for one in nested(samples)
        ]
        assert analyse_residual(records, 1.0).is_noise


def _shape(name: str, one: Residual, gaps: FloatArray, before: int, whole: int) -> FloatArray:
    rising = np.sign(np.diff(one.drive, append=one.drive[:1]))
    reach = float(np.abs(one.drive).max())
    arch = 1.0 - (one.drive / reach) ** 2
    first = int(np.argmax(one.drive))
    found = {
        "input": np.cos(3.0 * one.drive + 0.5),
        "direction": rising * arch,
        "gap": gaps[one.gap] * one.measured,
        "amplitude": (reach - 0.7) * arch,
        "start": np.where(
            np.arange(one.drive.size) < first, (1.0 - np.arange(one.drive.size) / first) ** 2, 0.0
        ),
        "drift": (before + np.arange(one.drive.size)) / whole - 0.5,
    }
    return np.asarray(found[name])


CASES = [
    ("input", "one loop"), ("input", "nested loops"), ("input", "records over the gap"),
    ("direction", "one loop"), ("direction", "nested loops"), ("direction", "records over the gap"),
    ("amplitude", "nested loops"), ("drift", "nested loops"), ("gap", "records over the gap"),
    ("start", "records over the gap"),
]  # fmt: skip


@pytest.mark.first(2)
@pytest.mark.parametrize(("name", "kind"), CASES)
@pytest.mark.parametrize(("size", "tries"), [(2.0, 60), (20.0, 20)])
def test_a_shape_of_twice_the_noise_is_named(name: str, kind: str, size: float, tries: int) -> None:
    rng = np.random.default_rng(11)
    right = 0
    for trial in range(tries):
        records = SETS[kind](150 if trial % 2 else 400)
        whole = sum(record.drive.size for record in records)
        gaps = rng.permutation([1.0, -0.4, -0.9])
        shapes, before = [], 0
        for one in records:
            shapes.append(_shape(name, one, gaps, before, whole))
            before += one.drive.size
        rms = np.sqrt(np.mean(np.concatenate(shapes) ** 2))
        offs = [NOISE * (rng.standard_normal(shape.size) + size * shape / rms) for shape in shapes]
        left = analyse_residual(left_by(records, offs), 1.0)
        right += bool(left.shapes) and left.shapes[0][0] == name
        assert left.beyond_noise == pytest.approx(NOISE * size, rel=0.25)
    assert right > 0.95 * tries
