"""Step a bearing tick by tick in Python as a reference for the loop in C."""

from __future__ import annotations

import numpy as np

from anhyst_rigs.link.virtual_boards import Reading
from anhyst_rigs.rig.bearing.loop import BearingSetup
from anhyst_rigs.rig.plant import current_controllers, make_plant


class SteppedBearing:
    """A plant for the plant bus, with signals as fractions of full scale."""

    def __init__(self, setup: BearingSetup, seed: int = 0) -> None:
        self.bearing = make_plant(setup.rig, seed)
        self.load = setup.rig.settings.load.force_N
        self._scales = setup.position_control.settings("fixed")
        self._loop = current_controllers(setup.rig)[0]
        self._read, self._integral = np.zeros((2, len(setup.rig.settings.body_magnets))).tolist()
        self._last: float | None = None

    def amperes(self, drives: tuple[float, ...]) -> list[float]:
        """Convert fractions of full scale to A."""
        return [drive * self._scales["current_full"] for drive in drives[: len(self._read)]]

    def step(self, tick: int, currents: tuple[float, ...]) -> Reading:
        """Advance with the currents of the last tick, and read the sensors."""
        del tick  # the bearing counts its own ticks
        if self._last is not None:
            self.bearing.advance(self._amplifiers(self.amperes(currents)), self._last)
        self._last = self.load
        (gap,), self._read, *_ = self.bearing.read()
        full = self._scales["current_full"]
        return Reading(
            gap=0.0,
            force=0.0,
            current=self._read[0] / full,
            further_currents=tuple(current / full for current in self._read[1:]),
            position=(self._scales["gap_middle"] - gap) / self._scales["position_full"],
        )

    def _amplifiers(self, reference: list[float]) -> list[float]:
        """Return the inputs of the amplifiers: current references, or voltages that achieve them."""
        loop = self._loop
        if loop["gain"] == 0.0:
            return reference
        error = np.subtract(reference, self._read).tolist()
        volts = []
        for i, wanted in enumerate(reference):
            voltage = loop["resistance"] * wanted + loop["gain"] * error[i] + self._integral[i]
            volts.append(min(max(voltage, -loop["limit"]), loop["limit"]))
            if abs(voltage) < loop["limit"]:
                self._integral[i] += loop["reset"] * error[i]
        return volts
