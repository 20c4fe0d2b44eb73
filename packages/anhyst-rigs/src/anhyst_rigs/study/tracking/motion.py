"""Define the recorded motion of a body, and how a hysteresis model predicts its force.

:class:`Motion` computes the force on the body from its acceleration. :class:`MotionLaw` predicts
the same force from the commanded currents and the measured gaps, with the code of the core. Both
signals pass the same filter, so that they can be compared. The module `bodies` defines the classes
for stages and bearings.
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
"""Corner frequency of the filter's three equal poles, Hz; at most a twentieth of the tick rate."""
COMPARISON_RATE_HZ = 1000.0
"""Rate of the comparisons of measured and predicted force, Hz."""
MIN_DEMAND_TO_MAX_FORCE = 0.06
"""Smallest demand of compared samples, as a fraction of the largest force. At rest, a
load could not be distinguished from an error of the magnets."""
MIN_AMPLIFIER_TO_FILTER_BANDWIDTH = 16.0
"""Smallest bandwidth of an amplifier, relative to the corner frequency of the filter. The lag of
the amplifier is not modelled."""
WIDTH_GRID_STEP = 0.005
"""Step of the grid of relative loop widths; a hysteresis model is fitted for each grid value."""


def refuse_slow_amplifier(rig: BodyRig) -> None:
    """Raise an error if the amplifier lag of a rig would be mistaken for a lag of the iron."""
    file, min_bandwidth_Hz = rig.settings, MIN_AMPLIFIER_TO_FILTER_BANDWIDTH * FILTER_CORNER_HZ
    if file.amplifier.bandwidth_Hz < min_bandwidth_Hz:
        raise InputError(
            f"{rig.path}: amplifier.bandwidth_Hz: is below {min_bandwidth_Hz:g} Hz, so that its lag "
            "would be mistaken for that of the iron; calibrate with a faster amplifier",
            code="amplifier-too-slow",
            key="amplifier.bandwidth_Hz",
        )


class ColumnFault(NamedTuple):
    """A fault of a recording, and the column that shows it."""

    text: str
    column: str


@dataclass(frozen=True)
class Motion(ABC):
    """The recorded motion of a body, and the force on the body that follows from it."""

    rig: BodyRig
    columns: Mapping[str, FloatArray]  # recorded values by column name, SI units
    # first tick that is compared; earlier ticks only determine the hysteresis state
    first_compared_tick: int = 0

    @property
    def comparisons_per_tick(self) -> int:
        """Number of force components that are compared at one tick."""
        return 1

    @property
    def tick_numbers(self) -> FloatArray:
        """Number of each tick, from 0."""
        return np.arange(self.columns["gap_read_m"].size, dtype=np.float64)

    def filter_force(self, force: FloatArray, delay_ticks: float = 0.0) -> FloatArray:
        """Delay a force by some ticks, then apply the filter."""
        gain = -math.expm1(-2.0 * math.pi * min(FILTER_CORNER_HZ * self.rig.dt, 0.05))
        filtered_force = np.interp(self.tick_numbers - delay_ticks, self.tick_numbers, force)
        for _ in range(3):
            filtered_force = lfilter([gain], [1.0, gain - 1.0], filtered_force)
        return np.asarray(filtered_force)

    @property
    @abstractmethod
    def measured_force(self) -> FloatArray:
        """Net force of the magnets that follows from the motion, filtered, N."""

    @property
    @abstractmethod
    def force_per_unit(self) -> Mapping[ParameterName, FloatArray]:
        """Force that a unit of each body parameter causes, filtered, N."""

    @property
    @abstractmethod
    def force_noise(self) -> float:
        """Standard deviation of the measured force that sensor noise causes, N."""

    @property
    @abstractmethod
    def compared_indices(self) -> NDArray[np.intp]:
        """Indices of the compared samples."""

    @property
    def force_rms(self) -> float:
        """Rms force to which residuals are related, N."""
        return rms(self.measured_force[self.compared_indices])

    @property
    def noise_gain(self) -> float:
        """Noise of the filtered acceleration divided by the noise of the position, 1/s^2."""
        second_difference = np.zeros(self.tick_numbers.size)
        second_difference[:3] = 1.0, -2.0, 1.0
        return float(np.linalg.norm(self.filter_force(second_difference))) / self.rig.dt**2

    @property
    def delay_ticks(self) -> float:
        """Delay from a command to its force, ticks: dead time plus half a tick.

        The amplifier adds no lag, because its control has an integral part and the filter is slow.
        """
        amplifier_delay = self.rig.settings.amplifier.delay_s / self.rig.dt
        return self.rig.settings.timing.delay_ticks + 0.5 + amplifier_delay


