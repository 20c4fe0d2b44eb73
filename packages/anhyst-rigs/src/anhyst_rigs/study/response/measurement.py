"""Measure closed loop, sensitivity and plant of a running position loop with a multi-sine.

A signal is added to the position reading. A short pilot signal, twice as strong as the noise, measures
how much the signals of the loop respond. The amplitudes of the measuring signal follow from these
responses, so that motion, current and voltage stay within their limits. After the transient, three
periods are recorded. Lines between the excited ones contain noise and distortion only: their power
gives the coherence and the uncertainty of every point.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from anhyst.support.errors import InputError
from anhyst.support.jobs import Progress
from anhyst.support.numeric import FloatArray
from anhyst.support.states import Fault, Flag, Phase, State
from anhyst_rigs.rig.bench.injection import InjectionPort
from anhyst_rigs.rig.bench.protocol import Signal
from anhyst_rigs.study.response.multisine import (
    ComplexArray,
    LineArray,
    Multisine,
    amplitude_spectrum,
    choose_lines,
    with_random_phases,
)
from anhyst_rigs.study.response.result import (
    EXACT_UNCERTAINTY_DB,
    MIN_COHERENCE,
    UNCERTAINTY_SIGMAS,
    FrequencyResponse,
    MeasuredResponse,
    ResponseName,
)

POINTS = 200
"""Number of frequencies."""
LOW_HZ = 1.0
HIGH_HZ = 5000.0
"""Lowest and highest frequency, Hz. Half the tick rate is a further limit."""
PERIOD_S = 5.0
_PERIODS = 3
_SETTLING_S = 1.5
"""Time in which the transient of the measuring signal decays, s."""
_FADE_S = 0.05
"""Time in which the measuring signal begins and ends, s."""
_REST_S = 0.25
"""Time in which the noise is measured, and in which the transient of the pilot signal decays, s."""
_PILOT_PERIOD_S = 1.0
_PILOT_POINTS = 100
_PILOT_TO_NOISE = 2.0
"""rms of the pilot signal, relative to the rms of the noise in the position reading."""
_MIN_NOISE_TO_MOTION = 1e-3
"""Smallest noise that is assumed, relative to the largest motion."""
_EVEN_POWER_FRACTION = 0.2
"""Fraction of the power in the plant's input that is equal for all points. The other power increases
with a power of the frequency, because the motion of a mass falls with the square of the frequency,
and amplifiers reduce it further."""
_POWER_EXPONENT = 5.0
_LINE_MOTION_TO_MOTION = 0.5
"""Motion of a single line, relative to the largest motion divided by the root of the number of lines.
"""
_READ_S = 0.05
"""Time from one read of the bench to the next, s."""
_KEY = "response"


class ResponseSeat(Protocol):
    """The members of :class:`anhyst_rigs.rig.bench.protocol.Bench` that a measurement uses."""

    @property
    def rate(self) -> float:
        """Tick rate, Hz."""

    @property
    def signals(self) -> tuple[Signal, ...]:
        """Columns of the rows, after the tick number."""

    @property
    def injection_port(self) -> InjectionPort | None:
        """Place where a signal is added; None if there is none."""

    def advance(self, ticks: int) -> FloatArray:
        """Wait for some ticks, and return all new rows."""

    def inject(self, signal: FloatArray) -> int:
        """Add a signal to the position reading; return its first tick."""


def measure_response(
    bench: ResponseSeat, motion: float | None = None, progress: Progress | None = None
) -> FrequencyResponse:
    """Measure a loop while it holds its body; the motion stays below `motion`, m."""
    loop = _MeasuredLoop(bench, progress)
    port = loop.port
    motion = port.max_motion if motion is None else motion
    if not 0.0 < motion <= port.max_motion:
        raise InputError(
            f"frequency response: the motion is {1e6 * motion:g} um; choose one above 0 and at most "
            f"{1e6 * port.max_motion:.3g} um, a hundredth of the gap",
            code="out-of-range",
            key="motion",
        )
    try:
        excitation = _design_excitation(loop, motion)
        period = excitation.respond()
        settling_ticks = round(_SETTLING_S * bench.rate)
        signal = _repeat(period, settling_ticks, round(_FADE_S * bench.rate))
        records = loop.record(signal)[:, settling_ticks : settling_ticks + _PERIODS * len(period)]
    finally:
        bench.inject(np.zeros(0))
    position = records[0] - np.tile(period, _PERIODS)
    return FrequencyResponse(
        frequency=excitation.lines * bench.rate / excitation.period_ticks,
        responses=_evaluate(excitation, records[0], position, records[1]),
        rate=bench.rate,
        plant_unit=f"m/{port.input_unit}",
        motion=float(np.abs(position - position.mean()).max()),
        injected=float(np.abs(period).max()),
        duration=loop.ticks / bench.rate,
    )


def _repeat(period: FloatArray, settling_ticks: int, fade_ticks: int) -> FloatArray:
    """Return the last part of a period, all periods, and a fade; the signal begins and ends gradually."""
    ramp = 0.5 - 0.5 * np.cos(np.pi * (np.arange(fade_ticks) + 0.5) / fade_ticks)
    signal = np.concatenate(
        [period[-settling_ticks:], *[period] * _PERIODS, period[:fade_ticks] * ramp[::-1]]
    )
    signal[:fade_ticks] *= ramp
    return signal


class _MeasuredLoop:
    """The loop of a bench: records its signals, and checks that the loop remains linear."""

    def __init__(self, bench: ResponseSeat, progress: Progress | None) -> None:
        if bench.injection_port is None:
            bench.inject(np.zeros(0))  # raises the error that states why
            raise AssertionError
        self.bench, self.port = bench, bench.injection_port
        self.ticks = 0  # number of ticks since the start
        self._progress = progress
        self._total_ticks = (
            2.0 * _REST_S + _PILOT_PERIOD_S + _SETTLING_S + _PERIODS * PERIOD_S + _FADE_S
        ) * bench.rate
        self._columns = {signal.name: 1 + number for number, signal in enumerate(bench.signals)}
        combinations = [self.port.reading, self.port.plant_input]
        combinations += [{name: 1.0} for name in self.port.max_changes]
        self._weights = np.zeros((1 + len(bench.signals), len(combinations)))
        for number, weights in enumerate(combinations):
            for name, weight in weights.items():
                self._weights[self._columns[name], number] = weight

    def record(self, signal: FloatArray) -> FloatArray:
        """Inject a signal; return the reading, the plant's input and all limited signals, one row each."""
        first_tick = self.bench.inject(signal)
        next_tick, end_tick, blocks = first_tick, first_tick + len(signal), []
        while next_tick < end_tick:
            rows = self.bench.advance(min(end_tick - next_tick, round(_READ_S * self.bench.rate)))
            rows = rows[(rows[:, 0] >= next_tick) & (rows[:, 0] < end_tick)]
            if len(rows) == 0:
                continue
            if rows[-1, 0] - next_tick + 1 != len(rows):
                raise InputError(
                    "frequency response: ticks are missing; repeat the measurement", code="ticks-missing"
                )
            self._check(rows)
            blocks.append(rows @ self._weights)
            next_tick += len(rows)
            self.ticks += len(rows)
            if self._progress is not None:
                self._progress(min(self.ticks, self._total_ticks), self._total_ticks)
        return np.concatenate(blocks).T.copy()

    def _check(self, rows: FloatArray) -> None:
        """Raise an InputError if the body is not held, or if a limit is reached."""
        for name, value in self.port.held_values.items():
            other_values = rows[rows[:, self._columns[name]] != value, self._columns[name]]
            if len(other_values):
                raise _not_held(name, int(other_values[0]))
        for limit in self.port.limits:
            values = rows[:, self._columns[limit.signal]]
            if values.min() <= limit.low or values.max() >= limit.high:
                raise _not_linear(limit.text)
        if self.port.forbidden_flags:
            flags = np.bitwise_or.reduce(rows[:, self._columns["flags"]].astype(np.int64))
            if reported := Flag(int(flags) & self.port.forbidden_flags):
                raise _not_linear(f"the controller reports {Flag(reported).name}".lower().replace("_", " "))


