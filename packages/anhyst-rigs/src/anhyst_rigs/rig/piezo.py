"""A piezo stage from its rig file, its controller, and the path that both follow.

The reference goes through the feedforward at once, and an integrator behind a notch filter at the
resonance corrects what is left.
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
"""Longest step of the integration, s: a fortieth of the period of 1 kHz."""
NOISE_SEED = 20261125
"""Of the noise of the sensor."""


class PiezoControllerArguments(TypedDict):
    """A controller of a piezo stage as the core takes it."""

    filters: list[FloatArray]  # of the deviation
    pid: FloatArray
    settings: Mapping[str, float]


@dataclass(frozen=True)
class PiezoRig:
    """A piezo stage as its file describes it."""

    path: Path
    settings: RigFile

    def plant_parameters(self, dt: float) -> dict[str, float]:
        """Return it as the core takes it, for ticks of a length, s, on which a command is held."""
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
        """Return it for ticks of a length, s."""
        times, shares = self.settings.stack.creep_times_s, self.settings.stack.creep_shares
        return PiezoMotion(self.plant_parameters(dt), np.array(times), np.array(shares))

    @property
    def dt(self) -> float:
        """Time between ticks, s."""
        return 1.0 / self.settings.timing.rate_Hz

    @property
    def corner_ticks(self) -> int:
        """Ticks over which corners of the path are rounded."""
        return max(
            1, round(self.settings.displacement_case.corner_s * self.settings.timing.rate_Hz)
        )

    @property
    def response_delay(self) -> float:
        """What the stage answers later, s: known, and the same whatever makes the voltage.

        One sample of delay and half a one of hold, the amplifier, and the slope of the phase below
        the resonance.
        """
        flexure = self.settings.flexure
        rounded = 2.0 * flexure.damping_ratio / (2.0 * np.pi * flexure.resonance_Hz)
        late = self.settings.stack_amplifier.time_constant_s
        return 1.5 / self.settings.timing.rate_Hz + late + rounded

    def make_loop(self, plant: PiezoRig, drive: ForceController) -> PiezoLoop:
        """Return a stage at long rest at 0 V behind the controller of this one."""
        loop = PiezoLoop(plant.make_motion(self.dt), self.settings.position_sensor.step_m)
        loop.control(drive.native, **controller_arguments(self, drive))
        return loop


def integration_steps(file: RigFile, seconds: float) -> int:
    """Return the steps in which a stage is integrated: 40 a period of its resonance, or more."""
    return max(
        1,
        math.ceil(seconds / min(MAX_INTEGRATION_STEP_S, 1.0 / (40.0 * file.flexure.resonance_Hz))),
    )


def read_piezo_rig(path: PathLike) -> PiezoRig:
    """Read and check the rig file of a piezo stage."""
    settings = read_rig_file(path, "displacement")
    if faults := [*frequency_faults(settings, [settings.displacement_case])]:
        raise faults_error(path, faults)
    return PiezoRig(Path(path), settings)


def copy_at_rest(inverse: ForceController) -> ForceController:
    """Return another of the same parameters, for a stack that is at 0 V for long."""
    fresh = inverse.reset_copy()
    if fresh.format == "fixed":
        fresh.native.commit(0, 0)
    return fresh


def notch_parameters(file: RigFile) -> dict[str, float]:
    """Return frequency, damping and width of the notch filter: those of the resonance if left out."""
    control, flexure = file.displacement, file.flexure
    return {
        "notch_Hz": control.notch_Hz or flexure.resonance_Hz,
        "notch_damping": control.notch_damping or flexure.damping_ratio,
        "notch_width": control.notch_width,
    }


def make_notch(file: RigFile) -> FloatArray:
    """Return the notch filter in the feedback."""
    rate, (frequency, damping, width) = file.timing.rate_Hz, notch_parameters(file).values()
    if frequency >= 0.5 * rate:
        raise InputError(
            f"timing.rate_Hz: {rate:g} ticks a second are too few for a notch filter at "
            f"{frequency:g} Hz, the resonance; give more than twice as many",
            code="rate-too-low",
            key="timing.rate_Hz",
        )
    return notch(frequency, damping, width, 1.0 / rate)


def controller_arguments(rig: PiezoRig, inverse: ForceController) -> PiezoControllerArguments:
    """Return the controller of a stage behind what makes voltages of displacements."""
    settings, coded = rig.settings, inverse.format == "fixed"
    bandwidth = 2.0 * np.pi * settings.displacement.bandwidth_Hz
    return {
        "filters": [make_notch(settings)],
        "pid": integrator(bandwidth * rig.dt),
        "settings": {
            "demand_full": inverse.scales.demand if coded else 1.0,
            "current_full": inverse.scales.current if coded else 1.0,
            "flux_full": 1.0,
            "gap_low": 0.0,
            "gap_high": 1.0,
            "current_low": settings.stack_amplifier.low_V,
            "current_high": settings.stack_amplifier.high_V,
            "current_step": 0.0,
        },
    }


def triangle_wave(phase: FloatArray) -> FloatArray:
    """Return what a triangle is at its phase, in periods: 0 at whole ones, 1 in between."""
    wave: FloatArray = 1.0 - np.abs(1.0 - 2.0 * (phase % 1.0))
    return wave


def round_corners(path: FloatArray, width: int) -> FloatArray:
    """Return a path with its corners rounded over so many ticks, all but the first of which it has.

    Twice the mean over half of it: what the resonance answers to is gone at whole periods.
    """
    half = np.ones(max(1, width // 2)) / max(1, width // 2)
    return np.asarray(np.convolve(np.convolve(path, half), half)[width : len(path)])


def find_piezo_loss(rig: PiezoRig, error: FloatArray, correction: FloatArray) -> Loss | None:
    """Return where the loop was lost, by the deviation and by what the feedback asks for, m."""
    stroke = rig.settings.displacement_case.stroke_m
    bounds = (
        SignalBound("the deviation was the whole stroke", error, -stroke, stroke),
        SignalBound("the feedback asked for more than the stroke", correction, -stroke, stroke),
    )
    return find_loss(bounds, planned=error.size)


def files_of_piezo(path: PathLike, controller: PathLike | None) -> list[Path]:
    """Return the rig file, which names no other."""
    del controller
    return [Path(path)]
