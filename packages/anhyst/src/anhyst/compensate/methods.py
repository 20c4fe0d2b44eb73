"""Every method from a wanted force to a current, each fitted to the same loops.

Those without memory or with one play are in :mod:`.current_map`; those with a model, the inverse of
the hysteresis, compiled as for a controller, and those that correct either by a Hall probe stand
here. A later one is a file of its own, a name in :data:`~anhyst.support.kinds.MethodName`, and a
row of `METHODS`.
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
    Io,
    MethodParameters,
    Native,
)
from anhyst.compensate.plan import CompileRequest, make_plan, round_full_scale
from anhyst.compensate.sources import FluxCalibration, Sources
from anhyst.data.output_map import is_actuator
from anhyst.data.surface import Surface
from anhyst.model.actuator import Model
from anhyst.model.schema import ValidRange
from anhyst.support.block_words import Scales
from anhyst.support.cache import cached_result
from anhyst.support.errors import InputError
from anhyst.support.kinds import MethodName, NumberFormat
from anhyst.support.numeric import (
    FloatArray,
    first_order_share,
    to_factor,
    to_q31,
    to_smoothing_factor,
)


def restrict_model(
    model: Model,
    currents: tuple[float, float],
    forces: tuple[float, float],
    gaps: tuple[float, float],
) -> Model:
    """Return a model that holds for one magnet of a bearing, and no further."""
    if not is_actuator(model):
        text = "model: a bearing needs one from current to force"
        raise InputError(text, code="not-current-to-force", key="model")
    covered = model.valid_range.schedule
    if covered is None or gaps[0] < covered[0] - 1e-9 or gaps[1] > covered[1] + 1e-9:
        covered_text = (
            "no gap" if covered is None else f"gaps of {covered[0]:g} to {covered[1]:g} m"
        )
        raise InputError(
            f"model: holds at {covered_text}, wanted are {gaps[0]:g} to {gaps[1]:g} m; identify it "
            "from loops at more gaps or narrow the range",
            code="gaps-not-covered",
            key="model",
        )
    return replace(model, valid=ValidRange(currents, forces, gaps))


@dataclass(frozen=True)
class HysteresisInverse:
    """The inverse of hysteresis, compiled."""

    block: Block  # in the number format of the controller
    iterations: int  # evaluations of a search
    flux_full_scale = 1.0

    @property
    def scales(self) -> Scales:
        """Full scales of the block."""
        return self.block.scales

    @property
    def constants(self) -> dict[str, float]:
        """Evaluations of a search."""
        return {"iterations": float(self.iterations)}

    def native(self, number_format: NumberFormat) -> Native:
        """Return the core's own."""
        kind, words = self.block.kind, self.block.words
        if number_format == "fixed":
            return _core.FixedForceController.compensator(kind, words)
        return REAL_CONTROLLERS[number_format].compensator(kind, words)


def compile_static_inverse(sources: Sources, number_format: NumberFormat) -> HysteresisInverse:
    """Compile the full law as if its iron were thin: without what answers late."""
    model = None if sources.model is None else sources.model.at_rest
    return compile_inverse("full", replace(sources, model=model), number_format)


def compile_inverse(
    kind: Literal["full", "simplified"], sources: Sources, number_format: NumberFormat
) -> HysteresisInverse:
    """Compile as for a controller; floats of thin iron that pulls take the tables of fixed point."""
    model, operating = sources.model, sources.operating
    if model is None:
        raise InputError("this method needs a model; identify one from the loops", code="no-model")
    restricted = restrict_model(model, operating.currents, operating.forces, operating.gap_range)
    has_layers = kind == "full" and restricted.has_layers
    restricted = restricted if has_layers else restricted.at_rest
    needs_float_tables = number_format != "fixed" and (has_layers or operating.is_bipolar)
    io: Io = "f32" if needs_float_tables else "q31"
    request = CompileRequest(kind, io, operating.rate)
    plan = cached_result("plans", lambda: make_plan(restricted, request, 0), restricted, request)
    block = plan.builder.dynamic_block(plan.sizes, number_format)
    return HysteresisInverse(block, plan.sizes.iterations)


