"""Evaluate the loops of a magnet for a draft, and guess the missing data of its machine."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from anhyst.data import Loop, Loops
from anhyst.data.estimates import estimate_noise
from anhyst.data.output_map import is_electromagnet
from anhyst.data.speeds import find_rate_effect, group_by_speed, select_slow_loops
from anhyst.data.surface import Tangent, fit_plane, fit_surface
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst_rigs.draft.text import round_down, round_nearest

TOP_CURRENT_TO_MAX = 0.95
"""Fraction of the largest current, above which samples determine the force at this current."""

USABLE_FORCE_FRACTION = 0.95
"""Fraction of the measured force that a controller may demand."""

MAX_DEMAND_TO_SMALLEST_FORCE = 4.0
"""Largest ratio of a demanded force to the smallest force over all gaps at the largest current."""

MIN_LOAD_TO_USABLE_FORCE = 0.01
"""Smallest load, as a fraction of the usable force at the operating gap. The loops are too
uncertain for a smaller load."""

MIN_BRANCH_SAMPLES = 12
"""Smallest number of samples in a branch for an estimate of its noise."""


@dataclass(frozen=True, eq=False)
class MeasuredMagnet:
    """A magnet, described by its loops."""

    loops: Loops  # only slow loops of force over current, at one or several gaps
    gaps: FloatArray  # measured gaps, m, ascending; shape (g,)
    current_high: float  # largest current that was measured at every gap, A
    forces: FloatArray  # force at this current, N; shape (g,)
    # cycle rate, Hz, and current rate, A/s, of the fastest loops; None if rates do not matter
    fastest: tuple[float, float] | None = None

    def usable_force(self, gap: float) -> float:
        """Return the largest force that a controller may demand at a gap, N.

        It is slightly below the force of the loops at this gap. It is also limited relative to the
        smallest force over all gaps, because the fitted model would otherwise extrapolate.
        """
        # The reciprocal root of the force is almost linear in the gap.
        force = float(np.interp(gap, self.gaps, self.forces**-0.5) ** -2)
        return min(USABLE_FORCE_FRACTION * force, MAX_DEMAND_TO_SMALLEST_FORCE * float(self.forces.min()))

    def slopes(self, force: float, gap: float) -> Tangent:
        """Return the slopes of the force over current and over gap at an operating point."""
        force_high = self.usable_force(gap)
        if force < MIN_LOAD_TO_USABLE_FORCE * force_high:
            raise InputError(
                f"load: {force:g} N is less than a hundredth of the {force_high:.4g} N that the "
                "magnet may pull, and the loops are too uncertain there; give a larger load, or "
                "loops with smaller currents",
                code="load-too-small",
                key="load",
            )
        end_gaps = float(self.gaps[0]), float(self.gaps[-1])
        tangent = fit_plane(fit_surface(self.loops, (0.0, force_high), end_gaps), force, gap, force_high)
        if not tangent.current_per_force > 0.0:
            raise InputError(
                f"at {force:.4g} N and a gap of {gap:g} m the force does not rise with the "
                "current; check the loops with anhyst inspect",
                code="force-does-not-rise",
            )
        return tangent

    @property
    def noise(self) -> tuple[float, float]:
        """Standard deviations of the noise of current and force between reversals, A and N."""
        noises = [
            (estimate_noise(loop.input[start:end]), estimate_noise(loop.output[start:end]))
            for loop in self.loops.loops
            for start, end in pairwise([0, int(np.argmax(loop.input)), int(loop.n)])
            if end - start >= MIN_BRANCH_SAMPLES
        ]
        if not noises:
            return 0.0, 0.0
        current, force = np.median(np.array(noises), axis=0)
        return float(current), float(force)

    @property
    def sampling_and_rate(self) -> tuple[float, float] | None:
        """Sample interval, s, and rate of the current, A/s; None if the loops have no times."""
        sample_intervals, current_rates = [], []
        for loop in self.loops.loops:
            if loop.time is None:
                return None
            dt = np.diff(loop.time)
            is_time_increasing = dt > 0.0
            sample_intervals.append(
                float(np.median(dt[is_time_increasing])) if is_time_increasing.any() else math.nan
            )
            current_rates.append(
                float(np.abs(np.diff(loop.input)[is_time_increasing]).sum() / dt[is_time_increasing].sum())
            )
        time_step, current_rate = float(np.median(sample_intervals)), float(np.median(current_rates))
        return (time_step, current_rate) if time_step > 0.0 and current_rate > 0.0 else None


def evaluate_loops(loops: Loops) -> MeasuredMagnet:
    """Evaluate the loops of a magnet, and return the result."""
    if not is_electromagnet(loops) or loops.schedule is None or loops.schedule.name != "gap":
        raise InputError("a rig needs columns I_A, F_N and gap_m", code="columns-missing")
    fastest, loops = _fastest_rate(loops), select_slow_loops(loops)
    loops_by_gap = loops.by_schedule()
    current_high = min(max(float(loop.input.max()) for loop in group) for group in loops_by_gap.values())
    current_high = round_nearest(current_high, 3)  # because readings are noisy
    if not current_high > 0.0:
        text = "at one gap no current above 0 A was measured; invert the sign of the current"
        raise InputError(text, code="current-negative")
    forces = np.array([_force_at_top(group, current_high) for group in loops_by_gap.values()])
    if not forces.min() > 0.0:
        text = "the largest current does not pull at every gap; invert the sign of the force"
        raise InputError(text, code="force-negative")
    gaps = np.array(list(loops_by_gap), dtype=np.float64)
    return MeasuredMagnet(loops, gaps, current_high, forces, fastest)


def _fastest_rate(loops: Loops) -> tuple[float, float] | None:
    """Return cycle rate, Hz, and current rate, A/s, of the fastest loops; None if irrelevant."""
    speeds = group_by_speed(loops)
    if speeds is None or find_rate_effect(loops, speeds) is None:
        return None
    steps = [np.diff(loop.input) / np.diff(loop.time) for loop in speeds.fast[-1] if loop.time is not None]
    return speeds.fastest_rate, float(np.median(np.abs(np.concatenate(steps))))


def _force_at_top(loops: Sequence[Loop], current_high: float) -> float:
    """Return the force at the largest current, N, from a line through the samples near it."""
    current = np.concatenate([loop.input for loop in loops])
    force = np.concatenate([loop.output for loop in loops])
    is_at_top = np.abs(current - current_high) <= (1.0 - TOP_CURRENT_TO_MAX) * current_high
    current, force = current[is_at_top], force[is_at_top]
    if np.ptp(current) < 0.1 * (1.0 - TOP_CURRENT_TO_MAX) * current_high:
        return float(np.mean(force))
    _, level = np.polyfit(current - current_high, force, 1)
    return float(level)


GRAVITY_M_PER_S2 = 9.81
"""Acceleration of gravity, m/s^2."""

MIN_FORCE_TO_LOAD = 1.1
"""Smallest ratio of the magnet's force to the load at any gap, for a reliable lift-off."""

