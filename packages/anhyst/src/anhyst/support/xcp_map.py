"""What a master of XCP sees of a controller: areas of addresses, values, sizes.

Made by tools/contract from contract/xcp.toml and signals.toml: do not edit.
"""

from __future__ import annotations

from typing import NamedTuple


class XcpValue(NamedTuple):
    """A value of four bytes; `of` names the signal whose full scale 1.0 is."""

    name: str
    format: str
    doc: str
    of: str = ""
    low: int = -(1 << 31)
    high: int = (1 << 31) - 1
    body: str = ""


PACKET = 136
LISTS = 4
ODTS = 8
ENTRIES = 32
SECRET = 0x616E6879
EVENT = "tick"

HEARTBEAT_MS = 500
"""Ceiling of the boards for settings in ticks."""

AREAS = {
    "signal": 0x00010000,
    "setting": 0x00020000,
    "input": 0x00030000,
    "block": 0x00040000,
    "name": 0x00050000,
    "event": 0x00060000,
}
"""Address of the first byte of each area."""

SIGNALS = (
    XcpValue("demand", "q31", "demand in force, q31 of the full-scale force", of="demand"),
    XcpValue("force", "q30", "measured force, q30", of="demand", body="force"),
    XcpValue("gap", "q30", "measured gap, q30", of="gap", body="force"),
    XcpValue("current", "q30", "measured current, q30", of="current"),
    XcpValue("drive", "q31", "current driven, q31 of the full-scale current", of="current"),
    XcpValue("flux", "q30", "flux of the model after the commit, q30"),
    XcpValue("expected", "q31", "force that the model expects after the commit, q31", of="demand"),
    XcpValue("state", "integer", "state, as a number"),
    XcpValue("flags", "integer", "flags, as in status"),
    XcpValue(
        "position",
        "q31",
        "measured position, q31 of the controller's full scale",
        of="position",
        body="position",
    ),
    XcpValue(
        "reference", "q31", "position controlled to, likewise", of="position", body="position"
    ),
    XcpValue("phase", "integer", "phase, as a number", body="position"),
    XcpValue(
        "current_2",
        "q30",
        "measured current of the second magnet, q30",
        of="current",
        body="position",
    ),
    XcpValue("drive_2", "q31", "current driven there, q31", of="current", body="position"),
    XcpValue("fault", "integer", "latched reason of a fault, as a number"),
)

SETTINGS = (
    XcpValue(
        "heartbeat_ticks",
        "integer",
        "ticks without a new request until the link counts as lost; the board has a ceiling of its own",
        low=2,
        high=1000000,
    ),
    XcpValue(
        "demand_slew",
        "q31",
        "largest change of the demand in a tick, q31",
        of="demand",
        low=1,
        high=2147483647,
    ),
    XcpValue(
        "compensation",
        "integer",
        "1: the compensator; 0: a constant force-current ratio",
        low=0,
        high=1,
    ),
    XcpValue(
        "ratio",
        "q30",
        "the constant ratio, q30: current for each unit of demand",
        low=-2147483648,
        high=2147483647,
    ),
    XcpValue(
        "follow",
        "integer",
        "what the memory follows. 0: the current driven; 1: the current measured",
        low=0,
        high=1,
    ),
    XcpValue(
        "gains",
        "integer",
        "0: the gains built in; 1: these times gain_p to gain_dd as they stand when this is written",
        low=0,
        high=1,
        body="position",
    ),
    XcpValue(
        "gain_p",
        "q30",
        "share of the proportional gain built in, q30",
        low=536870912,
        high=2147483647,
        body="position",
    ),
    XcpValue(
        "gain_i", "q30", "share of the integral gain, q30", low=0, high=2147483647, body="position"
    ),
    XcpValue(
        "gain_d",
        "q30",
        "share of the gain of the first derivative, q30",
        low=536870912,
        high=2147483647,
        body="position",
    ),
    XcpValue(
        "gain_dd",
        "q30",
        "share of the gain of the second derivative, q30",
        low=0,
        high=2147483647,
        body="position",
    ),
    XcpValue(
        "current_tolerance",
        "q31",
        "largest deviation of the measured from the driven current, q31",
        of="current",
        low=1,
        high=536870911,
    ),
    XcpValue(
        "current_lag_ticks",
        "integer",
        "longest time constant of amplifier and current sensor, ticks",
        low=3,
        high=1000000,
    ),
    XcpValue(
        "current_sweep_ticks",
        "integer",
        "ticks in which the amplifier can change the current by the full scale",
        low=1,
        high=1000000,
    ),
    XcpValue(
        "current_off_ticks",
        "integer",
        "samples in a row beyond current_tolerance until it is a fault",
        low=1,
        high=1000000,
    ),
)

INPUTS = (
    XcpValue(
        "set_demand",
        "q31",
        "the demanded force, in force from the next tick",
        of="demand",
        body="force",
    ),
    XcpValue("set_target", "q31", "the position to go to and hold", of="position", body="position"),
    XcpValue(
        "command", "integer", "one of command, done when it is written; reads as 0", low=0, high=9
    ),
)
