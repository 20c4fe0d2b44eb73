"""A stage and its controller in lock-step: runs motions."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from anhyst._core import FixedAxes, LoopController, Plant, TrackingAxes, TrackingAxesF32
from anhyst.compensate.block import Block
from anhyst.compensate.force_controller import ForceController
from anhyst.compensate.methods import HysteresisInverse
from anhyst.control.fixed_axes import Drives, FixedController, fixed_axes
from anhyst.control.position import Allocation
from anhyst.support.kinds import MethodName, NumberFormat
from anhyst.support.numeric import FloatArray
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.calibration import ParameterName
from anhyst_rigs.rig.drift import NO_DRIFT, Drift, drifted_plant
from anhyst_rigs.rig.loop import Scenario, Setup, SimulatedLoop
from anhyst_rigs.rig.recording import Recording
from anhyst_rigs.rig.stage.calibrated import believed
from anhyst_rigs.rig.stage.drives import (
    least_of,
    opposed,
    usual_allocation,
    watch_settings,
    wrench_layout,
    yields,
)
from anhyst_rigs.rig.stage.geometry import (
    along_scan,
    axes_of,
    decoupling,
    head_rows,
    pull_rows,
    scan_direction,
    stops_of,
    travel_m,
    weight,
    without,
)
from anhyst_rigs.rig.stage.recording import recorded, stage_loss
from anhyst_rigs.rig.stage.setpoint import SetPoint, instants, stray, ticks_of

AT_BIAS: tuple[MethodName, ...] = ("ratio", "secant", "linearised")
"""Methods of constants: the force is shared out by class A, around the bias they are fitted at."""
ODD = 2.0
"""By how much farther off than the end stops let it a reading is not believed."""


@dataclass(frozen=True)
class Feedforward:
    """Gains of the force that is fed forward: ``mass*(a + jerk*j + snap*s)`` with ``a`` weighted."""

    acceleration: float = 1.0  # 1 for the mass that the file says
    jerk: float = 0.0  # s
    snap: float = 0.0  # s2


@dataclass(frozen=True)
class StageSetup(Setup):
    """All that a run of a stage needs."""

    # number format of PID and allocation; f64 goes with any compensator, f32 with f32 and fixed
    law: NumberFormat = "f64"
    drift: Drift = NO_DRIFT  # by which the plant is not what was calibrated
    correction: FloatArray | None = None  # of every magnet, as the core has it; not in fixed point
    # what was found of the body: what is fed forward is for its mass and centre of mass
    body: Mapping[ParameterName, float] = field(default_factory=dict)
    cable: float = 0.0  # N/m, and against such a cable

    @property
    def believed(self) -> BodyRig:
        """The stage as its controller believes it to be."""
        return believed(self.rig, self.body) if self.body else self.rig

    def make_plant(self, seed: int) -> Plant:
        """Return the plant, drifted, at rest where it works, its iron demagnetised."""
        return drifted_plant(self.rig, self.drift, seed)

    def make_controller(self, drives: Sequence[ForceController] = ()) -> LoopController:
        """Return PIDs and allocation over force controllers, in their formats."""
        return axes_controller(self, drives)


def pid(rig: BodyRig) -> dict[str, float]:
    """Return the PID as a filter of second order, by the trapezoidal rule.

    Where integral and lead end and begin, the rig file says in parts of the crossover.
    """
    table, dt = rig.settings.tracking, rig.dt
    omega = 2.0 * math.pi * table.crossover_Hz
    low, lead = omega / table.integral_ratio, omega / table.lead_ratio
    high = table.rolloff_ratio * omega

    def shape(s: complex) -> complex:
        return (s + low) / s * (1.0 + s / lead) / (1.0 + s / high)

    jw = 1j * omega
    gain = rig.settings.body.mass_kg * omega**2 / abs(shape(jw))
    # gain*(s + low)*(1 + s/lead)/(s*(1 + s/high)), s = fast*(z - 1)/(z + 1)
    fast = 2.0 / dt
    up = (1.0 / lead, 1.0 + low / lead, low)
    down = (1.0 / high, 1.0, 0.0)

    def bilinear(p: tuple[float, float, float]) -> tuple[float, float, float]:
        a, b, c = p[0] * fast**2, p[1] * fast, p[2]
        return a + b + c, 2.0 * (c - a), a - b + c

    numerator, denominator = bilinear(up), bilinear(down)
    b0, b1, b2 = (gain * one / denominator[0] for one in numerator)
    a1, a2 = (one / denominator[0] for one in denominator[1:])
    return {"b0": b0, "b1": b1, "b2": b2, "a1": a1, "a2": a2}


def feed(setup: StageSetup, motion: SetPoint, gains: Feedforward) -> FloatArray:
    """Return the force fed forward at every tick, N, so much earlier as the loop is late."""
    rig = setup.rig
    time = instants(rig, ticks_of(rig, motion)) + rig.late
    place, acceleration, jerk, snap = motion.at(time)
    moved = gains.acceleration * acceleration + gains.jerk * jerk + gains.snap * snap
    return np.asarray(setup.believed.settings.body.mass_kg * moved + setup.cable * place)


def track(
    setup: StageSetup,
    motion: SetPoint,
    gains: Feedforward,
    seed: int = 0,
    learnt: FloatArray | None = None,
    load: FloatArray | None = None,
) -> Recording:
    """Follow a motion from rest, the iron demagnetised.

    `learnt` is added to what is fed forward; the controller does not know `load`, N, which pushes
    along the set-point.
    """
    rig, n = setup.rig, ticks_of(setup.rig, motion)
    time = instants(rig, n + 1)
    place, forward = motion.at(time)[0], feed(setup, motion, gains)
    if learnt is not None:
        forward = forward + learnt
    wrench = fed_wrench(setup.believed, forward)
    scenario = scenario_along(rig, place, stray(rig, motion, time), wrench)
    # The body is off its reference by too little for the cable to feel it.
    pulled = -setup.drift.cable * place[:n] + (0.0 if load is None else load)
    return follow(setup, replace(scenario, load=pulled), seed)


def scenario_along(
    rig: BodyRig, place: FloatArray, stray: FloatArray, wrench: FloatArray, offset: float = 0.0
) -> Scenario:
    """Return the scenario of a stage that moves along its set-point, or an offset beside it, m.

    Places and stray of the long stroke, m, have a value more than the wrench has rows. The magnets
    ride on the frame, position heads do not.
    """
    n, along = len(wrench), scan_direction(rig.settings)
    frame = np.outer(place + stray, along)
    return Scenario(np.outer(place[:n] + offset, along), feed=wrench, frame=frame)


def follow(setup: StageSetup, scenario: Scenario, seed: int = 0) -> Recording:
    """Go through a scenario from rest."""
    rig, run = setup.rig, SimulatedLoop(setup, seed).run(scenario)
    return Recording(recorded(rig, run, scenario), stage_loss(rig, run, scenario.ticks))


def fed_wrench(rig: BodyRig, forward: FloatArray) -> FloatArray:
    """Return the wrench of a force along the set-point, a row a tick.

    It moves the centre of mass, and carries the weight.
    """
    file = rig.settings
    return np.asarray(np.outer(forward, along_scan(file)) - weight(file))


def bias(rig: BodyRig, method: str) -> float:
    """Return what either magnet pulls with at rest, N: for constants half of the largest force."""
    if rig.settings.magnet.both_ways:
        return 0.0
    return 0.5 * rig.settings.tracking.force_max_N if method in AT_BIAS else rig.idle


def axes_rows(setup: StageSetup) -> dict[str, FloatArray]:
    """Return the matrices of a controller, by their names in the core.

    Beside them `at`, what each head reads of a pose.
    """
    file, at = setup.rig.settings, head_rows(setup.rig.settings)
    decouple, weigh = decoupling(setup.believed.settings)
    b0, b1, b2, a1, a2 = pid(setup.rig).values()
    mass, speed = file.body.mass_kg, file.tracking.land_m_per_s * setup.rig.dt
    ends = np.array(stops_of(file))[:, None]
    return {
        "at": at,
        "see": np.ascontiguousarray(np.linalg.pinv(at)),
        "without": without(file).reshape(at.size, len(at)),
        "ground": np.array(axes_of(file) if file.heads_stand else [], dtype=float),
        "decouple": decouple,
        "weigh": weigh,
        "pid": np.array([[b0 / mass, b1 / mass, b2 / mass, a1, a2]] * len(file.body.free)),
        "reach": ODD * ends,
        "lift": ends * (file.tracking.lift_m_per_s * setup.rig.dt / travel_m(file)),
        "land": np.array([[-speed * (axis == "z")] for axis in file.body.free]),
    }


def axes_controller(
    setup: StageSetup, drives: Sequence[ForceController] = ()
) -> TrackingAxes | FixedAxes:
    """Return PIDs, decoupling and allocation over force controllers."""
    magnets = [one.native for one in drives or setup.fresh()]
    if setup.law == "fixed":
        assert setup.correction is None, "in fixed point nothing corrects a force controller"
        return fixed_words(setup).over(magnets, setup.compensator.parameters.flux_full_scale)
    settings = controller_settings(setup) | watch_settings(setup.rig)
    kind, idle = Allocation(int(settings.pop("allocation"))), settings.pop("idle")
    made = TrackingAxesF32 if setup.law == "f32" else TrackingAxes
    controller = made(
        magnets, wrench_layout(setup.rig.settings, kind, idle), axes_rows(setup), settings
    )
    if setup.correction is not None:
        controller.correct(setup.correction)
    return controller


def fixed_words(setup: StageSetup) -> FixedController:
    """Return the words of a controller in fixed point."""
    file, settings = setup.rig.settings, controller_settings(setup)
    how = int(settings["allocation"]), settings["idle"]
    bounds = least_of(file), file.tracking.force_max_N
    drives = Drives(pull_rows(file), opposed(file), yields(file), *how, *bounds)
    return fixed_axes(axes_rows(setup), drives, settings | watch_settings(setup.rig))


def controller_settings(setup: StageSetup) -> dict[str, float]:
    """Return what a controller is given beside its PID and its magnets, SI."""
    rig, compensator = setup.rig, setup.compensator
    amplifier, scales = rig.settings.amplifier, compensator.scales
    low, high = amplifier.current_low_A, amplifier.current_high_A
    allocation = usual_allocation(rig.settings)
    if setup.method in AT_BIAS and allocation is Allocation.CLASS_AB:
        allocation = Allocation.BY_HALVES
    return {
        "demand_full": scales.demand,
        "current_full": scales.current,
        "flux_full": compensator.parameters.flux_full_scale,
        "gap_low": scales.gap_low,
        "gap_high": scales.gap_high,
        "allocation": allocation,
        "idle": bias(rig, setup.method),
        "current_low": low,
        "current_high": high,
        "current_step": (high - low) / ((1 << amplifier.dac_bits) - 1),
    }


def blocks_of(setup: StageSetup) -> list[Block]:
    """Return for each magnet the parameter block of its compensator of a law."""
    return [block_of(compensator) for compensator in setup.each]


def block_of(compensator: ForceController) -> Block:
    """Return the parameter block of a compensator of a law."""
    assert isinstance(compensator.parameters, HysteresisInverse)
    return compensator.parameters.block
