"""Which outputs a magnet can reach, and the demands along which a compensator is measured."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anhyst.compensate.block import DemandLimits
from anhyst.model.actuator import Model
from anhyst.support.block_words import Scales
from anhyst.support.numeric import FloatArray

MARGIN = 0.98
"""Of the largest output that the largest current gives: a demand must be reachable to be judged."""

STEP = 0.005
"""Of a random walk, in parts of the range: many of them make the way of one reversal."""

GAPS = 33
"""Places over the gap at which it is found out what can be reached."""

CYCLES, MOST_TICKS = 3, 8000
"""Of fast demands: cycles, and ticks of all of them at most."""

BAND = (0.1, 0.6)
"""Of fast demands, in parts of what can be reached at rest: they take more current."""


@dataclass(frozen=True)
class Path:
    """A demand over a gap, sample by sample."""

    name: str  # key of the path
    title: str  # what it is, for a reader
    demand: FloatArray  # in units of the output; shape (n,)
    # scheduling variable, SI; None where the model does not need it; shape (n,)
    gap: FloatArray | None


@dataclass(frozen=True)
class Reach:
    """Range of the output at each gap, for currents within their limits."""

    scales: Scales
    moves: bool  # whether the gap matters
    gaps: FloatArray  # scheduling variable, SI; shape (g,)
    # smallest demand that is asked for, and largest, in units of the output; shape (g,)
    low: FloatArray
    high: FloatArray
    left: FloatArray  # output that the smallest current leaves after the largest; shape (g,)

    def demand(self, part: FloatArray, gap: FloatArray, lifted: bool = False) -> FloatArray:
        """Return demands at parts 0..1 of the range; `lifted` above what a current can leave."""
        bottom = self.left + 0.03 * (self.high - self.left) if lifted else self.low
        low, high = (np.interp(gap, self.gaps, end) for end in (bottom, self.high))
        return np.asarray(low + (high - low) * part)

    def paths(self, *, lifted: bool = False, seed: int = 1, length: int = 1) -> list[Path]:
        """Return everything that a compensator is measured on."""
        collected = []
        for name, (title, part, share) in _shapes(self.moves, seed, 1500 * length).items():
            gap = self.scales.gap_at(share)
            shown = title if self.moves else title.removesuffix(", gap at rest")
            demand = self.demand(part, gap, lifted)
            collected.append(Path(name, shown, demand, gap if self.moves else None))
        return collected

    def fast_paths(self, fastest: float, rate: float) -> list[Path]:
        """Return demands as fast as a model was seen to hold, and a tenth of it; the gap moves slowly."""
        fastest = min(fastest or rate / 200.0, rate / 20.0)
        collected = []
        for speed in (fastest, 0.1 * fastest):
            ticks = min(round(CYCLES * rate / speed), MOST_TICKS)
            phase = np.arange(ticks) * speed / rate
            part = 1.0 - np.abs(2.0 * (phase % 1.0) - 1.0)
            rise = np.minimum(phase / 0.5, 1.0)  # from rest
            gap = self.scales.gap_at(0.5 * (1.0 - np.cos(2.0 * np.pi * phase / CYCLES)))
            low, high = (BAND[0] * rise, BAND[0] + (BAND[1] - BAND[0]) * rise)
            demand = self.demand(low + (high - low) * part, gap)
            title = f"triangles of {speed:.3g} Hz, gap moving"
            collected.append(Path(f"fast_{speed:.3g}", title, demand, gap if self.moves else None))
        return collected


def find_reach(model: Model, scales: Scales, limits: DemandLimits) -> Reach:
    """Find out which outputs can be reached over the gap."""
    gaps = np.linspace(scales.gap_low, scales.gap_high, GAPS)
    low, high = limits.current
    turns = np.array([high, low, high, low])
    ends = np.array([model.predict(turns, gap, history="demagnetised").output for gap in gaps])
    span = ends[:, 2] - ends[:, 3]
    top = np.minimum(ends[:, 3] + MARGIN * span, limits.demand[1])
    bottom = np.full(GAPS, limits.demand[0])
    if model.power == 2:  # the square of a flux is never negative
        bottom = np.maximum(bottom, model.over_schedule("out_0", gaps))
    else:
        bottom = np.maximum(bottom, ends[:, 2] - MARGIN * span)
    return Reach(scales, model.needs_schedule, gaps, bottom, top, ends[:, 3])


def _shapes(moves: bool, seed: int, size: int) -> dict[str, tuple[str, FloatArray, FloatArray]]:
    """Return title, demand and gap of each path, both 0..1."""
    random = np.random.default_rng(seed)
    shapes = {
        "nested": (
            "nested loops, gap at rest",
            np.resize(_nested(), size),
            _at_rest(random, size, 250),
        ),
        "reversals": (
            "random reversals, gap at rest",
            _reversals(random, size),
            _at_rest(random, size, 200),
        ),
        "jumps": (
            "full-range jumps in one sample, gap at rest",
            _jumps(random, size),
            _at_rest(random, size, 50),
        ),
    }
    if moves:
        shapes["moving"] = (
            "random reversals, gap moving",
            _reversals(random, size),
            _reversals(random, size, 90.0),
        )
        shapes["moving_jumps"] = (
            "jumps of demand and gap in one sample",
            _jumps(random, size),
            _jumps(random, size),
        )
        shapes["walking"] = (
            "demand and gap walking together",
            _walk(random, size),
            _walk(random, size),
        )
    return shapes


def _nested() -> FloatArray:
    """Triangles inside each other, from zero to the largest and around three middles; 0..1."""
    corners = [0.0]
    for middle in (0.5, 0.2, 0.8):
        for half in min(middle, 1.0 - middle) * np.array([1.0, 0.75, 0.5, 0.3, 0.15, 0.05]):
            corners += [middle + half, middle - half]
    corners.append(0.0)
    at = np.linspace(0.0, len(corners) - 1.0, 1500)
    return np.interp(at, np.arange(len(corners)), corners)


def _reversals(random: np.random.Generator, size: int, stride: float = 25.0) -> FloatArray:
    """Return straight lines between random turning points at random times; 0..1."""
    times = np.concatenate([[0.0], np.cumsum(random.exponential(stride, size))])
    levels = random.random(times.size)
    levels[0] = 0.0
    extreme = random.random(times.size) < 0.15
    levels[extreme] = np.round(levels[extreme])
    return np.interp(np.arange(size), times, levels)


def _jumps(random: np.random.Generator, size: int) -> FloatArray:
    """Return another level at every sample, half of them at one of the ends; 0..1."""
    levels = random.random(size)
    ends = random.random(size) < 0.5
    levels[ends] = np.round(levels[ends])
    return levels


def _walk(random: np.random.Generator, size: int) -> FloatArray:
    """Return small random steps on top of each other, turning back at the ends; 0..1."""
    walk = random.random() + np.cumsum(random.normal(0.0, STEP, size))
    return np.abs((walk + 1.0) % 2.0 - 1.0)


def _at_rest(random: np.random.Generator, size: int, length: int) -> FloatArray:
    """Return fractions 0..1 of the gap range, each held for ``length`` samples, both ends included."""
    levels = random.random(-(-size // length))
    levels[:2] = 0.0, 1.0
    return np.repeat(levels, length)[:size]
