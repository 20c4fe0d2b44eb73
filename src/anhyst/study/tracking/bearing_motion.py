"""The same of a bearing: the force that carries the load and moves the armature against the law.

What is compared is the net force of its magnets, positive where it closes the gap. The load is taken
as it was recorded, or as the rig file says; a constant part of it is estimated beside.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter1d, minimum_filter1d

from anhyst.compensate.force_controller import ForceController
from anhyst.compensate.interface import MethodName
from anhyst.control.controller_file import ControllerTable
from anhyst.rig.bearing.controller_check import pair_of
from anhyst.rig.bearing.file import BearingRig
from anhyst.rig.bearing.make_setup import IdentifiedMagnet, calibrated, fit_magnets
from anhyst.rig.calibration import ParameterName
from anhyst.rig.recording import HOVER, column
from anhyst.rig.stage.file import StageRig
from anhyst.study.tracking.motion import UPDATES_HZ, Motion, MotionLaw, on_grid
from anhyst.support.arrays import FloatArray

ASKED_S, ASKED = 0.06, 0.02
"""What is compared lies so soon after the reference moved by that part of the travel: where nothing
was asked for, any load would be taken for a number of the magnet."""
KNOWN, UNSURE = 0.002, 0.1
"""Standard deviation of a load that was recorded, in parts of the largest force, and of one that was
not, in parts of what the rig file says."""


@dataclass(frozen=True)
class BearingMotion(Motion):
    """What was read while an armature was lifted and moved."""

    @property
    def ticks(self) -> FloatArray:
        """Number of each tick."""
        return np.arange(self.read["gap_read_m"].size, dtype=np.float64)

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
        sensor = self.rig.settings.gap_sensor.sensor()
        read = math.hypot(sensor.noise, sensor.step / math.sqrt(12.0))
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

    def __init__(
        self,
        bearing: BearingRig,
        controller: ControllerTable,
        magnet: IdentifiedMagnet,
        method: MethodName,
        load_known: bool = True,
    ) -> None:
        self.rig, self.method = StageRig(bearing.path, bearing.settings), method
        self.names = bearing.numbers
        self._most = controller.force_max(pair_of(bearing))
        self._totals, self._load_known = [one.total for one in bearing.magnets], load_known

        def fitted(width: float) -> ForceController:
            known = [calibrated(magnet, wider=width)]
            return fit_magnets(bearing, controller, known, method, "f64")[0]

        self.compensator = cache(fitted)

    @property
    def moved(self) -> Sequence[ParameterName]:
        """The numbers that a motion may move."""
        curve = self.method == "single-valued"
        return [name for name in self.names if not (curve and name.startswith("width"))]

    @property
    def force_max(self) -> float:
        """Largest force of one magnet, N."""
        return self._most

    def prior(self, name: ParameterName) -> float:
        """Return the standard deviation that the rig file states for a number."""
        if name.startswith("scale"):
            return 0.01 * self.rig.settings.spread.sensor_gain_percent
        if name == "bias_N":
            return KNOWN * self._most if self._load_known else UNSURE * self.rig.bearing.load
        return super().prior(name)

    def motion(self, read: Mapping[str, FloatArray], begin: int = 0) -> Motion:
        """Take a motion as it was read."""
        return BearingMotion(self.rig, read, begin)

    def net(self, motion: Motion, values: Mapping[ParameterName, float]) -> FloatArray:
        """Return the net force along a path by the law with some numbers, filtered, N."""
        gap = motion.read["gap_read_m"] - values["gap_zero_m"]
        gap = np.interp(motion.ticks + motion.late, motion.ticks, gap)
        net = motion.by_body["bias_N"] * values["bias_N"]
        for number, total in enumerate(self._totals, 1):
            width = values.get("width", values.get(f"width_{number}", 0.0))
            flowed = motion.read[column("command", "A", number)]
            flowed = (1.0 + values[f"scale_{number}"]) * flowed
            compensator = self.compensator(on_grid("width", width)).fresh()
            pulled = compensator.follow(flowed, gap if total is None else total - gap)
            net = net + (-1.0) ** (number - 1) * motion.filtered(pulled, motion.late)
        return net