DEFAULT_LOAD_TO_SMALLEST_FORCE = 0.5
"""Default load, as a fraction of the smallest force over all gaps at the largest current."""

STOP_CLEARANCE_TO_TRAVEL = 0.05
"""Smallest distance of the operating gap from a stop, as a fraction of the travel."""


@dataclass(frozen=True, slots=True)
class MachineRequest:
    """Data of a machine that the user gives; None for values that are to be guessed."""

    mass: float | None = None  # moving mass, kg
    load: float | None = None  # load that opens the gap, N
    gap: float | None = None  # operating gap, m


@dataclass(frozen=True, slots=True)
class GuessedValue:
    """A value, and the source of its guess, which is empty if the user gave the value."""

    number: float
    guess: str = ""


@dataclass(frozen=True, slots=True)
class Machine:
    """Moving mass, load and operating gap of a machine."""

    mass: GuessedValue  # mass, kg; load, N; gap, m
    load: GuessedValue
    gap: GuessedValue
    stops: tuple[float, float]  # smallest and largest gap, m

    @property
    def clearance(self) -> float:
        """Distance from the operating gap to the nearer stop, m."""
        gap = self.gap.number
        return min(gap - self.stops[0], self.stops[1] - gap)

    def list_guesses(self) -> dict[str, str]:
        """Return the options that were guessed, with their values and the sources of the guesses."""
        return {
            f"--{name} {value.number:g}": value.guess
            for name, value in {"mass": self.mass, "load": self.load, "gap": self.gap}.items()
            if value.guess
        }


