"""Find the operating point of a bearing: slopes of the magnet, poles and the linear loop.

The slopes are measured on the steady-state loop of the virtual magnet. Just after a reversal, only
the reversible part of the iron responds, so the slope for small movements is smaller.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal

import numpy as np

from anhyst.support.numeric import FloatArray, geometric_spacing
from anhyst.support.toml_file import FileFault, faults_error
from anhyst_rigs.rig.bearing.loop import BearingSetup
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.measuring import HeldBearing
from anhyst_rigs.rig.plant import current_controller_gains
from anhyst_rigs.rig.sensor_table import FluxSensorTable
from anhyst_rigs.study.bearing import linear

_CURRENT_POINTS = 1200
_GAP_STEP_M = 2e-6
MIN_RATE_TO_POLE_FREQUENCY = 20.0
"""Smallest sample rate, as a multiple of the frequency of the plant's unstable pole."""


@dataclass(frozen=True)
class OperatingPoint:
    """The operating point of a bearing."""

    gap: float  # operating gap, m
    force: float  # force of one magnet, N
    current: float  # current, A, as the mean of the ascending and the descending branch
    force_max: float  # largest force at this gap, N
    slopes: ReversalSlopes  # static slopes, and slopes just after a reversal
    # bearing for small movements; a pair of magnets counts as one magnet with the windings in
    # series, whose current is the deviation of each current from its bias
    bearing: linear.LinearBearing


def find_operating_point(rig: BodyRig) -> OperatingPoint:
    """Measure the magnet of a rig at its operating gap and load."""
    settings = rig.settings
    gap, current_high_A = settings.gap_m, settings.amplifier.current_high_A
    ascending_current = np.linspace(0.0, current_high_A, _CURRENT_POINTS)
    path = np.concatenate([ascending_current, ascending_current[::-1]])
    load_N = rig.static_load
    stop_gaps = np.array([settings.body.stop_low_m, settings.body.stop_high_m])
    smallest_gap = float(np.min(rig.magnet_gaps(stop_gaps)))
    force, psi, _ = rig.static_map(path, np.full(path.size, gap))
    check_load(rig, float(force[_CURRENT_POINTS - 1]))
    _check_lift_off(
        rig, float(rig.static_map(ascending_current, np.full(ascending_current.size, stop_gaps[1]))[0][-1])
    )
    if settings.hall_probe is not None:
        density = float(
            rig.static_map(ascending_current, np.full(ascending_current.size, smallest_gap))[2][-1]
        )
        _check_probe(rig, settings.hall_probe, density, smallest_gap)
    bias = settings.bias_N
    key = ("load", "force_N") if bias is None else ("control", "bias_N")
    target_force = load_N if bias is None else bias
    min_force, max_force = float(force[0]), float(force[_CURRENT_POINTS - 1])
    if not min_force < target_force < max_force:
        text = f"{target_force:g} N is outside the force range of the magnet at {gap:g} m"
        text += f", {min_force:.4g} to {max_force:.4g} N; correct it"
        raise faults_error(rig.path, [FileFault(key, text, code="out-of-range")])
    ascending_current_A = float(np.interp(target_force, force[:_CURRENT_POINTS], ascending_current))
    descending_current_A = float(np.interp(target_force, force[_CURRENT_POINTS:][::-1], ascending_current))
    current = 0.5 * (ascending_current_A + descending_current_A)
    hold = HeldBearing(rig).magnet().hold
    try:
        slopes = measure_slopes(hold, current, gap, 0.0, current_high_A, _GAP_STEP_M)
    except ValueError as error:
        text = f"at {target_force:g} N {error}; raise or lower it"
        raise faults_error(rig.path, [FileFault(key, text, code="out-of-range")]) from error
    current_span = 0.05 * current_high_A
    linkage = np.interp(
        [current - current_span, current + current_span], ascending_current, psi[:_CURRENT_POINTS]
    )
    magnet_count = float(len(rig.settings.body_magnets))
    point = linear.LinearBearing(
        mass=settings.body.mass_kg,
        k_i=magnet_count * slopes.static.k_i,
        k_s=magnet_count * slopes.static.k_s - settings.load.stiffness_N_per_m,
        inductance=magnet_count * float(linkage[1] - linkage[0]) / (2.0 * current_span),
        resistance=magnet_count * settings.magnet.poles.resistance,
        damping=settings.body.damping_N_s_per_m + settings.load.damping_N_s_per_m,
        eddy_time=settings.magnet.eddy_time_s,
    )
    check_rate(rig, point.current_drive_pole)
    return OperatingPoint(gap, target_force, current, float(force[_CURRENT_POINTS - 1]), slopes, point)


def has_constant_gains(setup: BearingSetup) -> bool:
    """Whether the compensator of a setup consists of constants, so that its loop is linear.

    For any other compensator, no linear loop describes small movements: their slope is between the
    static slope and the much smaller slope after a reversal.
    """
    return "k_i_N_per_A" in setup.compensator.parameters.constants


