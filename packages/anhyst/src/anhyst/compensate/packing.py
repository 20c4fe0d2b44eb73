"""Fill a parameter block with words and tables, and add its checksum.

All kinds share the limits of the signals, the start-up sequence and the tables over the gap
(`BlockFrame`). Each law adds its own tables (`LawTables`). `Packer` converts numbers to the number
format and lays the block out.
"""

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
    make_core,
    split_single,
)
from anhyst.compensate.circuit import (
    MAX_WEIGHT,
    WEIGHT_UNIT,
    CurrentCoefficients,
    LagCoefficients,
    current_coefficients,
    flux_gain,
    flux_shift,
    flux_unit,
    gap_knots,
    iron_parameters,
    lag_coefficient,
)
from anhyst.model.actuator import Model, least_slope
from anhyst.model.dynamics import Layers
from anhyst.support.block_layout import (
    BODY_WORDS,
    KINDS,
    LAYOUT_VERSION,
    MAGIC,
    MAX_BLOCK_WORDS,
    MAX_FLOAT_BLOCK_WORDS,
    MIN_BLOCK_WORDS,
    SIGNAL_UNITS,
    WORD_INDEX,
    WORD_INDEX_OF_KIND,
)
from anhyst.support.block_words import CODE_OF_ONE, Scales
from anhyst.support.errors import InputError
from anhyst.support.kinds import NumberFormat
from anhyst.support.numeric import FloatArray
from anhyst.support.units import MU_0

MIN_RING_MOVE = 64.0 / 32768.0
"""Smallest fraction of its distance that the flux inside a ring moves in a tick in fixed point. The
rounding error of a smaller fraction would exceed 0.8 %."""


def as_word(value: float, code_of_one: float, name: str) -> int:
    """Round a number to a 16-bit word in which `code_of_one` is 1.0."""
    word = round(value * code_of_one)
    word = 32767 if word == 32768 else word  # 1.0 becomes the largest word
    if not -32767 <= word <= 32767:
        text = f"{name}: {value:g} does not fit its 16-bit word; widen the scale"
        raise InputError(text, code="too-large-for-fixed-point", key=name)
    return word


def split_factor(factor: float, name: str) -> tuple[int, int]:
    """Split a positive factor into a weight (n/65536, below 0.5) and a shift of 0 to 12."""
    shift = 0
    while factor >= 0.4999 * 2.0**shift and shift <= 12:
        shift += 1
    weight = round(factor / 2.0**shift * 65536)
    if shift > 12 or weight < 1:
        text = f"{name}: {factor:g} is out of the range of fixed point"
        raise InputError(text, code="too-large-for-fixed-point", key=name)
    return weight, shift


WORD_FORMATS = {(kind, word.name): word.format for kind, body in BODY_WORDS.items() for word in body}
"""Format of each word, by kind and name."""


