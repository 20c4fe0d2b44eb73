"""What was read while a stage moved, and what the law of a method says of it.

The law follows the currents that were commanded, at the gaps that were read, in the core's own
code; what the body did is its acceleration. Both sides pass the same filter.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from anhyst.compensate.methods import FluxFeedback, FusedInverse
from anhyst.control.position import shared_by_pair
from anhyst.support.errors import InputError
from anhyst.support.kinds import PROBED, MethodName
from anhyst.support.numeric import FloatArray, rms
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.calibration import CENTRE, OF_STAGE, CalibratedMethod, ParameterName, kind_of
from anhyst_rigs.rig.drift import NO_DRIFT, Drift
from anhyst_rigs.rig.fitting import IdentifiedMagnet
from anhyst_rigs.rig.recording import of_magnets
from anhyst_rigs.rig.stage.file import per_root
from anhyst_rigs.rig.stage.loop import COMMANDS, PROBES, READ, StageSetup, corrected, fit_method

FILTER_HZ = 250.0
"""Corner of the three poles that both sides pass; a twentieth of the ticks at most."""
UPDATES_HZ = 1000.0
"""How often the two sides are compared."""
DEAD = 0.06
"""Nothing is learnt below this part of the largest force: at rest any load would be taken for one."""
AMPLIFIER = 16.0
"""Bandwidth that an amplifier must have, in corners of the filter: what it lags is not counted."""
_OF_BODY: tuple[ParameterName, ...] = ("bias_N", "payload", "cable_N_per_m")
_OF_IRON: tuple[ParameterName, ...] = ("scale_1", "scale_2", "width", "lag_s", *_OF_BODY)
MOVED: Mapping[MethodName, tuple[ParameterName, ...]] = {
    "single-valued": ("scale_1", "scale_2", "lag_s", *_OF_BODY),
    "play": _OF_IRON,
    "at-rest": _OF_IRON,
    "full": _OF_IRON,
    "flux": ("scale_1", "scale_2", *_OF_BODY),
    "fused": ("scale_1", "scale_2", *_OF_BODY),
}
"""What can be learnt of each method. The gap zero is frozen: on one axis it is hardly to be told from
the difference of both scales."""
STILL = 20
"""Ticks over which a speed is taken, to see whether a recording begins at rest."""
WIDTHS = 0.005
"""A law is fitted anew for widths on this grid."""


def refuse_uncalibratable(rig: BodyRig) -> None:
    """Refuse a stage whose motion would teach something else than what its magnets are off by."""
    file, least = rig.settings, AMPLIFIER * FILTER_HZ
    if file.amplifier.bandwidth_Hz < least:
        raise InputError(
            f"{rig.path}: amplifier.bandwidth_Hz: is below {least:g} Hz, and its lag would be "
            "taken for the iron's; calibrate with a faster amplifier",
            code="amplifier-too-slow",
            key="amplifier.bandwidth_Hz",
        )


class Moving(NamedTuple):
    """What shows that a recording begins in motion."""

    text: str  # how it begins
    column: str


@dataclass(frozen=True)
class Motion:
    """What was read while a stage moved, and what its body did."""

    rig: BodyRig
    read: Mapping[str, FloatArray]  # by column
    begin: int = 0  # tick from which on it teaches; before, it only tells what the iron remembers

    @property
    def rows(self) -> int:
        """How many numbers are compared at one tick."""
        return 1

    @property
    def ticks(self) -> FloatArray:
        """Number of each tick."""
        return np.arange(self.read["demand_N"].size, dtype=np.float64)

    def filtered(self, force: FloatArray, late: float = 0.0) -> FloatArray:
        """Return a force that acts so many ticks late, through the filter of both sides."""
        share = -math.expm1(-2.0 * math.pi * min(FILTER_HZ * self.rig.dt, 0.05))
        passed = np.interp(self.ticks - late, self.ticks, force)
        for _ in range(3):
            passed = lfilter([share], [1.0, share - 1.0], passed)
        return np.asarray(passed)

    @cached_property
    def pushed(self) -> FloatArray:
        """Mass times acceleration, filtered, N."""
        place = self.read["position_read_m"]
        acceleration = np.zeros(place.size)
        acceleration[1:-1] = np.diff(place, 2) / self.rig.dt**2
        return self.filtered(self.rig.settings.body.mass_kg * acceleration)

    @property
    def force(self) -> float:
        """Force of which a law leaves a part, root mean square, N."""
        return rms(self.pushed[self.compared])

    @cached_property
    def by_body(self) -> Mapping[ParameterName, FloatArray]:
        """What the numbers of the body push with, for each unit of them, filtered, N."""
        place = self.read["position_read_m"]
        moved = self.filtered(place - place[0])
        return dict(zip(_OF_BODY, (np.ones(place.size), -self.pushed, -moved), strict=True))

    @property
    def asked(self) -> FloatArray:
        """What was demanded, filtered, N; the first magnet pulls towards smaller positions."""
        return -self.filtered(self.read["demand_N"], self.late)

    @property
    def noise(self) -> float:
        """Standard deviation of that force from the noise of the position, N."""
        file = self.rig.settings
        return file.body.mass_kg * file.position_sensor.noise_m * self.passed

    @property
    def passed(self) -> float:
        """Noise of an acceleration after the filter, in that of its position, 1/s2."""
        tick = np.zeros(self.ticks.size)
        tick[:3] = 1.0, -2.0, 1.0
        return float(np.linalg.norm(self.filtered(tick))) / self.rig.dt**2

    @cached_property
    def compared(self) -> NDArray[np.intp]:
        """Ticks at which both sides are compared: where much is demanded."""
        every = max(1, round(1.0 / (UPDATES_HZ * self.rig.dt)))
        least = DEAD * self.rig.settings.tracking.force_max_N
        asked = np.abs(self.filtered(self.read["demand_N"]))[::every]
        ticks = every * np.flatnonzero(asked > least)
        return ticks[ticks >= self.begin]

    @cached_property
    def rises(self) -> FloatArray:
        """By how much the root of the force of each magnet that was asked for rises in a tick."""
        asked = shared_by_pair(self.read["demand_N"], self.rig.idle)
        return np.diff(np.sqrt(asked), prepend=0.0)

    @property
    def late(self) -> float:
        """Ticks from a command to its force: dead time and half a tick.

        The integral of an amplifier leaves no lag of what is slower than the filter here.
        """
        dead = self.rig.settings.amplifier.delay_s / self.rig.dt
        return self.rig.settings.timing.delay_ticks + 0.5 + dead


class MotionLaw:
    """A method as it is fitted to the loops, and with other numbers."""

    names: Sequence[ParameterName] = OF_STAGE
    """All numbers of it, in the order of files."""
    trust = 0.004
    """Standard deviation of a comparison, in parts of the largest force: what a good law leaves."""
    seen = 0.7
    """Of its prior standard deviation: a parameter with more left is called not seen."""

    def __init__(self, rig: BodyRig, magnet: IdentifiedMagnet, method: MethodName) -> None:
        self.rig, self.method = rig, method
        self.compensator = cache(lambda width: fit_method(rig, magnet, method, width))

    @property
    def needed(self) -> Sequence[str]:
        """The columns of a recording without which nothing is learnt."""
        return ["t_s", "demand_N", *READ, *COMMANDS]

    @property
    def helpful(self) -> Sequence[str]:
        """The columns that help, where a recording has them: those of flux probes."""
        file = self.rig.settings
        if file.hall_probe is None:
            return ()
        return of_magnets([("flux_read", "T")], 1, len(file.placed))

    def left_out(self, motions: Sequence[Motion]) -> Sequence[MethodName]:
        """Return the methods of which the recordings do not say enough."""
        names = self.helpful
        is_probed = names and all(name in one.read for one in motions for name in names)
        return () if is_probed else PROBED

    def known_from(self, motions: Sequence[Motion]) -> Mapping[str, Any]:
        """Return what a law is told of what the recordings hold."""
        del motions
        return {}

    def begins_in_motion(self, columns: Mapping[str, FloatArray]) -> Moving | None:
        """Return what shows that a recording begins in motion: what iron remembers is not known."""
        file = self.rig.settings
        place = np.column_stack([columns[name] for name in self.places])
        speed = np.linalg.norm(place[STILL:] - place[:-STILL], axis=1) / (STILL * self.rig.dt)
        noise = 10.0 * file.position_sensor.noise_m / (STILL * self.rig.dt)
        if abs(columns["demand_N"][0]) > DEAD * file.tracking.force_max_N:
            return Moving("in motion", "demand_N")
        is_moving = speed[0] > 0.02 * float(speed.max()) + noise
        return Moving("in motion", self.places[0]) if is_moving else None

    @property
    def places(self) -> Sequence[str]:
        """The columns that say where the body is."""
        return ["position_read_m"]

    opposite_sign = (
        "demand_N and the body go the same way: it is positive where the first magnet pulls, "
        "towards smaller positions; turn its sign"
    )
    """What is wrong where the demand counts the other way."""

    def wrong_sign(self, motion: Motion) -> str:
        """Say that the demand counts the other way than the body goes; empty where it does not."""
        together = float(motion.pushed[motion.compared] @ motion.asked[motion.compared])
        return self.opposite_sign if together < 0.0 else ""

    @property
    def moved(self) -> Sequence[ParameterName]:
        """The numbers that a motion may move."""
        return MOVED[self.method]

    @property
    def leaves(self) -> float:
        """Of the moving force: what is left at most where it fits; nothing is taken of what leaves more."""
        return 0.0075 if self.method == "play" else 0.0037

    @property
    def force_max(self) -> float:
        """Largest force that is asked for, N."""
        return self.rig.settings.tracking.force_max_N

    def prior(self, name: ParameterName) -> float:
        """Return the standard deviation that the rig file states for a number."""
        spread = self.rig.settings.spread
        of_probe = self.method in PROBED
        return {
            "scale": 0.01 * (spread.hall_percent if of_probe else spread.current_percent),
            "gap_zero_m": spread.gap_zero_m,
            "width": 0.01 * spread.pinning_percent,
            "lag_s": spread.eddy_s,
            "bias_N": 0.01 * self.force_max,
            "payload": 0.01 * spread.payload_percent,
            "cable_N_per_m": spread.cable_N_per_m,
            **dict.fromkeys(CENTRE, spread.centre_m),
        }[kind_of(name)]

    def motion(self, read: Mapping[str, FloatArray], begin: int = 0) -> Motion:
        """Take a motion as it was read."""
        return Motion(self.rig, read, begin)

    def shows(self, motion: Motion, name: ParameterName) -> bool:
        """Whether a motion can show a number."""
        del motion, name
        return True

    def stage(self, learnt: CalibratedMethod, drift: Drift = NO_DRIFT) -> StageSetup:
        """Return the stage whose controller is corrected by what was found; its plant may drift."""
        return corrected(self.rig, self.compensator, learnt, drift)

    def net(self, motion: Motion, values: Mapping[ParameterName, float]) -> FloatArray:
        """Return the net force along a path by the law with some numbers, filtered, N."""
        scales = np.array([[1.0 + values["scale_1"]], [1.0 + values["scale_2"]]])
        if self.method in PROBED:
            forces, late = self._by_flux(motion, scales), -self.probe_late
        else:
            forces, late = self._by_currents(motion, scales, values), motion.late
        # the first magnet pulls towards smaller positions
        body = (values[name] * force for name, force in motion.by_body.items())
        return sum(body, motion.filtered(forces[1] - forces[0], late))

    def _by_currents(
        self, motion: Motion, scales: FloatArray, values: Mapping[ParameterName, float]
    ) -> list[FloatArray]:
        read, rig = motion.read, self.rig
        compensator = self.compensator(on_grid("width", values["width"]))
        lead = values["lag_s"] / rig.dt * self._per_root
        flowed = scales * np.array([read[name] for name in COMMANDS]) - lead * motion.rises
        gap = np.interp(motion.ticks + motion.late, motion.ticks, read["gap_read_m"])
        return [
            compensator.fresh().follow(current, at)
            for current, at in zip(flowed, (gap, self._total - gap), strict=True)
        ]

    def _by_flux(self, motion: Motion, scales: FloatArray) -> list[FloatArray]:
        gap = motion.read["gap_read_m"]
        flux = scales * np.array([motion.read[name] for name in PROBES])
        at = (gap, self._total - gap)
        return [self.pull(*one) for one in zip(flux, at, strict=True)]

    def pull(self, flux: FloatArray, gap: FloatArray) -> FloatArray:
        """Go back the way of the method's calibration: the force goes with the flux density squared."""
        parameters = self.compensator(0.0).parameters
        assert isinstance(parameters, FluxFeedback | FusedInverse)
        of_root = parameters.loop.wanted[:, -1] / math.sqrt(parameters.scales.demand)
        gaps = np.linspace(parameters.scales.gap_low, parameters.scales.gap_high, of_root.size)
        return np.asarray((flux / np.interp(gap, gaps, of_root)) ** 2)

    @cached_property
    def _per_root(self) -> float:
        return per_root(self.compensator(0.0), self.rig)

    @property
    def _total(self) -> float:
        total = self.rig.settings.gap_total_m
        assert total is not None
        return total

    @property
    def probe_late(self) -> float:
        """Ticks that a flux probe lags."""
        probe = self.rig.settings.hall_probe
        assert probe is not None
        return 1.0 / (2.0 * math.pi * probe.bandwidth_Hz * self.rig.dt)


def on_grid(name: ParameterName, value: float) -> float:
    """Return the value of a parameter that a law can be fitted with."""
    return round(value / WIDTHS) * WIDTHS if kind_of(name) == "width" else value