def _not_held(name: str, value: int) -> InputError:
    kinds = {"state": State, "phase": Phase, "flight": Phase, "fault": Fault}
    text = kinds[name](value).name.lower().replace("_", " ")
    return InputError(
        f"frequency response: the {name} is '{text}', but the body must be held at rest; lift it (a stage: "
        "stop it), wait until it rests, and measure again",
        code="not-held",
        key=_KEY,
    )


def _not_linear(text: str) -> InputError:
    return InputError(
        f"frequency response: {text}, so the loop was not linear; choose a smaller motion, or another target",
        code="not-linear",
        key=_KEY,
    )


def _design_excitation(loop: _MeasuredLoop, motion: float) -> Multisine:
    """Return the measuring signal, from the responses to a pilot signal that is as strong as the noise."""
    rate, port = loop.bench.rate, loop.port
    high = min(HIGH_HZ, 0.5 * rate * (1.0 - 1.0 / (rate * PERIOD_S)))
    rest = loop.record(np.zeros(round(_REST_S * rate)))
    noise = max(float(np.std(rest[0])), _MIN_NOISE_TO_MOTION * motion)
    pilot_ticks = round(_PILOT_PERIOD_S * rate)
    pilot_lines = choose_lines(_PILOT_POINTS, LOW_HZ, math.floor(high * pilot_ticks / rate))
    even = np.full(len(pilot_lines), _PILOT_TO_NOISE * noise * math.sqrt(2.0 / len(pilot_lines)))
    pilot = Multisine(pilot_lines, with_random_phases(even), pilot_ticks)
    pilot_period = pilot.respond()
    rest_ticks = round(_REST_S * rate)
    records = loop.record(np.concatenate([pilot_period[-rest_ticks:], pilot_period]))[:, rest_ticks:]
    records[0] -= pilot_period  # the position
    period_ticks = round(PERIOD_S * rate)
    lines = choose_lines(POINTS, LOW_HZ * period_ticks / rate, high * period_ticks / rate)
    pilot_gains = [pilot.amplitudes_of(record) / pilot.amplitudes for record in records]
    gains = [
        np.interp(lines / period_ticks, pilot_lines / pilot_ticks, values.real)
        + 1j * np.interp(lines / period_ticks, pilot_lines / pilot_ticks, values.imag)
        for values in pilot_gains
    ]
    return _limit_excitation(lines, gains, period_ticks, motion, port)


