"""Find the outputs that an actuator can reach, and make test demands within this range.

The range is measured on the model, for currents within their limits, at several gaps. The test
demands are nested triangles, random reversals, jumps and random walks, with a fixed or a moving
gap. A fast demand is a triangle wave. The table search and the accuracy budget measure a
compensator on these paths.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anhyst.compensate.block import DemandLimits
from anhyst.model.actuator import Model
from anhyst.support.block_words import Scales
from anhyst.support.numeric import FloatArray

MAX_OUTPUT_SHARE = 0.98
"""Highest demand, as a fraction of the output range between the smallest and the largest current.
The margin above this value keeps every demand reachable."""

WALK_STEP = 0.005
"""Standard deviation of one step of a random walk, as a fraction of the range. The steps are so
small that the walk takes many of them between two reversals."""

RANGE_GAPS = 33
"""Number of gaps at which the reachable output is calculated."""

FAST_CYCLES = 3
"""Number of cycles of a fast demand."""

MAX_FAST_TICKS = 8000
"""Maximum number of ticks of a fast demand, even if the demand then has fewer cycles."""

FAST_BAND = (0.1, 0.6)
"""Lowest and highest value of a fast demand, as fractions of the static range. A fast demand needs
more current than a slow one, so the upper part of the range is not used."""


@dataclass(frozen=True)
class DemandPath:
    """A demand and a gap for each sample."""

    name: str  # short identifier, such as ``reversals``
    title: str  # description of the path for reports
    demand: FloatArray  # demand, in units of the output; shape (n,)
    # scheduling variable (gap), SI; None if the model does not need it; shape (n,)
    gap: FloatArray | None


@dataclass(frozen=True)
class OutputRange:
    """Range of the output at each gap, for currents within their limits."""

    scales: Scales
    has_gap: bool  # whether the output depends on the gap
    gaps: FloatArray  # scheduling variable (gap), SI; shape (g,)
    # lowest and highest demand, in units of the output; shape (g,)
    low: FloatArray
    high: FloatArray
    remanent: FloatArray  # output at the lowest current, after the highest current; shape (g,)

    def demand(self, fraction: FloatArray, gap: FloatArray, above_remanence: bool = False) -> FloatArray:
        """Return the demands for fractions 0..1 of the range.

        With `above_remanence`, the range starts 3 % above the output that remains at the lowest
        current.
        """
        lowest_demand = self.remanent + 0.03 * (self.high - self.remanent) if above_remanence else self.low
        low, high = (np.interp(gap, self.gaps, end) for end in (lowest_demand, self.high))
        return np.asarray(low + (high - low) * fraction)

    def paths(self, *, above_remanence: bool = False, seed: int = 1, length: int = 1) -> list[DemandPath]:
        """Return all paths on which a compensator is measured."""
        collected_paths = []
        for name, (title, fraction, gap_fraction) in _make_shapes(self.has_gap, seed, 1500 * length).items():
            gap = self.scales.gap_at(gap_fraction)
            shown_title = title if self.has_gap else title.removesuffix(", gap at rest")
            demand = self.demand(fraction, gap, above_remanence)
            collected_paths.append(DemandPath(name, shown_title, demand, gap if self.has_gap else None))
        return collected_paths

    def fast_paths(self, max_frequency: float, rate: float) -> list[DemandPath]:
        """Return triangle waves at the highest frequency of a model, and at a tenth of it.

        `max_frequency` and `rate` are in Hz. A `max_frequency` of 0 means rate/200; the limit is
        rate/20. The gap moves slowly.
        """
        max_frequency = min(max_frequency or rate / 200.0, rate / 20.0)
        collected_paths = []
        for frequency in (max_frequency, 0.1 * max_frequency):
            ticks = min(round(FAST_CYCLES * rate / frequency), MAX_FAST_TICKS)
            phase = np.arange(ticks) * frequency / rate
            fraction = 1.0 - np.abs(2.0 * (phase % 1.0) - 1.0)
            onset_factor = np.minimum(phase / 0.5, 1.0)  # start-up from zero demand
            gap = self.scales.gap_at(0.5 * (1.0 - np.cos(2.0 * np.pi * phase / FAST_CYCLES)))
            low, high = (
                FAST_BAND[0] * onset_factor,
                FAST_BAND[0] + (FAST_BAND[1] - FAST_BAND[0]) * onset_factor,
            )
            demand = self.demand(low + (high - low) * fraction, gap)
            title = f"triangles of {frequency:.3g} Hz, gap moving"
            collected_paths.append(
                DemandPath(f"fast_{frequency:.3g}", title, demand, gap if self.has_gap else None)
            )
        return collected_paths


def find_output_range(model: Model, scales: Scales, limits: DemandLimits) -> OutputRange:
    """Calculate the outputs that can be reached at each gap."""
    gaps = np.linspace(scales.gap_low, scales.gap_high, RANGE_GAPS)
    low, high = limits.current
    reversals = np.array([high, low, high, low])
    outputs = np.array([model.predict(reversals, gap, history="demagnetised").output for gap in gaps])
    span = outputs[:, 2] - outputs[:, 3]
    highest_demand = np.minimum(outputs[:, 3] + MAX_OUTPUT_SHARE * span, limits.demand[1])
    lowest_demand = np.full(RANGE_GAPS, limits.demand[0])
    if model.power == 2:  # the square of a flux is never negative
        lowest_demand = np.maximum(lowest_demand, model.interpolate_parameter("out_0", gaps))
    else:
        lowest_demand = np.maximum(lowest_demand, outputs[:, 2] - MAX_OUTPUT_SHARE * span)
    return OutputRange(scales, model.needs_schedule, gaps, lowest_demand, highest_demand, outputs[:, 3])


def _make_shapes(has_gap: bool, seed: int, size: int) -> dict[str, tuple[str, FloatArray, FloatArray]]:
    """Return the title, the demand and the gap of each path; demand and gap are fractions 0..1."""
    random = np.random.default_rng(seed)
    shapes = {
        "nested": (
            "nested loops, gap at rest",
            np.resize(_nested_triangles(), size),
            _stepped_gaps(random, size, 250),
        ),
        "reversals": (
            "random reversals, gap at rest",
            _random_reversals(random, size),
            _stepped_gaps(random, size, 200),
        ),
        "jumps": (
            "full-range jumps in one sample, gap at rest",
            _random_levels(random, size),
            _stepped_gaps(random, size, 50),
        ),
    }
    if has_gap:
        shapes["moving"] = (
            "random reversals, gap moving",
            _random_reversals(random, size),
            _random_reversals(random, size, 90.0),
        )
        shapes["moving_jumps"] = (
            "jumps of demand and gap in one sample",
            _random_levels(random, size),
            _random_levels(random, size),
        )
        shapes["walking"] = (
            "demand and gap walking together",
            _random_walk(random, size),
            _random_walk(random, size),
        )
    return shapes


def _nested_triangles() -> FloatArray:
    """Return triangles of decreasing amplitude around three mean values; 0..1."""
    reversal_levels = [0.0]
    for mean_level in (0.5, 0.2, 0.8):
        for half_size in min(mean_level, 1.0 - mean_level) * np.array([1.0, 0.75, 0.5, 0.3, 0.15, 0.05]):
            reversal_levels += [mean_level + half_size, mean_level - half_size]
    reversal_levels.append(0.0)
    positions = np.linspace(0.0, len(reversal_levels) - 1.0, 1500)
    return np.interp(positions, np.arange(len(reversal_levels)), reversal_levels)


def _random_reversals(random: np.random.Generator, size: int, mean_interval: float = 25.0) -> FloatArray:
    """Return straight lines between random levels at random times; 0..1."""
    reversal_times = np.concatenate([[0.0], np.cumsum(random.exponential(mean_interval, size))])
    levels = random.random(reversal_times.size)
    levels[0] = 0.0
    is_extreme = random.random(reversal_times.size) < 0.15
    levels[is_extreme] = np.round(levels[is_extreme])
    return np.interp(np.arange(size), reversal_times, levels)


def _random_levels(random: np.random.Generator, size: int) -> FloatArray:
    """Return a new random level at each sample; half of them are 0 or 1."""
    levels = random.random(size)
    is_extreme = random.random(size) < 0.5
    levels[is_extreme] = np.round(levels[is_extreme])
    return levels


def _random_walk(random: np.random.Generator, size: int) -> FloatArray:
    """Return a random walk that is reflected at 0 and 1."""
    walk = random.random() + np.cumsum(random.normal(0.0, WALK_STEP, size))
    return np.abs((walk + 1.0) % 2.0 - 1.0)


def _stepped_gaps(random: np.random.Generator, size: int, length: int) -> FloatArray:
    """Return fractions 0..1 of the gap range, each constant for `length` samples.

    The first two fractions are 0 and 1.
    """
    levels = random.random(-(-size // length))
    levels[:2] = 0.0, 1.0
    return np.repeat(levels, length)[:size]
