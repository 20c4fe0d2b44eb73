"""Training with PyTorch: Adam, then L-BFGS, with early stopping at withheld samples.

Finally, a few steps use all samples, because the withheld pieces of a steep branch are missed otherwise.
"""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from ._signals import WITHHELD_SHARE

Tensors = dict[str, Any]
Losses = Callable[[Tensors], tuple[Any, Any]]
"""Returns the losses of training and validation at the values of the parameters."""

CHECK_INTERVAL = 5
"""Number of iterations between two validations."""

FULL_EFFORT_SAMPLES = 5000
"""Number of samples up to which the full number of iterations is made."""

MIN_EFFORT = 0.3
"""Smallest share of the iterations, for many samples."""


def effort(samples: int) -> float:
    """Return the share of the iterations that a training with a number of samples makes."""
    return min(1.0, max(MIN_EFFORT, FULL_EFFORT_SAMPLES / samples))


def pytorch() -> Any:
    """Return the module PyTorch, which only a training needs."""
    return importlib.import_module("torch")


def parameters_of(values: dict[str, Any]) -> Tensors:
    """Return trainable tensors in double precision."""
    torch = pytorch()

    return {
        key: torch.tensor(value, dtype=torch.float64, requires_grad=True) for key, value in values.items()
    }


class Search:
    """A search from one initial guess, which can be continued.

    Attributes
    ----------
    validation
        Lowest validation loss.
    best
        Parameters with this loss.
    """

    def __init__(self, parameters: Tensors, losses: Losses) -> None:
        self.validation = math.inf
        self.best: Tensors = {}
        self._parameters = parameters
        self._losses = losses

    def run_adam(self, steps: int, rate: float) -> None:
        """Take steps of Adam; the rate falls to a hundredth of its first value along a cosine."""
        torch = pytorch()

        optimiser = torch.optim.Adam(list(self._parameters.values()), lr=rate)
        schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimiser, steps, rate / 100.0)
        for step in range(steps):
            optimiser.zero_grad()
            training, validation = self._losses(self._parameters)
            if step % CHECK_INTERVAL == 0:
                self._keep_best(validation)
            training.backward()
            torch.nn.utils.clip_grad_norm_(list(self._parameters.values()), 1.0)
            optimiser.step()
            schedule.step()

    def run_lbfgs(self, steps: int) -> None:
        """Take steps of L-BFGS from the best parameters, until they bring nothing more."""
        self._restore()
        for loss in self._descend(steps, 0.0):
            self._keep_best(loss)
        self._restore()

    def refit(self, steps: int) -> None:
        """Take steps of L-BFGS from the best parameters on all samples, including the withheld samples."""
        self._restore()
        for _ in self._descend(steps, WITHHELD_SHARE / (1.0 - WITHHELD_SHARE)):
            pass
        self.validation = -math.inf
        self.best = {key: value.detach().clone() for key, value in self._parameters.items()}

    def _descend(self, steps: int, share: float) -> Iterator[Any]:
        """Take steps of L-BFGS, and yield the validation loss after some of them."""
        torch = pytorch()

        optimiser = torch.optim.LBFGS(
            list(self._parameters.values()),
            max_iter=CHECK_INTERVAL,
            history_size=30,
            tolerance_grad=1e-12,
            tolerance_change=1e-14,
            line_search_fn="strong_wolfe",
        )

        def closure() -> Any:
            optimiser.zero_grad()
            training, validation = self._losses(self._parameters)
            total = training + share * validation
            total.backward()
            return total

        for _ in range(steps // CHECK_INTERVAL):
            before = optimiser.step(closure).item()
            with torch.no_grad():
                training, validation = self._losses(self._parameters)
            if not (training + share * validation).item() < before * (1.0 - 1e-7):
                break
            yield validation

    def _keep_best(self, validation: Any) -> None:
        value = validation.item()
        if value < self.validation:
            self.validation = value
            self.best = {key: value.detach().clone() for key, value in self._parameters.items()}

    def _restore(self) -> None:
        torch = pytorch()

        with torch.no_grad():
            for key, value in self.best.items():
                self._parameters[key].copy_(value)


def best_search(searches: Sequence[Search]) -> Search:
    """Return the search with the lowest validation loss."""
    return min(searches, key=lambda search: search.validation)
