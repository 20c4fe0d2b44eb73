"""The bus on which a virtual plant gives a controller its ticks.

Both wait for each other, so that virtual time stands still while either computes: at every tick the
plant says what its sensors show, the controller answers with the current it wants from the next
tick on.
"""

from __future__ import annotations

import math
import socket
import struct
from typing import NamedTuple, Protocol

from anhyst.errors import InputError
from anhyst.link.frames import Fault, PlantDrive, PlantSample, State

Q30 = float(1 << 30)
Q31 = float(1 << 31)
_RESERVED = -(1 << 31)
_LEAST, _MOST = _RESERVED + 1, (1 << 31) - 1
_DRIVE_BYTES = 16


class Reading(NamedTuple):
    """What the sensors show at the beginning of a tick; NaN: the sensor's error code.

    Parameters
    ----------
    gap : float
        0 at the low end of the model's range of gaps, 1 at the high one.
    force, current : float
        As a fraction of full scale.
    status : int, optional
        0, or 1 where there is no sample at all.
    """

    gap: float
    force: float
    current: float
    status: int = 0


class Plant(Protocol):
    """What stands at the other end of the bus."""

    def step(self, tick: int, current: float) -> Reading | tuple[float, float, float, int]:
        """Go on by one tick, to the beginning of tick number `tick`.

        Parameters
        ----------
        tick : int
            Counts from 1.
        current : float
            Driven by the controller in the tick before, as a fraction of full scale. It begins to
            flow now, in the tick that this step leads to: what flowed until now is the current of
            the step before. That is the one tick of delay of every controller.

        Returns
        -------
        Reading or tuple
            Gap, force, current, status.
        """
        ...  # pragma: no cover


class PlantBus:
    """The plant's end of the bus.

    Parameters
    ----------
    plant : Plant
        Stepped once a tick.
    connection : socket
        To the controller.
    timeout : float, optional
        How long a controller may take for a tick, s of the clock on the wall.

    Attributes
    ----------
    tick : int
        Number of the last tick; 0 before the first.
    drive : float
        Current that the controller wants from the next tick on, as a fraction of full scale.
    state : State
        Of the controller after the last tick.
    fault : Fault
        Its latched reason.
    """

    def __init__(self, plant: Plant, connection: socket.socket, timeout: float = 10.0) -> None:
        self.plant = plant
        self.tick = 0
        self.drive = 0.0
        self.state = State.INIT
        self.fault = Fault.NONE
        self._connection = connection
        # Waited for inside the system: an emulated board sends byte by byte.
        connection.settimeout(None)
        wait = struct.pack("@ll", int(timeout), int(timeout % 1.0 * 1e6))
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, wait)
        connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, wait)

    def step(self, ticks: int = 1) -> None:
        """Go on by some ticks, in lock-step with the controller.

        Raises
        ------
        InputError
            The controller hung up or does not answer.
        """
        for _ in range(ticks):
            self._step(self.tick + 1)

    def skip(self, ticks: int) -> None:
        """Let the plant go on without the controller, which misses these ticks."""
        for _ in range(ticks):
            self.tick += 1
            self.plant.step(self.tick, self.drive)

    def _step(self, tick: int) -> None:
        sample = _encode(tick, *self.plant.step(tick, self.drive))
        try:
            self._connection.sendall(sample.pack())
            drive = PlantDrive.unpack(self._receive())
        except (OSError, ValueError) as error:
            raise InputError(
                f"the controller did not finish tick {tick}: {error}; see its output"
            ) from error
        if drive.tick != tick:
            raise InputError(f"the controller answered tick {drive.tick} to tick {tick}")
        self.tick = tick
        self.drive = drive.drive / Q31
        self.state = State(drive.state & 0xFF)
        self.fault = Fault(drive.state >> 8 & 0xFF)

    def _receive(self) -> bytes:
        data = self._connection.recv(_DRIVE_BYTES, socket.MSG_WAITALL)
        if not data:
            raise ConnectionError("it hung up")
        return data


def _encode(tick: int, gap: float, force: float, current: float, status: int = 0) -> PlantSample:
    return PlantSample(tick & 0xFFFFFFFF, _q30(gap), _q30(force), _q30(current), status)


def _q30(value: float) -> int:
    """Give the nearest code; what lies beyond is the nearest end, no number the error code."""
    if math.isnan(value):
        return _RESERVED
    return round(min(max(value * Q30, _LEAST), _MOST))