@dataclass(frozen=True)
class FluxGains:
    """How the measured flux density corrects the current."""

    proportional: float  # A/T
    integral: float  # in a tick, A/T
    anti_windup: float  # share of an excess of current that the integral removes in one tick
    # share of a step of the wanted flux density that is expected to show a tick later
    smoothing: float
    crossover: float  # of the flux loop, rad/s

    @property
    def as_array(self) -> FloatArray:
        """The gains in the order of ``anhyst_flux_loop``."""
        return np.array([self.proportional, self.integral, self.anti_windup, self.smoothing])


def design_flux_loop(
    calibration: FluxCalibration, surface: Surface, density: FloatArray, force: float, rate: float
) -> FluxGains:
    """Design the flux loop.

    The flux follows the current at once but for delay and lag, so an integral alone would close the
    loop. The proportional part takes the lag away, once; what is left is an integral behind the
    delay and half a tick, the integral's own. The crossover is half the inverse of these two. That
    leaves a phase margin of 61 degrees without lag. The proportional part takes the lag of several
    low-passes for that of one, which costs some: 52 degrees are left behind amplifier and probe of
    the bundled bearing, 34 where eddy currents of 100 us come on top. The gain is that of the gap
    where the flux answers most, so that no gap is faster than designed.
    """
    tick = 1.0 / rate
    column = int(np.clip(np.searchsorted(surface.force, force), 1, surface.force.size - 2))
    neighbours = slice(column - 1, column + 2)
    flux_per_current = np.ptp(density[:, neighbours], axis=1) / np.ptp(
        surface.current[:, neighbours], axis=1
    )
    crossover = 0.5 / (calibration.delay + 0.5 * tick)
    integral = crossover / float(flux_per_current.max())
    return FluxGains(
        proportional=integral * calibration.lag,
        integral=integral * tick,
        anti_windup=min(1.0, crossover * tick),
        smoothing=first_order_share(tick / (calibration.delay + calibration.lag)),
        crossover=crossover,
    )


MAX_ADDED_CURRENT_SHARE = 0.05
"""Of the largest current: what a flux loop adds to that of a law at most, so that a probe that fails
costs accuracy and not the flight."""


@dataclass(frozen=True)
class FluxLoop:
    """How the measured flux density corrects the current of a method."""

    # T, at both ends of the force, on equal steps of the gap; shape (g, 2). Between them it goes with
    # the root of the force, or where that has a sign, straight with it
    flux_table: FloatArray
    scales: Scales  # of the method
    gains: FluxGains
    rate: float  # ticks a second, Hz

    @cached_property
    def full_scale(self) -> float:
        """Flux density that counts as 1.0 in fixed point, T."""
        return round_full_scale(float(self.flux_table.max()))

    @property
    def constants(self) -> dict[str, float]:
        """Crossover and gains."""
        return {
            "crossover_Hz": self.gains.crossover / (2.0 * math.pi),
            "k_p_A_per_T": self.gains.proportional,
            "k_i_A_per_T_s": self.gains.integral * self.rate,
        }

    def words(self) -> tuple[NDArray[np.int16], NDArray[np.int16]]:
        """Return table and gains as fixed point takes them."""
        flux_per_current = self.full_scale / self.scales.current
        rows = [
            to_factor("proportional of the flux loop", self.gains.proportional * flux_per_current),
            to_factor("integral of the flux loop", self.gains.integral * flux_per_current),
            to_factor("anti-windup of the flux loop", self.gains.anti_windup),
            to_smoothing_factor("delay of the flux loop", self.gains.smoothing),
        ]
        wanted = table_words(self.flux_table, self.full_scale, "flux density")
        return wanted, np.array(rows, dtype=np.int16)


def _make_flux_loop(sources: Sources, surface: Surface, scales: Scales) -> FluxLoop:
    """Design the loop around a method with these scales."""
    operating, calibration = sources.operating, sources.flux_calibration
    if calibration is None:
        raise InputError(
            "flux: needs a Hall probe and its calibration", code="no-hall-probe", key="flux"
        )
    density = calibration.density_at(surface.force, surface.gap)
    gains = design_flux_loop(calibration, surface, density, operating.force, operating.rate)
    force_range = np.array([-operating.is_bipolar * scales.demand, scales.demand])
    gap = np.linspace(scales.gap_low, scales.gap_high, surface.gap.size)
    flux_table = np.ascontiguousarray(calibration.density_at(force_range, gap))
    return FluxLoop(flux_table, scales, gains, operating.rate)


