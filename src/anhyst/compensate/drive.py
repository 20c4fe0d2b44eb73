"""The drive of a magnet: the core's own, with the scales that give its numbers a meaning."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from anhyst import _core
from anhyst.compensate.block import Block, Scales, as_word
from anhyst.compensate.floating import RealBlock
from anhyst.compensate.flux import FluxGains
from anhyst.control.controller_file import Format, Variant
from anhyst.control.pidd2 import as_factor, as_smoothing
from anhyst.support.arrays import FloatArray

Native = _core.ForceController | _core.ForceControllerF32 | _core.FixedForceController

_Q31 = 2.0**31
_NO_FLUX = -(2**31)


@dataclass(frozen=True)
class MapLaw:
    """Current over force and gap without memory.

    Parameters
    ----------
    entries : ndarray, shape (g, f)
        A, on equal steps over the range of gaps and from zero to the full-scale force; rises along
        the force. For fixed point both numbers are 2^n + 1.
    scales : Scales
        Full scales; no entry is beyond that of the current.
    limits : tuple of float
        Of the current, A.
    """

    entries: FloatArray
    scales: Scales
    limits: tuple[float, float]

    def real(self) -> tuple[float, ...]:
        """Scales and limits as the floating-point drives take them."""
        scales = self.scales
        return scales.demand, scales.gap_low, scales.gap_high, *self.limits

    def words(self) -> NDArray[np.int16]:
        """Entries as the fixed-point drive takes them."""
        return _words(self.entries, self.scales.current, "current")

    def codes(self) -> tuple[int, int]:
        """Limits as the fixed-point drive takes them."""
        low, high = (code(end, self.scales.current) for end in self.limits)
        return low, high


@dataclass(frozen=True)
class FluxLaw:
    """A map, corrected by the measured flux density.

    Parameters
    ----------
    map : MapLaw
        Current over force and gap.
    wanted : ndarray, shape (g, f)
        Flux density on the same steps, T.
    gains : FluxGains
        Of the flux loop.
    full_scale : float
        Flux density that counts as 1.0 in fixed point, T.
    """

    map: MapLaw
    wanted: FloatArray
    gains: FluxGains
    full_scale: float

    def words(self) -> NDArray[np.int16]:
        """Flux densities as the fixed-point drive takes them."""
        return _words(self.wanted, self.full_scale, "flux density")

    def factors(self) -> NDArray[np.int16]:
        """Gains as the fixed-point drive takes them."""
        across = self.full_scale / self.map.scales.current
        rows = [
            as_factor("proportional of the flux loop", self.gains.proportional * across),
            as_factor("integral of the flux loop", self.gains.integral * across),
            as_factor("anti-windup of the flux loop", self.gains.back),
            as_smoothing("delay of the flux loop", self.gains.smoothing),
        ]
        return np.array(rows, dtype=np.int16)


@dataclass(frozen=True)
class CompensatorLaw:
    """The inverse of hysteresis, compiled.

    Parameters
    ----------
    block : Block or RealBlock
        For fixed point or for floating point.
    """

    block: Block | RealBlock


Law = MapLaw | FluxLaw | CompensatorLaw


@dataclass(frozen=True)
class Drive:
    """A drive, and what its numbers mean.

    Parameters
    ----------
    variant : str
        How it finds the current.
    format : str
        Number format.
    scales : Scales
        Full-scale force and current, and the range of the gap.
    law : MapLaw, FluxLaw or CompensatorLaw
        What it was fitted to.
    numbers : mapping of str to float
        What tells it from others, by names with units, for reports.

    Notes
    -----
    `native` remembers what was applied to it: two magnets need two drives, and every run a
    `fresh` one.
    """

    variant: Variant
    format: Format
    scales: Scales
    law: Law
    numbers: Mapping[str, float]

    @cached_property
    def native(self) -> Native:
        """The core's drive, at first demagnetised and with an empty integral."""
        if self.format == "fixed":
            return _fixed(self.law)
        return _real(self.law, single=self.format == "f32")

    def fresh(self) -> Drive:
        """Return the same drive with nothing remembered."""
        return replace(self)

    def __getstate__(self) -> dict[str, Any]:
        """Leave the core's object behind: another process makes its own, with nothing in it."""
        return {name: value for name, value in self.__dict__.items() if name != "native"}

    @property
    def flux_full_scale(self) -> float:
        """Flux density that counts as 1.0 in fixed point, T; 1 where none is looked at."""
        return self.law.full_scale if isinstance(self.law, FluxLaw) else 1.0

    def solve(self, demand: float, gap: float, flux: float = math.nan) -> float:
        """Return the current for a force; nothing is remembered.

        Parameters
        ----------
        demand : float
            N.
        gap : float
            m.
        flux : float, optional
            Measured flux density, T; NaN without.

        Returns
        -------
        float
            A.
        """
        native, scales = self.native, self.scales
        if not isinstance(native, _core.FixedForceController):
            return native.solve(demand, gap, flux)
        density = _NO_FLUX if math.isnan(flux) else code(flux, self.flux_full_scale)
        found = native.solve(code(demand, scales.demand), self.gap_code(gap), density)
        return found / _Q31 * scales.current

    def commit(self, applied: float, gap: float) -> float:
        """Go on with the current that was applied.

        Parameters
        ----------
        applied : float
            A.
        gap : float
            m.

        Returns
        -------
        float
            Force to expect, N.
        """
        native, scales = self.native, self.scales
        if not isinstance(native, _core.FixedForceController):
            return native.commit(applied, gap)
        expected = native.commit(code(applied, scales.current), self.gap_code(gap))
        return expected / _Q31 * scales.demand

    def gap_code(self, gap: float) -> int:
        """Return a gap, m, as the fixed-point drive takes it."""
        return code(gap - self.scales.gap_low, self.scales.gap_high - self.scales.gap_low)


def code(value: float, one: float) -> int:
    """Return a signal in which `one` counts as 1.0 as a q31; what is beyond saturates."""
    return int(max(-_Q31, min(_Q31 - 1.0, round(value / one * _Q31))))


def _words(values: FloatArray, one: float, name: str) -> NDArray[np.int16]:
    words = [[as_word(value / one, 2.0**15, name) for value in row] for row in values.tolist()]
    return np.array(words, dtype=np.int16)


def _real(law: Law, *, single: bool) -> _core.ForceController | _core.ForceControllerF32:
    drive = _core.ForceControllerF32 if single else _core.ForceController
    if isinstance(law, MapLaw):
        return drive.map(law.entries, *law.real())
    if isinstance(law, FluxLaw):
        return drive.flux(law.map.entries, law.wanted, law.gains.row, *law.map.real())
    block = law.block
    assert isinstance(block, RealBlock)
    given = block.kind, block.numbers, block.gaps, block.tables
    if single:
        return _core.ForceControllerF32.compensator(_core.ParametersF32(*given))
    return _core.ForceController.compensator(_core.Parameters(*given))


def _fixed(law: Law) -> _core.FixedForceController:
    if isinstance(law, MapLaw):
        return _core.FixedForceController.map(law.words(), *law.codes())
    if isinstance(law, FluxLaw):
        given = law.map.words(), law.words(), law.factors()
        return _core.FixedForceController.flux(*given, *law.map.codes())
    block = law.block
    assert isinstance(block, Block)
    return _core.FixedForceController.compensator(block.kind, block.words)
