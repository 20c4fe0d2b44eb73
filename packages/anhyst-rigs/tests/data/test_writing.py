"""A recording comes back from every format as it was, and what cannot be written is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from anhyst.data.formats import WRITERS
from anhyst.data.table import check_format, check_recording, read_columns, write_recording
from anhyst.support.errors import InputError
from anhyst.support.units import find_unit, split_header
from anhyst_rigs.rig.recording import COLUMNS, Recording


def recording(rows: int = 50) -> Recording:
    table = np.random.default_rng(2).normal(size=(rows, len(COLUMNS)))
    table[:, COLUMNS.index("t_s")] = np.arange(rows) / 20e3
    table[:, COLUMNS.index("state")] = 67.0
    return Recording.from_table(table)


@pytest.mark.first(3)
@pytest.mark.parametrize("rows", [1, 50])
@pytest.mark.parametrize("suffix", [*WRITERS, ".MAT"])
def test_a_recording_of_a_bearing_is_read_back_bit_for_bit(suffix: str, rows: int, tmp_path: Path) -> None:
    path, written = tmp_path / f"run{suffix}", recording(rows)
    write_recording(path, written.columns)
    back = read_columns(path)
    units = back.source_table.units or ("",) * len(back.source_table.header)
    found = {
        split_header(name, unit)[0]: (unit or split_header(name)[1], values)
        for name, unit, values in zip(back.source_table.header, units, back.columns, strict=True)
    }
    for name, values in written.columns.items():
        plain, unit = split_header(name)
        read_unit, read = found[plain]
        assert np.array_equal(np.asarray(read), values), name
        assert find_unit(read_unit) == find_unit(unit), name


def test_a_recording_as_csv_has_the_headers_that_the_documentation_names(tmp_path: Path) -> None:
    write_recording(tmp_path / "run.csv", recording().columns)
    assert (tmp_path / "run.csv").read_text().splitlines()[0] == ",".join(COLUMNS)


@pytest.mark.parametrize("name", ["run.txt", "run", "run.json"])
def test_another_ending_is_refused(name: str) -> None:
    with pytest.raises(InputError, match=r"\.parquet"):
        check_format(name)


def test_an_input_file_is_not_replaced(tmp_path: Path) -> None:
    path = tmp_path / "loops.csv"
    path.touch()
    with pytest.raises(InputError, match=r"loops\.csv"):
        check_recording(path, input_files=[path])
