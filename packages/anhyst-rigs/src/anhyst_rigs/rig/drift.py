"""Plants that are not what their controller was made for, and rigs with something changed."""

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
"""Standard deviations at which the distribution of a change ends."""
_UNITS = {"gap_offset": ("m", 1.0), "eddy": ("s", 1.0), "cable": ("N_per_m", 1.0)}
_UNITS |= {f"place_{axis}": ("m", 1.0) for axis in "xyz"}
"""Of what is not relative: unit and factor in files."""


@dataclass(frozen=True, slots=True)
class Drift:
    """How far one plant is from the one in the rig file; relative where no unit is named."""

    pinning: float = 0.0  # 0.1 is 10 % more
    reversible: float = 0.0
    saturation: float = 0.0
    mass: float = 0.0
    resistance: float = 0.0
    # gain errors of the sensors; that of the position around the operating gap
    position_gain: float = 0.0
    current_gain: float = 0.0
    flux_gain: float = 0.0
    gap_offset: float = 0.0  # error of the position sensor at the operating gap, m
    first_scale: float = 0.0  # of the current of the first magnet, and of a bearing's second
    second_scale: float = 0.0
    eddy: float = 0.0  # lag of the flux behind the current that the controller does not know, s
    conductivity: float = 0.0  # of solid iron
    cable: float = 0.0  # pulls a body back to where its motion begins, N/m
    stroke: float = 0.0  # of a piezo stack
    creep: float = 0.0
    resonance: float = 0.0
    # by which the centre of mass is off, and of a head the place where it looks at the body, m
    place_x: float = 0.0
    place_y: float = 0.0
    place_z: float = 0.0
    # of a stage: what each magnet has drifted in by itself, and each position head
    magnets: tuple[Drift, ...] = ()
    heads: tuple[Drift, ...] = ()

    def as_dict(self) -> dict[str, float]:
        """Return what drifted, with units in the keys; parts of a body by their numbers."""
        values = {drift.name: getattr(self, drift.name) for drift in fields(self)}
        parts = {"magnet": values.pop("magnets"), "head": values.pop("heads")}
        drifted = {name: value for name, value in values.items() if value}
        units = {name: _UNITS.get(name, ("percent", 100.0)) for name in drifted}
        return {f"{name}_{unit}": by * drifted[name] for name, (unit, by) in units.items()} | {
            f"{part}_{number}_{key}": value
            for part, several in parts.items()
            for number, drift in enumerate(several, 1)
            for key, value in drift.as_dict().items()
        }

    def select(self, names: Collection[str]) -> Drift:
        """Return a plant that has drifted in nothing but this, in each of its magnets alike."""
        heads = self.heads if "heads" in names else ()
        own = {name: getattr(self, name) for name in names if name != "heads"}
        return Drift(
            **own, magnets=tuple(magnet.select(names) for magnet in self.magnets), heads=heads
        )


NO_DRIFT = Drift()


def sample_drift(file: RigFile, rng: np.random.Generator) -> Drift:
    """Draw a plant: normal, cut off at :data:`CUT` standard deviations; a lag is positive."""
    spreads = SPREADS[file.control.kind]
    magnets = tuple(
        _sample_spreads(file, spreads.magnet, rng) for _ in file.body_magnets if spreads.magnet
    )
    heads = tuple(
        _sample_spreads(file, spreads.head, rng) for _ in file.position_sensors if spreads.head
    )
    return replace(_sample_spreads(file, spreads.rig_wide, rng), magnets=magnets, heads=heads)


def _sample_spreads(file: RigFile, spreads: Mapping[str, str], rng: np.random.Generator) -> Drift:
    drawn = {}
    for name, key in spreads.items():
        if name == "conductivity" and file.magnet.solid is None:
            continue
        share = 0.01 if key.endswith("_percent") else 1.0
        while abs(value := float(rng.standard_normal())) > MAX_SAMPLE_SIGMA:
            pass
        drawn[name] = share * getattr(file.spread, key) * value
    if "eddy" in drawn:
        drawn["eddy"] = abs(drawn["eddy"])
    return Drift(**drawn)


def sample_plant(file: RigFile, seed: int, number: int) -> tuple[Drift, int]:
    """Draw the plant of a number: how far it has drifted, and the seed of its noise."""
    rng = np.random.default_rng([seed, number])
    noise = int(rng.integers(1 << 31))
    return sample_drift(file, rng), noise


def drifted_file(file: RigFile, drift: Drift) -> RigFile:
    """Return what the file of a plant that has drifted would say; an identified law stays."""
    changes: dict[str, Any] = {}
    if file.stacks:
        for key in ("stroke_m_per_V", "bend_m_per_V2", "slope_m_per_V"):
            changes[f"stack.{key}"] = (1.0 + drift.stroke) * getattr(file.stack, key)
        shares = [(1.0 + drift.creep) * share for share in file.stack.creep_shares]
        changes["stack.creep_shares"] = shares
        changes["flexure.resonance_Hz"] = (1.0 + drift.resonance) * file.flexure.resonance_Hz
    if file.magnets and file.bodies:
        changes |= _body_changes(file, drift)
    if file.iron is not None:
        iron = file.iron.drifted_keys(drift.pinning, drift.reversible, drift.saturation)
        changes |= {f"iron.{key}": value for key, value in iron.items()}
    return file.with_changes(changes)


