"""Cleaning steps: each named, each optional, each telling what it did."""

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
from anhyst.data.delay import skew as estimate_skew
from anhyst.data.estimates import noise as noise_of
from anhyst.data.filtering import denoise, ripple
from anhyst.data.holes import cut_holes, find_holes
from anhyst.data.loops import Loop, Loops, is_even, with_columns
from anhyst.data.output_map import output_map
from anhyst.data.path import branches, turning_points
from anhyst.data.proposals import join_pair, quote_name
from anhyst.data.reading import read_loops
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError, wrong_type
from anhyst.support.jobs import Progress
from anhyst.support.numeric import FloatArray
from anhyst.support.wording import count_of

MOST_POINTS = 4000
"""Samples that thinning leaves of a loop at most."""

_STEADY = 0.02
_SPIKE_SIGMA = 8.0
_SPIKE_SHARE = 0.01


def clean(loopset: Loops, steps: Sequence[str] | str | None = None) -> Loops:
    """Apply cleaning steps in the order given.

    Parameters
    ----------
    loopset
        The loops.
    steps
        Names out of `STEPS`, also as a text with commas; `DEFAULT_STEPS` if ``None``.

    Returns
    -------
    Loops
        With one line in ``repairs`` for each step that changed something.

    Raises
    ------
    InputError
        If a step is not known.
    """
    if not isinstance(loopset, Loops):
        raise wrong_type("clean: loopset", "Loops (read_loops reads a file)", loopset)
    for name in DEFAULT_STEPS if steps is None else names_of(steps, "clean: steps"):
        if name not in STEPS:
            raise InputError(
                f"cleaning step '{name}' is not known; there are: {', '.join(STEPS)}",
                code="unknown-cleaning-step",
                key=name,
            )
        loopset = STEPS[name](loopset)
    return loopset


def dedupe(loopset: Loops) -> Loops:
    """Drop samples that repeat the one before.

    At the same time another value is no repeat: then the clock is coarser than the sampling.
    """
    keep = []
    for loop in loopset.loops:
        columns = (loop.input, loop.output, loop.schedule, loop.time)
        stays = [np.diff(column) == 0.0 for column in columns if column is not None]
        keep.append(np.concatenate(([True], ~np.logical_and.reduce(stays))))
    return _kept(loopset, keep, "dedupe: {} dropped", "repeated sample")


def spikes(loopset: Loops) -> Loops:
    """Drop single output samples far from their neighbours, away from reversals."""
    keep = []
    for loop in loopset.loops:
        padded = np.pad(loop.output, 2, mode="edge")
        windows = np.lib.stride_tricks.sliding_window_view(padded, 5)
        away = np.abs(loop.output - np.median(windows, axis=1))
        limit = max(_SPIKE_SIGMA * noise_of(loop.output), _SPIKE_SHARE * float(np.ptp(loop.output)))
        spike = away > limit
        for turn in turning_points(loop.input):
            spike[max(0, turn - 2) : turn + 3] = False  # a sharp tip is no spike
        keep.append(~spike)
    return _kept(loopset, keep, "spikes: {} dropped")


def steady(loopset: Loops) -> Loops:
    """Settle a scheduling value that wobbles by less than 2 % within a loop to its median."""
    loops = list(loopset.loops)
    settled = 0
    for index, loop in enumerate(loops):
        values = loop.schedule
        if values is not None and 0.0 < np.ptp(values) <= _STEADY * float(np.max(np.abs(values))):
            loops[index] = replace(loop, schedule=np.full(loop.n, float(np.median(values))))
            settled += 1
    if not settled:
        return loopset
    name = loopset.schedule.name if loopset.schedule else ""
    return loopset.with_loops(
        loops, f"steady: {name} of {count_of(settled, 'loop')} settled to its median"
    )


def drift(loopset: Loops) -> Loops:
    """Take a linear drift out of the output, so that states that come again have one output.

    Where none comes again the drift cannot be judged: a note says so, and the loop stays as it is.
    """
    loops, texts, unknown = list(loopset.loops), [], []
    for index, loop in enumerate(loops):
        total = estimates.drift(loop)
        if total is None:
            unknown.append(f"'{loop.label}'")
        elif total:
            clock = loop.time if loop.time is not None else np.arange(loop.n, dtype=np.float64)
            share = (clock - clock[0]) / (clock[-1] - clock[0]) - 0.5
            loops[index] = replace(loop, output=loop.output - total * share)
            texts.append(f"{total:.3g} {loopset.output.unit} in loop '{loop.label}'")
    if unknown:
        note = f"drift of loops {_some(unknown)} cannot be judged: no state comes again in them"
        loopset = replace(loopset, notes=(*loopset.notes, note))
    if not texts:
        return loopset
    return loopset.with_loops(loops, f"drift: {_some(texts)} removed from the output")


