"""List all methods from force to current, and fit them to the same loops.

Single-valued maps and the map with one play operator are in :mod:`.current_map`. This module
contains the compiled inverse of the hysteresis, and the methods that correct a map or an inverse
with the flux density of a Hall probe. To add a method, write a file, a name in
:data:`~anhyst.support.kinds.MethodName`, and a row of `METHODS`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from anhyst import _core
from anhyst.compensate.block import Block
from anhyst.compensate.coil_flux import MAP_DEVIATION_SHARE, MAX_DEVIATION_SHARE, CoilFlux
from anhyst.compensate.current_map import (
    CurrentMap,
    fit_linearised_map,
    fit_play_map,
    fit_ratio_map,
    fit_secant_map,
    fit_single_valued_map,
    make_current_map,
    table_words,
)
from anhyst.compensate.force_controller import (
    REAL_CONTROLLERS,
    ForceController,
    MethodParameters,
    Native,
    SignalFormat,
)
from anhyst.compensate.plan import CompileRequest, make_plan, round_full_scale
from anhyst.compensate.sources import FluxCalibration, Sources
from anhyst.data.output_map import is_actuator
from anhyst.data.surface import Surface
from anhyst.model.actuator import Model
from anhyst.support.block_words import Scales
from anhyst.support.cache import cached_result
from anhyst.support.errors import InputError
from anhyst.support.kinds import MethodName, NumberFormat
from anhyst.support.numeric import FloatArray, first_order_share, to_factor, to_q31, to_smoothing_factor


def restrict_model(
    model: Model, currents: tuple[float, float], forces: tuple[float, float], gaps: tuple[float, float]
) -> Model:
    """Return a model whose valid range is that of one magnet of a bearing."""
    if not is_actuator(model):
        text = "model: a bearing needs a model from current to force"
        raise InputError(text, code="not-current-to-force", key="model")
    covered_gaps = model.valid_range.schedule
    if covered_gaps is None or gaps[0] < covered_gaps[0] - 1e-9 or gaps[1] > covered_gaps[1] + 1e-9:
        covered_text = (
            "no gap" if covered_gaps is None else f"gaps of {covered_gaps[0]:g} to {covered_gaps[1]:g} m"
        )
        raise InputError(
            f"model: is valid for {covered_text}, but needs {gaps[0]:g} to {gaps[1]:g} m; identify it "
            "from loops at more gaps, or narrow the range",
            code="gaps-not-covered",
            key="model",
        )
    valid_range = replace(model.valid_range, input=currents, output=forces, schedule=gaps)
    return replace(model, valid=valid_range)


@dataclass(frozen=True)
class HysteresisInverse:
    """Compiled inverse of the hysteresis."""

    block: Block  # parameter block in the number format of the controller
    iterations: int  # maximum number of iterations
    flux_full_scale = 1.0

    @property
    def scales(self) -> Scales:
        """Full scales of the block's signals."""
        return self.block.scales

    @property
    def constants(self) -> dict[str, float]:
        """Maximum number of iterations."""
        return {"iterations": float(self.iterations)}

    def native(self, number_format: NumberFormat) -> Native:
        """Return a new force controller of the core."""
        kind, words = self.block.kind, self.block.words
        if number_format == "fixed":
            return _core.FixedForceController.compensator(kind, words)
        return REAL_CONTROLLERS[number_format].compensator(kind, words)


def compile_static_inverse(sources: Sources, number_format: NumberFormat) -> HysteresisInverse:
    """Compile the full law without eddy-current lag, as for a laminated core."""
    model = None if sources.model is None else sources.model.at_rest
    return compile_inverse("full", replace(sources, model=model), number_format)


