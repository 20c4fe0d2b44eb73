"""The command ``invert``: compute the drive for a demanded output."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import TYPE_CHECKING, Any

from anhyst.verbs.predict import show

if TYPE_CHECKING:
    from anhyst.data.path import HistoryLike
    from anhyst.model.actuator import Model
    from anhyst.model.predict_file import RunSummary
    from anhyst.support.atomic import PathLike
    from anhyst.support.jobs import Progress

__all__ = ["invert", "show"]

PLACE = 22, "Use a model"
PROGRESS = "reading"


def invert(
    model: Model | PathLike,
    demand: PathLike | Any,
    out: PathLike | None = None,
    *,
    columns: Mapping[str, str] | None = None,
    scale: Mapping[str, float | str] | None = None,
    flip: Collection[str] | None = None,
    history: HistoryLike | None = None,
    progress: Progress | None = None,
) -> RunSummary:
    """Compute the drive for a demanded output, such as the current for a force.

    DEMAND contains the output of the model (F_N, B_T, psi_Wb, x_m) and the other columns that
    `predict` needs, without the drive. If two currents give the same force, the positive one is
    used. The output file repeats the columns and adds the drive (I_A) and 'valid': 1 inside the
    valid range of the model, else 0.

    Parameters
    ----------
    model : Model or path-like
        A model.toml.
    demand : path-like, Loops, data frame or dict of arrays
        CSV with the demanded output, such as F_N.
    out : path-like, ``FILE``, required on the command line
        CSV file to write.
    columns, scale, flip : as of `read_loops`, optional
    history : str or list of float, ``HISTORY``, optional
        What happened before the first sample: 'demagnetised', 'settled' (the file is a cycle,
        repeated until it closes), or 'conditioned:0,2,0' (reversal points of the input in SI
        units). [default: as in the model]
    progress : callable, optional
        Called with the bytes read and the file size.

    Returns
    -------
    RunSummary
        The run, with the columns of the output file.

    Raises
    ------
    InputError
        A file cannot be read or written, a column is missing, or a sample is not valid.

    Examples
    --------
    anhyst invert model.toml demand.csv --out current.csv
    """
    from anhyst.model.predict_file import run_file

    return run_file(model, "invert", demand, out, columns, scale, flip, history, progress)
