"""Progress of long commands: a bar with per cent on a terminal, otherwise lines at intervals."""

from __future__ import annotations

import json
import os
import re
import sys
import threading
from pathlib import Path

import pytest

from anhyst.cli.shared import ProgressEstimate
from tests.foreign.magnets import MAGNETS

from .command import quick, shares_said, speaking

SHORT = ("--law", "play-cells", "--gap-map", "reluctance", "--out", "m.toml")
"""A search of a few seconds."""


@pytest.fixture
def here(tmp_path: Path) -> Path:
    MAGNETS["u"].write_loops(tmp_path / "loops.csv")
    return tmp_path


@pytest.mark.slow
def test_off_a_terminal_lines_come_on_standard_error_and_json_stays_clean(here: Path) -> None:
    result = speaking(0.1, "identify", "loops.csv", *SHORT, "--json", cwd=here)
    assert result.returncode == 0, result.stderr
    assert json.loads(result.stdout)["law"]
    message = [line for line in result.stderr.splitlines() if line.startswith("anhyst: searching: ")]
    assert message
    shares = shares_said("searching", result.stderr)
    assert len(shares) == len(message)
    assert shares == sorted(shares)
    assert any(re.search(r" s so far, about \d+ s left$", line) for line in message)


def test_a_short_command_prints_no_progress(here: Path) -> None:
    result = quick("inspect", "loops.csv", "--json", cwd=here)
    assert result.returncode == 0
    assert "so far" not in result.stderr


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="no pseudo-terminals")
def test_a_terminal_shows_a_bar_with_per_cent_and_remaining_time(here: Path) -> None:
    ours, theirs = os.openpty()
    seen: list[bytes] = []

    def read() -> None:
        try:
            while part := os.read(ours, 65536):
                seen.append(part)
        except OSError:  # Linux raises this at the end
            pass

    reader = threading.Thread(target=read)
    reader.start()
    result = speaking(0.1, "identify", "loops.csv", *SHORT, cwd=here, stderr=theirs)
    os.close(theirs)
    reader.join()
    os.close(ours)
    assert result.returncode == 0
    shown = b"".join(seen).decode()
    assert re.search(r"searching .*\d+ %, \d+ s so far, about \d+ s left", shown)
    assert "anhyst: searching" not in shown
    assert "so far" not in result.stdout


class Clock:
    """A clock that tests set."""

    def __init__(self) -> None:
        self.now = 0.0

    def __call__(self) -> float:
        return self.now


def test_remaining_time_follows_the_completed_fraction() -> None:
    clock = Clock()
    pace = ProgressEstimate(clock)
    clock.now = 10.0
    assert pace.remaining_s() is None
    pace.update(1, 4)
    assert pace.remaining_s() == pytest.approx(30.0)
    pace.update(4, 4)
    assert pace.remaining_s() is None


def test_the_completed_fraction_never_falls_and_ends_at_one() -> None:
    pace = ProgressEstimate(Clock())
    shares = []
    for done, total in ((0, 0), (1, 4), (1, 8), (8, 8), (9, 8)):
        pace.update(done, total)
        shares.append(pace.share)
    assert shares == [0.0, 0.25, 0.25, 1.0, 1.0]


@pytest.mark.parametrize(("seconds", "words"), [(40.0, "40 s"), (300.0, "5 min"), (8000.0, "2 h 13 min")])
def test_times_are_written_in_words(seconds: float, words: str) -> None:
    clock = Clock()
    pace = ProgressEstimate(clock)
    clock.now = seconds
    assert str(pace) == f"0 %, {words} so far"
