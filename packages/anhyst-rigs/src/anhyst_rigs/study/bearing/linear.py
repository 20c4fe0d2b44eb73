"""Linearise a bearing at an operating point, and analyse its sampled control loop.

The position is ``p = gap_middle - gap``. The winding has the voltage v, the current i and the flux
linkage psi. The current i_m is the current that would sustain this flux in steady state::

    m p'' = k_i i_m + k_s p - d p'
    psi' = L i_m' + k_i p' = v - R i      motion induces a voltage
    i = i_m + (t/L) psi'                  eddy currents delay the flux by the time t

The discretisation is exact: the controller output is constant during a tick. It takes effect after
the delay, which may be a fraction of a tick. A symmetric pair of magnets equals one magnet with the
sums of k_i, k_s, L and R, and with the sum of both compensations. The loop is analysed by its loop
gain, sensitivity, poles and margins. The controller uses the gains per tick of the C core. The
compensation between controller and current is linearised too.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.linalg import block_diag, expm
from scipy.optimize import brentq, minimize_scalar

from anhyst.control import Pidd2
from anhyst.support.numeric import FloatArray

ComplexArray = NDArray[np.complex128]

_GRID_POINTS = 3000  # number of frequencies between which crossings are searched
_MIN_FREQUENCY_TO_SAMPLE_RATE = 1e-5  # lowest frequency, relative to the sample rate


@dataclass(frozen=True)
class LinearBearing:
    """A bearing that is linearised for small movements."""

    mass: float  # mass, kg
    k_i: float  # slope of the force with respect to the current, N/A
    # slope of the force with respect to a reduction of the gap, minus the stiffness of the load
    # drive, N/m; positive if the magnet is unstable
    k_s: float
    inductance: float  # incremental inductance at this gap, H
    resistance: float  # resistance, ohm
    damping: float = 0.0  # damping, N s/m
    eddy_time: float = 0.0  # eddy-current lag of the flux, s

    @property
    def current_drive_pole(self) -> float:
        """The rightmost pole if the current is impressed, Hz; negative if stable."""
        return _rightmost_pole(_motion_matrix(self)[:2, :2])

    @property
    def voltage_drive_pole(self) -> float:
        """The rightmost pole if the voltage is impressed, Hz. The winding makes it slower."""
        return _rightmost_pole(_motion_matrix(self))


@dataclass(frozen=True)
class AnalogueAmplifier:
    """An analogue PI controller of the current; its voltage for the error e is ``v = gain e + I``."""

    gain: float  # proportional gain, V/A
    integral_gain: float  # V/(A s)


@dataclass(frozen=True)
class DigitalAmplifier:
    """A current controller that computes a voltage once per tick.

    ``v = feedforward r + gain (r - i) + I`` for the current reference r. The integral I increases
    by ``integral_gain (r - i)`` per tick.
    """

    feedforward: float  # nominal resistance, V/A
    gain: float  # proportional gain, V/A
    integral_gain: float  # integral gain, V/A per tick
    sensor_bandwidth: float = math.inf  # bandwidth of the current sensor, Hz; infinite: no lag


@dataclass(frozen=True)
class LoopTiming:
    """Sample rate, delay and sensor bandwidth of a control loop."""

    rate: float  # number of ticks per second, Hz
    # delay from the sample to the command of the amplifier, including those of sensor and amplifier
    delay_ticks: float
    sensor_bandwidth: float = math.inf  # bandwidth of the position sensor, Hz; infinite: no lag


def discretise(
    bearing: LinearBearing, amplifier: AnalogueAmplifier | DigitalAmplifier, timing: LoopTiming
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return matrices a, b, c from the current reference at a tick to the position reading, m/A."""
    a, b, current, feedthrough = voltage_matrices(bearing)
    if isinstance(amplifier, AnalogueAmplifier):
        a, b = _close_current_loop(a, b, current, feedthrough, amplifier)
    a, b, position = _append_sensor_lag(a, b, np.eye(len(b))[0], 0.0, timing.sensor_bandwidth)
    if isinstance(amplifier, AnalogueAmplifier):
        a, b = _discretise_with_delay(a, b, timing)
        return a, b, _pad_with_zeros(position, len(b))
    if math.isinf(amplifier.sensor_bandwidth) and feedthrough != 0.0:
        raise ValueError("with eddy currents the current must be read through a lag")
    sensor_row = _pad_with_zeros(current, len(b))
    a, b, current = _append_sensor_lag(a, b, sensor_row, feedthrough, amplifier.sensor_bandwidth)
    a, b = _discretise_with_delay(a, b, timing)
    sensor_row = _pad_with_zeros(current, len(b))
    closed_loop_matrix = np.block(
        [
            [a - amplifier.gain * np.outer(b, sensor_row), b[:, None]],
            [-amplifier.integral_gain * sensor_row[None, :], np.ones((1, 1))],
        ]
    )
    reference = np.append((amplifier.feedforward + amplifier.gain) * b, amplifier.integral_gain)
    return closed_loop_matrix, reference, _pad_with_zeros(position, len(reference))


