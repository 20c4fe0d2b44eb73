"""Test recordings from the page: the last seconds, from a crossing, of a length, in its folder."""

from __future__ import annotations

import json
import math
import shutil
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from anhyst.cli.app import main
from anhyst.data.formats import open_table
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst.support.states import Command
from anhyst_rigs.dashboard.recording import (
    BUFFER_S,
    LevelCrossing,
    RecordingFile,
    RecordingSpan,
    RingBuffer,
    TickRecorder,
    start_recording,
)
from anhyst_rigs.rig.bench.bearing import BearingBench
from anhyst_rigs.rig.bench.protocol import Signal, Subscription
from tests.live.conftest import wait_for
from tests.live.test_recorder import numbers
from tests.refusals import refused, says

RATE = 1000.0
SIGNALS = (Signal("gap", "m", "true gap"), Signal("force", "N", "of the magnet, < 300"))


def rows(first: int, count: int) -> FloatArray:
    ticks = np.arange(first, first + count, dtype=float)
    return np.column_stack((ticks, 1e-4 / ticks, 10.0 * np.sin(ticks / 300.0)))


class Fed:
    """A recorder whose rows are written by the test."""

    def __init__(self, folder: Path) -> None:
        self.said: list[str] = []
        self.recorder = TickRecorder(SIGNALS, RATE, folder, self.said.append)
        self.tick = 0
        self._subscription = Subscription("recorder", 10**6, needs_every_tick=True)
        self._thread = threading.Thread(target=self.recorder.run, args=(self._subscription,))
        self._thread.start()

    def feed(self, count: int) -> None:
        for first in range(self.tick + 1, self.tick + count + 1, 10):
            self._subscription.put(rows(first, min(10, self.tick + count + 1 - first)))
        self.tick += count

    def close(self) -> None:
        self._subscription.close()
        self._thread.join()


@pytest.fixture
def fed(tmp_path: Path) -> Iterator[Fed]:
    one = Fed(tmp_path)
    yield one
    one.close()


def ended(fed: Fed) -> Callable[[], bool]:
    return lambda: fed.recorder.status() is None


def test_the_ring_holds_the_last_rows_however_they_come() -> None:
    ring = RingBuffer(100, 3)
    first = 1
    for count in (1, 7, 100, 3, 250, 99, 101):
        ring.append(rows(first, count))
        first += count
    assert ring.total == first - 1
    assert np.array_equal(ring.read(ring.total - 100, ring.total), rows(first - 100, 100))
    assert ring.find_tick(first - 40) == ring.total - 40
    assert ring.find_tick(0) == ring.total - 100


def test_the_last_seconds_are_kept_while_time_is_paused(fed: Fed) -> None:
    fed.feed(25_000)
    fed.recorder.start("last.csv", RecordingSpan(pretrigger_s=BUFFER_S, duration_s=0.0), fed.tick)
    wait_for(ended(fed))
    expected = rows(25_001 - int(BUFFER_S * RATE), int(BUFFER_S * RATE))
    assert np.array_equal(np.delete(numbers(fed.recorder.folder / "last.csv"), 1, axis=1), expected)


def test_a_recording_lasts_as_long_as_asked(fed: Fed) -> None:
    fed.feed(3000)
    fed.recorder.start("span.csv", RecordingSpan(pretrigger_s=0.5, duration_s=1.25), fed.tick)
    fed.feed(4000)
    wait_for(ended(fed))
    assert np.array_equal(numbers(fed.recorder.folder / "span.csv")[:, 0], np.arange(2501, 4251))


def test_one_without_end_is_stopped_at_the_tick_of_the_order(fed: Fed) -> None:
    fed.recorder.start("run.csv", RecordingSpan(), fed.tick)
    fed.feed(777)
    fed.recorder.stop(fed.tick)
    fed.feed(500)
    wait_for(ended(fed))
    assert np.array_equal(numbers(fed.recorder.folder / "run.csv")[:, 0], np.arange(1, 778))
    assert fed.said == ["run.csv written, 0.777 s"]


