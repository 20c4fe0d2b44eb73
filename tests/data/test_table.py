"""Text tables: every layout that is read, every fault that is named."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from anhyst.data import read_columns, write_csv
from anhyst.data.formats.columns import Texts
from anhyst.data.formats.layout import read_layout
from anhyst.support.atomic import atomic_writer
from anhyst.support.errors import InputError

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
    assert table.need("current", "I_A").tolist() == [0.0, 1.0, 2.0]
    assert table.need("force", "F_N").tolist() == [0.0, 2.5, 10.0]


def test_comments_become_notes(tmp_path: Path) -> None:
    table = read_columns(file_of(tmp_path, "# rig 3\n" + GOOD.replace("1,2.5", "# hm\n1,2.5")))
    assert table.notes == ("rig 3", "hm")


def test_latin1_degree_sign_is_read(tmp_path: Path) -> None:
    content = "I_A;T [°C]\n1,5;20\n".encode("latin-1")
    table = read_columns(file_of(tmp_path, content))
    assert table.need("temperature", "T_C").tolist() == [20.0]
    assert table.need("current", "I_A").tolist() == [1.5]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "is empty"),
        (b"  \n \n", "is empty"),
        ("# only\n# notes\n", "holds no table"),
        ("I_A,F_N\n", "has a header but no data"),
        ("1,2\n3,4\n", "line 1: numbers where the header should be"),
        (GOOD.replace("2.5", "abc"), "line 3, column 'F_N': 'abc' is not a number"),
        (GOOD.replace("2.5", ""), "line 3, column 'F_N': is empty"),
        (GOOD.replace("2.5", "1_0"), "line 3, column 'F_N': '1_0' is not a number"),
        (GOOD.replace("2.5", "NaN"), "line 3, column 'F_N': NaN is no measured value"),
        (GOOD.replace("2.5", "-inf"), "line 3, column 'F_N': -inf is no measured value"),
        (GOOD.replace("2.5", "1e999"), "line 3, column 'F_N': 1e999 is no measured value"),
        (GOOD.replace("1,2.5", "1"), "line 3: has 1 field where the header names 2 columns"),
        (GOOD.replace("1,2.5", "1,2,3"), "line 3: has 3 fields where the header names 2"),
        ("#a\n\n" + GOOD.replace("2.5", "x"), "line 5, column 'F_N': 'x' is not a number"),
        (GOOD.encode("utf-16"), "is UTF-16 text; save it again as UTF-8"),
        (GOOD.encode("utf-16-le"), "is UTF-16 text"),
        (bytes(range(256)) * 20, "is a binary file"),
        (b"PK\x03\x04rest", "a workbook"),
        (GOOD.encode() + b"1,1\n" * 2000 + b"\x00\x01\xff,3\n", "line 2005, column 'I_A': '??"),
    ],
)
def test_faults_are_one_line_with_file_and_line(
    tmp_path: Path, content: str | bytes, words: str
) -> None:
    path = file_of(tmp_path, content)
    with pytest.raises(InputError) as caught:
        read_columns(path)
    message = str(caught.value)
    assert message.startswith(f"{path}: ")
    assert words in message
    assert message.isprintable()


def test_a_drive_may_be_all_there_is(tmp_path: Path) -> None:
    path = file_of(tmp_path, "I [A]\n0\n1.5\n2,5\n")
    assert read_columns(path).need("current", "").tolist() == [0.0, 1.5, 2.5]
    with pytest.raises(InputError, match=r"line 1: one column only \('I \[A\]'\); a loop needs"):
        read_layout(path)


def test_a_header_may_stand_behind_many_comments(tmp_path: Path) -> None:
    table = read_columns(file_of(tmp_path, "# a remark\n" * 10_000 + GOOD))
    assert table.need("current", "I_A").tolist() == [0.0, 1.0, 2.0]
    assert len(table.notes) == 10_000


def test_a_negative_gap_is_named_with_its_line(tmp_path: Path) -> None:
    table = read_columns(file_of(tmp_path, "I_A,gap_mm\n0,0.3\n1,-0.3\n"))
    with pytest.raises(
        InputError, match=r"loops\.csv: line 3: negative gap -0\.0003 m; gaps count"
    ):
        table.get("gap")


def test_missing_file_and_folder_are_named(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"none\.csv: no such file"):
        read_columns(tmp_path / "none.csv")
    with pytest.raises(InputError, match="is a folder"):
        read_columns(tmp_path)


def test_time_going_backwards_is_named_with_its_line(tmp_path: Path) -> None:
    table = read_columns(file_of(tmp_path, "t_s,I_A\n0,1\n2,1\n# x\n1,1\n"))
    with pytest.raises(InputError, match=r"loops\.csv: line 5: time going backwards"):
        table.get("time")


def test_text_in_a_column_nobody_needs_is_kept(tmp_path: Path) -> None:
    path = file_of(tmp_path, 'I_A,remark,x1\n1,,3\n2,"a, b",n/a\n3,c,5\n')
    table = read_columns(path)
    assert table.need("current", "I_A").tolist() == [1.0, 2.0, 3.0]
    remark, other = table.columns[1], table.columns[2]
    assert isinstance(remark, Texts)
    assert isinstance(other, Texts)
    assert remark.rows() == ["", "a, b", "c"]
    assert other.rows() == ["3", "n/a", "5"]


def test_columns_are_mapped(tmp_path: Path) -> None:
    path = file_of(tmp_path, "U_M_V,flux_mWb,y_um\n1,2,3\n")
    assert read_columns(path, {"U_M_V": "psi_Wb"}).need("flux_linkage", "").tolist() == [1.0]
    assert read_columns(path, {"flux_mWb": "psi"}).need("flux_linkage", "").tolist() == [0.002]
    assert read_columns(path, {"y_um": "x"}).need("displacement", "").tolist() == [3e-6]


@pytest.mark.parametrize(
    ("mapping", "words"),
    [
        ({"z": "I_A"}, "has no column 'z' to map"),
        ({"y_um": "x_mm"}, "the file says um, the mapping mm"),
        ({"y_um": "I_foo"}, "unknown unit 'foo'"),
        ({"raw": "gap"}, "has no unit; call it 'gap_m'"),
    ],
)
def test_mappings_that_make_no_sense_are_refused(
    tmp_path: Path, mapping: dict[str, str], words: str
) -> None:
    path = file_of(tmp_path, "U_M_V,raw,y_um\n1,2,3\n")
    with pytest.raises(InputError, match=words):
        read_columns(path, mapping)


def test_absent_and_doubled_quantities_are_reported(tmp_path: Path) -> None:
    table = read_columns(file_of(tmp_path, "I_A,I_mA\n1,2\n"))
    assert table.get("gap") is None
    with pytest.raises(InputError, match="has no column of force"):
        table.need("force", "F_N")
    with pytest.raises(InputError, match="columns 'I_A' and 'I_mA' both hold current"):
        table.get("current")


def test_output_repeats_the_input_columns(tmp_path: Path) -> None:
    table = read_columns(file_of(tmp_path, "I,note,gap\nmA,,mm\n100,a,0.3\n200.5,b;c,0.3\n"))
    out = tmp_path / "force.csv"
    write_csv(out, {**table.as_columns(), "F_N": np.array([0.1, 1.0 / 3.0])})
    assert out.read_text() == (
        'I [mA],note,gap [mm],F_N\n100,a,0.3,0.1\n200.5,"b;c",0.3,0.3333333333333333\n'
    )


def test_values_are_read_only(tmp_path: Path) -> None:
    values = read_columns(file_of(tmp_path, GOOD)).need("current", "I_A")
    with pytest.raises(ValueError, match="read-only"):
        values[0] = 1.0


def long_table(folder: Path, rows: int, *, fault: int | None = None) -> Path:
    """Write a table of several chunks, with text, an unused column and perhaps one bad field."""
    lines = [f"{k * 1e-5:.6f},run {k % 3},{k / 7:.7f},x{k},{-k / 3:.6e}" for k in range(rows)]
    if fault is not None:
        lines[fault] = lines[fault].replace(",run", ",run").rsplit(",", 1)[0] + ",oops"
    return file_of(folder, "t_s,loop,I_A,tag,F_N\n" + "\n".join(lines) + "\n")


def test_long_files_are_read_in_chunks_with_progress(tmp_path: Path) -> None:
    path = long_table(tmp_path, 200_000)
    seen: list[tuple[float, float]] = []
    table = read_columns(path, {"tag": ""}, progress=lambda done, size: seen.append((done, size)))
    size = path.stat().st_size
    assert len(seen) >= 2
    assert seen[-1] == (size, size)
    k = np.arange(200_000)
    np.testing.assert_allclose(table.need("current", "I_A"), k / 7, atol=5e-8)
    np.testing.assert_allclose(table.need("force", "F_N"), -k / 3, rtol=5e-7)
    labels = table.columns[1]
    assert isinstance(labels, Texts)
    assert labels.values == ("run 0", "run 1", "run 2")
    assert np.array_equal(labels.codes, k % 3)


def test_fault_far_into_a_long_file_is_found(tmp_path: Path) -> None:
    path = long_table(tmp_path, 200_000, fault=170_001)
    with pytest.raises(InputError, match="line 170003, column 'F_N': 'oops' is not a number"):
        read_columns(path)


def test_slow_and_fast_way_read_the_same(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    rows = [",".join(f"{v:.17g}" for v in row) for row in rng.normal(size=(300, 3))]
    plain = file_of(tmp_path, "I_A,F_N,x_m\n" + "\n".join(rows) + "\n", "fast.csv")
    rows.insert(100, "# a comment sends this chunk the slow way")
    slow = file_of(tmp_path, "I_A,F_N,x_m\n" + "\n".join(rows) + "\n", "slow.csv")
    one, two = read_columns(plain), read_columns(slow)
    for name in ("current", "force", "displacement"):
        assert np.array_equal(one.need(name, ""), two.need(name, ""))


def test_writing_is_all_or_nothing(tmp_path: Path) -> None:
    out = tmp_path / "sub" / "out.csv"
    with pytest.raises(InputError, match=r"out\.csv: cannot be written: No such file"):
        write_csv(out, {"I_A": np.zeros(3)})
    with pytest.raises(InputError, match="cannot be written: File name too long"):
        write_csv(tmp_path / ("n" * 300), {"I_A": np.zeros(3)})
    with pytest.raises(InputError, match="cannot be written: Is a directory"):
        write_csv(tmp_path, {"I_A": np.zeros(3)})
    assert list(tmp_path.iterdir()) == []


def test_devices_are_written_to_and_not_replaced() -> None:
    device = Path("/dev/full")
    if not device.is_char_device():
        pytest.skip("no /dev/full here")
    with pytest.raises(InputError, match="/dev/full: cannot be written: No space left on device"):
        write_csv(device, {"I_A": np.zeros(3)})
    assert device.is_char_device()


def test_interrupted_writing_leaves_nothing_behind(tmp_path: Path) -> None:
    def half() -> None:
        with atomic_writer(tmp_path / "model.toml") as file:
            file.write("half of it")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        half()
    assert list(tmp_path.iterdir()) == []


def test_full_disk_leaves_nothing_behind(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(self: Path, target: Path) -> Path:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", full)
    old = file_of(tmp_path, "kept", "out.csv")
    with pytest.raises(InputError, match=r"out\.csv: cannot be written: No space left on device"):
        write_csv(old, {"I_A": np.zeros(3)})
    assert [path.name for path in tmp_path.iterdir()] == ["out.csv"]
    assert old.read_text() == "kept"
