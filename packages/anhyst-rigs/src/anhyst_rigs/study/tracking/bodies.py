"""The motion of a stage and of a bearing, and the law of a method of each.

Of a stage the wrench of all magnets is held against the motion. Moments count by the radius of
gyration of the body about their axis, so that all that is compared is in N. What the law is known
to leave out: the lines of pull move with the body by micrometres.

Of a bearing the net force of its magnets is compared, positive where it closes the gap. The load is
taken as it was recorded, or as the rig file says; a constant part of it is estimated beside.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from anhyst.compensate.force_controller import ForceController
from anhyst.compensate.methods import FluxFeedback, FusedInverse
from anhyst.control.controller_file import ControllerTable
from anhyst.support.kinds import PROBED, MethodName
from anhyst.support.numeric import FloatArray
from anhyst_rigs.rig.bearing.loop import fit_magnets, pair_of
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.calibration import CENTRE, CalibratedMethod, ParameterName
from anhyst_rigs.rig.drift import NO_DRIFT, Drift
from anhyst_rigs.rig.fitting import IdentifiedMagnet, calibrated
from anhyst_rigs.rig.recording import CURRENTS, HOVER, column, of_magnets
from anhyst_rigs.rig.stage.calibrated import believed, per_root
from anhyst_rigs.rig.stage.fitted import corrected, fit_method
from anhyst_rigs.rig.stage.geometry import (
    axes_of,
    head_rows,
    mass_matrix,
    pull_rows,
    scan_direction,
    weight,
    weight_along_scan,
)
from anhyst_rigs.rig.stage.loop import StageSetup
from anhyst_rigs.rig.stage.recording import demand_columns, pose_columns
from anhyst_rigs.study.tracking.motion import (
    DEAD,
    UPDATES_HZ,
    ColumnFault,
    Motion,
    MotionLaw,
    on_grid,
)

_STEPS: Mapping[ParameterName, float] = {"payload": 0.01, **dict.fromkeys(CENTRE, 1e-3)}
"""By which a number of the body is moved for its derivative."""
START_S = 0.01
"""From when on anything is compared: the weight is taken up in one step, from which no supply lets
the currents follow their commands."""


STILL = 20
"""Ticks over which a speed is taken, to see whether a recording begins at rest."""
LEARNT: tuple[MethodName, ...] = ("single-valued", "play", "at-rest", "full", "flux", "fused")
"""Methods that a motion can correct."""
_NOT_OF: Mapping[MethodName, tuple[str, ...]] = {
    "single-valued": ("width",),
    **dict.fromkeys(PROBED, ("gap_zero", "width", "lag")),
}
"""Numbers that a method has no use for, by what they begin with."""


@dataclass(frozen=True)
class StageMotion(Motion):
    """What was read while a stage moved, a number a coordinate a tick."""

    @property
    def rows(self) -> int:
        """Coordinates."""
        return len(self.rig.settings.body.free)

    def in_newtons(self, wrench: FloatArray, late: float = 0.0) -> FloatArray:
        """Return a wrench a tick through the filter, moments by the radius of gyration, in a row."""
        passed = [self.filtered(one, late) for one in (wrench / self.radii).T]
        return np.column_stack(passed).ravel()

    @cached_property
    def radii(self) -> FloatArray:
        """By which moments count, m; 1 along a coordinate."""
        body = self.rig.settings.body
        radii = [math.sqrt(one / body.mass_kg) for one in body.inertia_kg_m2 or [1.0] * 3]
        return np.array([1.0, 1.0, 1.0, *radii])[axes_of(self.rig.settings)]

    @cached_property
    def _pose(self) -> FloatArray:
        columns = pose_columns(self.rig.settings.body.free)
        return np.column_stack([self.read[name] for name in columns])

    @cached_property
    def _acceleration(self) -> FloatArray:
        moved = np.zeros_like(self._pose)
        moved[1:-1] = np.diff(self._pose, 2, axis=0) / self.rig.dt**2
        return moved

    @cached_property
    def pushed(self) -> FloatArray:
        """Masses times accelerations, filtered, N."""
        return self.in_newtons(self._acceleration @ mass_matrix(self.rig.settings))

    @cached_property
    def carried(self) -> FloatArray:
        """Weight, filtered, N."""
        return self.in_newtons(np.tile(weight(self.rig.settings), (self.ticks.size, 1)))

    @cached_property
    def by_body(self) -> Mapping[ParameterName, FloatArray]:
        """What the numbers of the body push with, for each unit of them, filtered, N."""
        file, pushes = self.rig.settings, {}
        for name, step in _STEPS.items():
            other = believed(self.rig, {name: step}).settings
            more = self._acceleration @ (mass_matrix(other) - mass_matrix(file))
            pushes[name] = self.in_newtons(weight(other) - weight(file) - more) / step
        along = scan_direction(file)
        way = (self._pose - self._pose[0]) @ along
        pushes["bias_N"] = self.in_newtons(np.tile(along, (way.size, 1)))
        pushes["cable_N_per_m"] = self.in_newtons(-np.outer(way, along))
        return pushes

    @property
    def asked(self) -> FloatArray:
        """What was demanded beside what carries the weight, filtered, N."""
        file = self.rig.settings
        asked = np.column_stack([self.read[name] for name in demand_columns(file.body.free)])
        return self.in_newtons(asked + weight(file), self.late)

    @property
    def noise(self) -> float:
        """Standard deviation of the force from the noise of the heads, N."""
        file = self.rig.settings
        of_heads = mass_matrix(file) @ np.linalg.pinv(head_rows(file)) / self.radii[:, None]
        each = float(np.linalg.norm(of_heads)) / math.sqrt(self.rows)
        return each * file.position_sensor.noise_m * self.passed

    @cached_property
    def compared(self) -> NDArray[np.intp]:
        """Places at which both sides are compared: all coordinates where much is demanded."""
        every = max(1, round(1.0 / (UPDATES_HZ * self.rig.dt)))
        least = DEAD * self.rig.settings.tracking.force_max_N
        asked = np.linalg.norm(self.asked.reshape(-1, self.rows)[::every], axis=1)
        ticks = every * np.flatnonzero(asked > least)
        ticks = ticks[ticks >= max(self.begin, round(START_S / self.rig.dt))]
        return (self.rows * ticks[:, None] + np.arange(self.rows)).ravel()


class StageLaw(MotionLaw):
    """A method of every magnet as it is fitted to the loops of one, and with other numbers."""

    def __init__(self, rig: BodyRig, magnet: IdentifiedMagnet, method: MethodName) -> None:
        self.rig, self.method = rig, method
        self.compensator = cache(lambda width: fit_method(rig, magnet, method, width))
        self._per_root = cache(lambda: per_root(self.compensator(0.0), rig))
        self._of: StageMotion | None = None
        self._kept: dict[tuple[object, ...], FloatArray] = {}  # of single magnets along that motion
        self._count = range(1, len(rig.settings.placed) + 1)
        without = _NOT_OF.get(method, ())
        if rig.settings.magnet.both_ways:
            without += ("lag",)  # its force goes with the current, and not with its square
        self.names = [name for name in rig.numbers if not name.startswith(without)]
        free = len(rig.settings.body.free)
        # Along one coordinate a gap zero does what the scale of its magnet does: both together would
        # run off to their bounds in many laps.
        frozen = ("gap_zero",) if free == 1 else ()
        self.moved = [name for name in self.names if not name.startswith(frozen)]
        self.force_max = rig.settings.tracking.force_max_N
        # Both were chosen for six coordinates, 0.0015 and 0.9, and for one, 0.0023 and 0.85. What a
        # law leaves is spread over them, and the more there are, the less shows of each number. With
        # a smaller trust many laps fit what the law has wrong; with a larger one a lap shows little.
        self.trust, self.seen = 0.0015 * (6.0 / free) ** 0.25, 0.84 + 0.01 * free
        self.leaves = 0.0075 if method == "play" else 0.0037
        of_body = [*demand_columns(rig.settings.body.free), *pose_columns(rig.settings.body.free)]
        of_each = of_magnets([("gap_read", "m"), *CURRENTS[:1]], 1, len(rig.settings.placed))
        self.needed = ["t_s", "demand_N", *of_body, *of_each]
        probes = of_magnets([("flux_read", "T")], 1, len(rig.settings.placed))
        self.helpful = [] if rig.settings.hall_probe is None else probes

    def left_out(self, motions: Sequence[Motion]) -> Sequence[MethodName]:
        """Return the methods of which the recordings do not say enough."""
        read = all(name in one.read for one in motions for name in self.helpful)
        return () if self.helpful and read else PROBED

    def begins_in_motion(self, columns: Mapping[str, FloatArray]) -> ColumnFault | None:
        """Return what shows that a recording begins in motion: what iron remembers is not known."""
        file, poses = self.rig.settings, pose_columns(self.rig.settings.body.free)
        places = [name for name in poses if name.endswith("_m")] or poses
        place = np.column_stack([columns[name] for name in places])
        speed = np.linalg.norm(place[STILL:] - place[:-STILL], axis=1) / (STILL * self.rig.dt)
        noise = 10.0 * file.position_sensor.noise_m / (STILL * self.rig.dt)
        if abs(columns["demand_N"][0] + weight_along_scan(file)) > DEAD * self.force_max:
            return ColumnFault("begins in motion", "demand_N")
        # a body that carries its weight falls until currents flow
        fallen = abs(file.body.gravity_m_per_s2) * STILL * self.rig.dt * weight(file).any()
        is_moving = speed[0] > 0.02 * float(speed.max()) + noise + fallen
        return ColumnFault("begins in motion", places[0]) if is_moving else None

    def wrong_sign(self, motion: Motion) -> ColumnFault | None:
        """Return what shows that the demand counts the other way than the body goes."""
        assert isinstance(motion, StageMotion)
        together = float(motion.pushed[motion.compared] @ motion.asked[motion.compared])
        first = demand_columns(self.rig.settings.body.free)[0]
        text = f"the body goes against {first}; turn the sign of every demanded force and moment"
        return ColumnFault(text, first) if together < 0.0 else None

    def motion(self, read: Mapping[str, FloatArray], begin: int = 0) -> Motion:
        """Take a motion as it was read."""
        return StageMotion(self.rig, read, begin)

    def shows(self, motion: Motion, name: ParameterName) -> bool:
        """Whether a motion can show a number: at rest any law is wrong by a part of what it pulls."""
        number = re.search(r"_(\d+)", name)
        if number is None:
            return True
        assert isinstance(motion, StageMotion)
        pulled = self._pulled(motion, int(number[1]), {})[motion.compared]
        most = np.linalg.norm(pulled.reshape(-1, motion.rows), axis=1).max()
        return bool(most > DEAD * self.force_max)

    def stage(self, learnt: CalibratedMethod, drift: Drift = NO_DRIFT) -> StageSetup:
        """Return the stage whose controller is corrected by what was found; its plant may drift."""
        return corrected(self.rig, self.compensator, learnt, drift)

    def net(self, motion: Motion, values: Mapping[ParameterName, float]) -> FloatArray:
        """Return the wrench along a path by the law with some numbers, filtered, N."""
        assert isinstance(motion, StageMotion)
        body = [values[name] * force for name, force in motion.by_body.items()]
        pulled = [self._pulled(motion, number, values) for number in self._count]
        return np.asarray(sum([*body, *pulled], motion.carried))

    def _pulled(
        self, motion: StageMotion, number: int, values: Mapping[ParameterName, float]
    ) -> FloatArray:
        """Return what one magnet pulls with; what was asked for before is kept."""
        scale = 1.0 + values.get(f"scale_{number}", 0.0)
        zero = values.get(f"gap_zero_{number}_m", 0.0)
        width = on_grid("width", values.get(f"width_{number}", 0.0))
        lag, file = values.get("lag_s", 0.0), self.rig.settings
        if motion is not self._of:
            self._of, self._kept = motion, {}
        key = number, scale, zero, width, lag
        if key not in self._kept:
            gap = motion.read[column("gap_read", "m", number)] - zero
            if self.method in PROBED:
                flux, probe = motion.read[column("flux_read", "T", number)], file.hall_probe
                assert probe is not None
                lag_ticks = 1.0 / (2.0 * math.pi * probe.bandwidth_Hz * self.rig.dt)
                force, late = self._pull(scale * flux, gap), -lag_ticks
            else:
                current = scale * motion.read[column("command", "A", number)]
                later = np.interp(motion.ticks + motion.late, motion.ticks, gap)
                force, late = self._follow(current, later, width, lag), motion.late
            row = pull_rows(file)[number - 1] / motion.radii
            self._kept[key] = np.outer(motion.filtered(force, late), row).ravel()
        return self._kept[key]

    def _follow(self, current: FloatArray, gap: FloatArray, width: float, lag: float) -> FloatArray:
        """Return the force of a current whose flux lags it by so many seconds, N.

        The controller leads by what the root of the force changes by in that time, and so does this.
        """
        force = self.compensator(width).fresh().follow(current, gap)
        if not lag:
            return force
        rises = np.diff(np.sqrt(np.maximum(force, 0.0)), prepend=0.0)
        behind = current - lag / self.rig.dt * self._per_root() * rises
        return self.compensator(width).fresh().follow(behind, gap)

    def _pull(self, flux: FloatArray, gap: FloatArray) -> FloatArray:
        """Go back the way of the method's calibration: the force goes with the flux density squared."""
        parameters = self.compensator(0.0).parameters
        assert isinstance(parameters, FluxFeedback | FusedInverse)
        of_root = parameters.loop.wanted[:, -1] / math.sqrt(parameters.scales.demand)
        gaps = np.linspace(parameters.scales.gap_low, parameters.scales.gap_high, of_root.size)
        return np.asarray((flux / np.interp(gap, gaps, of_root)) ** 2)


