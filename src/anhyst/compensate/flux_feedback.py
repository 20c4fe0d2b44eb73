"""The method that measures: a map of the current, corrected by a Hall probe."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from anhyst import _core
from anhyst.compensate.block import Scales
from anhyst.compensate.current_map import CurrentMap, current_map, table_words
from anhyst.compensate.flux import FluxGains, design_flux_loop
from anhyst.compensate.force_controller import REAL, Native
from anhyst.compensate.interface import NumberFormat
from anhyst.compensate.plan import full_scale
from anhyst.compensate.sources import Sources
from anhyst.support.arrays import FloatArray
from anhyst.support.errors import InputError
from anhyst.support.fixed_point import as_factor, as_smoothing


@dataclass(frozen=True)
class FluxFeedback:
    """A map, corrected by the measured flux density."""

    map: CurrentMap  # current over force and gap
    wanted: FloatArray  # flux density on the same steps, T; shape (g, f)
    gains: FluxGains  # of the flux loop
    rate: float  # ticks a second, Hz

    @property
    def scales(self) -> Scales:
        """Those of the map."""
        return self.map.scales

    @cached_property
    def flux_full_scale(self) -> float:
        """Flux density that counts as 1.0 in fixed point, T."""
        return full_scale(float(self.wanted.max()))

    @property
    def numbers(self) -> dict[str, float]:
        """Crossover and gains of the flux loop."""
        return {
            "crossover_Hz": self.gains.crossover / (2.0 * math.pi),
            "k_p_A_per_T": self.gains.proportional,
            "k_i_A_per_T_s": self.gains.integral * self.rate,
        }

    def native(self, number_format: NumberFormat) -> Native:
        """Return the core's own."""
        table = self.map
        if number_format == "fixed":
            wanted = table_words(self.wanted, self.flux_full_scale, "flux density")
            return _core.FixedForceController.flux(
                table.words(), wanted, self._factors(), *table.codes()
            )
        given = table.entries, self.wanted, self.gains.row
        return REAL[number_format].flux(*given, *table.real())

    def _factors(self) -> NDArray[np.int16]:
        """Gains as fixed point takes them."""
        across = self.flux_full_scale / self.scales.current
        rows = [
            as_factor("proportional of the flux loop", self.gains.proportional * across),
            as_factor("integral of the flux loop", self.gains.integral * across),
            as_factor("anti-windup of the flux loop", self.gains.back),
            as_smoothing("delay of the flux loop", self.gains.smoothing),
        ]
        return np.array(rows, dtype=np.int16)


def flux_feedback(sources: Sources, _: NumberFormat) -> FluxFeedback:
    """Design the flux loop around the best current without memory."""
    surface, operating, calibration = sources.surface(), sources.operating, sources.flux_calibration
    if calibration is None:
        raise InputError(
            "flux: needs a Hall probe and its calibration", code="no-hall-probe", key="flux"
        )
    wanted = np.ascontiguousarray(calibration.density_over(surface.force, surface.gap))
    gains = design_flux_loop(calibration, surface, wanted, operating.force, operating.rate)
    return FluxFeedback(current_map(surface.current, operating, {}), wanted, gains, operating.rate)
