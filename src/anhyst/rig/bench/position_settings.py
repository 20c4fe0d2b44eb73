"""What a controller of position lets its operator change: compensation and gains."""

from __future__ import annotations

from collections.abc import Mapping

from anhyst.control.pidd2 import Pidd2
from anhyst.link.client import ControllerLink, Refused
from anhyst.link.frames import SETTINGS, Setting
from anhyst.link.plant_bus import Q30
from anhyst.rig.bench.protocol import Parameter
from anhyst.support.errors import InputError

_GAINS = {
    "gain_p": ("N/m", "K_p of the controller of position"),
    "gain_i": ("N/(m s)", "its K_i"),
    "gain_d": ("N s/m", "its K_d"),
    "gain_dd": ("N s^2/m", "its K_dd"),
}
"""Of which a firmware takes shares of what was compiled; one of zero stays zero."""

_Codes = dict[Setting, int]


class PositionSettings:
    """Compensation and gains of a firmware that levitates.

    Parameters
    ----------
    link : ControllerLink
        To the firmware, just switched on.
    pidd2 : Pidd2
        Gains that it was compiled with.
    """

    def __init__(self, link: ControllerLink, pidd2: Pidd2) -> None:
        self._link = link
        given = dict(zip(_GAINS, (pidd2.K_p, pidd2.K_i, pidd2.K_d, pidd2.K_dd), strict=True))
        self._compiled = {name: gain for name, gain in given.items() if gain != 0.0}
        names = ("compensation", *self._compiled)
        self._codes: _Codes = {one: link.read_setting(one) for one in map(_setting, names)}

    def parameters(self) -> tuple[Parameter, ...]:
        """Return all that may be changed, with the values in force."""
        found = [
            Parameter(
                "compensation",
                "",
                0.0,
                1.0,
                "1: the compensator; 0: the constant ratio",
                float(self._codes[Setting.COMPENSATION]),
            )
        ]
        for name, gain in self._compiled.items():
            known, (unit, doc) = SETTINGS[_setting(name)], _GAINS[name]
            ends = sorted(gain * code / Q30 for code in (known.low, known.high))
            value = gain * self._codes[_setting(name)] / Q30
            found.append(Parameter(name, unit, ends[0], ends[1], doc, value))
        return tuple(found)

    def apply(self, values: Mapping[str, float]) -> None:
        """Put values that were checked in force from the next tick on, all of them or none.

        Raises
        ------
        InputError
            A compensation that is neither 0 nor 1, or the firmware refuses, and says why.
        """
        wanted = {_setting(name): self._code(name, value) for name, value in values.items()}
        changed = {one: code for one, code in wanted.items() if code != self._codes[one]}
        try:
            self._write(changed)
        except Refused:
            self._write({one: self._codes[one] for one in changed})
            raise
        self._codes |= changed

    def _write(self, codes: _Codes) -> None:
        for one, code in codes.items():
            self._link.write_setting(one, code)
        if any(one is not Setting.COMPENSATION for one in codes):
            self._link.write_setting(Setting.GAINS, 1)  # the shares that stand there now

    def _code(self, name: str, value: float) -> int:
        if name == "compensation":
            if value not in (0.0, 1.0):
                raise InputError(f"compensation: is {value:g}; choose 0 or 1")
            return int(value)
        known = SETTINGS[_setting(name)]
        code = round(value / self._compiled[name] * Q30)
        return min(max(code, known.low), known.high)


def _setting(name: str) -> Setting:
    return Setting[name.upper()]
