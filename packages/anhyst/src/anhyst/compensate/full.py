"""The parameter block of the full law: the exact step, from tables."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
from scipy.optimize import brentq

from anhyst._core import langevin
from anhyst.compensate.block import DemandLimits, TableSizes
from anhyst.compensate.circuit import Arms, iron_of
from anhyst.compensate.packing import BlockFrame, LawTables, Packer
from anhyst.laws.jiles_atherton import ascending_branch
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray

MARGIN = 1.02
"""Tables reach a little further than any current within its limits drives the field."""


DESCENTS = 100
"""Steps down to the largest field from above: each is a bound, wherever one stops."""

FURTHEST = 95.0
"""Largest field over the shape field: the curve rises by a third of it, a slope of 32 at most."""

MAX_Q8 = 32767 / 256
"""Largest steepness that a word holds; it steers Newton steps only."""


@dataclass(frozen=True)
class Normal:
    """The law in units of its own, and how a current is made up there."""

    a: float  # shape field of the anhysteretic curve, A/m: the unit of fields
    kappa: float  # ``k/a``
    c: float  # reversible fraction
    play: float  # ``r_d/a``
    # ``h = a/((1-alpha)*M_s)``: flux (over that of saturated iron) for a field ``x = 1``
    air: float
    # current at each place over the gap, A: ``bias + flux_arm*flux + field_arm*x``; shape (n,)
    bias: FloatArray
    flux_arm: FloatArray
    field_arm: FloatArray


def normal(iron: Mapping[str, float], arms: Arms) -> Normal:
    """Bring the parameters of iron, and how a current is made up, into the units of the law."""
    a = iron["a"]
    return Normal(
        a=a,
        kappa=iron["k"] / a,
        c=iron["c"],
        play=iron["r_d"] / a,
        air=arms.air * a,
        bias=arms.bias,
        flux_arm=arms.flux_arm,
        field_arm=arms.field_arm * a,
    )


def largest_field(law: Normal, current: tuple[float, float]) -> float:
    """Largest ``|x|`` to which currents within their limits drive the iron, at any gap."""
    drive = np.abs(np.asarray(current)[:, None] - law.bias).ravel()
    arm, field_arm = (np.tile(arms, len(current)) for arms in (law.flux_arm, law.field_arm))
    against = arm < 0.0
    with_air, counted = ((drive[rows], arm[rows], field_arm[rows]) for rows in (~against, against))
    return max(law.kappa, _rising_field(law, *with_air), _free_field(law, *counted))


def _rising_field(law: Normal, drive: FloatArray, arm: FloatArray, own: FloatArray) -> float:
    """Return the largest field on the ascending branch, where the iron answers least.

    What each drive has left falls with the field, so the last to have some left leads furthest.
    """
    if drive.size == 0:
        return 0.0

    def missing(x: float) -> float:
        pinned = float(ascending_branch(law.kappa, np.array([x]))[0])
        m = (1.0 - law.c) * pinned + law.c * float(langevin(np.array([x]))[0][0])
        return float(np.min(arm * (m + law.air * x) + own * x - drive))

    return float(brentq(missing, -1.0 - law.kappa, float(np.max(drive / own)) + law.kappa + 1.0))


def _free_field(law: Normal, drive: FloatArray, arm: FloatArray, own: FloatArray) -> float:
    """Return the largest field on the anhysteretic curve, where the iron counts against the air."""
    x = np.full(drive.shape, np.inf)
    for _ in range(DESCENTS):
        x = (drive - arm * langevin(x)[0]) / (own + arm * law.air)
    return float(np.max(x, initial=0.0))


@dataclass(frozen=True)
class FullTables:
    """Tables of a compensator of the full law; fields in units of ``a``."""

    reach: float  # largest field
    curve: FloatArray  # anhysteretic curve over fields from 0 to the largest; shape (2**n + 1,)
    # ascending branch of a fully pinned iron, over fields of both signs; shape (2**(n + 1) + 1,)
    branch: FloatArray
    inverse: FloatArray  # field over the anhysteretic from 0 to 1; shape (2**m + 1,)


def full_law(frame: BlockFrame) -> LawTables:
    """Return the tables of a model of the full law; a field of 1 is the largest."""
    law = normal(iron_of(frame.model), frame.arms)
    tables = full_tables(law, frame.limits, frame.sizes)
    arms = law.bias, law.flux_arm, law.field_arm * tables.reach
    return LawTables(arms, partial(_pack, law, tables, frame.sizes))


def full_tables(law: Normal, limits: DemandLimits, sizes: TableSizes) -> FullTables:
    """Return the tables of a law, as far as currents within their limits lead."""
    reach = MARGIN * largest_field(law, limits.current)
    if reach > FURTHEST:
        raise InputError(
            f"current: its limits drive the iron to {reach:.0f} times its shape field a, beyond "
            f"{FURTHEST:.0f} the tables are too steep for 16 bits; narrow the current, or "
            "identify with --law play-cells",
            code="tables-too-steep",
            key="current",
        )
    n = sizes.curve_segments
    field = np.linspace(-reach, reach, 2 ** (n + 1) + 1)
    rising = field[2**n :]
    curve = langevin(rising)[0]
    level = np.linspace(0.0, 1.0, 2**sizes.inverse_segments + 1)
    inverse = np.interp(level, curve, rising)
    return FullTables(reach, curve, ascending_branch(law.kappa, field), inverse)


def _pack(law: Normal, tables: FullTables, sizes: TableSizes, pack: Packer) -> None:
    reach = tables.reach
    pack.set_single("UNIT_FIELD", reach * law.a)
    pack.table("FULL_CURVE", tables.curve, 32768.0)
    pack.table("FULL_BRANCH", tables.branch, 32768.0)
    pack.table("FULL_INVERSE", tables.inverse / reach, 32767.0)
    pack.put_weight("FULL_RATE", reach / (law.kappa * np.log(2.0)) / 16.0, "k")
    steepness = reach / law.kappa
    pack.put("FULL_STEEPNESS", min(steepness, MAX_Q8) if pack.is_fixed else steepness, "k", 1)
    pack.put("FULL_AIR", law.air * reach / 4.0, "h", least=1)
    pack.put("FULL_REVERSIBLE", law.c, "c")
    pack.put("FULL_PLAY", law.play / reach, "r_d")
    pack.set("FULL_ITERATIONS", sizes.iterations)
    pack.set("FULL_CURVE_SEGMENTS", sizes.curve_segments)
    pack.set("FULL_INVERSE_SEGMENTS", sizes.inverse_segments)
