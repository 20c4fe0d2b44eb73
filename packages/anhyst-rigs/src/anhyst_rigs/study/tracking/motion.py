"""What was read while a body moved, and what the law of a method says of it: what all bodies share.

The law follows the currents that were commanded, at the gaps that were read, in the core's own
code; what the body did is its acceleration. Both sides pass the same filter.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from anhyst.support.errors import InputError
from anhyst.support.kinds import FLUX_PROBE_METHODS, MethodName
from anhyst.support.numeric import FloatArray, rms
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.calibration import CENTRE_PARAMETERS, ParameterName, parameter_kind

FILTER_CORNER_HZ = 250.0
"""Corner of the three poles that both sides pass; a twentieth of the ticks at most."""
COMPARISON_RATE_HZ = 1000.0
"""How often the two sides are compared."""
MIN_DEMAND_RATIO = 0.06
"""Nothing is learnt below this part of the largest force: at rest any load would be taken for one."""
MIN_AMPLIFIER_BANDWIDTH_RATIO = 16.0
"""Bandwidth that an amplifier must have, in corners of the filter: what it lags is not counted."""
WIDTH_GRID_STEP = 0.005
"""A law is fitted anew for widths on this grid."""


def refuse_slow_amplifier(rig: BodyRig) -> None:
    """Refuse a stage whose motion would teach something else than what its magnets are off by."""
    file, min_bandwidth_Hz = rig.settings, MIN_AMPLIFIER_BANDWIDTH_RATIO * FILTER_CORNER_HZ
    if file.amplifier.bandwidth_Hz < min_bandwidth_Hz:
        raise InputError(
            f"{rig.path}: amplifier.bandwidth_Hz: is below {min_bandwidth_Hz:g} Hz, and its lag would be "
            "taken for the iron's; calibrate with a faster amplifier",
            code="amplifier-too-slow",
            key="amplifier.bandwidth_Hz",
        )


class ColumnFault(NamedTuple):
    """What is wrong with a recording, and the column that shows it."""

    text: str
    column: str


@dataclass(frozen=True)
class Motion(ABC):
    """What was read while a body moved, and what it did."""

    rig: BodyRig
    columns: Mapping[str, FloatArray]  # by column
    first_compared_tick: int = (
        0  # tick from which on it teaches; before, it only tells what the iron remembers
    )

    @property
    def comparisons_per_tick(self) -> int:
        """How many numbers are compared at one tick."""
        return 1

    @property
    def tick_numbers(self) -> FloatArray:
        """Number of each tick."""
        return np.arange(self.columns["gap_read_m"].size, dtype=np.float64)

    def filter_force(self, force: FloatArray, delay_ticks: float = 0.0) -> FloatArray:
        """Return a force that acts so many ticks late, through the filter of both sides."""
        gain = -math.expm1(-2.0 * math.pi * min(FILTER_CORNER_HZ * self.rig.dt, 0.05))
        passed = np.interp(self.tick_numbers - delay_ticks, self.tick_numbers, force)
        for _ in range(3):
            passed = lfilter([gain], [1.0, gain - 1.0], passed)
        return np.asarray(passed)

    @property
    @abstractmethod
    def measured_force(self) -> FloatArray:
        """What the magnets must have pushed with, by the motion, filtered, N."""

    @property
    @abstractmethod
    def force_per_unit(self) -> Mapping[ParameterName, FloatArray]:
        """What the numbers of the body push with, for each unit of them, filtered, N."""

    @property
    @abstractmethod
    def force_noise(self) -> float:
        """Standard deviation of the force of the motion from the noise of its sensors, N."""

    @property
    @abstractmethod
    def compared_indices(self) -> NDArray[np.intp]:
        """Places at which both sides are compared."""

    @property
    def force_rms(self) -> float:
        """Force of which a law leaves a part, root mean square, N."""
        return rms(self.measured_force[self.compared_indices])

    @property
    def noise_gain(self) -> float:
        """Noise of an acceleration after the filter, in that of its position, 1/s2."""
        second_difference = np.zeros(self.tick_numbers.size)
        second_difference[:3] = 1.0, -2.0, 1.0
        return float(np.linalg.norm(self.filter_force(second_difference))) / self.rig.dt**2

    @property
    def delay_ticks(self) -> float:
        """Ticks from a command to its force: dead time and half a tick.

        The integral of an amplifier leaves no lag of what is slower than the filter here.
        """
        amplifier_delay = self.rig.settings.amplifier.delay_s / self.rig.dt
        return self.rig.settings.timing.delay_ticks + 0.5 + amplifier_delay


class MotionLaw(ABC):
    """A method as it is fitted to the loops, and with other numbers."""

    rig: BodyRig
    method: MethodName
    names: Sequence[ParameterName]  # all numbers of it, in the order of files
    estimable_names: Sequence[ParameterName]  # those that a motion may move
    comparison_sigma_ratio: (
        float  # standard deviation of a comparison, in parts of the largest force
    )
    max_sigma_ratio: (
        float  # of its prior standard deviation: a number with more left is called not seen
    )
    max_residual_ratio: float  # of the moving force: what is left at most where a law fits
    force_max: float  # largest force that is asked for, N
    required_columns: Sequence[str]  # columns of a recording without which nothing is learnt
    optional_columns: Sequence[str]  # columns that help, where a recording has them

    def uncalibratable_methods(self, motions: Sequence[Motion]) -> Sequence[MethodName]:
        """Return the methods of which the recordings do not say enough: those of flux probes."""
        del motions
        return FLUX_PROBE_METHODS

    def law_options(self, motions: Sequence[Motion]) -> Mapping[str, Any]:
        """Return what a law is told of what the recordings hold."""
        del motions
        return {}

    @abstractmethod
    def find_motion_at_start(self, columns: Mapping[str, FloatArray]) -> ColumnFault | None:
        """Return what shows that a recording begins in motion: what iron remembers is not known."""

    def find_wrong_sign(self, motion: Motion) -> ColumnFault | None:
        """Return what shows that the demand counts the other way than the body goes."""
        del motion
        return None

    def prior_sigma(self, name: ParameterName) -> float:
        """Return the standard deviation that the rig file states for a number."""
        spread = self.rig.settings.spread
        uses_probe = self.method in FLUX_PROBE_METHODS
        return {
            "scale": 0.01 * (spread.hall_percent if uses_probe else spread.current_percent),
            "gap_zero_m": spread.gap_zero_m,
            "width": 0.01 * spread.pinning_percent,
            "lag_s": spread.eddy_s,
            "bias_N": 0.01 * self.force_max,
            "payload": 0.01 * spread.payload_percent,
            "cable_N_per_m": spread.cable_N_per_m,
            **dict.fromkeys(CENTRE_PARAMETERS, spread.centre_m),
        }[parameter_kind(name)]

    @abstractmethod
    def make_motion(
        self, columns: Mapping[str, FloatArray], first_compared_tick: int = 0
    ) -> Motion:
        """Take a motion as it was read."""

    def is_excited(self, motion: Motion, name: ParameterName) -> bool:
        """Whether a motion can show a number."""
        del motion, name
        return True

    @abstractmethod
    def net_force(self, motion: Motion, values: Mapping[ParameterName, float]) -> FloatArray:
        """Return the net force along a path by the law with some numbers, filtered, N."""


def round_to_grid(name: ParameterName, value: float) -> float:
    """Return the value of a parameter that a law can be fitted with."""
    return (
        round(value / WIDTH_GRID_STEP) * WIDTH_GRID_STEP
        if parameter_kind(name) == "width"
        else value
    )