def compile_inverse(
    kind: Literal["full", "simplified"], sources: Sources, number_format: NumberFormat
) -> HysteresisInverse:
    """Compile the inverse of the hysteresis as for a controller.

    Floating point uses the tables of fixed point if the core is laminated and the force has one
    sign.
    """
    model, operating = sources.model, sources.operating
    if model is None:
        raise InputError("this method needs a model; identify one from the loops", code="no-model")
    restricted_model = restrict_model(model, operating.currents, operating.forces, operating.gap_range)
    has_layers = kind == "full" and restricted_model.has_layers
    restricted_model = restricted_model if has_layers else restricted_model.at_rest
    needs_float_tables = number_format != "fixed" and (has_layers or operating.is_bipolar)
    io: SignalFormat = "f32" if needs_float_tables else "q31"
    request = CompileRequest(kind, io, operating.rate)
    plan = cached_result("plans", lambda: make_plan(restricted_model, request, 0), restricted_model, request)
    block = plan.builder.dynamic_block(plan.sizes, number_format)
    return HysteresisInverse(block, plan.sizes.iterations)


@dataclass(frozen=True)
class FluxGains:
    """Gains of the feedback loop that corrects the current by the measured flux density."""

    proportional: float  # proportional gain, A/T
    integral: float  # integral gain per tick, A/T
    anti_windup: float  # fraction of a current's excess that the integral removes per tick
    # fraction of a step of the demanded flux density that is expected in the next tick
    smoothing: float
    crossover: float  # crossover frequency, rad/s
    flux_per_current: float  # at the operating force, mean of the gaps, T/A

    @property
    def as_array(self) -> FloatArray:
        """Gains in the order of ``anhyst_flux_loop``."""
        return np.array([self.proportional, self.integral, self.anti_windup, self.smoothing])


def design_flux_loop(
    calibration: FluxCalibration, surface: Surface, density: FloatArray, force: float, rate: float
) -> FluxGains:
    """Design the flux loop.

    The flux follows the current immediately, except for delay and lag. A pure integral would
    therefore close the loop. The proportional part cancels the lag once. The remaining loop is an
    integrator with a dead time: the delay plus half a tick. The crossover frequency is half the
    inverse of the dead time. Without lag, the phase margin is then 61 degrees. The proportional
    part treats the lag of several low-passes as one first-order lag, which reduces the margin: to
    52 degrees with amplifier and probe of the bundled bearing, and to 34 degrees with additional
    eddy currents of 100 us. The gain is that of the gap with the largest flux per current, so that
    no gap has a higher crossover.
    """
    tick = 1.0 / rate
    column = int(np.clip(np.searchsorted(surface.force, force), 1, surface.force.size - 2))
    neighbours = slice(column - 1, column + 2)
    flux_per_current = np.ptp(density[:, neighbours], axis=1) / np.ptp(surface.current[:, neighbours], axis=1)
    crossover = 0.5 / (calibration.delay + 0.5 * tick)
    integral = crossover / float(flux_per_current.max())
    return FluxGains(
        proportional=integral * calibration.lag,
        integral=integral * tick,
        anti_windup=min(1.0, crossover * tick),
        smoothing=_expected_share(calibration, tick),
        crossover=crossover,
        flux_per_current=float(flux_per_current.mean()),
    )


def _expected_share(calibration: FluxCalibration, tick: float) -> float:
    """Return the fraction of a step of the flux density that is expected in the next tick.

    The flux of a coil refers to the end of its tick, so that its mean delay is known exactly.
    """
    ticks = (calibration.delay + calibration.lag) / tick
    return first_order_share(1.0 / ticks) if calibration.coil is None else 1.0 / max(1.0, ticks)


MAX_ADDED_CURRENT_SHARE = 0.05
"""Largest current that a flux loop adds to the current of a law, relative to the largest current.
If the probe fails, the accuracy decreases, but the armature stays levitated."""


