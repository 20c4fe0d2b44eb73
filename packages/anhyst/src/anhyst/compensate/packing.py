"""How a parameter block is filled: what all kinds share, and the tables that a law adds."""

from __future__ import annotations

import zlib
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from anhyst.compensate.block import (
    DTYPES,
    Block,
    Conditioning,
    DemandLimits,
    Kind,
    TableSizes,
    WordArray,
    core_of,
    single_words,
)
from anhyst.compensate.circuit import (
    LARGEST_WEIGHT,
    WEIGHT,
    Arms,
    arms_of,
    flux_gain,
    flux_shift,
    flux_unit,
    iron_of,
    lag_arm,
    nodes,
)
from anhyst.model.actuator import Model, least_slope
from anhyst.model.dynamics import Layers
from anhyst.support.block_layout import (
    BODY,
    KINDS,
    LAYOUT,
    LEAST_WORDS,
    MAGIC,
    MOST_REAL_WORDS,
    MOST_WORDS,
    PLACES,
    UNITS,
    WORDS,
)
from anhyst.support.block_words import ONES, Scales
from anhyst.support.errors import InputError
from anhyst.support.kinds import NumberFormat
from anhyst.support.numeric import FloatArray
from anhyst.support.units import MU_0


def as_word(value: float, unit: float, name: str) -> int:
    """Round a number to a word in which `unit` is 1.0."""
    word = round(value * unit)
    word = 32767 if word == 32768 else word  # 1.0 is the largest number of its format
    if not -32767 <= word <= 32767:
        text = f"{name}: {value:g} does not fit its 16-bit word; widen the scale"
        raise InputError(text, code="too-large-for-fixed-point", key=name)
    return word


def mantissa(factor: float, name: str) -> tuple[int, int]:
    """Split a positive factor into a weight (n/65536, below 0.5) and a shift of 0 to 12."""
    shift = 0
    while factor >= 0.4999 * 2.0**shift and shift <= 12:
        shift += 1
    weight = round(factor / 2.0**shift * 65536)
    if shift > 12 or weight < 1:
        text = f"{name}: {factor:g} is out of the range of fixed point"
        raise InputError(text, code="too-large-for-fixed-point", key=name)
    return weight, shift


FORMATS = {(kind, word.name): word.format for kind, body in BODY.items() for word in body}
"""Format of each word of a kind, by its name."""