def _pad_with_zeros(coefficients: FloatArray, length: int) -> FloatArray:
    return np.concatenate([coefficients, np.zeros(length - len(coefficients))])


def voltage_matrices(bearing: LinearBearing) -> tuple[FloatArray, FloatArray, FloatArray, float]:
    """Return matrices of a voltage-driven bearing: state, input, current row and feedthrough."""
    lag_per_inductance = bearing.eddy_time / bearing.inductance
    voltage_fraction = 1.0 / (1.0 + bearing.resistance * lag_per_inductance)
    input_vector = np.array([0.0, 0.0, voltage_fraction / bearing.inductance])
    return (
        _motion_matrix(bearing),
        input_vector,
        np.array([0.0, 0.0, voltage_fraction]),
        voltage_fraction * lag_per_inductance,
    )


def _motion_matrix(bearing: LinearBearing) -> FloatArray:
    """Return the state matrix of position, velocity and i_m at constant voltage."""
    mass, inductance = bearing.mass, bearing.inductance
    winding_rate = bearing.resistance / (inductance + bearing.resistance * bearing.eddy_time)
    return np.array(
        [
            [0.0, 1.0, 0.0],
            [bearing.k_s / mass, -bearing.damping / mass, bearing.k_i / mass],
            [0.0, -bearing.k_i / inductance, -winding_rate],
        ]
    )


def _rightmost_pole(matrix: FloatArray) -> float:
    return float(np.max(np.linalg.eigvals(matrix).real)) / (2.0 * math.pi)


def _close_current_loop(
    a: FloatArray, b: FloatArray, current: FloatArray, feedthrough: float, amplifier: AnalogueAmplifier
) -> tuple[FloatArray, FloatArray]:
    """Close the analogue current loop; the integral of its controller becomes the last state."""
    gain, integral_gain = amplifier.gain, amplifier.integral_gain
    voltage_fraction = 1.0 / (1.0 + gain * feedthrough)  # The voltage changes the current immediately.
    voltage = voltage_fraction * np.append(-gain * current, 1.0)
    current_row = _pad_with_zeros(current, 4) + feedthrough * voltage
    matrix = block_diag(a, 0.0) + np.outer(np.append(b, 0.0), voltage)
    matrix[3] = -integral_gain * current_row
    reference_gain = voltage_fraction * gain
    return matrix, np.append(reference_gain * b, integral_gain * (1.0 - feedthrough * reference_gain))


