"""From a fit to the model it stands for."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np

from anhyst.data import Loops
from anhyst.identification.cell_kernel import SCALES, WeightKernel
from anhyst.identification.default import FoundModel
from anhyst.identification.gauge import physical
from anhyst.identification.response import Local
from anhyst.identification.rest import AT_REST
from anhyst.identification.space import LEAST_GAP_FLUX
from anhyst.model.actuator import Model
from anhyst.model.fit_record import ValidRange
from anhyst.model.gap_map import Curve
from anhyst.support.arrays import FloatArray

_BETWEEN = 4
"""Pieces between two gaps in which the curves of a model with leakage are drawn."""


def model_of(fit: FoundModel, loopset: Loops) -> Model:
    """Bare model of a fit: parameters and gap map, no records of how it was found."""
    space = fit.space
    places, sets = _between(fit)
    nodes = tuple(float(node) for node in places)
    single = len(nodes) < 2
    gaps = nodes if loopset.schedule is not None and loopset.schedule.name == "gap" else ()
    parameters = physical(space.form, sets, space.gap_map, loopset.input, loopset.output, gaps)
    for name, reading in (("in_0", space.records.rest.input), ("out_0", space.records.rest.output)):
        fitted = np.asarray(parameters[name]) + reading.offset
        parameters[name] = tuple(fitted.tolist()) if fitted.ndim else float(fitted)
    cells = None
    if isinstance(space.form.cells, WeightKernel):
        scales = (float(np.max(parameters.pop(name))) for name in SCALES)
        cells = space.form.cells.scaled(fit.sets[0].law, *scales)
    return Model(
        name="model",
        cells=cells,
        input=loopset.input,
        output=loopset.output,
        parameters=parameters,
        law=space.form.law,
        gap_map="none" if single else space.written_map,
        schedule=loopset.schedule,
        nodes=nodes,
    )


def _between(fit: FoundModel) -> tuple[FloatArray, list[Local]]:
    """Nodes of a model and the sets there: with leakage, places between the gaps too.

    What a gap grows by is its own reluctance; what the iron sees of it behind a leakage bends. So
    the former is interpolated, and so densely that the curves between nodes do not matter.
    """
    space, sets = fit.space, fit.sets
    nodes = space.records.nodes
    if space.gap_map != "leakage":
        return nodes, sets
    leakage = space.leakage(fit.theta)
    seen = np.array([local.omega for local in sets])
    own = Curve("rho", nodes, seen / np.maximum(1.0 - leakage * seen, LEAST_GAP_FLUX))
    pieces = [np.linspace(*ends, _BETWEEN, endpoint=False) for ends in pairwise(nodes)]
    places = np.concatenate([*pieces, nodes[-1:]])
    first, power = sets[0], space.form.power
    scale = first.scale * (1.0 - first.h * first.omega)
    gain = first.gain / max(1.0 - leakage * first.omega, LEAST_GAP_FLUX) ** power
    return places, [
        replace(
            first,
            omega=omega,
            scale=scale / (1.0 - first.h * omega),
            gain=gain * max(1.0 - leakage * omega, LEAST_GAP_FLUX) ** power,
        )
        for omega in (own(places) / (1.0 + leakage * own(places))).tolist()
    ]


def valid_range(loopset: Loops) -> ValidRange:
    """Give the range of what was measured."""

    def span(values: list[FloatArray]) -> tuple[float, float]:
        return min(float(v.min()) for v in values), max(float(v.max()) for v in values)

    at = loopset.schedule_values
    low, high = span([loop.input for loop in loopset.loops])
    if 0.0 < low <= AT_REST * high:
        low = 0.0  # the sensor's offset is no reason to flag a drive at rest
    return ValidRange(
        input=(low, high),
        output=span([loop.output for loop in loopset.loops]),
        schedule=(at[0], at[-1]) if at else None,
    )
