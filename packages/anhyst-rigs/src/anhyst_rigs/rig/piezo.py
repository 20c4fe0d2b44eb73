"""Describe a piezo stage, its controller, and the reference that the stage follows.

The feedforward converts the reference to a voltage. An integrator with a notch filter at the
resonance corrects the remaining error.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TypedDict

import numpy as np

from anhyst._core import PiezoLoop, PiezoMotion
from anhyst.compensate.force_controller import ForceController
from anhyst.control.pidd2 import integrator, notch
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst.support.toml_file import faults_error
from anhyst_rigs.rig.body import frequency_faults
from anhyst_rigs.rig.file import RigFile
from anhyst_rigs.rig.kind_rules import read_rig_file
from anhyst_rigs.rig.recording import Loss, SignalBound, find_loss

MAX_INTEGRATION_STEP_S = 25e-6
"""Longest integration step, s: a fortieth of the period of 1 kHz."""
NOISE_SEED = 20261125
"""Seed of the sensor noise."""


class PiezoControllerArguments(TypedDict):
    """Arguments with which the core makes the controller of a piezo stage."""

    filters: list[FloatArray]  # filters of the control error
    pid: FloatArray
    settings: Mapping[str, float]


@dataclass(frozen=True)
class PiezoRig:
    """A piezo stage, described by its rig file."""

    path: Path
    settings: RigFile

    def plant_parameters(self, dt: float) -> dict[str, float]:
        """Return the core's parameters for a tick period, s, with a constant command in each tick."""
        stack, flexure = self.settings.stack, self.settings.flexure
        steps = integration_steps(self.settings, dt)
        return {
            "stroke_per_volt": stack.stroke_m_per_V,
            "bend": stack.bend_m_per_V2,
            "slope": stack.slope_m_per_V,
            "beta": stack.beta_per_V,
            "gamma": stack.gamma_per_V,
            "omega": 2.0 * math.pi * flexure.resonance_Hz,
            "damping": flexure.damping_ratio,
            "kept": math.exp(-dt / steps / self.settings.stack_amplifier.time_constant_s),
            "step": dt / steps,
            "steps": steps,
        }

    def make_motion(self, dt: float) -> PiezoMotion:
        """Return the plant for a tick period, s."""
        creep_times, creep_shares = self.settings.stack.creep_times_s, self.settings.stack.creep_shares
        return PiezoMotion(self.plant_parameters(dt), np.array(creep_times), np.array(creep_shares))

    @property
    def dt(self) -> float:
        """Time between ticks, s."""
        return 1.0 / self.settings.timing.rate_Hz

    @property
    def corner_ticks(self) -> int:
        """Number of ticks in a rounded corner of the reference."""
        return max(1, round(self.settings.displacement_case.corner_s * self.settings.timing.rate_Hz))

    @property
    def response_delay(self) -> float:
        """Delay of the stage's response, s, which is known and independent of the compensation.

        It is the sum of one tick of delay, half a tick of hold, the time constant of the amplifier,
        and the phase slope of the resonance at low frequency.
        """
        flexure = self.settings.flexure
        resonance_delay = 2.0 * flexure.damping_ratio / (2.0 * np.pi * flexure.resonance_Hz)
        amplifier_delay = self.settings.stack_amplifier.time_constant_s
        return 1.5 / self.settings.timing.rate_Hz + amplifier_delay + resonance_delay

    def make_loop(self, plant: PiezoRig, drive: ForceController) -> PiezoLoop:
        """Return the plant after a long rest at 0 V, with the controller of this rig."""
        loop = PiezoLoop(plant.make_motion(self.dt), self.settings.position_sensor.step_m)
        loop.control(drive.native, **controller_arguments(self, drive))
        return loop


def integration_steps(file: RigFile, seconds: float) -> int:
    """Return the number of integration steps in a time, s: at least 40 per resonance period."""
    return max(1, math.ceil(seconds / min(MAX_INTEGRATION_STEP_S, 1.0 / (40.0 * file.flexure.resonance_Hz))))


