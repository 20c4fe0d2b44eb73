"""Write the A2L description of a controller for XCP tools (ASAM MCD-2 MC, version 1.6)."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any

from anhyst.compilation.source import render
from anhyst.support.block_layout import HEAD_WORDS, MAX_BLOCK_WORDS
from anhyst.support.block_words import CODE_OF_ONE
from anhyst.support.states import Command, Fault, Phase, State
from anhyst.support.xcp_map import (
    AREA_ADDRESSES,
    DAQ_LIST_COUNT,
    EVENT_NAME,
    HEARTBEAT_MS,
    INPUTS,
    MAX_PACKET_BYTES,
    SETTINGS,
    SIGNALS,
    XcpValue,
)

_CODE_OF_ONE = {"q31": 2.0**31, "q30": 2.0**30, "integer": 1.0}
_ENUMS: dict[str, type[IntEnum]] = {"state": State, "fault": Fault, "phase": Phase, "command": Command}
_LAYOUTS = {
    "as_SLONG": "SLONG",
    "as_ULONG": "ULONG",
    "as_SWORD": "SWORD",
    "as_UWORD": "UWORD",
    "as_FLOAT32": "FLOAT32_IEEE",
}
_UNITS = ("1NS", "10NS", "100NS", "1US", "10US", "100US", "1MS", "10MS", "100MS", "1S")
_COMMANDS = (
    *("GET_COMM_MODE_INFO", "GET_ID", "GET_SEED", "UNLOCK", "SET_MTA", "UPLOAD", "SHORT_UPLOAD"),
    *(
        "BUILD_CHECKSUM",
        "DOWNLOAD",
        "SHORT_DOWNLOAD",
        "SET_CAL_PAGE",
        "GET_CAL_PAGE",
        "GET_PAG_PROCESSOR_INFO",
    ),
    *("COPY_CAL_PAGE", "CLEAR_DAQ_LIST", "SET_DAQ_PTR", "WRITE_DAQ", "SET_DAQ_LIST_MODE"),
    *("START_STOP_DAQ_LIST", "START_STOP_SYNCH", "GET_DAQ_CLOCK", "GET_DAQ_PROCESSOR_INFO"),
    *("GET_DAQ_RESOLUTION_INFO", "GET_DAQ_EVENT_INFO", "FREE_DAQ", "ALLOC_DAQ", "ALLOC_ODT"),
    "ALLOC_ODT_ENTRY",
)
_READ_ONLY_WORDS = {word.name for word in HEAD_WORDS} - {"GENERATION"}
"""Words that a tool must not change, because they are checked or recalculated."""

_MAX_SINGLE_PRECISION = 3.4028234e38


@dataclass(frozen=True)
class _Conversion:
    """Linear conversion from a number to a quantity: slope*number + offset."""

    name: str
    unit: str
    slope: float
    offset: float = 0.0

    def limits(self, low: float, high: float) -> dict[str, float]:
        """Return the limits of the converted quantity."""
        first_value, second_value = self.slope * low + self.offset, self.slope * high + self.offset
        return {"low": min(first_value, second_value), "high": max(first_value, second_value)}


@dataclass
class _Conversions:
    """All conversions; equal conversions are listed once."""

    by_content: dict[tuple[str, float, float], _Conversion] = field(default_factory=dict)

    def find_or_add(self, unit: str, slope: float, offset: float = 0.0) -> _Conversion:
        """Return a conversion; new conversions are numbered."""
        key = (unit, slope, offset)
        return self.by_content.setdefault(key, _Conversion(f"m{len(self.by_content)}", unit, slope, offset))


def make_a2l(manifest: Mapping[str, Any]) -> str:
    """Return the A2L description of a controller."""
    rate = float(manifest["rate_Hz"])
    conversions = _Conversions()
    measurements = [
        _value_entry(value, AREA_ADDRESSES["signal"] + 4 * number, manifest, conversions)
        for number, value in enumerate(SIGNALS)
    ]
    controlled_quantity = "force" if manifest["controller"] is None else "position"
    operation = [
        _value_entry(_limit_ticks(value, rate), AREA_ADDRESSES["setting"] + 4 * number, manifest, conversions)
        for number, value in enumerate(SETTINGS)
        if value.body in ("", controlled_quantity)
    ]
    operation += [
        _value_entry(
            _limit_position(value, manifest), AREA_ADDRESSES["input"] + 4 * number, manifest, conversions
        )
        for number, value in enumerate(INPUTS)
        if value.body in ("", controlled_quantity)
    ]
    words = [*_block_head_entries(conversions), *_word_entries(manifest, conversions)]
    tables = [
        {
            "name": name,
            "doc": _quotable_text((kind.__doc__ or "").strip().partition("\n")[0]),
            "names": [(member.value, member.name.lower()) for member in kind],
        }
        for name, kind in _ENUMS.items()
    ]
    return render(
        "description.a2l.j2",
        {
            "name": manifest["name"],
            "title": _quotable_text(f"{manifest['model']['name']}, {manifest['kind']}, {rate:g} Hz"),
            "version": manifest["anhyst"],
            "block_at": f"0x{AREA_ADDRESSES['block']:08X}",
            "block_bytes": 2 * MAX_BLOCK_WORDS,
            "packet": MAX_PACKET_BYTES,
            "lists": DAQ_LIST_COUNT,
            "event": EVENT_NAME,
            "units": _UNITS,
            "stamp": tick_period(rate, 65535),
            "cycle": tick_period(rate, 255),
            "commands": _COMMANDS,
            "layouts": _LAYOUTS,
            "methods": conversions.by_content.values(),
            "tables": tables,
            "measurements": measurements,
            "characteristics": operation + words,
            "operation": [word["name"] for word in operation],
            "parameters": [word["name"] for word in words],
        },
    )


def tick_period(rate: float, max_count: int) -> tuple[int, int]:
    """Return a tick period as a count up to `max_count`, and the exponent n of its unit 10^n ns."""
    for exponent in range(10):
        ticks = (10 ** (9 - exponent) + int(rate) // 2) // int(rate)
        if ticks <= max_count:
            return ticks, exponent
    raise AssertionError(rate)  # pragma: no cover - a second fits


def _value_entry(
    value: XcpValue, address: int, manifest: Mapping[str, Any], conversions: _Conversions
) -> dict[str, Any]:
    """Return the entry of a value of four bytes."""
    row: dict[str, Any] = {
        "name": value.name,
        "doc": _quotable_text(value.doc),
        "at": f"0x{address:08X}",
        "layout": "as_SLONG",
        "entries": 1,
        "read_only": False,
    }
    if value.name in _ENUMS:
        return row | {"method": value.name, "low": 0, "high": max(_ENUMS[value.name])}
    conversion = _select_conversion(value, manifest, conversions)
    return row | {"method": conversion.name} | conversion.limits(value.low, value.high)


def _select_conversion(
    value: XcpValue, manifest: Mapping[str, Any], conversions: _Conversions
) -> _Conversion:
    """Return the conversion of a value."""
    step = 1.0 / _CODE_OF_ONE[value.format]
    signals = manifest["signals"]
    if value.of == "position":
        controller = manifest["controller"]
        scale = controller["signals"]["position"]["scale"] if controller is not None else 1.0
        return conversions.find_or_add("m", scale * step)
    if value.of == "gap" and signals["gap"] is not None:
        low, high = signals["gap"]["low"], signals["gap"]["high"]
        return conversions.find_or_add(signals["gap"]["unit"], (high - low) * step, low)
    if value.of in ("demand", "current"):
        return conversions.find_or_add(signals[value.of]["unit"], signals[value.of]["scale"] * step)
    return conversions.find_or_add("", step)


def _limit_ticks(value: XcpValue, rate: float) -> XcpValue:
    """Return a setting; a number of ticks gets the upper limit that the boards apply."""
    if not value.name.endswith("_ticks"):
        return value
    return value._replace(high=min(value.high, math.ceil(rate * HEARTBEAT_MS / 1000)))


def _limit_position(value: XcpValue, manifest: Mapping[str, Any]) -> XcpValue:
    """Return an input; a position gets the range that the controller accepts."""
    if value.of != "position":
        return value
    settings = manifest["controller"]["settings"]
    return value._replace(low=settings["position_low"], high=settings["position_high"])


def _block_head_entries(conversions: _Conversions) -> Iterator[dict[str, Any]]:
    for word in HEAD_WORDS:
        is_double_word = word.size == 2
        yield {
            "name": f"block.{word.name.lower()}",
            "doc": _quotable_text(word.doc),
            "at": _address_text(word.index),
            "layout": "as_ULONG" if is_double_word else "as_UWORD",
            "entries": 1,
            "read_only": word.name in _READ_ONLY_WORDS,
            "method": conversions.find_or_add("", 1.0).name,
            "low": 0 if is_double_word else word.low,
            "high": 0xFFFFFFFF if is_double_word else word.high,
        }


def _word_entries(manifest: Mapping[str, Any], conversions: _Conversions) -> Iterator[dict[str, Any]]:
    for word in manifest["parameters"]:
        row = {
            "name": f"block.{word['name'].lower()}",
            "doc": _quotable_text(word["doc"]),
            "at": _address_text(word["first"]),
            "entries": word["entries"],
            "read_only": False,
        }
        if word["format"] == "single":
            conversion = conversions.find_or_add(word["unit"], 1.0)
            yield (
                row
                | {"low": -_MAX_SINGLE_PRECISION, "high": _MAX_SINGLE_PRECISION}
                | {
                    "layout": "as_FLOAT32",
                    "entries": 1,
                    "read_only": True,  # the firmware accepts only the compiled scales
                    "method": conversion.name,
                }
            )
            continue
        conversion = conversions.find_or_add(word["unit"], word["scale"] / CODE_OF_ONE[word["format"]])
        yield (
            row
            | conversion.limits(word["low"], word["high"])
            | {"layout": "as_SWORD", "method": conversion.name}
        )


def _address_text(word: int) -> str:
    return f"0x{AREA_ADDRESSES['block'] + 2 * word:08X}"


def _quotable_text(text: str) -> str:
    """Return a text that may be enclosed in quotes."""
    return re.sub(r"[\"\\\s]+", " ", text).strip()
