"""Identify models for force control, and represent the controller programs made from them."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from anhyst._core import FixedCompensator
from anhyst.compensate.block import Block, Kind
from anhyst.data import Loops
from anhyst.model.actuator import Model
from anhyst.model.parameters import Parameter
from anhyst.support.block_words import Scales
from anhyst.support.errors import InputError
from anhyst.support.jobs import Progress
from anhyst.support.kinds import MethodName
from anhyst.support.numeric import FloatArray
from anhyst_rigs.rig.drift import map_parameter
from anhyst_rigs.rig.force.file import ForceControlRig
from anhyst_rigs.rig.measurement_table import identify_loops

Codes = NDArray[np.int64]

Q31_ONE = 1 << 31


@dataclass(frozen=True)
class Program:
    """A controller program as it is written to the flash memory."""

    kind: Kind  # kind of the compensator, ``"full"`` or ``"simplified"``
    name: MethodName  # method: the same, or ``"at-rest"``
    model: Model  # model of the compiled program
    block: Block  # parameter block of the kind that the hysteresis law of the model needs
    cycles: int  # number of cycles of the start-up sequence
    firmware: Path  # path of the firmware, built for the board on which it runs

    @property
    def scales(self) -> Scales:
        """Full scale of each signal."""
        return self.block.scales

    @property
    def conditioning_currents(self) -> list[float]:
        """Reversal points of the start-up sequence, A: the limits of the current."""
        low, high = self.block.limits.current
        return [high, low] * self.cycles

    def gap_codes(self, gap: FloatArray) -> Codes:
        """Return the firmware codes of gap readings, m, as q31 of the gap range."""
        codes = np.rint(self.scales.gap_fraction(gap) * (Q31_ONE >> 1)).astype(np.int64)
        return np.minimum(2 * np.clip(codes, 0, Q31_ONE >> 1), Q31_ONE - 1)

    def demand_code(self, force: float) -> int:
        """Return the code of a force, N, on the link, as q31 of full scale."""
        return min(round(force / self.scales.demand * Q31_ONE), Q31_ONE - 1)


@dataclass(frozen=True)
class FirmwareSession:
    """Codes that a firmware and its bench exchanged at every tick since power-on."""

    gap: Codes  # gap that the controller used, q31
    drive: Codes  # driven current, q31 of full scale
    demand: Codes  # active demand at the ticks of the run, q31
    first_run_tick: int  # first tick of the run
    # whether the command DEMAGNETISED preceded the run, so that earlier currents have no effect
    is_demagnetised: bool


def count_differing_ticks(program: Program, session: FirmwareSession) -> int:
    """Repeat a session in this process; return the number of ticks whose current differs.

    Every tick uses the gap and the demand of the firmware, and the results should be bit-identical.
    """
    core = FixedCompensator(program.block.kind, program.block.words)
    first_tick = session.first_run_tick
    if not session.is_demagnetised:
        history = np.column_stack([session.drive[:first_tick], session.gap[:first_tick]])
        for codes in history.tolist():
            core.commit_q31(*codes)
    demand, gap = session.demand.astype(np.int32), session.gap[first_tick:].astype(np.int32)
    return int(np.count_nonzero(core.run(demand, gap, False) != session.drive[first_tick:]))


MIN_DEAD_BAND_SIGMAS = 5.0
"""Smallest half-width of the dead band, in standard deviations of the noise of the field."""

MIN_FULL_SCALE_SHARE = 0.82
"""Smallest full scale of the force, relative to the largest measured force.

The start-up sequence reaches this force; boards accept readings up to 1.25 times full scale.
"""


def read_rig_loops(rig: ForceControlRig) -> Loops:
    """Read the loops of a rig; raise an error if none was measured at the gap ``control.end_m``."""
    loops = rig.measured_loops.read()
    end = rig.settings.force.end_m
    if not any(_is_same_gap(loop.schedule_value, end) for loop in loops.loops):
        gaps = ", ".join(f"{float(gap or 0.0):g}" for gap in loops.by_schedule())
        text = f"{rig.path}: control.end_m: no loops at {end:g} m; there are some at {gaps} m"
        raise InputError(text, code="no-such-loop", key="control.end_m")
    return loops


def _is_same_gap(value: float | None, gap: float) -> bool:
    return value is not None and math.isclose(value, gap, rel_tol=1e-6)


def loops_at_gap(loops: Loops, gap: float) -> Loops:
    """Return the loops that were measured at a gap, m."""
    return loops.with_loops(loop for loop in loops.loops if _is_same_gap(loop.schedule_value, gap))


def identify_force_model(rig: ForceControlRig, loops: Loops, progress: Progress | None = None) -> Model:
    """Identify a model from loops, and prepare it for force control.

    - Loops at one gap give a model for this gap only. Loops at several gaps give a model with the gap map
      ``circuit``, which permits a moving armature.
    - The dead band is made as wide as the noise of the position sensor requires, so that noise does not
      erase the hysteresis state.
    - The valid range ends at the largest force of the rig, or at :data:`MIN_FULL_SCALE_SHARE` times the
      largest measured force if this is larger. It never exceeds the largest measured force.
    - A model with eddy-current lag keeps only as many layers as can be compiled.
    """
    has_several_gaps = len(loops.by_schedule()) > 1
    options = rig.settings.loops
    model = identify_loops(loops, options, "circuit" if has_several_gaps else "auto", progress)
    model = model if model.has_layers or model.has_lag else model.at_rest
    if options.dead_band:
        model = _with_min_dead_band(model, _min_dead_band(model, rig))
    valid_range = model.valid
    assert valid_range is not None
    max_force = max(rig.settings.force.force_max_N, MIN_FULL_SCALE_SHARE * valid_range.output[1])
    return replace(model, valid=replace(valid_range, output=(0.0, min(max_force, valid_range.output[1]))))


def _with_min_dead_band(model: Model, min_half_width: float) -> Model:
    """Return a model whose dead band, if any, has at least a given half-width, A/m."""
    new_parameters: dict[str, Parameter] = {}
    for parameter_spec in model.operator_law.parameters_with_role("dead band"):
        new_parameters[parameter_spec.name] = map_parameter(
            model.parameters[parameter_spec.name], lambda value: max(value, min_half_width)
        )
    return replace(model, parameters={**model.parameters, **new_parameters}) if new_parameters else model


def _min_dead_band(model: Model, rig: ForceControlRig) -> float:
    """Return the half-width of a dead band that contains the noise of the position sensor, A/m."""
    if not model.needs_schedule:
        return 0.0
    sensor, static_model = rig.settings.gap_sensor, model.at_rest
    noise = math.hypot(sensor.noise_m, sensor.resolution / math.sqrt(12.0))
    force_max = rig.settings.force.force_max_N
    max_change = 0.0
    for gap in model.nodes:
        for current_share in (0.25, 0.5, 0.75, 1.0):
            demand = np.full(2, current_share * force_max)
            gaps = np.array([gap, gap + noise])
            static_field = static_model.invert(demand, gaps, history="demagnetised").field
            max_change = max(max_change, abs(float(static_field[1] - static_field[0])))
    return MIN_DEAD_BAND_SIGMAS * max_change
