"""The load drive of a virtual bearing, operated while it runs."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from anhyst._core import Plant
from anhyst.rig.bearing.file import BearingRig
from anhyst.rig.bench.protocol import Parameter
from anhyst.support.arrays import FloatArray
from anhyst.support.elementary import sine


class LoadDrive:
    """What pulls at the armature: force, damping, stiffness, a disturbance."""

    def __init__(self, rig: BearingRig, bearing: Plant) -> None:
        load, mass = rig.settings.load, rig.settings.body.mass_kg
        self.force = load.force_N
        self._bearing = bearing
        self._dt = rig.dt
        self._since = 0  # tick of the disturbance's phase zero
        self._values = {
            "load_damping": load.damping_N_s_per_m,
            "load_stiffness": load.stiffness_N_per_m,
            "disturbance_force": 0.0,
            "disturbance_frequency": 10.0,
        }
        # Rendered by a drive that is late: beyond a part of its bandwidth it would shake by itself.
        damping = mass * 2.0 * math.pi * load.velocity_bandwidth_Hz / 4.0
        stiffness = mass * (2.0 * math.pi * load.bandwidth_Hz / 10.0) ** 2
        most = rig.settings.timing.rate_Hz / 4.0
        force = max(abs(load.force_N), mass * 9.81)
        self._ranges = {
            "load_damping": (-damping, damping, "N s/m", "damping that the load drive renders"),
            "load_stiffness": (
                -stiffness,
                stiffness,
                "N/m",
                "stiffness that it renders about the operating gap",
            ),
            "disturbance_force": (0.0, force, "N", "amplitude of a sine on its force"),
            "disturbance_frequency": (0.0, most, "Hz", "of this sine"),
        }

    def parameters(self) -> tuple[Parameter, ...]:
        """Return all that may be changed, with the values in force."""
        return tuple(
            Parameter(name, unit, low, high, doc, self._values[name])
            for name, (low, high, unit, doc) in self._ranges.items()
        )

    def apply(self, values: Mapping[str, float], tick: int) -> None:
        """Put values in force from a tick on; what is no parameter of it is left alone."""
        self._values |= {name: values[name] for name in self._values if name in values}
        if "disturbance_frequency" in values:
            self._since = tick
        self._bearing.set_load(self._values["load_damping"], self._values["load_stiffness"])

    def forces(self, first: int, ticks: int) -> FloatArray:
        """Return what is commanded at some ticks from one on, N, shape (ticks,)."""
        amplitude, frequency = (
            self._values[f"disturbance_{one}"] for one in ("force", "frequency")
        )
        if amplitude == 0.0:
            return np.full(ticks, self.force)
        turns = frequency * self._dt * np.arange(first - self._since, first - self._since + ticks)
        wave: FloatArray = self.force + amplitude * sine(turns)
        return wave
