"""The description of a controller for tools that speak XCP: its A2L."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from enum import IntEnum
from typing import Any

from anhyst.compilation.source import render
from anhyst.support.block_layout import HEAD, MOST_WORDS
from anhyst.support.block_words import ONES
from anhyst.support.states import Command, Fault, Phase, State
from anhyst.support.xcp_map import (
    AREAS,
    EVENT,
    HEARTBEAT_MS,
    INPUTS,
    LISTS,
    PACKET,
    SETTINGS,
    SIGNALS,
    XcpValue,
)

_ONES = {"q31": 2.0**31, "q30": 2.0**30, "integer": 1.0}
_NAMED: dict[str, type[IntEnum]] = {
    "state": State,
    "fault": Fault,
    "phase": Phase,
    "command": Command,
}
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
_FIXED = {word.name for word in HEAD} - {"GENERATION"}
"""Words that no tool may change: what they say of the block is checked, or computed anew."""

_SINGLE_MOST = 3.4028234e38


@dataclass(frozen=True)
class _Method:
    """How a number becomes a quantity: slope*number + offset."""

    name: str
    unit: str
    slope: float
    offset: float = 0.0

    def ends(self, low: float, high: float) -> dict[str, float]:
        """Return the limits of the quantity."""
        first, second = self.slope * low + self.offset, self.slope * high + self.offset
        return {"low": min(first, second), "high": max(first, second)}


@dataclass
class _Methods:
    """Every method once, by what it does."""

    found: dict[tuple[str, float, float], _Method] = field(default_factory=dict)

    def of(self, unit: str, slope: float, offset: float = 0.0) -> _Method:
        """Return the method; new ones are numbered."""
        key = (unit, slope, offset)
        return self.found.setdefault(key, _Method(f"m{len(self.found)}", unit, slope, offset))


def a2l(manifest: Mapping[str, Any]) -> str:
    """Return the description of a controller in ASAM MCD-2 MC, version 1.6."""
    rate = float(manifest["rate_Hz"])
    methods = _Methods()
    measurements = [
        _described(value, AREAS["signal"] + 4 * number, manifest, methods)
        for number, value in enumerate(SIGNALS)
    ]
    body = "force" if manifest["controller"] is None else "position"
    operation = [
        _described(_bounded(value, rate), AREAS["setting"] + 4 * number, manifest, methods)
        for number, value in enumerate(SETTINGS)
        if value.body in ("", body)
    ]
    operation += [
        _described(_within_reach(value, manifest), AREAS["input"] + 4 * number, manifest, methods)
        for number, value in enumerate(INPUTS)
        if value.body in ("", body)
    ]
    words = [*_head(methods), *_words(manifest, methods)]
    tables = [
        {
            "name": name,
            "doc": _plain((kind.__doc__ or "").strip().partition("\n")[0]),
            "names": [(member.value, member.name.lower()) for member in kind],
        }
        for name, kind in _NAMED.items()
    ]
    return render(
        "description.a2l.j2",
        {
            "name": manifest["name"],
            "title": _plain(f"{manifest['model']['name']}, {manifest['kind']}, {rate:g} Hz"),
            "version": manifest["anhyst"],
            "block_at": f"0x{AREAS['block']:08X}",
            "block_bytes": 2 * MOST_WORDS,
            "packet": PACKET,
            "lists": LISTS,
            "event": EVENT,
            "units": _UNITS,
            "stamp": period(rate, 65535),
            "cycle": period(rate, 255),
            "commands": _COMMANDS,
            "layouts": _LAYOUTS,
            "methods": methods.found.values(),
            "tables": tables,
            "measurements": measurements,
            "characteristics": operation + words,
            "operation": [word["name"] for word in operation],
            "parameters": [word["name"] for word in words],
        },
    )


def period(rate: float, most: int) -> tuple[int, int]:
    """Return the period of a tick as a number up to `most`, and the power of ten of ns it counts."""
    for power in range(10):
        ticks = (10 ** (9 - power) + int(rate) // 2) // int(rate)
        if ticks <= most:
            return ticks, power
    raise AssertionError(rate)  # pragma: no cover - a second fits


def _described(
    value: XcpValue, at: int, manifest: Mapping[str, Any], methods: _Methods
) -> dict[str, Any]:
    """Return what stands in the A2L of a value of four bytes."""
    row: dict[str, Any] = {
        "name": value.name,
        "doc": _plain(value.doc),
        "at": f"0x{at:08X}",
        "layout": "as_SLONG",
        "entries": 1,
        "read_only": False,
    }
    if value.name in _NAMED:
        return row | {"method": value.name, "low": 0, "high": max(_NAMED[value.name])}
    method = _method(value, manifest, methods)
    return row | {"method": method.name} | method.ends(value.low, value.high)


def _method(value: XcpValue, manifest: Mapping[str, Any], methods: _Methods) -> _Method:
    """Return what 1 of a value is worth."""
    step = 1.0 / _ONES[value.format]
    signals = manifest["signals"]
    if value.of == "position":
        controller = manifest["controller"]
        scale = controller["signals"]["position"]["scale"] if controller is not None else 1.0
        return methods.of("m", scale * step)
    if value.of == "gap" and signals["gap"] is not None:
        low, high = signals["gap"]["low"], signals["gap"]["high"]
        return methods.of(signals["gap"]["unit"], (high - low) * step, low)
    if value.of in ("demand", "current"):
        return methods.of(signals[value.of]["unit"], signals[value.of]["scale"] * step)
    return methods.of("", step)


def _bounded(value: XcpValue, rate: float) -> XcpValue:
    """Return a setting as the boards limit it."""
    if not value.name.endswith("_ticks"):
        return value
    return value._replace(high=min(value.high, math.ceil(rate * HEARTBEAT_MS / 1000)))


def _within_reach(value: XcpValue, manifest: Mapping[str, Any]) -> XcpValue:
    """Return an input as the controller limits it: a target to the positions that can be."""
    if value.of != "position":
        return value
    settings = manifest["controller"]["settings"]
    return value._replace(low=settings["position_low"], high=settings["position_high"])


def _head(methods: _Methods) -> Iterator[dict[str, Any]]:
    for word in HEAD:
        double = word.size == 2
        yield {
            "name": f"block.{word.name.lower()}",
            "doc": _plain(word.doc),
            "at": _address(word.at),
            "layout": "as_ULONG" if double else "as_UWORD",
            "entries": 1,
            "read_only": word.name in _FIXED,
            "method": methods.of("", 1.0).name,
            "low": 0 if double else word.low,
            "high": 0xFFFFFFFF if double else word.high,
        }


def _words(manifest: Mapping[str, Any], methods: _Methods) -> Iterator[dict[str, Any]]:
    for word in manifest["parameters"]:
        row = {
            "name": f"block.{word['name'].lower()}",
            "doc": _plain(word["doc"]),
            "at": _address(word["first"]),
            "entries": word["entries"],
            "read_only": False,
        }
        if word["format"] == "single":
            method = methods.of(word["unit"], 1.0)
            yield (
                row
                | {"low": -_SINGLE_MOST, "high": _SINGLE_MOST}
                | {
                    "layout": "as_FLOAT32",
                    "entries": 1,
                    "read_only": True,  # what the signals are counted in: a board takes no other
                    "method": method.name,
                }
            )
            continue
        method = methods.of(word["unit"], word["scale"] / ONES[word["format"]])
        yield (
            row
            | method.ends(word["low"], word["high"])
            | {"layout": "as_SWORD", "method": method.name}
        )


def _address(word: int) -> str:
    return f"0x{AREAS['block'] + 2 * word:08X}"


def _plain(text: str) -> str:
    """Return a text that may stand between quotes."""
    return re.sub(r"[\"\\\s]+", " ", text).strip()