def _body_changes(file: RigFile, drift: Drift) -> dict[str, Any]:
    """Return the changes of a body that magnets move, of their winding, and of its sensors.

    The gain error of the position sensor turns its reading around the operating gap, so that gain
    and offset are two things.
    """
    sensor, shunt, hall = file.gap_sensor, file.current_sensor, file.hall_probe
    turned = drift.position_gain * file.gap_m
    changes = {
        "magnet.resistance_ohm": file.magnet.poles.resistance * (1.0 + drift.resistance),
        "body.mass_kg": file.body.mass_kg * (1.0 + drift.mass),
        "gap_sensor.gain_error": sensor.gain_error + drift.position_gain,
        "gap_sensor.offset_m": sensor.offset_m + drift.gap_offset - turned,
        "current_sensor.gain_error": shunt.gain_error + drift.current_gain,
    }
    if (solid := file.magnet.solid_iron) is not None:
        conductivity = solid.conductivity * (1.0 + drift.conductivity)
        changes["magnet.solid.conductivity_S_per_m"] = conductivity
    if hall is not None:
        changes["hall_probe.gain_error"] = hall.gain_error + drift.flux_gain
    return changes


def drifted_plant(rig: BodyRig, drift: Drift, seed: int) -> Plant:
    """Return a plant that has drifted, at rest; a stage is seen from the long stroke."""
    other = replace(rig, settings=drifted_file(rig.settings, drift))
    settings = other.settings
    if rig.law is not None:
        return make_plant(other, seed, other.make_law_magnet(drifted_law(rig.law, drift)))
    scales = [drift.first_scale] * len(settings.body_magnets)
    if len(scales) == 2:
        scales[1] = drift.second_scale
    own = drift.magnets or [Drift(first_scale=scale) for scale in scales]
    each = [replace(one, eddy=drift.eddy) for one in own]
    made = {one: _drifted_magnet(settings, one) for one in dict.fromkeys(each)}
    numbers = plant_parameters(other)
    numbers.body["centre"] = _shift_position(settings.body.centre_m, drift)
    for one, actuator, gap in zip(each, numbers.actuators, numbers.heads, strict=False):
        probe, sensor = actuator["flux_probe"], gap["sensor"]
        if actuator["has_probe"]:
            actuator["flux_probe"] = {**probe, "gain": probe["gain"] + one.flux_gain}
        gap["sensor"] = {**sensor, "offset": sensor["offset"] + one.gap_offset}
    for one, head in zip(drift.heads, numbers.heads[len(each) :], strict=False):
        head["line"] = {**head["line"], "r": _shift_position(head["line"]["r"], one)}
    return make_plant(other, seed, *(made[one] for one in each), parameters=numbers)


def _shift_position(place: Sequence[float], drift: Drift) -> list[float]:
    by = (drift.place_x, drift.place_y, drift.place_z)
    return [coordinate + off for coordinate, off in zip(place, by, strict=True)]


def _drifted_magnet(file: RigFile, drift: Drift) -> Magnet:
    """Return a magnet that has drifted by itself."""
    magnet = file.magnet
    steel = file.steel.model_copy(update=file.steel.drifted_keys(drift.pinning, 0.0, 0.0))
    poles = replace(magnet.poles, turns=magnet.poles.turns * (1.0 + drift.first_scale))
    lag = magnet.eddy_time_s + drift.eddy
    return make_iron_magnet(poles, steel, lag, file.gap_m, magnet.solid_iron)


def map_parameter(value: Parameter, change: Callable[[float], float]) -> Parameter:
    """Return a parameter changed, at every node of the gap if it depends on the gap."""
    return tuple(map(change, value)) if isinstance(value, tuple) else change(value)


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
                tuple(min(factor * coefficient, spec.high) for coefficient in value)
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
    gone -= {spec.name for spec in get_law(model.law, other).parameters}
    kept = {name: value for name, value in model.parameters.items() if name not in gone}
    return replace(model, cells=other, parameters=kept)


def change_rig(rig: AnyRig, changes: Mapping[str, Any]) -> AnyRig:
    """Return a rig with other settings, by the names of :meth:`RigFile.changed`."""
    return replace(rig, settings=rig.settings.with_changes(changes))


def change_iron(
    rig: BodyRig, reversible_fraction: float | None = None, width: float = 1.0
) -> BodyRig:
    """Return a rig with another iron of the same family, of which motion taught nothing."""
    if rig.settings.magnet.kind == "law":
        raise InputError(
            f"{rig.path}: magnet.kind: other irons are tried with a magnet that has one; write "
            '"electromagnet"',
            code="not-iron-of-cells",
            key="magnet.kind",
        )
    steel = rig.settings.steel
    keys = steel.drifted_keys(width - 1.0, 0.0, 0.0)
    if reversible_fraction is not None:
        if not isinstance(steel, NamedCells):
            raise InputError(
                f"{rig.path}: iron.family: cells alone have a reversible fraction; describe "
                "an iron of cells, or leave the fraction out",
                code="not-iron-of-cells",
                key="iron.family",
            )
        keys["reversible_fraction"] = reversible_fraction
    return change_rig(
        remove_calibration(rig), {f"iron.{key}": value for key, value in keys.items()}
    )


def remove_calibration(rig: BodyRig) -> BodyRig:
    """Return a rig that names nothing that motion taught."""
    return rig if rig.calibration_path is None else change_rig(rig, {"control.calibration": None})