@dataclass(frozen=True)
class FluxFeedback:
    """A map, corrected by the measured flux density."""

    map: CurrentMap  # current over force and gap
    loop: FluxLoop

    @property
    def scales(self) -> Scales:
        """Full scales of the map."""
        return self.map.scales

    @property
    def flux_full_scale(self) -> float:
        """Flux density that counts as 1.0 in fixed point, T."""
        return self.loop.full_scale

    @property
    def constants(self) -> dict[str, float]:
        """Crossover and gains of the flux loop."""
        return self.loop.constants

    def native(self, number_format: NumberFormat) -> Native:
        """Return the core's own."""
        table, loop = self.map, self.loop
        if number_format == "fixed":
            return _core.FixedForceController.flux(
                table.entry_words(), *loop.words(), *table.limit_codes()
            )
        tables = table.entries, loop.flux_table, loop.gains.as_array
        return REAL_CONTROLLERS[number_format].flux(*tables, *table.real_arguments())


def fit_flux_feedback(sources: Sources, _: NumberFormat) -> FluxFeedback:
    """Design the flux loop around the best current without memory."""
    surface = sources.surface()
    table = make_current_map(surface.current, sources.operating, {})
    return FluxFeedback(table, _make_flux_loop(sources, surface, table.scales))


@dataclass(frozen=True)
class FusedInverse:
    """The inverse of the hysteresis, corrected by the measured flux density."""

    inverse: HysteresisInverse
    loop: FluxLoop
    limits: tuple[float, float]  # of the current, A
    force_low: float  # of the table of the flux density, N

    @property
    def max_added_current(self) -> float:
        """Current that the loop adds at most, A."""
        return MAX_ADDED_CURRENT_SHARE * self.limits[1]

    @property
    def scales(self) -> Scales:
        """Full scales of the inverse."""
        return self.inverse.scales

    @property
    def flux_full_scale(self) -> float:
        """Flux density that counts as 1.0 in fixed point, T."""
        return self.loop.full_scale

    @property
    def constants(self) -> dict[str, float]:
        """Numbers of the inverse and of the flux loop."""
        return self.inverse.constants | self.loop.constants

    def native(self, number_format: NumberFormat) -> Native:
        """Return the core's own."""
        native, scales = self.inverse.native(number_format), self.scales
        if isinstance(native, _core.FixedForceController):
            codes = (to_q31(end / scales.current) for end in (self.max_added_current, *self.limits))
            native.fuse(*self.loop.words(), *codes)
        else:
            ends = self.force_low, scales.demand, scales.gap_low, scales.gap_high
            native.fuse(
                self.loop.flux_table,
                self.loop.gains.as_array,
                self.max_added_current,
                *ends,
                *self.limits,
            )
        return native


def compile_fused_inverse(sources: Sources, number_format: NumberFormat) -> FusedInverse:
    """Compile the full law, and design the flux loop around it."""
    inverse, operating = compile_inverse("full", sources, number_format), sources.operating
    force_low = -operating.is_bipolar * inverse.scales.demand
    loop = _make_flux_loop(sources, sources.surface(), inverse.scales)
    return FusedInverse(inverse, loop, operating.currents, force_low)


Role = Literal["baseline", "model", "sensor"]


@dataclass(frozen=True, slots=True)
class Method:
    """One way from a wanted force to a current."""

    # ``"model"``: with a model of the iron; ``"sensor"``: with another sensor; ``"baseline"``: with
    # neither
    role: Role
    # from what is known of a magnet and a number format to the parameters
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


def make_compensator(
    method: MethodName, sources: Sources, number_format: NumberFormat
) -> ForceController:
    """Fit a way from force to current."""
    return ForceController(method, number_format, METHODS[method].fit(sources, number_format))
