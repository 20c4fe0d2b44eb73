"""Compute measured and predicted forces along the motion of a stage or a bearing.

For a stage, the wrench of all magnets is compared with the motion of the body. Moments are divided
by the radius of gyration about their axis, so that all compared components are in N. The model
neglects that the lines of force move with the body by micrometres. For a bearing, the net force of
the magnets is compared, positive if it closes the gap. The load is the recorded one or that of the
rig file; the parameter ``bias_N`` is the estimate of a constant error of this load.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from anhyst.compensate.force_controller import ForceController
from anhyst.compensate.methods import FluxFeedback, FusedInverse
from anhyst.control.controller_file import ControllerTable
from anhyst.support.kinds import FLUX_PROBE_METHODS, MethodName
from anhyst.support.numeric import FloatArray, rms
from anhyst_rigs.rig.bearing.loop import fit_bearing_compensators, pair_table
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.calibration import CENTRE_PARAMETERS, CalibratedMethod, ParameterName
from anhyst_rigs.rig.drift import NO_DRIFT, Drift
from anhyst_rigs.rig.fitting import IdentifiedMagnet, calibrate_magnet
from anhyst_rigs.rig.recording import CURRENT_SIGNALS, HOVER_CODE, column_name, magnet_columns
from anhyst_rigs.rig.stage.calibrated import assumed_rig, current_per_root_force
from anhyst_rigs.rig.stage.fitted import apply_calibration, fit_method_compensator
from anhyst_rigs.rig.stage.geometry import (
    axis_indices,
    head_rows,
    magnet_rows,
    mass_matrix,
    scan_direction,
    weight_along_scan,
    weight_wrench,
)
from anhyst_rigs.rig.stage.loop import StageSetup
from anhyst_rigs.rig.stage.recording import demand_columns, pose_columns
from anhyst_rigs.study.tracking.motion import (
    COMPARISON_RATE_HZ,
    MIN_DEMAND_TO_MAX_FORCE,
    ColumnFault,
    Motion,
    MotionLaw,
    round_to_grid,
)

_DERIVATIVE_STEPS: Mapping[ParameterName, float] = {"payload": 0.01, **dict.fromkeys(CENTRE_PARAMETERS, 1e-3)}
"""Step of each body parameter for finite-difference derivatives."""
MAX_EXCHANGED_RESIDUAL = 0.2
"""Largest residual after the exchange of two magnets, relative to that before it."""
COMPARISON_START_S = 0.01
"""Time of the first comparison, s. Before, the magnets take up the weight in one step, and the
currents do not follow their commands."""


SPEED_WINDOW_TICKS = 20
"""Number of ticks between the two positions that give the speed at the start of a recording."""
CALIBRATABLE_METHODS: tuple[MethodName, ...] = ("single-valued", "play", "at-rest", "full", "flux", "fused")
"""Methods that can be calibrated from a motion."""
_UNUSED_PARAMETERS: Mapping[MethodName, tuple[str, ...]] = {
    "single-valued": ("width",),
    **dict.fromkeys(FLUX_PROBE_METHODS, ("gap_zero", "width", "lag")),
}
"""Prefixes of the names of the parameters that each method does not use."""


@dataclass(frozen=True)
class StageMotion(Motion):
    """The recorded motion of a stage, with one component for each free coordinate."""

    @property
    def comparisons_per_tick(self) -> int:
        """Number of free coordinates."""
        return len(self.rig.settings.body.free)

    def filter_wrench(self, wrench: FloatArray, delay_ticks: float = 0.0) -> FloatArray:
        """Filter a wrench, and return all components as a one-dimensional array, N.

        Moments are divided by the radius of gyration.
        """
        filtered_wrench = [
            self.filter_force(component, delay_ticks) for component in (wrench / self.gyration_radii).T
        ]
        return np.column_stack(filtered_wrench).ravel()

    @cached_property
    def gyration_radii(self) -> FloatArray:
        """Radius of gyration of each rotation, m; 1 for translations."""
        body = self.rig.settings.body
        radii = [math.sqrt(inertia / body.mass_kg) for inertia in body.inertia_kg_m2 or [1.0] * 3]
        return np.array([1.0, 1.0, 1.0, *radii])[axis_indices(self.rig.settings)]

    @cached_property
    def _pose(self) -> FloatArray:
        columns = pose_columns(self.rig.settings.body.free)
        return np.column_stack([self.columns[name] for name in columns])

    @cached_property
    def _acceleration(self) -> FloatArray:
        acceleration = np.zeros_like(self._pose)
        acceleration[1:-1] = np.diff(self._pose, 2, axis=0) / self.rig.dt**2
        return acceleration

    @cached_property
    def measured_force(self) -> FloatArray:
        """Mass matrix times acceleration, filtered, N."""
        return self.filter_wrench(self._acceleration @ mass_matrix(self.rig.settings))

    @cached_property
    def weight_force(self) -> FloatArray:
        """Weight of the body, filtered, N."""
        return self.filter_wrench(np.tile(weight_wrench(self.rig.settings), (self.tick_numbers.size, 1)))

    @cached_property
    def force_per_unit(self) -> Mapping[ParameterName, FloatArray]:
        """Force that a unit of each body parameter causes, filtered, N."""
        file, forces = self.rig.settings, {}
        for name, step in _DERIVATIVE_STEPS.items():
            changed_file = assumed_rig(self.rig, {name: step}).settings
            inertial_force = self._acceleration @ (mass_matrix(changed_file) - mass_matrix(file))
            forces[name] = (
                self.filter_wrench(weight_wrench(changed_file) - weight_wrench(file) - inertial_force) / step
            )
        scan_axis = scan_direction(file)
        travel = (self._pose - self._pose[0]) @ scan_axis
        forces["bias_N"] = self.filter_wrench(np.tile(scan_axis, (travel.size, 1)))
        forces["cable_N_per_m"] = self.filter_wrench(-np.outer(travel, scan_axis))
        return forces

    @property
    def demanded_force(self) -> FloatArray:
        """Demanded force without the part that carries the weight, filtered, N."""
        file = self.rig.settings
        demand = np.column_stack([self.columns[name] for name in demand_columns(file.body.free)])
        return self.filter_wrench(demand + weight_wrench(file), self.delay_ticks)

    @property
    def force_noise(self) -> float:
        """Standard deviation of the measured force that the noise of the heads causes, N."""
        file = self.rig.settings
        head_gain = mass_matrix(file) @ np.linalg.pinv(head_rows(file)) / self.gyration_radii[:, None]
        rms_gain = float(np.linalg.norm(head_gain)) / math.sqrt(self.comparisons_per_tick)
        return rms_gain * file.position_sensor.noise_m * self.noise_gain

    @cached_property
    def compared_indices(self) -> NDArray[np.intp]:
        """Indices of the compared samples: all coordinates at all ticks with a large demand."""
        interval_ticks = max(1, round(1.0 / (COMPARISON_RATE_HZ * self.rig.dt)))
        min_demand_N = MIN_DEMAND_TO_MAX_FORCE * self.rig.settings.tracking.force_max_N
        demand_N = np.linalg.norm(
            self.demanded_force.reshape(-1, self.comparisons_per_tick)[::interval_ticks], axis=1
        )
        ticks = interval_ticks * np.flatnonzero(demand_N > min_demand_N)
        ticks = ticks[ticks >= max(self.first_compared_tick, round(COMPARISON_START_S / self.rig.dt))]
        return (self.comparisons_per_tick * ticks[:, None] + np.arange(self.comparisons_per_tick)).ravel()


class StageLaw(MotionLaw):
    """The hysteresis model of one method, applied to every magnet of a stage."""

    def __init__(self, rig: BodyRig, magnet: IdentifiedMagnet, method: MethodName) -> None:
        self.rig, self.method = rig, method
        self.compensator = cache(lambda width: fit_method_compensator(rig, magnet, method, width))
        self._current_per_root_force = cache(lambda: current_per_root_force(self.compensator(0.0), rig))
        self._cached_motion: StageMotion | None = None
        # forces of single magnets along the cached motion, N
        self._cached_forces: dict[tuple[object, ...], FloatArray] = {}
        self._magnet_numbers = range(1, len(rig.settings.body_magnets) + 1)
        unused_names = _UNUSED_PARAMETERS.get(method, ())
        if rig.settings.magnet.is_bidirectional:
            # The force of this magnet is proportional to the current, not to its square.
            unused_names += ("lag",)
        self.names = [name for name in rig.parameter_names if not name.startswith(unused_names)]
        coordinate_count = len(rig.settings.body.free)
        # With one coordinate, an error of the gap zero and an error of the magnet's scale have the
        # same effect. If both were estimated, both would drift to their bounds in many motions.
        fixed_names = ("gap_zero",) if coordinate_count == 1 else ()
        self.estimable_names = [name for name in self.names if not name.startswith(fixed_names)]
        self.force_max = rig.settings.tracking.force_max_N
        # These values were tuned: 0.0015 and 0.9 with six coordinates, 0.0023 and 0.85 with one.
        # With a smaller sigma, many motions fit errors of the model. With a larger sigma, a motion
        # gives little information. With more coordinates, model errors are distributed over all.
        self.comparison_sigma_ratio = 0.0015 * (6.0 / coordinate_count) ** 0.25
        self.max_sigma_ratio = 0.84 + 0.01 * coordinate_count
        self.max_residual_ratio = 0.0075 if method == "play" else 0.0037
        body_columns = [*demand_columns(rig.settings.body.free), *pose_columns(rig.settings.body.free)]
        magnet_signal_columns = magnet_columns(
            [("gap_read", "m"), *CURRENT_SIGNALS[:1]], 1, len(rig.settings.body_magnets)
        )
        self.required_columns = ["t_s", "demand_N", *body_columns, *magnet_signal_columns]
        probe_columns = magnet_columns([("flux_read", "T")], 1, len(rig.settings.body_magnets))
        self.optional_columns = [] if rig.settings.hall_probe is None else probe_columns

    def uncalibratable_methods(self, motions: Sequence[Motion]) -> Sequence[MethodName]:
        """Return the methods that the given recordings cannot calibrate."""
        has_probes = all(name in motion.columns for motion in motions for name in self.optional_columns)
        return () if self.optional_columns and has_probes else FLUX_PROBE_METHODS

    def find_motion_at_start(self, columns: Mapping[str, FloatArray]) -> ColumnFault | None:
        """Return a fault if a recording begins in motion, because its hysteresis state is unknown."""
        file, pose_names = self.rig.settings, pose_columns(self.rig.settings.body.free)
        position_names = [name for name in pose_names if name.endswith("_m")] or pose_names
        position = np.column_stack([columns[name] for name in position_names])
        speed = np.linalg.norm(position[SPEED_WINDOW_TICKS:] - position[:-SPEED_WINDOW_TICKS], axis=1) / (
            SPEED_WINDOW_TICKS * self.rig.dt
        )
        max_noise_speed = 10.0 * file.position_sensor.noise_m / (SPEED_WINDOW_TICKS * self.rig.dt)
        if abs(columns["demand_N"][0] + weight_along_scan(file)) > MIN_DEMAND_TO_MAX_FORCE * self.force_max:
            return ColumnFault("begins in motion", "demand_N")
        # If the magnets carry the weight, the body falls until currents flow.
        fall_speed = (
            abs(file.body.gravity_m_per_s2) * SPEED_WINDOW_TICKS * self.rig.dt * weight_wrench(file).any()
        )
        is_moving = speed[0] > 0.02 * float(speed.max()) + max_noise_speed + fall_speed
        return ColumnFault("begins in motion", position_names[0]) if is_moving else None

    def find_wrong_sign(self, motion: Motion) -> ColumnFault | None:
        """Return a fault if the demand and the motion have opposite signs, or None."""
        assert isinstance(motion, StageMotion)
        correlation = float(
            motion.measured_force[motion.compared_indices] @ motion.demanded_force[motion.compared_indices]
        )
        demand_column = demand_columns(self.rig.settings.body.free)[0]
        text = f"the body moves against {demand_column}; invert the sign of every demanded force and moment"
        return ColumnFault(text, demand_column) if correlation < 0.0 else None

    def find_exchanged_magnets(self, motion: Motion) -> tuple[int, int] | None:
        """Return the two magnets whose exchange explains a motion that the law does not, or None."""
        assert isinstance(motion, StageMotion)
        if not motion.compared_indices.size:
            return None
        pulls = np.array([self._magnet_pull(motion, number, {}) for number in self._magnet_numbers])
        rows = magnet_rows(self.rig.settings) / motion.gyration_radii
        unexplained = motion.measured_force - motion.weight_force - (pulls.T @ rows).ravel()

        def residual(pair: tuple[int, int]) -> float:
            first, second = pair
            change = np.outer(pulls[first] - pulls[second], rows[first] - rows[second]).ravel()
            return rms((unexplained + change)[motion.compared_indices])

        pair = min(combinations(range(len(rows)), 2), key=residual)
        is_explained = residual(pair) < MAX_EXCHANGED_RESIDUAL * rms(unexplained[motion.compared_indices])
        return (pair[0] + 1, pair[1] + 1) if is_explained else None

    def make_motion(self, columns: Mapping[str, FloatArray], first_compared_tick: int = 0) -> Motion:
        """Return the motion that recorded columns describe."""
        return StageMotion(self.rig, columns, first_compared_tick)

    def is_excited(self, motion: Motion, name: ParameterName) -> bool:
        """Whether a motion excites a parameter: its magnet must exceed 6 % of the largest force."""
        magnet_number = re.search(r"_(\d+)", name)
        if magnet_number is None:
            return True
        assert isinstance(motion, StageMotion)
        force = self._magnet_force(motion, int(magnet_number[1]), {})[motion.compared_indices]
        max_force = np.linalg.norm(force.reshape(-1, motion.comparisons_per_tick), axis=1).max()
        return bool(max_force > MIN_DEMAND_TO_MAX_FORCE * self.force_max)

    def corrected_stage(self, calibration: CalibratedMethod, drift: Drift = NO_DRIFT) -> StageSetup:
        """Return the stage with a controller corrected by a calibration, and with a plant drift."""
        return apply_calibration(self.rig, self.compensator, calibration, drift)

    def net_force(self, motion: Motion, values: Mapping[ParameterName, float]) -> FloatArray:
        """Return the wrench that the model predicts along a motion for given values, filtered, N."""
        assert isinstance(motion, StageMotion)
        body_forces = [values[name] * force for name, force in motion.force_per_unit.items()]
        magnet_forces = [self._magnet_force(motion, number, values) for number in self._magnet_numbers]
        return np.asarray(sum([*body_forces, *magnet_forces], motion.weight_force))

    def _magnet_force(
        self, motion: StageMotion, number: int, values: Mapping[ParameterName, float]
    ) -> FloatArray:
        """Return the filtered force components of one magnet, N."""
        pull_row = magnet_rows(self.rig.settings)[number - 1] / motion.gyration_radii
        return np.outer(self._magnet_pull(motion, number, values), pull_row).ravel()

    def _magnet_pull(
        self, motion: StageMotion, number: int, values: Mapping[ParameterName, float]
    ) -> FloatArray:
        """Return the filtered pull of one magnet, N. The results are cached."""
        scale = 1.0 + values.get(f"scale_{number}", 0.0)
        gap_zero = values.get(f"gap_zero_{number}_m", 0.0)
        width = round_to_grid("width", values.get(f"width_{number}", 0.0))
        lag, file = values.get("lag_s", 0.0), self.rig.settings
        if motion is not self._cached_motion:
            self._cached_motion, self._cached_forces = motion, {}
        key = number, scale, gap_zero, width, lag
        if key not in self._cached_forces:
            gap = motion.columns[column_name("gap_read", "m", number)] - gap_zero
            if self.method in FLUX_PROBE_METHODS:
                flux, probe = motion.columns[column_name("flux_read", "T", number)], file.hall_probe
                assert probe is not None
                lag_ticks = 1.0 / (2.0 * math.pi * probe.bandwidth_Hz * self.rig.dt)
                force, delay_ticks = self._force_of_flux(scale * flux, gap), -lag_ticks
            else:
                current = scale * motion.columns[column_name("command", "A", number)]
                gap_at_force = np.interp(motion.tick_numbers + motion.delay_ticks, motion.tick_numbers, gap)
                force = self._force_of_current(current, gap_at_force, width, lag)
                delay_ticks = motion.delay_ticks
            self._cached_forces[key] = motion.filter_force(force, delay_ticks)
        return self._cached_forces[key]

    def _force_of_current(
        self, current: FloatArray, gap: FloatArray, width: float, lag_s: float
    ) -> FloatArray:
        """Return the force of a current whose flux lags by the time ``lag_s``, N.

        The current is reduced by the lag, times the slope of current over root force, times the
        rate of change of this root. The lead in the controller uses the same expression.
        """
        force = self.compensator(width).reset_copy().follow(current, gap)
        if not lag_s:
            return force
        root_steps = np.diff(np.sqrt(np.maximum(force, 0.0)), prepend=0.0)
        lagged_current = current - lag_s / self.rig.dt * self._current_per_root_force() * root_steps
        return self.compensator(width).reset_copy().follow(lagged_current, gap)

    def _force_of_flux(self, flux: FloatArray, gap: FloatArray) -> FloatArray:
        """Return the force of a measured flux density, N, to whose square it is proportional."""
        parameters = self.compensator(0.0).parameters
        assert isinstance(parameters, FluxFeedback | FusedInverse)
        flux_per_root_force = parameters.loop.flux_table[:, -1] / math.sqrt(parameters.scales.demand)
        gaps = np.linspace(parameters.scales.gap_low, parameters.scales.gap_high, flux_per_root_force.size)
        return np.asarray((flux / np.interp(gap, gaps, flux_per_root_force)) ** 2)


REFERENCE_WINDOW_S = 0.06
"""Length of the window before a tick, s, in which the reference must move if the tick is compared.
"""
MIN_REFERENCE_CHANGE_TO_TRAVEL = 0.02
"""Smallest change of the reference in this window, as a fraction of the travel. At rest, a load
could not be distinguished from an error of the magnet."""
RECORDED_LOAD_SIGMA_TO_MAX_FORCE = 0.002
"""Standard deviation of a recorded load, as a fraction of the largest force."""
ASSUMED_LOAD_SIGMA_TO_LOAD = 0.1
"""Standard deviation of the load that the rig file gives, as a fraction of this load."""


@dataclass(frozen=True)
class BearingMotion(Motion):
    """The recorded motion of a levitated armature."""

    @cached_property
    def _inertial_force(self) -> FloatArray:
        """Weight minus mass times acceleration, filtered, N."""
        gap, body = self.columns["gap_read_m"], self.rig.settings.body
        opening_acceleration = np.full(gap.size, body.gravity_m_per_s2)
        opening_acceleration[1:-1] -= np.diff(gap, 2) / self.rig.dt**2
        return self.filter_force(body.mass_kg * opening_acceleration)

    @cached_property
    def measured_force(self) -> FloatArray:
        """Net force of the magnets that follows from the load and the motion, filtered, N."""
        assumed_load = np.full(self.tick_numbers.size, self.rig.settings.load.force_N)
        return self._inertial_force + self.filter_force(self.columns.get("load_N", assumed_load))

    @property
    def force_rms(self) -> float:
        """Rms force to which residuals are related, N; for a pair, it includes both bias forces."""
        return math.hypot(super().force_rms, math.sqrt(2.0) * (self.rig.settings.bias_N or 0.0))

    @cached_property
    def force_per_unit(self) -> Mapping[ParameterName, FloatArray]:
        """Force that a unit of each body parameter causes, filtered, N."""
        return {"bias_N": -np.ones(self.tick_numbers.size), "payload": -self._inertial_force}

    @property
    def force_noise(self) -> float:
        """Standard deviation of the measured force from the sensor's noise and resolution, N."""
        sensor = self.rig.settings.gap_sensor
        gap_noise = math.hypot(sensor.noise_m, sensor.resolution / math.sqrt(12.0))
        return self.rig.settings.body.mass_kg * gap_noise * self.noise_gain

    @cached_property
    def compared_indices(self) -> NDArray[np.intp]:
        """Indices of the compared ticks: the armature levitates and its reference moves."""
        file, reference = self.rig.settings, self.columns["reference_m"]
        state = np.rint(self.columns["state"])
        if "phase" in self.columns:
            state = 16.0 * state + np.rint(self.columns["phase"])
        is_levitated = state == HOVER_CODE
        # before levitation, it is the reference of the lift-off
        levitated_reference = np.where(
            is_levitated, reference, file.gap_m if not is_levitated.any() else reference[is_levitated][0]
        )
        window = round(REFERENCE_WINDOW_S / self.rig.dt)
        window_shift = (window - 1) // 2  # The window ends at the compared tick.
        reference_change = maximum_filter1d(levitated_reference, window, origin=window_shift)
        reference_change -= minimum_filter1d(levitated_reference, window, origin=window_shift)
        min_change = MIN_REFERENCE_CHANGE_TO_TRAVEL * (file.body.stop_high_m - file.body.stop_low_m)
        interval_ticks = max(1, round(1.0 / (COMPARISON_RATE_HZ * self.rig.dt)))
        ticks = interval_ticks * np.flatnonzero(
            (is_levitated & (reference_change > min_change))[::interval_ticks]
        )
        return ticks[ticks >= self.first_compared_tick]


