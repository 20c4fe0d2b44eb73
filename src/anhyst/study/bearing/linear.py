"""A loop around a linearised bearing: loop gain, sensitivity, poles and margins.

The controller is the core's, with the gains per tick that it runs with; between it and the current
stands what compensates the magnet, linearised too.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import brentq, minimize_scalar
from scipy.special import stdtrit

from anhyst.control import Pidd2
from anhyst.study.bearing.linear_plant import Chain, CurrentLoop, DigitalAmplifier, Point, sampled
from anhyst.support.numeric import FloatArray

__all__ = [
    "Chain",
    "Compensation",
    "CurrentLoop",
    "DigitalAmplifier",
    "LinearLoop",
    "Margins",
    "Point",
]
Complexes = NDArray[np.complex128]

_GRID = 3000  # frequencies between which crossings are searched
_LOWEST = 1e-5  # of them, in parts of the rate


@dataclass(frozen=True)
class Compensation:
    """What stands between demand and current: ``i = (u - k_s p)/k_i``."""

    k_i: float  # N/A
    k_s: float = 0.0  # n/m; 0 for a constant ratio of force and current


@dataclass(frozen=True)
class Margins:
    """How far a loop is from instability."""

    stable: bool  # whether the closed loop is; the margins mean something only if it is
    # factors below and above 1 by which the loop gain may change; 0 and infinite without limit
    gain_down: float
    gain_up: float
    phase: float  # least phase margin, degrees
    # additional delay that makes it unstable, s (exact for whole ticks); infinite if none does
    delay: float
    crossover: float  # highest frequency with a loop gain of 1, Hz; 0 if there is none
    peak: float  # of the sensitivity
    peak_frequency: float  # Hz


@dataclass(frozen=True)
class LinearLoop:
    """A linear loop."""

    point: Point
    amplifier: CurrentLoop | DigitalAmplifier
    chain: Chain
    controller: Pidd2  # of the rate of the chain
    compensation: Compensation

    def __post_init__(self) -> None:
        if not math.isclose(self.controller.rate, self.chain.rate, rel_tol=1e-9):
            raise ValueError(
                f"the controller runs at {self.controller.rate:g} Hz, the loop at "
                f"{self.chain.rate:g} Hz"
            )

    @cached_property
    def plant(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Matrices a, b, c from the current's reference at a tick to the position read, m/A."""
        return sampled(self.point, self.amplifier, self.chain)

    def plant_response(self, frequency: ArrayLike) -> Complexes:
        """Return the position read for each ampere of the reference, m/A."""
        a, b, c = self.plant
        return _response(a, b, c, self._z(frequency))

    def response(self, frequency: ArrayLike) -> Complexes:
        """Return the loop gain L; the sensitivity is 1/(1 + L)."""
        z = self._z(frequency)
        a, b, c, d = _controller(self.controller)
        feedback = -(_response(a, b[:, 1], c, z) + d[1])  # of the position
        current = (feedback + self.compensation.k_s) / self.compensation.k_i
        return np.asarray(current * _response(*self.plant, z))

    def sensitivity(self, frequency: ArrayLike) -> Complexes:
        """Return what the controller sees of what is added to the sensor."""
        return np.asarray(1.0 / (1.0 + self.response(frequency)))

    @cached_property
    def poles(self) -> Complexes:
        """Of the closed loop, in z; stable if all lie within the unit circle."""
        a, b, c = self.plant
        own, into, out, through = _controller(self.controller)
        share = 1.0 / self.compensation.k_i
        direct = share * (through[1] - self.compensation.k_s)
        closed = np.block(
            [
                [a + direct * np.outer(b, c), share * np.outer(b, out)],
                [np.outer(into[:, 1], c), own],
            ]
        )
        return np.asarray(np.linalg.eigvals(closed), dtype=np.complex128)

    @property
    def stable(self) -> bool:
        """Whether the closed loop is; a filter or integral without gain does not count."""
        return bool(np.max(np.abs(self.poles)) < 1.0)

    @cached_property
    def margins(self) -> Margins:
        """How far it is from instability."""
        return _margins(self)

    def _z(self, frequency: ArrayLike) -> Complexes:
        turn = 2j * np.pi / self.chain.rate
        return np.exp(turn * np.atleast_1d(np.asarray(frequency, dtype=float)))


