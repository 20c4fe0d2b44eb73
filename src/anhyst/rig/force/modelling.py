"""The models of force control: identified from a rig's loops, and fit for its sensors."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from anhyst.data import Loops
from anhyst.model.actuator import Model
from anhyst.model.compilable import has_layers
from anhyst.model.parameters import Parameter
from anhyst.rig.force.file import Rig
from anhyst.rig.loop_files import identify_loops
from anhyst.support.errors import InputError
from anhyst.support.progress import Progress

SAFE = 5.0
"""The dead band is at least so many standard deviations of the noise of the field."""

PLAUSIBLE = 0.82
"""The start-up sequence pulls with the largest measured force; boards take a quarter above full
scale for plausible."""


def loops_of_rig(rig: Rig) -> Loops:
    """Read the loops of a rig."""
    loops = rig.measured.read()
    end = rig.settings.force.end_m
    if not any(_near(loop.schedule_value, end) for loop in loops.loops):
        gaps = ", ".join(f"{float(gap or 0.0):g}" for gap in loops.by_schedule())
        raise InputError(
            f"{rig.path}: control.end_m: no loops at {end:g} m; there are some at {gaps} m",
            code="no-such-loop",
            key="control.end_m",
        )
    return loops


def _near(value: float | None, gap: float) -> bool:
    return value is not None and math.isclose(value, gap, rel_tol=1e-6)


def loops_at(loops: Loops, gap: float) -> Loops:
    """Return the loops of one position."""
    return loops.with_loops(loop for loop in loops.loops if _near(loop.schedule_value, gap))


def find_model(rig: Rig, loops: Loops, progress: Progress | None = None) -> Model:
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
    found = identify_loops(loops, options, "circuit" if several else "auto", progress)
    found = found if has_layers(found) else found.at_rest
    if options.dead_band:
        found = _spanning(found, _least_dead_band(found, rig))
    valid = found.valid
    assert valid is not None
    most = max(rig.settings.force.force_max_N, PLAUSIBLE * valid.output[1])
    return replace(found, valid=replace(valid, output=(0.0, min(most, valid.output[1]))))


def _spanning(model: Model, least: float) -> Model:
    """Return a model whose dead band, if its law has one, is at least so wide, A/m."""
    wide: dict[str, Parameter] = {}
    for spec in model.operator_law.with_role("dead band"):
        given = model.parameters[spec.name]
        wide[spec.name] = (
            tuple(max(one, least) for one in given)
            if isinstance(given, tuple)
            else max(given, least)
        )
    return replace(model, parameters={**model.parameters, **wide}) if wide else model


def _least_dead_band(model: Model, rig: Rig) -> float:
    """Half-width of the dead band, A/m, that the noise of the position sensor stays within."""
    if not model.needs_schedule:
        return 0.0
    sensor, still = rig.settings.gap_sensor.sensor(), model.at_rest
    noise = math.hypot(sensor.noise, sensor.step / math.sqrt(12.0))
    force_max = rig.settings.force.force_max_N
    largest = 0.0
    for gap in model.nodes:
        for share in (0.25, 0.5, 0.75, 1.0):
            demand = np.full(2, share * force_max)
            gaps = np.array([gap, gap + noise])
            field = still.invert(demand, gaps, history="demagnetised").field
            largest = max(largest, abs(float(field[1] - field[0])))
    return SAFE * largest