class MotionLaw(ABC):
    """The hysteresis model of one method, with parameters that can be estimated from a motion."""

    rig: BodyRig
    method: MethodName
    names: Sequence[ParameterName]  # all parameters, in the order of the calibration file
    estimable_names: Sequence[ParameterName]  # parameters that may be estimated from a motion
    # standard deviation of a comparison, as a fraction of the largest force
    comparison_sigma_ratio: float
    max_sigma_ratio: float  # largest ratio of posterior to prior sigma for an identified parameter
    # largest rms residual of a suitable model, as a fraction of the rms force
    max_residual_ratio: float
    force_max: float  # largest demanded force, N
    required_columns: Sequence[str]  # columns that a recording must have
    optional_columns: Sequence[str]  # columns that are used if a recording contains them

    @property
    def is_right_in_kind(self) -> bool:
        """Whether the law is more than a curve or one play operator, whose errors resemble a mass."""
        return self.method not in ("single-valued", "play")

    def uncalibratable_methods(self, motions: Sequence[Motion]) -> Sequence[MethodName]:
        """Return the methods that the recordings cannot calibrate; by default, those with a probe."""
        del motions
        return FLUX_PROBE_METHODS

    def law_options(self, motions: Sequence[Motion]) -> Mapping[str, Any]:
        """Return the keyword arguments for the constructor that depend on the recordings."""
        del motions
        return {}

    @abstractmethod
    def find_motion_at_start(self, columns: Mapping[str, FloatArray]) -> ColumnFault | None:
        """Return a fault if a recording begins in motion, because its hysteresis state is unknown."""

    def find_wrong_sign(self, motion: Motion) -> ColumnFault | None:
        """Return a fault if the demand and the motion have opposite signs, or None."""
        del motion
        return None

    def find_exchanged_magnets(self, motion: Motion) -> tuple[int, int] | None:
        """Return two magnets whose recorded columns are exchanged, or None."""
        del motion
        return None

    def prior_sigma(self, name: ParameterName) -> float:
        """Return the prior standard deviation of a parameter, from the rig file."""
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
    def make_motion(self, columns: Mapping[str, FloatArray], first_compared_tick: int = 0) -> Motion:
        """Return the motion that recorded columns describe."""

    def is_excited(self, motion: Motion, name: ParameterName) -> bool:
        """Whether a motion gives information about a parameter."""
        del motion, name
        return True

    @abstractmethod
    def net_force(self, motion: Motion, values: Mapping[ParameterName, float]) -> FloatArray:
        """Return the net force that the model predicts for given parameters, filtered, N."""

    def residual(self, motion: Motion, values: Mapping[ParameterName, float]) -> FloatArray:
        """Return the compared forces of a motion that given parameter values do not explain, N."""
        return (motion.measured_force - self.net_force(motion, values))[motion.compared_indices]


def round_to_grid(name: ParameterName, value: float) -> float:
    """Round a loop width to the grid of the fitted models; return any other parameter unchanged."""
    return round(value / WIDTH_GRID_STEP) * WIDTH_GRID_STEP if parameter_kind(name) == "width" else value