@pytest.mark.parametrize("rising", [True, False])
def test_a_level_crossing_starts_a_recording_with_earlier_samples(fed: Fed, rising: bool) -> None:
    level = -5.0
    crossing = fed.recorder.make_level_crossing("force", level, rising)
    fed.feed(2500)  # forces that crossed the level before count for nothing
    wait_for(lambda: fed.recorder._ring.total == 2500)
    fed.recorder.start("crossed.csv", RecordingSpan(0.2, 0.3, crossing), fed.tick)
    assert (fed.recorder.status() or {})["waits"]
    fed.feed(4000)
    wait_for(ended(fed))
    got = numbers(fed.recorder.folder / "crossed.csv")
    force = rows(2501, 4000)[:, 2]
    beyond = force >= level if rising else force <= level
    hit = 2501 + int(np.flatnonzero(beyond[1:] & ~beyond[:-1])[0]) + 1
    assert np.array_equal(got[:, 0], np.arange(hit - 200, hit + 300))
    before, at = got[199:201, 3]
    assert (before < level <= at) if rising else (before > level >= at)


def test_a_signal_already_beyond_the_level_does_not_trigger() -> None:
    assert LevelCrossing(1, 0.0, True).find(np.array([1.0, 2.0, 3.0])) is None
    assert LevelCrossing(1, 0.0, True).find(np.array([-1.0, 0.0, 3.0])) == 1


def test_a_recording_without_a_trigger_leaves_no_file(fed: Fed) -> None:
    fed.recorder.start(
        "never.mf4", RecordingSpan(0.0, 1.0, fed.recorder.make_level_crossing("force", 99.0, True)), 0
    )
    fed.feed(500)
    fed.recorder.stop(fed.tick)
    assert list(fed.recorder.folder.iterdir()) == []


@pytest.mark.parametrize(
    "name",
    ["../out.csv", "/tmp/out.csv", "a/b.csv", ".hidden.csv", "", "x.py", "a\0.csv", "-rf.csv",
     "..", "a\\b.csv", 101 * "a" + ".csv"],
)  # fmt: skip
def test_nothing_is_written_outside_the_folder(fed: Fed, name: str) -> None:
    before = sorted(fed.recorder.folder.parent.rglob("*"))
    with pytest.raises(InputError) as caught:
        fed.recorder.start(name, RecordingSpan(), 0)
    assert caught.value.code in {"bad-name", "wrong-ending"}
    assert sorted(fed.recorder.folder.parent.rglob("*")) == before


def test_a_link_to_another_place_is_not_written_through(fed: Fed, tmp_path: Path) -> None:
    (fed.recorder.folder / "link.csv").symlink_to(tmp_path.parent / "elsewhere.csv")
    with refused("exists-already"):
        fed.recorder.start("link.csv", RecordingSpan(), 0)
    assert not (tmp_path.parent / "elsewhere.csv").exists()


def test_one_recording_at_a_time(fed: Fed) -> None:
    fed.recorder.start("one.csv", RecordingSpan(), 0)
    with refused("busy record: one.csv"):
        fed.recorder.start("two.csv", RecordingSpan(), 0)
    with refused("out-of-range"):
        fed.recorder.start("two.csv", RecordingSpan(pretrigger_s=11.0), 0)


def test_a_full_disk_ends_the_recording_and_not_the_bench(fed: Fed) -> None:
    class Full(RecordingFile):
        def __init__(self) -> None:
            self.path, self.rows = Path("full.csv"), 0

        def write_rows(self, rows: FloatArray) -> None:
            raise OSError(28, "No space left on device")

        def write_note(self, tick: int, text: str) -> None:
            pass

        def close(self) -> None:
            pass

    fed.recorder.start_in_file(Full(), RecordingSpan(), 0)
    fed.feed(100)
    wait_for(lambda: fed.recorder.error_text)
    assert fed.recorder.error_text == "full.csv: No space left on device"
    fed.recorder.start("next.csv", RecordingSpan(), fed.tick)
    fed.feed(100)
    fed.recorder.stop(fed.tick)
    wait_for(ended(fed))
    assert len(numbers(fed.recorder.folder / "next.csv")) == 100


