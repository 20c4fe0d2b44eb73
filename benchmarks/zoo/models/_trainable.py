"""Training of the learned models, for the command ``python -m benchmarks.zoo train``."""

from __future__ import annotations

import sys

from ..task import MissingData, read_task
from ._learned import LearnedModel, LearnedOverSchedule
from .differentiable_preisach import DifferentiablePreisach
from .gru import Gru
from .play_network import PlayNetwork

TRAINABLE: dict[str, type[LearnedModel]] = {
    model.name: model for model in (DifferentiablePreisach, Gru, PlayNetwork)
}


def train(model: str, task: str) -> None:
    """Train a model on the training records of a task, and record it; a task without data is skipped.

    Raises
    ------
    Refusal
        PyTorch is not installed.
    """
    try:
        records = read_task(task).training
    except MissingData as missing:
        print(f"{task}: {missing}", file=sys.stderr)
        return
    learned = TRAINABLE[model]
    LearnedOverSchedule(lambda: learned(is_retrained=True)).fit(records)
