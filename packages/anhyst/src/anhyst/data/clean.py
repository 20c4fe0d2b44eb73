"""Clean loops with named steps, such as removing spikes, drift or noise.

`STEPS` lists the steps by their name on the command line. Each step takes a set of loops and
returns a changed set, with a line in its ``repairs`` that states the change. `ReadOptions` combines
reading and cleaning, and stores its settings in model files.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from operator import itemgetter
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from anhyst.data import estimates
from anhyst.data.delay import estimate_delay
from anhyst.data.estimates import estimate_noise
from anhyst.data.filtering import average_over_ripple, denoise
from anhyst.data.holes import cut_holes, find_holes
from anhyst.data.loops import Loop, Loops, is_even, replace_columns
from anhyst.data.output_map import output_map
from anhyst.data.path import find_branches, find_turning_points
from anhyst.data.proposals import join_pair, quote_name
from anhyst.data.reading import read_loops
from anhyst.data.recurrence import estimate_drift
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError, wrong_type
from anhyst.support.jobs import Progress
from anhyst.support.numeric import FloatArray
from anhyst.support.wording import count_text

MAX_SAMPLES_PER_LOOP = 4000
"""Maximum number of samples of a loop after the step `thin`."""

_MAX_WOBBLE_SHARE = 0.02
_MIN_SPIKE_SIGMAS = 8.0
_MIN_SPIKE_SHARE = 0.01


def clean(loopset: Loops, steps: Sequence[str] | str | None = None) -> Loops:
    """Apply cleaning steps in the given order.

    Parameters
    ----------
    loopset
        The loops.
    steps
        Names from `STEPS`, as a list or as a text with commas; `DEFAULT_STEPS` if ``None``.

    Returns
    -------
    Loops
        With one line in ``repairs`` for each step that changed something.

    Raises
    ------
    InputError
        If a step is unknown.
    """
    if not isinstance(loopset, Loops):
        raise wrong_type("clean: loopset", "Loops (read_loops reads a file)", loopset)
    for name in DEFAULT_STEPS if steps is None else parse_names(steps, "clean: steps"):
        if name not in STEPS:
            raise InputError(
                f"cleaning step '{name}' is not known; there are: {', '.join(STEPS)}",
                code="unknown-cleaning-step",
                key=name,
            )
        loopset = STEPS[name](loopset)
    return loopset


def drop_repeated_samples(loopset: Loops) -> Loops:
    """Drop samples whose values and time repeat the previous sample.

    Different values at the same time are kept, because the clock may be coarser than the sampling.
    """
    keep_masks = []
    for loop in loopset.loops:
        columns = (loop.input, loop.output, loop.schedule, loop.time)
        is_repeated = [np.diff(column) == 0.0 for column in columns if column is not None]
        keep_masks.append(np.concatenate(([True], ~np.logical_and.reduce(is_repeated))))
    return _keep_samples(loopset, keep_masks, "dedupe: {} dropped", "repeated sample")


def drop_spikes(loopset: Loops) -> Loops:
    """Drop single output samples that deviate from the median of five, but not at reversals."""
    keep_masks = []
    for loop in loopset.loops:
        padded_output = np.pad(loop.output, 2, mode="edge")
        windows = np.lib.stride_tricks.sliding_window_view(padded_output, 5)
        deviation = np.abs(loop.output - np.median(windows, axis=1))
        spike_threshold = max(
            _MIN_SPIKE_SIGMAS * estimate_noise(loop.output), _MIN_SPIKE_SHARE * float(np.ptp(loop.output))
        )
        is_spike = deviation > spike_threshold
        for turning_point in find_turning_points(loop.input):
            is_spike[max(0, turning_point - 2) : turning_point + 3] = False  # a sharp tip is not a spike
        keep_masks.append(~is_spike)
    return _keep_samples(loopset, keep_masks, "spikes: {} dropped")


def set_schedule_to_median(loopset: Loops) -> Loops:
    """Replace a scheduling value by its median if it varies by at most 2 % within a loop."""
    loops = list(loopset.loops)
    steadied_count = 0
    for index, loop in enumerate(loops):
        values = loop.schedule
        if values is not None and 0.0 < np.ptp(values) <= _MAX_WOBBLE_SHARE * float(np.max(np.abs(values))):
            loops[index] = replace(loop, schedule=np.full(loop.n, float(np.median(values))))
            steadied_count += 1
    if not steadied_count:
        return loopset
    name = loopset.schedule.name if loopset.schedule else ""
    return loopset.with_loops(
        loops, f"steady: {name} of {count_text(steadied_count, 'loop')} replaced by its median"
    )


def remove_drift(loopset: Loops) -> Loops:
    """Remove a linear drift from the output, so that recurring states have equal outputs.

    If no state recurs, the drift cannot be determined: the loop stays unchanged, and a note says
    so.
    """
    loops, texts, unknown_drifts = list(loopset.loops), [], []
    for index, loop in enumerate(loops):
        total_drift = estimate_drift(loop, loopset.output)
        if total_drift is None:
            unknown_drifts.append(f"'{loop.label}'")
        elif total_drift:
            clock = loop.time if loop.time is not None else np.arange(loop.n, dtype=np.float64)
            time_share = (clock - clock[0]) / (clock[-1] - clock[0]) - 0.5
            loops[index] = replace(loop, output=loop.output - total_drift * time_share)
            texts.append(f"{total_drift:.3g} {loopset.output.unit} in loop '{loop.label}'")
    if unknown_drifts:
        note = f"drift of loops {_join_first(unknown_drifts)} cannot be determined, because no state recurs"
        loopset = replace(loopset, notes=(*loopset.notes, note))
    if not texts:
        return loopset
    return loopset.with_loops(loops, f"drift: {_join_first(texts)} removed from the output")


def remove_offset(loopset: Loops) -> Loops:
    """Centre symmetric loops of an odd output: one common input offset, one output offset each."""
    if is_even(loopset):
        return loopset
    offsets = [estimates.estimate_offsets(loop) for loop in loopset.loops]
    known_offsets = [offset_pair for offset_pair in offsets if offset_pair is not None]
    if not known_offsets:
        return loopset
    input_offset = float(np.median([offset_pair[0] for offset_pair in known_offsets]))
    loops, texts = [], []
    for loop, offset_pair in zip(loopset.loops, offsets, strict=True):
        output_offset = offset_pair[1] if offset_pair is not None else 0.0
        loops.append(replace(loop, input=loop.input - input_offset, output=loop.output - output_offset))
        texts.append(f"{output_offset:.3g} {loopset.output.unit} in loop '{loop.label}'")
    return loopset.with_loops(
        loops, f"offset: {input_offset:.3g} {loopset.input.unit} in the input; output: {_join_first(texts)}"
    )


def remove_delay(loopset: Loops) -> Loops:
    """Shift the output by its delay after the input, using the median delay of all loops."""
    steps = [estimates.measure_sampling(loop)[0] or 1.0 for loop in loopset.loops]
    delays = [
        delay_samples * step
        for delay_samples, step in zip(map(estimate_delay, loopset.loops), steps, strict=True)
        if delay_samples is not None
    ]
    if not delays:
        note = "delay between the channels: not determined; step 'skew' changed nothing"
        return replace(loopset, notes=(*loopset.notes, note))
    delay = float(np.median(delays))
    if delay == 0.0:
        return loopset
    loops = []
    for loop in loopset.loops:
        clock = loop.time if loop.time is not None else np.arange(loop.n, dtype=np.float64)
        shifted_clock = clock + delay
        is_inside = (shifted_clock >= clock[0]) & (shifted_clock <= clock[-1])
        for hole in find_holes(loop.time):
            is_inside &= (shifted_clock <= clock[hole.row]) | (shifted_clock >= clock[hole.row + 1])
        if np.count_nonzero(is_inside) < 3:
            return loopset
        shifted_output = np.interp(shifted_clock, clock, loop.output)[is_inside]
        loops.append(replace_columns(loop, itemgetter(is_inside), output=shifted_output))
    delay_text = f"{-delay:.2f} samples"
    if loopset.loops[0].time is not None:
        delay_text = f"{-delay:.3g} s ({-delay / steps[0]:.4g} samples)"
    return loopset.with_loops(loops, f"skew: output shifted by {delay_text}")


def thin_loops(loopset: Loops, max_samples: int = MAX_SAMPLES_PER_LOOP) -> Loops:
    """Average loops with more than ``max_samples`` down to this number, and keep the reversals.

    Outputs with creep keep all samples, because their model depends on the time.
    """
    counts = [loop.n for loop in loopset.loops if loop.n > max_samples]
    if not counts or output_map(loopset.output).has_creep:
        return loopset
    loops = [
        _average_along_path(loop, max_samples) if loop.n > max_samples else loop for loop in loopset.loops
    ]
    return loopset.with_loops(
        loops,
        f"thin: {count_text(len(counts), 'loop')} averaged to {max_samples} samples (from up to {max(counts)})",
    )


STEPS: Mapping[str, Callable[[Loops], Loops]] = MappingProxyType(
    {
        "dedupe": drop_repeated_samples,
        "spikes": drop_spikes,
        "steady": set_schedule_to_median,
        "drift": remove_drift,
        "offset": remove_offset,
        "skew": remove_delay,
        "holes": cut_holes,
        "ripple": average_over_ripple,
        "denoise": denoise,
        "thin": thin_loops,
    }
)
"""All cleaning steps by name."""

DEFAULT_STEPS = ("dedupe", "holes", "ripple", "denoise", "thin")
"""Steps that are applied by default; they do not change a clean record."""


def _average_along_path(loop: Loop, max_samples: int) -> Loop:
    """Return a loop whose samples are averaged over equal parts of its path."""
    branches = find_branches(loop.input)
    output_range, input_range = float(np.ptp(loop.output)) or 1.0, float(np.ptp(loop.input))
    # Input and output are relative to their ranges, so that steep and flat parts keep samples.
    path_length = np.zeros(loop.n)
    is_reversal = np.zeros(loop.n, bool)
    for branch in branches:
        rows = branch.rows
        branch_travel = np.zeros(branch.size)
        for values, value_range in ((loop.input[rows], input_range), (loop.output[rows], output_range)):
            sign = 1.0 if values[-1] >= values[0] else -1.0
            branch_travel += np.maximum.accumulate(sign * (values - values[0])) / value_range
        path_length[rows] = path_length[branch.start] + branch_travel
        is_reversal[[branch.start, branch.stop - 1]] = True
    bin_count = max(1, max_samples - 2 * len(branches) - 1)
    bins = np.minimum((path_length / path_length[-1] * bin_count).astype(np.intp), bin_count - 1)
    # A turning point is a bin of its own, and the next sample starts a new bin.
    starts_bin = np.concatenate(([True], (np.diff(bins) != 0) | is_reversal[1:] | is_reversal[:-1]))
    starts = np.flatnonzero(starts_bin)
    counts = np.diff(np.concatenate((starts, [loop.n])))

    def mean(values: FloatArray) -> FloatArray:
        bin_means: FloatArray = np.add.reduceat(values, starts) / counts
        return bin_means

    if loop.schedule_value is not None:
        return replace_columns(loop, mean, schedule=np.full(starts.size, loop.schedule_value))
    return replace_columns(loop, mean)


def _keep_samples(
    loopset: Loops, keep_masks: Sequence[NDArray[np.bool_]], text: str, noun: str = "sample"
) -> Loops:
    """Return the loops with the samples to keep, and a repair that counts the dropped samples."""
    dropped_count = sum(int(np.count_nonzero(~mask)) for mask in keep_masks)
    if not dropped_count:
        return loopset
    loops_and_masks = zip(loopset.loops, keep_masks, strict=True)
    loops = [replace_columns(loop, itemgetter(mask)) for loop, mask in loops_and_masks]
    return loopset.with_loops(loops, text.format(count_text(dropped_count, noun)))


def _join_first(texts: Sequence[str]) -> str:
    """Join texts with commas; of more than four texts, show three and the number of the others."""
    if len(texts) <= 4:
        return ", ".join(texts)
    return ", ".join(texts[:3]) + f" and {len(texts) - 3} more"


SETTING_PREFIX = "read_"
"""Prefix of the settings in a model file that state how the measurements were read."""


@dataclass(frozen=True, slots=True)
class ReadOptions:
    """Options for reading measurements: information that headers and sidecar files do not state."""

    columns: Mapping[str, str] = field(default_factory=dict)  # standard name, by name in the file
    constants: Mapping[str, float | str] = field(default_factory=dict)  # value, by standard name
    schedule: str | None = None  # scheduling variable
    loop: str | None = None  # column that distinguishes loops
    history: str | None = None  # history before the first sample
    sidecar: str | None = None  # TOML file that describes all files
    clean: tuple[str, ...] = DEFAULT_STEPS  # cleaning steps in order
    scale: Mapping[str, str] = field(default_factory=dict)  # factor: our unit per unit of the file
    flip: tuple[str, ...] = ()  # columns whose sign is reversed
    drop: str | None = None  # "invalid": omit samples without a measured value

    @classmethod
    def from_text(cls, **texts: str | None) -> ReadOptions:
        """Parse the options from texts, as on the command line and in a model file."""
        options = {name: text for name, text in texts.items() if text is not None}
        columns = _parse_pairs(options.pop("columns", ""), "columns")
        constants = _parse_pairs(options.pop("constants", ""), "constants")
        return cls(
            columns=columns,
            constants={name: _parse_constant(text) for name, text in constants.items()},
            clean=parse_names(options.pop("clean", ",".join(DEFAULT_STEPS)), "clean"),
            scale=_parse_pairs(options.pop("scale", ""), "scale"),
            flip=tuple(_split_list(options.pop("flip", ""))),
            **options,
        )

    def as_settings(self) -> dict[str, str | bool | int | float]:
        """Return the options that differ from their defaults as texts, for the model file."""
        settings: dict[str, str | bool | int | float] = {}
        for item in fields(self):
            value = getattr(self, item.name)
            if value == getattr(ReadOptions(), item.name):
                continue
            if isinstance(value, Mapping):
                value = ",".join(join_pair(name, text) for name, text in value.items())
            elif isinstance(value, tuple):
                value = ",".join(quote_name(name) for name in value) or "none"
            settings[SETTING_PREFIX + item.name] = value
        return settings

    def read(
        self, paths: Sequence[PathLike] | Any, progress: Progress | None = None, **other_keywords: Any
    ) -> Loops:
        """Read and clean loops; ``more`` are keywords of `read_loops` that are not options."""
        options = {item.name: getattr(self, item.name) for item in fields(self)}
        steps = options.pop("clean")
        return clean(read_loops(paths, **options, progress=progress, **other_keywords), steps)


def parse_names(value: object, argument: str) -> tuple[str, ...]:
    """Return a list of names from a text with commas or a sequence; ``"none"`` is an empty list."""
    if isinstance(value, str):
        return () if value.strip() == "none" else tuple(_split_list(value))
    if isinstance(value, Sequence) and all(isinstance(name, str) for name in value):
        return tuple(value)
    raise wrong_type(argument, "a list of names", value)


def _split_list(text: str) -> list[str]:
    """Split a text at commas; a field that begins with a double quote may contain commas."""
    rows = csv.reader([text], skipinitialspace=True)
    return [stripped_field for row in rows for field in row if (stripped_field := field.strip())]


def _parse_pairs(text: str, option: str) -> dict[str, str]:
    """Parse a list of ``name=value`` pairs, each name once."""
    values_by_name: dict[str, str] = {}
    for list_field in _split_list(text):
        name, equals_sign, value = (piece.strip() for piece in list_field.rpartition("="))
        if not equals_sign or not name:
            raise InputError(
                f"{option}: '{list_field}' is not of the form name=value", code="not-name-value", key=option
            )
        if name in values_by_name:
            raise InputError(f"{option}: '{name}' is given twice; keep one", code="name-twice", key=name)
        values_by_name[name] = value
    return values_by_name


def _parse_constant(text: str) -> float | str:
    """Return the number in a text, or the text itself if it is not a number."""
    try:
        return float(text)
    except ValueError:
        return text
