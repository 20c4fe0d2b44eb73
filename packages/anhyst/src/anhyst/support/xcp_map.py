"""What a master of XCP sees of a controller: areas of addresses, values, sizes.

Made by tools/contract from contract/xcp.toml and signals.toml: do not edit.
"""

from __future__ import annotations

import re
from typing import Any, NamedTuple


class XcpValue(NamedTuple):
    """A value of four bytes; `of` names the signal whose full scale 1.0 is."""

    name: str
    format: str
    doc: str
    of: str = ""
    low: int = -(1 << 31)
    high: int = (1 << 31) - 1
    body: str = ""


def _values(rows: str) -> tuple[XcpValue, ...]:
    """Return the values of a table with rows ``name format | key=value | doc``."""
    values = []
    for row in re.split(r"\n(?! )", rows.strip()):
        fixed, *others, doc = " ".join(row.split()).split(" | ")
        name, form = fixed.split()
        given: dict[str, Any] = dict(other.split("=") for other in others)
        given |= {key: int(given[key]) for key in ("low", "high") if key in given}
        values.append(XcpValue(name, form, doc, **given))
    return tuple(values)


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

SIGNALS = _values("""
demand q31 | of=demand | demand in force, q31 of the full-scale force
force q30 | of=demand | body=force | measured force, q30
gap q30 | of=gap | body=force | measured gap, q30
current q30 | of=current | measured current, q30
drive q31 | of=current | current driven, q31 of the full-scale current
flux q30 | flux of the model after the commit, q30
expected q31 | of=demand | force that the model expects after the commit, q31
state integer | state, as a number
flags integer | flags, as in status
position q31 | of=position | body=position | measured position, q31 of the controller's full scale
reference q31 | of=position | body=position | position controlled to, likewise
phase integer | body=position | phase, as a number
current_2 q30 | of=current | body=position | measured current of the second magnet, q30
drive_2 q31 | of=current | body=position | current driven there, q31
fault integer | latched reason of a fault, as a number
""")

SETTINGS = _values("""
heartbeat_ticks integer | low=2 | high=1000000
   | ticks without a new request until the link counts as lost; the board has a ceiling of its own
demand_slew q31 | of=demand | low=1 | high=2147483647 | largest change of the demand in a tick, q31
compensation integer | low=0 | high=1 | 1: the compensator; 0: a constant force-current ratio
ratio q30 | low=-2147483648 | high=2147483647
   | the constant ratio, q30: current for each unit of demand
follow integer | low=0 | high=1
   | what the memory follows. 0: the current driven; 1: the current measured
gains integer | low=0 | high=1 | body=position
   | 0: the gains built in; 1: these times gain_p to gain_dd as they stand when this is written
gain_p q30 | low=536870912 | high=2147483647 | body=position
   | share of the proportional gain built in, q30
gain_i q30 | low=0 | high=2147483647 | body=position | share of the integral gain, q30
gain_d q30 | low=536870912 | high=2147483647 | body=position
   | share of the gain of the first derivative, q30
gain_dd q30 | low=0 | high=2147483647 | body=position
   | share of the gain of the second derivative, q30
current_tolerance q31 | of=current | low=1 | high=536870911
   | largest deviation of the measured from the driven current, q31
current_lag_ticks integer | low=3 | high=1000000
   | longest time constant of amplifier and current sensor, ticks
current_sweep_ticks integer | low=1 | high=1000000
   | ticks in which the amplifier can change the current by the full scale
current_off_ticks integer | low=1 | high=1000000
   | samples in a row beyond current_tolerance until it is a fault
""")

INPUTS = _values("""
set_demand q31 | of=demand | body=force | the demanded force, in force from the next tick
set_target q31 | of=position | body=position | the position to go to and hold
command integer | low=0 | high=9 | one of command, done when it is written; reads as 0
""")
