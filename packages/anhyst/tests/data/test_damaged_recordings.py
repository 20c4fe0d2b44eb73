"""Damaged and malicious recordings cause an error of one line, with bounded memory."""

from __future__ import annotations

import random
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anhyst.data import read_loops
from anhyst.data.formats import WRITERS, excel, mat, open_table
from anhyst.data.formats.channels import ChannelGroup, Series
from anhyst.data.table import list_channels
from tests.cli.command import quick
from tests.data import recordings
from tests.data.recordings import PACKAGES, loop, workbook
from tests.property.test_bad_input import holds_or_is_refused
from tests.refusals import refused

KEPT = Path(__file__).parent / "damaged"
"""Files that crash or hang libraries or fill the memory, found by tools/fuzz_files.py."""

TIMES, CURRENT, FORCE = loop(50.0)


def write(path: Path, *series: Series) -> Path:
    WRITERS[path.suffix](path, [ChannelGroup("", Series("t", "s", TIMES), series)])
    return path


@pytest.mark.first(1)
@pytest.mark.parametrize("path", sorted(KEPT.iterdir()), ids=lambda path: path.name)
def test_files_that_crash_a_library_are_refused_in_one_line(path: Path) -> None:
    if path.suffix in PACKAGES:
        pytest.importorskip(PACKAGES[path.suffix])
    result = quick("inspect", path, cwd=KEPT)
    # Another version of the library may read the file.
    assert result.returncode in {0, 2}
    if result.returncode == 2:
        assert result.stderr.startswith("anhyst: error: ")
        assert result.stderr.count("\n") == 1


@pytest.mark.first(2)
@pytest.mark.parametrize("suffix", [".mat", ".mf4", ".tdms", ".h5", ".parquet", ".xlsx"])
def test_a_file_that_is_cut_off_is_refused_with_its_name(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"run{suffix}"
    if suffix == ".xlsx":
        pytest.importorskip(PACKAGES[suffix])
        rows = zip(TIMES.tolist(), CURRENT.tolist(), strict=True)
        workbook(path, [["t_s", "I_A"], *map(list, rows)])
    else:
        if suffix != ".mat":
            pytest.importorskip(PACKAGES[suffix])
        write(path, Series("I", "A", CURRENT), Series("F", "N", FORCE))
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    with refused(f"damaged-file: run{suffix}"):
        list_channels(path)


def damaged(content: bytes, seed: int) -> bytes:
    """Change bits, bytes and sizes of a valid file, cut it or repeat parts of it."""
    chance, data = random.Random(seed), bytearray(content)
    for _ in range(chance.choice((1, 1, 2, 4, 8))):
        place = chance.randrange(len(data)) if data else 0
        match chance.randrange(5):
            case 0:
                data[place : place + 1] = bytes([chance.randrange(256)])
            case 1:
                number = chance.choice((0, 1, 0x7F, 0xFF, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF))
                data[place : place + 4] = number.to_bytes(4, "little")
            case 2:
                del data[place : place + chance.randrange(64)]
            case 3:
                data[place:place] = data[: chance.randrange(64)]
            case 4:
                del data[place + len(data) // 2 :]
    return bytes(data)


@pytest.fixture(scope="module")
def mat_files(tmp_path_factory: pytest.TempPathFactory) -> list[bytes]:
    """Recordings of version 5, compressed and not."""
    from scipy.io import savemat

    folder = tmp_path_factory.mktemp("mat")
    savemat(folder / "plain.mat", {"I_A": CURRENT, "F_N": FORCE, "about": {"names": ["a", "bc"], "on": True}})
    files = [folder / "plain.mat", recordings.object_in_v5(folder / "object.mat")]
    files += [recordings.with_time(folder / "time.mat")]
    files += [write(folder / "desk.mat", Series("I", "A", CURRENT))]
    return [path.read_bytes() for path in files]


@pytest.mark.slow
@settings(max_examples=30)
@given(seed=st.integers(0, 2**32))
def test_a_damaged_mat_file_is_listed_or_refused(mat_files: list[bytes], seed: int) -> None:
    content = damaged(mat_files[seed % len(mat_files)], seed)
    holds_or_is_refused("run.mat", content, list_channels)


def test_false_sizes_in_a_mat_file_are_found_before_allocation(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def part(kind: int, content: bytes) -> bytes:
        return struct.pack("<2I", kind, len(content)) + content + bytes(-len(content) % 8)

    head = b"MATLAB 5.0 MAT-file".ljust(124) + b"\x00\x01IM"
    many = part(6, struct.pack("<2I", 2, 0)) + part(5, struct.pack("<2i", 1, 400_000))
    many += part(1, b"s") + part(5, struct.pack("<i", 8)) + part(1, b"a".ljust(8, b"\0"))
    path = tmp_path / "run.mat"
    path.write_bytes(head + part(14, many))
    with refused("damaged-file"):
        open_table(path)
    monkeypatch.setattr(mat, "MAX_BYTES", 1 << 20)
    packed = zlib.compress(part(14, bytes(1 << 21)))
    path.write_bytes(head + struct.pack("<2I", 15, len(packed)) + packed)
    with refused("too-large"):
        mat.MatGuard(path).check(path.read_bytes())


def test_hdf5_is_not_led_out_of_the_file_nor_round_in_it(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "run.h5"
    with h5py.File(path, "w") as file:
        file["t_s"], file["I_A"], file["F_N"] = TIMES, CURRENT, FORCE
        group = file.create_group("a")
        group["b"] = group  # a hard link to itself
        group["up"] = h5py.SoftLink("/a/up")
    assert [channel.name for channel in list_channels(path)] == ["t_s", "F_N", "I_A"]
    with h5py.File(path, "a") as file:
        file.create_dataset("huge", shape=(10**15,), chunks=(1024,), dtype="f8")
    with refused("too-large /huge: 1000000000000000"):
        list_channels(path)
    with h5py.File(path, "a") as file:
        del file["huge"]
        file["secret"] = h5py.ExternalLink("/etc/passwd", "/x")
    with refused("external-link /secret: '/etc/passwd'"):
        list_channels(path)


def test_a_workbook_that_would_fill_the_memory_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("python_calamine")
    rows: list[list[object]] = [["t_s", "I_A"], [0.0, 1.0], [1.0, 2.0], [2.0, 3.0]]
    far_cells = '<row r="1048576"><c r="XFD1048576"><v>1</v></c></row>'
    path = workbook(tmp_path / "run.xlsx", rows, cells=far_cells)
    with refused("too-large: 17179869184"):
        list_channels(path)
    monkeypatch.setattr(excel, "_MAX_EXPANDED_BYTES", 1 << 16)
    path = workbook(tmp_path / "bomb.xlsx", rows, cells=" " * (1 << 18))
    with refused("too-large"):
        list_channels(path)


def test_missing_times_are_named(tmp_path: Path) -> None:
    times = TIMES.copy()
    times[7] = np.nan
    path = tmp_path / "run.mat"
    clock, series = Series("t", "s", times), (Series("I", "A", CURRENT), Series("F", "N", FORCE))
    WRITERS[".mat"](path, [ChannelGroup("", clock, series)])
    with refused("not-finite: run.mat; sample 8"):
        read_loops(path)
    slow_channel = ChannelGroup("b", Series("t", "s", TIMES[::5]), (Series("gap", "mm", CURRENT[::5]),))
    WRITERS[".mat"](path, [ChannelGroup("a", clock, series), slow_channel])
    with refused("time-not-rising t: sample 8"):
        read_loops(path)
