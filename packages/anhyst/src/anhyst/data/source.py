"""Load loops for a command from files, folders, data in memory or a `Loops` object."""

from __future__ import annotations

import inspect
import os
from collections.abc import Collection, Mapping, Sequence
from dataclasses import fields, replace
from typing import Any

from anhyst.data.clean import ReadOptions, parse_names
from anhyst.data.loops import Loops
from anhyst.data.path import history_text
from anhyst.data.reading import read_loops
from anhyst.data.table import check_source
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError, wrong_type
from anhyst.support.jobs import Progress

LoopSource = Loops | PathLike | Sequence[PathLike] | Mapping[str, Any] | Any
"""Loops, a file, a folder, a list of files, a data frame, or a dict of arrays."""


def load_loops(
    source: LoopSource,
    argument: str,
    read_keywords: Mapping[str, Any],
    *,
    skipped_steps: Collection[str] = (),
    progress: Progress | None = None,
) -> tuple[Loops, ReadOptions | None]:
    """Return the loops of a source, and the options with which they were read.

    Files and data frames are read and cleaned. A `Loops` object is returned unchanged, with
    ``None`` as options.

    ``argument`` names the command and its argument in messages: ``"identify: loops"``.
    ``read_keywords`` are keywords of `read_loops`, and ``clean``, with the default of the command
    line. Cleaning steps in ``skipped_steps`` are not applied.
    """
    read_keywords = {name: value for name, value in read_keywords.items() if value is not None}
    if isinstance(source, Loops):
        for name in read_keywords:
            raise InputError(
                f"{argument} are read already, so {name} has no effect; pass it to read_loops or clean",
                code="option-not-for-this",
                key=name,
            )
        return source, None
    verb = argument.partition(":")[0]
    option_names = {item.name for item in fields(ReadOptions)}
    other_keywords = {name: value for name, value in read_keywords.items() if name not in option_names}
    for name in other_keywords:
        if name not in inspect.signature(read_loops).parameters:
            raise TypeError(f"{verb}() got an unexpected keyword argument '{name}'")
    check_source(source, argument)
    options = collect_read_options(
        verb, **{name: read_keywords[name] for name in read_keywords if name in option_names}
    )
    steps = tuple(step for step in options.clean if step not in skipped_steps)
    options = replace(options, clean=steps)
    return options.read(source, **{"progress": progress} | other_keywords), options


def collect_read_options(verb: str, **keywords: Any) -> ReadOptions:
    """Return the read options from Python arguments; ``None`` means that an option is not given."""
    defaults = ReadOptions()
    given_options = {name: value for name, value in keywords.items() if value is not None}
    for name, value in given_options.items():
        if not hasattr(defaults, name):
            raise TypeError(f"{verb}() got an unexpected keyword argument '{name}'")
        default_value = getattr(defaults, name)
        if name == "history":
            given_options[name] = history_text(value)
        elif isinstance(default_value, Mapping):
            if not isinstance(value, Mapping):
                example_text = {"columns": '{"I": "I_A"}'}.get(name, '{"gap_mm": 0.4}')
                raise wrong_type(f"{verb}: {name}", f"a dict, such as {example_text}", value)
            given_options[name] = dict(value)
        elif isinstance(default_value, tuple):
            given_options[name] = parse_names(value, f"{verb}: {name}")
        elif isinstance(value, str | os.PathLike):
            given_options[name] = os.fspath(value)
        else:
            raise wrong_type(f"{verb}: {name}", "a text", value)
    return replace(defaults, **given_options)
