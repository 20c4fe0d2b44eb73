"""A hundred random measurement files are read correctly or refused; none is read wrongly."""

from __future__ import annotations

import re
import shlex
from collections import Counter
from pathlib import Path
from typing import Literal

import numpy as np
import pytest

import anhyst
from anhyst.data import Loops
from anhyst.data.clean import ReadOptions
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from tests.data.variations import Truth, Variation, draw, write
from tests.refusals import in_commands

Outcome = Literal["read", "proposed", "refused", "wrong"]

COUNT = 100
MIN_READ = 95
MAX_PROPOSALS = 3
OPTION = re.compile(r"--(columns|scale|flip|drop|schedule|loop|constants|clean)\b")


def options_in(message: str) -> dict[str, str]:
    """Return the options of the command line that an error proposes."""
    proposed: dict[str, str] = {}
    for match in OPTION.finditer(message):
        rest = message[match.end() :].lstrip(" =")
        try:
            words = shlex.split(rest, posix=True)
        except ValueError:
            continue
        if words:
            proposed.setdefault(match[1], words[0].rstrip(".,;:)"))
    return proposed


def read(path: Path, options: dict[str, str]) -> Loops:
    return ReadOptions.from_text(**options, clean="none").read([path])


def outcome(variation: Variation, folder: Path) -> tuple[Outcome, str]:
    """Read one variation as a user does who applies the proposals of errors."""
    path, truth = write(variation, folder)
    options: dict[str, str] = {}
    said = ""
    for attempt in range(MAX_PROPOSALS + 1):
        try:
            loops = read(path, options)
        except InputError as error:
            said = in_commands(error)
            more = {name: text for name, text in options_in(said).items() if name != "clean"}
            if not more or more.items() <= options.items():
                return "refused", said
            options |= more
            continue
        fault = difference(loops, truth, variation)
        if fault:
            return "wrong", f"{fault} (options {options})"
        return ("proposed" if attempt else "read"), said
    return "refused", said


def difference(loops: Loops, truth: Truth, variation: Variation) -> str:
    """Return how loops differ from the truth; empty if they do not."""
    gaps = [round(1e3 * value, 2) for value in loops.schedule_values]
    if loops.schedule is None or sorted(set(gaps)) != sorted(truth.current):
        return f"gaps {gaps} instead of {sorted(truth.current)}"
    faults = [
        deviation(
            np.concatenate([getattr(loop, name) for loop in some]),
            signal[round(1e3 * (gap or 0.0), 2)],
            are_some_invalid=variation.trouble.name == "invalid",
        )
        for gap, some in loops.by_schedule().items()
        for name, signal in (("input", truth.current), ("output", truth.force))
    ]
    remarks = " ".join([*anhyst.inspect(loops).warnings, *loops.notes])
    if variation.trouble.word not in remarks:
        faults.append(f"nothing is said about the {variation.trouble.name}")
    return "; ".join(filter(None, faults))


def deviation(mine: FloatArray, theirs: FloatArray, *, are_some_invalid: bool) -> str:
    """Return how a signal differs from the true one; empty if it does not."""
    if are_some_invalid:
        if not 0.9 * theirs.size < mine.size < theirs.size + 1:
            return f"{mine.size} of {theirs.size} samples"
        is_near = abs(mine.max() - theirs.max()) <= 0.05 * theirs.max()
        return "" if is_near else f"maximum {mine.max():g} instead of {theirs.max():g}"
    if mine.size != theirs.size:
        return f"{mine.size} samples instead of {theirs.size}"
    is_same = np.abs(mine - theirs).max() <= 1e-5 * np.abs(theirs).max()
    return "" if is_same else "other values"


@pytest.mark.parametrize("half", ["even", "odd"])
def test_drawn_files_are_read_right_or_refused(tmp_path: Path, half: str) -> None:
    seeds = range(half == "odd", COUNT, 2)
    found = {seed: outcome(draw(seed), tmp_path / str(seed)) for seed in seeds}
    counts = Counter(kind for kind, _ in found.values())
    assert [f"{seed}: {said}" for seed, (kind, said) in found.items() if kind == "wrong"] == []
    assert 2 * (counts["read"] + counts["proposed"]) >= MIN_READ