@dataclass(frozen=True)
class FluxLoop:
    """Correction of the current of a method by the measured flux density."""

    # demanded flux density, T, at the smallest and largest force, on a regular grid of gaps; shape
    # (g, 2). Between these forces, it is proportional to the square root of the force, or linear if
    # forces have both signs
    flux_table: FloatArray
    scales: Scales  # full scales of the method
    gains: FluxGains
    rate: float  # sample rate, Hz
    coil: CoilFlux | None = None  # estimator of the flux; None: Hall probe

    @cached_property
    def full_scale(self) -> float:
        """Flux density that 1.0 represents in fixed point, T."""
        return round_full_scale(float(self.flux_table.max()))

    @property
    def signal_full_scale(self) -> float:
        """Flux density, T, or voltage of the coil, V, that 1.0 represents in fixed point."""
        return self.full_scale if self.coil is None else self.coil.full_scale

    def with_coil(self, native: Native) -> Native:
        """Return a force controller with the estimator of this loop, if it has one."""
        if self.coil is not None:
            current = self.scales.current
            if isinstance(native, _core.FixedForceController):
                native.sense(self.coil.codes(self.full_scale, current))
            else:
                native.sense(self.coil.settings(self.full_scale, current))
        return native

    @property
    def constants(self) -> dict[str, float]:
        """Crossover frequency and gains."""
        return {
            "crossover_Hz": self.gains.crossover / (2.0 * math.pi),
            "k_p_A_per_T": self.gains.proportional,
            "k_i_A_per_T_s": self.gains.integral * self.rate,
        }

    def words(self) -> tuple[NDArray[np.int16], NDArray[np.int16]]:
        """Return table and gains as fixed-point words."""
        flux_per_current = self.full_scale / self.scales.current
        rows = [
            to_factor("proportional gain of the flux loop", self.gains.proportional * flux_per_current),
            to_factor("integral gain of the flux loop", self.gains.integral * flux_per_current),
            to_factor("anti-windup of the flux loop", self.gains.anti_windup),
            to_smoothing_factor("delay of the flux loop", self.gains.smoothing),
        ]
        flux_words = table_words(self.flux_table, self.full_scale, "flux density")
        return flux_words, np.array(rows, dtype=np.int16)


def _make_flux_loop(
    sources: Sources, surface: Surface, scales: Scales, max_deviation: float = MAX_DEVIATION_SHARE
) -> FluxLoop:
    """Design the flux loop for a method with given scales.

    `max_deviation` is the largest deviation of a flux that is estimated from a coil's voltage.
    """
    operating, calibration = sources.operating, sources.flux_calibration
    if calibration is None:
        raise InputError("flux: needs a Hall probe and its calibration", code="no-hall-probe", key="flux")
    sensor = calibration.coil
    density = calibration.density_at(surface.force, surface.gap)
    gains = design_flux_loop(calibration, surface, density, operating.force, operating.rate)
    force_range = np.array([-operating.is_bipolar * scales.demand, scales.demand])
    gap = np.linspace(scales.gap_low, scales.gap_high, surface.gap.size)
    flux_table = np.ascontiguousarray(calibration.density_at(force_range, gap))
    coil = None if sensor is None else CoilFlux(sensor, operating.rate, gains.flux_per_current, max_deviation)
    return FluxLoop(flux_table, scales, gains, operating.rate, coil)


@dataclass(frozen=True)
class FluxFeedback:
    """Current map with a correction by the measured flux density."""

    map: CurrentMap  # current map
    loop: FluxLoop

    @property
    def scales(self) -> Scales:
        """Full scales of the map's signals."""
        return self.map.scales

    @property
    def flux_full_scale(self) -> float:
        """Flux density, T, or voltage, V, that 1.0 represents in fixed point."""
        return self.loop.signal_full_scale

    @property
    def constants(self) -> dict[str, float]:
        """Crossover frequency and gains of the flux loop."""
        return self.loop.constants

    def native(self, number_format: NumberFormat) -> Native:
        """Return a new force controller of the core."""
        table, loop = self.map, self.loop
        if number_format == "fixed":
            codes = table.entry_words(), *loop.words(), *table.limit_codes()
            return loop.with_coil(_core.FixedForceController.flux(*codes))
        tables = table.entries, loop.flux_table, loop.gains.as_array
        return loop.with_coil(REAL_CONTROLLERS[number_format].flux(*tables, *table.real_arguments()))


