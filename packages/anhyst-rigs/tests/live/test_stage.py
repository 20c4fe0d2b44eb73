"""Test a stage on the page whose parameters are estimated from its cycles while it runs."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from anhyst.support.states import Command
from anhyst_rigs.dashboard.orders import perform
from anhyst_rigs.dashboard.recording import start_recording
from anhyst_rigs.dashboard.serving import open_prepared
from anhyst_rigs.dashboard.session import LiveSession
from anhyst_rigs.rig.stage.fitted import make_stage
from anhyst_rigs.rig.stage.loop import Feedforward
from anhyst_rigs.study.prepared_benches import PreparedStage
from anhyst_rigs.study.tracking.calibrate import calibrate
from anhyst_rigs.study.tracking.estimator import ParameterEstimator
from anhyst_rigs.study.tracking.motion import Motion
from anhyst_rigs.study.tracking.online_calibration import StageCalibrator
from tests.live.conftest import Serve, Show, wait_for
from tests.live.test_page import press, ready, state_is, until
from tests.refusals import refused
from tests.study import bearings, stages
from tests.study.test_balancing import short_stage

SUBSTEPS = 4
WRONG = 6.0
"""A random plant in which estimation can remove most of the compensator's error."""


def prepared(**control: object) -> PreparedStage:
    setups = tuple(stages.setup(name, SUBSTEPS, **control) for name in ("single-valued", "full"))
    return PreparedStage(bearings.knowledge(), setups, (Feedforward(), Feedforward()))


class Beside:
    """A bench and its online calibration in step, without a session."""

    def __init__(self, found: PreparedStage | None = None) -> None:
        found = found or prepared()
        self.bench = found.open()
        self.learner = StageCalibrator(found.magnet, self.bench)

    def advance(self, ticks: int) -> None:
        while ticks > 0:
            count = min(ticks, 200)
            self.learner.process_rows(self.bench.advance(count), lambda act: act())
            ticks -= count

    def laps(self, count: int = 1) -> None:
        seen = len(self.learner.laps)
        while len(self.learner.laps) < seen + count:
            self.advance(200)


@pytest.fixture
def beside() -> Beside:
    return Beside()


def start(beside: Beside) -> None:
    beside.bench.apply({"plant": WRONG})
    beside.bench.command(Command.RUN)


def test_online_calibration_of_a_stage_reduces_its_error_to_a_third(beside: Beside) -> None:
    start(beside)
    beside.laps()
    before = beside.learner.laps[-1]
    assert before.values == {}
    assert not before.learning
    beside.learner.switch(True)
    beside.laps(5)
    after = beside.learner.laps[-1]
    assert after.average < before.average / 3.0
    assert after.refused == 0
    assert set(after.values) >= {"scale_1", "scale_2", "width_1", "width_2"}
    assert beside.learner.status()["before"]["full"] >= before.average / 2.0


def test_a_stage_with_misleading_motion_is_not_calibrated(beside: Beside) -> None:
    bench = beside.bench
    slow = bench.rig.settings.with_changes({"amplifier.bandwidth_Hz": 1000.0})
    bench.rig = replace(bench.rig, settings=slow)
    learner = StageCalibrator(bearings.knowledge(), bench)
    with refused("amplifier-too-slow amplifier.bandwidth_Hz"):
        learner.switch(True)
    learner.switch(False)
    assert not learner.is_on
    assert learner.status()["refused"]


def test_estimates_are_reverted_on_one_tick_and_learnt_again(beside: Beside) -> None:
    start(beside)
    beside.learner.switch(True)
    beside.laps(4)
    learnt = beside.learner.laps[-1].average
    beside.learner.switch(False)
    due = beside.learner.revert()
    beside.laps(2)
    assert due <= beside.bench.cycles[-1].first_tick
    assert beside.learner.laps[-1].values == {}
    assert beside.learner.laps[-1].average > 2.0 * learnt


