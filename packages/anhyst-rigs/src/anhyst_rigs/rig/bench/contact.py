"""Open the line to a controller on a board, check that it is the expected one, and read it.

The manifest of the compiled folder gives the scale of each signal. A controller with other scales
or another rate is rejected.
"""

from __future__ import annotations

import struct
import time
from collections.abc import Callable, Mapping, Sequence
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from anhyst.support.block_layout import WORD_INDEX
from anhyst.support.block_words import CRC_INDEX
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst.support.states import Fault, State
from anhyst_rigs.link.frames import Body
from anhyst_rigs.link.virtual_boards import Q30, Q31
from anhyst_rigs.link.xcp import XcpMaster
from anhyst_rigs.rig.bench.protocol import DemandRange, Signal
from anhyst_rigs.rig.bench.settings import (
    ControllerSettings,
    SettingSpec,
    force_settings,
    heartbeat_setting,
    position_settings,
)
from anhyst_rigs.rig.recording import column_name

_NO_VALUE_CODE = -(1 << 31)
"""Code that stands for a missing sensor reading."""


class _Column(NamedTuple):
    """A signal of the bench, computed from the code of a controller signal as slope*code + offset."""

    signal: Signal
    source: str
    slope: float
    offset: float = 0.0


class BoardColumns:
    """Conversion of a controller's signals, demand and settings to SI units."""

    def __init__(self, body: Body, sources: Sequence[str], manifest: Mapping[str, Any]) -> None:
        force, rate = body is Body.FORCE, float(manifest["rate_Hz"])
        columns = _force_columns(manifest) if force else _position_columns(manifest)
        columns_available = [column_spec for column_spec in columns if column_spec.source in sources]
        self._codes_per_unit: float
        self.signals = tuple(column_spec.signal for column_spec in columns_available)
        self._source_columns = [1 + sources.index(column_spec.source) for column_spec in columns_available]
        self._slopes = np.array([column_spec.slope for column_spec in columns_available])
        self._offsets = np.array([column_spec.offset for column_spec in columns_available])
        signals = manifest["signals"]
        if force:
            demand = signals["demand"]["scale"]
            demand_low, demand_high = manifest["limits"]["demand"]
            self._demand_range = DemandRange("force", "demand", "N", demand_low, demand_high, 0.0)
            self._codes_per_unit, self._zero = Q31 / demand, 0.0
            setting_specs = force_settings(demand, signals["current"]["scale"], rate)
        else:
            position = manifest["controller"]["signals"]["position"]
            demand_low, demand_high = position["low_gap"], position["high_gap"]
            self._demand_range = DemandRange("gap", "reference", "m", demand_low, demand_high, 0.0)
            self._codes_per_unit, self._zero = -Q31 / position["scale"], position["zero_gap"]
            setting_specs = position_settings(tuple(manifest["controller"]["gains"].values()))
        self.settings: tuple[SettingSpec, ...] = (*setting_specs, heartbeat_setting(rate))

    def values(self, signal_codes: NDArray[np.int64]) -> FloatArray:
        """Convert rows of a tick number and codes to rows of a tick number and signals in SI units."""
        source_codes = signal_codes[:, self._source_columns]
        values = np.where(source_codes == _NO_VALUE_CODE, np.nan, source_codes * self._slopes + self._offsets)
        return np.column_stack((signal_codes[:, 0].astype(np.float64), values))

    def demand_range(self, present_code: int) -> DemandRange:
        """Return the range of the demand; the argument is the present demand, q31 of full scale."""
        return self._demand_range._replace(value=float(present_code / self._codes_per_unit + self._zero))

    def demand_code(self, value: float) -> int:
        """Return the q31 code of a force, N, or a gap, m, relative to full scale."""
        code = round((value - self._zero) * self._codes_per_unit)
        return max(-int(Q31), min(int(Q31) - 1, code))


def _force_columns(manifest: Mapping[str, Any]) -> tuple[_Column, ...]:
    signals = manifest["signals"]
    force, current = signals["demand"]["scale"], signals["current"]["scale"]
    gap = signals["gap"] or {"low": 0.0, "high": 1.0}
    gap_range = gap["high"] - gap["low"]
    return (
        _Column(Signal("gap", "m", "measured gap"), "gap", gap_range / Q30, gap["low"]),
        _Column(Signal("demand", "N", "active force demand"), "demand", force / Q31),
        _Column(Signal("force", "N", "measured force"), "force", force / Q30),
        *_current_columns(current),
        *_common_columns(force),
    )


def _position_columns(manifest: Mapping[str, Any]) -> tuple[_Column, ...]:
    controller = manifest["controller"]
    position, force = controller["signals"]["position"], controller["signals"]["demand"]["scale"]
    current = controller["signals"]["current"]["scale"]
    slope, zero = -position["scale"] / Q31, position["zero_gap"]
    return (
        _Column(Signal("gap", "m", "measured gap"), "position", slope, zero),
        _Column(Signal("reference", "m", "reference gap"), "reference", slope, zero),
        _Column(Signal("demand", "N", "demanded force"), "demand", force / Q31),
        *(spec for number in range(controller["magnets"]) for spec in _current_columns(current, number + 1)),
        *_common_columns(manifest["signals"]["demand"]["scale"]),
        _Column(Signal("phase", "", "phase of the controller: Phase"), "phase", 1.0),
    )


