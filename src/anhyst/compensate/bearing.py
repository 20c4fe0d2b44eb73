"""A model where a levitating armature uses it."""

from __future__ import annotations

from dataclasses import replace

from anhyst.data.output_map import is_actuator
from anhyst.model.actuator import Model
from anhyst.model.fit_record import ValidRange
from anhyst.support.errors import InputError


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
