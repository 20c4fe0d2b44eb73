"""Recordings in MDF 4 (ASAM), by the package asammdf."""

from __future__ import annotations

import hashlib
import importlib.util
from pathlib import Path
from typing import Any

import numpy as np

from anhyst.data.formats.open_table import MemoryTable
from anhyst.support.errors import InputError


def open_mdf(path: Path, least: int) -> MemoryTable:
    """Read the one group of channels of an MDF file; channels of text are left out.

    Raises
    ------
    InputError
        No file, no MDF 4, no group with so many channels of numbers, several groups, or asammdf is
        not installed.
    """
    if importlib.util.find_spec("asammdf") is None:
        raise InputError(f"{path}: asammdf is not installed: pip install 'anhyst[io]'")
    try:
        sha256 = hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise InputError(f"{path}: {error.strerror}") from None
    signals = _signals(path)
    if len(signals) < least:
        raise InputError(f"{path}: {len(signals)} channels of numbers; at least {least} are needed")
    return MemoryTable(
        str(path),
        tuple(signal.name for signal in signals),
        tuple(signal.samples for signal in signals),
        tuple(signal.unit for signal in signals),
        sha256,
    )


def _signals(path: Path) -> list[Any]:
    from asammdf import MDF
    from asammdf.blocks.utils import MdfException

    try:
        with MDF(path) as file:
            stored: list[Any] = list(file.groups)
            groups = [n for n, one in enumerate(stored) if one.channel_group.cycles_nr > 0]
            if len(groups) != 1:
                raise InputError(
                    f"{path}: {len(groups)} groups of channels with samples; keep one of them in a "
                    "file of its own"
                )
            count = len(file.groups[groups[0]].channels)
            read = [file.get(group=groups[0], index=n) for n in range(count)]
    except (MdfException, ValueError, KeyError, IndexError) as error:
        raise InputError(f"{path}: is no whole MDF 4 file: {error}") from None
    return [
        one for one in read if one.samples.ndim == 1 and np.issubdtype(one.samples.dtype, np.number)
    ]