class Packer:
    """Collects words and tables in a number format, and makes a block with checksum.

    In fixed point, each number is rounded to a word. In floating point, a word is the number
    itself, and a shift that belongs to a weight is 0.
    """

    def __init__(self, kind: Kind, model_hash: int = 0, number_format: NumberFormat = "fixed") -> None:
        self.kind = kind
        self.number_format = number_format
        self._head = np.zeros(MIN_BLOCK_WORDS)
        self._head[0:4] = [*MAGIC, LAYOUT_VERSION, KINDS[kind]]
        model = WORD_INDEX["MODEL"]
        self._head[model : model + 2] = [model_hash & 0xFFFF, (model_hash >> 16) & 0xFFFF]
        self._tables: dict[str, FloatArray] = {}

    @property
    def is_fixed(self) -> bool:
        """Whether numbers are rounded to 16-bit words."""
        return self.number_format == "fixed"

    def put_integer(self, name: str, value: int) -> None:
        """Set a word to an integer."""
        self._head[WORD_INDEX_OF_KIND[self.kind][name]] = value

    def put_number(self, name: str, value: float, key: str, min_word: int = -32767) -> None:
        """Set a word to a number, but at least to `min_word`; messages contain `key`."""
        index = WORD_INDEX_OF_KIND[self.kind][name]
        code_of_one = CODE_OF_ONE[WORD_FORMATS[self.kind, name]]
        self._head[index] = max(as_word(value, code_of_one, key), min_word) if self.is_fixed else value

    def put_limit(self, name: str, value: float, scale: float, key: str) -> None:
        """Set a limit of a signal; rounded word times rounded scale never exceeds the limit."""
        self.put_number(name, value / scale, key)
        if not self.is_fixed:
            float_type = np.float32 if self.number_format == "f32" else np.float64
            word, full_value = float_type(value / scale), float_type(scale)
            while abs(float(word * full_value)) > abs(float(float_type(value))):
                word = np.nextafter(word, float_type(0.0))
            self._head[WORD_INDEX_OF_KIND[self.kind][name]] = word

    def put_weight(self, name: str, factor: float, key: str) -> None:
        """Set a positive factor as a weight, and its exponent in the word NAME_SHIFT."""
        weight, shift = split_factor(factor, key) if self.is_fixed else (factor, 0)
        self._head[WORD_INDEX_OF_KIND[self.kind][name]] = weight
        self.put_integer(f"{name}_SHIFT", shift)

    def put_single(self, name: str, value: float) -> None:
        """Set a number of single precision, which takes two words."""
        index = WORD_INDEX_OF_KIND[self.kind][name]
        self._head[index : index + 2] = split_single(value) if self.is_fixed else (value, 0.0)

    def put_table(self, name: str, values: FloatArray, code_of_one: float, min_word: int = -32767) -> None:
        """Add a table; in fixed point, the word `code_of_one` is 1.0."""
        words = np.asarray(values, dtype=np.float64)
        if self.is_fixed:
            words = np.maximum(np.rint(words * code_of_one), min_word)
            if np.abs(words).max() > 32767 or np.abs(np.diff(words)).max(initial=0) > 32767:
                largest_value = float(np.abs(values).max())
                raise InputError(
                    f"table {name.lower()}: {largest_value:.3g} exceeds the range of its 16-bit words, "
                    f"{32767 / code_of_one:.3g}; narrow the model's [valid], or correct its parameters",
                    code="too-large-for-fixed-point",
                )
        self._tables[name] = words.ravel()

    def make_block(self, scales: Scales, limits: DemandLimits) -> Block:
        """Lay out the block and add its checksum; equal tables are stored once."""
        for name, value in (
            ("SCALE_DEMAND", scales.demand),
            ("SCALE_CURRENT", scales.current),
            ("SCALE_GAP_LOW", scales.gap_low),
            ("SCALE_GAP_HIGH", scales.gap_high),
        ):
            self.put_single(name, value)
        tables: dict[str, tuple[int, int]] = {}
        block_parts = [self._head]
        end = MIN_BLOCK_WORDS
        for name, values in self._tables.items():
            duplicate_word = next(
                (n for n, v in self._tables.items() if n in tables and np.array_equal(v, values)), None
            )
            if duplicate_word is None:
                tables[name] = (end, values.size)
                block_parts.append(values)
                end += values.size
            else:
                tables[name] = tables[duplicate_word]
            self.put_integer(name, tables[name][0])
        if end > (MAX_BLOCK_WORDS if self.is_fixed else MAX_FLOAT_BLOCK_WORDS):
            raise InputError(
                f"the parameter block needs {2 * end} bytes, but a controller accepts {2 * MAX_BLOCK_WORDS}; "
                "request a lower accuracy",
                code="block-too-long",
            )
        self._head[WORD_INDEX["LENGTH"]] = end
        words = np.concatenate(block_parts)
        if self.is_fixed:
            words = (words.astype(np.int64) & 0xFFFF).astype("<u2").view("<i2")
        words = words.astype(DTYPES[self.number_format])
        return Block(self.kind, _add_checksum(words), scales, limits, tables)


