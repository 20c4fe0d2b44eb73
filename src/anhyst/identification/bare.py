"""From a fit to the model it stands for."""

from __future__ import annotations

import numpy as np

from anhyst.data import Loops
from anhyst.identification.cell_kernel import SCALES, WeightKernel
from anhyst.identification.default import FoundModel
from anhyst.identification.gauge import physical
from anhyst.identification.rest import AT_REST
from anhyst.model.actuator import Model
from anhyst.model.fit_record import ValidRange
from anhyst.support.arrays import FloatArray


def model_of(found: FoundModel, loopset: Loops) -> Model:
    """Bare model of a fit: parameters and gap map, no records of how it was found.

    Parameters
    ----------
    found : FoundModel
        The fit.
    loopset : Loops
        For the quantities.

    Returns
    -------
    Model
    """
    space = found.space
    nodes = tuple(float(node) for node in space.records.nodes)
    single = len(nodes) < 2
    gaps = nodes if loopset.schedule is not None and loopset.schedule.name == "gap" else ()
    parameters = physical(
        space.form, found.sets, space.gap_map, loopset.input, loopset.output, gaps
    )
    for name, reading in (("in_0", space.records.rest.input), ("out_0", space.records.rest.output)):
        fitted = np.asarray(parameters[name]) + reading.offset
        parameters[name] = tuple(fitted.tolist()) if fitted.ndim else float(fitted)
    cells = None
    if isinstance(space.form.cells, WeightKernel):
        scales = (float(np.max(parameters.pop(name))) for name in SCALES)
        cells = space.form.cells.scaled(found.sets[0].law, *scales)
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


def valid_range(loopset: Loops) -> ValidRange:
    """Give the range of what was measured.

    Parameters
    ----------
    loopset : Loops
        All loops.

    Returns
    -------
    ValidRange
        From zero on where the drive comes to rest.
    """

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