ASKED_S, ASKED = 0.06, 0.02
"""What is compared lies so soon after the reference moved by that part of the travel: where nothing
was asked for, any load would be taken for a number of the magnet."""
KNOWN, UNSURE = 0.002, 0.1
"""Standard deviation of a load that was recorded, in parts of the largest force, and of one that was
not, in parts of what the rig file says."""


@dataclass(frozen=True)
class BearingMotion(Motion):
    """What was read while an armature was lifted and moved."""

    @cached_property
    def _inertia(self) -> FloatArray:
        """Weight less mass times acceleration, filtered, N."""
        gap, body = self.read["gap_read_m"], self.rig.settings.body
        away = np.full(gap.size, body.gravity_m_per_s2)
        away[1:-1] -= np.diff(gap, 2) / self.rig.dt**2
        return self.filtered(body.mass_kg * away)

    @cached_property
    def pushed(self) -> FloatArray:
        """What the magnets pulled with, by the load and the motion, filtered, N."""
        drive = np.full(self.ticks.size, self.rig.settings.load.force_N)
        return self._inertia + self.filtered(self.read.get("load_N", drive))

    @property
    def force(self) -> float:
        """Force of which a law leaves a part, root mean square, N; magnets of a pair pull besides."""
        return math.hypot(super().force, math.sqrt(2.0) * (self.rig.settings.bias_N or 0.0))

    @cached_property
    def by_body(self) -> Mapping[ParameterName, FloatArray]:
        """What the numbers of the body push with, for each unit of them, filtered, N."""
        return {"bias_N": -np.ones(self.ticks.size), "payload": -self._inertia}

    @property
    def noise(self) -> float:
        """Standard deviation of that force from noise and steps of the gap sensor, N."""
        sensor = self.rig.settings.gap_sensor
        read = math.hypot(sensor.noise_m, sensor.step / math.sqrt(12.0))
        return self.rig.settings.body.mass_kg * read * self.passed

    @cached_property
    def compared(self) -> NDArray[np.intp]:
        """Ticks at which both sides are compared: the armature hangs and goes where it is told."""
        file, reference = self.rig.settings, self.read["reference_m"]
        state = np.rint(self.read["state"])
        if "phase" in self.read:
            state = 16.0 * state + np.rint(self.read["phase"])
        hangs = state == HOVER
        # the reference before it hangs is that of the lift
        last = np.where(hangs, reference, file.gap_m if not hangs.any() else reference[hangs][0])
        window = round(ASKED_S / self.rig.dt)
        back = (window - 1) // 2  # so that the window ends at the tick
        moved = maximum_filter1d(last, window, origin=back)
        moved -= minimum_filter1d(last, window, origin=back)
        least = ASKED * (file.body.stop_high_m - file.body.stop_low_m)
        every = max(1, round(1.0 / (UPDATES_HZ * self.rig.dt)))
        ticks = every * np.flatnonzero((hangs & (moved > least))[::every])
        return ticks[ticks >= self.begin]


