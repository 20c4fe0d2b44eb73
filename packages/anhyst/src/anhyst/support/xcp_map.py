"""The XCP view of a controller: memory areas, values and sizes.

XCP is a protocol by which measurement tools read and set values of a controller. The numbers are
read from contract/xcp.toml and signals.toml.
"""

from __future__ import annotations

import tomllib
from typing import Any, NamedTuple

from anhyst.support.atomic import contract_folder


class XcpValue(NamedTuple):
    """A value of four bytes. `of` names the signal that has the same full scale."""

    name: str
    format: str
    doc: str
    of: str = ""
    low: int = -(1 << 31)
    high: int = (1 << 31) - 1
    body: str = ""


def _value_from_row(row: dict[str, Any]) -> XcpValue:
    """Return a value from its row; values of several magnets end with the number of the magnet."""
    name = f"{row['name']}_{row['number']}" if "number" in row else row["name"]
    given_values = {key: row[key] for key in ("of", "low", "high", "body") if key in row}
    return XcpValue(name, row["format"], row["doc"], **given_values)


_XCP = tomllib.loads((contract_folder() / "xcp.toml").read_text(encoding="utf-8"))
_SIGNALS = tomllib.loads((contract_folder() / "signals.toml").read_text(encoding="utf-8"))

MAX_PACKET_BYTES: int = _XCP["packet"]
DAQ_LIST_COUNT: int = _XCP["lists"]
ODT_COUNT: int = _XCP["odts"]
MAX_ODT_ENTRIES: int = _XCP["entries"]
SEED_SECRET: int = _XCP["secret"]
EVENT_NAME: str = _XCP["event"]

HEARTBEAT_MS: int = _SIGNALS["heartbeat_ms"]
"""Upper limit, ms, on the boards for settings that count ticks."""

AREA_ADDRESSES: dict[str, int] = {area["name"]: area["number"] << 16 for area in _XCP["area"]}
"""Address of the first byte of each memory area."""

SIGNALS = tuple(map(_value_from_row, _SIGNALS["signal"]))
SETTINGS = tuple(map(_value_from_row, _SIGNALS["setting"]))
INPUTS = tuple(map(_value_from_row, _SIGNALS["input"]))
