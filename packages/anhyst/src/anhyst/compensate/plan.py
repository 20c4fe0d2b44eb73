"""What is compiled and how: scales of the signals, limits, sizes of tables, and why."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from anhyst.compensate.block import Block, Conditioning, DemandLimits, Kind, TableSizes
from anhyst.compensate.builder import BlockBuilder
from anhyst.compensate.circuit import flux_gain, flux_shift
from anhyst.compensate.force_controller import Io
from anhyst.compensate.search import BlockSearch, SearchResult
from anhyst.data.output_map import output_map
from anhyst.data.path import History
from anhyst.model.actuator import Model, find_compile_obstacle
from anhyst.support.block_words import Scales
from anhyst.support.cache import c_name, check_c_name
from anhyst.support.errors import InputError, NegativeResult

RAMP_TIME_S = 0.25
"""Duration of one ramp, where the ticks of the controller allow: slow for an amplifier."""

MAX_CYCLES = 16
MAX_REMAINING_SHARE = 0.1
"""Of the wanted accuracy: so much may be left of an unknown start."""

MAX_CYCLE_RATIO = 0.99
"""What a further cycle leaves, in parts of what was left, from which on there is none: one cycle moves
all plays that it reaches at all."""

RAMP_SAMPLES = 60
"""Samples of a ramp in the simulation; the model is exact at any sampling."""

START_REVERSALS = (-2.0, -1.0, -0.4, 0.0, 0.4, 1.0, 2.0)
"""Turning points, over the largest current, after which the iron is left to itself."""


@dataclass(frozen=True, slots=True)
class StartUp:
    """The sequence, and what is left of an unknown start after it."""

    conditioning: Conditioning  # as it stands in the parameter block
    seconds: float  # how long it takes
    # largest difference of the output afterwards between any two starts, in its unit
    remaining_difference: float


def plan_start_up(
    model: Model, scales: Scales, limits: DemandLimits, rate: float, accuracy: float
) -> StartUp:
    """Choose the sequence."""
    ticks = int(np.clip(round(rate * RAMP_TIME_S), 2, 32767))
    cycles, remaining = 1, difference_after_start_up(model, scales, limits, 1)
    while remaining > MAX_REMAINING_SHARE * accuracy and cycles < MAX_CYCLES:
        with_one_more = difference_after_start_up(model, scales, limits, cycles + 1)
        if with_one_more > MAX_CYCLE_RATIO * remaining:
            break
        cycles, remaining = cycles + 1, with_one_more
    return StartUp(Conditioning(cycles, ticks, rate), 2 * cycles * ticks / rate, remaining)


def difference_after_start_up(
    model: Model, scales: Scales, limits: DemandLimits, cycles: int
) -> float:
    """Return the spread of outputs from different starts after a number of cycles, at any gap."""
    low, high = limits.current
    corners = [low, high] * cycles + [low]
    corners += [low + part * (high - low) for part in [0.6, 0.3, 0.8, 0.1, 0.4, 0.0]]
    drive = np.concatenate(
        [[low], *(np.linspace(*ends, RAMP_SAMPLES + 1)[1:] for ends in pairwise(corners))]
    )
    first_sample = 1 + 2 * RAMP_SAMPLES * cycles
    gaps = (scales.gap_low, scales.gap_high) if model.needs_schedule else (scales.gap_low,)
    largest = 0.0
    for gap in gaps:
        outputs = np.array(
            [
                model.predict(drive, gap, history=history).output[first_sample:]
                for history in _start_histories(high)
            ]
        )
        largest = max(largest, float(np.ptp(outputs, axis=0).max()))
    return largest


def _start_histories(high: float) -> list[History]:
    reversal_texts = (f"conditioned:{part * high!r},0" for part in START_REVERSALS if part)
    return [History.parse(text) for text in ("demagnetised", *reversal_texts)]


CHECKED_GAPS = 65
"""Places over the gap at which the model is looked at."""

ROUND_MANTISSAS = (1.0, 1.2, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)
"""Full-scale values are one of these times a power of ten."""

DEFAULT_ACCURACY_PERCENT = 0.1
"""Per cent of the largest output that formats and tables may cost where nothing else is asked."""

MIN_ACCURACY_PERCENT = 1e-3
MAX_ACCURACY_PERCENT = 50.0

RATE_RANGE_HZ = (1.0, 1e6)


@dataclass(frozen=True, slots=True)
class CompileRequest:
    """Options of a compilation, as the user gives them."""

    kind: Kind  # ``"full"`` or ``"simplified"`` (``"euler"`` is the baseline of the benchmarks)
    io: Io  # format of the signals: ``"q15"``, ``"q31"`` or ``"f32"``
    rate: float  # ticks a second, 1 to 10^6
    # Largest deviation from the model, per cent of the largest output. None: :data:`ACCURACY` for
    # formats and tables, whatever the law itself is off.
    accuracy: float | None = None
    name: str | None = None  # What the actuator is called in C. None: after the model.

    def __post_init__(self) -> None:
        if not RATE_RANGE_HZ[0] <= self.rate <= RATE_RANGE_HZ[1]:
            raise InputError(
                f"--rate: is {self.rate:g} Hz; give 1 to 1000000", code="out-of-range", key="--rate"
            )
        if (
            self.accuracy is not None
            and not MIN_ACCURACY_PERCENT <= self.accuracy <= MAX_ACCURACY_PERCENT
        ):
            text = f"--accuracy: is {self.accuracy:g} %; give {MIN_ACCURACY_PERCENT:g} to {MAX_ACCURACY_PERCENT:g}"
            raise InputError(text, code="out-of-range", key="--accuracy")
        if self.name is not None:
            check_c_name(self.name)


@dataclass(frozen=True, slots=True)
class Decision:
    """One decision of the plan: what was chosen, and why."""

    name: str
    value: str
    reason: str


@dataclass(frozen=True)
class Plan:
    """How a model is compiled."""

    name: str  # of the actuator in C: the prefix of its files and identifiers
    request: CompileRequest  # what was asked for
    model: Model  # at rest
    builder: BlockBuilder  # the model, with scales and limits
    sizes: TableSizes  # of tables and searches
    block: Block  # the parameters
    static_block: Block  # those without what answers late: the same unless iron is solid or late
    start_up: StartUp  # the start-up sequence
    search_result: SearchResult  # what the search tried
    reference_output: float  # output to which per cent refer; as :func:`reference_output`
    allowance: float  # what formats and tables may cost, in units of the output


def round_full_scale(largest: float) -> float:
    """Return the next round value above the largest magnitude of a signal.

    >>> full_scale(291.5), full_scale(3.01), full_scale(0.1)
    (300.0, 4.0, 0.12)
    """
    decade = 10.0 ** np.floor(np.log10(largest))
    # 1.0 itself has no code.
    mantissa = next(
        candidate
        for candidate in ROUND_MANTISSAS
        if candidate * decade > largest * (1.0 + 2.0**-15)
    )
    return float(f"{mantissa * decade:.6g}")


def largest_demand(limits: DemandLimits) -> float:
    """Return the largest magnitude of a demand."""
    return max(abs(end) for end in limits.demand)


def reference_output(model: Model, limits: DemandLimits) -> float:
    """Return the largest demand; of what has no natural zero the range of demands, its stroke."""
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
    """Decide how a model is compiled."""
    if (reason := find_compile_obstacle(model)) is not None:
        raise InputError(reason, code="no-fixed-point-form")
    dynamic_model = model if model.has_layers or model.has_lag else None
    if model.layers is not None and request.kind != "full":
        raise InputError(
            "layers: solid iron is compiled with --kind full; give that, or take the model at rest "
            "(at_rest)",
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
        name,
        request,
        model,
        builder,
        sizes,
        block,
        static_block,
        start_up,
        result,
        reference,
        allowance,
    )


def not_computed_error(error: InputError | NegativeResult) -> InputError:
    """Return the error of a model whose law ends within its own limits; `error` says where."""
    return InputError(
        f"[valid]: the law cannot be computed within these limits ({error}); narrow them, or "
        "correct the parameters",
        code="not-computed",
        key="valid",
    )


def find_limits(model: Model) -> DemandLimits:
    """Return the limits of demand and current: where the model was seen to hold."""
    valid = model.valid_range
    low, high = valid.output
    # A force is the square of the flux: what the sensor read below zero was noise.
    limits = DemandLimits((max(low, 0.0) if model.power == 2 else low, high), valid.input)
    schedule = valid.schedule
    ranges = [("output", limits.demand), ("input", limits.current)]
    if model.needs_schedule:
        ranges.append(("schedule", schedule or (0.0, 0.0)))
    for name, (low, high) in ranges:
        if not low < high:
            raise InputError(
                f"[valid]: the range of the {name}, {low:g} to {high:g}, has no room for a "
                "compensator; give its ends",
                code="range-too-narrow",
                key="valid",
            )
    return limits


def _largest_demand_word(model: Model, limits: DemandLimits) -> float:
    """Return the largest magnitude of a demand's words: its ends, the way to them from zero flux."""
    largest = largest_demand(limits)
    if output_map(model.output).has_natural_zero:
        return largest
    offsets = np.atleast_1d(model.parameters["out_0"])
    return max(
        largest, *(abs(float(offset) - end) for offset in offsets for end in (0.0, *limits.demand))
    )


def find_scales(model: Model, limits: DemandLimits) -> Scales:
    """Return what 1.0 of each signal means: round values, the gap's range as it is."""
    gap_low, gap_high = model.valid_range.schedule or (0.0, 0.0)
    return Scales(
        demand=round_full_scale(_largest_demand_word(model, limits)),
        current=round_full_scale(max(abs(end) for end in limits.current)),
        gap_low=gap_low,
        gap_high=gap_high,
    )
