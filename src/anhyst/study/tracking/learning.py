"""Learning control: the force that a repeated motion needs, from the error of the trial before."""

from __future__ import annotations

import math

import numpy as np

from anhyst.rig.stage.file import StageRig
from anhyst.rig.stage.loop import Feedforward, StageSetup, TrackedRun, pid, track
from anhyst.rig.stage.setpoint import motion_of
from anhyst.support.arrays import FloatArray

TRIALS = 8
FILTER_HZ = 200.0
"""Above it nothing is learnt."""
_PADDING = 4096
"""Ticks of zeros behind a trial, so that its end does not meet its begin."""


def learn(setup: StageSetup, gains: Feedforward, trials: int = TRIALS) -> list[TrackedRun]:
    """Repeat the test set-point and add after each trial what the model of the loop asks for."""
    table = setup.rig.settings.scan
    motion = motion_of(table, table.test_m_per_s2)
    runs = [track(setup, motion, gains, seed=0)]
    learnt = np.zeros(len(runs[0].reference))
    while len(runs) < trials and runs[-1].loss is None:
        learnt = _filtered(setup.rig, learnt, runs[-1].error)
        runs.append(track(setup, motion, gains, seed=len(runs), learnt=learnt))
    return runs


def _filtered(rig: StageRig, learnt: FloatArray, error: FloatArray) -> FloatArray:
    """Add the force that would have left no error, and keep what lies below the filter.

    With the plant ``P = e^(-s late)/(m s^2)`` and the controller C an error e is gone after the
    force ``e/P + C e``.
    """
    n, dt = error.size, rig.dt
    frequency = np.fft.rfftfreq(n + _PADDING, dt)
    s = 2j * math.pi * frequency
    late = (rig.settings.timing.delay_ticks + 0.5) * dt
    late += 1.0 / (2.0 * math.pi * rig.settings.amplifier.bandwidth_Hz)
    filtered = 1.0 / (1.0 + (frequency / FILTER_HZ) ** 4)
    with np.errstate(divide="ignore", invalid="ignore"):
        control = _pid_at(rig, np.exp(s * dt))
    needed = rig.settings.body.mass_kg * s**2 * np.exp(s * late) + control
    needed[0] = 0.0  # a constant force is what the integral finds
    missing = np.fft.rfft(error, n + _PADDING)
    whole = np.fft.rfft(learnt, n + _PADDING) + needed * missing
    return np.ascontiguousarray(np.fft.irfft(filtered * whole, n + _PADDING)[:n])


def _pid_at(rig: StageRig, z: np.ndarray[tuple[int, ...], np.dtype[np.complex128]]) -> FloatArray:
    """Return the PID over the frequency."""
    c = pid(rig)
    back = 1.0 / z
    numerator = c["b0"] + c["b1"] * back + c["b2"] * back**2
    return np.asarray(numerator / (1.0 + c["a1"] * back + c["a2"] * back**2))
