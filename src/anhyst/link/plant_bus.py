"""The bus on which a virtual plant gives a controller its ticks.

Both wait for each other, so that virtual time stops while either computes: at every tick the
plant says what its sensors show, the controller answers with the current it wants from the next
tick on.
"""

from __future__ import annotations

import math
import socket
import struct
from collections.abc import Callable
from dataclasses import fields
from typing import NamedTuple, Protocol

from anhyst.link.frames import PlantDrive, PlantSample
from anhyst.support.errors import InputError
from anhyst.support.states import Fault, State

Q30 = float(1 << 30)
Q31 = float(1 << 31)
_RESERVED = -(1 << 31)
_LEAST, _MOST = _RESERVED + 1, (1 << 31) - 1
_DRIVE_BYTES = PlantDrive.FIXED.size + 4
_CURRENTS, _DRIVES = (
    [field.name for field in fields(record) if field.name.startswith(signal)]
    for record, signal in ((PlantSample, "current"), (PlantDrive, "drive"))
)
"""Words of the magnets, the first to the last."""


class Reading(NamedTuple):
    """What the sensors show at the beginning of a tick; NaN: the sensor's error code."""

    gap: float  # 0 at the low end of the model's range of gaps, 1 at the high one
    force: float  # as a fraction of full scale
    current: float  # of the first magnet
    # bits of ``PORT_...`` in ``firmware/port/port.h``; 1: there is no sample at all
    status: int = 0
    # of a controller of position, as fractions of full scale
    position: float = 0.0
    further: tuple[float, ...] = ()  # currents of further magnets


class Plant(Protocol):
    """What stands at the other end of the bus."""

    def step(self, tick: int, currents: tuple[float, ...]) -> Reading:
        """Go on by one tick, to the beginning of tick number `tick`."""


Exchange = Callable[[PlantSample], PlantDrive]
"""Hands a sample to the controller and returns its drive."""


def over(connection: socket.socket, timeout: float = 10.0) -> Exchange:
    """Exchange records with a process at the other end of a socket."""
    wait_at_most(connection, timeout)

    def exchange(sample: PlantSample) -> PlantDrive:
        connection.sendall(sample.pack())
        data = connection.recv(_DRIVE_BYTES, socket.MSG_WAITALL)
        if not data:
            raise ConnectionError("it hung up")
        return PlantDrive.unpack(data)

    return exchange


class PlantBus:
    """The plant's end of the bus."""

    def __init__(self, plant: Plant, exchange: Exchange) -> None:
        self.plant = plant
        self.tick = 0
        self.drives: tuple[float, ...] = tuple(0.0 for _ in _DRIVES)
        self.state = State.INIT
        self.fault = Fault.NONE
        self.answer: PlantDrive | None = None
        self.exchange = exchange

    def step(self, ticks: int = 1) -> None:
        """Go on by some ticks, in lock-step with the controller."""
        for _ in range(ticks):
            self._step(self.tick + 1)

    def skip(self, ticks: int) -> None:
        """Let the plant go on without the controller, which misses these ticks."""
        for _ in range(ticks):
            self.tick += 1
            self.plant.step(self.tick, self.drives)

    def _step(self, tick: int) -> None:
        sample = _encode(tick, self.plant.step(tick, self.drives))
        try:
            drive = self.exchange(sample)
        except (OSError, ValueError) as error:
            raise InputError(
                f"the controller did not finish tick {tick}: {error}; see its output",
                code="tick-not-finished",
            ) from error
        if drive.tick != tick:
            raise InputError(
                f"the controller answered tick {drive.tick} to tick {tick}", code="tick-differs"
            )
        self.tick = tick
        self.answer = drive
        self.drives = tuple(getattr(drive, name) / Q31 for name in _DRIVES)
        self.state = State(drive.state & 0xFF)
        self.fault = Fault(drive.state >> 8 & 0xFF)

    @property
    def drive(self) -> float:
        """The first of the currents that the controller wants."""
        return self.drives[0]


def wait_at_most(connection: socket.socket, timeout: float) -> None:
    """Wait inside the system, not in Python: an emulated board sends byte by byte."""
    connection.settimeout(None)
    wait = struct.pack("@ll", int(timeout), int(timeout % 1.0 * 1e6))
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVTIMEO, wait)
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, wait)


def _encode(tick: int, reading: Reading) -> PlantSample:
    currents = (reading.current, *reading.further, *(0.0 for _ in _CURRENTS))
    return PlantSample(
        tick=tick & 0xFFFFFFFF,
        gap=_q30(reading.gap),
        force=_q30(reading.force),
        position=_code(reading.position, Q31),
        status=reading.status,
        **{name: _q30(current) for name, current in zip(_CURRENTS, currents, strict=False)},
    )


def _q30(value: float) -> int:
    """Give the nearest code; what lies beyond is the nearest end, no number the error code."""
    return _code(value, Q30)


def _code(value: float, unit: float) -> int:
    """Halves go up, as in the simulated loop."""
    if math.isnan(value):
        return _RESERVED
    return math.floor(min(max(value * unit + 0.5, _LEAST), _MOST))