class BearingLaw(MotionLaw):
    """The hysteresis model of one method, applied to each magnet of a bearing."""

    comparison_sigma_ratio = 0.004
    max_sigma_ratio = 0.7
    max_residual_ratio = 0.0043
    # The live page records the phase in a separate column next to the controller's state.
    optional_columns = ("load_N", "phase")

    def __init__(
        self,
        bearing: BodyRig,
        controller: ControllerTable,
        magnet: IdentifiedMagnet,
        method: MethodName,
        is_load_recorded: bool = True,
    ) -> None:
        self.rig, self.method = bearing, method
        self.names = bearing.parameter_names
        is_single_valued = method == "single-valued"
        self.estimable_names = [
            name for name in self.names if not (is_single_valued and name.startswith("width"))
        ]
        self.force_max = controller.force_max(pair_table(bearing))
        self._is_load_recorded = is_load_recorded

        def fit_compensator(width: float) -> ForceController:
            magnets = [calibrate_magnet(magnet, width_change=width)]
            return fit_bearing_compensators(bearing, controller, magnets, method, "f64")[0]

        self.compensator = cache(fit_compensator)
        commands = magnet_columns(CURRENT_SIGNALS[:1], 1, len(bearing.settings.magnets))
        self.required_columns = ["t_s", "reference_m", "gap_read_m", *commands, "state"]

    def law_options(self, motions: Sequence[Motion]) -> Mapping[str, Any]:
        """Return, as a keyword argument, whether the load was recorded in all motions."""
        return {"is_load_recorded": all("load_N" in motion.columns for motion in motions)}

    def find_motion_at_start(self, columns: Mapping[str, FloatArray]) -> ColumnFault | None:
        """Return a fault if a current flows at the start of a recording, or None."""
        has_current = columns["command_A"][0] > 0.0
        return ColumnFault("begins while a current flows", "command_A") if has_current else None

    def prior_sigma(self, name: ParameterName) -> float:
        """Return the prior standard deviation of a parameter, from the rig file."""
        if name.startswith("scale"):
            return 0.01 * self.rig.settings.spread.sensor_gain_percent
        if name == "bias_N":
            return (
                RECORDED_LOAD_SIGMA_TO_MAX_FORCE * self.force_max
                if self._is_load_recorded
                else ASSUMED_LOAD_SIGMA_TO_LOAD * self.rig.static_load
            )
        return super().prior_sigma(name)

    def make_motion(self, columns: Mapping[str, FloatArray], first_compared_tick: int = 0) -> Motion:
        """Return the motion that recorded columns describe."""
        return BearingMotion(self.rig, columns, first_compared_tick)

    def net_force(self, motion: Motion, values: Mapping[ParameterName, float]) -> FloatArray:
        """Return the net force that the model predicts for given parameters, filtered, N."""
        gap = motion.columns["gap_read_m"] - values["gap_zero_m"]
        gap = np.interp(motion.tick_numbers + motion.delay_ticks, motion.tick_numbers, gap)
        force = motion.force_per_unit["bias_N"] * values["bias_N"]
        for number, magnet_gap in enumerate(self.rig.magnet_gaps(gap), 1):
            width = values.get("width", values.get(f"width_{number}", 0.0))
            current = motion.columns[column_name("command", "A", number)]
            current = (1.0 + values[f"scale_{number}"]) * current
            compensator = self.compensator(round_to_grid("width", width)).reset_copy()
            magnet_force = compensator.follow(current, magnet_gap)
            force = force + (-1.0) ** (number - 1) * motion.filter_force(magnet_force, motion.delay_ticks)
        return force
