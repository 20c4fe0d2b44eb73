"""A bearing linearised at an operating point, from tick to tick.

With the position ``p = gap_middle - gap``, the winding's voltage v, current i and flux linkage psi,
and the current i_m that would hold that flux::

    m p'' = k_i i_m + k_s p - d p'
    psi' = L i_m' + k_i p' = v - R i      motion induces what the force takes
    i = i_m + (t/L) psi'                  eddy currents hold the flux back by the time t

Nothing is approximated in going over to ticks: what the controller puts out is held for a tick and
takes effect after the delay, which may be a fraction of a tick. A symmetric pair of magnets behaves
as one with k_i, k_s, L and R of both added up, and so does its compensation.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.linalg import block_diag, expm

from anhyst.support.numeric import FloatArray


@dataclass(frozen=True)
class Point:
    """What a bearing is for small movements."""

    mass: float  # kg
    k_i: float  # force for each ampere, N/A
    # force for each metre that the gap closes, N/m, less what the load drive gives; positive where
    # the magnet is unstable
    k_s: float
    inductance: float  # for small changes at this gap, H
    resistance: float  # ohm
    damping: float = 0.0  # N s/m
    eddy_time: float = 0.0  # by which the flux lags behind the current, s

    @property
    def pole_at_current(self) -> float:
        """The fastest growing pole while the flux follows a held current, Hz; negative: stable."""
        return _rightmost(_motion(self)[:2, :2])

    @property
    def pole_at_voltage(self) -> float:
        """The same while the voltage is held: the winding slows it down, Hz."""
        return _rightmost(_motion(self))


@dataclass(frozen=True)
class CurrentLoop:
    """An analogue current controller, ``v = gain e + reset times the integral of e``."""

    gain: float  # V/A
    reset: float  # V/(A s)


@dataclass(frozen=True)
class DigitalAmplifier:
    """A current controller that computes a voltage once a tick.

    ``v = feed r + gain (r - i) + I``, ``I`` grows by ``reset (r - i)`` a tick; r is the reference.
    """

    feed: float  # V/A; the resistance that it knows
    gain: float  # V/A
    reset: float  # V/A a tick
    sensor_bandwidth: float = math.inf  # of the current it reads, Hz; infinite: no lag


@dataclass(frozen=True)
class Chain:
    """When and how fast the loop measures and acts."""

    rate: float  # ticks a second, Hz
    # from the sample to the amplifier's command, those of sensor and amplifier included
    delay_ticks: float
    sensor_bandwidth: float = math.inf  # of the position, Hz; infinite: no lag


def sampled(
    point: Point, amplifier: CurrentLoop | DigitalAmplifier, chain: Chain
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return matrices a, b, c from the current's reference at a tick to the position read, m/A."""
    motion, into, current, direct = voltage_matrices(point)
    if isinstance(amplifier, CurrentLoop):
        motion, into = _under_current(motion, into, current, direct, amplifier)
        a, b, position = _with_sensor(motion, into, _unit(4, 0), 0.0, chain.sensor_bandwidth)
        a, b = _ticks(a, b, chain)
        return a, b, _padded(position, len(b))
    a, b, position = _with_sensor(motion, into, _unit(3, 0), 0.0, chain.sensor_bandwidth)
    if math.isinf(amplifier.sensor_bandwidth) and direct != 0.0:
        raise ValueError("with eddy currents the current must be read through a lag")
    reads = _padded(current, len(b))
    a, b, current = _with_sensor(a, b, reads, direct, amplifier.sensor_bandwidth)
    a, b = _ticks(a, b, chain)
    n = len(b)
    reads = _padded(current, n)
    closed = np.block(
        [
            [a - amplifier.gain * np.outer(b, reads), b[:, None]],
            [-amplifier.reset * reads[None, :], np.ones((1, 1))],
        ]
    )
    reference = np.append((amplifier.feed + amplifier.gain) * b, amplifier.reset)
    return closed, reference, _padded(position, n + 1)