def fit_flux_feedback(sources: Sources, _: NumberFormat) -> FluxFeedback:
    """Design the flux loop for the best single-valued map."""
    surface = sources.surface()
    table = make_current_map(surface.current, sources.operating, {})
    return FluxFeedback(table, _make_flux_loop(sources, surface, table.scales, MAP_DEVIATION_SHARE))


@dataclass(frozen=True)
class FusedInverse:
    """Inverse of the hysteresis with a correction by the measured flux density."""

    inverse: HysteresisInverse
    loop: FluxLoop
    limits: tuple[float, float]  # limits of the current, A
    force_low: float  # smallest force of the flux table, N

    @property
    def max_added_current(self) -> float:
        """Largest current that the loop adds, A."""
        return MAX_ADDED_CURRENT_SHARE * self.limits[1]

    @property
    def scales(self) -> Scales:
        """Full scales of the inverse's signals."""
        return self.inverse.scales

    @property
    def flux_full_scale(self) -> float:
        """Flux density, T, or voltage, V, that 1.0 represents in fixed point."""
        return self.loop.signal_full_scale

    @property
    def constants(self) -> dict[str, float]:
        """Constants of the inverse and of the flux loop."""
        return self.inverse.constants | self.loop.constants

    def native(self, number_format: NumberFormat) -> Native:
        """Return a new force controller of the core."""
        native, scales = self.inverse.native(number_format), self.scales
        if isinstance(native, _core.FixedForceController):
            codes = (to_q31(end / scales.current) for end in (self.max_added_current, *self.limits))
            native.fuse(*self.loop.words(), *codes)
        else:
            ends = self.force_low, scales.demand, scales.gap_low, scales.gap_high
            native.fuse(
                self.loop.flux_table, self.loop.gains.as_array, self.max_added_current, *ends, *self.limits
            )
        return self.loop.with_coil(native)


def compile_fused_inverse(sources: Sources, number_format: NumberFormat) -> FusedInverse:
    """Compile the full law, and design its flux loop."""
    inverse, operating = compile_inverse("full", sources, number_format), sources.operating
    force_low = -operating.is_bipolar * inverse.scales.demand
    loop = _make_flux_loop(sources, sources.surface(), inverse.scales)
    return FusedInverse(inverse, loop, operating.currents, force_low)


Role = Literal["baseline", "model", "sensor"]


@dataclass(frozen=True, slots=True)
class Method:
    """One method that calculates a current from a force."""

    # ``"model"``: uses a model; ``"sensor"``: uses a Hall probe; ``"baseline"``: uses neither
    role: Role
    # function that fits the parameters to the sources, for a number format
    fit: Callable[[Sources, NumberFormat], MethodParameters]


METHODS: Mapping[MethodName, Method] = {
    "ratio": Method("baseline", fit_ratio_map),
    "secant": Method("baseline", fit_secant_map),
    "linearised": Method("baseline", fit_linearised_map),
    "single-valued": Method("baseline", fit_single_valued_map),
    "play": Method("baseline", fit_play_map),
    "simplified": Method("model", partial(compile_inverse, "simplified")),
    "at-rest": Method("model", compile_static_inverse),
    "full": Method("model", partial(compile_inverse, "full")),
    "flux": Method("sensor", fit_flux_feedback),
    "fused": Method("model", compile_fused_inverse),
}

BASELINE_METHODS = tuple(name for name, method in METHODS.items() if method.role == "baseline")
MODEL_METHODS = tuple(name for name, method in METHODS.items() if method.role == "model")


def make_compensator(method: MethodName, sources: Sources, number_format: NumberFormat) -> ForceController:
    """Fit a method, and return its force controller."""
    return ForceController(method, number_format, METHODS[method].fit(sources, number_format))
