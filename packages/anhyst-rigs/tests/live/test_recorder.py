"""Test that a recording equals the measured bits, is immediately on disk, and can be read."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from websockets.sync.client import connect
from websockets.typing import Origin

from anhyst.cli.app import main
from anhyst.support.numeric import FloatArray
from anhyst.support.states import Command
from anhyst_rigs.dashboard.recording import start_recording
from anhyst_rigs.rig.bench.bearing import BearingBench
from tests.live.conftest import wait_for
from tests.refusals import refused
from tests.study import bearings


def numbers(path: Path) -> FloatArray:
    return np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2, encoding="utf-8")


def test_a_recording_reads_back_bit_for_bit(bench: BearingBench, tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    recorder = start_recording(path, bench.signals, bench.rate)
    rows = [bench.advance(500)]
    bench.command(Command.DEMAGNETISED)
    rows.append(bench.advance(500))
    recorder.write_rows(rows[0])
    recorder.write_note(500, "a\nnote")
    recorder.write_rows(rows[1])
    recorder.close()
    expected = np.concatenate(rows)
    got = numbers(path)
    assert np.array_equal(np.delete(got, 1, axis=1), expected)
    assert np.array_equal(got[:, 1], expected[:, 0] / bench.rate)
    assert "# after tick 500, a note\n" in path.read_text()


def test_a_recording_does_not_write_over_a_file(bench: BearingBench, tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text("precious")
    with refused("exists-already"):
        start_recording(path, bench.signals, bench.rate)
    assert path.read_text() == "precious"
    with refused("wrong-ending: .mf4"):
        start_recording(tmp_path / "run.txt", bench.signals, bench.rate)


@pytest.mark.slow
def test_a_killed_server_leaves_a_recording_that_inspect_reads(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "run.csv"
    rig = bearings.copy_known(tmp_path)
    command = [sys.executable, "-m", "anhyst.cli.app", "live", str(rig), "--listen", "0"]
    with subprocess.Popen(
        [*command, "--record", str(path)],
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {"XDG_CACHE_HOME": str(tmp_path / "cache")},
    ) as process:
        try:
            assert process.stdout is not None
            address = process.stdout.readline().split()[0].removesuffix("/")
            assert "the rig runs\n" in process.stdout  # reads until this line
            with connect(f"ws{address[4:]}/live", origin=Origin(address), max_size=None) as line:
                for name in ("demagnetised", "lift"):
                    wait_for(lambda: path.stat().st_size > 1e6)
                    line.send(json.dumps({"do": "command", "name": name, "id": 1}))
                wait_for(lambda: path.stat().st_size > 2.5e6)
        finally:
            process.send_signal(signal.SIGKILL)
    assert path.read_bytes().endswith(b"\n")
    ticks = numbers(path)[:, 0]
    assert np.array_equal(ticks, np.arange(1, len(ticks) + 1))
    assert "browser 1: lift" in path.read_text()
    assert main(["inspect", str(path)]) == 0
    assert "run.csv" in capsys.readouterr().out