def _append_sensor_lag(
    a: FloatArray, b: FloatArray, output: FloatArray, feedthrough: float, bandwidth: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Append a first-order lag to an output; the output of this lag becomes the new output."""
    if math.isinf(bandwidth):
        return a, b, output
    corner_rate = 2.0 * math.pi * bandwidth
    matrix = block_diag(a, -corner_rate)
    matrix[-1, :-1] = corner_rate * output
    return matrix, np.append(b, corner_rate * feedthrough), np.eye(len(matrix))[-1]


def _hold_matrices(a: FloatArray, b: FloatArray, seconds: float) -> tuple[FloatArray, FloatArray]:
    """Return the state transition and the input vector over a time in which the input is constant."""
    n = len(b)
    matrix = np.zeros((n + 1, n + 1))
    matrix[:n, :n], matrix[:n, n] = a, b
    transition = expm(matrix * seconds)
    return transition[:n, :n], transition[:n, n]


def _discretise_with_delay(a: FloatArray, b: FloatArray, timing: LoopTiming) -> tuple[FloatArray, FloatArray]:
    """Return the matrices of one tick; the input of tick n takes effect `delay_ticks` later."""
    tick_s, n = 1.0 / timing.rate, len(b)
    whole_ticks = math.floor(timing.delay_ticks)
    fraction = timing.delay_ticks - whole_ticks
    tick_transition, _ = _hold_matrices(a, b, tick_s)
    second_transition, second_input = _hold_matrices(a, b, (1.0 - fraction) * tick_s)
    _, first_input = _hold_matrices(a, b, fraction * tick_s)
    # The states after those of the plant are the delayed inputs, the newest first.
    delay_states = whole_ticks + (1 if fraction > 0.0 else 0)
    matrix = np.zeros((n + delay_states, n + delay_states))
    input_vector = np.zeros(n + delay_states)
    matrix[:n, :n] = tick_transition
    if fraction > 0.0:
        matrix[:n, n + delay_states - 1] = second_transition @ first_input
    if whole_ticks == 0:
        input_vector[:n] = second_input
    else:
        matrix[:n, n + whole_ticks - 1] = second_input
    if delay_states > 0:
        input_vector[n] = 1.0
        matrix[range(n + 1, n + delay_states), range(n, n + delay_states - 1)] = 1.0
    return matrix, input_vector


@dataclass(frozen=True)
class Compensation:
    """The linear compensation that converts a demand to a current: ``i = (u - k_s p)/k_i``."""

    k_i: float  # force constant, N/A
    k_s: float = 0.0  # negative stiffness, N/m; 0 for a constant ratio of force to current


@dataclass(frozen=True)
class Margins:
    """Stability margins of a control loop."""

    stable: bool  # whether the closed loop is stable; otherwise, the margins are meaningless
    # factors on the loop gain at the stability limit, below and above 1; 0 or infinite if none
    gain_down: float
    gain_up: float
    phase: float  # smallest phase margin, degrees
    # additional delay at the stability limit, s (exact for whole ticks); infinite if there is none
    delay: float
    crossover: float  # highest frequency with a loop gain of 1, Hz; 0 if there is none
    peak: float  # peak of the sensitivity
    peak_frequency: float  # frequency of this peak, Hz


@dataclass(frozen=True)
class LinearLoop:
    """A linear control loop of a bearing."""

    bearing: LinearBearing
    amplifier: AnalogueAmplifier | DigitalAmplifier
    timing: LoopTiming
    controller: Pidd2  # controller with the sample rate of the loop
    compensation: Compensation

    def __post_init__(self) -> None:
        if not math.isclose(self.controller.rate, self.timing.rate, rel_tol=1e-9):
            raise ValueError(
                f"the controller runs at {self.controller.rate:g} Hz, the loop at {self.timing.rate:g} Hz"
            )

    @cached_property
    def plant(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Matrices a, b, c from the current reference at a tick to the position reading, m/A."""
        return discretise(self.bearing, self.amplifier, self.timing)

    def plant_response(self, frequency: ArrayLike) -> ComplexArray:
        """Return the response from the current reference to the position reading, m/A."""
        a, b, c = self.plant
        return _frequency_response(a, b, c, self._z(frequency))

    def loop_gain(self, frequency: ArrayLike) -> ComplexArray:
        """Return the loop gain L; the sensitivity is 1/(1 + L)."""
        z = self._z(frequency)
        a, b, c, d = _controller_matrices(self.controller)
        feedback = -(_frequency_response(a, b[:, 1], c, z) + d[1])  # response to the position
        current = (feedback + self.compensation.k_s) / self.compensation.k_i
        return np.asarray(current * _frequency_response(*self.plant, z))

    def sensitivity(self, frequency: ArrayLike) -> ComplexArray:
        """Return the sensitivity: from a signal added to the sensor to the controller's reading."""
        return np.asarray(1.0 / (1.0 + self.loop_gain(frequency)))

    @cached_property
    def poles(self) -> ComplexArray:
        """Poles of the closed loop in z. The loop is stable if all are inside the unit circle."""
        a, b, c = self.plant
        controller_matrix, controller_input, controller_output, feedthrough = _controller_matrices(
            self.controller
        )
        inverse_k_i = 1.0 / self.compensation.k_i
        position_gain = inverse_k_i * (feedthrough[1] - self.compensation.k_s)
        matrix = np.block(
            [
                [a + position_gain * np.outer(b, c), inverse_k_i * np.outer(b, controller_output)],
                [np.outer(controller_input[:, 1], c), controller_matrix],
            ]
        )
        return np.asarray(np.linalg.eigvals(matrix), dtype=np.complex128)

    @property
    def is_stable(self) -> bool:
        """Whether the closed loop is stable; filters and integrals with zero gain are ignored."""
        return bool(np.max(np.abs(self.poles)) < 1.0)

    @cached_property
    def margins(self) -> Margins:
        """Stability margins of the loop."""
        return _find_margins(self)

    def _z(self, frequency: ArrayLike) -> ComplexArray:
        exponent = 2j * np.pi / self.timing.rate
        return np.exp(exponent * np.atleast_1d(np.asarray(frequency, dtype=float)))


def _controller_matrices(controller: Pidd2) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return matrices from reference and position to the demand; states as in ``pidd2_real.h``."""
    p, k, d, e, _, _, s, t, weight = controller.per_tick[:9]
    # states: s (y - position), then t (first - velocity)
    a = np.array([[1.0 - s, 0.0, 0.0], [-s * t, 1.0 - t, 0.0], [0.0, 0.0, 1.0]])
    b = np.array([[0.0, s], [0.0, s * t], [k, -k]])
    output = np.array([d * s + e * s * t, e * t, 1.0])
    feedthrough = np.array([weight * p, -p - d * s - e * s * t])
    is_used = [d != 0.0 or e != 0.0, e != 0.0, k != 0.0]
    return a[np.ix_(is_used, is_used)], b[is_used], output[is_used], feedthrough


def _frequency_response(a: FloatArray, b: FloatArray, c: FloatArray, z: ComplexArray) -> ComplexArray:
    """Return c (z - a)^-1 b for every value of z."""
    if len(b) == 0:
        return np.zeros(len(z), dtype=np.complex128)
    matrices = z[:, None, None] * np.eye(len(b)) - a
    return np.asarray(np.linalg.solve(matrices, np.broadcast_to(b[:, None], (len(z), len(b), 1)))[..., 0] @ c)


def _find_margins(loop: LinearLoop) -> Margins:
    """Search where the loop gain crosses the negative real axis and the unit circle."""
    grid = np.geomspace(
        _MIN_FREQUENCY_TO_SAMPLE_RATE * loop.timing.rate, 0.5 * loop.timing.rate, _GRID_POINTS
    )

    def gain(frequency: float) -> complex:
        return complex(loop.loop_gain(frequency)[0])

    values = loop.loop_gain(grid)
    axis_crossings = [gain(f).real for f in _find_roots(lambda f: gain(f).imag, grid, values.imag)] + [
        float(values[-1].real)
    ]  # The loop gain is real at half the sample rate.
    factors = [-1.0 / x for x in axis_crossings if x < 0.0]
    crossover_frequencies = _find_roots(lambda f: abs(gain(f)) - 1.0, grid, np.abs(values) - 1.0)
    phase_margins = [
        math.degrees(math.atan2((-gain(f)).imag, (-gain(f)).real)) for f in crossover_frequencies
    ]
    delays = [
        (angle % 360.0) / 360.0 / f for angle, f in zip(phase_margins, crossover_frequencies, strict=True)
    ]
    peak_index = int(np.argmax(np.abs(1.0 / (1.0 + values))))
    peak_search = minimize_scalar(
        lambda f: -abs(complex(loop.sensitivity(f)[0])),
        bounds=(grid[max(peak_index - 1, 0)], grid[min(peak_index + 1, len(grid) - 1)]),
        method="bounded",
    )
    return Margins(
        stable=loop.is_stable,
        gain_down=max((x for x in factors if x < 1.0), default=0.0),
        gain_up=min((x for x in factors if x > 1.0), default=math.inf),
        phase=min((abs(angle) for angle in phase_margins), default=180.0),
        delay=min(delays, default=math.inf),
        crossover=max(crossover_frequencies, default=0.0),
        peak=float(-peak_search.fun),
        peak_frequency=float(peak_search.x),
    )


def _find_roots(function: Callable[[float], float], grid: FloatArray, values: FloatArray) -> list[float]:
    """Return roots of a function, one between each pair of grid neighbours with opposite signs."""
    change = np.flatnonzero(np.sign(values[:-1]) * np.sign(values[1:]) < 0.0)
    return [float(brentq(function, grid[i], grid[i + 1], xtol=1e-9 * grid[i])) for i in change]


Zone = Literal["A", "B", "C", "D"]


ZONE_LIMITS: Mapping[Zone, float] = {"A": 3.0, "B": 4.0, "C": 5.0}
"""Largest peak sensitivity of the zones A, B and C of ISO 14839-3."""


def find_zone(peak: float) -> Zone:
    """Return the zone of a peak sensitivity; it is D above zone C, and for NaN.

    >>> find_zone(2.1), find_zone(3.0), find_zone(4.4), find_zone(9.0)
    ('A', 'A', 'C', 'D')
    """
    return next((name for name, zone_limit in ZONE_LIMITS.items() if peak <= zone_limit), "D")