def check_load(rig: BodyRig, force_max: float) -> None:
    """Raise an error if a load is larger than the largest force."""
    load_N, faults = rig.static_load, list[FileFault]()
    if not load_N < force_max:
        text = f"no current can carry {load_N:.4g} N: the magnet reaches {force_max:.4g} N"
        text += "; lower it or raise current_high_A"
        faults.append(FileFault(("load", "force_N"), text, code="load-too-large"))
    for index, step in enumerate(rig.settings.load_steps_N):
        if load_N < force_max <= load_N + step:
            text = f"{load_N:.4g} N and this step are {load_N + step:.4g} N"
            text += f", the magnet reaches {force_max:.4g} N; lower it"
            assert rig.settings.load_case is not None
            key = rig.settings.key_path(rig.settings.load_case, "forces_N", index)
            faults.append(FileFault(key, text, code="load-too-large"))
    if faults:
        raise faults_error(rig.path, faults)


def check_rate(rig: BodyRig, pole_Hz: float) -> None:
    """Raise an error if the sample rate is too low for the unstable pole of the plant."""
    rate_Hz, min_rate_Hz = rig.settings.timing.rate_Hz, MIN_RATE_TO_POLE_FREQUENCY * pole_Hz
    if rate_Hz < min_rate_Hz:
        text = f"{rate_Hz:.6g} Hz is too low for the unstable pole of the plant at {pole_Hz:.4g} Hz"
        text += f"; use at least {MIN_RATE_TO_POLE_FREQUENCY:g} times that, {math.ceil(min_rate_Hz)} Hz"
        raise faults_error(rig.path, [FileFault(("timing", "rate_Hz"), text, code="rate-too-low")])


def _check_lift_off(rig: BodyRig, force_max: float) -> None:
    """Raise an error if the magnet cannot lift the load off its rest."""
    if not rig.static_load < force_max:
        gap = rig.settings.body.stop_high_m
        text = f"no current lifts {rig.static_load:.4g} N off the rest at {gap:g} m, the magnet reaches "
        text += f"{force_max:.4g} N there; lower it, lower stop_high_m or raise current_high_A"
        raise faults_error(rig.path, [FileFault(("load", "force_N"), text, code="load-too-large")])


def _check_probe(rig: BodyRig, probe: FluxSensorTable, density: float, gap: float) -> None:
    """Raise an error if a Hall probe cannot read the largest flux density at the smallest gap, T."""
    read_density = density * (1.0 + probe.gain_error)
    if read_density > probe.range_T:
        text = f"the largest current makes {read_density:.4g} T at a gap of {gap:g} m; raise it"
        key = rig.settings.key_path(probe, "range_T")
        raise faults_error(rig.path, [FileFault(key, text, code="range-too-narrow")])


def make_linear_loop(setup: BearingSetup, operating_point: OperatingPoint) -> linear.LinearLoop:
    """Return the linear loop of a setup for small movements.

    If the compensator consists of constants, the loop uses these constants. A constant ratio does
    not cancel the negative stiffness. Every other compensator is assumed to use the static slopes.
    """
    rig = setup.rig
    magnet_count = float(len(rig.settings.body_magnets))
    drive_constants = setup.compensator.parameters.constants
    k_i, k_s = operating_point.bearing.k_i, operating_point.bearing.k_s
    if has_constant_gains(setup):
        k_i = magnet_count * drive_constants["k_i_N_per_A"]
        k_s = magnet_count * drive_constants.get("k_s_N_per_m", 0.0)
    return linear.LinearLoop(
        bearing=operating_point.bearing,
        amplifier=make_amplifier(rig),
        timing=make_timing(rig),
        controller=setup.controller.pidd2(),
        compensation=linear.Compensation(k_i, k_s),
    )


def make_timing(rig: BodyRig) -> linear.LoopTiming:
    """Return rate, delay and sensor bandwidth of a rig's loop."""
    timing, sensor = rig.settings.timing, rig.settings.gap_sensor
    delay_s = rig.settings.amplifier.delay_s + sensor.delay_s
    return linear.LoopTiming(
        timing.rate_Hz, timing.delay_ticks + delay_s * timing.rate_Hz, sensor.bandwidth_Hz
    )


def make_amplifier(rig: BodyRig) -> linear.AnalogueAmplifier | linear.DigitalAmplifier:
    """Return the amplifier of a rig; that of a pair counts as one for both windings in series."""
    magnet_count = float(len(rig.settings.body_magnets))
    gain, integral_gain = (magnet_count * gain_ for gain_ in current_controller_gains(rig))
    if rig.settings.amplifier.mode == "current":
        return linear.AnalogueAmplifier(gain, integral_gain)
    return linear.DigitalAmplifier(
        magnet_count * rig.settings.magnet.poles.resistance,
        gain,
        integral_gain * rig.dt,
        rig.settings.current_sensor.bandwidth_Hz,
    )


def sweep_frequencies(rig: BodyRig) -> FloatArray:
    """Return the frequencies of a stepped sine around the bandwidth of a bearing, Hz."""
    return geometric_spacing(10.0, min(2000.0, 0.1 * rig.settings.timing.rate_Hz), 25)


