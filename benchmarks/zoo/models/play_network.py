"""A monotone network of play operators, a small physics-informed network.

The states are play operators, which remember the reversals of the input and forget them as iron does
(Prandtl neural networks: Joghataie and Farrokh 2008, Dynamic analysis of nonlinear frames by Prandtl
neural networks, J. Eng. Mech. 134, 961-969). A network that increases in each state (positive
weights: Sill 1998, Monotonic networks, NIPS 10) computes the flux from them. For records with time,
linear filters before and behind (first or second order, trained) describe eddy currents and creep.

Three properties hold for all values of the parameters, without filters:

- A repeated cycle is closed from its second repetition on, and so are minor loops.
- The flux increases with the input.
- No closed cycle of the flux releases energy. On a simple cycle each state is at most as large on
  the ascending branch as on the descending branch, at the same input, and so is the flux. A cycle
  with minor loops consists of simple ones, because the states forget minor loops completely.

The output is a second-order polynomial of the flux, because a force is a square of a flux.
"""

from __future__ import annotations

from collections.abc import Sequence
from types import ModuleType
from typing import Any, ClassVar

import numpy as np

from ..model import Factory
from ..records import FloatArray, Record
from ._learned import Arrays, LearnedModel, LearnedOverSchedule
from ._plays import play_places
from ._signals import Scaling

PLAYS = 12
"""Number of play operators; the first has the threshold zero."""

HIDDEN = 20
"""Number of hidden neurons."""

FILTERS = 3
"""Number of linear filters before the play operators, and of those behind the network."""


class PlayNetwork(LearnedModel):
    """A monotone network of play operators, with filters if the records have time."""

    name: ClassVar[str] = "play network"
    settings: ClassVar[str] = "3"

    def predict(self, record: Record) -> FloatArray:
        """Return the output at each sample."""
        u, steps = scaled_path(record, self._scaling)
        scaled: FloatArray = run_network(np, self._arrays, u, steps, [(0, u.size)], np.arange(u.size))
        return record.path.cut(self._scaling.output_of(scaled))

    def _train(self, records: Sequence[Record]) -> Arrays:
        from ._play_fitting import train_play_network

        return train_play_network(records, self._scaling)


def scaled_path(record: Record, scaling: Scaling) -> tuple[FloatArray, FloatArray | None]:
    """Return the warped input along the path of a record, and its time steps if it has time."""
    path = record.path
    return scaling.warp(scaling.scale_input(path.input)), scaling.time_steps(path)


def run_network(
    xp: ModuleType, arrays: Any, u: Any, steps: Any | None, bounds: Sequence[tuple[int, int]], rows: Any
) -> Any:
    """Return the scaled output at some samples of paths that follow one another.

    Parameters
    ----------
    xp
        ``numpy``, or ``torch`` for the training.
    arrays
        Parameters.
    u, steps
        Warped input, and time steps or ``None``, shape (n,).
    bounds
        First sample and end of each path.
    rows
        Samples whose output is returned.
    """
    if steps is not None:
        u = u + run_filters(xp, arrays, "before", u, steps, bounds)
    thresholds = threshold_values(xp, arrays)
    places, signs = play_places(_plain(u), _plain(thresholds), float(_plain(arrays["rest"])[0]), bounds)
    if steps is None:
        z = monotone_network(
            xp, arrays, play_values(xp, u, thresholds, arrays["rest"], places[rows], signs[rows])
        )
    else:
        z = monotone_network(xp, arrays, play_values(xp, u, thresholds, arrays["rest"], places, signs))
        z = (z + run_filters(xp, arrays, "behind", z, steps, bounds))[rows]
    offset, slope, square = arrays["output"]
    return offset + slope * z + square * z * z


def threshold_values(xp: ModuleType, arrays: Any) -> Any:
    """Return the thresholds of the play operators: zero, and increasing positive values."""
    increments = xp.exp(arrays["log_increments"])
    return xp.concatenate([0.0 * increments[:1], xp.cumsum(increments, 0)])


def play_values(xp: ModuleType, u: Any, thresholds: Any, rest: Any, places: Any, signs: Any) -> Any:
    """Return the play operators from the sample that last moved each, shape (n, plays)."""
    if xp is not np:
        places, signs = xp.from_numpy(places), xp.from_numpy(signs)
    moved = u[places] - signs * thresholds
    return xp.where(signs == 0.0, rest + 0.0 * moved, moved)


def monotone_network(xp: ModuleType, arrays: Any, plays: Any) -> Any:
    """Return the flux, which increases with each play operator."""
    hidden = xp.tanh(plays @ xp.exp(arrays["log_weight"]) + arrays["bias"])
    return hidden @ xp.exp(arrays["log_out"]) + plays @ xp.exp(arrays["log_direct"])


def run_filters(
    xp: ModuleType, arrays: Any, key: str, x: Any, steps: Any, bounds: Sequence[tuple[int, int]]
) -> Any:
    """Return the weighted sum of the filtered signal minus the signal, from filters with complex poles.

    A path starts in equilibrium. All samples are computed together by doubling the span.
    """
    rate = xp.exp(arrays[f"log_rate_{key}"])
    pole = -rate + 1j * rate * arrays[f"quality_{key}"]
    decay = xp.exp(steps[:, None] * pole)
    mean = xp.concatenate([x[:1], (x[1:] + x[:-1]) / 2.0])
    first = np.zeros(len(x), bool)
    first[[start for start, _ in bounds]] = True
    is_first = first[:, None] if xp is np else xp.from_numpy(first)[:, None]
    decay = xp.where(is_first, 0.0 * decay, decay)
    state = xp.where(is_first, x[:, None] + 0j, (1.0 - decay) * mean[:, None])
    span = 1
    while span < max(end - start for start, end in bounds):
        state = xp.concatenate([state[:span], state[span:] + decay[span:] * state[:-span]])
        decay = xp.concatenate([decay[:span], decay[span:] * decay[:-span]])
        span *= 2
    gain = arrays[f"gain_{key}"]
    lag = state - x[:, None]
    return lag.real @ gain[0] + lag.imag @ gain[1]


def _plain(values: Any) -> FloatArray:
    """Return an array of a tensor or of an array."""
    return np.asarray(values if isinstance(values, np.ndarray) else values.detach().numpy())


MODELS: dict[str, Factory] = {PlayNetwork.name: lambda: LearnedOverSchedule(PlayNetwork)}
