"""Collect the inputs of a force controller: measured loops or a model, and the operating range.

If no loops were measured, :func:`simulate_loops` simulates loops of the model.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from anhyst.compensate.coil_flux import CoilSensor
from anhyst.compensate.plan import find_limits, round_full_scale
from anhyst.data import History, Loop, Loops
from anhyst.data.output_map import is_electromagnet
from anhyst.data.surface import Surface, fit_surface
from anhyst.model.actuator import Model
from anhyst.model.predict import slow_times
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray


@dataclass(frozen=True)
class FluxCalibration:
    """Static measurements with the Hall probe, and the dynamics of the current.

    With a coil instead of a probe, the flux density is the flux linkage of the coil, Wb.
    """

    gap: FloatArray  # gap in m, force in N, measured flux density in T; shape (n,)
    force: FloatArray
    flux_density: FloatArray
    delay: float  # time from a sample to the output of its current, s
    # lag of the measured flux density after the reference of the current, s: amplifier, eddy
    # currents and probe together
    lag: float
    coil: CoilSensor | None = None  # sensor of a coil's voltage; None: Hall probe

    def __post_init__(self) -> None:
        for name in ("gap", "force", "flux_density"):
            values = np.asarray(getattr(self, name), dtype=np.float64)
            if values.ndim != 1 or values.size != np.size(self.force) or values.size == 0:
                text = f"flux calibration: {name} must have one value per point"
                raise InputError(text, code="length-differs", key=name)
            if not np.isfinite(values).all():
                raise InputError(
                    f"flux calibration: {name} contains a value that is not a number",
                    code="not-finite",
                    key=name,
                )
            object.__setattr__(self, name, values)
        if not (self.delay > 0.0 and self.lag >= 0.0):
            text = "flux calibration: the delay must be above zero, and the lag at least zero"
            raise InputError(text, code="delay-not-above-zero")

    def density_at(self, force: FloatArray, gap: FloatArray) -> FloatArray:
        """Return the flux density for a force, T; shape (gaps, forces).

        At each measured gap, the density is a fitted constant times the square root of the force.
        With forces of both signs, it is a fitted straight line. It is interpolated between the
        gaps.
        """
        knots = np.unique(self.gap)
        if force[0] < 0.0:
            line_fits = [np.polyfit(*self._points_at(knot), 1) for knot in knots.tolist()]
            slope, intercept = (np.interp(gap, knots, column)[:, None] for column in np.transpose(line_fits))
            return np.asarray(intercept + slope * force)
        constants = []
        for knot in knots.tolist():
            rows = (self.gap == knot) & (self.force > 0.0)
            root = np.sqrt(self.force[rows])
            constant = float(root @ self.flux_density[rows] / (root @ root)) if rows.any() else 0.0
            if not constant > 0.0:
                text = (
                    f"flux calibration: at gap {knot:g} m the flux density does not increase with the force"
                )
                raise InputError(text, code="not-monotone")
            constants.append(constant)
        return np.asarray(np.interp(gap, knots, constants)[:, None] * np.sqrt(force)[None, :])

    def _points_at(self, gap: float) -> tuple[FloatArray, FloatArray]:
        at_gap = self.gap == gap
        return self.force[at_gap], self.flux_density[at_gap]


@dataclass(frozen=True)
class OperatingRange:
    """Operating point of a magnet, and its limits."""

    gap: float  # gap of the operating point, m
    force: float  # force of the operating point, N
    rate: float  # sample rate, Hz
    gap_range: tuple[float, float]  # smallest and largest gap of the controller, m
    force_max: float  # largest demanded force, N
    current_max: float  # largest current, A
    is_bipolar: bool = False  # whether the ranges of force and current are symmetric about zero

    @property
    def forces(self) -> tuple[float, float]:
        """Smallest and largest force, N."""
        return -self.is_bipolar * self.force_max, self.force_max

    @property
    def currents(self) -> tuple[float, float]:
        """Smallest and largest current, A."""
        return -self.is_bipolar * self.current_max, self.current_max

    def __post_init__(self) -> None:
        low, high = self.gap_range
        if not 0.0 <= low < self.gap < high:
            text = f"gap: {self.gap:g} m is not within {low:g} to {high:g} m"
            raise InputError(text, code="out-of-range", key="gap")
        low, high = self.forces
        if not low < self.force < high:
            text = f"force: {self.force:g} N is not within {low:g} to {high:g} N"
            raise InputError(text, code="out-of-range", key="force")
        if not (self.rate > 0.0 and self.current_max > 0.0):
            raise InputError("rate and largest current must be above zero", code="not-above-zero")


@dataclass(frozen=True)
class Sources:
    """Available information about a magnet; each method uses what it needs."""

    operating: OperatingRange  # operating point and limits
    loops: Loops | None = None  # loops, current to force; required by methods without a model
    model: Model | None = None  # model of the same loops; required by methods with a model
    # Hall probe; required by methods that measure the flux density
    flux_calibration: FluxCalibration | None = None

    def surface(self) -> Surface:
        """Return the best single-valued current over force and gap, fitted to the loops."""
        if self.loops is None:
            raise InputError("this method needs the measured loops; give them", code="no-loops")
        operating = self.operating
        full_scale_force = round_full_scale(operating.force_max)
        return fit_surface(
            self.loops, (-operating.is_bipolar * full_scale_force, full_scale_force), operating.gap_range
        )


LOOP_GAPS = 7
"""Number of gaps at which loops of a model are simulated."""

MINOR_LOOP_REVERSALS = (0.9, 0.1, 0.8, 0.2, 0.7, 0.3, 0.6, 0.4, 0.8, 0.6, 0.75, 0.65)
"""Reversal points of the current in a record of minor loops, relative to the largest current."""

RAMP_SAMPLES = 150
"""Number of samples from zero to the largest current."""


def find_operating_range(model: Model, rate: float) -> OperatingRange:
    """Return the operating range of a model: its whole valid range."""
    if not is_electromagnet(model) or model.valid is None or model.valid.schedule is None:
        raise InputError(
            "--kind play is for a magnet: current to force at several gaps, with [valid]; compile "
            "it with --kind full",
            code="option-not-for-this",
            key="--kind",
        )
    limits, gaps = find_limits(model), model.valid.schedule
    if not 0.0 <= gaps[0] < gaps[1]:
        text = "[valid]: --kind play needs a range of gaps; identify at several"
        raise InputError(text, code="single-gap", key="valid")
    middle, force = 0.5 * (gaps[0] + gaps[1]), limits.demand[1]
    return OperatingRange(middle, 0.5 * force, rate, gaps, force, limits.current[1])


def simulate_loops(model: Model, operating: OperatingRange) -> Loops:
    """Return the major loop and minor loops of a model at several gaps."""
    current_max = operating.current_max
    loops = []
    for gap in np.linspace(*operating.gap_range, LOOP_GAPS).tolist():
        drive = _make_drive((0.0, 1.0, 0.0), current_max)
        loops.append(_simulate_record(model, "whole", drive, 0, gap, History("settled")))
        history_drive = _make_drive((0.0, 1.0, 0.0, 1.0, 0.0), current_max)
        drive = np.concatenate(
            [history_drive[:-1], _make_drive((0.0, *MINOR_LOOP_REVERSALS, 0.0), current_max)]
        )
        history = History("conditioned", (0.0, current_max, 0.0, current_max, 0.0))
        loops.append(_simulate_record(model, "nested", drive, history_drive.size - 1, gap, history))
    return Loops(tuple(loops), model.input, model.output, model.schedule)


def _make_drive(reversals: Sequence[float], current_max: float) -> FloatArray:
    return current_max * np.append(np.concatenate(make_ramps(reversals, RAMP_SAMPLES)), reversals[-1])


def make_ramps(reversals: Sequence[float], samples: int) -> list[FloatArray]:
    """Return the ramps between reversals, each without its last point.

    `samples` is the number of samples per unit of travel.
    """
    return [
        np.linspace(start, end, max(2, round(samples * abs(end - start))), endpoint=False)
        for start, end in pairwise(reversals)
    ]


def _simulate_record(
    model: Model, label: str, drive: FloatArray, first_sample: int, gap: float, history: History
) -> Loop:
    """Return a simulated record without its first samples, which are its history."""
    initial_state = "settled" if history.kind == "settled" else "demagnetised"
    force = model.predict(drive, gap, slow_times(drive.size), initial_state).output
    gaps = np.full(drive.size - first_sample, gap)
    return Loop(label, drive[first_sample:], force[first_sample:], gaps, history=history)
