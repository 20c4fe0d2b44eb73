"""What all kinds of compensator of one model share: places over the gap, and how a current is made up.

A demand gives the flux at each gap, and the flux, with the field that the law finds for it, gives the
current. A kind adds the tables of its law (:class:`LawTables`).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

import numpy as np

from anhyst.compensate.block import (
    Block,
    Conditioning,
    DemandLimits,
    Kind,
    Packer,
    TableSizes,
    core_of,
)
from anhyst.model.actuator import Model, least_slope
from anhyst.model.dynamics import Layers
from anhyst.support.block_layout import UNITS
from anhyst.support.block_words import Scales
from anhyst.support.errors import InputError
from anhyst.support.kinds import NumberFormat
from anhyst.support.numeric import FloatArray
from anhyst.support.units import MU_0

if TYPE_CHECKING:
    from anhyst.laws.cells import CellWeights


def iron_of(model: Model) -> Mapping[str, float]:
    """Return the parameters of the iron, the same at every gap of what can be compiled."""
    return model.parameters_at(model.first_node)


def saturation(model: Model) -> float:
    """Return the largest magnetisation, A/m."""
    iron, law = iron_of(model), model.operator_law
    if law.cells is not None:
        return law.cells(iron).saturation
    return sum(iron[spec.name] for spec in law.with_role("saturation"))


def cell_weights(model: Model) -> CellWeights:
    """Return the cells of a model whose law has some."""
    cells = model.operator_law.cells
    assert cells is not None
    return cells(iron_of(model))


WEIGHT = 65536.0
LARGEST_WEIGHT = 32767 / WEIGHT
MOST_FLUX_SHIFT = 6


def nodes(model: Model, scales: Scales, sizes: TableSizes) -> FloatArray:
    """Places over the gap at which a table has its entries, SI."""
    if not model.needs_schedule:
        return np.full(2, scales.gap_low)
    return np.linspace(scales.gap_low, scales.gap_high, 2**sizes.gap_segments + 1)


def flux_unit(model: Model) -> float:
    """Flux density of saturated iron without the air around it, T: the unit of the inner flux."""
    return MU_0 * saturation(model) * (1.0 - iron_of(model)["alpha"])


def flux_shift(gain: FloatArray) -> int:
    """Return by how many bits gains of the flux are shifted to fit into their table."""
    if not gain.max() <= LARGEST_WEIGHT * 2.0**MOST_FLUX_SHIFT:
        raise InputError(
            "flux: the full-scale demand is far beyond saturation; narrow the output in the "
            "model's [valid], or correct its parameters",
            code="demand-beyond-saturation",
            key="flux",
        )
    return max(0, int(np.ceil(np.log2(gain.max() / LARGEST_WEIGHT))))


def flux_gain(model: Model, scales: Scales, at: FloatArray) -> FloatArray:
    """Return the flux of a full-scale output at each node, in units of :func:`flux_unit`."""
    full = scales.demand / model.over_schedule("c_out", at)
    return np.asarray((np.sqrt(full) if model.power == 2 else full) / flux_unit(model))


@dataclass(frozen=True)
class Arms:
    """How a current is made up at places over the gap: ``bias + flux_arm*flux + field_arm*x``."""

    # flux, in parts of that of saturated iron, for an effective field ``x`` of 1 A/m without iron
    air: float
    # in units of the input; for a flux of 1, and for an effective field of 1 A/m; shape (n,)
    bias: FloatArray
    flux_arm: FloatArray
    field_arm: FloatArray


def arms_of(model: Model, at: FloatArray) -> Arms:
    """Bring the circuit of a model into the form of a compensator, at places over the gap.

    ``c_H*(I - in_0) = x/(1-alpha) + (rho - alpha/(1-alpha))*B/mu0`` with
    ``B/mu0 = (1-alpha)*M_s*flux``; a rewriting of section 2 of the theory.
    """
    alpha = iron_of(model)["alpha"]
    turns, rho = (model.over_schedule(name, at) for name in ("c_H", "rho"))
    saturated = flux_unit(model) / MU_0
    return Arms(
        air=1.0 / saturated,
        bias=model.over_schedule("in_0", at),
        flux_arm=np.asarray(saturated * (rho - alpha / (1.0 - alpha)) / turns),
        field_arm=np.asarray(1.0 / ((1.0 - alpha) * turns)),
    )


def lag_arm(model: Model, at: FloatArray, rate: float) -> FloatArray | None:
    """Return the current for a flux that rises by 1 in a tick, one value a node; None without a lag.

    ``c_H*(I - in_0) = H + rho*B/mu0 + gamma*dB/dt``, the derivative as a backward difference.
    """
    if model.layers is not None or not model.has_eddy_currents:
        return None
    gamma, turns = (model.over_schedule(name, at) for name in ("gamma", "c_H"))
    return np.asarray(gamma * rate * flux_unit(model) / turns)


class LawTables(Protocol):
    """What a kind adds to a block: the tables of its law, with fields in a unit of its own."""

    @property
    def arms(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Bias, and the currents for a flux and for a field of 1, at each place; shape (n,)."""

    @property
    def offset(self) -> FloatArray | None:
        """Output at zero flux, at each place; None: that of the model."""

    def pack(self, pack: Packer) -> None:
        """Put words and tables into a block."""