def test_mdf_is_whole_at_every_moment_and_bit_for_bit(tmp_path: Path) -> None:
    asammdf = pytest.importorskip("asammdf")
    path, copy = tmp_path / "run.mf4", tmp_path / "copy.mf4"
    recorder = start_recording(path, SIGNALS, RATE)
    recorder.write_note(0, "in force: load = 5.0 N")
    noted, count = ["in force: load = 5.0 N"], 0
    for step in range(6):
        recorder.write_rows(rows(count + 1, 100 + step))
        count += 100 + step
        if step % 2:
            recorder.write_note(count, f"browser 1:\nload {step} N")
            noted.append(f"browser 1: load {step} N")
        shutil.copyfile(path, copy)  # as after a kill of the process
        with asammdf.MDF(copy) as file:
            expected = rows(1, count)
            assert np.array_equal(file.get("tick").samples, expected[:, 0])
            assert np.array_equal(file.get("force").samples, expected[:, 2])
            assert np.array_equal(file.get("gap").timestamps, expected[:, 0] / RATE)
            assert file.get("gap").unit == "m"
            assert [event.name for event in file.events] == noted
    recorder.close()
    assert open_table(path).header == ("t", "tick", "gap", "force")


def test_a_missing_extra_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "run.mf4"
    start_recording(path, SIGNALS, RATE).close()
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    assert main(["inspect", str(path)]) == 2
    assert says(capsys.readouterr().err, "not-installed")


def test_no_mdf_and_an_empty_one_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("asammdf")
    path = tmp_path / "run.mf4"
    path.write_text("no such thing")
    assert main(["inspect", str(path)]) == 2
    path.unlink()
    start_recording(path, SIGNALS, RATE).close()
    assert main(["inspect", str(path)]) == 2
    assert says(capsys.readouterr().err, "too-few-channels")


def swing(bench: BearingBench) -> Iterator[FloatArray]:
    """Levitate, and yield rows of two cycles of the load at one gap."""
    bench.advance(200)
    bench.command(Command.DEMAGNETISED)
    bench.command(Command.LIFT)
    bench.load(60.0)
    bench.advance(10_000)
    for n in range(400):
        bench.load(150.0 - 90.0 * math.cos(2.0 * math.pi * n / 200))
        yield bench.advance(50)


@pytest.mark.slow
def test_a_recording_is_a_measurement_for_inspect_and_identify(
    bench: BearingBench, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("asammdf")
    files = [tmp_path / "run.csv", tmp_path / "run.mf4"]
    recorders = [start_recording(path, bench.signals, bench.rate) for path in files]
    for part in swing(bench):
        for recorder in recorders:
            recorder.write_rows(part)
    seen = []
    for path, recorder in zip(files, recorders, strict=True):
        recorder.close()
        assert main(["inspect", str(path), "--clean", "dedupe,steady,thin", "--json"]) == 0
        seen.append(json.loads(capsys.readouterr().out))
    found = seen[0]
    assert found["loops"] == seen[1]["loops"]
    assert (found["input"], found["output"], found["schedule"]) == ("I_A", "F_N", "gap_m")
    assert found["schedule_values"] == [pytest.approx(450e-6, abs=1e-6)]
    assert found["loops"][0]["output_high_N"] == pytest.approx(240.0, abs=5.0)
    model = tmp_path / "model.toml"
    words = ["identify", str(files[1]), "--clean", "dedupe,steady,thin", "--out", str(model)]
    assert main([*words, "--law", "effective-field"]) in {0, 1}
    assert "effective-field" in model.read_text()
