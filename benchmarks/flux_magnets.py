"""Virtual magnets, records and tests for force from flux linkage: no magnet is a law of anhyst.

Families:

- ``two-irons``: two irons of Tellinen in series, with leakage between them,
- ``fringing``: a Preisach yoke, Roters' fringing at the gap, and leakage,
- ``cone``: a conical pole and a saturating rim parallel to it,
- ``tip``: an iron of Tellinen with a saturating tip,
- ``moving-leakage``: a Preisach yoke, a linear armature, and leakage that depends on the gap,
- ``proportional``: a proportional solenoid, whose plunger enters a thin ring that saturates. It is far
  outside the class of circuits that are fitted, so its force is a test of the stated uncertainty.

Even seeds may be inspected during development; odd seeds are for the final test.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np

from anhyst.data.loops import Loop, Loops
from anhyst.data.path import History
from anhyst.support.numeric import FloatArray
from anhyst.support.units import MU_0, QUANTITIES, Quantity
from flux_circuit import Branch, Magnet, conical_pole, flat_pole, leakage_path, overlap, rim, roters_pole
from flux_irons import Iron, LosslessIron, PreisachIron, Saturation, TellinenIron

FAMILIES = ("two-irons", "fringing", "cone", "tip", "moving-leakage")
PROPORTIONAL_SEED = 1000
"""Seeds from here on are proportional solenoids."""
FORCE_RANGE = (1.0, 5000.0)  # N
CURRENT_RANGE = (1.0, 20.0)  # A
TURNS_RANGE = (50, 2000)

DRIFT_RANGE = (0.003, 0.009)
"""Drift of the flux linkage during a record, relative to the largest flux linkage."""
GAP_ZERO_RANGE = (5e-6, 10e-6)
"""Error of the zero of the gap sensor, m."""
SAMPLE_S = 0.01
SAMPLES_PER_RANGE = 140
REST_SAMPLES = 10

CONDITIONING = (0.0, 1.0, 0.0, 1.0, 0.0)
RECORD_TURNS = (0.0, 1.0, 0.0, 1.0, 0.0, 0.6, 0.2, 1.0, 0.4, 0.8, 0.0, 0.3, 0.0, 1.0, 0.0)
"""Reversal points before and in a record, relative to the largest current."""
TEST_TURNS = (0.0, 1.0, 0.0, 0.45, 0.1, 0.75, 0.3, 1.0, 0.0)
TEST_PLACES = (1.0 / 6.0, 0.5, 5.0 / 6.0)
"""Unseen gaps: position in the logarithmic range of the gaps."""


class _Draw:
    """Random values of one magnet."""

    def __init__(self, seed: int, attempt: int) -> None:
        self.rng = np.random.default_rng([20261130, seed, attempt])

    def log(self, low: float, high: float) -> float:
        return float(low * (high / low) ** self.rng.random())

    def uniform(self, low: float, high: float) -> float:
        return float(self.rng.uniform(low, high))

    def coercive_field(self) -> float:
        return self.log(20.0, 300.0)

    def saturation(self, coercive_field: float) -> Saturation:
        return Saturation(
            self.uniform(1.5, 2.1),
            30.0 + coercive_field * self.uniform(0.8, 3.0),
            self.log(1000.0, 6000.0),
            self.uniform(0.1, 0.3),
        )

    def tellinen(self, coercive_field: float) -> tuple[Callable[[], Iron], Saturation]:
        saturation = self.saturation(coercive_field)
        return (lambda: TellinenIron(saturation, coercive_field)), saturation

    def preisach(self, coercive_field: float) -> tuple[Callable[[], Iron], Saturation]:
        saturation = self.saturation(coercive_field)
        spread, growth = self.uniform(0.3, 0.7), self.uniform(0.0, 0.6)
        return (lambda: PreisachIron(saturation, coercive_field, spread, growth)), saturation

    def lossless(self) -> Callable[[], Iron]:
        saturation = self.saturation(self.coercive_field())
        return lambda: LosslessIron(saturation)


def draw_magnet(seed: int) -> Magnet:
    """Draw a magnet; the family cycles with the seed."""
    for attempt in range(100):
        family = FAMILIES[seed % len(FAMILIES)] if seed < PROPORTIONAL_SEED else "proportional"
        magnet = _draw_once(family, seed, attempt)
        force = float(magnet.run(np.linspace(0.0, magnet.current_max, 30), magnet.gap_range[0])[1][-1])
        has_force = FORCE_RANGE[0] <= force <= FORCE_RANGE[1]
        if has_force and CURRENT_RANGE[0] <= magnet.current_max <= CURRENT_RANGE[1]:
            return replace(magnet, largest_force=force)
    raise AssertionError(seed)


def _draw_once(family: str, seed: int, attempt: int) -> Magnet:
    draw = _Draw(seed, attempt)
    coercive_field = draw.coercive_field()
    is_tellinen = family in {"two-irons", "tip"} or (
        family in {"cone", "proportional"} and draw.rng.random() < 0.5
    )
    make_yoke, saturation = (draw.tellinen if is_tellinen else draw.preisach)(coercive_field)
    gap_count = 1 if family in {"cone", "tip", "proportional"} else 2
    yoke_ratio, front_ratio = draw.uniform(0.95, 1.3), draw.uniform(0.75, 1.05)
    has_front_iron = family in {"two-irons", "tip"}
    density = 0.85 * saturation.polarisation * min(front_ratio if has_front_iron else yoke_ratio, 1.0)
    pole_area = draw.log(1.5, 4000.0) * MU_0 * 2.0 / (gap_count * density**2)
    side = math.sqrt(pole_area)
    gaps = (min(draw.log(1e-4, 3e-4), 0.1 * side), max(min(draw.log(6e-4, 2e-3), 0.4 * side), 6e-4))
    joint = gap_count * draw.log(5e-6, 50e-6) / (MU_0 * pole_area)  # 1/H
    branches = _draw_branches(draw, family, side, joint, front_ratio, gaps[1])
    middle_gap = math.sqrt(gaps[0] * gaps[1])
    working = sum(branch.gap(middle_gap)[0] for branch in branches)
    growth = draw.uniform(0.2, 1.5) if family == "moving-leakage" else 0.0
    leakage = leakage_path(draw.log(0.03, 0.4) * working, growth, middle_gap)
    yoke_length = draw.uniform(4.0, 8.0) * side
    knee_flux = density * pole_area
    saturating_drive = draw.uniform(1.15, 2.5) * (
        knee_flux / sum(branch.gap(gaps[0])[0] for branch in branches)
        + joint * knee_flux
        + yoke_length * (coercive_field + 2.0 * saturation.fast_field)
    )  # A
    turns = min(max(round(saturating_drive / draw.log(*CURRENT_RANGE)), TURNS_RANGE[0]), TURNS_RANGE[1])
    return Magnet(family, seed, saturating_drive / turns, gaps, turns, make_yoke, yoke_length,
                  yoke_ratio * pole_area, branches, leakage, pole_area, gap_count)  # fmt: skip


def _draw_branches(
    draw: _Draw, family: str, side: float, joint: float, front_ratio: float, largest_gap: float
) -> tuple[Branch, ...]:
    area = side * side
    if family == "cone":
        half_angle, depth = math.radians(draw.uniform(35.0, 70.0)), draw.uniform(0.1, 0.6) * side
        rim_area, offset = draw.uniform(0.08, 0.3) * area, draw.log(1e-5, 1e-4)
        rim_gap = rim(draw.uniform(2.0, 6.0) * rim_area, offset)
        rim_branch = Branch(rim_gap, 0.0, draw.lossless(), draw.uniform(0.5, 1.5) * side, rim_area)
        return Branch(conical_pole(area, half_angle, depth), joint), rim_branch
    if family == "proportional":
        depth, clearance = draw.uniform(0.9, 1.3) * largest_gap, draw.log(0.1e-3, 0.4e-3)
        ring = overlap(math.pi * side, clearance, depth, draw.uniform(0.2, 0.5) * depth)
        ring_iron = draw.lossless(), draw.uniform(0.1, 0.4) * side, draw.uniform(0.2, 0.5) * area
        face = roters_pole(draw.uniform(0.4, 0.7) * side, draw.uniform(0.1, 0.5) * side, 1)
        return Branch(face, joint), Branch(ring, joint, *ring_iron)
    if family == "two-irons":
        make_armature, _ = draw.tellinen(draw.coercive_field())
        length = draw.uniform(2.0, 4.0) * side
        return (Branch(flat_pole(side, 2), joint, make_armature, length, front_ratio * area),)
    thickness = draw.uniform(0.1, 0.5) * side
    if family == "tip":
        length = draw.uniform(0.2, 0.8) * side
        return (Branch(roters_pole(side, thickness, 1), joint, draw.lossless(), length, front_ratio * area),)
    armature = draw.uniform(2.0, 4.0) * side / (draw.log(1000.0, 5000.0) * MU_0 * area)
    return (Branch(roters_pole(side, thickness, 2), joint + armature),)


def sweep(turns: Sequence[float] | FloatArray, samples_per_range: int = SAMPLES_PER_RANGE) -> FloatArray:
    """Return straight ramps between reversal points, with rests where a point repeats the one before."""
    pieces = [np.full(1, float(turns[0]))]
    for start, end in itertools.pairwise(turns):
        count = round(abs(end - start) * samples_per_range) or REST_SAMPLES
        pieces.append(start + (end - start) * np.arange(1, count + 1) / count)
    return np.concatenate(pieces)


def run_conditioned(
    magnet: Magnet, current: FloatArray, gap: FloatArray | float
) -> tuple[FloatArray, FloatArray]:
    """Return flux linkage, Wb, and force, N, of a drive after :data:`CONDITIONING` at its first gap."""
    before = magnet.current_max * sweep(CONDITIONING, 30)
    gaps = np.broadcast_to(np.asarray(gap, dtype=float), current.shape)
    gaps = np.concatenate([np.full(before.size, gaps[0]), gaps])
    psi, force = magnet.run(np.concatenate([before, current]), gaps)
    return psi[before.size :], force[before.size :]


def record_gaps(magnet: Magnet, gaps: int | Sequence[float] = 4) -> FloatArray:
    """Return the gaps of a measurement, m: a geometric sequence, or those that are given."""
    if isinstance(gaps, int):
        return np.geomspace(*magnet.gap_range, gaps)
    return np.asarray(gaps, dtype=float)


def gap_zero_of(seed: int) -> float:
    """Return the zero error of the gap sensor of a measurement: reading minus true gap, m."""
    rng = np.random.default_rng([20261131, seed])
    return float(rng.choice([-1.0, 1.0]) * rng.uniform(*GAP_ZERO_RANGE))


def records(
    magnet: Magnet,
    seed: int,
    gaps: int | Sequence[float] = 4,
    *,
    drift: float | None = None,
    gap_zero: float | None = None,
    noise: float = 0.001,
    zero: Literal["absolute", "unknown"] = "absolute",
) -> Loops:
    """Return loops of current and flux linkage with noise and drift at several gaps.

    Parameters
    ----------
    magnet, seed
        The magnet, and the seed of the errors of this measurement.
    gaps
        Number of gaps in a geometric sequence, or the true gaps, m.
    drift
        Drift during a record, relative to the largest flux linkage; ``None`` draws value and sign for
        each record from :data:`DRIFT_RANGE`.
    gap_zero
        Reading of the gap sensor minus true gap, m; ``None`` selects :func:`gap_zero_of` the seed.
    noise
        Standard deviation of the noise, relative to the largest flux linkage.
    zero
        ``unknown`` subtracts the remanence at the first sample of each record.
    """
    return _measure(magnet, seed, record_gaps(magnet, gaps), drift, gap_zero, noise, zero)


def force_records(
    magnet: Magnet,
    seed: int,
    gaps: int | Sequence[float] = 4,
    *,
    gap_zero: float | None = None,
    noise: float = 0.001,
) -> Loops:
    """Return loops of current and force with noise, at the gaps and with the drive of `records`."""
    return _measure(magnet, seed, record_gaps(magnet, gaps), 0.0, gap_zero, noise, None)


def _measure(
    magnet: Magnet,
    seed: int,
    gaps: FloatArray,
    drift: float | None,
    gap_zero: float | None,
    noise: float,
    zero: Literal["absolute", "unknown"] | None,
) -> Loops:
    """Return loops of flux linkage, or of force if there is no ``zero``."""
    rng = np.random.default_rng([20261132, seed])
    offset = gap_zero_of(seed) if gap_zero is None else gap_zero
    turns = [RECORD_TURNS[0], *RECORD_TURNS[:5], *RECORD_TURNS[4:], RECORD_TURNS[-1]]
    current = magnet.current_max * sweep(turns)
    time = SAMPLE_S * np.arange(current.size, dtype=float)
    output: Quantity = QUANTITIES["force" if zero is None else "flux_linkage"]
    true_outputs = [run_conditioned(magnet, current, float(gap))[zero is None] for gap in gaps]
    scale = max(float(np.max(np.abs(values))) for values in true_outputs)
    history = History.of([magnet.current_max * point for point in CONDITIONING])
    loops: list[Loop] = []
    for gap, values in zip(gaps.tolist(), true_outputs, strict=True):
        drawn_drift = float(rng.choice([-1.0, 1.0]) * rng.uniform(*DRIFT_RANGE))
        slope = (drawn_drift if drift is None else drift) * scale / time[-1]
        measured: FloatArray = values + slope * time + noise * scale * rng.standard_normal(time.size)
        if zero == "unknown":
            measured -= values[0]
        schedule = np.full(time.size, gap + offset)
        loops.append(Loop(f"gap-{len(loops) + 1}", current, measured, schedule, time, history))
    return Loops(tuple(loops), QUANTITIES["current"], output, QUANTITIES["gap"])


class UnseenDrive(NamedTuple):
    """A drive with the true response of a magnet."""

    name: str
    current: FloatArray  # A
    gap: FloatArray  # reading of the gap sensor, m
    conditioning: tuple[float, ...]  # reversal points of the current before the drive, A
    psi: FloatArray  # Wb
    force: FloatArray  # N

    @property
    def moves(self) -> bool:
        """Whether the gap changes during the drive."""
        return bool(np.ptp(self.gap) > 0.0)


def tests(magnet: Magnet, gap_zero: float = 0.0) -> list[UnseenDrive]:  # noqa: PT028 # not a test of pytest
    """Return loops and random drives at three unseen gaps, and random drives with a moving gap.

    ``gap_zero`` is the reading of the gap sensor in use minus the true gap, m.
    """
    rng = np.random.default_rng([20261133, magnet.seed])
    low, high = magnet.gap_range
    drives: list[tuple[str, FloatArray, FloatArray]] = []
    for number, place in enumerate(TEST_PLACES, 1):
        for kind, turns in (("loops", TEST_TURNS), ("random", (0.0, *rng.random(10), 0.0))):
            current = sweep(turns, 80)
            drives.append((f"{kind}-{number}", current, np.full(current.size, low * (high / low) ** place)))
    for number in (1, 2):
        current = sweep((0.0, *rng.random(12), 0.0), 80)
        phase = np.linspace(0.0, 2.0 * np.pi, current.size)
        slow, fast = rng.uniform(1.0, 3.0) * phase, rng.uniform(3.0, 7.0) * phase + rng.uniform(0.0, 6.0)
        places = 0.5 + 0.22 * np.sin(slow) + 0.22 * np.sin(fast)
        drives.append((f"moving-{number}", current, low * (high / low) ** places))
    conditioning = tuple(magnet.current_max * point for point in CONDITIONING)
    found = []
    for name, share, gap in drives:
        current = magnet.current_max * share
        psi, force = run_conditioned(magnet, current, gap)
        found.append(UnseenDrive(name, current, gap + gap_zero, conditioning, psi, force))
    return found
