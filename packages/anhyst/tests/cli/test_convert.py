"""``anhyst convert``, and the channels that ``anhyst inspect`` lists."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import pytest

from anhyst.cli.app import main
from tests.data import recordings
from tests.data.recordings import PACKAGES
from tests.refusals import says

from .command import quick, unwrapped


def test_the_options_that_inspect_lists_turn_a_recording_into_a_model(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = recordings.control_desk(tmp_path / "run.mat")
    assert main(["inspect", str(source)]) == 0
    listed = capsys.readouterr().out
    for cells in (
        ("Coil/Current", "A", "2000", "1000", "0 to 3", "current"),
        ("Load cell", "N", "2000", "1000", "force"),
        ("Gap", "mm", "200", "100", "0.4 to 0.4", "gap"),
    ):
        lines = [f" {line} " for line in listed.splitlines()]
        assert any(all(f" {cell} " in line for cell in cells) for line in lines)
    assert "'Coil/Current' as current, 'Load cell' as force" in " ".join(listed.split())
    assert main(["inspect", str(source), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["input"], found["output"], found["schedule"]) == ("I_A", "F_N", "gap_m")

    table = tmp_path / "run.csv"
    assert main(["convert", str(source), str(table)]) == 0
    message = capsys.readouterr()
    assert unwrapped(message.out).endswith("run.csv: 3 channels, 1991 samples\n")
    assert "interpolated linearly" in message.err
    assert "CSV cannot store groups" in message.err
    mapping = "Coil/Current_A=I_A,Load cell [N]=F_N"
    assert main(["inspect", str(table), "--columns", mapping, "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["loops"] == found["loops"]


@pytest.mark.first(1)
@pytest.mark.parametrize("suffix", [".mf4", ".tdms", ".h5", ".parquet", ".mat"])
def test_a_csv_comes_back_from_every_format_as_it_was(suffix: str, tmp_path: Path) -> None:
    if suffix in PACKAGES:
        pytest.importorskip(PACKAGES[suffix])
    source, there, back = tmp_path / "a.csv", tmp_path / f"b{suffix}", tmp_path / "c.csv"
    rows = "0,1.5,-2e-300,3,rise\n0.001,0.1,1e+22,3,fall\n0.002,7,0.30000000000000004,3,fall\n"
    source.write_text("t_s,I_mA,H_kA_per_m,spindle torque [Nm],loop\n" + rows)
    assert main(["convert", str(source), str(there)]) == 0
    assert main(["convert", str(there), str(back)]) == 0
    assert back.read_text() == source.read_text()


def test_an_output_that_cannot_be_written_is_refused_before_reading(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = recordings.with_time(tmp_path / "run.mat")
    for arguments, message in (
        ((path, tmp_path / "run.xlsx"), "wrong-ending: .csv, .mat, .mf4, .tdms, .h5"),
        ((path, path), "writes-over-input: run.mat"),
        ((path, tmp_path / "no" / "run.csv"), "cannot-be-written"),
        ((tmp_path / "none.mat", tmp_path / "run.csv"), "no-such-file: none.mat"),
    ):
        assert main(["convert", *map(str, arguments)]) == 2
        assert says(capsys.readouterr().err, message)
    assert [one.name for one in tmp_path.iterdir()] == ["run.mat"]


@pytest.mark.first(3)
@pytest.mark.skipif(sys.platform == "win32", reason="has no limit on the size of files")
@pytest.mark.parametrize("suffix", [".csv", ".mf4", ".tdms", ".h5", ".parquet", ".mat"])
def test_a_full_disk_leaves_no_partial_file(suffix: str, tmp_path: Path) -> None:
    if suffix in PACKAGES:
        pytest.importorskip(PACKAGES[suffix])
    rows = "".join(f"{n}e-4,{n % 977}.{n % 7919},{n % 613}.{n % 6007}\n" for n in range(20_000))
    (tmp_path / "run.csv").write_text("t_s,I_A,F_N\n" + rows)
    completed = quick("convert", "run.csv", f"full{suffix}", cwd=tmp_path, file_size=50_000)
    assert completed.returncode == 2, completed.stderr
    assert says(completed.stderr, f"cannot-be-written: full{suffix}")
    assert [path.name for path in tmp_path.iterdir()] == ["run.csv"]
