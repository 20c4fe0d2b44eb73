"""What is searched: a box of numbers; of a bearing, seven, and the controller that a place stands for.

With the mass m that moves, the poles of the design rule lie at the distance w from the origin; here
the real one may lie elsewhere, at a w, so that every set of gains can be reached::

    (m + K_dd) s^3 + K_d s^2 + K_p s + K_i = (m + K_dd) (s + a w) (s^2 + 2 z w s + w^2)
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from anhyst.control.controller_file import ControllerTable, FilterTable, GainsTable
from anhyst.control.pidd2 import Pidd2
from anhyst.support.arrays import FloatArray

_DIGITS = 5
"""Of every gain that is kept: what a file says is what was tried."""


class Axis(NamedTuple):
    """One of the numbers: its ends, and whether equal steps are equal ratios."""

    low: float
    high: float
    ratio: bool


class Box:
    """The box that is searched."""

    @property
    def axes(self) -> dict[str, Axis]:
        """Every number by name."""
        raise NotImplementedError

    @property
    def size(self) -> int:
        """How many numbers there are."""
        return len(self.axes)

    def numbers(self, place: FloatArray) -> dict[str, float]:
        """Return the numbers at a place of the unit box."""
        found = {}
        for (name, axis), part in zip(self.axes.items(), place.tolist(), strict=True):
            if axis.ratio:
                found[name] = axis.low * (axis.high / axis.low) ** part
            else:
                found[name] = axis.low + (axis.high - axis.low) * part
        return found


@dataclass(frozen=True)
class GainSpace(Box):
    """What is searched of a bearing."""

    rate: float  # of the controller, Hz; frequencies are searched in parts of it
    mass: float  # what moves, kg

    @property
    def axes(self) -> dict[str, Axis]:
        """Every number by name."""
        rate = self.rate
        return {
            "bandwidth_Hz": Axis(rate / 1000.0, rate / 20.0, True),
            "damping": Axis(0.3, 3.0, True),
            "real_pole": Axis(0.03, 3.0, True),  # in parts of the bandwidth
            "virtual_mass": Axis(-0.5, 1.0, False),  # in parts of the mass
            "set_point_weight": Axis(0.0, 1.0, False),
            "cutoff_Hz": Axis(rate / 100.0, 0.45 * rate, True),
            "cutoff_2_Hz": Axis(rate / 100.0, 0.45 * rate, True),
        }

    def controller(self, place: FloatArray, like: ControllerTable) -> ControllerTable:
        """Return the controller at a place of the unit box; what is not searched stays as it is."""
        at = self.numbers(place)
        w, z, a = 2.0 * math.pi * at["bandwidth_Hz"], at["damping"], at["real_pole"]
        total = self.mass * (1.0 + at["virtual_mass"])
        gains = GainsTable(
            K_p_N_per_m=rounded(total * (1.0 + 2.0 * z * a) * w**2),
            K_i_N_per_m_s=rounded(total * a * w**3),
            K_d_N_s_per_m=rounded(total * (2.0 * z + a) * w),
            K_dd_N_s2_per_m=rounded(self.mass * at["virtual_mass"]),
        )
        filters = FilterTable(
            cutoff_Hz=rounded(at["cutoff_Hz"]), cutoff_2_Hz=rounded(at["cutoff_2_Hz"])
        )
        return like.model_copy(
            update={
                "design": None,
                "gains": gains,
                "filter": filters,
                "set_point_weight": round(at["set_point_weight"], _DIGITS),
            }
        )

    def per_tick(self, places: FloatArray, like: ControllerTable) -> FloatArray:
        """Return the gains per tick of many places, as :attr:`Pidd2.per_tick`, shape (n, 11)."""
        found: list[Pidd2] = [self.controller(place, like).pidd2() for place in places]
        return np.array([one.per_tick for one in found])


def rounded(value: float) -> float:
    """Return a gain as files hold it."""
    return float(f"{value:.{_DIGITS}g}")