def test_a_revert_cancels_a_pending_swap(beside: Beside) -> None:
    other = Beside()
    for one in (beside, other):
        start(one)
        one.laps()
    beside.learner.switch(True)
    beside.laps()
    beside.advance(200)  # new estimates wait for the next cycle
    other.advance(beside.bench.tick - other.bench.tick)
    beside.learner.switch(False)
    beside.learner.revert()
    beside.laps(2)
    other.laps(2)
    ratio = beside.learner.laps[-1].average / other.learner.laps[-1].average
    assert 0.8 < ratio < 1.25


def test_queued_cycles_are_ignored_after_a_revert(beside: Beside) -> None:
    start(beside)
    beside.learner.switch(True)
    waiting = [beside.bench.advance(200) for _ in range(60)]
    beside.learner.revert()
    for rows in waiting:
        beside.learner.process_rows(rows, lambda act: act())
    assert [lap.values for lap in beside.learner.laps] == [{}, {}]


def test_cycles_before_a_revert_are_no_baseline_for_new_estimates(beside: Beside) -> None:
    start(beside)
    beside.learner.switch(True)
    beside.laps(6)
    before = beside.learner.status()["before"]["full"]
    last = beside.learner.laps[-1].lap
    waiting = [beside.bench.advance(200)]
    while beside.bench.cycles[-1].number < last + 4:
        waiting.append(beside.bench.advance(200))
    beside.learner.revert()
    for rows in waiting:
        beside.learner.process_rows(rows, lambda act: act())
    assert beside.learner.status()["before"]["full"] == before
    beside.laps(6)
    assert beside.learner.is_on
    assert beside.learner.status()["trouble"] == ""


def test_at_rest_no_estimate_changes(beside: Beside, monkeypatch: pytest.MonkeyPatch) -> None:
    start(beside)
    beside.learner.switch(True)
    beside.laps(3)
    beside.bench.command(Command.STOP)
    beside.advance(2000)
    before = beside.learner.laps[-1].values, len(beside.learner.laps)
    learner = dict(beside.learner._estimators)["full"]
    estimate, applied = dict(learner.estimate), dict(learner.applied_values)
    beside.bench.load(5.0)
    beside.advance(1_000_000)
    assert (beside.learner.laps[-1].values, len(beside.learner.laps)) == before
    assert (learner.estimate, learner.applied_values) == (estimate, applied)
    # the state of the iron is unknown now: the first cycle gives no update
    taken: list[int] = []
    learn = ParameterEstimator.update

    def count(learner: ParameterEstimator, motion: Motion) -> bool:
        taken.append(1)
        return learn(learner, motion)

    monkeypatch.setattr(ParameterEstimator, "update", count)
    beside.bench.command(Command.RUN)
    beside.laps()
    assert taken == []
    beside.laps()
    assert taken == [1]


def test_an_incomplete_cycle_changes_no_estimate(beside: Beside) -> None:
    start(beside)
    beside.learner.switch(True)
    beside.advance(3000)
    beside.bench.command(Command.STOP)
    beside.advance(4000)
    assert len(beside.learner.laps) == 0
    beside.bench.command(Command.RUN)
    beside.advance(3000)
    beside.bench.advance(200)  # skip rows, as if they were lost
    beside.advance(9000)
    assert [lap.lap for lap in beside.learner.laps] == [3]


def test_an_estimate_that_increases_the_error_is_reverted_and_ends_learning(
    beside: Beside, monkeypatch: pytest.MonkeyPatch
) -> None:
    start(beside)
    beside.learner.switch(True)
    beside.laps(5)
    good = beside.learner.laps[-1]
    # a diverged estimator assumes a current scale that is 1 % too large
    monkeypatch.setattr(
        ParameterEstimator, "update", lambda learner, _: learner.estimate.update(scale_1=0.01)
    )
    beside.laps(6)
    assert max(lap.average for lap in beside.learner.laps) > 2.0 * good.average
    monkeypatch.undo()
    assert not beside.learner.is_on
    assert "grew from" in beside.learner.status()["trouble"]
    beside.laps(2)
    assert beside.learner.laps[-1].average < 1.5 * good.average


