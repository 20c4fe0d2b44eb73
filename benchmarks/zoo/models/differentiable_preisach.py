"""A Preisach model whose density is trained by gradient descent.

The model is that of Roussel et al. (2022, Differentiable Preisach modeling for characterization and
optimization of particle accelerator systems with hysteresis, Phys. Rev. Lett. 128, 204801): a mesh of
smooth relays, a density with one positive value for each relay, and a scale, an offset and a slope
of the output. The following points are added:

- The mesh is uniform in the warped input, so that it is dense where the output is steep.
- A reversible curve of smooth steps on the mesh is part of the density (relays without width).
- The output is a second-order polynomial of the magnetisation, because a force is a square of a flux.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import ModuleType
from typing import Any, ClassVar

import numpy as np

from ..model import Factory
from ..records import FloatArray, Record
from ._learned import Arrays, LearnedModel, LearnedOverSchedule
from ._signals import Scaling

MESH = 50
"""Number of lines of the mesh over the range of the warped input."""

EDGE = 1.02
"""Half of the range of the mesh."""

SMOOTHNESS = 0.5
"""Width of the switching of a relay, in lines of the mesh; the steps of neighbours overlap."""


class DifferentiablePreisach(LearnedModel):
    """A Preisach model with a trained density and smooth relays."""

    name: ClassVar[str] = "differentiable Preisach"
    settings: ClassVar[str] = "3"

    def predict(self, record: Record) -> FloatArray:
        """Return the output at each sample."""
        path = record.path
        scaled = self._scaling.scale_input(path.input)
        relays = path.cut(relay_states(record, self._scaling))
        output: FloatArray = preisach_output(np, self._arrays, path.cut(scaled), relays)
        return self._scaling.output_of(output)

    def _train(self, records: Sequence[Record]) -> Arrays:
        from ._preisach_fitting import train_preisach

        return train_preisach(records, self._scaling)


def mesh() -> tuple[FloatArray, FloatArray]:
    """Return the inputs at which the relays switch up and down, up >= down."""
    lines = np.linspace(-EDGE, EDGE, MESH)
    up, down = np.tril_indices(MESH)
    return lines[up], lines[down]


def relay_states(record: Record, scaling: Scaling) -> FloatArray:
    """Return the states of all relays along the path of a record, -1 to 1, shape (n, relays).

    A relay follows its upper switching curve if this is higher than its state, and its lower one if this
    is lower. Therefore, it has the deletion property although it is smooth. Demagnetised relays are up
    if their centre is below the input at rest.
    """
    u = scaling.warp(scaling.scale_input(record.path.input))
    up, down = mesh()
    width = SMOOTHNESS * 2.0 * EDGE / (MESH - 1)
    rest = float(scaling.warp(np.array([scaling.zero_input]))[0])
    state = np.tanh((rest - (up + down) / 2.0) / width)
    states = np.empty((u.size, up.size))
    for k, value in enumerate(u):
        state = np.maximum(state, np.tanh((value - up) / width))
        state = np.minimum(state, np.tanh((value - down) / width))
        states[k] = state
    return states


def preisach_output(xp: ModuleType, arrays: Any, u: Any, relays: Any) -> Any:
    """Return the scaled output from the input and the states of the relays."""
    density = xp.exp(arrays["log_density"])
    m = relays @ density
    offset, scale, square, slope = arrays["output"]
    return offset + scale * m + square * m * m + slope * u


MODELS: dict[str, Factory] = {
    DifferentiablePreisach.name: lambda: LearnedOverSchedule(DifferentiablePreisach)
}
