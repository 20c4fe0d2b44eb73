"""Run motions of a stage, whose plant and controller advance together tick by tick.

The module also computes PID, feedforward and controller settings from the rig file.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from anhyst._core import FixedAxes, LoopController, Plant, TrackingAxes, TrackingAxesF32
from anhyst.compensate.block import Block
from anhyst.compensate.force_controller import ForceController
from anhyst.compensate.methods import HysteresisInverse
from anhyst.control.fixed_axes import DriveLayout, FixedController, make_fixed_controller
from anhyst.control.position import Allocation
from anhyst.support.kinds import MethodName, NumberFormat
from anhyst.support.numeric import FloatArray
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.calibration import ParameterName
from anhyst_rigs.rig.drift import NO_DRIFT, Drift, drifted_plant
from anhyst_rigs.rig.loop import Scenario, Setup, SimulatedLoop
from anhyst_rigs.rig.recording import Recording
from anhyst_rigs.rig.stage.calibrated import assumed_rig
from anhyst_rigs.rig.stage.drives import (
    axis_yield_weights,
    min_single_force,
    monitoring_settings,
    opposing_magnets,
    usual_allocation,
    wrench_layout,
)
from anhyst_rigs.rig.stage.geometry import (
    axis_indices,
    decoupling_matrices,
    head_rows,
    inverses_without_head,
    magnet_rows,
    scan_direction,
    scan_wrench,
    stop_distances,
    travel_m,
    weight_wrench,
)
from anhyst_rigs.rig.stage.recording import find_stage_loss, recording_columns
from anhyst_rigs.rig.stage.setpoint import SetPoint, long_stroke_error, motion_ticks, tick_times

CONSTANT_METHODS: tuple[MethodName, ...] = ("ratio", "secant", "linearised")
"""Methods whose compensator consists of constants. In a pair of magnets, these methods use half of
the largest force as the bias force of each magnet."""
MAX_POSE_TO_STOP_DISTANCE = 2.0
"""Largest plausible pose, relative to the end stops. A larger reading is rejected."""


@dataclass(frozen=True)
class Feedforward:
    """Gains of the feedforward force ``mass*(acceleration*a + jerk*j + snap*s)``."""

    acceleration: float = 1.0  # factor of the acceleration; 1: the mass of the rig file
    jerk: float = 0.0  # factor of the jerk, s
    snap: float = 0.0  # factor of the snap, s^2
    # error with searched gains on withheld turnarounds, relative to that with the mass alone
    searched_error_ratio: float | None = field(default=None, compare=False)

    def as_dict(self) -> dict[str, float | None]:
        """Return the gains for JSON."""
        gains = {"acceleration": self.acceleration, "jerk_s": self.jerk, "snap_s2": self.snap}
        return gains | {"searched_error_ratio": self.searched_error_ratio}


@dataclass(frozen=True)
class StageSetup(Setup):
    """All data for a run of a stage."""

    # number format of PID and allocation; f64 for any compensator, f32 for f32 and fixed ones
    number_format: NumberFormat = "f64"
    drift: Drift = NO_DRIFT  # difference between the plant and the rig file
    # corrections of every magnet, one row each as in the core; not available in fixed point
    correction_rows: FloatArray | None = None
    # estimated changes of mass and centre of mass, which the feedforward uses
    body_corrections: Mapping[ParameterName, float] = field(default_factory=dict)
    cable_stiffness: float = 0.0  # estimated stiffness that the feedforward compensates, N/m

    @property
    def assumed_rig(self) -> BodyRig:
        """Stage with the mass and the centre of mass that its controller assumes."""
        return assumed_rig(self.rig, self.body_corrections) if self.body_corrections else self.rig

    def make_plant(self, seed: int) -> Plant:
        """Return the drifted plant at its operating point, at rest and demagnetised."""
        return drifted_plant(self.rig, self.drift, seed)

    def make_controller(self, drives: Sequence[ForceController] = ()) -> LoopController:
        """Return PID and allocation with the force controllers, each in its number format."""
        return make_axes_controller(self, drives)


def pid_coefficients(rig: BodyRig) -> dict[str, float]:
    """Return the PID as a second-order filter, discretised by the trapezoidal rule.

    The rig file gives the corners of integral and lead relative to the crossover frequency.
    """
    table, dt = rig.settings.tracking, rig.dt
    omega = 2.0 * math.pi * table.crossover_Hz
    integral_frequency, lead_frequency = omega / table.integral_ratio, omega / table.lead_ratio
    rolloff_frequency = table.rolloff_ratio * omega

    def shape(s: complex) -> complex:
        return (s + integral_frequency) / s * (1.0 + s / lead_frequency) / (1.0 + s / rolloff_frequency)

    jw = 1j * omega
    gain = rig.settings.body.mass_kg * omega**2 / abs(shape(jw))
    # gain*(s + low)*(1 + s/lead)/(s*(1 + s/high)), s = bilinear_rate*(z - 1)/(z + 1)
    bilinear_rate = 2.0 / dt
    numerator_s = (1.0 / lead_frequency, 1.0 + integral_frequency / lead_frequency, integral_frequency)
    denominator_s = (1.0 / rolloff_frequency, 1.0, 0.0)

    def bilinear(p: tuple[float, float, float]) -> tuple[float, float, float]:
        a, b, c = p[0] * bilinear_rate**2, p[1] * bilinear_rate, p[2]
        return a + b + c, 2.0 * (c - a), a - b + c

    numerator, denominator = bilinear(numerator_s), bilinear(denominator_s)
    b0, b1, b2 = (gain * coefficient / denominator[0] for coefficient in numerator)
    a1, a2 = (coefficient / denominator[0] for coefficient in denominator[1:])
    return {"b0": b0, "b1": b1, "b2": b2, "a1": a1, "a2": a2}


def feedforward_force(setup: StageSetup, motion: SetPoint, gains: Feedforward) -> FloatArray:
    """Return the feedforward force at every tick, N, advanced by the delay of the loop."""
    rig = setup.rig
    time = tick_times(rig, motion_ticks(rig, motion)) + rig.loop_delay
    position, acceleration, jerk, snap = motion.derivatives_at(time)
    mass_acceleration = gains.acceleration * acceleration + gains.jerk * jerk + gains.snap * snap
    return np.asarray(
        setup.assumed_rig.settings.body.mass_kg * mass_acceleration + setup.cable_stiffness * position
    )


def track(
    setup: StageSetup,
    motion: SetPoint,
    gains: Feedforward,
    seed: int = 0,
    learnt_force: FloatArray | None = None,
    load: FloatArray | None = None,
) -> Recording:
    """Run a motion that begins at rest with demagnetised iron.

    `learnt_force` adds to the feedforward. `load`, N, along the set-point, is unknown to the
    controller.
    """
    rig, n = setup.rig, motion_ticks(setup.rig, motion)
    time = tick_times(rig, n + 1)
    position, feedforward = motion.derivatives_at(time)[0], feedforward_force(setup, motion, gains)
    if learnt_force is not None:
        feedforward = feedforward + learnt_force
    wrench = feedforward_wrench(setup.assumed_rig, feedforward)
    scenario = scan_scenario(rig, position, long_stroke_error(rig, motion, time), wrench)
    # The position error is too small for a noticeable change of the cable force.
    external_force = -setup.drift.cable * position[:n] + (0.0 if load is None else load)
    return run_scenario(setup, replace(scenario, load=external_force), seed)


def scan_scenario(
    rig: BodyRig, positions: FloatArray, stroke_error: FloatArray, wrench: FloatArray, offset: float = 0.0
) -> Scenario:
    """Return the scenario of a motion along the set-point, with an optional offset, m.

    `positions` are those of the long stroke and `stroke_error` its path error, m; each has one value
    more than `wrench` has rows. The magnets ride on the long stroke, the position heads do not.
    """
    n, scan_axis = len(wrench), scan_direction(rig.settings)
    frame = np.outer(positions + stroke_error, scan_axis)
    return Scenario(np.outer(positions[:n] + offset, scan_axis), feed=wrench, frame=frame)


def run_scenario(setup: StageSetup, scenario: Scenario, seed: int = 0) -> Recording:
    """Run a scenario from rest, and check whether control is lost."""
    rig, run = setup.rig, SimulatedLoop(setup, seed).run(scenario)
    return Recording(recording_columns(rig, run, scenario), find_stage_loss(rig, run, scenario.ticks))


def feedforward_wrench(rig: BodyRig, scan_force: FloatArray) -> FloatArray:
    """Return the wrench of a force at the centre of mass along the set-point, one row per tick.

    The weight, which the magnets also carry, is included.
    """
    file = rig.settings
    return np.asarray(np.outer(scan_force, scan_wrench(file)) - weight_wrench(file))


def bias_force(rig: BodyRig, method: str) -> float:
    """Return the force of each magnet at rest, N: half of the largest force for constant methods."""
    if rig.settings.magnet.is_bidirectional:
        return 0.0
    return 0.5 * rig.settings.tracking.force_max_N if method in CONSTANT_METHODS else rig.idle_force


def controller_matrices(setup: StageSetup) -> dict[str, FloatArray]:
    """Return the matrices of a controller, by their names in the core.

    In addition, the matrix `at` gives the reading of each head for a unit of each coordinate.
    """
    file, head_matrix = setup.rig.settings, head_rows(setup.rig.settings)
    decoupling_matrix, weight_matrix = decoupling_matrices(setup.assumed_rig.settings)
    b0, b1, b2, a1, a2 = pid_coefficients(setup.rig).values()
    mass, speed = file.body.mass_kg, file.tracking.land_m_per_s * setup.rig.dt
    stops = np.array(stop_distances(file))[:, None]
    return {
        "at": head_matrix,
        "see": np.ascontiguousarray(np.linalg.pinv(head_matrix)),
        "without": inverses_without_head(file).reshape(head_matrix.size, len(head_matrix)),
        "ground": np.array(axis_indices(file) if file.has_ground_heads else [], dtype=float),
        "decouple": decoupling_matrix,
        "weigh": weight_matrix,
        "pid": np.array([[b0 / mass, b1 / mass, b2 / mass, a1, a2]] * len(file.body.free)),
        "reach": MAX_POSE_TO_STOP_DISTANCE * stops,
        "lift": stops * (file.tracking.lift_m_per_s * setup.rig.dt / travel_m(file)),
        "land": np.array([[-speed * (axis == "z")] for axis in file.body.free]),
    }


def make_axes_controller(
    setup: StageSetup, drives: Sequence[ForceController] = ()
) -> TrackingAxes | FixedAxes:
    """Return a controller with PID, decoupling and allocation, and with the force controllers."""
    magnets = [drive.native for drive in drives or setup.make_compensators()]
    if setup.number_format == "fixed":
        assert setup.correction_rows is None, "in fixed point nothing corrects a force controller"
        return make_fixed_stage_controller(setup).make_core(
            magnets, setup.compensator.parameters.flux_full_scale
        )
    settings = controller_settings(setup) | monitoring_settings(setup.rig)
    kind, idle_force = Allocation(int(settings.pop("allocation"))), settings.pop("idle")
    controller_class = TrackingAxesF32 if setup.number_format == "f32" else TrackingAxes
    controller = controller_class(
        magnets, wrench_layout(setup.rig.settings, kind, idle_force), controller_matrices(setup), settings
    )
    if setup.correction_rows is not None:
        controller.correct(setup.correction_rows)
    return controller


def make_fixed_stage_controller(setup: StageSetup) -> FixedController:
    """Return the controller in fixed point."""
    file, settings = setup.rig.settings, controller_settings(setup)
    allocation = int(settings["allocation"]), settings["idle"]
    bounds = min_single_force(file), file.tracking.force_max_N
    drives = DriveLayout(
        magnet_rows(file), opposing_magnets(file), axis_yield_weights(file), *allocation, *bounds
    )
    return make_fixed_controller(
        controller_matrices(setup), drives, settings | monitoring_settings(setup.rig)
    )


def controller_settings(setup: StageSetup) -> dict[str, float]:
    """Return the settings of a controller except its PID and its geometry, SI units."""
    rig, compensator = setup.rig, setup.compensator
    amplifier, scales = rig.settings.amplifier, compensator.scales
    current_low, current_high = amplifier.current_low_A, amplifier.current_high_A
    allocation = usual_allocation(rig.settings)
    if setup.method in CONSTANT_METHODS and allocation is Allocation.CLASS_AB:
        allocation = Allocation.BY_HALVES
    return {
        "demand_full": scales.demand,
        "current_full": scales.current,
        "flux_full": compensator.parameters.flux_full_scale,
        "gap_low": scales.gap_low,
        "gap_high": scales.gap_high,
        "allocation": allocation,
        "idle": bias_force(rig, setup.method),
        "current_low": current_low,
        "current_high": current_high,
        "current_step": (current_high - current_low) / ((1 << amplifier.dac_bits) - 1),
    }


def parameter_blocks(setup: StageSetup) -> list[Block]:
    """Return the parameter block of each magnet; its compensator must use a hysteresis law."""
    return [parameter_block(compensator) for compensator in setup.compensators]


def parameter_block(compensator: ForceController) -> Block:
    """Return the parameter block of a compensator that uses a hysteresis law."""
    assert isinstance(compensator.parameters, HysteresisInverse)
    return compensator.parameters.block