def _controller(controller: Pidd2) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Matrices from reference and position to the demand; the states are those of ``pidd2_real.h``."""
    p, k, d, e, _, _, s, t, weight = controller.per_tick[:9]
    # first = s (y - position), second = t (first - velocity)
    a = np.array([[1.0 - s, 0.0, 0.0], [-s * t, 1.0 - t, 0.0], [0.0, 0.0, 1.0]])
    b = np.array([[0.0, s], [0.0, s * t], [k, -k]])
    out = np.array([d * s + e * s * t, e * t, 1.0])
    through = np.array([weight * p, -p - d * s - e * s * t])
    used = [d != 0.0 or e != 0.0, e != 0.0, k != 0.0]
    return a[np.ix_(used, used)], b[used], out[used], through


def _response(a: FloatArray, b: FloatArray, c: FloatArray, z: Complexes) -> Complexes:
    """Return c (z - a)^-1 b for every z."""
    if len(b) == 0:
        return np.zeros(len(z), dtype=np.complex128)
    whole = z[:, None, None] * np.eye(len(b)) - a
    return np.asarray(
        np.linalg.solve(whole, np.broadcast_to(b[:, None], (len(z), len(b), 1)))[..., 0] @ c
    )


def _margins(loop: LinearLoop) -> Margins:
    """Search the loop gain for its crossings of the negative real axis and the unit circle."""
    grid = np.geomspace(_LOWEST * loop.chain.rate, 0.5 * loop.chain.rate, _GRID)

    def gain(frequency: float) -> complex:
        return complex(loop.response(frequency)[0])

    values = loop.response(grid)
    through_axis = [gain(f).real for f in _crossings(lambda f: gain(f).imag, grid, values.imag)] + [
        float(values[-1].real)
    ]  # real at half the rate
    factors = [-1.0 / x for x in through_axis if x < 0.0]
    ones = _crossings(lambda f: abs(gain(f)) - 1.0, grid, np.abs(values) - 1.0)
    turned = [math.degrees(math.atan2((-gain(f)).imag, (-gain(f)).real)) for f in ones]
    delays = [(angle % 360.0) / 360.0 / f for angle, f in zip(turned, ones, strict=True)]
    peak_frequency, peak = _peak(loop, grid, np.abs(1.0 / (1.0 + values)))
    return Margins(
        stable=loop.stable,
        gain_down=max((x for x in factors if x < 1.0), default=0.0),
        gain_up=min((x for x in factors if x > 1.0), default=math.inf),
        phase=min((abs(angle) for angle in turned), default=180.0),
        delay=min(delays, default=math.inf),
        crossover=max(ones, default=0.0),
        peak=peak,
        peak_frequency=peak_frequency,
    )


def _crossings(
    function: Callable[[float], float], grid: FloatArray, values: FloatArray
) -> list[float]:
    """Return the roots of a function between neighbours of opposite sign."""
    change = np.flatnonzero(np.sign(values[:-1]) * np.sign(values[1:]) < 0.0)
    return [float(brentq(function, grid[i], grid[i + 1], xtol=1e-9 * grid[i])) for i in change]


def _peak(loop: LinearLoop, grid: FloatArray, size: FloatArray) -> tuple[float, float]:
    """Return frequency and size of the largest sensitivity."""
    i = int(np.argmax(size))
    ends = grid[max(i - 1, 0)], grid[min(i + 1, len(grid) - 1)]
    best = minimize_scalar(
        lambda f: -abs(complex(loop.sensitivity(f)[0])), bounds=ends, method="bounded"
    )
    return float(best.x), float(-best.fun)


Zone = Literal["A", "B", "C", "D"]


@dataclass(frozen=True)
class Boundary:
    """The upper end of a zone."""

    zone: Zone
    ratio: float  # peak of the sensitivity

    @property
    def decibel(self) -> float:
        """The same, dB."""
        return 20.0 * math.log10(self.ratio)


BOUNDARIES = (Boundary("A", 3.0), Boundary("B", 4.0), Boundary("C", 5.0))
"""9.5, 12 and 14 dB. A: as newly commissioned; B: fit for long operation; C: for a limited time."""


def zone(peak: float) -> Zone:
    """Return the zone of a peak sensitivity; beyond C, and where it is not a number, D.

    >>> zone(2.1), zone(3.0), zone(4.4), zone(9.0)
    ('A', 'A', 'C', 'D')
    """
    return next((boundary.zone for boundary in BOUNDARIES if peak <= boundary.ratio), "D")


@dataclass(frozen=True)
class Quotient:
    """A ratio of means with its confidence interval."""

    value: float  # infinite over a mean of zero
    low: float  # ends of the interval; 0 and infinite where the lower mean may be zero
    high: float


def quotient(upper: ArrayLike, lower: ArrayLike, level: float = 0.95) -> Quotient:
    """Return the ratio of the means of pairs, with Fieller's interval.

    It holds all ratios R for which the mean of ``upper - R lower`` may be zero. So it holds 1
    exactly where the mean of the difference may be zero.
    """
    rows = np.array([upper, lower], dtype=float)
    count = rows.shape[1]
    factor = float(stdtrit(count - 1, 0.5 + 0.5 * level)) ** 2 / count
    a, b = (float(mean) for mean in rows.mean(axis=1))
    (aa, ab), (_, bb) = (factor * np.cov(rows)).tolist()
    value = a / b if b > 0.0 else math.inf
    # (a - R b)^2 <= aa - 2 R ab + R^2 bb
    square, half, rest = b * b - bb, a * b - ab, a * a - aa
    if square <= 0.0:
        return Quotient(value, 0.0, math.inf)
    root = math.sqrt(max(half * half - square * rest, 0.0))
    return Quotient(value, max((half - root) / square, 0.0), (half + root) / square)