def _current_columns(full_scale: float, magnet_number: int = 1) -> tuple[_Column, ...]:
    magnet_text = f", of magnet {magnet_number}" if magnet_number > 1 else ""
    read_name, command_name, drive_name = (
        column_name(name, "", magnet_number) for name in ("current", "command", "drive")
    )
    return (
        _Column(Signal(read_name, "A", f"measured current{magnet_text}"), read_name, full_scale / Q30),
        _Column(Signal(command_name, "A", f"commanded current{magnet_text}"), drive_name, full_scale / Q31),
    )


def _common_columns(force: float) -> tuple[_Column, ...]:
    return (
        _Column(Signal("expected", "N", "force predicted by the model"), "expected", force / Q31),
        _Column(Signal("model_flux", "", "flux of the model, relative to full scale"), "flux", 1.0 / Q30),
        _Column(Signal("state", "", "state of the controller: State"), "state", 1.0),
        _Column(Signal("fault", "", "latched fault: Fault"), "fault", 1.0),
        _Column(Signal("flags", "", "flags of this tick: Flag"), "flags", 1.0),
    )


OpenLineFunction = Callable[[], XcpMaster]
"""Function that opens a line. It raises an InputError if no controller responds."""


class OtherFirmware(InputError):  # noqa: N818 - not an error of the controller
    """Error: the controller that responds is not the one for which the folder was compiled."""


class ControllerContact:
    """An open line to a controller with its first readings; no command has been sent."""

    def __init__(self, line: XcpMaster, manifest: Mapping[str, Any]) -> None:
        _check_scales(line, manifest)
        self.line = line
        self.columns = BoardColumns(line.body, line.signals, manifest)
        self.settings = ControllerSettings(line, self.columns.settings)
        self.demand_code = line.read_demand()
        self.block = active_block_checksum(line)
        self.rows = line.take_samples(0)
        self.contact_time = time.monotonic()

    @property
    def state(self) -> State:
        """State of the controller at the last sample."""
        return State(self._last_value("state"))

    @property
    def fault(self) -> Fault:
        """Fault that the controller has latched."""
        return Fault(self._last_value("fault"))

    def _last_value(self, signal: str) -> int:
        return int(self.rows[-1, 1 + self.line.signals.index(signal)])

    def check_same_controller(self, earlier_contact: ControllerContact) -> None:
        """Raise OtherFirmware if the controller of an earlier contact was a different one."""
        line, earlier_line = self.line, earlier_contact.line
        identity = attrgetter("name", "body", "signals", "tick_interval")
        if identity(line) != identity(earlier_line):
            raise OtherFirmware(
                f"{line.url}: '{line.name}' answers with {len(line.signals)} signals instead of "
                f"'{earlier_line.name}' with {len(earlier_line.signals)}; "
                "this is another firmware, restart with its folder",
                code="other-firmware",
            )


def open_contact(
    open_line: OpenLineFunction, manifest: Mapping[str, Any], earlier_contact: ControllerContact | None = None
) -> ControllerContact:
    """Open a line and return the contact; close the line if the controller is not the expected one."""
    line = open_line()
    try:
        contact = ControllerContact(line, manifest)
        if earlier_contact is not None:
            contact.check_same_controller(earlier_contact)
    except BaseException:
        line.close()
        raise
    return contact


def active_block_checksum(line: XcpMaster) -> list[int]:
    """Return the checksum of the active parameter block, which identifies this block."""
    return line.read_words(CRC_INDEX, 2)


def _check_scales(line: XcpMaster, manifest: Mapping[str, Any]) -> None:
    """Raise OtherFirmware if controlled quantity, scales or rate differ from those of the folder."""
    signals = manifest["signals"]
    if (manifest["controller"] is None) is not (line.body is Body.FORCE):
        raise OtherFirmware(
            f"{line.url}: controls a {line.body.name.lower()}, but the folder does not", code="other-firmware"
        )
    expected_values = {
        "SCALE_DEMAND": ("full scale of the demand", signals["demand"]["scale"]),
        "SCALE_CURRENT": ("full scale of the current", signals["current"]["scale"]),
        "SCALE_RATE": ("rate", manifest["rate_Hz"]),
    }
    for word_name, (name, value) in expected_values.items():
        scale_words = line.read_words(WORD_INDEX[word_name], 2)
        (board_value,) = struct.unpack("<f", struct.pack("<2h", *scale_words))
        if not abs(board_value - value) <= 1e-6 * abs(value):
            raise OtherFirmware(
                f"{line.url}: the {name} of its block is {board_value:g}, but {value:g} in the folder; "
                "name the folder from which the firmware was built",
                code="other-firmware",
                key=name,
            )
