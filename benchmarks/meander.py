"""Follow a meander of 50 fields, 200 mm in x and y, with the planar stage of the example.

The long stroke moves below the stage. At each turnaround in x, the body steps by one field pitch in
y. The feedforward contains only the mass. Plant, iron and layout are those of the example; there is
one noise seed.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from anhyst.support.kinds import MethodName
from anhyst.support.numeric import FloatArray
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.drift import NO_DRIFT, drifted_plant
from anhyst_rigs.rig.loop import ClosedLoop, Scenario
from anhyst_rigs.rig.plant import current_controllers
from anhyst_rigs.rig.stage.file import read_stage
from anhyst_rigs.rig.stage.fitted import identify_stage_magnet, make_stage
from anhyst_rigs.rig.stage.geometry import mass_matrix, weight_wrench
from anhyst_rigs.rig.stage.loop import StageSetup
from anhyst_rigs.rig.stage.recording import axis_columns
from anhyst_rigs.rig.stage.setpoint import (
    STROKE_ERROR_DELAY_S,
    SetPoint,
    stroke_error_from_acceleration,
    tick_times,
)
from planar import RIG
from rows import Row

FIELDS = 50
FIELD_LENGTH_M, FIELD_PITCH_M = 0.2, 0.004
"""Length of a field along x, with half a turnaround at each end, and pitch of the fields along y,
m."""
STEP_ALONG_Y = SetPoint((10.0, 10.0), 0.12, 0.0, 7.5e-3, 2e-3, has_final_rest=True)
"""Set-point of a step along y: accelerations, m/s2, and speed, m/s."""
METHODS: tuple[MethodName, ...] = ("single-valued", "play", "full", "flux", "fused")
PIECE_TICKS = 20_000
SETTLED_S = 5e-3
"""Time from the end of the acceleration to the beginning of the exposure, s."""


@dataclass(frozen=True)
class Path:
    """A path along x and y: positions, m, and accelerations, m/s2; one row for each time."""

    rig: BodyRig

    @property
    def motion_along_x(self) -> SetPoint:
        """The motion along x."""
        scan = self.rig.settings.scan
        turning = 2.0 * scan.speed_m_per_s / max(scan.test_m_per_s2) + scan.jerk_phase_s
        cruise = FIELD_LENGTH_M / scan.speed_m_per_s - turning / 2.0
        phases = scan.jerk_phase_s, scan.snap_phase_s
        return SetPoint((max(scan.test_m_per_s2),) * FIELDS, scan.speed_m_per_s, cruise, *phases)

    def set_points_at(self, time: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return positions and accelerations at given times."""
        x_motion, moved_length = (
            self.motion_along_x,
            float(STEP_ALONG_Y.derivatives_at(np.array([STEP_ALONG_Y.duration]))[0][0]),
        )
        side_step = replace(STEP_ALONG_Y, cruise=(FIELD_PITCH_M - moved_length) / STEP_ALONG_Y.speed)
        pulse_duration = side_step.duration - 2.0 * side_step.cruise  # without the cruise before and after it
        x, y = x_motion.derivatives_at(time)[:2], [np.zeros_like(time), np.zeros_like(time)]
        for pulse_start, length, _ in x_motion.pulses[1:]:
            step_start = pulse_start + 0.5 * (length - pulse_duration) - side_step.cruise
            step_position, acceleration, _, _ = side_step.derivatives_at(time - step_start)
            y = [y[0] + step_position, y[1] + acceleration]
        return np.column_stack([x[0], y[0]]), np.column_stack([x[1], y[1]])

    def exposure_mask(self, count: int) -> np.ndarray:
        """Return the mask of the ticks in which a field is exposed."""
        mask, dt = np.zeros(count, dtype=bool), self.rig.dt
        for pulse_start, length, _ in self.motion_along_x.pulses:
            end = pulse_start + length + self.motion_along_x.cruise
            mask[round((pulse_start + length + SETTLED_S) / dt) : round(end / dt)] = True
        return mask


def errors(setup: StageSetup) -> tuple[FloatArray, int]:
    """Return the errors of all coordinates, one row for each tick, and the union of all flags."""
    rig, file, path = setup.rig, setup.rig.settings, Path(setup.rig)
    free_axes, n = file.body.free, round(path.motion_along_x.duration / rig.dt)
    time, lead_time = tick_times(rig, n + 1), (file.timing.delay_ticks + 0.5) * rig.dt
    path_positions, set_points = path.set_points_at(time)[0], np.zeros((n + 1, len(free_axes)))
    set_points[:, :2] = path_positions
    accelerations = np.zeros((n, len(free_axes)))
    accelerations[:, :2] = path.set_points_at(time[:n] + lead_time)[1]
    wrench = accelerations @ mass_matrix(file).T - weight_wrench(file)
    delayed_stray = path.motion_along_x.derivatives_at(time - STROKE_ERROR_DELAY_S)[1] / max(
        file.scan.test_m_per_s2
    )
    frame = set_points.copy()
    frame[:, 0] += stroke_error_from_acceleration(rig, delayed_stray, time)
    frame[:, 1] += stroke_error_from_acceleration(rig, 0.0, time)
    bearing = drifted_plant(rig, NO_DRIFT, 1)
    loop = ClosedLoop(bearing, setup.make_controller(), current_controllers(rig))
    pose_errors, flags = np.zeros((n, len(free_axes))), 0
    for first_tick in range(0, n, PIECE_TICKS):
        end = min(first_tick + PIECE_TICKS, n)
        piece_scenario = Scenario(
            set_points[first_tick:end], feed=wrench[first_tick:end], frame=frame[first_tick : end + 1]
        )
        run = loop.run(piece_scenario)
        poses = np.column_stack([run[name] for name in axis_columns("pose", free_axes)])
        pose_errors[first_tick:end] = set_points[first_tick:end] - poses - frame[first_tick:end]
        flags |= int(np.bitwise_or.reduce(run["flags"].astype(int)))
    return pose_errors, flags


def rows() -> list[Row]:
    """Return a row for each method."""
    rig = read_stage(RIG)
    magnet, result_rows = identify_stage_magnet(rig), []
    for method in METHODS:
        pose_errors, flags = errors(make_stage(rig, magnet, method))
        ticks = round(rig.settings.scan.slit_s / rig.dt)
        is_full_window = (
            np.convolve(Path(rig).exposure_mask(len(pose_errors)), np.ones(ticks), "valid") > ticks - 0.5
        )
        slit = np.ones(ticks) / ticks
        means = np.column_stack(
            [np.convolve(coordinate_errors, slit, "valid") for coordinate_errors in pose_errors.T]
        )
        average = 1e9 * np.abs(means[is_full_window]).max(axis=0)
        peak = 1e9 * np.abs(pose_errors[round(0.05 / rig.dt) :]).max(axis=0)
        text = ", ".join(
            f"{axis} {p:.3g} / {m:.3g}"
            for axis, p, m in zip(rig.settings.body.free, peak, average, strict=True)
        )
        title = f"meander, {FIELDS} fields, {len(pose_errors) * rig.dt:.0f} s, {method}: peak / average"
        result_rows.append(Row(title, "reported", f"{text} nm, nrad; flags {flags}", True))
    return result_rows
