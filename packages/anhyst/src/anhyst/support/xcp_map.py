"""What a master of XCP sees of a controller: areas of addresses, values, sizes.

They are in contract/xcp.toml and signals.toml.
"""

from __future__ import annotations

import tomllib
from typing import Any, NamedTuple

from anhyst.support.atomic import contract_folder


class XcpValue(NamedTuple):
    """A value of four bytes; `of` names the signal whose full scale 1.0 is."""

    name: str
    format: str
    doc: str
    of: str = ""
    low: int = -(1 << 31)
    high: int = (1 << 31) - 1
    body: str = ""


def _value_from_row(row: dict[str, Any]) -> XcpValue:
    """Return a value from its row; that of a second magnet has the number behind its name."""
    name = f"{row['name']}_{row['number']}" if "number" in row else row["name"]
    given = {key: row[key] for key in ("of", "low", "high", "body") if key in row}
    return XcpValue(name, row["format"], row["doc"], **given)


_XCP = tomllib.loads((contract_folder() / "xcp.toml").read_text(encoding="utf-8"))
_SIGNALS = tomllib.loads((contract_folder() / "signals.toml").read_text(encoding="utf-8"))

MAX_PACKET_BYTES: int = _XCP["packet"]
DAQ_LIST_COUNT: int = _XCP["lists"]
ODT_COUNT: int = _XCP["odts"]
MAX_ODT_ENTRIES: int = _XCP["entries"]
SEED_SECRET: int = _XCP["secret"]
EVENT_NAME: str = _XCP["event"]

HEARTBEAT_MS: int = _SIGNALS["heartbeat_ms"]
"""Ceiling of the boards for settings in ticks."""

AREA_ADDRESSES: dict[str, int] = {area["name"]: area["number"] << 16 for area in _XCP["area"]}
"""Address of the first byte of each area."""

SIGNALS = tuple(map(_value_from_row, _SIGNALS["signal"]))
SETTINGS = tuple(map(_value_from_row, _SIGNALS["setting"]))
INPUTS = tuple(map(_value_from_row, _SIGNALS["input"]))
