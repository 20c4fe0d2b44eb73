"""The command ``predict``: compute the output for a given drive."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from anhyst.data.path import HistoryLike
    from anhyst.model.actuator import Model
    from anhyst.model.predict_file import RunSummary
    from anhyst.support.atomic import PathLike
    from anhyst.support.jobs import Progress

PLACE = 21, "Use a model"
PROGRESS = "reading"


def predict(
    model: Model | PathLike,
    drive: PathLike | Any,
    out: PathLike | None = None,
    *,
    columns: Mapping[str, str] | None = None,
    scale: Mapping[str, float | str] | None = None,
    flip: Collection[str] | None = None,
    history: HistoryLike | None = None,
    progress: Progress | None = None,
) -> RunSummary:
    """Compute the output for a given drive, such as the force for a current.

    DRIVE contains the input of the model (I_A, H_A_per_m, u_V) and the gap or another scheduling
    variable (gap_m). A model with eddy currents also needs the time (t_s). If there are loop labels
    (loop), each loop is a separate run. Units are converted. The output file repeats the columns
    and adds the output (F_N) and 'valid': 1 inside the valid range of the model, else 0.

    Parameters
    ----------
    model : Model or path-like
        A model.toml.
    drive : path-like, Loops, data frame or dict of arrays
        CSV with the drive, such as I_A.
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
    anhyst predict model.toml drive.csv --out force.csv
    """
    from anhyst.model.predict_file import run_file

    return run_file(model, "predict", drive, out, columns, scale, flip, history, progress)


def show(result: RunSummary, _: Mapping[str, Any]) -> Iterator[str]:
    """Return the terminal output: the computed column, and its deviation from a measured column."""
    from anhyst.support.wording import count_text

    runs = "1 run" if result.runs == 1 else f"{result.runs} runs, each"
    yield f"{result.out}: {count_text(result.rows, 'row')}, {runs} {result.history}"
    yield f"{result.column}: {result.low:.6g} to {result.high:.6g} {result.unit}"
    deviation = result.deviation
    if deviation is not None and deviation.largest > 0.0:
        mean, rms, worst = (
            100.0 * value / deviation.largest
            for value in (deviation.mean_abs, deviation.rms, deviation.worst)
        )
        yield (
            f"deviation from the column in the file: mean {mean:.3g} %, rms {rms:.3g} %, worst "
            f"{worst:.3g} % of {deviation.of}"
        )
    if result.outside:
        rows = "1 row lies" if result.outside == 1 else f"{result.outside} rows lie"
        yield f"{rows} outside the valid range of the model (valid = 0)"
