"""What was recorded of a simulated loop, and its files."""

from __future__ import annotations

import io
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from anhyst._core import LOOP_COLUMNS
from anhyst.control.states import Phase, State
from anhyst.data.files import write_csv
from anhyst.support.arrays import FloatArray
from anhyst.support.atomic import PathLike, write_bytes
from anhyst.support.errors import InputError

COLUMNS: tuple[str, ...] = tuple(LOOP_COLUMNS.split())
"""Of every recording, the unit in the name; described in docs/simulate.md."""


def in_column(state: State, phase: Phase = Phase.REST) -> int:
    """Return what the column ``state`` says of a state and a phase of the controller."""
    return 16 * state + phase


READY, RUN, FAULT = (in_column(state) for state in (State.READY, State.RUN, State.FAULT))
"""The least that the column says in each of these states; the phase comes on top."""

BREAKAWAY, RISE, HOVER, DESCEND, SET_DOWN = (
    in_column(State.RUN, phase)
    for phase in (Phase.BREAKAWAY, Phase.RISE, Phase.HOVER, Phase.DESCEND, Phase.SET_DOWN)
)
"""On its rest while the force rises; under control on its way, there, and down; let go."""


@dataclass(frozen=True)
class Recording:
    """One row a tick.

    Parameters
    ----------
    table : ndarray, shape (n, len(COLUMNS))
        As :data:`COLUMNS` names them.
    """

    table: FloatArray

    def __getitem__(self, name: str) -> FloatArray:
        column: FloatArray = self.table[:, COLUMNS.index(name)]
        return column

    def __len__(self) -> int:
        return int(self.table.shape[0])

    def part(self, begin: int, end: int) -> Recording:
        """Return the rows from one tick up to another."""
        return Recording(self.table[begin:end])

    @property
    def columns(self) -> Mapping[str, FloatArray]:
        """All of it by name."""
        return {name: self[name] for name in COLUMNS}


ENDINGS = (".csv", ".mat")


def check_ending(path: PathLike) -> None:
    """Refuse a file that is no recording by its ending."""
    if Path(path).suffix.lower() not in ENDINGS:
        raise InputError(
            f"{path}: a recording is written as .csv or .mat; name it so", code="wrong-ending"
        )


def write_recording(path: PathLike, recording: Recording) -> None:
    """Write a recording as CSV or, by its ending, as MAT (version 5).

    Parameters
    ----------
    path : path-like
        Ends in ``.csv`` or ``.mat``.
    recording : Recording

    Raises
    ------
    InputError
        Another ending, or the place cannot be written.
    """
    check_ending(path)
    if Path(path).suffix.lower() == ".csv":
        write_csv(path, recording.columns)
        return
    from scipy.io import savemat

    content = io.BytesIO()
    savemat(content, dict(recording.columns), do_compression=True, oned_as="column")
    write_bytes(path, content.getvalue())


def read_recording(path: PathLike) -> Recording:
    """Read what :func:`write_recording` wrote.

    Parameters
    ----------
    path : path-like
        Ends in ``.csv`` or ``.mat``.

    Raises
    ------
    InputError
        Another ending, the file cannot be read, or it lacks a column of a recording.
    """
    check_ending(path)
    try:
        found = _read_csv(path) if Path(path).suffix.lower() == ".csv" else _read_mat(path)
    except OSError as error:
        raise InputError(
            f"{path}: cannot be read: {error.strerror}; check the path", code="cannot-be-read"
        ) from error
    missing = [name for name in COLUMNS if name not in found]
    if missing:
        raise InputError(
            f"{path}: column {missing[0]} is missing; name a recording of simulate",
            code="column-missing",
            key=missing[0],
        )
    return Recording(np.column_stack([found[name] for name in COLUMNS]))


def _read_csv(path: PathLike) -> Mapping[str, FloatArray]:
    try:
        with Path(path).open(encoding="utf-8") as file:
            names = file.readline().rstrip("\n").split(",")
            return dict(zip(names, np.loadtxt(file, delimiter=",", ndmin=2).T, strict=True))
    except ValueError as error:
        raise InputError(
            f"{path}: {error}; name a recording of simulate", code="not-a-recording"
        ) from error


def _read_mat(path: PathLike) -> Mapping[str, FloatArray]:
    from scipy.io import loadmat
    from scipy.io.matlab import MatReadError

    try:
        found = loadmat(io.BytesIO(Path(path).read_bytes()), variable_names=COLUMNS)
    except (MatReadError, ValueError, TypeError, NotImplementedError) as error:
        raise InputError(
            f"{path}: is no MAT file of version 5; name another", code="not-a-mat-file"
        ) from error
    return {name: np.ravel(found[name]) for name in COLUMNS if name in found}
