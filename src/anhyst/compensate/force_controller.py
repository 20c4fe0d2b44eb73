"""From force to current: what every compensator can do, and the core's arithmetic in SI units."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike

from anhyst import _core
from anhyst.support.block_words import Scales
from anhyst.support.kinds import MethodName, NumberFormat
from anhyst.support.numeric import FloatArray, q31


class Compensator(ABC):
    """From a wanted output to the current that gives it, sample by sample.

    A user calls :meth:`solve` as often as he likes, applies a current, and calls :meth:`commit`
    once with the current that was really applied, after limits and the amplifier. Demands and
    outputs are in units of the model's output, N for a force; currents in those of its input, A;
    the scheduling variable is SI, m for a gap. What is beyond the limits of a compensator is
    limited, never refused.
    """

    @abstractmethod
    def solve(self, demand: float, gap: float | None = None) -> float:
        """Return the current that gives `demand` now; the state is not touched."""

    @abstractmethod
    def commit(self, applied: float, gap: float | None = None) -> float:
        """Advance the state with the current that was applied."""

    @abstractmethod
    def fresh(self) -> Self:
        """Return another one with the same parameters, which remembers nothing.

        Two magnets need two compensators, and every run its own.
        """

    def run(self, demand: ArrayLike, gap: ArrayLike | None = None) -> FloatArray:
        """Solve and commit sample by sample."""
        demands = np.array(demand, dtype=np.float64, ndmin=1)
        places = np.broadcast_to(np.asarray(gap), demands.shape).tolist()
        currents = []
        for now, at in zip(demands.tolist(), places, strict=True):
            current = self.solve(now, at)
            self.commit(current, at)
            currents.append(current)
        return np.array(currents)


Native = _core.ForceController | _core.ForceControllerF32 | _core.FixedForceController

REAL: Mapping[NumberFormat, type[_core.ForceController] | type[_core.ForceControllerF32]] = {
    "f64": _core.ForceController,
    "f32": _core.ForceControllerF32,
}

_Q31 = 2.0**31
_NO_FLUX = -(2**31)


class MethodParameters(Protocol):
    """What a method found, of which a controller is made."""

    @property
    def scales(self) -> Scales:
        """Full-scale force and current, and the range of the gap."""

    @property
    def flux_full_scale(self) -> float:
        """Flux density that counts as 1.0 in fixed point, T; 1 where none is looked at."""

    @property
    def numbers(self) -> Mapping[str, float]:
        """Constants by their names with units, for reports."""

    def native(self, number_format: NumberFormat) -> Native:
        """Return the core's own, which remembers nothing yet."""


@dataclass(frozen=True)
class ForceController(Compensator):
    """A compensator of one magnet as a controller of its position runs it.

    `native` remembers what was applied to it.
    """

    method: MethodName  # how it finds the current
    format: NumberFormat  # number format
    parameters: MethodParameters  # what it was fitted to

    @cached_property
    def native(self) -> Native:
        """The core's own, at first demagnetised and with an empty integral."""
        return self.parameters.native(self.format)

    @property
    def scales(self) -> Scales:
        """Full-scale force and current, and the range of the gap."""
        return self.parameters.scales

    def fresh(self) -> ForceController:
        """Return the same with nothing remembered."""
        return replace(self)

    def __getstate__(self) -> dict[str, Any]:
        """Leave the core's object behind: another process makes its own, with nothing in it."""
        return {name: value for name, value in self.__dict__.items() if name != "native"}

    def solve(self, demand: float, gap: float | None = None, flux: float = math.nan) -> float:
        """Return the current for a force; the state is not touched."""
        native, scales = self.native, self.scales
        at = scales.gap_low if gap is None else gap
        if not isinstance(native, _core.FixedForceController):
            return native.solve(demand, at, flux)
        full = self.parameters.flux_full_scale
        density = _NO_FLUX if math.isnan(flux) else q31(flux / full)
        code = native.solve(q31(demand / scales.demand), self._gap_code(at), density)
        return code / _Q31 * scales.current

    def commit(self, applied: float, gap: float | None = None) -> float:
        """Advance the state with the current that was applied, A; return the force to expect, N."""
        native, scales = self.native, self.scales
        at = scales.gap_low if gap is None else gap
        if not isinstance(native, _core.FixedForceController):
            return native.commit(applied, at)
        expected = native.commit(q31(applied / scales.current), self._gap_code(at))
        return expected / _Q31 * scales.demand

    def follow(self, applied: FloatArray, gap: FloatArray) -> FloatArray:
        """Advance along a path of applied currents, A; return the forces to expect, N."""
        native, scales = self.native, self.scales
        if not isinstance(native, _core.FixedForceController):
            return native.follow(applied, gap)
        parts = (
            applied / scales.current,
            (gap - scales.gap_low) / (scales.gap_high - scales.gap_low),
        )
        codes = [np.clip(np.rint(part * _Q31), -_Q31, _Q31 - 1.0) for part in parts]
        return np.asarray(native.follow(*codes) / _Q31 * scales.demand)

    def _gap_code(self, gap: float) -> int:
        return q31((gap - self.scales.gap_low) / (self.scales.gap_high - self.scales.gap_low))
