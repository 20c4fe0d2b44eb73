"""Training of the GRU with PyTorch."""

from __future__ import annotations

from typing import Any

import numpy as np

from ._fitting import Search, Tensors, best_search, parameters_of, pytorch
from ._gru_kernel import gru_function
from ._learned import Arrays
from .gru import ADAM_STEPS, LBFGS_STEPS, REFIT_STEPS, SEEDS, TRIAL_STEPS, WEIGHT_DECAY, Sequences


def train_gru(sequences: Sequences, hidden: int) -> Arrays:
    """Return the arrays with the smallest loss of several searches."""
    losses = _Losses(sequences)
    features = sequences.inputs.shape[2]
    searches = [
        Search(parameters_of(initial_arrays(features, hidden, seed)), losses) for seed in range(SEEDS)
    ]
    for search in searches:
        search.run_adam(TRIAL_STEPS, 0.02)
    best = best_search(searches)
    best.run_adam(ADAM_STEPS, 0.01)
    best.run_lbfgs(LBFGS_STEPS)
    best.refit(REFIT_STEPS)
    return {key: value.numpy() for key, value in best.best.items()}


def initial_arrays(features: int, hidden: int, seed: int) -> dict[str, Any]:
    """Return random initial values; the update gates start at different time constants."""
    rng = np.random.default_rng(seed)
    bias = np.zeros(3 * hidden)
    bias[hidden : 2 * hidden] = rng.uniform(-1.0, 3.0, hidden)
    return {
        "weight_ih": rng.normal(0.0, 1.0 / np.sqrt(features), (3 * hidden, features)),
        "weight_hh": rng.normal(0.0, 1.0 / np.sqrt(hidden), (3 * hidden, hidden)),
        "bias_ih": bias,
        "bias_hh": np.zeros(3 * hidden),
        "h0": np.zeros(hidden),
        "out": rng.normal(0.0, 0.3 / np.sqrt(hidden), hidden),
        "direct": np.zeros(features),
        "offset": np.zeros(1),
    }


class _Losses:
    """Losses of training and validation over all windows."""

    def __init__(self, sequences: Sequences) -> None:
        torch = pytorch()

        self._states = gru_function()
        self._inputs = torch.tensor(sequences.inputs)
        self._window = torch.tensor(sequences.window)
        self._before = torch.tensor(sequences.before)
        self._after = torch.clamp(self._before + 1, max=sequences.inputs.shape[1] - 1)
        self._fraction = torch.tensor(sequences.fraction)
        self._output = torch.tensor(sequences.output)
        self._training = torch.tensor(sequences.training / sequences.training.sum())
        self._validation = torch.tensor(sequences.validation / sequences.validation.sum())

    def __call__(self, parameters: Tensors) -> tuple[Any, Any]:
        driven = self._inputs @ parameters["weight_ih"].T + parameters["bias_ih"]
        states = self._states(driven, *(parameters[key] for key in ("weight_hh", "bias_hh", "h0")))
        steps = states @ parameters["out"] + self._inputs @ parameters["direct"] + parameters["offset"]
        at, after = steps[self._window, self._before], steps[self._window, self._after]
        squared = (at + self._fraction * (after - at) - self._output) ** 2
        decay = sum((parameters[key] ** 2).sum() for key in ("weight_ih", "weight_hh", "out"))
        return (self._training * squared).sum() + WEIGHT_DECAY * decay, (self._validation * squared).sum()
