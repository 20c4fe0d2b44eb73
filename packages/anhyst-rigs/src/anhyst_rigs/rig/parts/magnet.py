"""Compute the parameters of virtual magnets: an iron in a magnetic circuit, or an identified law.

The module also reads and checks flux tables, and describes solenoids. The equations are in
``plant/include/anhyst_plant/magnet.h``.
"""

# ruff: noqa: N815 - keys of a solenoid file carry units

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Annotated

import numpy as np
from numpy.typing import NDArray
from pydantic import Field
from scipy.interpolate import PchipInterpolator

from anhyst._core import AnyIron, Coil, Magnet
from anhyst.data.table import DataTable, read_columns
from anhyst.laws.law import IronOperator
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst.support.registry import Registry
from anhyst.support.toml_file import NotNegative, Positive, Table
from anhyst.support.units import MU_0
from anhyst_rigs.rig.parts.iron import AnySteel

_TABLE_CURRENTS = 257
_TABLE_GAPS = 129
"""Number of currents and number of gaps in a flux table of the core."""
_FAR_M = 1e6
"""Gap without bias of a permanent magnet: its magnetomotive force changes by 1e-9 in 1 mm."""
_WALL_M = 1e-12
"""Size of the wall of a cone without effect."""


@dataclass(frozen=True, slots=True)
class Poles:
    """A magnet with two poles in front of a flat armature."""

    turns: float  # turns of the winding
    resistance: float  # resistance of the winding, ohm
    width: float  # width of a pole face, m
    depth: float
    leakage: float  # permeance between the legs, parallel to the gaps, H
    iron_length: float  # mean length of the flux path in the iron, m
    joints: float = 0.0  # total air gap in the joints of the core, m
    # only for bidirectional actuators: reluctance of the flux path outside the iron, independent of
    # the gap, 1/H; magnetomotive force divided by displacement, A/m; stiffness without flux, N/m
    outer: float | None = None
    bias: float = 0.0
    spring: float = 0.0
    # magnetomotive force of a permanent magnet in series with the iron, A; `joints` has its reluctance
    magnet_mmf: float = 0.0
    # reluctance of the path that the fluxes of both magnets of a pair share, which `joints` includes, 1/H
    shared: float = 0.0

    def flux_density(self, gain: FloatArray, gap: FloatArray) -> FloatArray:
        """Return the flux density in the gap, T, for which the plant computes a pull of `gain`, N."""
        return np.sqrt(MU_0 * gain / ((self.width + gap) * (self.depth + gap)))

    def pull_force(self, density: FloatArray, gap: FloatArray, middle_gap: float) -> FloatArray:
        """Return the force, N, that the plant computes for a flux density, T, at a gap, m.

        The bias of a bidirectional actuator is zero at the gap `middle`.
        """
        if self.outer is not None:
            return self.bias * self.area * density - self.spring * (middle_gap - gap)
        return density**2 * (self.area - gap**2) / MU_0

    @property
    def area(self) -> float:
        """Cross-section of the core, m^2."""
        return self.width * self.depth

    def reluctance(self, gap: float) -> float:
        """Return the reluctance of the flux path outside the iron, with leakage and joints, 1/H.

        Fringing widens the pole by half a gap on each side.
        """
        if self.outer is not None:
            return self.outer
        gaps = 2.0 * gap / (MU_0 * (self.width + gap) * (self.depth + gap))
        return 1.0 / (1.0 / gaps + self.leakage) + self.joints / (MU_0 * self.area)

    def inductance(self, gap: float) -> float:
        """Return the inductance of the winding for iron of infinite permeability, H."""
        return self.turns**2 / self.reluctance(gap)

    def cone_parameters(self) -> dict[str, float] | None:
        """Return both gaps as one flat face of the plant, or None without a permanent magnet.

        The plant accepts a constant magnetomotive force only with a cone. The wall of this cone
        is negligible. The face has the permeance of both gaps, which is exact for square poles.
        """
        if self.magnet_mmf == 0.0:
            return None
        side = math.sqrt(0.5 * self.area)
        fringe = (self.width + self.depth) / (8.0 * side)
        wall = dict.fromkeys(("clearance", "taper", "saturation", "thickness"), 1.0)
        wall |= {"around": _WALL_M, "depth": 0.0, "onset": _WALL_M}
        return {"leakage": self.leakage, "side": side, "fringe": fringe, **wall}


@dataclass(frozen=True)
class ActuatorKind:
    """How flux becomes force in a magnet of one ``kind``."""

    # quantity of the loops: "force" if the magnet only pulls, "thrust" if it is bidirectional
    output: str
    # descriptions of the keys of ``magnet.numbers``, whose values are all above 0
    numbers: Mapping[str, str]
    circuit: Callable[[Poles, Mapping[str, float]], Poles]  # function that adds these to a circuit


