"""A recording comes back from its file as it was, and what is none is refused in one line."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from anhyst.rig.bearing.recording import COLUMNS, Recording, read_recording, write_recording
from tests.refusals import refused


def recording() -> Recording:
    table = np.random.default_rng(2).normal(size=(50, len(COLUMNS)))
    table[:, COLUMNS.index("state")] = 67.0
    return Recording(table)


@pytest.mark.parametrize("name", ["run.csv", "run.mat", "run.MAT"])
def test_what_was_written_is_read_back_bit_for_bit(name: str, tmp_path: Path) -> None:
    write_recording(tmp_path / name, recording())
    assert np.array_equal(read_recording(tmp_path / name).table, recording().table)


def test_a_single_tick_is_read_back(tmp_path: Path) -> None:
    for name in ("one.csv", "one.mat"):
        write_recording(tmp_path / name, recording().part(0, 1))
        assert np.array_equal(read_recording(tmp_path / name).table, recording().table[:1])


@pytest.mark.parametrize(
    ("name", "content", "text"),
    [
        ("run.txt", b"", "wrong-ending"),
        ("run.csv", b"t_s,gap_m\n0,1\n", "column-missing reference_m"),
        ("run.csv", b"t_s,gap_m\n0,what\n", "not-a-recording"),
        ("run.csv", b"t_s\n0,1\n", "not-a-recording"),
        ("run.mat", b"t_s,gap_m\n0,1\n", "not-a-mat-file"),
        ("run.mat", b"", "not-a-mat-file"),
    ],
)
def test_what_is_no_recording_is_refused(
    name: str, content: bytes, text: str, tmp_path: Path
) -> None:
    (tmp_path / name).write_bytes(content)
    with refused(text):
        read_recording(tmp_path / name)


def test_a_file_that_is_not_there_is_reported(tmp_path: Path) -> None:
    for name in ("none.csv", "none.mat"):
        with refused(f"cannot-be-read: {name}"):
            read_recording(tmp_path / name)
