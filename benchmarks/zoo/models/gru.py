"""A gated recurrent unit (GRU), the network that predicts hysteresis best in open comparisons.

The unit is that of Cho et al. (2014, Learning phrase representations using RNN encoder-decoder). Vater
et al. (2026, RHINO-MAG, arXiv:2603.29745) compared networks for the MagNet Challenge 2025. A GRU with
a state of eight and 325 parameters won, also over networks with more physics. It has the same size
here, because larger states (16 and 24) predicted simulated irons no better. Only with thousands of
samples, a state of 16 halved the error for a simulated oscillator. In addition:

- A record without time is run in steps of equal travel of the input. The unit is then independent of
  the sampling, and a reversal is always a step. A record with time is run in its samples, and the
  logarithm of the time step is an input.
- The inputs are the input of the record, its warped value (stretched where the output is steep), and
  the change of the input. A linear path leads from the inputs to the output.
- A settled cycle counts in two repetitions in the training, so that the network learns to settle.
- Each scheduling value has a network of its own. On simulated magnets with three gaps, this predicted
  moving gaps with a third of the error of one network that has the gap and its inverse as inputs.
- Several initial guesses are trained shortly, and the best is trained with Adam and then L-BFGS.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ..model import Factory
from ..records import LEAD_IN_CYCLES, FloatArray, Record
from ._learned import Arrays, LearnedModel, LearnedOverSchedule
from ._signals import IntArray, Scaling, by_travel, range_weight, split

HIDDEN = 8
"""Size of the state."""

LARGE_HIDDEN = 16
"""Size of the state for many samples."""

MANY_SAMPLES = 3000
"""Minimum number of training samples for the large state."""

TRAVEL_STEP = 0.04
"""Step of the warped input, whose range is 2, for records without time."""

WINDOW = 400
"""Longest sequence in the training; longer ones are cut into windows."""

BURN_IN = 150
"""Steps at the start of a window that do not count, because the state is not known before it."""

SEEDS = 4
"""Number of initial guesses."""

TRIAL_STEPS = 200
"""Number of iterations of Adam for each initial guess."""

ADAM_STEPS = 1000
"""Number of further iterations of Adam for the best one."""

LBFGS_STEPS = 1500
"""Largest number of iterations of L-BFGS after Adam."""

REFIT_STEPS = 500
"""Largest number of iterations of L-BFGS on all samples."""

WEIGHT_DECAY = 1e-6
"""Weight of the sum of squared weights in the loss."""


@dataclass(frozen=True)
class Sequences:
    """Windows of the inputs, and the samples in them that count."""

    inputs: FloatArray  # (windows, steps, features)
    window: IntArray  # window of each sample
    before: IntArray  # step at or before each sample
    fraction: FloatArray  # position between this step and the next
    output: FloatArray
    training: FloatArray  # weights
    validation: FloatArray


class Gru(LearnedModel):
    """A GRU with a linear path from its inputs."""

    name: ClassVar[str] = "GRU"
    settings: ClassVar[str] = "3"

    def predict(self, record: Record) -> FloatArray:
        """Return the output at each sample."""
        inputs, before, fraction = step_inputs(record, self._scaling)
        states = run_gru(self._arrays, inputs)
        steps = read_out(self._arrays, inputs, states)
        following = np.minimum(before + 1, steps.size - 1)
        scaled = steps[before] * (1.0 - fraction) + steps[following] * fraction
        return record.path.cut(self._scaling.output_of(scaled))

    def _train(self, records: Sequence[Record]) -> Arrays:
        from ._gru_fitting import train_gru

        samples = sum(record.input.size for record in records)
        hidden = LARGE_HIDDEN if samples >= MANY_SAMPLES else HIDDEN
        return train_gru(cut_windows(records, self._scaling), hidden)


def step_inputs(record: Record, scaling: Scaling) -> tuple[FloatArray, IntArray, FloatArray]:
    """Return the inputs in each step, and the place of each sample of the path in the steps."""
    path = record.path
    u = scaling.scale_input(path.input)
    steps = scaling.time_steps(path)
    if steps is None:
        travel = by_travel(scaling.warp(u), TRAVEL_STEP)
        w = travel.input
        u = scaling.unwarp(w)
        change = np.concatenate([[0.0], np.diff(w)]) / TRAVEL_STEP
        columns = [u, w, change]
        before, fraction = travel.before, travel.fraction
    else:
        change = np.concatenate([[0.0], np.diff(u)]) / scaling.input_step
        columns = [u, scaling.warp(u), change, np.log(np.maximum(steps, 1e-6)) / 3.0]
        before, fraction = np.arange(u.size), np.zeros(u.size)
    return np.column_stack(columns), before, fraction


def run_gru(arrays: Arrays, inputs: FloatArray) -> FloatArray:
    """Return the states after each step, shape (steps, hidden)."""
    hidden = arrays["h0"].size
    driven = inputs @ arrays["weight_ih"].T + arrays["bias_ih"]
    weight, bias = arrays["weight_hh"], arrays["bias_hh"]
    states = np.empty((inputs.shape[0], hidden))
    h = arrays["h0"]
    for step, x in enumerate(driven):
        own = weight @ h + bias
        gates = 1.0 / (1.0 + np.exp(-(x[: 2 * hidden] + own[: 2 * hidden])))
        reset, update = gates[:hidden], gates[hidden:]
        candidate = np.tanh(x[2 * hidden :] + reset * own[2 * hidden :])
        h = candidate + update * (h - candidate)
        states[step] = h
    return states


def read_out(arrays: Arrays, inputs: FloatArray, states: FloatArray) -> FloatArray:
    """Return the scaled output of each step."""
    scaled: FloatArray = states @ arrays["out"] + inputs @ arrays["direct"] + arrays["offset"]
    return scaled


def cut_windows(records: Sequence[Record], scaling: Scaling) -> Sequences:
    """Return the training records as windows of the same length."""
    windows: list[FloatArray] = []
    samples: list[tuple[Any, ...]] = []
    for record in records:
        inputs, before, fraction = step_inputs(record, scaling)
        first_counted = record.path.lead_in - record.path.lead_in // LEAD_IN_CYCLES
        before, fraction = before[first_counted:], fraction[first_counted:]
        repeats = before.size // record.input.size
        kept, withheld = (np.tile(part * range_weight(record, scaling), repeats) for part in split(record))
        output = np.tile(scaling.scale_output(record.output), repeats)
        for first, counted_from, end in _window_bounds(inputs.shape[0]):
            inside = (before >= counted_from) & (before < end - 1) & (kept + withheld > 0.0)
            inside |= (before == end - 1) & (fraction == 0.0) & (kept + withheld > 0.0)
            if not inside.any():
                continue
            number = np.full(inside.sum(), len(windows))
            samples.append(
                (number, before[inside] - first, *(v[inside] for v in (fraction, output, kept, withheld)))
            )
            windows.append(inputs[first:end])
    length = max(window.shape[0] for window in windows)
    padded = np.stack([np.pad(window, ((0, length - window.shape[0]), (0, 0))) for window in windows])
    columns = [np.concatenate(column) for column in zip(*samples, strict=True)]
    return Sequences(padded, columns[0].astype(int), columns[1].astype(int), *columns[2:])


def _window_bounds(length: int) -> list[tuple[int, int, int]]:
    """Return the first step, the first step that counts, and the end of each window."""
    if length <= WINDOW:
        return [(0, 0, length)]
    starts = range(0, length - BURN_IN - 1, WINDOW - BURN_IN - 1)
    return [(start, start + BURN_IN if start else 0, min(start + WINDOW, length)) for start in starts]


MODELS: dict[str, Factory] = {Gru.name: lambda: LearnedOverSchedule(Gru)}
