"""Scores of a model on a task."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from .inversion import round_trip_error
from .model import Model, Refusal
from .probes import has_even_output, probe_behaviour
from .records import FloatArray, Record
from .task import Task
from .time_limit import limited_time

FIT_LIMIT_S = 120.0
"""Processor time of a fit, after which the model is stopped and counts as declined."""
MIN_TIMED_S = 0.1
"""Predictions are repeated for this processor time, s, because the clock of some systems is coarse."""
MAX_REPEATS = 100
INVERSE_LIMIT_S = 20.0
"""Processor time of the inverse, after which it is not computed."""


@dataclass(frozen=True)
class Scores:
    """Scores of one model on one task; those that were not computed are ``None``.

    ``refusal`` is the reason if the model declined the task, or the error if it failed. Errors in %
    refer to the largest output of the test records. An output that is even in the input has neither
    an inverse nor a direction of its loops.
    """

    refusal: str = ""
    nrms: float | None = None  # rms error / standard deviation of the test outputs
    mean: float | None = None  # mean absolute error, %
    worst: float | None = None  # largest error, %
    round_trip: float | None = None  # rms error of output -> input -> output, normalised as nrms
    rest_drift: float | None = None  # %
    minor_loop_gap: float | None = None  # %
    smallest_loss: float | None = None
    is_passive: bool | None = None
    n_parameters: int | None = None
    fit_s: float | None = None  # processor time, s
    step_us: float | None = None  # processor time per sample of a prediction, µs
    is_recorded: bool = False  # whether the fit was read from the record of an earlier training

    def to_dict(self) -> dict[str, Any]:
        """Return the scores for a file."""
        return asdict(self)


@dataclass(frozen=True)
class Errors:
    """Errors of outputs on the scored samples of several records."""

    nrms: float
    mean: float
    worst: float

    @classmethod
    def compare(cls, outputs: Sequence[FloatArray], records: Sequence[Record]) -> Errors:
        """Compare outputs of a model with records."""
        truth = np.concatenate([record.output[record.scored] for record in records])
        modelled = np.concatenate(
            [output[record.scored] for output, record in zip(outputs, records, strict=True)]
        )
        residual = np.abs(modelled - truth)
        full_scale = float(np.max(np.abs(truth)))
        return cls(
            float(np.sqrt(np.mean(residual**2)) / np.std(truth)),
            float(100.0 * np.mean(residual) / full_scale),
            float(100.0 * np.max(residual) / full_scale),
        )


def score(model: Model, task: Task) -> tuple[Scores, list[FloatArray]]:
    """Fit a model to a task; return its scores and its outputs of the test records."""
    began = time.process_time()
    try:
        with limited_time(FIT_LIMIT_S):
            model.fit(task.training)
    except Refusal as refusal:
        return Scores(refusal=str(refusal), fit_s=time.process_time() - began), []
    recorded_s: float | None = getattr(model, "recorded_fit_s", None)
    fit_s = time.process_time() - began if recorded_s is None else recorded_s
    outputs, step_us = _predict(model, task.test)
    errors, is_even = Errors.compare(outputs, task.test), has_even_output(task.training)
    scores = Scores(
        nrms=errors.nrms,
        mean=errors.mean,
        worst=errors.worst,
        round_trip=None if is_even else _round_trip(model, task),
        n_parameters=model.n_parameters(),
        fit_s=fit_s,
        step_us=step_us,
        is_recorded=recorded_s is not None,
    )
    if not task.is_rate_dependent:
        behaviour = probe_behaviour(model, task.training)
        scores = replace(
            scores,
            rest_drift=behaviour.rest_drift,
            minor_loop_gap=behaviour.minor_loop_gap,
            smallest_loss=None if is_even else behaviour.smallest_loss,
            is_passive=None if is_even else behaviour.is_passive,
        )
    return scores, outputs


def _predict(model: Model, records: Sequence[Record]) -> tuple[list[FloatArray], float]:
    """Return the outputs of records and the processor time of a sample, µs."""
    hidden_records = [record.without_output() for record in records]
    model.predict(hidden_records[0])  # the first call may compile
    began, count = time.process_time(), 0
    while time.process_time() - began < MIN_TIMED_S and count < MAX_REPEATS:
        outputs = [model.predict(record) for record in hidden_records]
        count += 1
    seconds = (time.process_time() - began) / count
    for output, record in zip(outputs, records, strict=True):
        if output.shape != record.output.shape:
            shapes = f"has shape {output.shape}, expected {record.output.shape}"
            raise ValueError(f"the prediction of '{record.name}' {shapes}")
        if bad_count := int(np.sum(~np.isfinite(output))):
            raise ValueError(
                f"the prediction of '{record.name}' has {bad_count} values that are not finite; "
                "the output of a record is hidden (NaN) when it is predicted"
            )
    return outputs, 1e6 * seconds / sum(record.path.input.size for record in records)


def _round_trip(model: Model, task: Task) -> float | None:
    """Return the error of the inverse on the first test record, or None if it cannot be computed."""
    try:
        with limited_time(INVERSE_LIMIT_S):
            error = round_trip_error(model, task.test[0], task.training)
    except Exception:  # the prediction counts although the inverse fails or takes too long
        return None
    return error if np.isfinite(error) else None