def offset(loopset: Loops) -> Loops:
    """Centre symmetric loops of an odd output: one input offset for all, one output offset each."""
    if is_even(loopset):
        return loopset
    offsets = [estimates.offsets(loop) for loop in loopset.loops]
    centres = [centre for centre in offsets if centre is not None]
    if not centres:
        return loopset
    shift = float(np.median([centre[0] for centre in centres]))
    loops, texts = [], []
    for loop, centre in zip(loopset.loops, offsets, strict=True):
        zero = centre[1] if centre is not None else 0.0
        loops.append(replace(loop, input=loop.input - shift, output=loop.output - zero))
        texts.append(f"{zero:.3g} {loopset.output.unit} in loop '{loop.label}'")
    return loopset.with_loops(
        loops, f"offset: {shift:.3g} {loopset.input.unit} of the input, output {_some(texts)}"
    )


def skew(loopset: Loops) -> Loops:
    """Shift the output by its delay behind the input (one delay for all loops, their median)."""
    steps = [estimates.sampling(loop)[0] or 1.0 for loop in loopset.loops]
    delays = [
        found * step
        for found, step in zip(map(estimate_skew, loopset.loops), steps, strict=True)
        if found is not None
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
        later = clock + delay
        is_inside = (later >= clock[0]) & (later <= clock[-1])
        for hole in find_holes(loop.time):
            is_inside &= (later <= clock[hole.row]) | (later >= clock[hole.row + 1])
        if np.count_nonzero(is_inside) < 3:
            return loopset
        shifted = np.interp(later, clock, loop.output)[is_inside]
        loops.append(with_columns(loop, itemgetter(is_inside), output=shifted))
    size = f"{-delay:.2f} samples"
    if loopset.loops[0].time is not None:
        size = f"{-delay:.3g} s ({-delay / steps[0]:.4g} samples)"
    return loopset.with_loops(loops, f"skew: output moved by {size}")


def thin(loopset: Loops, most: int = MOST_POINTS) -> Loops:
    """Average long loops down to ``most`` samples along their path, reversals kept as measured.

    What creeps keeps its samples: there the clock counts.
    """
    counts = [loop.n for loop in loopset.loops if loop.n > most]
    if not counts or output_map(loopset.output).creeps:
        return loopset
    loops = [_thinned(loop, most) if loop.n > most else loop for loop in loopset.loops]
    return loopset.with_loops(
        loops,
        f"thin: {count_of(len(counts), 'loop')} averaged to {most} samples (from up to {max(counts)})",
    )


STEPS: Mapping[str, Callable[[Loops], Loops]] = MappingProxyType(
    {
        "dedupe": dedupe,
        "spikes": spikes,
        "steady": steady,
        "drift": drift,
        "offset": offset,
        "skew": skew,
        "holes": cut_holes,
        "ripple": ripple,
        "denoise": denoise,
        "thin": thin,
    }
)
"""All cleaning steps by name."""

DEFAULT_STEPS = ("dedupe", "holes", "ripple", "denoise", "thin")
"""The steps taken unless others are named: those that do nothing to a clean record."""


def _thinned(loop: Loop, most: int) -> Loop:
    parts = branches(loop.input)
    height, span = float(np.ptp(loop.output)) or 1.0, float(np.ptp(loop.input))
    # Progress along the path, in ranges of input and output: steep and flat parts keep points.
    progress = np.zeros(loop.n)
    fixed = np.zeros(loop.n, bool)
    for part in parts:
        rows = part.rows
        travelled = np.zeros(part.size)
        for values, size in ((loop.input[rows], span), (loop.output[rows], height)):
            sign = 1.0 if values[-1] >= values[0] else -1.0
            travelled += np.maximum.accumulate(sign * (values - values[0])) / size
        progress[rows] = progress[part.start] + travelled
        fixed[[part.start, part.stop - 1]] = True
    room = max(1, most - 2 * len(parts) - 1)
    bins = np.minimum((progress / progress[-1] * room).astype(np.intp), room - 1)
    # A turning point stands alone; what follows it starts a new bin.
    edge = np.concatenate(([True], (np.diff(bins) != 0) | fixed[1:] | fixed[:-1]))
    starts = np.flatnonzero(edge)
    counts = np.diff(np.concatenate((starts, [loop.n])))

    def mean(values: FloatArray) -> FloatArray:
        averaged: FloatArray = np.add.reduceat(values, starts) / counts
        return averaged

    if loop.schedule_value is not None:
        return with_columns(loop, mean, schedule=np.full(starts.size, loop.schedule_value))
    return with_columns(loop, mean)


def _kept(
    loopset: Loops, keep: Sequence[NDArray[np.bool_]], text: str, what: str = "sample"
) -> Loops:
    dropped = sum(int(np.count_nonzero(~mask)) for mask in keep)
    if not dropped:
        return loopset
    pairs = zip(loopset.loops, keep, strict=True)
    loops = [with_columns(loop, itemgetter(mask)) for loop, mask in pairs]
    return loopset.with_loops(loops, text.format(count_of(dropped, what)))


def _some(texts: Sequence[str]) -> str:
    """Join texts, the first few of many."""
    if len(texts) <= 4:
        return ", ".join(texts)
    return ", ".join(texts[:3]) + f" and {len(texts) - 3} more"


PREFIX = "read_"
"""Settings of the provenance that say how the measurements were read begin with this."""


@dataclass(frozen=True, slots=True)
class ReadOptions:
    """How measurements are read, where their headers and sidecars do not say it all."""

    columns: Mapping[str, str] = field(default_factory=dict)  # column of the file to our column
    # our column to what it is throughout
    constants: Mapping[str, float | str] = field(default_factory=dict)
    schedule: str | None = None  # the scheduling variable; the column that distinguishes loops
    loop: str | None = None
    history: str | None = None  # what happened before the first sample
    sidecar: str | None = None  # TOML file that describes all the files
    clean: tuple[str, ...] = DEFAULT_STEPS  # cleaning steps, in their order
    scale: Mapping[str, str] = field(
        default_factory=dict
    )  # column to our unit per unit of the file
    flip: tuple[str, ...] = ()  # columns whose sign is reversed
    drop: str | None = None  # "invalid": samples without a measured value are left out

    @classmethod
    def from_text(cls, **texts: str | None) -> ReadOptions:
        """Read the options from texts, as on the command line and in a model file."""
        options = {name: text for name, text in texts.items() if text is not None}
        columns = _pairs(options.pop("columns", ""), "columns")
        constants = _pairs(options.pop("constants", ""), "constants")
        return cls(
            columns=columns,
            constants={name: _number_or_text(text) for name, text in constants.items()},
            clean=names_of(options.pop("clean", ",".join(DEFAULT_STEPS)), "clean"),
            scale=_pairs(options.pop("scale", ""), "scale"),
            flip=tuple(_parts(options.pop("flip", ""))),
            **options,
        )

    def as_settings(self) -> dict[str, str | bool | int | float]:
        """Return what differs from the default as texts, for the provenance of a model."""
        settings: dict[str, str | bool | int | float] = {}
        for item in fields(self):
            value = getattr(self, item.name)
            if value == getattr(ReadOptions(), item.name):
                continue
            if isinstance(value, Mapping):
                value = ",".join(join_pair(name, text) for name, text in value.items())
            elif isinstance(value, tuple):
                value = ",".join(quote_name(name) for name in value) or "none"
            settings[PREFIX + item.name] = value
        return settings

    def read(
        self, paths: Sequence[PathLike] | Any, progress: Progress | None = None, **more: Any
    ) -> Loops:
        """Read and clean loops; ``more`` are keywords of `read_loops` that are no options."""
        options = {item.name: getattr(self, item.name) for item in fields(self)}
        steps = options.pop("clean")
        return clean(read_loops(paths, **options, progress=progress, **more), steps)


def names_of(value: object, argument: str) -> tuple[str, ...]:
    """Return a list of names; a text lists them with commas, and ``"none"`` is an empty list."""
    if isinstance(value, str):
        return () if value.strip() == "none" else tuple(_parts(value))
    if isinstance(value, Sequence) and all(isinstance(name, str) for name in value):
        return tuple(value)
    raise wrong_type(argument, "a list of names", value)


def _parts(text: str) -> list[str]:
    """Split at commas; a field that begins with a double quote may hold some."""
    rows = csv.reader([text], skipinitialspace=True)
    return [part for row in rows for piece in row if (part := piece.strip())]


def _pairs(text: str, what: str) -> dict[str, str]:
    pairs: dict[str, str] = {}
    for part in _parts(text):
        name, equals, value = (piece.strip() for piece in part.rpartition("="))
        if not equals or not name:
            raise InputError(
                f"{what}: '{part}' is not of the form name=value", code="not-name-value", key=what
            )
        if name in pairs:
            raise InputError(
                f"{what}: '{name}' is given twice; keep one", code="name-twice", key=name
            )
        pairs[name] = value
    return pairs


def _number_or_text(text: str) -> float | str:
    try:
        return float(text)
    except ValueError:
        return text
