"""Methods with a model: the inverse of the hysteresis, compiled as for a controller."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

from anhyst import _core
from anhyst.compensate.block import Block
from anhyst.compensate.floating import RealBlock, build_real
from anhyst.compensate.force_controller import Native
from anhyst.compensate.plan import CompileRequest, make_plan
from anhyst.compensate.scheduled import full_kind
from anhyst.compensate.sources import Sources
from anhyst.compensate.twin import Io
from anhyst.data.output_map import is_actuator
from anhyst.model.actuator import Model
from anhyst.model.compilable import has_layers
from anhyst.model.fit_record import ValidRange
from anhyst.support.block_words import Scales
from anhyst.support.errors import InputError
from anhyst.support.kept import kept
from anhyst.support.kinds import NumberFormat


def bearing_model(
    model: Model,
    currents: tuple[float, float],
    forces: tuple[float, float],
    gaps: tuple[float, float],
) -> Model:
    """Return a model that holds for one magnet of a bearing, and no further."""
    if not is_actuator(model):
        raise InputError(
            "model: a bearing needs one from current to force",
            code="not-current-to-force",
            key="model",
        )
    if model.valid is None:
        raise InputError(
            "model: does not say where it holds; identify it from loops",
            code="no-valid-range",
            key="valid",
        )
    seen = model.valid.schedule
    if seen is None or gaps[0] < seen[0] - 1e-9 or gaps[1] > seen[1] + 1e-9:
        known = "no gap" if seen is None else f"gaps of {seen[0]:g} to {seen[1]:g} m"
        raise InputError(
            f"model: holds at {known}, wanted are {gaps[0]:g} to {gaps[1]:g} m; identify it "
            "from loops at more gaps or narrow the range",
            code="gaps-not-covered",
            key="model",
        )
    return replace(model, valid=ValidRange(currents, forces, gaps))


@dataclass(frozen=True)
class HysteresisInverse:
    """The inverse of hysteresis, compiled."""

    block: Block | RealBlock  # for fixed point or for floating point
    iterations: int  # evaluations of a search
    flux_full_scale = 1.0

    @property
    def scales(self) -> Scales:
        """Those of the block."""
        return self.block.scales

    @property
    def numbers(self) -> dict[str, float]:
        """Evaluations of a search."""
        return {"iterations": float(self.iterations)}

    def native(self, number_format: NumberFormat) -> Native:
        """Return the core's own."""
        block = self.block
        if isinstance(block, Block):
            return _core.FixedForceController.compensator(block.kind, block.words)
        parts = block.kind, block.numbers, block.gaps, block.tables
        if number_format == "f32":
            return _core.ForceControllerF32.compensator(_core.ParametersF32(*parts))
        return _core.ForceController.compensator(_core.Parameters(*parts))


def full_inverse(sources: Sources, number_format: NumberFormat) -> HysteresisInverse:
    """Compile the full law."""
    return _compile("full", sources, number_format)


def full_inverse_at_rest(sources: Sources, number_format: NumberFormat) -> HysteresisInverse:
    """Compile the full law as if its iron were thin: without what answers late."""
    model = None if sources.model is None else sources.model.at_rest
    return _compile("full", replace(sources, model=model), number_format)


def simplified_inverse(sources: Sources, number_format: NumberFormat) -> HysteresisInverse:
    """Compile the simplified law."""
    return _compile("simplified", sources, number_format)


def _compile(
    kind: Literal["full", "simplified"], sources: Sources, number_format: NumberFormat
) -> HysteresisInverse:
    """Compile as for a controller; floats of thin iron that pulls take the tables of fixed point."""
    model, where = sources.model, sources.operating
    if model is None:
        raise InputError("this method needs a model; identify one from the loops", code="no-model")
    narrowed = bearing_model(model, where.currents, where.forces, where.gap_range)
    solid = kind == "full" and has_layers(narrowed)
    narrowed = narrowed if solid else narrowed.at_rest
    own = number_format != "fixed" and (solid or where.both_ways)  # tables for floats
    io: Io = "f32" if own else "q31"
    request = CompileRequest(kind, io, where.rate)
    plan = kept("plans", lambda: make_plan(narrowed, request, 0), narrowed, request)
    block = plan.block
    if number_format != "fixed" and not own:
        law = plan.builder.law if kind == "simplified" else None
        made = full_kind(plan.model) if kind == "full" else kind
        parts = plan.model, made, block.scales, block.limits, plan.sizes
        block = build_real(*parts, plan.start.conditioning, law)
    return HysteresisInverse(block, plan.sizes.iterations)
