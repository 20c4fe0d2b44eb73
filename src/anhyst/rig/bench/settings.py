"""The settings of a controller, as parameters of a bench."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple, Protocol

from anhyst.compile.a2l import HEARTBEAT_MS
from anhyst.link.frames import SETTINGS, Setting
from anhyst.link.plant_bus import Q30, Q31
from anhyst.rig.bench.protocol import Parameter
from anhyst.support.errors import InputError


class SettingsLine(Protocol):
    """What reads and writes them."""

    def read_setting(self, setting: Setting) -> int:
        """Ask for a setting."""
        ...  # pragma: no cover

    def write_setting(self, setting: Setting, value: int) -> int:
        """Set a setting from the next tick on."""
        ...  # pragma: no cover


class KnownSetting(NamedTuple):
    """A setting in SI units.

    Attributes
    ----------
    name, unit, low, high, doc
        As of :class:`anhyst.rig.bench.protocol.Parameter`.
    setting : Setting
        Which.
    code : float
        What one of its codes means.
    """

    name: str
    setting: Setting
    unit: str
    low: float
    high: float
    code: float
    doc: str


class ControllerSettings:
    """Settings that are read and written over a line.

    Parameters
    ----------
    line : SettingsLine
        To the controller.
    known : sequence of KnownSetting
        Those that there are.
    """

    def __init__(self, line: SettingsLine, known: Sequence[KnownSetting]) -> None:
        self._line = line
        self._known = tuple(known)
        self._values = self._read()

    def parameters(self) -> tuple[Parameter, ...]:
        """Return them, with the values in force."""
        return tuple(
            Parameter(one.name, one.unit, one.low, one.high, one.doc, self._values[one.name])
            for one in self._known
        )

    def write(self, values: Mapping[str, float], runs: bool) -> None:
        """Write some of them, one after the other; what is no setting is left alone.

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
        mine = [one for one in self._known if one.name in values]
        for one in mine:
            kept = runs and not SETTINGS[one.setting].while_running
            if kept and values[one.name] != self._values[one.name]:
                raise InputError(
                    f"{one.name}: stays as it is while the controller runs; stop it first"
                )
        for one in mine:
            code = min(round(values[one.name] / one.code), int(Q31) - 1)
            self._line.write_setting(one.setting, code)
        self._values = self._read()

    def _read(self) -> dict[str, float]:
        return {one.name: self._line.read_setting(one.setting) * one.code for one in self._known}


def force_settings(demand: float, current: float, rate: float) -> tuple[KnownSetting, ...]:
    """Return the settings of a controller of force.

    Parameters
    ----------
    demand, current : float
        Full scales, N and A.
    rate : float
        Ticks a second.
    """
    most, ratio = demand * rate, current / demand
    slew, follow = (
        "largest slope of the demand",
        "0: the memory follows the current driven; 1: measured",
    )
    switch = "1: the compensator; 0: the constant ratio"
    of_ratio = "constant ratio of current to force"
    return (
        KnownSetting("demand_slew", Setting.DEMAND_SLEW, "N/s", most / Q31, most, most / Q31, slew),
        KnownSetting("compensation", Setting.COMPENSATION, "", 0.0, 1.0, 1.0, switch),
        KnownSetting("ratio", Setting.RATIO, "A/N", 0.0, 2.0 * ratio, ratio / Q30, of_ratio),
        KnownSetting("follow", Setting.FOLLOW, "", 0.0, 1.0, 1.0, follow),
    )


def heartbeat_setting(rate: float) -> KnownSetting:
    """Return how long a controller waits for its operator, at so many ticks a second."""
    low, high = SETTINGS[Setting.HEARTBEAT_TICKS].low / rate, 1e-3 * HEARTBEAT_MS
    doc = "without a sign of life for so long the controller goes to rest"
    return KnownSetting("heartbeat", Setting.HEARTBEAT_TICKS, "s", low, high, 1.0 / rate, doc)
