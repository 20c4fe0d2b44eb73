"""Loops as a verb of the package accepts them: read already, in files, or in memory."""

from __future__ import annotations

import inspect
import os
from collections.abc import Collection, Mapping, Sequence
from dataclasses import fields, replace
from typing import Any

from anhyst.data.clean import ReadOptions, names_of
from anhyst.data.loops import Loops
from anhyst.data.path import history_text
from anhyst.data.reading import read_loops
from anhyst.data.table import check_source
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError, wrong_type
from anhyst.support.jobs import Progress

LoopSource = Loops | PathLike | Sequence[PathLike] | Mapping[str, Any] | Any
"""Loops, a file, a folder, several of them, a data frame, or a dict of arrays."""


def loops_from(
    source: LoopSource,
    argument: str,
    reading: Mapping[str, Any],
    *,
    without: Collection[str] = (),
    progress: Progress | None = None,
) -> tuple[Loops, ReadOptions | None]:
    """Return the loops that a verb was given, and the options with which they were read.

    Files and data frames are read and cleaned; there are no options if the caller had read them.

    ``argument`` is the verb with its argument, for messages: ``"identify: loops"``. ``reading``
    holds keywords of `read_loops`, and ``clean``, whose default is that of the command line.
    Cleaning steps in ``without`` are left out. Loops that are read already stay unchanged.
    """
    reading = {name: value for name, value in reading.items() if value is not None}
    if isinstance(source, Loops):
        for name in reading:
            raise InputError(
                f"{argument} are read already, so {name} has no effect; give it to read_loops or "
                "clean",
                code="option-not-for-this",
                key=name,
            )
        return source, None
    verb = argument.partition(":")[0]
    own = {item.name for item in fields(ReadOptions)}
    more = {name: value for name, value in reading.items() if name not in own}
    for name in more:
        if name not in inspect.signature(read_loops).parameters:
            raise TypeError(f"{verb}() got an unexpected keyword argument '{name}'")
    check_source(source, argument)
    options = options_of(verb, **{name: reading[name] for name in reading if name in own})
    steps = tuple(step for step in options.clean if step not in without)
    options = replace(options, clean=steps)
    return options.read(source, **{"progress": progress} | more), options


def options_of(verb: str, **reading: Any) -> ReadOptions:
    """Collect how loops are read from arguments of Python; ``None`` is an argument left out."""
    plain = ReadOptions()
    given = {name: value for name, value in reading.items() if value is not None}
    for name, value in given.items():
        if not hasattr(plain, name):
            raise TypeError(f"{verb}() got an unexpected keyword argument '{name}'")
        default = getattr(plain, name)
        if name == "history":
            given[name] = history_text(value)
        elif isinstance(default, Mapping):
            if not isinstance(value, Mapping):
                example = {"columns": '{"I": "I_A"}'}.get(name, '{"gap_mm": 0.4}')
                raise wrong_type(f"{verb}: {name}", f"a dict, such as {example}", value)
            given[name] = dict(value)
        elif isinstance(default, tuple):
            given[name] = names_of(value, f"{verb}: {name}")
        elif isinstance(value, str | os.PathLike):
            given[name] = os.fspath(value)
        else:
            raise wrong_type(f"{verb}: {name}", "a text", value)
    return replace(plain, **given)
