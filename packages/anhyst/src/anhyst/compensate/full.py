"""Make the tables of a parameter block for the Jiles-Atherton law (block kind "full").

The tables contain the anhysteretic curve, the ascending branch of a fully pinned iron, and the
inverse of the anhysteretic curve. The tables extend to the largest field that any current within
its limits produces. From the tables, the compensator calculates the exact step of the law.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.optimize import brentq

from anhyst._core import langevin
from anhyst.compensate.block import DemandLimits, TableSizes
from anhyst.compensate.circuit import CurrentCoefficients, iron_parameters
from anhyst.compensate.packing import BlockFrame, LawTables, Packer
from anhyst.laws.jiles_atherton import ascending_branch
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray

FIELD_MARGIN = 1.02
"""Largest field of the tables, relative to the largest field for currents within their limits."""


FIXED_POINT_STEPS = 100
"""Number of fixed-point iterations from above. Each iteration gives an upper bound of the largest
field."""

MAX_RELATIVE_FIELD = 95.0
"""Maximum of the largest field, relative to the shape field. The slope of the curve in a table is
then 32 at most: the initial slope of the anhysteretic curve is a third of this value."""

MAX_Q8 = 32767 / 256
"""Largest steepness that a word can store. The steepness affects only the Newton steps."""


@dataclass(frozen=True)
class NormalisedLaw:
    """Parameters of the law in units of the shape field, and coefficients of the current."""

    a: float  # shape field ``a`` of the anhysteretic curve, A/m; the unit of all fields
    kappa: float  # pinning field ``k/a``
    c: float  # reversible fraction of the magnetisation
    dead_band: float  # half-width ``r_d/a`` of the dead band
    # ``h = a/((1-alpha)*M_s)``: flux, relative to that of saturated iron, for a field ``x = 1``
    air_flux: float
    # current at each gap, A: ``bias + flux_coefficient*flux + field_coefficient*x``; shape (n,)
    bias: FloatArray
    flux_coefficient: FloatArray
    field_coefficient: FloatArray


def normalise_law(iron: Mapping[str, float], coefficients: CurrentCoefficients) -> NormalisedLaw:
    """Convert the parameters of the iron and the coefficients of the current to units of the law."""
    a = iron["a"]
    return NormalisedLaw(
        a=a,
        kappa=iron["k"] / a,
        c=iron["c"],
        dead_band=iron["r_d"] / a,
        air_flux=coefficients.air_flux * a,
        bias=coefficients.bias,
        flux_coefficient=coefficients.flux,
        field_coefficient=coefficients.field * a,
    )


def find_max_field(law: NormalisedLaw, current: tuple[float, float]) -> float:
    """Return the largest ``|x|`` for currents within their limits, over all gaps."""
    drive = np.abs(np.asarray(current)[:, None] - law.bias).ravel()
    flux_coefficient, field_coefficient = (
        np.tile(coefficient, len(current)) for coefficient in (law.flux_coefficient, law.field_coefficient)
    )
    is_negative = flux_coefficient < 0.0
    positive_arguments, negative_arguments = (
        (drive[rows], flux_coefficient[rows], field_coefficient[rows]) for rows in (~is_negative, is_negative)
    )
    return max(
        law.kappa,
        _max_field_on_ascending_branch(law, *positive_arguments),
        _max_field_on_anhysteretic(law, *negative_arguments),
    )


def _max_field_on_ascending_branch(
    law: NormalisedLaw, drive: FloatArray, flux_coefficient: FloatArray, field_coefficient: FloatArray
) -> float:
    """Return the largest field on the ascending branch, where the magnetisation is lowest.

    At each gap, the required drive increases with the field. At the largest field, it equals the
    available drive at one gap and exceeds it at all others.
    """
    if drive.size == 0:
        return 0.0

    def drive_error(x: float) -> float:
        pinned = float(ascending_branch(law.kappa, np.array([x]))[0])
        m = (1.0 - law.c) * pinned + law.c * float(langevin(np.array([x]))[0][0])
        return float(np.min(flux_coefficient * (m + law.air_flux * x) + field_coefficient * x - drive))

    return float(
        brentq(drive_error, -1.0 - law.kappa, float(np.max(drive / field_coefficient)) + law.kappa + 1.0)
    )


def _max_field_on_anhysteretic(
    law: NormalisedLaw, drive: FloatArray, flux_coefficient: FloatArray, field_coefficient: FloatArray
) -> float:
    """Return the largest field on the anhysteretic curve, for negative flux coefficients."""
    x = np.full(drive.shape, np.inf)
    for _ in range(FIXED_POINT_STEPS):
        x = (drive - flux_coefficient * langevin(x)[0]) / (
            field_coefficient + flux_coefficient * law.air_flux
        )
    return float(np.max(x, initial=0.0))


@dataclass(frozen=True)
class FullTables:
    """Tables of the law; fields in units of ``a``."""

    max_field: float  # largest field of the tables
    curve: FloatArray  # anhysteretic curve over fields from 0 to the largest; shape (2**n + 1,)
    # ascending branch of a fully pinned iron, for fields of both signs; shape (2**(n + 1) + 1,)
    branch: FloatArray
    inverse: FloatArray  # field for anhysteretic magnetisations from 0 to 1; shape (2**m + 1,)


def make_full_law(frame: BlockFrame) -> LawTables:
    """Return the tables of a model; a field of 1 is the largest field."""
    law = normalise_law(iron_parameters(frame.model), frame.coefficients)
    tables = make_full_tables(law, frame.limits, frame.sizes)
    coefficients = law.bias, law.flux_coefficient, law.field_coefficient * tables.max_field
    return LawTables(coefficients, partial(_pack, law, tables, frame.sizes))


def make_full_tables(law: NormalisedLaw, limits: DemandLimits, sizes: TableSizes) -> FullTables:
    """Return the tables of a law for all fields that currents within their limits produce."""
    max_field = FIELD_MARGIN * find_max_field(law, limits.current)
    if max_field > MAX_RELATIVE_FIELD:
        raise InputError(
            f"current: at its limits, the field is {max_field:.0f} times the shape field a, but above "
            f"{MAX_RELATIVE_FIELD:.0f} the tables are too steep for 16 bits; narrow the current, or "
            "identify with --law play-cells",
            code="tables-too-steep",
            key="current",
        )
    n = sizes.curve_segments
    field = np.linspace(-max_field, max_field, 2 ** (n + 1) + 1)
    positive_field = field[2**n :]
    curve = langevin(positive_field)[0]
    magnetisation = np.linspace(0.0, 1.0, 2**sizes.inverse_segments + 1)
    inverse = np.interp(magnetisation, curve, positive_field)
    return FullTables(max_field, curve, ascending_branch(law.kappa, field), inverse)


def _pack(law: NormalisedLaw, tables: FullTables, sizes: TableSizes, packer: Packer) -> None:
    max_field = tables.max_field
    packer.put_single("UNIT_FIELD", max_field * law.a)
    packer.put_table("FULL_CURVE", tables.curve, 32768.0)
    packer.put_table("FULL_BRANCH", tables.branch, 32768.0)
    packer.put_table("FULL_INVERSE", tables.inverse / max_field, 32767.0)
    packer.put_weight("FULL_RATE", max_field / (law.kappa * np.log(2.0)) / 16.0, "k")
    steepness = max_field / law.kappa
    packer.put_number("FULL_STEEPNESS", min(steepness, MAX_Q8) if packer.is_fixed else steepness, "k", 1)
    packer.put_number("FULL_AIR", law.air_flux * max_field / 4.0, "h", min_word=1)
    packer.put_number("FULL_REVERSIBLE", law.c, "c")
    packer.put_number("FULL_PLAY", law.dead_band / max_field, "r_d")
    packer.put_integer("FULL_ITERATIONS", sizes.iterations)
    packer.put_integer("FULL_CURVE_SEGMENTS", sizes.curve_segments)
    packer.put_integer("FULL_INVERSE_SEGMENTS", sizes.inverse_segments)
