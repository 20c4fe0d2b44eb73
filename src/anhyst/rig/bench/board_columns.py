"""What the codes of a controller on a board mean, as the manifest of its folder says."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from anhyst.link.frames import Body
from anhyst.link.plant_bus import Q30, Q31
from anhyst.rig.bench.protocol import Aim, Signal
from anhyst.rig.bench.settings import (
    KnownSetting,
    force_settings,
    heartbeat_setting,
    position_settings,
)
from anhyst.rig.recording import column
from anhyst.support.arrays import FloatArray

_RESERVED = -(1 << 31)
"""Code of a sensor that had no value."""


class _Column(NamedTuple):
    """A signal of the bench, and of which of the controller's it is made: slope*code + offset."""

    signal: Signal
    source: str
    slope: float
    offset: float = 0.0


class BoardColumns:
    """Signals, demand and settings of a controller in SI units."""

    def __init__(self, body: Body, sources: Sequence[str], manifest: Mapping[str, Any]) -> None:
        force, rate = body is Body.FORCE, float(manifest["rate_Hz"])
        columns = _force_columns(manifest) if force else _position_columns(manifest)
        known = [one for one in columns if one.source in sources]
        self._code: float
        self._zero: float
        self.signals = tuple(one.signal for one in known)
        self._from = [1 + sources.index(one.source) for one in known]
        self._slopes = np.array([one.slope for one in known])
        self._offsets = np.array([one.offset for one in known])
        signals = manifest["signals"]
        if force:
            demand = signals["demand"]["scale"]
            low, high = manifest["limits"]["demand"]
            self._aim = Aim("force", "demand", "N", low, high, 0.0)
            self._code, self._zero = float(Q31 / demand), 0.0
            own = force_settings(demand, signals["current"]["scale"], rate)
        else:
            position = manifest["controller"]["signals"]["position"]
            low, high = position["low_gap"], position["high_gap"]
            self._aim = Aim("gap", "reference", "m", low, high, 0.0)
            self._code, self._zero = float(-Q31 / position["scale"]), position["zero_gap"]
            own = position_settings(tuple(manifest["controller"]["gains"].values()))
        self.settings: tuple[KnownSetting, ...] = (*own, heartbeat_setting(rate))

    def values(self, codes: NDArray[np.int64]) -> FloatArray:
        """Return rows of tick and signals for rows of tick and codes."""
        mine = codes[:, self._from]
        values = np.where(mine == _RESERVED, np.nan, mine * self._slopes + self._offsets)
        return np.column_stack((codes[:, 0].astype(np.float64), values))

    def aim(self, code: int) -> Aim:
        """Return what may be demanded, with what is: q31 of full scale."""
        return self._aim._replace(value=float(code / self._code + self._zero))

    def code(self, value: float) -> int:
        """Return a force, N, or a gap, m, as a controller takes it: q31 of full scale."""
        code = round((value - self._zero) * self._code)
        return max(-int(Q31), min(int(Q31) - 1, code))


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
    return (
        _Column(Signal("gap", "m", "as its sensor says"), "position", slope, zero),
        _Column(Signal("reference", "m", "gap controlled to"), "reference", slope, zero),
        _Column(Signal("demand", "N", "force that the controller wants"), "demand", force / Q31),
        *(one for number in range(controller["magnets"]) for one in _currents(current, number + 1)),
        *_of_any(manifest["signals"]["demand"]["scale"]),
        _Column(Signal("phase", "", "what the currents do: Phase"), "phase", 1.0),
    )


def _currents(full: float, number: int = 1) -> tuple[_Column, ...]:
    of = f", of magnet {number}" if number > 1 else ""
    read, asked, driven = (column(name, "", number) for name in ("current", "command", "drive"))
    return (
        _Column(Signal(read, "A", f"as its sensor says{of}"), read, full / Q30),
        _Column(Signal(asked, "A", f"current asked for{of}"), driven, full / Q31),
    )


def _of_any(force: float) -> tuple[_Column, ...]:
    return (
        _Column(Signal("expected", "N", "force that the model expects"), "expected", force / Q31),
        _Column(Signal("model_flux", "", "of the model, of full scale"), "flux", 1.0 / Q30),
        _Column(Signal("state", "", "of the controller: State"), "state", 1.0),
        _Column(Signal("fault", "", "its latched reason: Fault"), "fault", 1.0),
        _Column(Signal("flags", "", "what was in the way: Flag"), "flags", 1.0),
    )