def guess_missing_machine_data(request: MachineRequest, magnet: MeasuredMagnet) -> Machine:
    """Return the data of a machine, and guess values that the user did not give."""
    for name, given_value, unit in (
        ("mass", request.mass, "kg"),
        ("load", request.load, "N"),
        ("gap", request.gap, "m"),
    ):
        if given_value is not None and not (math.isfinite(given_value) and given_value > 0.0):
            text = f"{name}: {given_value:g} {unit} is not above 0; correct it"
            raise InputError(text, code="not-above-zero", key=name)
    gap = _choose_gap(request, magnet)
    load = _choose_load(request, magnet)
    if request.mass is not None:
        mass = GuessedValue(request.mass)
    else:
        mass = GuessedValue(round_nearest(load.number / GRAVITY_M_PER_S2), "the load is its weight")
    return Machine(mass, load, gap, (float(magnet.gaps[0]), float(magnet.gaps[-1])))


def _choose_gap(request: MachineRequest, magnet: MeasuredMagnet) -> GuessedValue:
    lowest_gap, highest_gap = float(magnet.gaps[0]), float(magnet.gaps[-1])
    if magnet.gaps.size < 2:
        raise InputError(
            f"loops at one gap only, {lowest_gap:g} m, but a bearing moves; measure loops at a smaller and "
            "a larger one",
            code="single-gap",
        )
    if request.gap is None:
        return GuessedValue(
            round_nearest(0.5 * (lowest_gap + highest_gap), 3), "the middle of the measured gaps"
        )
    gap, clearance = request.gap, STOP_CLEARANCE_TO_TRAVEL * (highest_gap - lowest_gap)
    if not lowest_gap + clearance <= gap <= highest_gap - clearance:
        hints = [
            f", {gap:g}{exponent} m if {unit} are meant"
            for exponent, unit in (("e-3", "millimetres"), ("e-6", "micrometres"))
            if lowest_gap < gap * float(f"1{exponent}") < highest_gap
        ]
        raise InputError(
            f"gap: {gap:g} m is too near the stops, which are the ends of the measured gaps of "
            f"{lowest_gap:g} to {highest_gap:g} m; give one from {lowest_gap + clearance:g} to "
            f"{highest_gap - clearance:g} m{''.join(hints)}",
            code="gaps-not-covered",
            key="gap",
        )
    return GuessedValue(gap)


def _choose_load(request: MachineRequest, magnet: MeasuredMagnet) -> GuessedValue:
    weakest_index = int(magnet.forces.argmin())  # the largest gap, unless a solenoid has a cone
    weakest_force, weakest_gap = float(magnet.forces[weakest_index]), float(magnet.gaps[weakest_index])
    if request.load is not None:
        load = GuessedValue(request.load)
    elif request.mass is not None:
        load = GuessedValue(round_nearest(request.mass * GRAVITY_M_PER_S2, 3), "the weight of the mass")
    else:
        load = GuessedValue(
            round_down(DEFAULT_LOAD_TO_SMALLEST_FORCE * weakest_force),
            f"{100.0 * DEFAULT_LOAD_TO_SMALLEST_FORCE:.0f} % of the force at {weakest_gap:g} m",
        )
    if load.number * MIN_FORCE_TO_LOAD > weakest_force:
        origin = f", guessed as {load.guess}; give --load" if load.guess else ""
        raise InputError(
            f"load: {load.number:g} N cannot be lifted at a gap of {weakest_gap:g} m: there the "
            f"loops reach {weakest_force:.4g} N at {magnet.current_high:.4g} A, and {MIN_FORCE_TO_LOAD:g} times the "
            f"load, {load.number * MIN_FORCE_TO_LOAD:.4g} N, are needed; lower the load, or give loops with larger "
            f"currents or smaller gaps{origin}",
            code="load-too-large",
            key="load",
        )
    return load