PATHOLOGICAL_REVERSAL_TO_STATIC_SLOPE = 0.25
"""Slope after a reversal divided by the static slope, below which an iron is called pathological.
"""
_SETTLING_CYCLES = 3  # number of cycles until the loop is in steady state
_SAMPLES_PER_BRANCH = 400  # number of samples of a branch
_SLOPE_HALF_WIDTH_TO_RANGE = 0.05  # half-width of the fit of a static slope, relative to the current range
_REVERSAL_STEP_TO_RANGE = 0.0005  # size of the reversal, relative to the current range


@dataclass(frozen=True)
class Slopes:
    """The force at an operating point, and its slopes."""

    force: float  # force, N
    k_i: float  # slope of the force with respect to the current, N/A
    k_s: float  # slope of the force with respect to a reduction of the gap, N/m


@dataclass(frozen=True)
class ReversalSlopes:
    """Static slopes of a magnet with hysteresis, and its slopes just after a reversal."""

    static: Slopes  # force and slopes, averaged over both branches of the steady-state loop
    after_rise: float  # slope just after a maximum of the current, N/A
    after_fall: float

    @property
    def slope_ratio(self) -> float:
        """Ratio of the smaller of both slopes after a reversal to the static slope."""
        return min(self.after_rise, self.after_fall) / self.static.k_i

    @property
    def label(self) -> Literal["regular", "pathological"]:
        """Class of the iron."""
        return label_iron(self.slope_ratio)


def label_iron(slope_ratio: float) -> Literal["regular", "pathological"]:
    """Return the class of an iron from its ratio of the slope after a reversal to the static slope."""
    return "pathological" if slope_ratio < PATHOLOGICAL_REVERSAL_TO_STATIC_SLOPE else "regular"


def measure_slopes(
    force_at: Callable[[float, float], float],
    current: float,
    gap: float,
    current_low: float,
    current_high: float,
    gap_step: float,
) -> ReversalSlopes:
    """Measure the slopes of a magnet with hysteresis on its steady-state loop."""
    slope_span, reversal_step = (
        _SLOPE_HALF_WIDTH_TO_RANGE * (current_high - current_low),
        _REVERSAL_STEP_TO_RANGE * (current_high - current_low),
    )
    if not current_low + slope_span < current < current_high - slope_span:
        raise ValueError(
            f"the current of {current:g} A is too close to the ends of {current_low:g}..{current_high:g} A"
        )
    below_gap, at_gap, above_gap = (
        _mean_branch(force_at, current, held_gap, current_low, current_high)
        for held_gap in (gap - gap_step, gap, gap + gap_step)
    )
    _settle_on_loop(force_at, gap, current_low, current_high)
    ascending_force = _move_current(force_at, gap, current_low, current)[-1]
    after_rise = (ascending_force - force_at(current - reversal_step, gap)) / reversal_step
    _move_current(force_at, gap, current - reversal_step, current_high)
    descending_force = _move_current(force_at, gap, current_high, current)[-1]
    after_fall = (force_at(current + reversal_step, gap) - descending_force) / reversal_step
    k_s = (below_gap[0] - above_gap[0]) / (2.0 * gap_step)
    return ReversalSlopes(Slopes(at_gap[0], at_gap[1], k_s), float(after_rise), float(after_fall))


def _move_current(
    force_at: Callable[[float, float], float], gap: float, start: float, end: float
) -> FloatArray:
    """Move the current from one value to another, and return the forces along this path."""
    return np.array([force_at(float(x), gap) for x in np.linspace(start, end, _SAMPLES_PER_BRANCH + 1)[1:]])


def _settle_on_loop(
    force_at: Callable[[float, float], float], gap: float, current_low: float, current_high: float
) -> None:
    for _ in range(_SETTLING_CYCLES):
        _move_current(force_at, gap, current_low, current_high)
        _move_current(force_at, gap, current_high, current_low)


def _mean_branch(
    force_at: Callable[[float, float], float],
    current: float,
    gap: float,
    current_low: float,
    current_high: float,
) -> tuple[float, float]:
    """Return the force at a current, N, and its slope, N/A; both averaged over the two branches."""
    _settle_on_loop(force_at, gap, current_low, current_high)
    ascending, descending = (
        _move_current(force_at, gap, current_low, current_high),
        _move_current(force_at, gap, current_high, current_low),
    )
    grid = np.linspace(current_low, current_high, _SAMPLES_PER_BRANCH + 1)
    mean_force = 0.5 * (ascending[:-1] + descending[-2::-1])  # samples at grid[1:-1]
    deviation = grid[1:-1] - current
    is_near = np.abs(deviation) <= _SLOPE_HALF_WIDTH_TO_RANGE * (current_high - current_low)
    # A parabola is fitted, so that the curvature does not bias the slope.
    coefficients = np.polynomial.Polynomial.fit(deviation[is_near], mean_force[is_near], 2).convert().coef
    return float(coefficients[0]), float(coefficients[1])