def _add_permanent_magnet(poles: Poles, numbers: Mapping[str, float]) -> Poles:
    """Return a circuit with a permanent magnet, whose recoil line is straight, in series."""
    remanence, coercivity = numbers["remanence_T"], numbers["coercivity_A_per_m"]
    if remanence < MU_0 * coercivity:
        text = f"is above remanence_T/mu_0, {remanence / MU_0:.4g} A/m; enter HcB, not HcJ"
        raise InputError(f"numbers.coercivity_A_per_m: {text}", code="out-of-range")
    magnet_mmf = coercivity * numbers["magnet_length_m"]
    reluctance = magnet_mmf / (remanence * numbers["magnet_area_m2"])
    joints = poles.joints + MU_0 * poles.area * reluctance
    return replace(poles, joints=joints, magnet_mmf=magnet_mmf)


def _add_shared_path(poles: Poles, numbers: Mapping[str, float]) -> Poles:
    """Return the circuit of a magnet whose yoke has a path for the fluxes of two coils."""
    shared = numbers["shared_reluctance_per_H"]
    return replace(poles, joints=poles.joints + MU_0 * poles.area * shared, shared=shared)


PERMANENT_MAGNET, COUPLED = "permanent-magnet", "coupled-electromagnet"
"""Kinds of magnets with a permanent magnet in series, and of two coils on one yoke."""
_MAGNET_NUMBERS = {
    "remanence_T": "remanence of the permanent magnet",
    "coercivity_A_per_m": "coercivity HcB of the permanent magnet",
    "magnet_length_m": "length of the permanent magnet along the flux",
    "magnet_area_m2": "cross-section of the permanent magnet",
}
_SHARED_NUMBERS = {"shared_reluctance_per_H": "reluctance of the yoke path that both fluxes share"}

ACTUATORS: Registry[ActuatorKind] = Registry(
    "anhyst.actuators",
    {
        "electromagnet": ActuatorKind("force", {}, lambda poles, _: poles),
        PERMANENT_MAGNET: ActuatorKind("force", _MAGNET_NUMBERS, _add_permanent_magnet),
        COUPLED: ActuatorKind("force", _SHARED_NUMBERS, _add_shared_path),
    },
    lambda found, _: "" if isinstance(found, ActuatorKind) else "and it is not an ActuatorKind",
)
"""Kinds of actuators by name: built-in and plug-in ones (entry point ``anhyst.actuators``)."""


@dataclass(frozen=True, slots=True)
class SolidIron:
    """The solid part of a core: a slab that the field enters at its surface."""

    length: float  # length of the flux path, m
    depth: float  # depth from the surface to the middle, m
    conductivity: float  # S/m
    volumes: int = 12  # number of volumes across the depth, narrower near the surface

    def layer_parameters(self) -> tuple[FloatArray, FloatArray]:
        """Return each volume's fraction of the cross-section, and its eddy-current drag, A s/(m T)."""
        width = np.geomspace(1.0, _INNER_TO_SURFACE_VOLUME_WIDTH, self.volumes)
        width /= width.sum()
        distances = 0.5 * np.append(width[0], width[1:] + width[:-1])
        return width, self.conductivity * self.depth**2 * distances


_INNER_TO_SURFACE_VOLUME_WIDTH = 6.0
"""Ratio of the width of the innermost volume to that of the volume at the surface."""


def make_iron_magnet(
    poles: Poles, steel: AnySteel, eddy_time: float = 0.0, gap: float = 1e-3, solid: SolidIron | None = None
) -> Magnet:
    """Return a magnet with an iron of any family, and with a solid part if one is given."""
    parameters = circuit_parameters(poles, eddy_time, gap)
    if (cone := poles.cone_parameters()) is not None:
        return Magnet(parameters, steel.make_steel(), cone)
    if solid is None:
        return Magnet(parameters, steel.make_steel())
    return Magnet(parameters, steel.make_steel(), solid.length / poles.iron_length, *solid.layer_parameters())


def circuit_parameters(poles: Poles, eddy_time: float, gap: float) -> dict[str, float]:
    """Return the parameters of winding and circuit by their names in ``anhyst_plant/magnet.h``."""
    return {
        "iron_length": poles.iron_length,
        "iron_area": poles.area,
        "pole_width": poles.width,
        "pole_depth": poles.depth,
        "leakage": poles.leakage,
        "joints": poles.joints / (MU_0 * poles.area) if poles.outer is None else poles.outer,
        "eddy": eddy_time * poles.reluctance(gap) * poles.area / poles.iron_length,
        "bias": poles.bias or poles.magnet_mmf / _FAR_M,
        "middle": gap if poles.magnet_mmf == 0.0 else _FAR_M,
        "spring": poles.spring,
        "turns": float(poles.turns),
        "resistance": poles.resistance,
    }


