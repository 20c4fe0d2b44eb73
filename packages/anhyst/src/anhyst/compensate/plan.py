"""Plan how a model is compiled: signal scales, limits, table sizes and the start-up sequence.

`make_plan` makes all these choices for a model and a `CompileRequest`. The search selects the
smallest tables that keep the requested accuracy.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from anhyst.compensate.block import Block, Conditioning, DemandLimits, Kind, TableSizes
from anhyst.compensate.builder import BlockBuilder
from anhyst.compensate.circuit import flux_gain, flux_shift
from anhyst.compensate.force_controller import SignalFormat
from anhyst.compensate.search import BlockSearch, BlockSearchResult
from anhyst.data.output_map import output_map
from anhyst.data.path import History
from anhyst.model.actuator import Model, find_compile_obstacle
from anhyst.support.block_words import Scales
from anhyst.support.cache import c_name, check_c_name
from anhyst.support.errors import InputError, NegativeResult

RAMP_TIME_S = 0.25
"""Duration of one start-up ramp, which is slow for an amplifier. The number of ticks is limited to
2..32767."""

MAX_CYCLES = 16
MAX_REMAINING_SHARE = 0.1
"""Largest remaining difference after the start-up, as a fraction of the accuracy."""

MAX_CYCLE_RATIO = 0.99
"""A further start-up cycle is not used if more than this fraction of the previous difference would
remain. A single cycle moves all play operators that it reaches."""

RAMP_SAMPLES = 60
"""Number of samples of a ramp in the simulation. The model is exact at any sampling."""

START_REVERSALS = (-2.0, -1.0, -0.4, 0.0, 0.4, 1.0, 2.0)
"""Last currents of the tested histories before the start-up, relative to the largest current."""


@dataclass(frozen=True, slots=True)
class StartUp:
    """Start-up sequence, and the difference that remains after it."""

    conditioning: Conditioning  # start-up sequence of the parameter block
    seconds: float  # duration, s
    # largest difference of the outputs after the sequence, for any two histories, in units of the
    # output
    remaining_difference: float


def plan_start_up(
    model: Model, scales: Scales, limits: DemandLimits, rate: float, accuracy: float
) -> StartUp:
    """Select the number of cycles of the start-up sequence."""
    ticks = int(np.clip(round(rate * RAMP_TIME_S), 2, 32767))
    cycles, remaining_difference = 1, difference_after_start_up(model, scales, limits, 1)
    while remaining_difference > MAX_REMAINING_SHARE * accuracy and cycles < MAX_CYCLES:
        next_difference = difference_after_start_up(model, scales, limits, cycles + 1)
        if next_difference > MAX_CYCLE_RATIO * remaining_difference:
            break
        cycles, remaining_difference = cycles + 1, next_difference
    return StartUp(Conditioning(cycles, ticks, rate), 2 * cycles * ticks / rate, remaining_difference)


def difference_after_start_up(model: Model, scales: Scales, limits: DemandLimits, cycles: int) -> float:
    """Return the largest difference of the outputs for different histories, over all gaps.

    The model runs a number of start-up cycles, and then a test sequence.
    """
    low, high = limits.current
    reversal_currents = [low, high] * cycles + [low]
    reversal_currents += [low + fraction * (high - low) for fraction in [0.6, 0.3, 0.8, 0.1, 0.4, 0.0]]
    drive = np.concatenate(
        [[low], *(np.linspace(*ends, RAMP_SAMPLES + 1)[1:] for ends in pairwise(reversal_currents))]
    )
    first_sample = 1 + 2 * RAMP_SAMPLES * cycles
    gaps = (scales.gap_low, scales.gap_high) if model.needs_schedule else (scales.gap_low,)
    largest_difference = 0.0
    for gap in gaps:
        outputs = np.array(
            [
                model.predict(drive, gap, history=history).output[first_sample:]
                for history in _start_histories(high)
            ]
        )
        largest_difference = max(largest_difference, float(np.ptp(outputs, axis=0).max()))
    return largest_difference


def _start_histories(largest_current: float) -> list[History]:
    reversal_texts = (f"conditioned:{level * largest_current!r},0" for level in START_REVERSALS if level)
    return [History.parse(text) for text in ("demagnetised", *reversal_texts)]


CHECKED_GAPS = 65
"""Number of gaps at which the flux gain of the model is checked."""

ROUND_MANTISSAS = (1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)
"""Mantissas of full-scale values, which are multiplied by a power of ten."""

DEFAULT_ACCURACY_PERCENT = 0.1
"""Largest deviation due to formats and tables without ``--accuracy``, % of the largest output."""

MIN_ACCURACY_PERCENT = 1e-3
MAX_ACCURACY_PERCENT = 50.0

RATE_RANGE_HZ = (1.0, 1e6)


@dataclass(frozen=True, slots=True)
class CompileRequest:
    """Options of a compilation that the user gives."""

    kind: Kind  # ``"full"`` or ``"simplified"`` (``"euler"`` is the baseline of the benchmarks)
    io: SignalFormat  # format of the signals: ``"q15"``, ``"q31"`` or ``"f32"``
    rate: float  # sample rate, 1 to 10^6 Hz
    # largest deviation from the model, % of the largest output; None:
    # :data:`DEFAULT_ACCURACY_PERCENT` for formats and tables, without a limit for the
    # simplification of the law
    accuracy: float | None = None
    name: str | None = None  # name of the actuator in C; None: derived from the model

    def __post_init__(self) -> None:
        if not RATE_RANGE_HZ[0] <= self.rate <= RATE_RANGE_HZ[1]:
            raise InputError(
                f"--rate: is {self.rate:g} Hz; give 1 to 1000000", code="out-of-range", key="--rate"
            )
        if self.accuracy is not None and not MIN_ACCURACY_PERCENT <= self.accuracy <= MAX_ACCURACY_PERCENT:
            text = f"--accuracy: is {self.accuracy:g} %; give {MIN_ACCURACY_PERCENT:g} to {MAX_ACCURACY_PERCENT:g}"
            raise InputError(text, code="out-of-range", key="--accuracy")
        if self.name is not None:
            check_c_name(self.name)


@dataclass(frozen=True, slots=True)
class Decision:
    """One choice of the plan, with its reason."""

    name: str
    value: str
    reason: str


@dataclass(frozen=True)
class Plan:
    """All choices for the compilation of a model."""

    name: str  # name of the actuator in C: prefix of its files and identifiers
    request: CompileRequest  # options of the user
    model: Model  # static model, without lag and layers
    builder: BlockBuilder  # the model, with scales and limits
    sizes: TableSizes  # sizes of tables and number of iterations
    block: Block  # parameter block
    static_block: Block  # block without eddy-current lag; the same block if the model has none
    start_up: StartUp  # start-up sequence, and the difference that remains after it
    search_result: BlockSearchResult  # errors of all tested table sizes
    reference_output: float  # output that is 100 % in relative errors; see :func:`reference_output`
    allowance: float  # largest deviation due to formats and tables, in units of the output


def round_full_scale(magnitude: float) -> float:
    """Return the next round value above the largest magnitude of a signal.

    >>> round_full_scale(291.5), round_full_scale(3.01), round_full_scale(0.1)
    (300.0, 4.0, 0.12)
    """
    decade = 10.0 ** np.floor(np.log10(magnitude))
    # No code represents the value 1.0 itself.
    mantissa = next(
        candidate for candidate in ROUND_MANTISSAS if candidate * decade > magnitude * (1.0 + 2.0**-15)
    )
    return float(f"{mantissa * decade:.6g}")


def largest_demand(limits: DemandLimits) -> float:
    """Return the largest magnitude of a demand."""
    return max(abs(end) for end in limits.demand)


def reference_output(model: Model, limits: DemandLimits) -> float:
    """Return the output that is 100 %: the largest demand.

    An output without a natural zero, such as a position, is related to the range of its demands.
    """
    if output_map(model.output).has_natural_zero:
        return largest_demand(limits)
    return limits.demand[1] - limits.demand[0]


def make_plan(
    model: Model,
    request: CompileRequest,
    model_hash: int,
    allowance_share: float = 1.0,
    scales: Scales | None = None,
) -> Plan:
    """Select scales, limits, table sizes and start-up sequence for a model.

    The search may use only `allowance_share` of the allowed deviation.
    """
    if (reason := find_compile_obstacle(model)) is not None:
        raise InputError(reason, code="no-fixed-point-form")
    dynamic_model = model if model.has_layers or model.has_lag else None
    if model.layers is not None and request.kind != "full":
        raise InputError(
            "layers: a solid core needs --kind full; give it, or use the static model (at_rest)",
            code="layers-need-full",
            key="layers",
        )
    model = model.at_rest
    limits = find_limits(model)
    scales = scales or find_scales(model, limits)
    flux_shift(flux_gain(model, scales, np.linspace(scales.gap_low, scales.gap_high, CHECKED_GAPS)))
    reference = reference_output(model, limits)
    allowance = DEFAULT_ACCURACY_PERCENT / 100.0 * reference
    if request.accuracy is not None:
        tolerance = request.accuracy / 100.0 * reference
        allowance = tolerance if request.kind == "full" else min(tolerance, allowance)
    try:
        start_up = plan_start_up(model, scales, limits, request.rate, allowance)
    except InputError as error:
        raise not_computed_error(error) from error
    settings = model, request.kind, request.io, scales, limits
    builder = BlockBuilder(*settings, start_up.conditioning, model_hash, dynamic_model)
    result = BlockSearch(builder, allowance_share * allowance).run()
    sizes, block = result.sizes, builder.dynamic_block(result.sizes)
    static_block = block if dynamic_model is None else builder(sizes)
    name = request.name or c_name(model.name)
    return Plan(
        name, request, model, builder, sizes, block, static_block, start_up, result, reference, allowance
    )


def not_computed_error(error: InputError | NegativeResult) -> InputError:
    """Return the exception for a model whose law cannot be calculated within its own limits.

    `error` states where the calculation failed.
    """
    return InputError(
        f"[valid]: the law cannot be calculated within these limits ({error}); narrow them, or "
        "correct the parameters",
        code="not-computed",
        key="valid",
    )


def find_limits(model: Model) -> DemandLimits:
    """Return the limits of demand and current: the valid range of the model."""
    valid = model.valid_range
    low, high = valid.output
    # A force is proportional to the square of the flux. Negative measured values are noise.
    limits = DemandLimits((max(low, 0.0) if model.power == 2 else low, high), valid.input)
    schedule = valid.schedule
    ranges = [("output", limits.demand), ("input", limits.current)]
    if model.needs_schedule:
        ranges.append(("schedule", schedule or (0.0, 0.0)))
    for name, (low, high) in ranges:
        if not low < high:
            raise InputError(
                f"[valid]: the range of the {name}, {low:g} to {high:g}, is empty; give its limits",
                code="range-too-narrow",
                key="valid",
            )
    return limits


def _largest_demand_word(model: Model, limits: DemandLimits) -> float:
    """Return the largest magnitude of a demand, or of a demand minus the output at zero flux."""
    largest_demand_value = largest_demand(limits)
    if output_map(model.output).has_natural_zero:
        return largest_demand_value
    offsets = np.atleast_1d(model.parameters["out_0"])
    return max(
        largest_demand_value,
        *(abs(float(offset) - end) for offset in offsets for end in (0.0, *limits.demand)),
    )


def find_scales(model: Model, limits: DemandLimits) -> Scales:
    """Return the full scales of the signals: round values, except for the range of the gap."""
    gap_low, gap_high = model.valid_range.schedule or (0.0, 0.0)
    return Scales(
        demand=round_full_scale(_largest_demand_word(model, limits)),
        current=round_full_scale(max(abs(end) for end in limits.current)),
        gap_low=gap_low,
        gap_high=gap_high,
    )
