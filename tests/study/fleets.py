"""Fleets of virtual magnets whose scatter is known."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from anhyst.data.loops import Loop, Loops
from anhyst.model.actuator import Model
from anhyst.support.units import QUANTITIES

GAPS = (3e-4, 5e-4)
RAMP = 90
"""Samples of a ramp."""
CYCLES = 12
"""Before a loop is recorded: until it has settled."""
SCATTER = 0.05
"""Of the pinning and of the output, from magnet to magnet."""


def magnet(pinning: float, output: float, gap_error: float = 0.0) -> Model:
    """Make one magnet: pinning and output in parts of the usual ones, gap error in m."""
    iron: dict[str, float | tuple[float, ...]] = {
        "M_s": 1e6,
        "a": 1000.0,
        "k": 700.0 * pinning,
        "c": 0.2,
    }
    around: dict[str, float | tuple[float, ...]] = {
        "c_H": 7500.0,
        "c_out": 170.0 * output,
        "rho": tuple(g + gap_error for g in (9e-3, 15e-3)),
    }
    return Model(
        "magnet",
        QUANTITIES["current"],
        QUANTITIES["force"],
        {**iron, **around},
        gap_map="reluctance",
        schedule=QUANTITIES["gap"],
        nodes=GAPS,
    )


def loops_of(model: Model, seed: int) -> Loops:
    """Measure a magnet in one run: at each gap large loops, then small ones, the last of each."""
    rng = np.random.default_rng(seed)
    loops = []
    ramp = 1.0 - np.abs(np.linspace(-1.0, 1.0, 2 * RAMP, endpoint=False))
    large, small = 3.0 * ramp, np.concatenate([2.0 * ramp[:RAMP], 2.0 - 1.2 * ramp])
    for gap in GAPS:
        drive = np.concatenate([*[large] * CYCLES, small, *[small[RAMP:]] * CYCLES])
        force = model(drive, gap, history="demagnetised")
        force += 2e-4 * force.max() * rng.standard_normal(force.size)
        for label, end in (("large", 2 * CYCLES * RAMP), ("small", drive.size)):
            part = slice(end - 2 * RAMP, end)
            schedule, time = (
                np.full(2 * RAMP, gap),
                0.01 * np.arange(drive.size, dtype=np.float64)[part],
            )
            loops.append(Loop(label, drive[part], force[part], schedule, time))
    return Loops(tuple(loops), model.input, model.output, QUANTITIES["gap"])


def write_fleet(folder: Path, count: int, seed: int = 7) -> list[tuple[float, float]]:
    """Write a fleet and return pinning and output of each magnet."""
    rng = np.random.default_rng(seed)
    drawn = []
    for place in range(count):
        pinning, output = 1.0 + SCATTER * rng.standard_normal(2)
        loops_of(magnet(pinning, output), place).save(folder / f"m{place:02d}.csv")
        drawn.append((float(pinning), float(output)))
    return drawn
