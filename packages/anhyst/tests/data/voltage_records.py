"""Records of the voltage of coils, with irons that differ from the laws of anhyst, and the true flux."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from anhyst.support.numeric import FloatArray

RESTS = (0.0, 0.1, 0.3, 1.0)
"""Drawn durations of a rest before and after the cycles, in cycles."""


@dataclass(frozen=True)
class VoltageRecord:
    """A record of a logger, with the true flux and resistance."""

    time: FloatArray  # s
    current: FloatArray  # A
    voltage: FloatArray  # V
    flux: FloatArray  # true flux linkage, Wb
    resistance: float  # mean resistance, weighted by the heat, Ohm; zero: a sense coil

    def error(self, flux: FloatArray) -> float:
        """Return the rms error of a flux linkage in % of the largest, without a constant."""
        return 100.0 * float(np.std(flux - self.flux)) / float(np.max(np.abs(self.flux)))


def play_iron(drive: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return the flux of play operators with saturation, and an air path."""
    thresholds, weights = rng.lognormal(-3.2, 0.8, 12), rng.dirichlet(np.ones(12))
    knee, air = rng.uniform(0.3, 1.2), rng.uniform(0.02, 0.25)
    states, flux = np.zeros(12), np.empty_like(drive)
    for row, value in enumerate(drive):
        states = np.clip(states, value - thresholds, value + thresholds)
        flux[row] = (1.0 - air) * np.tanh(states / knee) @ weights + air * value
    return flux


def tellinen_iron(drive: FloatArray, rng: np.random.Generator) -> FloatArray:
    """Return the flux of Tellinen's iron, whose minor loops do not close."""
    coercive, knee, air = rng.uniform(0.01, 0.06), rng.uniform(0.3, 1.0), rng.uniform(0.05, 0.3)
    branches = {sign: np.tanh((drive + sign * coercive) / knee) + air * (drive + sign * coercive)
                for sign in (-1.0, 1.0)}  # fmt: skip
    slopes = {sign: np.cosh((drive + sign * coercive) / knee) ** -2 / knee + air for sign in (-1.0, 1.0)}
    flux = np.zeros_like(drive)
    for row in range(1, drive.size):
        step = drive[row] - drive[row - 1]
        sign = -np.sign(step) or 1.0
        distance = abs(branches[-sign][row] - flux[row - 1]) / abs(branches[1.0][row] - branches[-1.0][row])
        share = min(1.0, abs(distance) if (branches[-sign][row] - flux[row - 1]) * sign <= 0.0 else 0.0)
        flux[row] = flux[row - 1] + step * (0.02 + (slopes[sign][row] - 0.02) * share)
    return flux


def reversal_points(kind: str, low: float, rng: np.random.Generator) -> list[float]:
    """Return the reversals of a drive from 0 whose largest value is 1; ``low`` is 0 or -1."""
    cycles = [1.0, low]
    if kind == "single":
        return [0.0, *cycles, *([1.0] if low else [])]
    if kind == "equal":
        return [0.0, *cycles * int(rng.integers(2, 7))]
    if kind == "nested":
        sizes = rng.uniform(0.55, 0.8), rng.uniform(0.25, 0.5)
        return [0.0, *cycles * 2, *(p * size for size in sizes for p in cycles * 2), *cycles]
    if kind == "growing":
        return [
            0.0,
            *(p * size for size in np.linspace(0.3, 1.0, int(rng.integers(3, 6))) for p in cycles * 2),
        ]
    points = [0.0, *cycles * 2]
    for _ in range(int(rng.integers(1, 4))):
        start = rng.uniform(0.15, 0.5)
        points += [1.0, start, start + rng.uniform(0.15, 0.4), start, low]
    return [*points, *cycles]


