"""A swept sine through a loop that levitates."""

from __future__ import annotations

from anhyst.rig.bearing.loop import SimulatedLoop, lost_at
from anhyst.rig.bearing.recording import Recording
from anhyst.rig.bearing.scenario import Script
from anhyst.rig.bearing.setup import Setup
from anhyst.study.bearing.sensitivity import Sensitivity, measure_sensitivity
from anhyst.support.arrays import FloatArray

SINE_M = 0.5e-6
"""Amplitude of the swept sine, m."""


class _LostError(Exception):
    """What lies on its stop answers to no controller."""


def sweep(
    setup: Setup, gap: float, load: float, frequencies: FloatArray, seed: int
) -> Sensitivity | None:
    """Measure the sensitivity of a loop by a swept sine."""
    rig = setup.rig
    loop = SimulatedLoop(setup, seed)
    loop.run(Script(rig, gap, load).lift_off(setup.controller).build())

    def run(inject: FloatArray) -> Recording:
        recording = loop.run(Script(rig, gap, load).hold(0.0, inject).build())
        if len(recording) < inject.size or lost_at(rig, recording) is not None:
            raise _LostError
        return recording

    try:
        return measure_sensitivity(run, frequencies, SINE_M, rig.settings.timing.rate_Hz)
    except _LostError:
        return None