def _unit(length: int, index: int) -> FloatArray:
    row = np.zeros(length)
    row[index] = 1.0
    return row


def _padded(row: FloatArray, length: int) -> FloatArray:
    return np.concatenate([row, np.zeros(length - len(row))])


def voltage_matrices(point: Point) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Return what the voltage does, without an amplifier."""
    held = point.eddy_time / point.inductance
    share = 1.0 / (1.0 + point.resistance * held)
    into = np.array([0.0, 0.0, share / point.inductance])
    return _motion(point), into, np.array([0.0, 0.0, share]), share * held


def _motion(point: Point) -> FloatArray:
    """Matrix of position, velocity and i_m while the voltage is held."""
    mass, inductance = point.mass, point.inductance
    slowed = point.resistance / (inductance + point.resistance * point.eddy_time)
    return np.array(
        [
            [0.0, 1.0, 0.0],
            [point.k_s / mass, -point.damping / mass, point.k_i / mass],
            [0.0, -point.k_i / inductance, -slowed],
        ]
    )


def _rightmost(matrix: FloatArray) -> float:
    return float(np.max(np.linalg.eigvals(matrix).real)) / (2.0 * math.pi)


def _under_current(
    a: FloatArray, b: FloatArray, current: FloatArray, direct: float, amplifier: CurrentLoop
) -> tuple[FloatArray, FloatArray]:
    """Close the analogue current controller, whose integral becomes the last state."""
    gain, reset = amplifier.gain, amplifier.reset
    share = 1.0 / (1.0 + gain * direct)  # the voltage passes into the current at once
    voltage = share * np.append(-gain * current, 1.0)
    flows = _padded(current, 4) + direct * voltage
    whole = block_diag(a, 0.0) + np.outer(np.append(b, 0.0), voltage)
    whole[3] = -reset * flows
    reference = share * gain
    return whole, np.append(reference * b, reset * (1.0 - direct * reference))


def _with_sensor(
    a: FloatArray, b: FloatArray, reads: FloatArray, direct: float, bandwidth: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Append a lag of first order behind an output, which becomes the output."""
    if math.isinf(bandwidth):
        return a, b, reads
    lag = 2.0 * math.pi * bandwidth
    whole = block_diag(a, -lag)
    whole[-1, :-1] = lag * reads
    return whole, np.append(b, lag * direct), _unit(len(b) + 1, len(b))


def _held(a: FloatArray, b: FloatArray, seconds: float) -> tuple[FloatArray, FloatArray]:
    """Matrices over a time in which the input is held."""
    n = len(b)
    whole = np.zeros((n + 1, n + 1))
    whole[:n, :n], whole[:n, n] = a, b
    after = expm(whole * seconds)
    return after[:n, :n], after[:n, n]


def _ticks(a: FloatArray, b: FloatArray, chain: Chain) -> tuple[FloatArray, FloatArray]:
    """Go over to ticks: the input of tick n takes effect `delay_ticks` later."""
    tick, n = 1.0 / chain.rate, len(b)
    waiting = math.floor(chain.delay_ticks)
    part = chain.delay_ticks - waiting
    over_tick, _ = _held(a, b, tick)
    rest, now = _held(a, b, (1.0 - part) * tick)
    _, begin = _held(a, b, part * tick)
    # Rows behind the plant's: what waits, the newest first.
    line = waiting + (1 if part > 0.0 else 0)
    whole, into = np.zeros((n + line, n + line)), np.zeros(n + line)
    whole[:n, :n] = over_tick
    if part > 0.0:
        whole[:n, n + line - 1] = rest @ begin
    if waiting == 0:
        into[:n] = now
    else:
        whole[:n, n + waiting - 1] = now
    if line > 0:
        into[n] = 1.0
        whole[range(n + 1, n + line), range(n, n + line - 1)] = 1.0
    return whole, into
