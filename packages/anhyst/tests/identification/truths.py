"""Virtual actuators with known parameters, and loops measured on them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from anhyst.data import History, Loop, Loops
from anhyst.identification.response import PARAMETER_NAMES, ParameterSet
from anhyst.model.actuator import Model
from anhyst.model.parameters import GapMap, Parameter
from anhyst.support.numeric import FloatArray
from anhyst.support.units import MU_0, QUANTITIES

GAPS = (0.3e-3, 0.4e-3, 0.5e-3, 0.6e-3)
I_MAX = 2.0
H_MAX = 120.0
HISTORIES = ("settled", "demagnetised", "conditioned")

MAGNET: Mapping[str, Parameter] = {
    "M_s": 1e6,
    "a": 1000.0,
    "k": 700.0,
    "c": 0.2,
    "c_out": 60.0,
    "in_0": 0.015,
    "out_0": -0.4,
}
"""A magnet in the gauge of identification: ``a = DEFAULT_AIR_CORE_SLOPE*M_s*(1 - alpha)``."""

AROUND: Mapping[GapMap, Mapping[str, Parameter]] = {
    "none": {"alpha": 0.0, "c_H": 12e3, "rho": 0.006},
    "scaling": {
        "alpha": -0.004,
        "a": 1004.0,
        "k": 702.8,
        "c_H": tuple(1.0 / (1.5e-5 + 0.19 * gap) for gap in GAPS),
    },
    "reluctance": {"c_H": 12e3, "rho": tuple(2e-4 + 11.5 * gap for gap in GAPS)},
}
"""Circuit parameters of each gap map; gap-dependent ones are linear where the map interpolates
them."""

CORE: Mapping[str, Parameter] = {
    "M_s": 4e5,
    "a": 18.0,
    "k": 11.0,
    "c": 0.25,
    "alpha": 4e-5,
    "c_H": 1.0,
    "c_out": 1.0,
    "in_0": 0.8,
    "out_0": 2e-3,
}


def magnet(
    gap_map: GapMap = "reluctance",
    output: str = "force",
    gaps: Sequence[float] = GAPS,
    law: str = "effective-field",
    **changes: Parameter,
) -> Model:
    """Return a current-driven electromagnet; a map other than 'none' has nodes at the gaps."""
    parameters = {**MAGNET, **AROUND[gap_map], **changes}
    places = [GAPS.index(gap) for gap in gaps]
    chosen = {
        name: tuple(value[place] for place in places) if isinstance(value, tuple) else value
        for name, value in parameters.items()
    }
    scheduled = gap_map != "none"
    return Model(
        "magnet",
        QUANTITIES["current"],
        QUANTITIES[output],
        chosen,
        law=law,
        gap_map=gap_map,
        schedule=QUANTITIES["gap"] if scheduled else None,
        nodes=tuple(gaps) if scheduled else (),
    )


def core(law: str = "effective-field", **changes: Parameter) -> Model:
    """Return a closed core driven by a field, with measured flux density."""
    parameters = {**CORE, **changes}
    return Model("core", QUANTITIES["field"], QUANTITIES["flux_density"], parameters, law=law)


def path(points: Sequence[float], samples: int) -> FloatArray:
    """Return straight lines from point to point with about `samples` samples in total."""
    way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(points)))])
    return np.interp(np.linspace(0.0, way[-1], samples), way, points)


def history_of(model: Model, kind: str) -> str:
    """Return the history in full: the conditioning drive is two large cycles from rest."""
    if kind != "conditioned":
        return kind
    points = "120,-120,120,-60,0" if model.input.name == "field" else "0,2,0,2,0"
    return f"conditioned:{points}"


def drives_of(model: Model, history: str, samples: int) -> dict[str, FloatArray]:
    """Return nested loops: separate steady-state cycles, or one record that runs through them."""
    top = H_MAX if model.input.name == "field" else I_MAX
    low = -1.0 if model.input.name == "field" else 0.0
    if history == "settled":
        cycles = {}
        for name, part in (("full", 1.0), ("middle", 0.6), ("small", 0.3)):
            bottom, peak = low * part * top, part * top
            cycle = path([bottom, peak, bottom], samples)[:-1]
            cycles[name] = np.roll(cycle, samples // 5)
        return cycles
    points = [0.0, 1.0, low, 0.6, 0.8 * low + 0.1, 0.4, 0.3 * low + 0.1, 0.9]
    return {"record": path([top * point for point in points], 3 * samples)}


def loops_of(
    model: Model, history: str = "settled", *, samples: int = 80, noise: float = 0.0, seed: int = 0
) -> Loops:
    """Return nested loops at every node; noise is relative to the largest output."""
    history = history_of(model, history)
    loops = []
    for node in model.nodes or (None,):
        for label, drive in drives_of(model, history, samples).items():
            schedule = None if node is None else np.full(drive.size, node)
            output = model.predict(drive, node, history=history).output
            loops.append(Loop(label, drive, output, schedule, history=History.parse(history)))
    clean = Loops(tuple(loops), model.input, model.output, model.schedule)
    return noisy(clean, noise, seed) if noise else clean


def noisy(loopset: Loops, noise: float, seed: int) -> Loops:
    """Add white noise to the output, relative to the largest output of all loops."""
    rng = np.random.default_rng(seed)
    size = noise * largest(loopset)
    return loopset.with_loops(
        replace(loop, output=loop.output + size * rng.standard_normal(loop.n)) for loop in loopset.loops
    )


def largest(loopset: Loops) -> float:
    """Return the largest absolute output of all loops."""
    return max(float(np.max(np.abs(loop.output))) for loop in loopset.loops)


def worst(loopset: Loops, outputs: Sequence[FloatArray]) -> float:
    """Return the largest error of outputs, relative to the largest measured output."""
    deviations = [
        np.abs(output - loop.output).max() for loop, output in zip(loopset.loops, outputs, strict=True)
    ]
    return float(max(deviations)) / largest(loopset)


def predicted(model: Model, loopset: Loops) -> list[FloatArray]:
    """Return the modelled output of every loop."""
    return [
        model.predict(loop.input, loop.schedule, loop.time, loop.history).output for loop in loopset.loops
    ]


def gauge_free(model: Model) -> list[ParameterSet]:
    """Return the gauge-free parameters of a model at each node (docs/theory.md)."""
    found = []
    for node in model.nodes or (None,):
        p = model.parameters_at(node)
        grip = 1.0 - p["alpha"]
        found.append(
            ParameterSet(
                law=(p["k"] / p["a"], p["c"]),
                omega=(p["rho"] / (1.0 + p["rho"]) - p["alpha"]) * p["M_s"] / p["a"],
                scale=p["a"] * (1.0 + p["rho"]) / p["c_H"],
                gain=p["c_out"] * (MU_0 * p["M_s"] * grip) ** model.power,
                in_0=p["in_0"],
                out_0=p["out_0"],
                h=p["a"] / (p["M_s"] * grip),
            )
        )
    return found


def apart(one: Model, other: Model, loopset: Loops) -> float:
    """Return the largest relative difference of gauge-free parameters; offsets relative to the
    spans."""
    spans = {
        "c": 1.0,
        "in_0": max(float(np.max(np.abs(loop.input))) for loop in loopset.loops),
        "out_0": largest(loopset),
    }
    differences = [
        abs(getattr(a, name) - getattr(b, name)) / spans.get(name, abs(getattr(b, name)))
        for a, b in zip(gauge_free(one), gauge_free(other), strict=True)
        for name in PARAMETER_NAMES
    ]
    return float(max(differences))
