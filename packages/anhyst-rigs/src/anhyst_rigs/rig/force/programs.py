"""Models of force control, from a rig's loops, and what a controller program built of one is."""

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
    """A controller program, as it is flashed."""

    kind: Kind  # ``"full"`` or ``"simplified"``
    name: MethodName  # the same, or ``"at-rest"``
    model: Model  # what it was compiled from
    block: Block  # its parameters, of the kind that the model's law has
    cycles: int  # of the start-up sequence
    firmware: Path  # built for the board it runs on

    @property
    def scales(self) -> Scales:
        """What 1.0 of each signal means."""
        return self.block.scales

    @property
    def conditioning_currents(self) -> list[float]:
        """Turning points of the start-up sequence, A: between the limits of the current."""
        low, high = self.block.limits.current
        return [high, low] * self.cycles

    def gap_codes(self, gap: FloatArray) -> Codes:
        """Return gaps as its sensor read them, m, as the firmware takes them: q31 of the range."""
        codes = np.rint(self.scales.gap_fraction(gap) * (Q31_ONE >> 1)).astype(np.int64)
        return np.minimum(2 * np.clip(codes, 0, Q31_ONE >> 1), Q31_ONE - 1)

    def demand_code(self, force: float) -> int:
        """Force, N, as the link carries it: q31 of full scale."""
        return min(round(force / self.scales.demand * Q31_ONE), Q31_ONE - 1)


@dataclass(frozen=True)
class FirmwareSession:
    """What passed between a firmware and the bench, tick by tick from power on, as codes."""

    gap: Codes  # gap that the controller used, q31
    drive: Codes  # current it drove, q31 of full scale
    demand: Codes  # demand in force at the ticks of the run, q31
    first_run_tick: int  # first tick of the run
    # whether the controller got this command just before: what was before does not count
    is_demagnetised: bool


def count_differing_ticks(program: Program, session: FirmwareSession) -> int:
    """Compute a session again in this process, and count where the firmware did otherwise.

    Every tick is repeated with the gap and the demand that the firmware had: what comes out is
    what the simulated program gives, and it must be the same to the last bit.
    """
    core, first = FixedCompensator(program.block.kind, program.block.words), session.first_run_tick
    if not session.is_demagnetised:
        before = np.column_stack([session.drive[:first], session.gap[:first]])
        for codes in before.tolist():
            core.commit_q31(*codes)
    demand, gap = session.demand.astype(np.int32), session.gap[first:].astype(np.int32)
    return int(np.count_nonzero(core.run(demand, gap, False) != session.drive[first:]))


MIN_DEAD_BAND_SIGMAS = 5.0
"""The dead band is at least so many standard deviations of the noise of the field."""

MIN_FULL_SCALE_SHARE = 0.82
"""The start-up sequence pulls with the largest measured force; boards take a quarter above full
scale for plausible."""


def read_rig_loops(rig: ForceControlRig) -> Loops:
    """Read the loops of a rig."""
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
    """Return the loops of one position."""
    return loops.with_loops(loop for loop in loops.loops if _is_same_gap(loop.schedule_value, gap))


def identify_force_model(
    rig: ForceControlRig, loops: Loops, progress: Progress | None = None
) -> Model:
    """Identify a model of these loops and make it ready for force control.

    One position gives a model of this gap alone; several give one of the map ``circuit``, under
    which the armature may move. Noise of the position sensor must not wear the memory away: where
    it does not stay within the dead band that the loops allow, that is widened to span it. The
    valid range ends at the largest force of the rig, so that a program is compiled for what is
    used, or at :data:`PLAUSIBLE` of the largest measured one. Of what answers late it has the layers
    that can be compiled.
    """
    several = len(loops.by_schedule()) > 1
    options = rig.settings.loops
    model = identify_loops(loops, options, "circuit" if several else "auto", progress)
    model = model if model.has_layers or model.has_lag else model.at_rest
    if options.dead_band:
        model = _with_min_dead_band(model, _min_dead_band(model, rig))
    valid = model.valid
    assert valid is not None
    most = max(rig.settings.force.force_max_N, MIN_FULL_SCALE_SHARE * valid.output[1])
    return replace(model, valid=replace(valid, output=(0.0, min(most, valid.output[1]))))


def _with_min_dead_band(model: Model, least: float) -> Model:
    """Return a model whose dead band, if its law has one, is at least so wide, A/m."""
    wide: dict[str, Parameter] = {}
    for spec in model.operator_law.with_role("dead band"):
        wide[spec.name] = map_parameter(
            model.parameters[spec.name], lambda value: max(value, least)
        )
    return replace(model, parameters={**model.parameters, **wide}) if wide else model


def _min_dead_band(model: Model, rig: ForceControlRig) -> float:
    """Half-width of the dead band, A/m, that the noise of the position sensor stays within."""
    if not model.needs_schedule:
        return 0.0
    sensor, still = rig.settings.gap_sensor, model.at_rest
    noise = math.hypot(sensor.noise_m, sensor.resolution / math.sqrt(12.0))
    force_max = rig.settings.force.force_max_N
    largest = 0.0
    for gap in model.nodes:
        for share in (0.25, 0.5, 0.75, 1.0):
            demand = np.full(2, share * force_max)
            gaps = np.array([gap, gap + noise])
            field = still.invert(demand, gaps, history="demagnetised").field
            largest = max(largest, abs(float(field[1] - field[0])))
    return MIN_DEAD_BAND_SIGMAS * largest
