"""Add a signal to the position reading of a running bench, to measure the response of its loop."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from anhyst.support.numeric import FloatArray

MOTION_TO_GAP = 0.01
"""Default of the largest motion by an injected signal, relative to the operating gap."""
CURRENT_TO_MAX_CURRENT = 0.07
"""Largest change of a current by this signal, relative to the largest current."""


class SignalLimit(NamedTuple):
    """Limits of a signal at which the loop is not linear any more."""

    signal: str
    low: float  # limits in the unit of the signal; values at a limit are rejected
    high: float
    text: str  # what has happened at a limit


@dataclass(frozen=True)
class InjectionPort:
    """The place in a position loop where a bench adds a signal, and the signals around this place."""

    # weights of the signals whose sum is the position reading, m, including the injected signal
    reading: Mapping[str, float]
    plant_input: Mapping[str, float]  # weights of the signals whose sum is the input of the plant
    input_unit: str  # unit of this input: A or N
    max_motion: float  # default of the largest motion of the body, m
    max_changes: Mapping[str, float]  # largest changes of signals, if the motion has its default
    max_step: float  # largest change of the injected signal from tick to tick, m
    held_values: Mapping[str, int]  # values of signals while the controller holds the body
    limits: tuple[SignalLimit, ...]
    forbidden_flags: int = 0  # bits of the signal ``flags`` that report a limit


class InjectedSignal:
    """A signal that a bench consumes tick by tick; it is zero after its last value."""

    def __init__(self) -> None:
        self._remaining = np.zeros(0)

    def start(self, values: FloatArray) -> None:
        """Replace the remaining signal; an empty array ends it."""
        self._remaining = np.asarray(values, dtype=np.float64)

    def take(self, ticks: int) -> FloatArray:
        """Return the values of the next ticks."""
        taken = np.zeros(ticks)
        values, self._remaining = self._remaining[:ticks], self._remaining[ticks:]
        taken[: len(values)] = values
        return taken
