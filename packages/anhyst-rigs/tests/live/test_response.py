"""Test the measurement of a frequency response on the benches, in a session and on the page."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from anhyst.support.states import Command, State
from anhyst_rigs.dashboard.orders import perform
from anhyst_rigs.dashboard.session import LiveSession
from anhyst_rigs.rig.bench.bearing import BearingBench
from anhyst_rigs.rig.bench.force import ForceBench
from anhyst_rigs.rig.bench.stage import StageBench
from anhyst_rigs.study.response.measurement import measure_response
from anhyst_rigs.study.response.result import read_response
from anhyst_rigs.study.response.virtual import hold_body
from tests.live.conftest import Serve, Show, wait_for
from tests.live.test_page import lift, until
from tests.refusals import refused
from tests.rig.test_stage_bench import setups

Order = Callable[..., Any]


@pytest.fixture
def session(bench: BearingBench) -> Iterator[LiveSession]:
    """A session with a lifted bearing."""
    hold_body(bench)
    opened = LiveSession(bench)
    opened.start()
    wait_for(lambda: opened.status()["state"] == State.RUN)
    yield opened
    opened.close()


def send(session: LiveSession, what: str, **fields: object) -> Any:
    return session.run_between_chunks(lambda: perform(session, "browser", {"do": what, **fields}))


def wait_until_excited(session: LiveSession) -> None:
    wait_for(lambda: session.status()["response"]["share"] > 0.05)


def test_cancel_ends_a_measurement_and_the_body_remains_lifted(session: LiveSession) -> None:
    send(session, "response", motion=2e-6)
    wait_until_excited(session)
    with refused("busy"):
        send(session, "target", value=0.44e-3)
    assert {"target", "generator", "apply", "land", "response"} <= session.status()["refused"].keys()
    send(session, "response", cancel=True)
    wait_for(lambda: not session.status()["response"]["running"])
    assert session.status()["response"]["trouble"] == "cancelled"
    assert session.status()["state"] == State.RUN
    send(session, "target", value=0.44e-3)


def test_stop_ends_a_measurement_and_the_next_one_needs_a_lifted_body(session: LiveSession) -> None:
    send(session, "response", motion=2e-6)
    wait_until_excited(session)
    session.stop("browser")
    wait_for(lambda: not session.status()["response"]["running"])
    wait_for(lambda: session.status()["state"] == State.FAULT)
    with refused("not-held response"):
        send(session, "response", motion=2e-6)


def test_a_session_closes_during_a_measurement(session: LiveSession) -> None:
    send(session, "response", motion=2e-6)
    wait_until_excited(session)
    session.close()
    assert not session.meter.is_driving


def test_a_body_that_rests_is_refused(bench: BearingBench) -> None:
    bench.advance(20_000)  # the self-test ends
    with refused("not-held response: idle"):
        measure_response(bench)


def test_an_armature_that_touches_a_stop_is_refused(bench: BearingBench) -> None:
    hold_body(bench)
    bench.demand(0.3515e-3)
    bench.advance(20_000)
    with refused("not-linear response: end stop"):
        measure_response(bench)


def test_a_current_that_reaches_its_limit_is_refused(bench: BearingBench) -> None:
    hold_body(bench)
    port = bench.injection_port
    assert port is not None
    bench.injection_port = replace(port, max_motion=50e-6, max_changes={"command": 9.0}, limits=())
    with refused("not-linear response: the controller reports"):
        measure_response(bench)


def test_a_bench_without_a_position_loop_refuses(force_bench: ForceBench) -> None:
    with refused("not-for-this-kind response"):
        measure_response(force_bench)
    force_bench.close()


@pytest.mark.slow
def test_the_plant_of_a_stage_is_its_mass() -> None:
    """Below the amplifier's bandwidth, the demanded force moves a mass after the delay of the loop."""
    bench = StageBench(setups())
    hold_body(bench)
    response = measure_response(bench)
    plant, frequency = response.responses["plant"], response.frequency
    mass_line = 1.0 / (bench.rig.settings.body.mass_kg * (2.0 * np.pi * frequency) ** 2)
    is_mass = (frequency > 150.0) & (frequency < 1000.0)
    ratio = 20.0 * np.log10(np.abs(plant.values) / mass_line)[is_mass]
    assert np.max(np.abs(ratio)) < 1.0
    assert plant.coherence[is_mass].min() > 0.999
    assert response.zone == "A"
    assert response.margins.crossover == pytest.approx(bench.rig.settings.tracking.crossover_Hz, rel=0.1)


def test_stop_ends_the_signal_of_a_stage() -> None:
    bench = StageBench(setups())
    bench.inject(np.full(2000, 1e-6))
    error = 1 + [signal.name for signal in bench.signals].index("pose_read_x")
    assert np.abs(np.diff(bench.advance(100)[:, error])).max() > 0.0
    bench.command(Command.STOP)
    assert np.all(bench._injected.take(100) == 0.0)


@pytest.mark.slow
@pytest.mark.needs("chromium")
def test_the_page_measures_and_saves_a_response(serve: Serve, show: Show, tmp_path: Path) -> None:
    served = serve()
    page = show(served)
    lift(page, served)
    page.get_by_role("tab", name="Bode").click()
    page.locator("#measure-response").click()
    wait_for(lambda: served.session.meter.is_driving)
    wait_for(lambda: not served.session.meter.is_driving)
    assert served.session.meter.status()["trouble"] == ""
    page.locator("#bode figure").first.wait_for()
    assert "Zone A" in page.locator("#bode dl").inner_text()
    with page.expect_download() as saved:
        page.get_by_role("button", name="Save CSV").click()
    saved.value.save_as(tmp_path / "response.csv")
    found, measured = read_response(tmp_path / "response.csv"), served.session.meter.result
    assert measured is not None
    assert found.facts() == measured.facts()
    until(page, "document.querySelector('#bode canvas').ariaLabel === 'Magnitude / dB over Frequency / Hz'")
    page.locator("#bode select").select_option("plant")
    until(page, "document.querySelector('#bode canvas').ariaLabel.startsWith('Magnitude / dB re 1 m/')")
    page.locator("#bode figure").first.focus()
    page.keyboard.press("ArrowRight")
    until(page, "/± [0-9.]+ dB re 1 m./.test(document.querySelector('#bode .bode output').textContent)")
    page.set_viewport_size({"width": 390, "height": 844})
    box = page.locator("#bode figure").first.bounding_box()
    assert box is not None
    assert box["width"] <= 390.0
    assert box["height"] > 150.0
