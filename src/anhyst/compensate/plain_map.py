"""The constant force-current ratio that drives while a compensation is switched off."""

from __future__ import annotations

import numpy as np

from anhyst.compensate.block import Scales
from anhyst.compensate.current_map import CurrentMap
from anhyst.compensate.surface import fit_line, fit_surface
from anhyst.data import Loop, Loops
from anhyst.model.actuator import Model
from anhyst.support.errors import InputError

_COLUMNS = 9
"""Of the table: straight, but for where the current would be beyond its full scale."""

_SAMPLES = 200
"""Of a ramp of the current, up or down."""

_SLOW_S = 1e9
"""From one sample to the next: no eddy current counts."""

_LARGEST = 1.0 - 2.0**-15
"""Of the full scale: the largest entry in 16 bits."""


def plain_map(model: Model, scales: Scales) -> CurrentMap:
    """Return a constant force-current ratio, fitted to the settled loops of a model.

    The method ``ratio`` around half of the largest force at the middle gap, with loops of the model
    in place of measured ones.
    """
    if model.valid is None:
        raise InputError(
            "model: does not say where it holds; identify it from loops",
            code="no-valid-range",
            key="valid",
        )
    high, force_max = model.valid.input[1], model.valid.output[1]
    ends = scales.gap_low, scales.gap_high
    middle = 0.5 * (ends[0] + ends[1])
    loops = [_loop(model, high, gap) for gap in (ends[0], middle, ends[1])]
    known = Loops(tuple(loops), model.input, model.output, model.schedule)
    surface = fit_surface(known, (0.0, scales.demand), ends)
    line = fit_line(surface, 0.5 * force_max, middle, force_max)
    force = np.linspace(0.0, scales.demand, _COLUMNS)
    row = line.current + line.per_force * (force - 0.5 * force_max)
    most = _LARGEST * scales.current
    entries = np.clip(np.tile(row, (2, 1)), -most, most)
    return CurrentMap(entries, scales, (0.0, high), {"k_i_N_per_A": line.k_i})


def _loop(model: Model, high: float, gap: float) -> Loop:
    """Return the settled loop up to a current and back at a gap."""
    ramp = np.linspace(0.0, high, _SAMPLES)
    drive = np.concatenate((ramp, ramp[-2::-1]))
    time = _SLOW_S * np.arange(drive.size)
    force = model.predict(drive, gap, time, "settled").output
    return Loop(f"{gap:g}", drive, force, np.full(drive.size, gap))
