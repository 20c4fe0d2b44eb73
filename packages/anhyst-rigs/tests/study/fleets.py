"""Fleets of virtual magnets with a known scatter."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from anhyst.data.loops import Loop, Loops
from anhyst.model.actuator import Model
from anhyst.support.numeric import FloatArray
from anhyst.support.units import MU_0, QUANTITIES

GAPS = (3e-4, 5e-4)
RAMP = 90
"""Samples of a ramp."""
CYCLES = 12
"""Cycles before a loop is recorded, so that it is a steady-state loop."""
SCATTER = 0.05
"""Standard deviation of pinning and output between magnets, as a fraction."""


def magnet(pinning: float, output: float, gap_error: float = 0.0) -> Model:
    """Make one magnet: factors of the nominal pinning and output, offset of the gap's rho."""
    iron: dict[str, float | tuple[float, ...]] = {"M_s": 1e6, "a": 1000.0, "k": 700.0 * pinning, "c": 0.2}
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
    """Measure a magnet in one run: at each gap, return the last major and the last minor loop."""
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
            schedule, time = (np.full(2 * RAMP, gap), 0.01 * np.arange(drive.size, dtype=np.float64)[part])
            loops.append(Loop(label, drive[part], force[part], schedule, time))
    return Loops(tuple(loops), model.input, model.output, QUANTITIES["gap"])


NOISE = 0.01
"""Noise of `few_loops_of`, as a fraction of the largest force."""
EACH = 5
"""Step between the stored samples of `few_loops_of`."""
_GAUGE = 1e-3
"""Slope of the air core that identification chooses if the loops do not determine it."""


def few_loops_of(model: Model, seed: int) -> Loops:
    """Measure a magnet with poor sensors: one large loop at each gap, few samples, high noise."""
    rng = np.random.default_rng(seed)
    ramp = 3.0 * (1.0 - np.abs(np.linspace(-1.0, 1.0, 2 * RAMP, endpoint=False)))
    drive, part = np.tile(ramp, 6), slice(10 * RAMP, 12 * RAMP, EACH)
    loops = []
    for gap in GAPS:
        force = model(drive, gap, history="demagnetised")
        force += NOISE * force.max() * rng.standard_normal(force.size)
        at = np.full(2 * RAMP // EACH, gap)
        loops.append(Loop("large", drive[part], force[part], at, 0.05 * np.arange(float(at.size))))
    return Loops(tuple(loops), model.input, model.output, QUANTITIES["gap"])


def quantities_of(model: Model) -> FloatArray:
    """Return the parameters of a noise-free fit: k/a, c, w*M_s/a, a/c_H, saturation."""
    parameters = model.parameters
    rho, a = np.array(parameters["rho"]), np.array(parameters["a"])
    gain = parameters["c_out"] * (MU_0 * np.array(parameters["M_s"])) ** 2
    return np.array(
        [
            parameters["k"] / a,
            parameters["c"],
            *(rho / (1.0 + rho) / _GAUGE),
            (1.0 + rho[0]) * a / parameters["c_H"],
            gain,
        ]
    )


def model_of_quantities(values: FloatArray) -> Model:
    """Return the magnet with these parameters."""
    kappa, c, low_gap, high_gap, scale, gain = values.tolist()
    rho = tuple(_GAUGE * gap / (1.0 - _GAUGE * gap) for gap in (low_gap, high_gap))
    around = {"c_H": (1.0 + rho[0]) * 1000.0 / scale, "c_out": gain / (MU_0 * 1e6) ** 2}
    made = magnet(1.0, 1.0)
    return replace(made, parameters={**made.parameters, "k": 1000.0 * kappa, "c": c, **around, "rho": rho})


def write_fleet(folder: Path, count: int, seed: int = 7) -> list[tuple[float, float]]:
    """Write the loops of a fleet; return pinning and output of its magnets."""
    rng = np.random.default_rng(seed)
    rows = []
    for place in range(count):
        pinning, output = 1.0 + SCATTER * rng.standard_normal(2)
        loops_of(magnet(pinning, output), place).save(folder / f"m{place:02d}.csv")
        rows.append((float(pinning), float(output)))
    return rows
