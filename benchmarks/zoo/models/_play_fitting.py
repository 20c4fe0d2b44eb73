"""Training of the monotone network of play operators with PyTorch."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ..records import LEAD_IN_CYCLES, FloatArray, Record
from ._fitting import Search, Tensors, best_search, effort, parameters_of, pytorch
from ._learned import Arrays
from ._signals import Scaling, range_weight, split
from .play_network import FILTERS, HIDDEN, PLAYS, run_network, scaled_path

SEEDS = 4
"""Number of initial guesses."""

TRIAL_STEPS = 200
"""Number of iterations of Adam for each initial guess."""

ADAM_STEPS = 1000
"""Number of iterations of Adam."""

LBFGS_STEPS = 1500
"""Largest number of iterations of L-BFGS after Adam."""

REFIT_STEPS = 500
"""Largest number of iterations of L-BFGS on all samples."""

SMOOTHNESS_WEIGHT = 1e-8
"""Weight of the sum of squared weights, which are the slopes of the network."""


def train_play_network(records: Sequence[Record], scaling: Scaling) -> Arrays:
    """Return the arrays with the smallest loss of several searches."""
    losses = _Losses(records, scaling)
    share = effort(losses.samples)
    searches = [
        Search(parameters_of(initial_arrays(records, scaling, seed)), losses) for seed in range(SEEDS)
    ]
    for search in searches:
        search.run_adam(int(share * TRIAL_STEPS), 0.03)
    best = best_search(searches)
    best.run_adam(int(share * ADAM_STEPS), 0.02)
    best.run_lbfgs(int(share * LBFGS_STEPS))
    best.refit(int(share * REFIT_STEPS))
    return {key: value.numpy() for key, value in best.best.items()}


def initial_arrays(records: Sequence[Record], scaling: Scaling, seed: int) -> dict[str, Any]:
    """Return random initial values; the output starts as the best polynomial of the warped input."""
    rng = np.random.default_rng(seed)
    thresholds = 0.9 * (np.arange(PLAYS) / (PLAYS - 1)) ** 1.5
    u = np.concatenate([scaling.warp(scaling.scale_input(record.input)) for record in records])
    y = np.concatenate([scaling.scale_output(record.output) for record in records])
    known = np.isfinite(y)
    square, slope, offset = np.polyfit(u[known], y[known], 2)
    arrays = {
        "log_increments": np.log(np.diff(thresholds)),
        "rest": scaling.warp(np.array([scaling.zero_input])),
        "log_weight": rng.normal(np.log(2.0 / PLAYS), 0.7, (PLAYS, HIDDEN)),
        "bias": rng.uniform(-1.5, 1.5, HIDDEN),
        "log_out": rng.normal(np.log(0.5 / HIDDEN), 0.3, HIDDEN),
        "log_direct": np.full(PLAYS, np.log(0.3 / PLAYS)),
        "output": np.array([offset, slope, square]),
    }
    if scaling.time_step > 0.0:
        for key in ("before", "behind"):
            arrays |= {
                f"log_rate_{key}": rng.uniform(np.log(0.003), np.log(3.0), FILTERS),
                f"quality_{key}": rng.uniform(0.0, 1.0, FILTERS),
                f"gain_{key}": rng.normal(0.0, 0.05, (2, FILTERS)),
            }
    return arrays


class _Losses:
    """Losses of training and validation over all records."""

    def __init__(self, records: Sequence[Record], scaling: Scaling) -> None:
        torch = pytorch()

        inputs: list[FloatArray] = []
        steps: list[FloatArray] = []
        columns: list[FloatArray] = []
        bounds = []
        for record in records:
            u, step = scaled_path(record, scaling)
            # One repetition settles the play operators, but not the filters.
            skipped = 0 if step is not None else record.path.lead_in // LEAD_IN_CYCLES
            u = u[skipped:]
            start = sum(part.size for part in inputs)
            bounds.append((start, start + u.size))
            inputs.append(u)
            steps.append(np.zeros(u.size) if step is None else step[skipped:])
            parts = [part * range_weight(record, scaling) for part in split(record)]
            own = np.stack([np.nan_to_num(scaling.scale_output(record.output)), *parts])
            columns.append(np.pad(own, ((0, 0), (u.size - own.shape[1], 0))))
        output, training, validation = np.concatenate(columns, axis=1)
        rows = np.flatnonzero(training + validation)
        self._bounds = bounds
        self._input = torch.tensor(np.concatenate(inputs))
        self._steps = torch.tensor(np.concatenate(steps)) if scaling.time_step > 0.0 else None
        self._rows = rows
        self.samples = output.size
        self._output = torch.tensor(output[rows])
        self._training = torch.tensor(training[rows] / training.sum())
        self._validation = torch.tensor(validation[rows] / validation.sum())

    def __call__(self, parameters: Tensors) -> tuple[Any, Any]:
        torch = pytorch()

        predicted = run_network(torch, parameters, self._input, self._steps, self._bounds, self._rows)
        squared = (predicted - self._output) ** 2
        roughness = (2.0 * parameters["log_weight"]).exp().sum()
        return (
            (self._training * squared).sum() + SMOOTHNESS_WEIGHT * roughness,
            (self._validation * squared).sum(),
        )