@pytest.mark.slow
def test_a_changed_plant_does_not_revert_estimates(beside: Beside) -> None:
    start(beside)
    beside.learner.switch(True)
    beside.laps(4)
    beside.bench.apply({"plant": WRONG + 4.0})
    beside.laps(4)
    assert beside.learner.is_on
    assert beside.learner.status()["trouble"] == ""


def test_each_method_learns_from_its_own_cycles(beside: Beside) -> None:
    start(beside)
    beside.learner.switch(True)  # before the first tick
    beside.laps(2)
    assert beside.learner.status()["before"]["full"] == beside.learner.laps[0].average
    beside.bench.apply({"compensation": 0.0})
    beside.laps(3)
    methods = [lap.method for lap in beside.learner.laps]
    assert methods[:2] == ["full", "full"]
    assert methods[-1] == "single-valued"
    last = beside.learner.laps[-1]
    assert last.values == {}
    assert last.refused > 0  # its model does not explain the motion
    assert "no correction is applied" in beside.learner.status()["said"]["single-valued"]


@pytest.fixture
def session() -> Iterator[LiveSession]:
    bench, improver, learner = open_prepared(prepared())
    found = LiveSession(bench, improver=improver, learner=learner)
    found.start()
    yield found
    found.close()


def order(session: LiveSession, **fields: object) -> Callable[[], object]:
    return lambda: session.run_between_chunks(lambda: perform(session, "test", fields))


def test_a_session_runs_learns_and_reverts(session: LiveSession) -> None:
    assert session.status()["next"] == "press run" or session.bench.tick == 0
    wait_for(lambda: session.bench.tick > 0)
    order(session, do="apply", values={"plant": WRONG})()
    order(session, do="learn", on=True)()  # before the first tick
    order(session, do="command", name="run")()
    learner = session.learner
    assert learner is not None
    wait_for(lambda: len(learner.laps) >= 3 and learner.laps[-1].values)
    assert session.status()["learn"]["on"] is True
    order(session, do="learn", revert=True)()
    order(session, do="learn", on=False)()
    count = len(learner.laps)
    wait_for(lambda: len(learner.laps) > count + 1)
    assert learner.laps[-1].values == {}
    session.run_between_chunks(lambda: session.stop("test"))
    wait_for(lambda: session.status()["next"] == "press run")
    assert not session.end_reason
    with refused("wrong-state: only in the state idle"):
        order(session, do="command", name="lift")()


def test_a_bench_that_does_not_learn_refuses_to() -> None:
    with_file = prepared()
    session = LiveSession(with_file.open())
    session.start()
    try:
        with refused("not-for-this-kind learn"):
            order(session, do="learn", on=True)()
    finally:
        session.close()


@pytest.mark.slow
@pytest.mark.needs("chromium")
def test_the_page_shows_and_reverts_estimates_of_a_stage(serve: Serve, show: Show) -> None:
    served = serve(prepared=prepared())
    page = show(served)
    ready(page)
    state_is(page, "ready")
    served.session.run_between_chunks(lambda: served.session.apply_parameters({"plant": WRONG}))
    press(page, "run")
    state_is(page, "run")
    page.get_by_role("tab", name="improve").click()
    press(page, "learn from the motion")
    page.wait_for_selector("#learnt tbody tr")
    assert "±" in page.locator("#learnt tbody tr").first.inner_text()
    until(page, "document.getElementById('gained').textContent.includes('nm before')")
    with page.expect_download() as saved:
        page.locator("#csv").click()
    assert saved.value.path().read_text().startswith("t_s,method,average_m,peak_m,")
    press(page, "stop learning")
    press(page, "revert")
    until(page, "!document.querySelector('#learnt tbody tr')")
    page.keyboard.press("c")
    until(page, "document.getElementById('compensation').textContent === 'Off (C)'")
    until(page, "document.getElementById('gained').textContent.startsWith('single-valued')")
    page.keyboard.press("Escape")
    state_is(page, "ready")
    assert page.locator("#next").inner_text() == "Press Run"