class Packer:
    """Collects words and tables in a number format, and closes the block with its checksum.

    Fixed point rounds every number to its word. In floating point a word is the number itself, and
    a shift that belongs to a weight is 0.
    """

    def __init__(
        self, kind: Kind, model_hash: int = 0, number_format: NumberFormat = "fixed"
    ) -> None:
        self.kind = kind
        self.number_format = number_format
        self._head = np.zeros(LEAST_WORDS)
        self._head[0:4] = [*MAGIC, LAYOUT, KINDS[kind]]
        model = PLACES["MODEL"]
        self._head[model : model + 2] = [model_hash & 0xFFFF, (model_hash >> 16) & 0xFFFF]
        self._tables: dict[str, FloatArray] = {}

    @property
    def is_fixed(self) -> bool:
        """Whether numbers are rounded to 16-bit words."""
        return self.number_format == "fixed"

    def set(self, name: str, value: int) -> None:
        """Put an integer."""
        self._head[WORDS[self.kind][name]] = value

    def put(self, name: str, value: float, key: str, least: int = -32767) -> None:
        """Put a number; `least` is its smallest word, and `key` names it in a message."""
        at = WORDS[self.kind][name]
        one = ONES[FORMATS[self.kind, name]]
        self._head[at] = max(as_word(value, one, key), least) if self.is_fixed else value

    def put_limit(self, name: str, value: float, scale: float, key: str) -> None:
        """Put a limit of a signal; the rounded word times the rounded scale is never beyond it."""
        self.put(name, value / scale, key)
        if not self.is_fixed:
            real = np.float32 if self.number_format == "f32" else np.float64
            word, full = real(value / scale), real(scale)
            while abs(float(word * full)) > abs(float(real(value))):
                word = np.nextafter(word, real(0.0))
            self._head[WORDS[self.kind][name]] = word

    def put_weight(self, name: str, factor: float, key: str) -> None:
        """Put a positive factor as a weight, and its exponent in the word NAME_SHIFT."""
        weight, shift = mantissa(factor, key) if self.is_fixed else (factor, 0)
        self._head[WORDS[self.kind][name]] = weight
        self.set(f"{name}_SHIFT", shift)

    def set_single(self, name: str, value: float) -> None:
        """Put a number of two words."""
        at = WORDS[self.kind][name]
        self._head[at : at + 2] = single_words(value) if self.is_fixed else (value, 0.0)

    def table(self, name: str, values: FloatArray, unit: float, least: int = -32767) -> None:
        """Put a table of numbers, or rows of one, in which the word `unit` is 1.0 in fixed point."""
        words = np.asarray(values, dtype=np.float64)
        if self.is_fixed:
            words = np.maximum(np.rint(words * unit), least)
            if np.abs(words).max() > 32767 or np.abs(np.diff(words)).max(initial=0) > 32767:
                largest = float(np.abs(values).max())
                raise InputError(
                    f"table {name.lower()}: {largest:.3g} does not fit into its 16 bits, which end "
                    f"at {32767 / unit:.3g}; narrow the model's [valid], or correct its parameters",
                    code="too-large-for-fixed-point",
                )
        self._tables[name] = words.ravel()

    def close(self, scales: Scales, limits: DemandLimits) -> Block:
        """Lay everything out."""
        for name, value in (
            ("SCALE_DEMAND", scales.demand),
            ("SCALE_CURRENT", scales.current),
            ("SCALE_GAP_LOW", scales.gap_low),
            ("SCALE_GAP_HIGH", scales.gap_high),
        ):
            self.set_single(name, value)
        tables: dict[str, tuple[int, int]] = {}
        parts = [self._head]
        end = LEAST_WORDS
        for name, values in self._tables.items():
            same = next(
                (n for n, v in self._tables.items() if n in tables and np.array_equal(v, values)),
                None,
            )
            if same is None:
                tables[name] = (end, values.size)
                parts.append(values)
                end += values.size
            else:
                tables[name] = tables[same]
            self.set(name, tables[name][0])
        if end > (MOST_WORDS if self.is_fixed else MOST_REAL_WORDS):
            raise InputError(
                f"the parameter block needs {2 * end} bytes, a controller takes {2 * MOST_WORDS}; "
                "ask for less accuracy",
                code="block-too-long",
            )
        self._head[PLACES["LENGTH"]] = end
        words = np.concatenate(parts)
        if self.is_fixed:
            words = (words.astype(np.int64) & 0xFFFF).astype("<u2").view("<i2")
        words = words.astype(DTYPES[self.number_format])
        return Block(self.kind, _with_checksum(words), scales, limits, tables)


def _with_checksum(words: NDArray[Any]) -> WordArray:
    """Put the checksum into its two words; it runs over the bytes of all others, low byte first."""
    at = PLACES["CRC"]
    crc = zlib.crc32(np.concatenate([words[:at], words[at + 2 :]]).tobytes())
    halves = np.array([crc & 0xFFFF, crc >> 16])
    is_integer = np.issubdtype(words.dtype, np.integer)
    words[at : at + 2] = halves.astype(np.uint16).view(np.int16) if is_integer else halves
    return words.astype(words.dtype.newbyteorder("="))


@dataclass(frozen=True)
class LawTables:
    """What a kind adds to a block: the tables of its law, with fields in a unit of its own."""

    # bias, and the currents for a flux and for a field of 1, at each place over the gap; shape (n,)
    arms: tuple[FloatArray, FloatArray, FloatArray]
    pack: Callable[[Packer], None]  # puts words and tables
    offset: FloatArray | None = None  # output at zero flux at each place; None: that of the model


@dataclass(frozen=True)
class BlockFrame:
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