def _limit_excitation(
    lines: LineArray, gains: list[ComplexArray], period_ticks: int, motion: float, port: InjectionPort
) -> Multisine:
    """Return a multi-sine whose responses stay within the limits of the port."""
    position_gain, input_gain, *limited_gains = gains
    relative_power = (lines / lines[-1]) ** _POWER_EXPONENT
    relative_power = _EVEN_POWER_FRACTION / len(lines) + (
        1.0 - _EVEN_POWER_FRACTION
    ) * relative_power / np.sum(relative_power)
    shares = [motion / port.max_motion * change for change in port.max_changes.values()]

    def excess(signal: Multisine) -> float:
        """Return the largest ratio of a signal to its limit, except that of the position."""
        peaks = [
            float(np.abs(signal.respond(gain)).max()) / limit
            for gain, limit in zip(limited_gains, shares, strict=True)
        ]
        return max(*peaks, float(np.abs(np.diff(signal.respond())).max()) / port.max_step)

    amplitudes = with_random_phases(np.sqrt(relative_power)) / input_gain
    signal = Multisine(lines, amplitudes, period_ticks)
    amplitudes = amplitudes / excess(signal)
    # The position of each line alone is limited, so that the sum remains below the largest motion.
    line_motion = _LINE_MOTION_TO_MOTION * motion / math.sqrt(len(lines))
    position = np.abs(amplitudes * position_gain)
    amplitudes = amplitudes * np.minimum(1.0, line_motion / np.maximum(position, 1e-3 * line_motion))
    signal = Multisine(lines, amplitudes, period_ticks)
    position_excess = float(np.abs(signal.respond(position_gain)).max()) / motion
    return Multisine(lines, amplitudes / max(excess(signal), position_excess), period_ticks)


def _evaluate(
    excitation: Multisine, reading: FloatArray, position: FloatArray, plant_input: FloatArray
) -> dict[ResponseName, MeasuredResponse]:
    """Return the responses, with the coherence from the lines that are not excited."""
    spectra = [amplitude_spectrum(signal) for signal in (reading, position, plant_input)]
    steps = excitation.lines * _PERIODS
    read, moved, driven = (spectrum[steps] for spectrum in spectra)
    background = _Background(steps, len(spectra[0]))
    plant = moved / driven
    noise = background.rms_near(lambda index, _: spectra[0][index])
    plant_noise = background.rms_near(
        lambda index, point: spectra[1][index] - plant[point] * spectra[2][index]
    )
    frequency = excitation.lines / excitation.period_ticks
    injected = excitation.amplitudes
    return {
        "closed_loop": _make_response(frequency, -moved / injected, noise / np.abs(moved)),
        "sensitivity": _make_response(frequency, read / injected, noise / np.abs(read)),
        "plant": _make_response(frequency, plant, plant_noise / np.abs(moved)),
    }


