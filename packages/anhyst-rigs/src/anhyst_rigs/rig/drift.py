"""Sample random plants that differ from the rig file, and change settings of a rig."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from anhyst._core import Magnet, Plant
from anhyst.compensate.circuit import cell_weights
from anhyst.laws import get_law
from anhyst.laws.law import Role
from anhyst.model.actuator import Model
from anhyst.model.parameters import Parameter
from anhyst.support.errors import InputError
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.file import RigFile
from anhyst_rigs.rig.from_loops import AnyRig
from anhyst_rigs.rig.parts.iron import NamedCells
from anhyst_rigs.rig.parts.magnet import make_iron_magnet
from anhyst_rigs.rig.plant import make_plant, plant_parameters
from anhyst_rigs.rig.tables import SPREADS

MAX_SAMPLE_SIGMA = 3.0
"""Truncation of the sampled normal distributions, in standard deviations."""
_UNITS = {"gap_offset": ("m", 1.0), "eddy": ("s", 1.0), "cable": ("N_per_m", 1.0)}
_UNITS |= {f"place_{axis}": ("m", 1.0) for axis in "xyz"}
"""Unit in files, and factor to it, of each quantity that is not relative."""


@dataclass(frozen=True, slots=True)
class Drift:
    """Differences between a plant and its rig file. They are relative unless a unit is given."""

    pinning: float = 0.0  # relative change of the pinning; 0.1: 10 % more
    reversible: float = 0.0
    saturation: float = 0.0
    mass: float = 0.0
    resistance: float = 0.0
    # relative gain errors of the sensors; position_gain acts on the distance from the operating gap
    position_gain: float = 0.0
    current_gain: float = 0.0
    flux_gain: float = 0.0
    gap_offset: float = 0.0  # error of the position sensor at the operating gap, m
    first_scale: float = 0.0  # relative change of the current of the first magnet
    second_scale: float = 0.0
    eddy: float = 0.0  # lag of the flux behind the current that the model neglects, s
    conductivity: float = 0.0  # relative change of the conductivity of solid iron
    cable: float = 0.0  # stiffness that pulls a body back to the start of its motion, N/m
    stroke: float = 0.0  # relative change of the stroke of a piezo stack
    creep: float = 0.0
    resonance: float = 0.0
    # displacement of the centre of mass, or of a head's measured point, m
    place_x: float = 0.0
    place_y: float = 0.0
    place_z: float = 0.0
    # only for a stage: drift of each magnet and of each position head
    magnets: tuple[Drift, ...] = ()
    heads: tuple[Drift, ...] = ()

    def as_dict(self) -> dict[str, float]:
        """Return all nonzero differences; keys contain units and numbers of magnets and heads."""
        values = {drift.name: getattr(self, drift.name) for drift in fields(self)}
        drifts_by_part = {"magnet": values.pop("magnets"), "head": values.pop("heads")}
        nonzero_drifts = {name: value for name, value in values.items() if value}
        units = {name: _UNITS.get(name, ("percent", 100.0)) for name in nonzero_drifts}
        return {f"{name}_{unit}": factor * nonzero_drifts[name] for name, (unit, factor) in units.items()} | {
            f"{part_name}_{number}_{key}": value
            for part_name, drifts in drifts_by_part.items()
            for number, drift in enumerate(drifts, 1)
            for key, value in drift.as_dict().items()
        }

    def select(self, names: Collection[str]) -> Drift:
        """Return a drift with only the named quantities, also for each magnet."""
        heads = self.heads if "heads" in names else ()
        values = {name: getattr(self, name) for name in names if name != "heads"}
        return Drift(**values, magnets=tuple(magnet.select(names) for magnet in self.magnets), heads=heads)


NO_DRIFT = Drift()


def sample_drift(file: RigFile, rng: np.random.Generator) -> Drift:
    """Sample the drift of a plant from normal distributions, truncated at :data:`MAX_SAMPLE_SIGMA`.

    The lag ``eddy`` is the absolute value of its sample.
    """
    spreads = SPREADS[file.control.kind]
    magnets = tuple(_sample_spreads(file, spreads.magnet, rng) for _ in file.body_magnets if spreads.magnet)
    heads = tuple(_sample_spreads(file, spreads.head, rng) for _ in file.position_sensors if spreads.head)
    return replace(_sample_spreads(file, spreads.rig_wide, rng), magnets=magnets, heads=heads)


def _sample_spreads(file: RigFile, spreads: Mapping[str, str], rng: np.random.Generator) -> Drift:
    changes = {}
    for name, key in spreads.items():
        if name == "conductivity" and file.magnet.solid is None:
            continue
        unit_factor = 0.01 if key.endswith("_percent") else 1.0
        while abs(value := float(rng.standard_normal())) > MAX_SAMPLE_SIGMA:
            pass
        changes[name] = unit_factor * getattr(file.spread, key) * value
    if "eddy" in changes:
        changes["eddy"] = abs(changes["eddy"])
    return Drift(**changes)


def sample_plant(file: RigFile, seed: int, number: int) -> tuple[Drift, int]:
    """Return the drift of the plant with a number, and the seed of its noise."""
    rng = np.random.default_rng([seed, number])
    noise = int(rng.integers(1 << 31))
    return sample_drift(file, rng), noise


def drifted_file(file: RigFile, drift: Drift) -> RigFile:
    """Return the rig file of a drifted plant. An identified law is not changed here."""
    changes: dict[str, Any] = {}
    if file.stacks:
        for key in ("stroke_m_per_V", "bend_m_per_V2", "slope_m_per_V"):
            changes[f"stack.{key}"] = (1.0 + drift.stroke) * getattr(file.stack, key)
        creep_shares = [(1.0 + drift.creep) * creep_share for creep_share in file.stack.creep_shares]
        changes["stack.creep_shares"] = creep_shares
        changes["flexure.resonance_Hz"] = (1.0 + drift.resonance) * file.flexure.resonance_Hz
    if file.magnets and file.bodies:
        changes |= _body_changes(file, drift)
    if file.iron is not None:
        iron = file.iron.drifted_keys(drift.pinning, drift.reversible, drift.saturation)
        changes |= {f"iron.{key}": value for key, value in iron.items()}
    return file.with_changes(changes)


def _body_changes(file: RigFile, drift: Drift) -> dict[str, Any]:
    """Return the changed values of a body between magnets, its winding and its sensors.

    The gain error of the position sensor is zero at the operating gap, where the offset is defined.
    """
    sensor, shunt, probe = file.gap_sensor, file.current_sensor, file.flux_sensor
    gain_offset = drift.position_gain * file.gap_m
    changes = {
        "magnet.resistance_ohm": file.magnet.poles.resistance * (1.0 + drift.resistance),
        "body.mass_kg": file.body.mass_kg * (1.0 + drift.mass),
        "gap_sensor.gain_error": sensor.gain_error + drift.position_gain,
        "gap_sensor.offset_m": sensor.offset_m + drift.gap_offset - gain_offset,
        "current_sensor.gain_error": shunt.gain_error + drift.current_gain,
    }
    if (solid := file.magnet.solid_iron) is not None:
        conductivity = solid.conductivity * (1.0 + drift.conductivity)
        changes["magnet.solid.conductivity_S_per_m"] = conductivity
    if probe is not None:
        name = "coil_sensor" if file.hall_probe is None else "hall_probe"
        changes[f"{name}.gain_error"] = probe.gain_error + drift.flux_gain
    return changes


def drifted_plant(rig: BodyRig, drift: Drift, seed: int) -> Plant:
    """Return a drifted plant at rest."""
    drifted_rig = replace(rig, settings=drifted_file(rig.settings, drift))
    settings = drifted_rig.settings
    if rig.law is not None:
        return make_plant(drifted_rig, seed, drifted_rig.make_law_magnet(drifted_law(rig.law, drift)))
    scales = [drift.first_scale] * len(settings.body_magnets)
    if len(scales) == 2:
        scales[1] = drift.second_scale
    magnet_drifts = drift.magnets or [Drift(first_scale=scale) for scale in scales]
    complete_drifts = [replace(magnet_drift, eddy=drift.eddy) for magnet_drift in magnet_drifts]
    magnets = {
        magnet_drift: _drifted_magnet(settings, magnet_drift)
        for magnet_drift in dict.fromkeys(complete_drifts)
    }
    drifted_parameters = plant_parameters(drifted_rig)
    drifted_parameters.body["centre"] = _shift_position(settings.body.centre_m, drift)
    for magnet_drift, actuator, gap in zip(
        complete_drifts, drifted_parameters.actuators, drifted_parameters.heads, strict=False
    ):
        probe, sensor = actuator["flux_probe"], gap["sensor"]
        if actuator["has_probe"]:
            actuator["flux_probe"] = {**probe, "gain": probe["gain"] + magnet_drift.flux_gain}
        gap["sensor"] = {**sensor, "offset": sensor["offset"] + magnet_drift.gap_offset}
    for magnet_drift, head in zip(
        drift.heads, drifted_parameters.heads[len(complete_drifts) :], strict=False
    ):
        head["line"] = {**head["line"], "r": _shift_position(head["line"]["r"], magnet_drift)}
    return make_plant(
        drifted_rig,
        seed,
        *(magnets[magnet_drift] for magnet_drift in complete_drifts),
        parameters=drifted_parameters,
    )


def _shift_position(position: Sequence[float], drift: Drift) -> list[float]:
    position_shift = (drift.place_x, drift.place_y, drift.place_z)
    return [
        coordinate + displacement for coordinate, displacement in zip(position, position_shift, strict=True)
    ]


def _drifted_magnet(file: RigFile, drift: Drift) -> Magnet:
    """Return a magnet with its individual drift."""
    magnet = file.magnet
    steel = file.steel.model_copy(update=file.steel.drifted_keys(drift.pinning, 0.0, 0.0))
    poles = replace(magnet.poles, turns=magnet.poles.turns * (1.0 + drift.first_scale))
    lag = magnet.eddy_time_s + drift.eddy
    return make_iron_magnet(poles, steel, lag, file.gap_m, magnet.solid_iron)


def map_parameter(value: Parameter, change: Callable[[float], float]) -> Parameter:
    """Apply a function to the value of a parameter, or to the value at each gap."""
    return tuple(map(change, value)) if isinstance(value, tuple) else change(value)


def drifted_law(model: Model, drift: Drift) -> Model:
    """Return an identified law whose pinning, reversible part and saturation have drifted."""
    if model.operator_law.cells is not None:
        return _drifted_cells(model, drift)
    factors: dict[Role, float] = {
        "pinning": 1.0 + drift.pinning,
        "reversible": 1.0 + drift.reversible,
        "saturation": 1.0 + drift.saturation,
    }
    changed_parameters: dict[str, Parameter] = {}
    for role, factor in factors.items():
        for parameter_spec in model.operator_law.parameters_with_role(role):
            value = model.parameters[parameter_spec.name]
            changed_parameters[parameter_spec.name] = (
                tuple(min(factor * coefficient, parameter_spec.high) for coefficient in value)
                if isinstance(value, tuple)
                else min(factor * value, parameter_spec.high)
            )
    return replace(model, parameters={**model.parameters, **changed_parameters})


def _drifted_cells(model: Model, drift: Drift) -> Model:
    """Return a drifted law of play cells; cell 0 (without a threshold) is the reversible part."""
    cells = cell_weights(model)
    cell_fractions = cells.weights.sum(axis=1) / cells.saturation
    reversible_fraction = min(float(cell_fractions[0]) * (1.0 + drift.reversible), 1.0)
    factors = np.full(
        cell_fractions.size,
        (1.0 - reversible_fraction) / (1.0 - cell_fractions[0]) if cell_fractions[0] < 1.0 else 1.0,
    )
    factors[0] = reversible_fraction / cell_fractions[0] if cell_fractions[0] > 0.0 else 1.0
    drifted_weights = replace(
        cells,
        thresholds=(1.0 + drift.pinning) * cells.thresholds,
        weights=(1.0 + drift.saturation) * factors[:, None] * cells.weights,
    )
    removed_names = {parameter_spec.name for parameter_spec in model.operator_law.parameters}
    removed_names -= {spec.name for spec in get_law(model.law, drifted_weights).parameters}
    parameters = {name: value for name, value in model.parameters.items() if name not in removed_names}
    return replace(model, cells=drifted_weights, parameters=parameters)


def change_rig(rig: AnyRig, changes: Mapping[str, Any]) -> AnyRig:
    """Return a rig with changed settings; :meth:`RigFile.with_changes` describes their names."""
    return replace(rig, settings=rig.settings.with_changes(changes))


def change_iron(rig: BodyRig, reversible_fraction: float | None = None, width: float = 1.0) -> BodyRig:
    """Return a rig with another iron of the same family, without a calibration."""
    if rig.settings.magnet.kind == "law":
        raise InputError(
            f'{rig.path}: magnet.kind: a magnet with a law has no iron to change; write "electromagnet"',
            code="not-iron-of-cells",
            key="magnet.kind",
        )
    steel = rig.settings.steel
    keys = steel.drifted_keys(width - 1.0, 0.0, 0.0)
    if reversible_fraction is not None:
        if not isinstance(steel, NamedCells):
            raise InputError(
                f"{rig.path}: iron.family: only iron of cells has a reversible fraction; use "
                'family "cells", or omit the fraction',
                code="not-iron-of-cells",
                key="iron.family",
            )
        keys["reversible_fraction"] = reversible_fraction
    return change_rig(remove_calibration(rig), {f"iron.{key}": value for key, value in keys.items()})


def remove_calibration(rig: BodyRig) -> BodyRig:
    """Return a rig without a calibration file."""
    return rig if rig.calibration_path is None else change_rig(rig, {"control.calibration": None})