class BearingLaw(MotionLaw):
    """A method of each magnet of a bearing as it is fitted to the loops, and with other numbers."""

    trust = 0.004
    seen = 0.7
    leaves = 0.0043
    helpful = ("load_N", "phase")  # the live page writes the phase beside the state of a controller

    def __init__(
        self,
        bearing: BodyRig,
        controller: ControllerTable,
        magnet: IdentifiedMagnet,
        method: MethodName,
        load_known: bool = True,
    ) -> None:
        self.rig, self.method = bearing, method
        self.names = bearing.numbers
        curve = method == "single-valued"
        self.moved = [name for name in self.names if not (curve and name.startswith("width"))]
        self.force_max = controller.force_max(pair_of(bearing))
        self._load_known = load_known

        def fitted(width: float) -> ForceController:
            known = [calibrated(magnet, wider=width)]
            return fit_magnets(bearing, controller, known, method, "f64")[0]

        self.compensator = cache(fitted)
        commands = of_magnets(CURRENTS[:1], 1, len(bearing.settings.magnets))
        self.needed = ["t_s", "reference_m", "gap_read_m", *commands, "state"]

    def known_from(self, motions: Sequence[Motion]) -> Mapping[str, Any]:
        """Return whether the load was recorded in all motions."""
        return {"load_known": all("load_N" in one.read for one in motions)}

    def begins_in_motion(self, columns: Mapping[str, FloatArray]) -> ColumnFault | None:
        """Return what shows that a recording begins before the iron was demagnetised."""
        flows = columns["command_A"][0] > 0.0
        return ColumnFault("begins while a current flows", "command_A") if flows else None

    def prior(self, name: ParameterName) -> float:
        """Return the standard deviation that the rig file states for a number."""
        if name.startswith("scale"):
            return 0.01 * self.rig.settings.spread.sensor_gain_percent
        if name == "bias_N":
            return KNOWN * self.force_max if self._load_known else UNSURE * self.rig.load
        return super().prior(name)

    def motion(self, read: Mapping[str, FloatArray], begin: int = 0) -> Motion:
        """Take a motion as it was read."""
        return BearingMotion(self.rig, read, begin)

    def net(self, motion: Motion, values: Mapping[ParameterName, float]) -> FloatArray:
        """Return the net force along a path by the law with some numbers, filtered, N."""
        gap = motion.read["gap_read_m"] - values["gap_zero_m"]
        gap = np.interp(motion.ticks + motion.late, motion.ticks, gap)
        net = motion.by_body["bias_N"] * values["bias_N"]
        for number, own_gap in enumerate(self.rig.gaps_at(gap), 1):
            width = values.get("width", values.get(f"width_{number}", 0.0))
            flowed = motion.read[column("command", "A", number)]
            flowed = (1.0 + values[f"scale_{number}"]) * flowed
            compensator = self.compensator(on_grid("width", width)).fresh()
            pulled = compensator.follow(flowed, own_gap)
            net = net + (-1.0) ** (number - 1) * motion.filtered(pulled, motion.late)
        return net