def test_cycles_completed_meanwhile_are_skipped_and_counted(
    beside: Beside, monkeypatch: pytest.MonkeyPatch
) -> None:
    taken: list[Motion] = []
    monkeypatch.setattr(ParameterEstimator, "update", lambda _, motion: taken.append(motion))
    start(beside)
    beside.learner.switch(True)
    beside.laps()
    waiting = [beside.bench.advance(200)]
    while beside.bench.cycles[-1].number < beside.learner.laps[-1].lap + 4:
        waiting.append(beside.bench.advance(200))
    for rows in waiting:
        beside.learner.process_rows(rows, lambda act: act())
    assert [lap.learning for lap in beside.learner.laps] == [True, False, False, True]
    assert len(taken) == 2
    assert beside.learner.status()["left_out"] == 2
    beside.learner.revert()
    assert beside.learner.status()["left_out"] == 0


def several() -> PreparedStage:
    """Ten magnets with short set-points; the plant is random except for the loop widths."""
    known = bearings.knowledge()
    setups = tuple(make_stage(short_stage(), known, name) for name in ("single-valued", "full"))
    return PreparedStage(known, setups, (Feedforward(), Feedforward()))


@pytest.mark.slow
@pytest.mark.parametrize("make", [prepared, several])
def test_a_recording_from_the_first_tick_on_can_be_calibrated_from(
    make: Callable[[], PreparedStage], tmp_path: Path
) -> None:
    found = make()
    bench = found.open()
    session = LiveSession(bench, start_recording(tmp_path / "run.mf4", bench.signals, bench.rate))
    session.run_between_chunks(lambda: bench.apply({"plant": WRONG}))
    session.run_between_chunks(lambda: session.bench.command(Command.RUN))
    session.start()
    wait_for(lambda: len(bench.cycles) > 2)
    session.close()
    learnt = calibrate(found.setups[0].rig, tmp_path / "run.mf4", magnet=found.magnet, methods=["full"])
    assert learnt.has_estimates
    assert learnt.file.method[0].fits


@pytest.mark.slow
def test_a_body_of_several_coordinates_learns_from_its_cycles() -> None:
    beside = Beside(several())
    start(beside)
    beside.laps(2)
    before = min(lap.average for lap in beside.learner.laps)
    beside.learner.switch(True)
    beside.laps(4)
    learnt = beside.learner.laps[-1]
    assert learnt.average < before / 2.0
    assert learnt.refused == 0
    # each parameter is known better than its prior, and its value agrees with the prior
    for name in ("scale_1", "scale_4", "gap_zero_2_m", "scale_7", "centre_z_m"):
        value, sigma, applied, stated = learnt.values[name]
        assert sigma < stated
        assert abs(value) < 4.0 * stated
        assert abs(value - applied) < 0.5 * stated
    # after landing and immediate lift-off, the iron is on another branch
    for command in (Command.STOP, Command.LAND, Command.LIFT):
        beside.bench.command(command)
        beside.advance(1600)
    beside.bench.command(Command.RUN)
    beside.laps(2)
    again = beside.learner.laps[-1]
    assert again.average < before / 2.0
    assert again.refused == 0
    assert again.values
    assert "more than" not in beside.learner.status()["said"]["full"]


@pytest.mark.slow
@pytest.mark.needs("chromium")
def test_the_page_groups_estimates_of_a_body_by_kind_and_magnet(serve: Serve, show: Show) -> None:
    served = serve(prepared=several())
    page = show(served)
    ready(page)
    state_is(page, "ready")
    served.session.run_between_chunks(lambda: served.session.apply_parameters({"plant": WRONG}))
    press(page, "run")
    page.keyboard.press("6")
    press(page, "learn from the motion")
    page.wait_for_selector("#learnt tbody tr")
    heads = page.locator("#learnt tbody th").all_inner_texts()
    assert {head.partition(",")[0] for head in heads} == {"Scale error"}
    page.select_option("#learnt-kind", label="magnet x2")
    assert page.locator("#learnt tbody th").all_inner_texts() == [
        "Scale error, magnet x2",
        "Zero of the gap, magnet x2",
    ]
    page.select_option("#learnt-kind", "body")
    assert "Centre of mass, z" in page.locator("#learnt tbody th").all_inner_texts()
    page.keyboard.press("Escape")
