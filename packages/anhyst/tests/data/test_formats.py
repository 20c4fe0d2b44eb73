"""Recordings of other programs are read correctly, and written without losses."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from anhyst.data import read_loops
from anhyst.data.convert import convert
from anhyst.data.formats import FORMATS, WRITERS, ChannelTable, open_table
from anhyst.data.formats.channels import ChannelGroup, Series, read_groups
from tests.data import recordings
from tests.data.recordings import PACKAGES, Array, loop, workbook
from tests.refusals import refused

TIMES, CURRENT, FORCE = loop()


def needs(suffix: str) -> None:
    if suffix in PACKAGES:
        pytest.importorskip(PACKAGES[suffix])


def opened(path: Path) -> ChannelTable:
    table = open_table(path, min_columns=1)
    assert isinstance(table, ChannelTable)
    return table


def read_back(path: Path) -> dict[str, tuple[str, Array]]:
    """Return unit and samples of every channel and clock by its full name."""
    found = {}
    for part in read_groups(opened(path).file):
        before = f"{part.group}/" if part.group else ""
        for one in [*([part.clock] if part.clock else []), *part.series]:
            found[before + one.name] = (one.unit, one.values)
    return found


@pytest.mark.first(2)
@pytest.mark.parametrize(
    ("make", "columns"),
    [
        (recordings.with_time, {}),
        (recordings.time_series, {}),
        (recordings.matlab_73, {}),
        (recordings.control_desk, {"Coil/Current": "I_A", "Load cell": "F_N", "Gap": "gap_mm"}),
    ],
)
def test_a_recording_of_matlab_and_its_kin_is_the_loop_that_was_recorded(
    make: Callable[[Path], Path], columns: dict[str, str], tmp_path: Path
) -> None:
    if make is recordings.matlab_73:
        needs(".h5")
    found = read_loops(make(tmp_path / "run.mat"), columns=columns, history="settled")
    (measured,) = found.loops
    assert (found.input.name, found.output.name) == ("current", "force")
    rows = measured.input.size
    assert np.array_equal(measured.input, CURRENT[:rows])
    assert np.array_equal(measured.output, FORCE[:rows])
    assert measured.time is not None
    assert np.array_equal(measured.time, TIMES[:rows])
    if columns:  # the slow raster ends 9 samples before the fast one
        assert rows == 1991
        assert measured.schedule_value == pytest.approx(0.4e-3, rel=1e-12)
        assert any("Gap: interpolated linearly onto the times of" in note for note in found.notes)
    else:
        assert rows == 2000


def test_an_object_of_matlab_is_named_with_the_way_to_export_it(tmp_path: Path) -> None:
    path = recordings.object_in_v5(tmp_path / "run.mat")
    with refused("matlab-objects: 'logs'"):
        open_table(path)


def test_incompatible_clocks_are_refused_with_their_reason(tmp_path: Path) -> None:
    mapping = {"Coil/Current": "I_A", "Load cell": "F_N", "Gap": "gap_mm"}
    separate = recordings.control_desk(tmp_path / "apart.mat", begin=5.0)
    with refused("no-common-time Model Root/Gap/Gap: 1.999 s"):
        read_loops(separate, columns=mapping)
    table = opened(recordings.control_desk(tmp_path / "run.mat"))
    assert table.header == ("t", "Coil/Current", "Load cell", "Gap")
    assert table.find("Model Root/Load cell/Load cell") == 2
    without_gap = read_loops(separate, columns={**mapping, "Gap": ""}, history="settled")
    assert without_gap.loops[0].input.size == 2000


def write(path: Path, *parts: ChannelGroup) -> Path:
    WRITERS[path.suffix](path, parts)
    return path


def test_a_pause_is_not_interpolated_across(tmp_path: Path) -> None:
    slow_channel = np.concatenate((np.arange(0.0, 0.5, 0.01), np.arange(1.5, 2.0, 0.01)))
    path = write(
        tmp_path / "run.mat",
        ChannelGroup("a", Series("t", "s", TIMES), (Series("I", "A", CURRENT),)),
        ChannelGroup("b", Series("t", "s", slow_channel), (Series("F", "N", np.cos(slow_channel)),)),
    )
    with refused("gap-in-channel b/F: 0.49; 1.5 s; 101"):
        read_loops(path)


def test_linear_interpolation_of_straight_signals_is_exact(tmp_path: Path) -> None:
    fine_times, coarse = np.arange(0.0, 1.0, 0.001), np.arange(-0.05, 1.05, 0.01)
    path = write(
        tmp_path / "run.mat",
        ChannelGroup("a", Series("t", "ms", 1e3 * fine_times), (Series("I", "A", fine_times**2),)),
        ChannelGroup("b", Series("t", "s", coarse), (Series("F", "N", 3.0 * coarse - 1.0),)),
    )
    (measured,) = read_loops(path, history="settled").loops
    assert measured.input.size == 1000
    assert measured.output == pytest.approx(3.0 * fine_times - 1.0, abs=1e-12)


def test_a_unit_that_contradicts_the_name_is_refused_naming_both(tmp_path: Path) -> None:
    path = write(
        tmp_path / "run.mat",
        ChannelGroup("", Series("t", "s", TIMES), (Series("I_mA", "A", CURRENT), Series("F_N", "N", FORCE))),
    )
    with refused("bad-header I_mA"):
        read_loops(path)
    (measured,) = read_loops(path, columns={"I_mA": "I_A"}, history="settled").loops
    assert np.array_equal(measured.input, CURRENT)


EVERY = [suffix for suffix in WRITERS if suffix != ".hdf5"]


@pytest.mark.first(1)
@pytest.mark.parametrize("suffix", EVERY)
def test_written_files_are_read_back_bit_for_bit(suffix: str, tmp_path: Path) -> None:
    needs(suffix)
    special = FORCE.copy()
    special[:4] = -0.0, 5e-324, 1.7e308, 1.0 / 3.0
    texts = np.array([f"phase {n // 500}, ä" for n in range(TIMES.size)])
    section = ChannelGroup(
        "" if suffix == ".csv" else "bench",
        Series("t", "s", TIMES),
        (
            Series("I", "A", CURRENT),
            Series("spindle torque", "Nm", special),
            Series("H", "A/m", CURRENT.astype(np.float32)),
            Series("count", "", np.arange(TIMES.size, dtype=np.int32) - 7),
            Series("phase", "", texts),
        ),
    )
    path = write(tmp_path / f"run{suffix}", section)
    if suffix == ".csv":
        path = write(tmp_path / "run.mat", *_converted(path, tmp_path / "again.mat"))
    found = read_back(path)
    before = f"{section.group}/" if section.group else ""
    assert section.clock is not None
    for one in (section.clock, *section.series):
        unit, values = found[before + one.name]
        assert unit == one.unit
        assert np.array_equal(values, one.values)
        if values.dtype.kind == "f":
            assert np.array_equal(np.signbit(values), np.signbit(one.values))
        if suffix != ".csv":
            assert values.dtype == one.values.dtype or values.dtype.kind == "U"


def _converted(source: Path, out: Path) -> list[ChannelGroup]:
    convert(source, out)
    return read_groups(opened(out).file)


@pytest.mark.slow
def test_groups_and_clocks_survive_every_format_that_has_them(tmp_path: Path) -> None:
    slow_channel = np.arange(0.0, 2.0, 0.1)
    parts = (
        ChannelGroup("bench", Series("t", "s", TIMES), (Series("I", "A", CURRENT),)),
        ChannelGroup("oven", Series("t", "s", slow_channel), (Series("T", "degC", 20.0 + slow_channel),)),
    )
    path = write(tmp_path / "run.mat", *parts)
    expected = read_back(path)
    for suffix in (".mf4", ".tdms", ".h5", ".mat"):
        needs(suffix)
        onward = tmp_path / f"next{suffix}"
        convert(path, onward)
        path = onward
        found = read_back(path)
        assert found.keys() == expected.keys()
        for name, (unit, values) in expected.items():
            assert found[name][0] == unit
            assert np.array_equal(found[name][1], values)
    done = convert(path, tmp_path / "run.csv")
    assert any("CSV cannot store groups: bench, oven" in note for note in done.notes)
    assert any("oven/T: interpolated linearly onto the times of bench/I" in note for note in done.notes)
    assert (tmp_path / "run.csv").read_text().startswith("t_s,I_A,T_degC\n0,0,20\n")


def test_mdf_opens_in_asammdf_with_units_and_groups(tmp_path: Path) -> None:
    asammdf = pytest.importorskip("asammdf")
    source = recordings.control_desk(tmp_path / "run.mat")
    convert(source, tmp_path / "run.mf4")
    with asammdf.MDF(tmp_path / "run.mf4") as file:
        groups = [group.channel_group.acq_name for group in file.groups]
        current, gap = file.get("Coil/Current"), file.get("Gap")
    assert groups == ["Model Root/Coil/Current", "Model Root/Load cell", "Model Root/Gap"]
    assert (current.unit, gap.unit) == ("A", "mm")
    assert np.array_equal(current.timestamps, TIMES)
    assert np.array_equal(current.samples, CURRENT)


def test_labview_waveforms_have_the_clock_of_their_properties(tmp_path: Path) -> None:
    nptdms = pytest.importorskip("nptdms")
    about = {"wf_increment": 0.001, "wf_start_offset": 0.25}
    objects = [
        nptdms.ChannelObject("daq", name, values, {"unit_string": unit, **about})
        for name, unit, values in (("I", "A", CURRENT), ("F", "N", FORCE))
    ]
    with nptdms.TdmsWriter(tmp_path / "run.tdms") as writer:
        writer.write_segment(objects)
    (measured,) = read_loops(tmp_path / "run.tdms", history="settled").loops
    assert np.array_equal(measured.input, CURRENT)
    assert measured.time == pytest.approx(0.25 + TIMES, abs=1e-12)


@pytest.mark.parametrize("units", [True, False])
def test_a_workbook_with_title_merged_header_and_units_is_a_table(units: bool, tmp_path: Path) -> None:
    needs(".xlsx")
    rows = list(zip(TIMES.tolist(), CURRENT.tolist(), FORCE.tolist(), strict=True))
    head: list[list[object]] = [["Loop of magnet 3", None, None], [None, None, None]]
    names: list[object] = ["t", "I", "F"] if units else ["t_s", "I_A", "F_N"]
    head += [names, ["s", "[A]", "N"]] if units else [[names[0], None, None], [None, *names[1:]]]
    path = workbook(tmp_path / "run.xlsx", [["notes"]], [*head, *rows])
    (measured,) = read_loops(path, history="settled").loops
    assert np.array_equal(measured.input, CURRENT)
    assert np.array_equal(measured.output, FORCE)
    assert measured.time is not None


def test_the_message_for_a_missing_package_names_the_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    needs(".h5")
    recordings.matlab_73(tmp_path / "run.mat")
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    for suffix in (".mat", ".mf4", ".tdms", ".h5", ".parquet", ".xlsx"):
        with refused("not-installed"):
            FORMATS[suffix](tmp_path / f"run{suffix}", 2)


@pytest.mark.parametrize(
    ("version", "name"),
    [("2.14", "run.mdf"), ("3.30", "run.dat"), ("4.11", "run.mdf"), ("4.11", "run.csv"), ("4.11", "run")],
)
def test_an_mdf_file_is_read_whatever_its_version_and_name(version: str, name: str, tmp_path: Path) -> None:
    asammdf = pytest.importorskip("asammdf")
    signals = [
        asammdf.Signal(values, TIMES, unit, channel)
        for channel, unit, values in (("I", "A", CURRENT), ("F", "N", FORCE))
    ]
    with asammdf.MDF(version=version) as file:
        file.append(signals)
        saved = file.save(tmp_path / "saved.mdf", overwrite=True)
    path = Path(saved).rename(tmp_path / name)
    (measured,) = read_loops(path, history="settled").loops
    assert np.array_equal(measured.input, CURRENT)
    assert np.array_equal(measured.output, FORCE)
    assert measured.time == pytest.approx(TIMES, abs=1e-12)


@pytest.mark.parametrize(
    ("suffix", "name"),
    [(".csv", "run.mf4"), (".mat", "run.dat"), (".mf4", "run.mat"), (".tdms", "run.txt"),
     (".h5", "run.mat"), (".parquet", "run"), (".xlsx", "run.csv")],
)  # fmt: skip
def test_the_content_of_a_file_decides_and_not_its_name(suffix: str, name: str, tmp_path: Path) -> None:
    needs(suffix)
    if suffix == ".xlsx":
        rows = map(list, zip(TIMES.tolist(), CURRENT.tolist(), FORCE.tolist(), strict=True))
        source = workbook(tmp_path / "source.xlsx", [["t_s", "I_A", "F_N"], *rows])
    else:
        series = (Series("I", "A", CURRENT), Series("F", "N", FORCE))
        source = write(tmp_path / f"source{suffix}", ChannelGroup("", Series("t", "s", TIMES), series))
    (measured,) = read_loops(source.rename(tmp_path / name), history="settled").loops
    assert np.array_equal(measured.input, CURRENT)
    assert np.array_equal(measured.output, FORCE)


def test_invalid_samples_of_mdf_are_counted_and_not_called_damage(tmp_path: Path) -> None:
    asammdf = pytest.importorskip("asammdf")
    invalid = np.zeros(TIMES.size, bool)
    invalid[40:47] = True
    signals = [
        asammdf.Signal(CURRENT, TIMES, "A", "I", invalidation_bits=invalid),
        asammdf.Signal(FORCE, TIMES, "N", "F"),
    ]
    with asammdf.MDF(version="4.11") as file:
        file.append(signals)
        path = Path(file.save(tmp_path / "run.mf4"))
    with refused(f"not-finite I: sample 41; 7 of {TIMES.size} samples; --drop invalid"):
        read_loops(path)


def test_labview_waveforms_that_start_apart_are_on_one_clock(tmp_path: Path) -> None:
    nptdms = pytest.importorskip("nptdms")
    start, late_channel = np.datetime64("2026-11-28T10:00:00.000000"), 40
    properties = {"wf_increment": TIMES[1] - TIMES[0], "wf_start_offset": 0.0}
    delay = np.timedelta64(round(1e6 * late_channel * properties["wf_increment"]), "us")
    objects = [
        nptdms.ChannelObject("daq", name, values, {"unit_string": unit, **properties, "wf_start_time": begin})
        for name, unit, values, begin in (
            ("I", "A", CURRENT, start), ("F", "N", FORCE[late_channel:], start + delay))
    ]  # fmt: skip
    with nptdms.TdmsWriter(tmp_path / "run.tdms") as writer:
        writer.write_segment(objects)
    (measured,) = read_loops(tmp_path / "run.tdms", history="settled").loops
    assert np.allclose(measured.input, CURRENT[-measured.n :], atol=1e-6)
    assert np.allclose(measured.output, FORCE[-measured.n :], atol=1e-6)
    assert measured.n >= TIMES.size - late_channel - 1
