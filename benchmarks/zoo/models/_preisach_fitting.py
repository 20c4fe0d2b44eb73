"""Training of the differentiable Preisach model with PyTorch."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..records import Record
from ._fitting import Search, Tensors, best_search, parameters_of, pytorch
from ._learned import Arrays
from ._signals import Scaling, range_weight, split
from .differentiable_preisach import mesh, preisach_output, relay_states

ADAM_STEPS = 300
"""Number of iterations of Adam."""

LBFGS_STEPS = 300
"""Largest number of iterations of L-BFGS after Adam."""

REFIT_STEPS = 1000
"""Largest number of iterations of L-BFGS on all samples."""

WIDTHS = (0.15, 0.4)
"""Decays of the initial densities with the width of the relays, one for each search."""

DENSITY_WEIGHT = 1e-6
"""Weight of the squared densities, relative to a uniform density."""


def train_preisach(records: Sequence[Record], scaling: Scaling) -> Arrays:
    """Return the arrays with the smallest loss of several searches."""
    losses = _Losses(records, scaling)
    searches = [Search(parameters_of(initial_arrays(records, scaling, width)), losses) for width in WIDTHS]
    for search in searches:
        search.run_adam(ADAM_STEPS, 0.05)
    best = best_search(searches)
    best.run_lbfgs(LBFGS_STEPS)
    best.refit(REFIT_STEPS)
    return {key: value.numpy() for key, value in best.best.items()}


def initial_arrays(records: Sequence[Record], scaling: Scaling, width: float) -> dict[str, Any]:
    """Return a density that decays with the width of the relays, and the best polynomial of the input."""
    up, down = mesh()
    density = np.exp(-(up - down) / width)
    u = np.concatenate([scaling.warp(scaling.scale_input(record.input)) for record in records])
    y = np.concatenate([scaling.scale_output(record.output) for record in records])
    known = np.isfinite(y)
    square, scale, offset = np.polyfit(u[known], y[known], 2)
    return {"log_density": np.log(density / density.sum()), "output": np.array([offset, scale, square, 0.0])}


class _Losses:
    """Losses of training and validation over all records."""

    def __init__(self, records: Sequence[Record], scaling: Scaling) -> None:
        torch = pytorch()

        relays = [record.path.cut(relay_states(record, scaling)) for record in records]
        u = [scaling.scale_input(record.input) for record in records]
        y = [np.nan_to_num(scaling.scale_output(record.output)) for record in records]
        parts = [[part * range_weight(record, scaling) for part in split(record)] for record in records]
        training, validation = np.concatenate(parts, axis=1)
        self._relays = torch.tensor(np.concatenate(relays))
        self._input = torch.tensor(np.concatenate(u))
        self._output = torch.tensor(np.concatenate(y))
        self._training = torch.tensor(training / training.sum())
        self._validation = torch.tensor(validation / validation.sum())

    def __call__(self, parameters: Tensors) -> tuple[Any, Any]:
        torch = pytorch()

        squared = (preisach_output(torch, parameters, self._input, self._relays) - self._output) ** 2
        density = parameters["log_density"].exp()
        roughness = density.square().sum() * density.numel()
        return (
            (self._training * squared).sum() + DENSITY_WEIGHT * roughness,
            (self._validation * squared).sum(),
        )
