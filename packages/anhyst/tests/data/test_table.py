"""Text tables: supported layouts are read, and faults are named."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest

from anhyst.data import read_columns, write_csv
from anhyst.data.formats.channels import Texts
from anhyst.data.formats.text import open_text
from anhyst.support.atomic import atomic_writer
from tests.refusals import refused

GOOD = "I_A,F_N\n0,0\n1,2.5\n2,10\n"


def file_of(folder: Path, content: str | bytes, name: str = "loops.csv") -> Path:
    path = folder / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


@pytest.mark.parametrize(
    "content",
    [
        GOOD,
        GOOD.replace(",", ";"),
        GOOD.replace(",", "\t"),
        GOOD.replace(",", "  "),
        GOOD.replace(",", ", "),
        GOOD.replace(",", ";").replace(".", ","),
        GOOD.replace(",", "\t").replace(".", ","),
        GOOD.replace("\n", "\r\n"),
        GOOD.replace("\n", "\r"),
        GOOD.rstrip("\n"),
        GOOD + "\n\n",
        GOOD + ",\n",
        "\ufeff" + GOOD,
        "# rig 3\n\n" + GOOD,
        GOOD.replace("1,2.5", "# pause\n1,2.5"),
        GOOD.replace("1,2.5", '"1","2.5"'),
        GOOD.replace("I_A,F_N", '"I_A","F_N"'),
        GOOD.replace("I_A,F_N", "I [A],F [N]"),
        GOOD.replace("I_A,F_N", "I,F\nA,N"),
        GOOD.replace("I_A,F_N", "I,F\n[A],[N]"),
        GOOD.replace("I_A,F_N", "I,F\nmA,N").replace("1,", "1e3,").replace("\n2,", "\n2000,"),
        GOOD.replace("I_A,F_N", "# I_A F_N"),
        GOOD.replace("\n", ",\n"),
        "I [A]   F (N)\n 0 0\n 1 2.5\n 2 10\n",
    ],
)
def test_layouts_are_read_alike(tmp_path: Path, content: str) -> None:
    table = read_columns(file_of(tmp_path, content))
    assert table.require("current", "I_A").tolist() == [0.0, 1.0, 2.0]
    assert table.require("force", "F_N").tolist() == [0.0, 2.5, 10.0]


def test_comments_become_notes(tmp_path: Path) -> None:
    table = read_columns(file_of(tmp_path, "# rig 3\n" + GOOD.replace("1,2.5", "# hm\n1,2.5")))
    assert table.notes == ("rig 3", "hm")


def test_latin1_degree_sign_is_read(tmp_path: Path) -> None:
    content = "I_A;T [°C]\n1,5;20\n".encode("latin-1")
    table = read_columns(file_of(tmp_path, content))
    assert table.require("temperature", "T_C").tolist() == [20.0]
    assert table.require("current", "I_A").tolist() == [1.5]


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le", "utf-16-be", "latin-1"])
def test_text_is_read_in_every_usual_encoding(tmp_path: Path, encoding: str) -> None:
    content = "# Messung für µm\r\nI_A;T [°C]\r\n1,5;20\r\n2,5;21\r\n"
    path = file_of(tmp_path, content.encode(encoding))
    table = read_columns(path)
    assert table.require("current", "I_A").tolist() == [1.5, 2.5]
    assert table.require("temperature", "T_C").tolist() == [20.0, 21.0]
    assert table.notes == ("Messung für µm",)
    assert table.locate_row(1) == f"{path}: line 4"
    assert table.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "empty-file"),
        (b"  \n \n", "empty-file"),
        ("# only\n# notes\n", "no-table"),
        ("I_A,F_N\n", "no-data"),
        ("1,2\n3,4\n", "no-header: line 1"),
        (GOOD.replace("2.5", "abc"), "text-in-numbers F_N: line 3; 'abc'"),
        (GOOD.replace("2.5", ""), "not-finite F_N: line 3; 1 of 3 samples"),
        (GOOD.replace("2.5", "1_0"), "text-in-numbers F_N: line 3; '1_0'"),
        (GOOD.replace("2.5", "NaN"), "not-finite F_N: line 3"),
        (GOOD.replace("2.5", "-inf"), "not-finite F_N: line 3"),
        (GOOD.replace("2.5", "1e999"), "not-finite F_N: line 3"),
        (GOOD.replace("2.5", "OL"), "not-finite F_N: line 3"),
        (GOOD.replace("2.5", "-9.9E37"), "not-finite F_N: line 3"),
        (GOOD.replace("1,2.5", "1"), "fields-missing: line 3"),
        (GOOD.replace("1,2.5", "1,2,3"), "fields-missing: line 3"),
        ("#a\n\n" + GOOD.replace("2.5", "x"), "text-in-numbers F_N: line 5; 'x'"),
        (bytes(range(256)) * 20, "not-a-text"),
        (b"PK\x03\x04rest", "not-a-text"),
        (GOOD.encode() + b"1,1\n" * 2000 + b"\x00\x01\xff,3\n", "text-in-numbers I_A: line 2005"),
    ],
)
def test_faults_are_one_line_with_file_and_line(tmp_path: Path, content: str | bytes, words: str) -> None:
    path = file_of(tmp_path, content)
    with refused(words) as caught:
        read_columns(path).require("force", "F_N")
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert message.isprintable()


def test_a_file_may_hold_only_a_drive(tmp_path: Path) -> None:
    path = file_of(tmp_path, "I [A]\n0\n1.5\n2,5\n")
    assert read_columns(path).require("current", "").tolist() == [0.0, 1.5, 2.5]
    with refused("single-column: line 1; 'I [A]'"):
        open_text(path, 2)


def test_a_header_may_follow_many_comments(tmp_path: Path) -> None:
    table = read_columns(file_of(tmp_path, "# a remark\n" * 10_000 + GOOD))
    assert table.require("current", "I_A").tolist() == [0.0, 1.0, 2.0]
    assert len(table.notes) == 10_000


def test_a_negative_gap_is_named_with_its_line(tmp_path: Path) -> None:
    table = read_columns(file_of(tmp_path, "I_A,gap_mm\n0,0.3\n1,-0.3\n"))
    with refused("negative-gap gap: loops.csv; line 3; -0.0003 m"):
        table.get("gap")


def test_missing_file_and_folder_are_named(tmp_path: Path) -> None:
    with refused("no-such-file: none.csv"):
        read_columns(tmp_path / "none.csv")
    with refused("is-a-folder"):
        read_columns(tmp_path)


def test_time_going_backwards_is_named_with_its_line(tmp_path: Path) -> None:
    table = read_columns(file_of(tmp_path, "t_s,I_A\n0,1\n2,1\n# x\n1,1\n"))
    with refused("time-backwards: loops.csv; line 5"):
        table.get("time")


def test_text_in_an_unused_column_is_kept(tmp_path: Path) -> None:
    path = file_of(tmp_path, 'I_A,remark,x1\n1,,3\n2,"a, b",n/a\n3,c,5\n')
    table = read_columns(path)
    assert table.require("current", "I_A").tolist() == [1.0, 2.0, 3.0]
    remark, other = table.columns[1], table.columns[2]
    assert isinstance(remark, Texts)
    assert isinstance(other, Texts)
    assert remark.as_list() == ["", "a, b", "c"]
    assert other.as_list() == ["3", "n/a", "5"]


def test_columns_are_mapped(tmp_path: Path) -> None:
    path = file_of(tmp_path, "U_M_V,flux_mWb,y_um\n1,2,3\n")
    assert read_columns(path, {"U_M_V": "psi_Wb"}).require("flux_linkage", "").tolist() == [1.0]
    assert read_columns(path, {"flux_mWb": "psi"}).require("flux_linkage", "").tolist() == [0.002]
    assert read_columns(path, {"y_um": "x"}).require("displacement", "").tolist() == [3e-6]


@pytest.mark.parametrize(
    ("mapping", "words"),
    [
        ({"z": "I_A"}, "no-such-column z"),
        ({"y_um": "x_mm"}, "units-differ"),
        ({"y_um": "I_foo"}, "bad-header: 'foo'"),
        ({"raw": "gap"}, "bad-header: 'gap_m'"),
    ],
)
def test_mappings_that_make_no_sense_are_refused(tmp_path: Path, mapping: dict[str, str], words: str) -> None:
    path = file_of(tmp_path, "U_M_V,raw,y_um\n1,2,3\n")
    with refused(words):
        read_columns(path, mapping)


def test_absent_and_doubled_quantities_are_reported(tmp_path: Path) -> None:
    table = read_columns(file_of(tmp_path, "I_A,I_mA\n1,2\n"))
    assert table.get("gap") is None
    with refused("column-missing force"):
        table.require("force", "F_N")
    with refused("column-twice current: 'I_A'; 'I_mA'"):
        table.get("current")


def test_output_repeats_the_input_columns(tmp_path: Path) -> None:
    table = read_columns(file_of(tmp_path, "I,note,gap\nmA,,mm\n100,a,0.3\n200.5,b;c,0.3\n"))
    out = tmp_path / "force.csv"
    write_csv(out, {**table.as_columns(), "F_N": np.array([0.1, 1.0 / 3.0])})
    assert out.read_text() == (
        'I [mA],note,gap [mm],F_N\n100,a,0.3,0.1\n200.5,"b;c",0.3,0.3333333333333333\n'
    )


def test_values_are_read_only(tmp_path: Path) -> None:
    values = read_columns(file_of(tmp_path, GOOD)).require("current", "I_A")
    with pytest.raises(ValueError, match="read-only"):
        values[0] = 1.0


def long_table(folder: Path, rows: int, *, fault: int | None = None) -> Path:
    """Write a table of several chunks, with texts, an unused column and optionally an invalid
    field."""
    lines = [f"{k * 1e-5:.6f},run {k % 3},{k / 7:.7f},x{k},{-k / 3:.6e}" for k in range(rows)]
    if fault is not None:
        lines[fault] = lines[fault].replace(",run", ",run").rsplit(",", 1)[0] + ",oops"
    return file_of(folder, "t_s,loop,I_A,tag,F_N\n" + "\n".join(lines) + "\n")


@pytest.mark.slow
def test_long_files_are_read_in_chunks_with_progress(tmp_path: Path) -> None:
    path = long_table(tmp_path, 200_000)
    progress_calls: list[tuple[float, float]] = []
    table = read_columns(path, {"tag": ""}, progress=lambda done, size: progress_calls.append((done, size)))
    size = path.stat().st_size
    assert len(progress_calls) >= 2
    assert progress_calls[-1] == (size, size)
    k = np.arange(200_000)
    np.testing.assert_allclose(table.require("current", "I_A"), k / 7, atol=5e-8)
    np.testing.assert_allclose(table.require("force", "F_N"), -k / 3, rtol=5e-7)
    labels = table.columns[1]
    assert isinstance(labels, Texts)
    assert labels.values == ("run 0", "run 1", "run 2")
    assert np.array_equal(labels.codes, k % 3)


def test_a_fault_late_in_a_long_file_is_found(tmp_path: Path) -> None:
    path = long_table(tmp_path, 200_000, fault=170_001)
    with refused("text-in-numbers F_N: line 170003; 'oops'"):
        read_columns(path)


def test_slow_and_fast_way_read_the_same(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    rows = [",".join(f"{v:.17g}" for v in row) for row in rng.normal(size=(300, 3))]
    fast_text = file_of(tmp_path, "I_A,F_N,x_m\n" + "\n".join(rows) + "\n", "fast.csv")
    rows.insert(100, "# a comment sends this chunk the slow way")
    slow_text = file_of(tmp_path, "I_A,F_N,x_m\n" + "\n".join(rows) + "\n", "slow.csv")
    one, two = read_columns(fast_text), read_columns(slow_text)
    for name in ("current", "force", "displacement"):
        assert np.array_equal(one.require(name, ""), two.require(name, ""))


def test_writing_is_all_or_nothing(tmp_path: Path) -> None:
    out = tmp_path / "sub" / "out.csv"
    with refused("cannot-be-written ENOENT: out.csv"):
        write_csv(out, {"I_A": np.zeros(3)})
    with refused("cannot-be-written ENAMETOOLONG"):
        write_csv(tmp_path / ("n" * 300), {"I_A": np.zeros(3)})
    with refused("cannot-be-written EISDIR"):
        write_csv(tmp_path, {"I_A": np.zeros(3)})
    assert list(tmp_path.iterdir()) == []


def test_devices_are_written_to_and_not_replaced() -> None:
    device = Path("/dev/full")
    if not device.is_char_device():
        pytest.skip("no /dev/full here")
    with refused("cannot-be-written ENOSPC"):
        write_csv(device, {"I_A": np.zeros(3)})
    assert device.is_char_device()


def test_interrupted_writing_leaves_no_file(tmp_path: Path) -> None:
    def half() -> None:
        with atomic_writer(tmp_path / "model.toml") as file:
            file.write("half of it")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        half()
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_leaves_no_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(self: Path, target: Path) -> Path:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", full)
    old = file_of(tmp_path, "kept", "out.csv")
    with refused("cannot-be-written ENOSPC: out.csv"):
        write_csv(old, {"I_A": np.zeros(3)})
    assert [path.name for path in tmp_path.iterdir()] == ["out.csv"]
    assert old.read_text() == "kept"