@dataclass(frozen=True, slots=True)
class FluxTable:
    """Flux linkage of a winding as a function of current and gap."""

    current: FloatArray  # A, increasing from 0; shape (i,)
    gap: FloatArray  # m, increasing; shape (g,)
    psi: FloatArray  # Wb; increases with the current, decreases with the gap; shape (g, i)


def read_flux_table(path: PathLike) -> FluxTable:
    """Read and check a flux table."""
    table = read_columns(path)
    current = table.require("current", "I_A")
    gap = table.require("gap", "gap_m")
    psi = table.require("flux_linkage", "psi_Wb")
    currents, column = np.unique(current, return_inverse=True)
    gaps, gap_indices = np.unique(gap, return_inverse=True)
    for name, values in (("current", currents), ("gap", gaps)):
        if values.size < 2:
            text = f"{table.path}: has a single {name}; measure at least two"
            raise InputError(text, code="too-few-values", key=name)
    if currents[0] != 0.0:
        text = f"currents begin at {currents[0]:g} A; begin at 0, as the flux is assumed to be odd"
        raise InputError(
            f"{table.locate_row(int(np.argmin(current)))}: {text}", code="currents-not-from-zero", key="I_A"
        )
    row_numbers = np.full((gaps.size, currents.size), -1)
    for number, cell_indices in enumerate(zip(gap_indices.tolist(), column.tolist(), strict=True)):
        if row_numbers[cell_indices] >= 0:
            point = _point_text(gap[number], current[number])
            raise InputError(
                f"{table.locate_row(number)}: {point} occurs twice; remove one", code="value-again"
            )
        row_numbers[cell_indices] = number
    _check_all_combinations(table.path, gaps, currents, row_numbers)
    flux_table = FluxTable(currents, gaps, psi[row_numbers])
    _check_monotone(table, flux_table, row_numbers)
    return flux_table


def check_flux_range(
    path: PathLike, table: FluxTable, gap_low: float, gap_high: float, current_high: float
) -> None:
    """Raise an InputError if a flux table does not cover the travel and the current range."""
    lowest_gap, highest_gap = float(table.gap[0]), float(table.gap[-1])
    if not (lowest_gap <= gap_low and gap_high <= highest_gap):
        raise InputError(
            f"{path}: gap_m runs from {lowest_gap:g} to {highest_gap:g} m and must contain the travel, "
            f"{gap_low:g} to {gap_high:g} m; add gaps",
            code="gaps-not-covered",
            key="gap_m",
        )
    if table.current[-1] < current_high:
        raise InputError(
            f"{path}: I_A ends at {table.current[-1]:g} A and the amplifier at {current_high:g} A; "
            "add currents",
            code="currents-not-covered",
            key="I_A",
        )


def _check_all_combinations(
    path: str, gaps: FloatArray, currents: FloatArray, row_numbers: NDArray[np.int_]
) -> None:
    missing_points = np.argwhere(row_numbers < 0)
    if len(missing_points):
        first_hole = _point_text(gaps[missing_points[0, 0]], currents[missing_points[0, 1]])
        further_text = f" and at {len(missing_points) - 1} other points" if len(missing_points) > 1 else ""
        raise InputError(
            f"{path}: has a hole at {first_hole}{further_text}; {gaps.size} gaps and "
            f"{currents.size} currents must form a full grid; add the missing points",
            code="grid-has-holes",
        )


def _check_monotone(table: DataTable, flux_table: FluxTable, row_numbers: NDArray[np.int_]) -> None:
    constant_indices = np.add(np.argwhere(np.diff(flux_table.psi, axis=1) <= 0.0), (0, 1))
    rising_indices = np.add(np.argwhere(np.diff(flux_table.psi[:, 1:], axis=0) >= 0.0), (1, 1))
    for fault_indices, text in (
        (np.argwhere(flux_table.psi[:, :1] != 0.0), "psi is not 0 without current"),
        (constant_indices, "psi does not rise with the current"),
        (rising_indices, "psi does not fall as the gap opens"),
    ):
        if len(fault_indices):
            gap_index, current_index = fault_indices[0].tolist()
            point = _point_text(flux_table.gap[gap_index], flux_table.current[current_index])
            location = table.locate_row(int(row_numbers[gap_index, current_index]))
            raise InputError(f"{location}: {text} at {point}; correct this point", code="not-monotone")


