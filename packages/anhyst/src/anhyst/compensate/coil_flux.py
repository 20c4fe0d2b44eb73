"""Choose the settings of the estimator that replaces a flux probe by the voltage of a coil.

The estimator integrates the voltage of a sense coil, or of the winding itself. The flux of the law
holds the estimate at standstill. The equations are in ``core/include/anhyst/control/coil_flux.h``.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from anhyst.compensate.plan import round_full_scale
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray

LAW_TIME_S = 4.0
"""Time constant with which the estimate returns to the flux of the law at half of the full scale, and
with which offset and resistance are learned, s."""

MAX_DEVIATION_SHARE = 0.02
"""Largest deviation of the estimate from the flux of the law, relative to the full scale. A larger
one is due to the offset or the resistance, which are then learned quickly."""

MAP_DEVIATION_SHARE = 0.05
"""The same for a single-valued curve, which lacks the remanence of the iron."""

MAX_OFFSET_SHARE = 0.01
"""Largest estimated offset of the voltage, relative to the range of its sensor."""

LEARNING = 32.0
"""Speed at which the resistance is learned at the full-scale current, relative to the offset."""

LARGE_CURRENT_SHARE = 0.25
"""Smallest current that teaches the resistance, relative to the full scale. At small currents, the
remanence of the iron would be taken for a resistance."""

LARGEST_READING_SHARE = 0.999
"""Reading, relative to the range, from which the converter limits the voltage."""

MAX_RESISTANCE_CHANGE = 0.4
"""Largest change of the estimated resistance relative to the given one: copper that warms by 100 K."""


@dataclass(frozen=True)
class CoilSensor:
    """Sensor of the mean voltage of a coil during a tick."""

    range: float  # largest voltage, V
    resistance: float  # resistance of the winding in the controller, ohm; 0: sense coil
    # time from the committed current to the mean current of the last tick, s
    current_delay: float


@dataclass(frozen=True)
class CoilFlux:
    """Settings of the estimator of one magnet."""

    sensor: CoilSensor
    rate: float  # sample rate, Hz
    inductance: float  # flux linkage per current at the operating point, H
    # largest deviation from the flux of the law, relative to the full scale; only with a sense coil
    max_deviation: float = MAX_DEVIATION_SHARE

    @property
    def full_scale(self) -> float:
        """Voltage that 1.0 represents in fixed point, V."""
        return round_full_scale(self.sensor.range)

    def settings(self, flux: float, current: float) -> FloatArray:
        """Return ``anhyst_coil_flux_settings`` for the full scales of flux, Wb, and current, A."""
        sensor, tick = self.sensor, 1.0 / self.rate
        drop = sensor.resistance * tick
        spread, offset = MAX_RESISTANCE_CHANGE * drop, MAX_OFFSET_SHARE * sensor.range * tick
        lag = 1.0 / (1.0 + sensor.current_delay * self.rate)
        deviation = MAX_DEVIATION_SHARE if sensor.resistance else self.max_deviation
        bounds = LARGEST_READING_SHARE * sensor.range, deviation * flux, flux
        pull = min(tick / LAW_TIME_S, 1.0 / 512.0)
        learning = LEARNING / current**2, LARGE_CURRENT_SHARE * current
        return np.array([tick, drop, spread, offset, self.inductance, lag, *bounds, pull, *learning])

    def codes(self, flux: float, current: float) -> NDArray[np.int32]:
        """Return the same settings in fixed point."""
        voltage = self.full_scale
        # flux, voltage and current in full scales; the full scale and the learning are constants
        unit = np.array([voltage, current, current, 1.0, current, flux, flux / voltage, 1.0, flux]) / flux
        bits = [29, 29, 29, 40, 29, 31, 31, 31, 35]
        fractions = unit * np.delete(self.settings(flux, current), [8, 10, 11])
        if fractions[:2].max() > 0.5:
            text = "the voltage of one tick changes the flux by more than half of its full scale"
            raise InputError(f"coil: {text}; raise the rate", code="rate-too-low", key="rate")
        codes = np.round(np.ldexp(fractions, bits))
        return np.clip(codes, 0, 2**31 - 1).astype(np.int32)
