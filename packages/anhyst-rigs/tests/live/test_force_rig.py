"""Test a force rig on the page: its target is a force in newtons."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from anhyst.support.numeric import FloatArray
from anhyst.support.states import Command, State
from anhyst_rigs.dashboard.generator import PeriodicWave
from anhyst_rigs.dashboard.session import LiveSession
from anhyst_rigs.rig.bench.force import ForceBench
from tests.live.conftest import Serve, Show, wait_for
from tests.live.test_page import last, press, ready, state_is, until
from tests.refusals import refused


@pytest.fixture
def session(force_bench: ForceBench) -> Iterator[LiveSession]:
    opened = LiveSession(force_bench)
    opened.start()
    yield opened
    opened.close()


def up(session: LiveSession) -> None:
    wait_for(lambda: session.status()["state"] == State.IDLE)
    session.run_between_chunks(lambda: session.bench.command(Command.DEMAGNETISED))
    session.run_between_chunks(lambda: session.bench.command(Command.RUN))


def test_a_run_begins_at_zero_and_a_generator_stays_within_the_range(session: LiveSession) -> None:
    with refused("wrong-state demand"):
        session.run_between_chunks(lambda: session.bench.demand(10.0))
    up(session)
    session.run_between_chunks(lambda: session.bench.demand(10.0))
    assert session.status()["target"] == 10.0
    begin = session.bench.tick + 1
    with refused("out-of-range generator: 21 N; 40 N"):
        session.run_between_chunks(lambda: session.generate(PeriodicWave("sine", 11.0, 2.0, begin)))
    session.run_between_chunks(lambda: session.generate(PeriodicWave("sine", 5.0, 2.0, begin)))
    with refused("out-of-range"):
        session.run_between_chunks(lambda: session.bench.demand(2.0))
    session.run_between_chunks(lambda: session.stop("somebody"))
    assert session.status()["generator"] is None
    wait_for(lambda: session.status()["state"] == State.READY)
    tick = session.bench.tick
    wait_for(lambda: session.bench.tick > tick + 0.5 * session.bench.rate)  # current has decayed
    session.run_between_chunks(lambda: session.bench.command(Command.RUN))
    assert session.status()["target"] == 0.0
    assert not session.end_reason


def test_a_generator_ends_at_the_limits_of_the_bench(force_bench: ForceBench, session: LiveSession) -> None:
    up(session)
    session.run_between_chunks(lambda: session.bench.demand(10.0))
    begin = session.bench.tick + 1
    session.run_between_chunks(lambda: session.generate(PeriodicWave("sine", 5.0, 2.0, begin)))
    seen: list[FloatArray] = []
    session.subscribe(seen.append)
    session.run_between_chunks(lambda: force_bench.command(Command.IDLE))  # without the page
    wait_for(lambda: len(seen) > 20)
    assert session.status()["generator"] is None
    assert "generator off: demand: a force is demanded in the state run" in session.log[-1].text
    assert np.all(np.diff(np.concatenate(seen)[:, 0]) == 1.0)


@pytest.mark.slow
@pytest.mark.needs("chromium")
def test_a_force_is_demanded_and_its_step_is_drawn(serve: Serve, show: Show, force_bench: ForceBench) -> None:
    page = show(serve(bench=force_bench))
    ready(page)
    state_is(page, "idle")
    press(page, "demagnetised")
    press(page, "run")
    state_is(page, "run")
    page.locator("#target").fill("20")
    page.locator("#go").click()
    until(page, "document.querySelector('#panel').innerText.includes('now 20 N')")
    wait_for(lambda: abs(last(page, "force") - 20.0) < 1.0)
    assert page.locator("#load").count() == 0
    page.keyboard.press("Tab")
    page.get_by_role("tab", name="3 steps").click()
    page.wait_for_selector("#steps tbody tr")
    assert page.locator("#steps tbody tr td").nth(2).inner_text() == "+20 N"
    page.get_by_role("tab", name="2 loop").click()
    until(page, "document.getElementById('loop').innerText.includes('force − demand: rms')")
    page.keyboard.press("Escape")
    state_is(page, "ready")
