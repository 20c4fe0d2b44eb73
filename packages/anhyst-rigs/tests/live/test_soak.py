"""Run a page and a bench for a long time: no data is lost, and memory does not grow."""

from __future__ import annotations

import os
import statistics
import time
from pathlib import Path

import pytest

from anhyst.support.states import State
from anhyst_rigs.rig.bench.force import ForceBench
from tests.live.conftest import Serve, Show
from tests.live.test_page import last, press, ready, state_is
from tests.live.test_recorder import numbers

EVERY_S = 0.2
GROWN = 0.05
"""Allowed growth of the used memory after all buffers are full, as a fraction."""


def resident() -> float:
    """Return the memory in use by this process, MB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


@pytest.mark.slow
@pytest.mark.needs("chromium")
@pytest.mark.parametrize("seconds", [10.0, pytest.param(60.0, marks=pytest.mark.campaign)])
def test_a_bench_with_a_page_runs_for_long(
    serve: Serve, show: Show, force_bench: ForceBench, tmp_path: Path, seconds: float
) -> None:
    path = tmp_path / "run.csv"
    served = serve(bench=force_bench, record=path)
    page = show(served)
    ready(page)
    press(page, "demagnetised")
    press(page, "run")
    state_is(page, "run")
    session, rate = served.session, force_bench.rate
    began, first, sizes = time.monotonic(), session.bench.tick, []
    while time.monotonic() < began + seconds:
        time.sleep(EVERY_S)
        sizes.append(resident())
    passed = time.monotonic() - began
    factor = (session.bench.tick - first) / rate / passed
    print(f"{factor:.4f} times the clock for {passed:.1f} s, {sizes[-1]:.0f} MB")
    assert session.status()["state"] == State.RUN
    assert last(page, "state") == State.RUN
    assert session.status()["missing"] == 0
    assert not session.end_reason
    served.end()
    ticks = numbers(path)[:, 0]
    assert (ticks[1:] - ticks[:-1] == 1.0).all()
    quarter = len(sizes) // 4
    start, end = (statistics.median(sizes[quarter : 2 * quarter]), statistics.median(sizes[-quarter:]))
    assert end < (1.0 + GROWN) * start