@dataclass(frozen=True)
class _Background:
    """The lines near each excited line that are not excited."""

    steps: LineArray  # excited lines
    count: int  # number of lines

    def rms_near(self, spectrum: Callable[[LineArray, int], ComplexArray]) -> FloatArray:
        """Return the rms amplitude of noise and distortion near each excited line.

        Noise is at all lines, and the distortion that matters at odd multiples of the excitation's
        inverse period. The larger of both counts.
        """
        lines = np.arange(self.count)
        is_noise = lines % _PERIODS != 0
        is_distorted = lines % (2 * _PERIODS) == _PERIODS
        is_distorted[self.steps] = False
        result = np.zeros(len(self.steps))
        for point, step in enumerate(self.steps.tolist()):
            for is_chosen, width in ((is_noise, 0.02), (is_distorted, 0.05)):
                half = round(max(width * step, _MIN_WINDOW_LINES * _PERIODS))
                near = np.arange(max(1, step - half), min(self.count, step + half + 1))
                power = np.abs(spectrum(near[is_chosen[near]], point)) ** 2
                result[point] = max(result[point], math.sqrt(float(np.mean(power))))
        return result


_MIN_WINDOW_LINES = 16
"""Smallest distance of lines that are evaluated together with an excited line, inverse periods."""
_MAX_AVERAGED_SIDE = 5
"""Largest number of points on each side that are averaged with a point."""
_MIN_AVERAGED_POINTS = 3
_MAX_SCATTER_TO_NOISE = 2.0
"""Largest power of the deviations from the mean line, relative to that of the noise."""


_MAX_UNCERTAINTY = (10.0 ** (EXACT_UNCERTAINTY_DB / 20.0) - 1.0) / UNCERTAINTY_SIGMAS
"""Largest relative standard deviation of a point that is not averaged with its neighbours."""


def _make_response(frequency: FloatArray, values: ComplexArray, noise_ratio: FloatArray) -> MeasuredResponse:
    """Return a response; uncertain points are averaged with their neighbours.

    Two straight lines fit the neighbours: the logarithm of the magnitude over that of the frequency, and
    the phase over the frequency, because a delay is linear in it. This is permitted only if the
    neighbours deviate from these lines by no more than noise.
    """
    coherence = 1.0 / (1.0 + noise_ratio**2)
    own_uncertainty = noise_ratio / math.sqrt(2.0)  # of the magnitude, and of the phase in radians
    averaged, uncertainty = np.ones(len(values), dtype=np.int64), own_uncertainty.copy()
    stated = np.where(coherence < MIN_COHERENCE, np.nan, values)
    for point in np.flatnonzero(own_uncertainty > _MAX_UNCERTAINTY).tolist():
        for side in range(1, _MAX_AVERAGED_SIDE + 1):
            near = np.arange(max(0, point - side), min(len(values), point + side + 1))
            if len(near) < _MIN_AVERAGED_POINTS:
                continue
            weight = 1.0 / own_uncertainty[near]
            relative = frequency[near] / frequency[point]
            ratios = np.log(values[near] / values[point])
            size, variance, size_scatter = _fit_middle(np.log(relative), ratios.real, weight)
            phase, _, phase_scatter = _fit_middle(relative - 1.0, ratios.imag, weight)
            scatter = (size_scatter + phase_scatter) / (2.0 * (len(near) - 2))
            if math.sqrt(variance) <= _MAX_UNCERTAINTY and scatter <= _MAX_SCATTER_TO_NOISE:
                stated[point], averaged[point] = values[point] * np.exp(size + 1j * phase), len(near)
                uncertainty[point] = math.sqrt(variance)
                break
    return MeasuredResponse(stated, uncertainty, coherence, averaged)


def _fit_middle(x: FloatArray, y: FloatArray, weight: FloatArray) -> tuple[float, float, float]:
    """Return the value of a weighted straight line at zero, its variance, and the weighted residual."""
    basis = np.column_stack([np.ones_like(x), x]) * weight[:, None]
    covariance = np.linalg.inv(basis.T @ basis)
    fit = covariance @ basis.T @ (weight * y)
    residual = weight * y - basis @ fit
    return float(fit[0]), float(covariance[0, 0]), float(residual @ residual)
