"""A linear discrete state-space model, fitted by the output-error method.

The model is ``y = c + G(q) u`` with a rational ``G``, which is a state-space
model in companion form. Its order is the one with the smallest error on withheld parts of the training records. The
start is an ARX model, refined by the iteration of Steiglitz and McBride (IEEE Trans. Automatic
Control 10, 1965); Gauss-Newton steps with filtered gradients then minimise the error of the
simulated output (Ljung, System Identification, 1999). A record starts in the steady state of its
first input. If the records have times, they are resampled to one common time step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter, lfilter_zi

from ..records import BoolArray, FloatArray, Record
from ._evolution import solve_linear
from ._over_schedule import OverSchedule
from ._withheld import Scaling, withheld

ORDERS = (1, 2, 3, 4, 5, 6)
FOLDS = 2
REFINEMENTS = 8
ROUNDS_TO_CHOOSE = 10
ROUNDS = 50
MIN_STEP = 1.0 / 64.0
MIN_IMPROVEMENT = 1e-7
MAX_SAMPLES = 60_000
"""Largest number of resampled samples of all complete inputs together."""

MAX_POLE = 0.99999


@dataclass(frozen=True)
class _Signal:
    """A record with its lead-in on a uniform grid."""

    input: FloatArray
    output: FloatArray
    used: BoolArray
    places: FloatArray  # positions of the record's samples on the grid

    @classmethod
    def of(cls, record: Record, step: float, used: BoolArray) -> _Signal:
        """Return the signal of a record; the step is zero if the samples are the grid."""
        path = record.path
        count = path.input.size
        output = np.tile(record.output, count // record.output.size)
        mask = np.arange(count) >= path.lead_in
        mask[path.lead_in :] &= used
        places = np.arange(count, dtype=float)
        if step == 0.0 or path.time is None:
            return cls(path.input, output, mask, places[path.lead_in :])
        places = (path.time - path.time[0]) / step
        grid = np.arange(int(np.ceil(places[-1] - 1e-6)) + 1)
        inputs = CubicSpline(places, path.input)(np.minimum(grid, places[-1]))
        nearest = np.clip(np.rint(np.interp(grid, places, np.arange(count))).astype(int), 0, count - 1)
        return cls(inputs, np.interp(grid, places, output), mask[nearest], places[path.lead_in :])

    def sample(self, output: FloatArray) -> FloatArray:
        """Return an output on the grid at the samples of the record."""
        return np.interp(self.places, np.arange(output.size), output)


class _TransferFunction:
    """The filter ``c + B(q) / F(q)`` of one order."""

    def __init__(self, order: int) -> None:
        self._order = order
        self._denominator = np.eye(1, order + 1)[0]
        self._numerator = np.zeros(order + 2)  # b_0 to b_n, and c

    def fit(self, signals: Sequence[_Signal], rounds: int) -> None:
        """Fit the coefficients to the outputs that are used."""
        smallest_cost = np.inf
        for _ in range(REFINEMENTS):
            self._denominator = self._refine(signals)
            cost = self._fit_numerator(signals)
            if cost < smallest_cost:
                smallest_cost, kept = cost, (self._denominator, self._numerator)
        self._denominator, self._numerator = kept
        self._descend(signals, smallest_cost, rounds)

    def simulate(self, u: FloatArray) -> FloatArray:
        """Return the output from the steady state of the first input."""
        output: FloatArray = self._states(u) @ self._numerator
        return output

    def _states(self, u: FloatArray) -> FloatArray:
        """Return the filtered input with its delays, and ones, shape (n, order + 2)."""
        filtered = _delays(_filter(self._denominator, u), self._order + 1)
        return np.column_stack([filtered, np.ones(u.size)])

    def _refine(self, signals: Sequence[_Signal]) -> FloatArray:
        """Return a denominator by least squares on prefiltered signals, with stable poles."""
        rows, targets = [], []
        for signal in signals:
            y = _filter(self._denominator, signal.output)
            past = _delays(y, self._order + 1)[:, 1:]
            rows.append(np.hstack([-past, self._states(signal.input)])[signal.used])
            targets.append(y[signal.used])
        theta = solve_linear(np.vstack(rows), np.concatenate(targets))
        poles = np.roots(np.concatenate([[1.0], theta[: self._order]]))
        size = np.abs(poles)
        poles = np.where(size > 1.0, poles / np.maximum(size, 1e-9) ** 2, poles)
        poles *= np.minimum(1.0, MAX_POLE / np.maximum(np.abs(poles), 1e-9))
        denominator: FloatArray = np.real(np.poly(poles))
        return denominator

    def _fit_numerator(self, signals: Sequence[_Signal]) -> float:
        """Fit numerator and offset, and return the sum of squared errors of the simulated output."""
        states = np.vstack([self._states(signal.input)[signal.used] for signal in signals])
        y = np.concatenate([signal.output[signal.used] for signal in signals])
        self._numerator = solve_linear(states, y)
        return float(np.sum((y - states @ self._numerator) ** 2))

    def _descend(self, signals: Sequence[_Signal], cost: float, rounds: int) -> None:
        """Minimise the error of the simulated output by Gauss-Newton steps; the numerator follows."""
        for _ in range(rounds):
            step = self._propose(signals)
            before, length, kept = cost, 1.0, (self._denominator, self._numerator)
            while length >= MIN_STEP:
                self._denominator = kept[0] + np.concatenate([[0.0], length * step])
                if np.max(np.abs(np.roots(self._denominator))) <= MAX_POLE:
                    cost = self._fit_numerator(signals)
                    if cost < before:
                        break
                length /= 2.0
            else:
                self._denominator, self._numerator = kept
                return
            if before - cost < MIN_IMPROVEMENT * before:
                return

    def _propose(self, signals: Sequence[_Signal]) -> FloatArray:
        """Return the change of the denominator that minimises the linearised error."""
        rows, errors = [], []
        for signal in signals:
            states = self._states(signal.input)
            output = states @ self._numerator
            slope = _filter(self._denominator, output - self._numerator[-1])
            rows.append(np.hstack([-_delays(slope, self._order + 1)[:, 1:], states])[signal.used])
            errors.append((signal.output - output)[signal.used])
        return solve_linear(np.vstack(rows), np.concatenate(errors))[: self._order]


class StateSpace:
    """A linear state-space model whose order is chosen on withheld parts of the records."""

    def fit(self, records: Sequence[Record]) -> None:
        """Choose the order on withheld parts, and fit the model to all records."""
        self._scaling = Scaling.of(records)
        normalised = [self._scaling.normalise(record) for record in records]
        self._step = _common_step(normalised)
        errors = dict.fromkeys(ORDERS, 0.0)
        for fold in range(FOLDS):
            out = withheld(normalised, fold, FOLDS)
            kept = self._signals(normalised, [~mask for mask in out])
            for order in ORDERS:
                model = _TransferFunction(order)
                model.fit(kept, ROUNDS_TO_CHOOSE)
                for signal in self._signals(normalised, out):
                    residual = (signal.output - model.simulate(signal.input))[signal.used]
                    errors[order] += float(residual @ residual)
        self._order = min(errors, key=errors.__getitem__)
        self._model = _TransferFunction(self._order)
        self._model.fit(
            self._signals(normalised, [np.ones(record.input.size, np.bool_) for record in normalised]), ROUNDS
        )

    def predict(self, record: Record) -> FloatArray:
        """Return the simulated output at each sample."""
        normalised = self._scaling.normalise(record)
        signal = _Signal.of(normalised, self._step, record.scored)
        return self._scaling.restore(signal.sample(self._model.simulate(signal.input)))

    def n_parameters(self) -> int:
        """Return the coefficients of the transfer function and the offset."""
        return 2 * self._order + 2

    def _signals(self, records: Sequence[Record], used: Sequence[BoolArray]) -> list[_Signal]:
        """Return the signals of the records in which the given samples count."""
        return [
            _Signal.of(record, self._step, mask & record.scored)
            for record, mask in zip(records, used, strict=True)
        ]


def _common_step(records: Sequence[Record]) -> float:
    """Return the time step of the grid, or zero if the records have no times."""
    times = [record.path.time for record in records]
    recorded_times = [time for time in times if time is not None]
    if len(recorded_times) < len(times):
        return 0.0
    step = min(float(np.median(np.diff(time))) for time in recorded_times)
    return max(step, sum(float(time[-1] - time[0]) for time in recorded_times) / MAX_SAMPLES)


def _filter(denominator: FloatArray, signal: FloatArray) -> FloatArray:
    """Return a signal divided by a polynomial in the delay, from its steady state."""
    start = lfilter_zi([1.0], denominator) * signal[0]
    filtered: FloatArray = lfilter([1.0], denominator, signal, zi=start)[0]
    return filtered


def _delays(signal: FloatArray, count: int) -> FloatArray:
    """Return a signal delayed by 0 to count - 1 samples as columns."""
    padded = np.concatenate([np.full(count - 1, signal[0]), signal])
    return np.lib.stride_tricks.sliding_window_view(padded, count)[:, ::-1]


MODELS = {"linear state space": lambda: OverSchedule(StateSpace)}
