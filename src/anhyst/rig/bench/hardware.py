"""The bench of a controller on a board, or of any firmware that keeps its own time."""

from __future__ import annotations

import struct
import time
from collections.abc import Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from anhyst.compensate.layout import PLACES
from anhyst.control.states import Command, State
from anhyst.link.frames import Body, Setting
from anhyst.link.plant_bus import Q30, Q31
from anhyst.rig.bench.bearing import BEARING_COMMANDS
from anhyst.rig.bench.force import FORCE_COMMANDS, check_demand
from anhyst.rig.bench.parameters import check_values
from anhyst.rig.bench.protocol import Aim, Parameter, Signal
from anhyst.rig.bench.settings import ControllerSettings, force_settings, heartbeat_setting
from anhyst.support.arrays import FloatArray
from anhyst.support.errors import InputError

_BEAT_S = 0.02
"""Between two signs of life to a controller, s; it waits for 0.1 s."""

_RESERVED = -(1 << 31)
"""Code of a sensor that had no value."""


class BoardLine(Protocol):
    """What a controller is reached by.

    Attributes
    ----------
    url : str
        For messages.
    body : Body
        What the controller controls.
    signals : tuple of str
        Signals of ``contract/signals.toml`` that :meth:`take` returns.
    every : int
        Ticks from one sample to the next.
    """

    url: str
    body: Body
    signals: tuple[str, ...]
    every: int

    def take(self, tick: int) -> NDArray[np.int64]:
        """Wait for the last sample up to a tick, and return all that came: tick, codes."""
        ...  # pragma: no cover

    def beat(self) -> None:
        """Say that the operator is there."""
        ...  # pragma: no cover

    def clock(self) -> int:
        """Return the number of the last tick, modulo 2^32."""
        ...  # pragma: no cover

    def goal(self) -> int:
        """Return what is demanded, q31 of full scale."""
        ...  # pragma: no cover

    def aim(self, code: int) -> None:
        """Demand a force or a position, q31 of full scale."""
        ...  # pragma: no cover

    def command(self, command: Command) -> State:
        """Change the state, and return the one it is in then."""
        ...  # pragma: no cover

    def read_words(self, first: int, count: int) -> list[int]:
        """Return words of the parameter block in force."""
        ...  # pragma: no cover

    def read_setting(self, setting: Setting) -> int:
        """Ask for a setting."""
        ...  # pragma: no cover

    def write_setting(self, setting: Setting, value: int) -> int:
        """Set a setting from the next tick on."""
        ...  # pragma: no cover

    def close(self) -> None:
        """Hang up."""
        ...  # pragma: no cover


class _Column(NamedTuple):
    """A signal of the bench, and of which of the controller's it is made: slope*code + offset."""

    signal: Signal
    source: str
    slope: float
    offset: float = 0.0


class HardwareBench:
    """A controller that runs by itself, seen and operated over a line.

    A :class:`anhyst.rig.bench.protocol.Bench` that keeps time. The controller's operator is whoever
    calls :meth:`advance`: without it there is no sign of life, and the controller goes to its safe
    state by itself.

    Parameters
    ----------
    line : BoardLine
        Closed with the bench.
    manifest : mapping
        Of the compiled folder that the firmware is built around.

    Attributes
    ----------
    aim : Aim
        The force of a magnet, the gap of a bearing.

    Raises
    ------
    InputError
        The firmware is built around another folder.
    """

    load_most = 0.0
    keeps_time = True

    def __init__(self, line: BoardLine, manifest: Mapping[str, Any]) -> None:
        self.rate = float(manifest["rate_Hz"])
        self.every = line.every
        self._line = line
        self._beaten = 0.0
        self._stretch = max(1, int(_BEAT_S * self.rate))
        self._force = line.body is Body.FORCE
        _check(line, manifest)
        columns = _force_columns(manifest) if self._force else _position_columns(manifest)
        known = [one for one in columns if one.source in line.signals]
        self.signals = tuple(one.signal for one in known)
        self._from = [1 + line.signals.index(one.source) for one in known]
        self._slopes = np.array([one.slope for one in known])
        self._offsets = np.array([one.offset for one in known])
        self._state_at = 1 + line.signals.index("state")
        signals = manifest["signals"]
        if self._force:
            self._code = Q31 / signals["demand"]["scale"]
            self._zero = 0.0
            low, high = manifest["limits"]["demand"]
            self.aim = Aim("force", "demand", "N", low, high, self._shown(line.goal()))
        else:
            position = manifest["controller"]["signals"]["position"]
            self._code, self._zero = -Q31 / position["scale"], position["zero_gap"]
            low, high = position["low_gap"], position["high_gap"]
            self.aim = Aim("gap", "reference", "m", low, high, self._shown(line.goal()))
        full = signals["demand"]["scale"], signals["current"]["scale"]
        settings = force_settings(*full, self.rate) if self._force else ()
        self._settings = ControllerSettings(line, (*settings, heartbeat_setting(self.rate)))
        self.tick = line.clock()
        self._state = State.INIT

    def advance(self, ticks: int) -> FloatArray:
        """Wait until some ticks have passed, and return all that came since."""
        parts, end = [], self.tick + ticks
        while self.tick < end:
            now = time.monotonic()
            if now - self._beaten > _BEAT_S:
                self._line.beat()
                self._beaten = now
            parts.append(
                self._line.take(max(self.tick + self.every, min(end, self.tick + self._stretch)))
            )
            self.tick = int(parts[-1][-1, 0])
        codes = np.concatenate(parts)
        self._state = State(int(codes[-1, self._state_at]))
        mine = codes[:, self._from]
        values = np.where(mine == _RESERVED, np.nan, mine * self._slopes + self._offsets)
        return np.column_stack((codes[:, 0].astype(np.float64), values))

    def command(self, command: Command) -> None:
        """Give a command."""
        self._state = self._line.command(command)

    def commands(self) -> tuple[Command, ...]:
        """Return the commands that this kind of controller has."""
        return FORCE_COMMANDS if self._force else BEARING_COMMANDS

    def demand(self, value: float) -> None:
        """Demand a force, N, or a gap, m."""
        if self._force:
            check_demand(self.aim, value, self._state)
        code = round((value - self._zero) * self._code)
        self._line.aim(max(-int(Q31), min(int(Q31) - 1, code)))

    def _shown(self, code: int) -> float:
        return float(code / self._code + self._zero)

    def load(self, force: float) -> None:
        """Refuse: nothing of the load is known here."""
        del force
        raise InputError("load: the bench of a board has no load drive")

    def parameters(self) -> tuple[Parameter, ...]:
        """Return the settings of the controller."""
        return self._settings.parameters()

    def apply(self, values: Mapping[str, float]) -> int:
        """Write settings one after the other; returns the first tick with all of them in force."""
        check_values(values, self.parameters())
        self._settings.write(values, self._state is State.RUN)
        return self.tick + (self._line.clock() - self.tick & 0xFFFFFFFF) + 1

    def close(self) -> None:
        """Hang up; a controller that drives current goes to its safe state by itself."""
        self._line.close()