def read_piezo_rig(path: PathLike) -> PiezoRig:
    """Read and check the rig file of a piezo stage."""
    settings = read_rig_file(path, "displacement")
    if faults := [*frequency_faults(settings, [settings.displacement_case])]:
        raise faults_error(path, faults)
    return PiezoRig(Path(path), settings)


def copy_at_rest(inverse: ForceController) -> ForceController:
    """Return a reset copy of an inverse, for a stack that has been at 0 V for a long time."""
    inverse_copy = inverse.reset_copy()
    if inverse_copy.format == "fixed":
        inverse_copy.native.commit(0, 0)
    return inverse_copy


def notch_parameters(file: RigFile) -> dict[str, float]:
    """Return frequency, damping and width of the notch filter; the defaults fit the resonance."""
    control, flexure = file.displacement, file.flexure
    return {
        "notch_Hz": control.notch_Hz or flexure.resonance_Hz,
        "notch_damping": control.notch_damping or flexure.damping_ratio,
        "notch_width": control.notch_width,
    }


def make_notch(file: RigFile) -> FloatArray:
    """Return the notch filter of the feedback."""
    rate, (frequency, damping, width) = file.timing.rate_Hz, notch_parameters(file).values()
    if frequency >= 0.5 * rate:
        raise InputError(
            f"timing.rate_Hz: {rate:g} Hz is too low for a notch filter at "
            f"{frequency:g} Hz; choose more than twice this frequency",
            code="rate-too-low",
            key="timing.rate_Hz",
        )
    return notch(frequency, damping, width, 1.0 / rate)


def controller_arguments(rig: PiezoRig, inverse: ForceController) -> PiezoControllerArguments:
    """Return the arguments of a controller that uses an inverse from displacement to voltage."""
    settings, is_fixed_point = rig.settings, inverse.format == "fixed"
    bandwidth = 2.0 * np.pi * settings.displacement.bandwidth_Hz
    return {
        "filters": [make_notch(settings)],
        "pid": integrator(bandwidth * rig.dt),
        "settings": {
            "demand_full": inverse.scales.demand if is_fixed_point else 1.0,
            "current_full": inverse.scales.current if is_fixed_point else 1.0,
            "flux_full": 1.0,
            "gap_low": 0.0,
            "gap_high": 1.0,
            "current_low": settings.stack_amplifier.low_V,
            "current_high": settings.stack_amplifier.high_V,
            "current_step": 0.0,
        },
    }


def triangle_wave(phase: FloatArray) -> FloatArray:
    """Return a triangle for phases in periods: 0 at integers, 1 halfway between them."""
    wave: FloatArray = 1.0 - np.abs(1.0 - 2.0 * (phase % 1.0))
    return wave


def round_corners(path: FloatArray, corner_ticks: int) -> FloatArray:
    """Return a path with corners rounded over `width` ticks, without its first `width` ticks.

    The path passes twice through a moving average over half of `width`. This removes oscillations
    of which a whole number of periods fits into the average.
    """
    kernel = np.ones(max(1, corner_ticks // 2)) / max(1, corner_ticks // 2)
    return np.asarray(np.convolve(np.convolve(path, kernel), kernel)[corner_ticks : len(path)])


def find_piezo_loss(rig: PiezoRig, error: FloatArray, feedback: FloatArray) -> Loss | None:
    """Return the first loss of control, at which the error or the feedback, m, exceeds the stroke."""
    stroke = rig.settings.displacement_case.stroke_m
    bounds = (
        SignalBound("the error reached the whole stroke", error, -stroke, stroke),
        SignalBound("the feedback demanded more than the stroke", feedback, -stroke, stroke),
    )
    return find_loss(bounds, planned_ticks=error.size)


def files_of_piezo(path: PathLike, controller: PathLike | None) -> list[Path]:
    """Return the rig file; it does not name other files."""
    del controller
    return [Path(path)]