def drive_through(points: Sequence[float], rest: float, samples: int, *, is_sine: bool) -> FloatArray:
    """Return a drive through reversals with ``samples`` per cycle, and a rest at both ends.

    Between equal points, the drive is held for half a cycle.
    """
    span, parts = float(np.ptp(points)), [np.full(1 + int(rest * samples), points[0])]
    for start, end in pairwise(points):
        count = int(samples / 2 * max(0.15, abs(end - start) / span if end != start else 1.0))
        share = np.arange(1, count + 1) / count
        parts.append(start + (end - start) * (0.5 - 0.5 * np.cos(np.pi * share) if is_sine else share))
    return np.concatenate([*parts, np.full(int(rest * samples), points[-1])])


def make_record(
    drive: FloatArray,
    rng: np.random.Generator,
    *,
    rate: float,
    ratio: float = 3.0,
    cycle: int = 1000,
    warming: float = 0.02,
    cooling: float = 0.0,
    offset: float = 5e-3,
    noise: float = 1e-3,
    bits: int = 16,
    is_sense: bool = False,
    is_play: bool = True,
) -> VoltageRecord:
    """Return the record of a drive.

    ``rate`` is the number of samples per s. ``ratio`` is R*I*T of a cycle of ``cycle`` samples over the
    largest flux linkage. ``cooling`` is the number of thermal time constants in the record.
    """
    top, largest = 10.0 ** rng.uniform(-0.3, 1.3), 10.0 ** rng.uniform(-2.0, 0.2)
    fine = np.interp(np.arange(4 * drive.size - 3) / 4.0, np.arange(drive.size), drive)
    flux = (play_iron if is_play else tellinen_iron)(fine, rng)
    flux *= largest / np.max(np.abs(flux))
    time = np.arange(drive.size) / rate
    heat = np.cumsum(drive**2 * np.exp(cooling * time / time[-1])) / np.exp(cooling * time / time[-1])
    cold = 0.0 if is_sense else ratio * largest * rate / (top * cycle)
    resistance = cold * (1.0 + warming * heat / heat.max())
    voltage = resistance * top * drive + np.gradient(flux, 0.25 / rate)[::4]
    size = float(np.max(np.abs(voltage)))
    voltage = voltage + offset + noise * size * rng.normal(size=time.size)
    current = top * (drive + noise * rng.normal(size=time.size))
    measured = []
    for values, full in ((current, top), (voltage, size)):
        resolution = 2.0 * full * rng.uniform(1.1, 2.5) / 2.0**bits
        measured.append(np.round(values / resolution) * resolution)
    mean = float(np.sum(resistance * drive**2) / np.sum(drive**2))
    return VoltageRecord(time, measured[0], measured[1], flux[::4], mean)


def draw_record(seed: int) -> VoltageRecord:
    """Return a record of a drawn drive, iron, coil and logger."""
    rng = np.random.default_rng([seed, 52])
    kind = str(rng.choice(["equal", "nested", "minor", "growing", "single"], p=[0.25, 0.3, 0.25, 0.15, 0.05]))
    low, frequency = -float(rng.random() < 0.35), 10.0 ** rng.uniform(np.log10(0.02), np.log10(5.0))
    points = [*reversal_points(kind, low, rng), *([0.0] if low else [])]
    cycle = int(np.clip(10.0 ** rng.uniform(np.log10(200.0), np.log10(50000.0)) / frequency, 60, 3000))
    drive = drive_through(points, float(rng.choice(RESTS)), cycle, is_sine=bool(rng.random() < 0.5))
    return make_record(
        drive,
        rng,
        rate=cycle * frequency,
        ratio=10.0 ** rng.uniform(-0.3, min(1.6, 0.9 - np.log10(frequency))),
        cycle=cycle,
        warming=rng.uniform(0.0, 0.05),
        cooling=float(rng.choice([0.0, 1.0, 4.0])),
        offset=rng.uniform(-0.01, 0.01),
        noise=float(rng.choice([0.0, 1e-3])),
        bits=int(rng.choice([12, 16])),
        is_sense=bool(rng.random() < 0.15),
        is_play=bool(rng.random() < 0.5),
    )