def _force_columns(manifest: Mapping[str, Any]) -> tuple[_Column, ...]:
    signals = manifest["signals"]
    force, current = signals["demand"]["scale"], signals["current"]["scale"]
    gap = signals["gap"] or {"low": 0.0, "high": 1.0}
    span = gap["high"] - gap["low"]
    return (
        _Column(Signal("gap", "m", "as its sensor says"), "gap", span / Q30, gap["low"]),
        _Column(Signal("demand", "N", "force demanded, in force"), "demand", force / Q31),
        _Column(Signal("force", "N", "as its sensor says"), "force", force / Q30),
        *_currents(current),
        *_of_any(force),
    )


def _position_columns(manifest: Mapping[str, Any]) -> tuple[_Column, ...]:
    controller = manifest["controller"]
    position, force = controller["signals"]["position"], controller["signals"]["demand"]["scale"]
    current = controller["signals"]["current"]["scale"]
    slope, zero = -position["scale"] / Q31, position["zero_gap"]
    second = (
        _Column(Signal("current_2", "A", "of the second magnet"), "current_2", current / Q30),
        _Column(Signal("command_2", "A", "asked for, likewise"), "drive_2", current / Q31),
    )
    return (
        _Column(Signal("gap", "m", "as its sensor says"), "position", slope, zero),
        _Column(Signal("reference", "m", "gap controlled to"), "reference", slope, zero),
        _Column(Signal("demand", "N", "force that the controller wants"), "demand", force / Q31),
        *_currents(current),
        *(second if controller["magnets"] == 2 else ()),
        *_of_any(manifest["signals"]["demand"]["scale"]),
        _Column(Signal("phase", "", "what the currents do: Phase"), "phase", 1.0),
    )


def _currents(full: float) -> tuple[_Column, ...]:
    return (
        _Column(Signal("current", "A", "as its sensor says"), "current", full / Q30),
        _Column(Signal("command", "A", "current asked for"), "drive", full / Q31),
    )


def _of_any(force: float) -> tuple[_Column, ...]:
    return (
        _Column(Signal("expected", "N", "force that the model expects"), "expected", force / Q31),
        _Column(Signal("model_flux", "", "of the model, of full scale"), "flux", 1.0 / Q30),
        _Column(Signal("state", "", "of the controller: State"), "state", 1.0),
        _Column(Signal("fault", "", "its latched reason: Fault"), "fault", 1.0),
        _Column(Signal("flags", "", "what was in the way: Flag"), "flags", 1.0),
    )


def _check(line: BoardLine, manifest: Mapping[str, Any]) -> None:
    """Refuse a folder whose numbers would be wrong for the signals of this controller."""
    signals = manifest["signals"]
    if (manifest["controller"] is None) is not (line.body is Body.FORCE):
        raise InputError(f"{line.url}: controls a {line.body.name.lower()}, the folder does not")
    wanted = {
        "SCALE_DEMAND": ("full scale of the demand", signals["demand"]["scale"]),
        "SCALE_CURRENT": ("full scale of the current", signals["current"]["scale"]),
        "SCALE_RATE": ("rate", manifest["rate_Hz"]),
    }
    for word, (name, value) in wanted.items():
        words = line.read_words(PLACES[word], 2)
        (found,) = struct.unpack("<f", struct.pack("<2h", *words))
        if not abs(found - value) <= 1e-6 * abs(value):
            raise InputError(
                f"{line.url}: the {name} of its block is {found:g}, that of the folder {value:g}; "
                "name the folder that the firmware is built around"
            )
