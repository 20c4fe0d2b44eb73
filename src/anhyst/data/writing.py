"""Writing recordings in the format that a file's name says."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

from anhyst.data.formats import PACKAGES, WRITERS
from anhyst.data.formats.channels import ChannelGroup, Series, need_package
from anhyst.support.arrays import FloatArray
from anhyst.support.atomic import PathLike, check_writable, write_error
from anhyst.support.errors import InputError
from anhyst.support.units import split_header


def check_format(path: PathLike) -> None:
    """Refuse a file that no format is written as, or whose package is not installed."""
    named = Path(path)
    suffix = named.suffix.lower()
    if suffix not in WRITERS:
        raise InputError(
            f"{path}: is written as {', '.join(WRITERS)}; name it so", code="wrong-ending"
        )
    if suffix in PACKAGES:
        need_package(named, PACKAGES[suffix])


def check_recording(path: PathLike, reads: Iterable[PathLike] = ()) -> None:
    """Refuse, before the work, a recording that cannot be written; `reads` must not be replaced."""
    check_format(path)
    check_writable(path, reads)


def write_sections(path: PathLike, sections: Sequence[ChannelGroup]) -> tuple[str, ...]:
    """Write sections whole or not at all; return what the format cannot hold."""
    target = Path(path)
    suffix = target.suffix.lower()
    try:
        return WRITERS[suffix](target, sections)
    except (InputError, MemoryError):
        raise
    except OSError as error:  # where a library keeps what it has not written yet
        raise write_error(path, error) from None
    except Exception as error:  # of the format's library: names or types that it does not take
        raise InputError(
            f"{path}: {suffix} cannot hold this recording ({error}); choose another format",
            code="format-cannot-hold",
        ) from None


def write_recording(path: PathLike, columns: Mapping[str, FloatArray]) -> None:
    """Write columns of one length over the first, their clock, by header such as ``gap_m``."""
    clock, *series = (_series(header, values) for header, values in columns.items())
    write_sections(path, [ChannelGroup("", clock, tuple(series))])


def _series(header: str, values: FloatArray) -> Series:
    name, unit = split_header(header)
    return Series(name, unit.replace("_per_", "/"), values)