def _point_text(gap: float, current: float) -> str:
    return f"{gap * 1e3:g} mm, {current:g} A"


def make_flux_table(
    poles: Poles, steel: AnySteel, current_high: float, gaps: tuple[float, float]
) -> FluxTable:
    """Compute a flux table from the poles and from the anhysteretic curve of the iron."""
    current = np.linspace(0.0, current_high, _TABLE_CURRENTS)
    gap = np.linspace(*gaps, _TABLE_GAPS)
    magnet = Magnet(circuit_parameters(poles, 0.0, float(gap[0])), steel.make_anhysteretic_steel())
    psi = [Coil(magnet).run(current, np.full(current.size, one_gap))[:, 1] for one_gap in gap]
    return FluxTable(current, gap, np.array(psi))


def make_law_magnet(
    poles: Poles, iron: IronOperator, rows: FloatArray, eddy: float, table: FluxTable
) -> Magnet:
    """Return a magnet whose pull follows an identified law and whose flux linkage follows a table."""
    if not isinstance(iron, AnyIron):
        text = "model: the core does not have its law and cannot simulate the magnet"
        raise InputError(text, code="law-not-in-core", key="model")
    parameters = {
        "eddy": eddy,
        "current_high": float(table.current[-1]),
        "gap_low": float(table.gap[0]),
        "gap_high": float(table.gap[-1]),
        "turns": float(poles.turns),
        "resistance": poles.resistance,
    }
    gap_range = parameters["gap_low"], parameters["gap_high"]
    rows = np.column_stack([rows, poles.flux_density(rows[:, 2], np.linspace(*gap_range, len(rows)))])
    # Interpolate on a fine uniform grid by monotone cubics, so that the table stays monotone.
    current = np.linspace(0.0, parameters["current_high"], _TABLE_CURRENTS)
    gap = np.linspace(*gap_range, _TABLE_GAPS)
    psi = PchipInterpolator(table.current, table.psi, axis=1)(current)
    psi = np.ascontiguousarray(PchipInterpolator(table.gap, psi, axis=0)(gap))
    return Magnet(parameters, iron, rows, psi)


class FluxPath(Table):
    """Dimensions of the flux path in the table ``[iron]``."""

    length_m: Positive  # mean length of the flux path in the iron
    area_m2: Positive


class CircuitTable(Table):
    """``[circuit]`` of a solenoid file: winding and poles."""

    turns: Annotated[int, Field(ge=1)]
    resistance_ohm: Positive | None = None  # winding resistance
    slide_reluctance_per_H: NotNegative  # reluctance of the sliding clearance
    leakage_H: NotNegative  # permeance parallel to the working gap
    face_area_m2: Positive  # area of the plunger's flat face
    # widening of the face on every side by its fringe field, relative to the gap
    fringe: NotNegative
    cone_diameter_m: Positive  # mean diameter of the wall of the cone
    cone_clearance_m: Positive  # radial clearance between plunger and wall
    cone_depth_m: Positive  # gap at which the plunger enters the cone
    cone_onset_m: Positive  # length of the transition from face to cone, which fringing smooths
    tip_thickness_m: Positive  # thickness of the wall at its tip
    tip_taper: NotNegative  # increase of the thickness divided by the depth
    tip_saturation_T: Positive  # flux density at which the wall saturates

    def cone_parameters(self) -> dict[str, float]:
        """Return the parameters of the working gap by their names in ``anhyst_plant/magnet.h``."""
        return {
            "leakage": self.leakage_H,
            "side": math.sqrt(self.face_area_m2),
            "fringe": self.fringe,
            "around": math.pi * self.cone_diameter_m,
            "clearance": self.cone_clearance_m,
            "depth": self.cone_depth_m,
            "onset": self.cone_onset_m,
            "thickness": self.tip_thickness_m,
            "taper": self.tip_taper,
            "saturation": self.tip_saturation_T,
        }

    def circuit_parameters(self, path: FluxPath) -> dict[str, float]:
        """Return winding and iron path by their names in ``anhyst_plant/magnet.h``."""
        zeros = ("pole_width", "pole_depth", "leakage", "eddy", "bias", "middle", "spring")
        return {
            **dict.fromkeys((*zeros, "resistance"), 0.0),
            "iron_length": path.length_m,
            "iron_area": path.area_m2,
            "joints": self.slide_reluctance_per_H,
            "turns": float(self.turns),
        }


def make_solenoid_magnet(steel: AnySteel, path: FluxPath, circuit: CircuitTable) -> Magnet:
    """Return the solenoid for the core's plant."""
    return Magnet(circuit.circuit_parameters(path), steel.make_steel(), circuit.cone_parameters())
