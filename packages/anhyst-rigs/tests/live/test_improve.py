"""Test the improvement of a model while its bench runs, without a page."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest

from anhyst.compensate.methods import HysteresisInverse
from anhyst.model.parameters import Parameter
from anhyst.support.block_words import set_generation
from anhyst.support.states import Command, State
from anhyst_rigs.dashboard.improver import Improver, ProcessJob
from anhyst_rigs.dashboard.orders import perform
from anhyst_rigs.dashboard.session import LiveSession
from anhyst_rigs.study.prepared_benches import PreparedBearing, PreparedForce, fixed_point_block
from tests.live.conftest import wait_for
from tests.live.jobs import dies, forever
from tests.refusals import refused
from tests.study import bearings


@pytest.fixture
def session(prepared: PreparedForce) -> Iterator[LiveSession]:
    bench = prepared.open()
    opened = LiveSession(bench, improver=Improver(prepared, bench))
    yield opened
    opened.close()


def order(session: LiveSession, step: str, **fields: Any) -> Mapping[str, Any]:
    message = {"do": "improve", "step": step, **fields}
    return session.run_between_chunks(lambda: perform(session, "browser 1", message))


def done(session: LiveSession, step: str) -> Mapping[str, Any]:
    """Start a step, wait for its end, and return its result."""
    assert session.improver is not None
    order(session, step)
    wait_for(lambda: not session.status()["improve"]["step"])
    assert session.status()["improve"]["trouble"] == ""
    return session.improver.results[step]


def force_error(session: LiveSession) -> float:
    """Condition the iron, then return the rms force error, N."""

    def swing() -> float:
        bench = session.bench
        names = [signal.name for signal in bench.signals]
        bench.command(Command.IDLE)
        reach(session, State.IDLE)
        bench.command(Command.CONDITION)
        reach(session, State.READY)
        bench.command(Command.RUN)
        parts = []
        for force in (32.0, 6.0, 25.0, 12.0, 32.0, 2.0):
            bench.demand(force)
            parts.append(bench.advance(300)[150:])
        rows = np.concatenate(parts)
        assert (rows[:, 1 + names.index("state")] == State.RUN).all()
        error = rows[:, 1 + names.index("force")] - rows[:, 1 + names.index("demand")]
        return float(np.sqrt(np.mean(np.square(error))))

    return session.run_between_chunks(swing)


def reach(session: LiveSession, state: State) -> None:
    names = [signal.name for signal in session.bench.signals]
    for _ in range(200):
        if session.bench.advance(50)[-1, 1 + names.index("state")] == state:
            return
    raise AssertionError(f"never {state.name}")


@pytest.mark.slow
def test_an_unknown_iron_is_measured_identified_and_swapped_in_while_the_bench_runs(
    session: LiveSession,
) -> None:
    session.run_between_chunks(lambda: reach(session, State.IDLE))
    before = force_error(session)
    assert session.improver is not None
    known = session.improver.known_model.curves
    with refused("step-missing"):
        order(session, "identify")
    with refused("step-missing"):
        order(session, "swap")
    measured = done(session, "measure")
    assert measured["warmth"] < 1.0
    assert max(measured["played"]["current"]) <= measured["limits"]["current_A"]["value"]
    found = done(session, "identify")
    assert found["new"]["rms_N"] < 0.4 * found["old"]["rms_N"]
    assert found["new"]["worst_N"] < found["old"]["worst_N"]
    compiled = done(session, "compile")
    assert compiled["worst_N"] < 0.01 * compiled["largest_N"]
    answer = order(session, "swap")
    assert answer["applied"] == session.bench.tick + 1
    after = force_error(session)
    assert after < 0.4 * before
    assert [curve.kind for curve in session.curves[:2]] == ["measured", "model"]
    for one, other in zip(session.curves[0::2], session.curves[1::2], strict=True):
        assert np.abs(np.subtract(one.force, other.force)).max() < 0.05 * max(one.force)
    assert session.curves[0].force != known[0].force
    assert set(order(session, "files")["files"]) == {"loops.csv", "loops.toml", "model.toml"}
    order(session, "back")
    assert session.curves == known
    assert force_error(session) == pytest.approx(before, rel=0.1)
    assert "the new model is swapped in" in [entry.text for entry in session.log]


@pytest.mark.slow
def test_a_drive_keeps_to_limits_that_are_drawn_tighter(session: LiveSession) -> None:
    assert session.improver is not None
    limits = session.improver.limits()
    for wrong, reason in (
        ({"heat": 1.0}, "unknown-limit limits: 'heat'"),
        ({"current_A": 9.0}, "out-of-range: 1.2"),
    ):
        with refused(reason):
            order(session, "measure", limits=wrong)
    order(session, "measure", limits={"current_A": 1.0, "force_N": 36.0})
    wait_for(lambda: "measure" in session.improver.results)  # type: ignore[union-attr]
    measured = session.improver.results["measure"]
    assert limits["current_A"]["value"] > 1.0
    assert max(measured["played"]["current"]) <= 1.0
    assert all(place["force_N"] <= 36.0 for place in measured["gaps"])


@pytest.mark.slow
def test_a_job_reports_progress_and_ends_when_cancelled() -> None:
    ended: list[object] = []
    job = ProcessJob(forever, on_end=ended.append)
    wait_for(lambda: job.completed_fraction == 0.25)
    job.cancel()
    assert job._process.exitcode != 0  # it was terminated early
    assert ended == []


@pytest.mark.slow
def test_a_crashed_job_is_reported() -> None:
    ended: list[object] = []
    ProcessJob(dies, on_end=ended.append)
    wait_for(lambda: ended)
    assert "ended without a result" in str(ended[0])


def test_one_job_at_a_time(session: LiveSession) -> None:
    order(session, "measure")
    with refused("busy"):
        order(session, "measure")
    order(session, "cancel")
    assert session.status()["improve"]["trouble"] == "measure: cancelled"


def test_a_levitating_bearing_uses_the_newly_compiled_block(firmware: Path) -> None:
    flying = bearings.single()
    prepared = PreparedBearing(flying, bearings.knowledge().model, firmware)
    running = flying.compensator.parameters
    assert isinstance(running, HysteresisInverse)
    same = fixed_point_block(prepared.compile(prepared.model))
    assert same.scales == running.scales
    assert same.words.tolist() == running.block.words.tolist()
    seen = prepared.model.valid
    assert seen is not None
    little = replace(prepared.model, valid=replace(seen, input=(0.0, 3.0)))
    with refused("currents-not-covered: 4.5"):
        prepared.compile(little)


def test_a_model_is_swapped_in_while_a_bearing_hovers(firmware: Path) -> None:
    prepared = PreparedBearing(bearings.single(), bearings.knowledge().model, firmware)
    bench = prepared.open()
    at = [signal.name for signal in bench.signals].index
    bench.advance(200)
    bench.command(Command.DEMAGNETISED)
    bench.command(Command.LIFT)
    bench.advance(10_000)
    other = replace(prepared.model, parameters=scaled(prepared.model.parameters, "c_H", 0.9))
    first = bench.swap_block(set_generation(fixed_point_block(prepared.compile(other)).words.tolist(), 9))
    rows = bench.advance(4000)
    bench.close()
    assert first == rows[0, 0]
    assert (rows[:, 1 + at("state")] == State.RUN).all()
    assert 0.0 < abs(rows[:, 1 + at("gap")] - bearings.GAP).max() < 10e-6


def scaled(parameters: Mapping[str, Parameter], name: str, factor: float) -> Mapping[str, Parameter]:
    value = parameters[name]
    assert isinstance(value, float)
    return MappingProxyType({**parameters, name: factor * value})