def _add_checksum(words: NDArray[Any]) -> WordArray:
    """Set the checksum of two words; it covers the bytes of all other words, low byte first."""
    index = WORD_INDEX["CRC"]
    crc = zlib.crc32(np.concatenate([words[:index], words[index + 2 :]]).tobytes())
    crc_words = np.array([crc & 0xFFFF, crc >> 16])
    is_integer = np.issubdtype(words.dtype, np.integer)
    words[index : index + 2] = crc_words.astype(np.uint16).view(np.int16) if is_integer else crc_words
    return words.astype(words.dtype.newbyteorder("="))


@dataclass(frozen=True)
class LawTables:
    """Tables that a law adds to a block."""

    # bias, and coefficients of flux and field, at each gap; shape (n,)
    coefficients: tuple[FloatArray, FloatArray, FloatArray]
    pack: Callable[[Packer], None]  # sets words and tables
    offset: FloatArray | None = None  # output at zero flux at each gap; None: that of the model


def _pack_ring(packer: Packer, lag: LagCoefficients) -> None:
    """Set the words of a ring with leakage flux."""
    if packer.is_fixed and lag.keep > 1.0 - MIN_RING_MOVE:
        raise InputError(
            f"eddy_circuit: the flux inside the ring moves by only {1.0 - lag.keep:.2g} of its distance in a "
            "tick, which 16-bit words represent too coarsely; compile with --io f32, or for a lower rate",
            code="ring-too-slow",
            key="eddy_circuit",
        )
    packer.put_number("LAG_LEAKY", lag.leaky, "gamma", min_word=1)
    packer.put_number("LAG_KEEP", lag.keep, "gamma")