@dataclass(frozen=True)
class Frame:
    """What a block has whatever its law: limits, start-up, and the tables over the gap."""

    model: Model
    scales: Scales
    limits: DemandLimits
    sizes: TableSizes
    conditioning: Conditioning

    @cached_property
    def at(self) -> FloatArray:
        """Places over the gap at which a table has its entries, SI."""
        return nodes(self.model, self.scales, self.sizes)

    @cached_property
    def arms(self) -> Arms:
        """How the model makes up a current at these places."""
        return arms_of(self.model, self.at)

    def layer_fields(self, layers: Layers) -> tuple[float, float]:
        """Return what a flux of 1 counts in the field of a layer, A/m: by its change in a tick, by itself.

        One tick is one implicit step of the diffusion. In a layer, as in :func:`arms_of`,
        ``H = (x - alpha*(1-alpha)*M_s*flux)/(1-alpha)``.
        """
        iron, unit, rate = iron_of(self.model), flux_unit(self.model), self.conditioning.rate
        alpha = iron["alpha"]
        hold = iron["gamma"] * rate / (layers.count - 1) * unit * (1.0 - alpha)
        return hold, -alpha * unit / MU_0

    def block(
        self,
        kind: Kind,
        law: LawTables,
        model_hash: int,
        number_format: NumberFormat,
        *,
        still: bool,
    ) -> Block:
        """Put everything into a block; `still` leaves the lag of the flux out."""
        pack = Packer(kind, model_hash, number_format)
        self._pack_signals(pack)
        self._pack_flux(pack, law.offset)
        lag = None if still else lag_arm(self.model, self.at, self.conditioning.rate)
        self._pack_arms(pack, *law.arms, lag)
        law.pack(pack)
        block = pack.close(self.scales, self.limits)
        try:
            core_of(block)
        except ValueError as error:
            raise self._refusal(block) from error
        return block

    def _pack_signals(self, pack: Packer) -> None:
        """Put limits, units and start-up."""
        model, scales, limits = self.model, self.scales, self.limits
        for name, value, scale in (
            ("DEMAND_LOW", limits.demand[0], scales.demand),
            ("DEMAND_HIGH", limits.demand[1], scales.demand),
            ("CURRENT_LOW", limits.current[0], scales.current),
            ("CURRENT_HIGH", limits.current[1], scales.current),
        ):
            pack.put_limit(name, value, scale, name.lower())
        pack.set_single("SCALE_RATE", self.conditioning.rate)
        gap = model.schedule.unit if model.schedule is not None else ""
        codes = [UNITS.index(unit) for unit in (model.output.unit, model.input.unit, gap)]
        pack.set("SCALE_UNITS", codes[0] + 16 * codes[1] + 256 * codes[2])
        pack.set("CONDITION_CYCLES", self.conditioning.cycles)
        pack.set("CONDITION_TICKS", self.conditioning.ramp_ticks)

    def _pack_flux(self, pack: Packer, offset: FloatArray | None) -> None:
        """Put the way from demand to flux; `offset` instead of the model's."""
        model, scales = self.model, self.scales
        pack.set("POWER", model.power)
        pack.set("ROOT_KNEE", self.sizes.root_knee)
        pack.set("GAP_SEGMENTS", self.sizes.gap_segments if model.needs_schedule else 0)
        gain = flux_gain(model, scales, self.at)
        shift = flux_shift(gain) if pack.is_fixed else 0
        pack.set("FLUX_SHIFT", shift)
        pack.put("FLUX_LIMIT", 1.0, "flux")
        pack.table("GAP_GAIN", gain / 2.0**shift, WEIGHT, least=1)
        offset = model.over_schedule("out_0", self.at) if offset is None else offset
        pack.table("GAP_OFFSET", offset / scales.demand, 32768.0)

    def _pack_arms(
        self,
        pack: Packer,
        bias: FloatArray,
        flux_arm: FloatArray,
        field_arm: FloatArray,
        lag: FloatArray | None,
    ) -> None:
        """Put how the current is made up, A for each unit of flux, field and lag."""
        full = self.scales.current
        arms = (
            (bias, flux_arm, field_arm) if lag is None else (bias, flux_arm + lag, lag, field_arm)
        )
        spans = [max(np.abs(part).max(), np.abs(np.diff(part)).max()) for part in arms]
        largest = max(spans) / full
        shift = max(0, int(np.ceil(np.log2(largest / LARGEST_WEIGHT)))) if pack.is_fixed else 0
        if shift > 8:
            raise InputError(
                f"current: a unit of flux or field counts for {largest:.0f} times the full-scale "
                "current, more than 16-bit words can weigh against each other; compile with --io f32",
                code="weights-too-uneven",
                key="current",
            )
        unit = full * 2.0**shift
        pack.set("CURRENT_SHIFT", shift)
        pack.table("GAP_BIAS", bias / unit, WEIGHT)
        pack.table("GAP_FLUX_ARM", flux_arm / unit, WEIGHT)
        pack.table("GAP_FIELD_ARM", field_arm / unit, WEIGHT, least=1)
        if lag is not None:
            pack.table("GAP_LAG_ARM", lag / unit, WEIGHT, least=0)

    def _refusal(self, block: Block) -> InputError:
        """Return why the core does not take a block."""
        steepest = least_slope(self.model, self.at).min()
        if steepest < 1.0 and block.is_fixed:
            return InputError(
                f"alpha: the output all but jumps at some currents (least slope of the drive "
                f"{steepest:.2g} of that without iron), nearer than 16-bit tables can follow; "
                "compile with --io f32",
                code="tables-too-steep",
                key="alpha",
            )
        return InputError(
            "[parameters]: the tables of a block cannot hold a law of these magnitudes; correct the "
            "parameters",
            code="law-beyond-the-tables",
            key="parameters",
        )
