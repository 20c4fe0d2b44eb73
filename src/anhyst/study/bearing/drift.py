"""Plants that have drifted away from what their controller was made for."""

from __future__ import annotations

from dataclasses import asdict, dataclass, fields, replace

import numpy as np

from anhyst._core import Plant
from anhyst.compensate.irons import cell_weights
from anhyst.laws.law import Role
from anhyst.laws.registry import law_of
from anhyst.model.actuator import Model
from anhyst.model.file import read_model
from anhyst.model.parameters import Parameter
from anhyst.rig.bearing.file import BearingRig
from anhyst.rig.bearing.plant import make_bearing, make_magnet
from anhyst.rig.tables import SpreadTable
from anhyst.study.bearing.variations import changed

CUT = 3.0
"""Standard deviations at which the distribution of a change ends."""


@dataclass(frozen=True, slots=True)
class Drift:
    """How far one plant is from the one in the rig file."""

    pinning: float = 0.0  # relative changes: 0.1 is 10 % more
    reversible: float = 0.0
    saturation: float = 0.0
    mass: float = 0.0
    resistance: float = 0.0
    # gain errors of the sensors; that of the position around the operating gap
    position_gain: float = 0.0
    current_gain: float = 0.0
    flux_gain: float = 0.0
    gap_offset: float = 0.0  # error of the position sensor at the operating gap, m

    def as_dict(self) -> dict[str, float]:
        """Return it with units in the keys."""
        given = asdict(self)
        offset = given.pop("gap_offset")
        return {f"{name}_percent": 100.0 * value for name, value in given.items()} | {
            "gap_offset_m": offset
        }


def draw_drift(spread: SpreadTable, rng: np.random.Generator) -> Drift:
    """Draw a plant."""
    gain = spread.sensor_gain_percent
    deviations = {
        "pinning": 0.01 * spread.pinning_percent,
        "reversible": 0.01 * spread.reversible_percent,
        "saturation": 0.01 * spread.saturation_percent,
        "mass": 0.01 * spread.mass_percent,
        "resistance": 0.01 * spread.resistance_percent,
        "position_gain": 0.01 * gain,
        "current_gain": 0.01 * gain,
        "flux_gain": 0.01 * gain,
        "gap_offset": spread.gap_zero_m,
    }
    return Drift(**{one.name: deviations[one.name] * _normal(rng) for one in fields(Drift)})


def drifted_rig(rig: BearingRig, drift: Drift) -> BearingRig:
    """Return the rig of a plant that has drifted; the law of an identified magnet stays.

    The gain error of the position sensor turns its reading around the operating gap, so that gain
    and offset are two things.
    """
    settings = rig.settings
    body = settings.body
    sensor, shunt, hall = settings.gap_sensor, settings.current_sensor, settings.hall_probe
    turned = drift.position_gain * settings.gap_m
    changes = {
        "magnet.resistance_ohm": settings.magnet.poles.resistance * (1.0 + drift.resistance),
        "body.mass_kg": body.mass_kg * (1.0 + drift.mass),
        "gap_sensor.gain_error": sensor.gain_error + drift.position_gain,
        "gap_sensor.offset_m": sensor.offset_m + drift.gap_offset - turned,
        "current_sensor.gain_error": shunt.gain_error + drift.current_gain,
    }
    if hall is not None:
        changes["hall_probe.gain_error"] = hall.gain_error + drift.flux_gain
    if settings.iron is not None:
        iron = settings.iron.drifted(drift.pinning, drift.reversible, drift.saturation)
        changes |= {f"iron.{key}": value for key, value in iron.items()}
    return changed(rig, changes)


def drifted_law(model: Model, drift: Drift) -> Model:
    """Return the law of a magnet that has drifted: its pinning, reversible part and saturation."""
    if model.operator_law.cells is not None:
        return _drifted_cells(model, drift)
    factors: dict[Role, float] = {
        "pinning": 1.0 + drift.pinning,
        "reversible": 1.0 + drift.reversible,
        "saturation": 1.0 + drift.saturation,
    }
    changed: dict[str, Parameter] = {}
    for role, factor in factors.items():
        for spec in model.operator_law.with_role(role):
            value = model.parameters[spec.name]
            changed[spec.name] = (
                tuple(min(factor * one, spec.high) for one in value)
                if isinstance(value, tuple)
                else min(factor * value, spec.high)
            )
    return replace(model, parameters={**model.parameters, **changed})


def _drifted_cells(model: Model, drift: Drift) -> Model:
    """Return the same of a law of cells, as weights: of cell 0, which nothing pins, and of the rest."""
    cells = cell_weights(model)
    shares = cells.weights.sum(axis=1) / cells.saturation
    free = min(float(shares[0]) * (1.0 + drift.reversible), 1.0)
    factors = np.full(shares.size, (1.0 - free) / (1.0 - shares[0]) if shares[0] < 1.0 else 1.0)
    factors[0] = free / shares[0] if shares[0] > 0.0 else 1.0
    other = replace(
        cells,
        thresholds=(1.0 + drift.pinning) * cells.thresholds,
        weights=(1.0 + drift.saturation) * factors[:, None] * cells.weights,
    )
    gone = {spec.name for spec in model.operator_law.parameters}
    gone -= {spec.name for spec in law_of(model.law, other).parameters}
    kept = {name: value for name, value in model.parameters.items() if name not in gone}
    return replace(model, cells=other, parameters=kept)


def drifted_bearing(rig: BearingRig, drift: Drift, seed: int) -> Plant:
    """Return a plant that has drifted, at rest."""
    other = drifted_rig(rig, drift)
    law = None if rig.model is None else drifted_law(read_model(rig.model), drift)
    return make_bearing(other, seed, make_magnet(other, law))


def _normal(rng: np.random.Generator) -> float:
    while abs(value := float(rng.standard_normal())) > CUT:
        pass
    return value