@dataclass(frozen=True)
class BlockFrame:
    """Parts of a block that all laws share: limits, start-up sequence, and tables over the gap."""

    model: Model
    scales: Scales
    limits: DemandLimits
    sizes: TableSizes
    conditioning: Conditioning

    @cached_property
    def gaps(self) -> FloatArray:
        """Gaps at which a table has entries, SI."""
        return gap_knots(self.model, self.scales, self.sizes)

    @cached_property
    def coefficients(self) -> CurrentCoefficients:
        """Coefficients of the current at the gaps of the tables."""
        return current_coefficients(self.model, self.gaps)

    def layer_fields(self, layers: Layers) -> tuple[float, float]:
        """Return the field in a layer, A/m: for a flux change of 1 in a tick, and for a flux of 1.

        A tick is one implicit step of the diffusion equation. The first field is that between two
        layers, divided by the sum of their fractions of the cross-section. As in
        :func:`current_coefficients`, ``H = (x - alpha*(1-alpha)*M_s*flux)/(1-alpha)`` in a layer.
        """
        iron, unit, rate = (iron_parameters(self.model), flux_unit(self.model), self.conditioning.rate)
        alpha = iron["alpha"]
        fractions = layers.area_fractions
        depth = 1.0 - 0.5 * (fractions[0] + fractions[-1])  # between the first and the last middle
        rate_field = iron["gamma"] * rate / (2.0 * depth) * unit * (1.0 - alpha)
        return rate_field, -alpha * unit / MU_0

    def make_block(
        self, kind: Kind, law: LawTables, model_hash: int, number_format: NumberFormat, *, is_static: bool
    ) -> Block:
        """Make the block of a law; `is_static` omits the lag of the flux."""
        packer = Packer(kind, model_hash, number_format)
        self._pack_signals(packer)
        self._pack_flux(packer, law.offset)
        lag = None if is_static else lag_coefficient(self.model, self.gaps, self.conditioning.rate)
        self._pack_coefficients(packer, *law.coefficients, None if lag is None else lag.current)
        if lag is not None and lag.leaky > 0.0:
            _pack_ring(packer, lag)
        law.pack(packer)
        block = packer.make_block(self.scales, self.limits)
        try:
            make_core(block)
        except ValueError as error:
            raise self._explain_rejection(block) from error
        return block

    def _pack_signals(self, packer: Packer) -> None:
        """Set limits, units and start-up sequence."""
        model, scales, limits = self.model, self.scales, self.limits
        for name, value, scale in (
            ("DEMAND_LOW", limits.demand[0], scales.demand),
            ("DEMAND_HIGH", limits.demand[1], scales.demand),
            ("CURRENT_LOW", limits.current[0], scales.current),
            ("CURRENT_HIGH", limits.current[1], scales.current),
        ):
            packer.put_limit(name, value, scale, name.lower())
        packer.put_single("SCALE_RATE", self.conditioning.rate)
        gap = model.schedule.unit if model.schedule is not None else ""
        codes = [SIGNAL_UNITS.index(unit) for unit in (model.output.unit, model.input.unit, gap)]
        packer.put_integer("SCALE_UNITS", codes[0] + 16 * codes[1] + 256 * codes[2])
        packer.put_integer("CONDITION_CYCLES", self.conditioning.cycles)
        packer.put_integer("CONDITION_TICKS", self.conditioning.ramp_ticks)

    def _pack_flux(self, packer: Packer, offset: FloatArray | None) -> None:
        """Set the conversion from demand to flux; `offset` replaces that of the model."""
        model, scales = self.model, self.scales
        packer.put_integer("POWER", model.power)
        packer.put_integer("ROOT_KNEE", self.sizes.root_knee)
        packer.put_integer("GAP_SEGMENTS", self.sizes.gap_segments if model.needs_schedule else 0)
        gain = flux_gain(model, scales, self.gaps)
        shift = flux_shift(gain) if packer.is_fixed else 0
        packer.put_integer("FLUX_SHIFT", shift)
        packer.put_number("FLUX_LIMIT", 1.0, "flux")
        packer.put_table("GAP_GAIN", gain / 2.0**shift, WEIGHT_UNIT, min_word=1)
        offset = model.interpolate_parameter("out_0", self.gaps) if offset is None else offset
        packer.put_table("GAP_OFFSET", offset / scales.demand, 32768.0)

    def _pack_coefficients(
        self,
        packer: Packer,
        bias: FloatArray,
        flux_coefficient: FloatArray,
        field_coefficient: FloatArray,
        lag_coefficient: FloatArray | None,
    ) -> None:
        """Set the coefficients of the current, in A per unit of flux, field and lag."""
        full_scale = self.scales.current
        columns = (
            (bias, flux_coefficient, field_coefficient)
            if lag_coefficient is None
            else (bias, flux_coefficient + lag_coefficient, lag_coefficient, field_coefficient)
        )
        spans = [max(np.abs(column).max(), np.abs(np.diff(column)).max()) for column in columns]
        largest_coefficient = max(spans) / full_scale
        shift = max(0, int(np.ceil(np.log2(largest_coefficient / MAX_WEIGHT)))) if packer.is_fixed else 0
        if shift > 8:
            raise InputError(
                f"current: a unit of flux or field needs {largest_coefficient:.0f} times the full-scale current, "
                "which exceeds the range of 16-bit words; compile with --io f32",
                code="weights-too-uneven",
                key="current",
            )
        unit = full_scale * 2.0**shift
        packer.put_integer("CURRENT_SHIFT", shift)
        packer.put_table("GAP_BIAS", bias / unit, WEIGHT_UNIT)
        packer.put_table("GAP_FLUX_ARM", flux_coefficient / unit, WEIGHT_UNIT)
        packer.put_table("GAP_FIELD_ARM", field_coefficient / unit, WEIGHT_UNIT, min_word=1)
        if lag_coefficient is not None:
            packer.put_table("GAP_LAG_ARM", lag_coefficient / unit, WEIGHT_UNIT, min_word=0)

    def _explain_rejection(self, block: Block) -> InputError:
        """Return the reason why the core rejects a block."""
        least_drive_slope = least_slope(self.model, self.gaps).min()
        if least_drive_slope < 1.0 and block.is_fixed:
            return InputError(
                f"alpha: the output nearly jumps at some currents (smallest slope of the drive "
                f"{least_drive_slope:.2g} of that without iron), too steep for 16-bit tables; "
                "compile with --io f32",
                code="tables-too-steep",
                key="alpha",
            )
        return InputError(
            "[parameters]: a law of these magnitudes does not fit into the tables of a block; correct "
            "the parameters",
            code="law-beyond-the-tables",
            key="parameters",
        )
