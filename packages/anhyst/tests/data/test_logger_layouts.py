"""Layouts of loggers and oscilloscopes are read correctly, or refused with the reason."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anhyst.data import read_loops
from anhyst.data.table import list_channels
from anhyst.support.errors import InputError
from tests.data.logger_layouts import (
    CURRENT,
    FORCE,
    LAYOUTS,
    TIMES,
    Export,
    aixacct,
    labview_multi,
    labview_no,
    labview_segments,
    picoscope,
    tektronix_beside,
    yokogawa,
)
from tests.data.test_damaged_recordings import damaged
from tests.refusals import refused


def write(folder: Path, export: Export) -> Path:
    path = folder / export.name
    path.write_bytes(export.text.encode(export.encoding))
    return path


@pytest.mark.parametrize("layout", LAYOUTS, ids=lambda layout: layout.__name__)
def test_layout_is_read_as_it_was_recorded(layout: Callable[[], Export], tmp_path: Path) -> None:
    export = layout()
    loops = read_loops(write(tmp_path, export), **export.reading, history="settled")
    (loop,) = loops.loops
    assert loop.time is not None
    assert np.allclose(loop.input, CURRENT, rtol=1e-5, atol=1e-5)
    assert np.allclose(loop.output, FORCE, rtol=1e-5, atol=1e-5)
    assert np.allclose(np.diff(loop.time), np.diff(TIMES), rtol=0.0, atol=1e-6)


def test_tables_and_segments_of_one_file_are_loops(tmp_path: Path) -> None:
    export = aixacct(tables=3)
    export = replace(export, text=export.text + "Table 4\n\nCycles [1]\tPr [uC/cm2]\n1\t20\n")
    loops = read_loops(write(tmp_path, export), **export.reading, history="settled")
    assert any("table 4 has other columns and is left out" in note for note in loops.notes)
    assert [loop.label for loop in loops.loops] == ["1", "2", "3"]
    for number, loop in enumerate(loops.loops, start=1):
        assert np.allclose(loop.input, number * CURRENT, atol=1e-5)
        assert np.allclose(loop.output, FORCE, atol=1e-5)
    separate = read_loops(write(tmp_path, labview_segments(pause=5.0)), history="settled")
    assert [loop.n for loop in separate.loops] == [150, 150]
    assert np.allclose(np.concatenate([loop.input for loop in separate.loops]), CURRENT, atol=1e-5)


@pytest.mark.parametrize(
    ("export", "old", "new", "words"),
    [
        (labview_no(), "X0\t-1,000000e-01\t-1", "X0\t-1,000000e-01\t-2", "different-steps: x0"),
        (labview_no(), "Delta_X\t1,000000e-03\t1", "Delta_X\t1,000000e-03\t2", "different-steps"),
        (labview_no(), "Delta_X", "Delta", "no-time-step: One"),
        (labview_multi(), "-0.100000000\t0.4", "-0.100000001\t0.4", "different-times: line 23"),
        (yokogawa(), "1.0000000e-03,1.0", "1.0000000e-03,2.0", "different-steps"),
        (tektronix_beside(), ",,,,,-9.0", ",,,,,-9.1", "different-times: next to the data"),
    ],
)
def test_channels_on_different_clocks_are_refused(
    export: Export, old: str, new: str, words: str, tmp_path: Path
) -> None:
    text = export.text.replace(old, new, 1)
    assert text != export.text
    with refused(words):
        read_loops(write(tmp_path, replace(export, text=text)), **export.reading)


@pytest.mark.parametrize("line", ["0.1;1,234;5.5", "0,1;1.234;5,5", "0.1\t1,234.5\t5.5", "0,1;1 234;5,5"])
def test_separators_of_thousands_are_refused(line: str, tmp_path: Path) -> None:
    sign = "\t" if "\t" in line else ";"
    path = tmp_path / "loop.csv"
    path.write_text(f"t_s{sign}I_A{sign}F_N\n" + f"{line}\n" * 20)
    with pytest.raises(InputError, match=r"line 2.*thousands"):
        read_loops(path)


@pytest.mark.parametrize("mark", ["∞", "-∞", "OL", "Over", "NaN", "#N/A", "----", "9.91E+37", ""])
def test_marks_of_invalid_samples_are_counted(mark: str, tmp_path: Path) -> None:
    lines = picoscope().text.split("\n")
    for n in (20, 21, 30):
        lines[n] = f"{lines[n].split(',')[0]},{mark},1.0"
    path = tmp_path / "pico.csv"
    path.write_text("\n".join(lines))
    with refused("not-finite Channel A: line 21; 3 of 300 samples; --drop invalid"):
        read_loops(path, **picoscope().reading)


@pytest.mark.parametrize("layout", LAYOUTS, ids=lambda layout: layout.__name__)
@settings(max_examples=12)
@given(seed=st.integers(0, 2**32 - 1))
def test_damaged_exports_are_read_or_refused(
    layout: Callable[[], Export], seed: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    export = layout()
    content = damaged(export.text.encode(export.encoding), seed)
    path = tmp_path_factory.mktemp("damaged") / export.name
    path.write_bytes(content)
    with contextlib.suppress(InputError):
        list_channels(path)
    with contextlib.suppress(InputError):
        read_loops(path, **export.reading)


@pytest.mark.parametrize(
    ("name", "columns"),
    [
        ("catman_names_above.txt", {"Strom [A]": "I_A", "Kraft U10 [N]": "F_N"}),
        ("rigol_start_increment.csv", {"CH1": "I_A", "CH2": "F_N"}),
        ("labview.lvm", {}),
        ("scope_metadata_beside_data.csv", {"CH1": "I_A", "CH2": "F_N"}),
        ("scope_time_ch1_ch2.csv", {"CH1": "I_A", "CH2": "F_N"}),
        ("comsol_percent.csv", {"Current (A)": "I_A", "Electromagnetic force (N)": "F_N"}),
        ("mdf4_named.mdf", {"I": "I_A", "F": "F_N"}),
    ],
)
def test_files_of_real_loggers_hold_the_same_loop(name: str, columns: dict[str, str], cases: Path) -> None:
    path = cases / name
    scale = dict.fromkeys(columns, 1.0)
    (loop,) = read_loops(path, columns=columns, scale=scale, history="settled").loops
    assert loop.n == 1200
    assert loop.input.max() == pytest.approx(3.0, rel=2e-3)
    assert loop.output.max() == pytest.approx(18.33, rel=2e-3)
    if name != "comsol_percent.csv":
        assert loop.time is not None
        assert np.diff(loop.time) == pytest.approx(1e-3, abs=1e-6)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("scope_overrange.csv", "not-finite Channel A: line 194; 21 of 1200 samples; --drop invalid"),
        ("invalid_samples.mf4", "not-finite I: sample 301; 25 of 1200 samples; --drop invalid"),
    ],
)
def test_invalid_samples_of_real_loggers_are_counted(name: str, words: str, cases: Path) -> None:
    columns = {"Channel A": "I_A", "Channel B": "F_N"} if name.endswith("csv") else {}
    scale = dict.fromkeys(columns, 1.0)
    with refused(words):
        read_loops(cases / name, columns=columns, scale=scale)
