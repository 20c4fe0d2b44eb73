"""The command ``convert``: write a measurement in another file format."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from anhyst.data.convert import Conversion
    from anhyst.support.atomic import PathLike
    from anhyst.support.jobs import Progress

PLACE = 12, "From measurements to a model"
PROGRESS = "reading"


def convert(source: PathLike, out: PathLike, progress: Progress | None = None) -> Conversion:
    """Write a measurement in another file format.

    Values are kept bit for bit. If a format cannot store something, such as groups in CSV, a
    warning says so. For CSV and Parquet, channels with several clocks are interpolated to the
    finest clock.

    Parameters
    ----------
    source : path-like, ``FILE``
        A measurement in any format that can be read.
    out : path-like, argument
        File to write: .csv, .mat, .mf4, .tdms, .h5 or .parquet.
    progress : callable, optional
        Called with the bytes read and the file size, if the source is text.

    Returns
    -------
    Conversion
        The number of channels and samples that were written.

    Raises
    ------
    InputError
        The source cannot be read, or the format cannot be written or stores nothing of the source.

    Examples
    --------
    anhyst convert recording.mf4 recording.csv
    """
    from anhyst.data.convert import convert as work

    return work(source, out, progress)


def warnings(result: Conversion) -> tuple[str, ...]:
    """Return the warnings about information that the new format cannot store."""
    return result.notes


def show(result: Conversion, _: Mapping[str, Any]) -> list[str]:
    """Return the terminal output."""
    from anhyst.support.wording import count_text

    channels, samples = count_text(result.channels, "channel"), count_text(result.samples, "sample")
    return [f"{result.out}: {channels}, {samples}"]
