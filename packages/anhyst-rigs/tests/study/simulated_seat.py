"""A simulated bearing on which a frequency response is measured without firmware."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from anhyst.support.numeric import FloatArray
from anhyst_rigs.rig.bearing.loop import BearingSetup
from anhyst_rigs.rig.bearing.scenario import ScenarioBuilder
from anhyst_rigs.rig.bench.bearing import make_injection_port
from anhyst_rigs.rig.bench.injection import InjectedSignal
from anhyst_rigs.rig.bench.protocol import Signal
from anhyst_rigs.rig.loop import SimulatedLoop
from anhyst_rigs.rig.recording import HOVER_CODE, Recording
from anhyst_rigs.study.bearing.operating import find_operating_point, make_linear_loop
from anhyst_rigs.study.response.multisine import ComplexArray
from anhyst_rigs.study.response.result import FrequencyResponse, ResponseName


class SimulatedSeat:
    """A levitated bearing; the port is that of the bench with firmware."""

    def __init__(self, setup: BearingSetup, seed: int = 0) -> None:
        self._rig, self._loop, self._injected = setup.rig, SimulatedLoop(setup, seed), InjectedSignal()
        self._loop.run(ScenarioBuilder(self._rig, self._rig.gap).lift_off(setup.controller).build())
        self.rate, self.tick = self._rig.settings.timing.rate_Hz, 0
        self.injection_port = replace(make_injection_port(setup), held_values={"state": HOVER_CODE})
        names = self._run(np.zeros(1)).columns
        self.signals = tuple(
            Signal(name.rsplit("_", 1)[0] if "_" in name else name, "", "") for name in names
        )

    def _run(self, inject: FloatArray) -> Recording:
        self.tick += len(inject)
        return self._loop.run(ScenarioBuilder(self._rig, self._rig.gap).hold(0.0, -inject).build())

    def inject(self, signal: FloatArray) -> int:
        self._injected.start(signal)
        return self.tick + 1

    def advance(self, ticks: int) -> FloatArray:
        first_tick = self.tick + 1
        run = self._run(self._injected.take(ticks))
        return np.column_stack([np.arange(first_tick, first_tick + len(run)), *run.columns.values()])


def linear_responses(setup: BearingSetup, frequency: FloatArray) -> dict[ResponseName, ComplexArray]:
    """Return the responses of the loop that the plant of `linearise` makes with this controller."""
    loop = make_linear_loop(setup, find_operating_point(setup.rig))
    sensitivity = loop.sensitivity(frequency)
    plant = loop.plant_response(frequency)
    return {"closed_loop": 1.0 - sensitivity, "sensitivity": sensitivity, "plant": plant}


def deviations(
    response: FrequencyResponse, expected: dict[ResponseName, ComplexArray], name: ResponseName
) -> tuple[float, float, int]:
    """Return the largest deviation of the exact points, dB and degrees, and their number."""
    one = response.responses[name]
    ratio = (one.values / expected[name])[one.uncertainty_decibel <= 0.3]
    return (
        float(np.max(np.abs(20.0 * np.log10(np.abs(ratio))))),
        float(np.max(np.abs(np.degrees(np.angle(ratio))))),
        len(ratio),
    )
