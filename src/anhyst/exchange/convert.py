"""The verb ``convert``: a measurement in another format, or a rig file in the format of today."""

from __future__ import annotations

import warnings

from anhyst.data.convert import Conversion, convert_measurement
from anhyst.rig.kind_rules import read_rig_file
from anhyst.rig.rewriting import rewrite_rig
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError, RenamedWarning
from anhyst.support.kinds import RIGS, FileKind, refuse_other
from anhyst.support.progress import Progress


def convert(source: PathLike, out: PathLike, progress: Progress | None = None) -> Conversion:
    """Write a measurement in the format that a file's name says, or a rig file in that of today.

    Values stay bit for bit. A format of one table gets channels of several clocks interpolated
    onto the finest, and a note. Comments of a rig file stay beside their keys.

    Parameters
    ----------
    source
        A measurement in any format that is read, or a rig file of any age.
    out
        To write; one that exists is replaced.
    progress
        Called with bytes read and file size, where the source is text.

    Returns
    -------
    Conversion
        What was written; of a rig file no channels.

    Raises
    ------
    InputError
        The source cannot be read, the format cannot be written, or holds nothing of the source.
    """
    if refuse_other(source, [FileKind.MEASUREMENT, *RIGS], "convert") not in RIGS:
        return convert_measurement(source, out, progress)
    if not str(out).lower().endswith(".toml"):
        raise InputError(f"{out}: a rig file is TOML; name it .toml", code="unknown-format")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RenamedWarning)
        read_rig_file(source, RIGS)  # what is wrong with it is said by its own lines
    rewrite_rig(source, out)
    return Conversion(str(out), 0, 0, ())
