"""Loops of the actuator of a force rig, its armature held."""

from __future__ import annotations

from anhyst.rig.force.file import Rig
from anhyst.rig.measuring import Sensors
from anhyst.rig.parts.magnet import Electromagnet
from anhyst.rig.parts.solenoid import Solenoid


class HeldActuator:
    """A force rig whose armature is held."""

    def __init__(self, rig: Rig) -> None:
        self._rig = rig

    def magnet(self) -> Solenoid | Electromagnet:
        """Return what pulls, demagnetised."""
        return self._rig.actuator()

    def sensors(self, seed: list[int], sample: float) -> Sensors:
        """Return what measures; the seed of the rig file is added, a sample is so many seconds."""
        instruments = self._rig.instruments([0, *seed], sample)
        return Sensors(instruments.current, instruments.force)
