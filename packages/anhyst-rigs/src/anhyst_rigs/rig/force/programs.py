"""Identify models for force control, and represent the controller programs compiled from them."""

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
    """A controller program as it is flashed."""

    kind: Kind  # ``"full"`` or ``"simplified"``
    name: MethodName  # the same, or ``"at-rest"``
    model: Model  # model from which it was compiled
    block: Block  # parameter block, of the kind of the model's law
    cycles: int  # number of cycles of the start-up sequence
    firmware: Path  # built for the board on which it runs

    @property
    def scales(self) -> Scales:
        """Full scale of each signal."""
        return self.block.scales

    @property
    def conditioning_currents(self) -> list[float]:
        """Reversals of the start-up sequence, A, at the limits of the current."""
        low, high = self.block.limits.current
        return [high, low] * self.cycles

    def gap_codes(self, gap: FloatArray) -> Codes:
        """Return gap readings, m, as codes of the firmware, q31 of the gap range."""
        codes = np.rint(self.scales.gap_fraction(gap) * (Q31_ONE >> 1)).astype(np.int64)
        return np.minimum(2 * np.clip(codes, 0, Q31_ONE >> 1), Q31_ONE - 1)

    def demand_code(self, force: float) -> int:
        """Return a force, N, as a code of the link, q31 of full scale."""
        return min(round(force / self.scales.demand * Q31_ONE), Q31_ONE - 1)


@dataclass(frozen=True)
class FirmwareSession:
    """Codes that a firmware and its bench exchanged, tick by tick from power-on."""

    gap: Codes  # gap that the controller used, q31
    drive: Codes  # driven current, q31 of full scale
    demand: Codes  # active demand at the ticks of the run, q31
    first_run_tick: int  # first tick of the run
    # whether the command demagnetised preceded the run, so that earlier currents do not count
    is_demagnetised: bool


def count_differing_ticks(program: Program, session: FirmwareSession) -> int:
    """Repeat a session in this process, and count the ticks with a different current.

    Every tick uses the gap and the demand of the firmware, and the results must be bit-identical.
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
"""Smallest half-width of the dead band, in standard deviations of the field noise."""

MIN_FULL_SCALE_SHARE = 0.82
"""Smallest full scale of the force relative to the largest measured force.

The start-up sequence reaches the largest measured force, and boards accept readings up to a quarter
above full scale.
"""


def read_rig_loops(rig: ForceControlRig) -> Loops:
    """Read the loops of a rig, and check that some were measured at ``control.end_m``."""
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

    - Loops at one gap give a model of this gap only. Loops at several gaps give a model with the
      gap map ``circuit``, which permits a moving armature.
    - The dead band is widened to the noise of the position sensor, so that noise does not erase the
      hysteresis state.
    - The valid range ends at the largest force of the rig, or at :data:`MIN_FULL_SCALE_SHARE` times
      the largest measured force if this is larger. It never exceeds the largest measured force.
    - A model with eddy-current lag keeps the layers that can be compiled.
    """
    has_several_gaps = len(loops.by_schedule()) > 1
    options = rig.settings.loops
    model = identify_loops(loops, options, "circuit" if has_several_gaps else "auto", progress)
    model = model if model.has_layers or model.has_lag else model.at_rest
    if options.dead_band:
        model = _with_min_dead_band(model, _min_dead_band(model, rig))
    valid = model.valid
    assert valid is not None
    max_force = max(rig.settings.force.force_max_N, MIN_FULL_SCALE_SHARE * valid.output[1])
    return replace(model, valid=replace(valid, output=(0.0, min(max_force, valid.output[1]))))


def _with_min_dead_band(model: Model, min_half_width: float) -> Model:
    """Return a model whose dead band, if its law has one, has at least a given half-width, A/m."""
    widened: dict[str, Parameter] = {}
    for spec in model.operator_law.parameters_with_role("dead band"):
        widened[spec.name] = map_parameter(
            model.parameters[spec.name], lambda value: max(value, min_half_width)
        )
    return replace(model, parameters={**model.parameters, **widened}) if widened else model


def _min_dead_band(model: Model, rig: ForceControlRig) -> float:
    """Return the half-width of the dead band that contains the position sensor's noise, A/m."""
    if not model.needs_schedule:
        return 0.0
    sensor, static_model = rig.settings.gap_sensor, model.at_rest
    noise = math.hypot(sensor.noise_m, sensor.resolution / math.sqrt(12.0))
    force_max = rig.settings.force.force_max_N
    max_change = 0.0
    for gap in model.nodes:
        for share in (0.25, 0.5, 0.75, 1.0):
            demand = np.full(2, share * force_max)
            gaps = np.array([gap, gap + noise])
            field = static_model.invert(demand, gaps, history="demagnetised").field
            max_change = max(max_change, abs(float(field[1] - field[0])))
    return MIN_DEAD_BAND_SIGMAS * max_change
