"""What moves, what pulls at it and where: as given, or guessed."""

from __future__ import annotations

import math
from dataclasses import dataclass

from anhyst.draft.magnet import MeasuredMagnet
from anhyst.draft.text import down, nearest
from anhyst.support.errors import InputError

GRAVITY = 9.81
"""m/s^2."""

LIFT = 1.1
"""Loops of every gap must reach so many times the load, or the armature hardly leaves its rest."""

USED = 0.5
"""Share of the force at the weakest gap that a load is guessed to be."""

ROOM = 0.05
"""Share of the travel that must be left between the operating gap and either stop."""


@dataclass(frozen=True, slots=True)
class Wanted:
    """What a user says of a machine; None for what is to be guessed."""

    mass: float | None = None  # of what moves, kg
    load: float | None = None  # force that pulls the gap open, N
    gap: float | None = None  # where it works, m


@dataclass(frozen=True, slots=True)
class Value:
    """A number, and from what it was guessed; empty where it was given."""

    number: float
    guess: str = ""


@dataclass(frozen=True, slots=True)
class Machine:
    """What moves, what pulls at it and where."""

    mass: Value  # kg, N, m
    load: Value
    gap: Value
    stops: tuple[float, float]  # least and largest gap, m

    @property
    def clearance(self) -> float:
        """Distance from the operating gap to the nearer stop, m."""
        gap = self.gap.number
        return min(gap - self.stops[0], self.stops[1] - gap)

    def guessed(self) -> dict[str, str]:
        """Return what was not given: option with its value, and from what it was guessed."""
        return {
            f"--{name} {value.number:g}": value.guess
            for name, value in {"mass": self.mass, "load": self.load, "gap": self.gap}.items()
            if value.guess
        }


def machine_of(wanted: Wanted, reach: MeasuredMagnet) -> Machine:
    """Complete what a user says of a machine."""
    for name, number, unit in (
        ("mass", wanted.mass, "kg"),
        ("load", wanted.load, "N"),
        ("gap", wanted.gap, "m"),
    ):
        if number is not None and not (math.isfinite(number) and number > 0.0):
            raise InputError(
                f"{name}: {number:g} {unit} is not above 0; correct it",
                code="not-above-zero",
                key=name,
            )
    gap = _gap(wanted, reach)
    load = _load(wanted, reach)
    if wanted.mass is not None:
        mass = Value(wanted.mass)
    else:
        mass = Value(nearest(load.number / GRAVITY), "the load is its weight")
    return Machine(mass, load, gap, (float(reach.gaps[0]), float(reach.gaps[-1])))


def _gap(wanted: Wanted, reach: MeasuredMagnet) -> Value:
    low, high = float(reach.gaps[0]), float(reach.gaps[-1])
    if reach.gaps.size < 2:
        raise InputError(
            f"loops at one gap only, {low:g} m: a bearing moves; measure loops at a smaller and a "
            "larger one",
            code="single-gap",
        )
    if wanted.gap is None:
        return Value(nearest(0.5 * (low + high), 3), "the middle of the measured gaps")
    gap, room = wanted.gap, ROOM * (high - low)
    if not low + room <= gap <= high - room:
        hints = [
            f", {gap:g}{exponent} m if {unit} are meant"
            for exponent, unit in (("e-3", "millimetres"), ("e-6", "micrometres"))
            if low < gap * float(f"1{exponent}") < high
        ]
        raise InputError(
            f"gap: {gap:g} m is not well within the measured gaps of {low:g} to {high:g} m, which "
            f"are the stops; give one from {low + room:g} to {high - room:g} m{''.join(hints)}",
            code="gaps-not-covered",
            key="gap",
        )
    return Value(gap)


def _load(wanted: Wanted, reach: MeasuredMagnet) -> Value:
    weakest = int(reach.forces.argmin())  # the largest gap, but of a solenoid with a cone
    reached, where = float(reach.forces[weakest]), float(reach.gaps[weakest])
    if wanted.load is not None:
        load = Value(wanted.load)
    elif wanted.mass is not None:
        load = Value(nearest(wanted.mass * GRAVITY, 3), "the weight of the mass")
    else:
        load = Value(down(USED * reached), f"{100.0 * USED:.0f} % of the force at {where:g} m")
    if load.number * LIFT > reached:
        origin = f", guessed as {load.guess}; give --load" if load.guess else ""
        raise InputError(
            f"load: {load.number:g} N cannot be lifted at a gap of {where:g} m: there the "
            f"loops reach {reached:.4g} N at {reach.current_high:.4g} A, and {LIFT:g} times the "
            f"load, {load.number * LIFT:.4g} N, are needed; lower it, or give loops of larger "
            f"currents or smaller gaps{origin}",
            code="load-too-large",
            key="load",
        )
    return load
