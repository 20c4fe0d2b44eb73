"""The settings of a controller of force, as parameters of a bench."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from anhyst.link.frames import Setting
from anhyst.link.plant_bus import Q30, Q31
from anhyst.rig.bench.protocol import Parameter
from anhyst.support.errors import InputError

_AT_REST = ("ratio", "follow")
"""Those that a firmware keeps as they are while it runs."""


class SettingsLine(Protocol):
    """What reads and writes them."""

    def read_setting(self, setting: Setting) -> int:
        """Ask for a setting."""
        ...  # pragma: no cover

    def write_setting(self, setting: Setting, value: int) -> int:
        """Set a setting from the next tick on."""
        ...  # pragma: no cover


class ForceSettings:
    """Settings in SI units.

    Parameters
    ----------
    line : SettingsLine
        To the controller.
    demand, current : float
        Full scales, N and A.
    rate : float
        Ticks a second.
    """

    def __init__(self, line: SettingsLine, demand: float, current: float, rate: float) -> None:
        self._line = line
        most, ratio = demand * rate, current / demand
        self._codes = {"demand_slew": most / Q31, "ratio": ratio / Q30}
        self._ranges = (
            ("demand_slew", "N/s", most / Q31, most, "largest slope of the demand"),
            ("compensation", "", 0.0, 1.0, "1: the compensator; 0: the constant ratio"),
            ("ratio", "A/N", 0.0, 2.0 * ratio, "constant ratio of current to force"),
            ("follow", "", 0.0, 1.0, "0: the memory follows the current driven; 1: measured"),
        )
        self._values = self._read()

    def parameters(self) -> tuple[Parameter, ...]:
        """Return them, with the values in force."""
        return tuple(
            Parameter(name, unit, low, high, doc, self._values[name])
            for name, unit, low, high, doc in self._ranges
        )

    def write(self, values: Mapping[str, float], runs: bool) -> None:
        """Write some of them, one after the other; others are left alone.

        Parameters
        ----------
        values : mapping of str to float
            By name, within their ranges.
        runs : bool
            Whether the controller runs.

        Raises
        ------
        InputError
            One may not be changed while it runs; then none is written.
        """
        mine = {name: values[name] for name in self._values if name in values}
        kept = [name for name in _AT_REST if name in mine and mine[name] != self._values[name]]
        if kept and runs:
            raise InputError(f"{kept[0]}: stays as it is while the controller runs; stop it first")
        for name, value in mine.items():
            code = min(round(value / self._codes.get(name, 1.0)), int(Q31) - 1)
            self._line.write_setting(Setting[name.upper()], code)
        self._values = self._read()

    def _read(self) -> dict[str, float]:
        return {
            name: self._line.read_setting(Setting[name.upper()]) * self._codes.get(name, 1.0)
            for name, *_ in self._ranges
        }
