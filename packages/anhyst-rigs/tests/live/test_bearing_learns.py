"""Test a bearing on the page whose parameters are estimated while it levitates."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from anhyst.support.block_words import GENERATION_INDEX, set_generation
from anhyst.support.states import Command
from anhyst_rigs.dashboard.serving import open_prepared
from anhyst_rigs.rig.bench.bearing import BearingBench
from anhyst_rigs.rig.drift import Drift, change_rig, drifted_file
from anhyst_rigs.rig.fitting import calibrate_magnet
from anhyst_rigs.study.prepared_benches import PreparedBearing, fixed_point_block
from anhyst_rigs.study.tracking.estimator import ParameterEstimator
from anhyst_rigs.study.tracking.online_calibration import BearingCalibrator
from tests.live.conftest import Serve, Show, wait_for
from tests.live.test_page import press, ready, until
from tests.refusals import refused
from tests.study import bearings

WRONG = Drift(pinning=0.2, gap_offset=10e-6)


def prepared(firmware: Path) -> PreparedBearing:
    """The example with a plant that differs from the model of its controller."""
    of = bearings.single()
    rig = change_rig(of.rig, {"spread.gap_zero_m": 5e-6})
    rig = replace(rig, settings=drifted_file(rig.settings, WRONG))
    return PreparedBearing(replace(of, rig=rig), bearings.knowledge().model, firmware)


class Beside:
    """A bench and its online calibration in step, without a session."""

    def __init__(self, found: PreparedBearing) -> None:
        self.prepared = found
        bench, improver, learner = open_prepared(found)
        assert isinstance(bench, BearingBench)
        assert improver is not None
        assert isinstance(learner, BearingCalibrator)
        improver.close()
        self.bench, self.learner = bench, learner

    def advance(self, seconds: float, swing: float = 0.0) -> None:
        for _ in range(round(200 * seconds)):
            side = 1.0 if self.bench.tick // 2000 % 2 else -1.0
            self.bench.demand(bearings.GAP + side * swing)
            self.learner.process_rows(self.bench.advance(100), lambda act: act())

    def lift(self) -> None:
        self.advance(0.01)
        self.bench.command(Command.DEMAGNETISED)
        self.bench.command(Command.LIFT)
        self.advance(0.45)

    def off(self) -> float:
        """Force error in the last evaluated second, N."""
        return self.learner.laps[-1].average


@pytest.fixture
def beside(firmware: Path) -> Iterator[Beside]:
    found = Beside(prepared(firmware))
    found.lift()
    yield found
    found.bench.close()


@pytest.mark.slow
def test_online_calibration_of_a_bearing_reduces_its_force_error_to_a_fifth(beside: Beside) -> None:
    beside.advance(1.0, 40e-6)
    before = beside.off()
    assert beside.learner.laps[-1].values == {}
    beside.learner.switch(True)
    beside.advance(3.0, 40e-6)
    assert beside.off() < before / 5.0
    last = beside.learner.laps[-1]
    assert last.refused == 0
    for value, sigma, applied, stated in last.values.values():
        assert abs(value) <= 4.0 * stated
        assert sigma < stated
        assert abs(value - applied) < 0.5 * stated
    # no motion: a changing load causes no update
    beside.advance(1.2)
    count, values = len(beside.learner.laps), beside.learner.laps[-1].values
    beside.bench.load(158.0)
    beside.advance(1.1)
    beside.bench.load(150.0)
    assert (len(beside.learner.laps), beside.learner.laps[-1].values) == (count, values)
    beside.learner.revert()
    beside.learner.switch(False)
    beside.advance(2.0, 40e-6)
    assert beside.off() > 0.8 * before
    assert beside.learner.laps[-1].values == {}


@pytest.mark.slow
def test_a_harmful_estimate_is_reverted_and_ends_learning(
    beside: Beside, monkeypatch: pytest.MonkeyPatch
) -> None:
    beside.learner.switch(True)
    beside.advance(2.0, 40e-6)
    monkeypatch.setattr(ParameterEstimator, "update", lambda *_: None)
    monkeypatch.setattr(
        ParameterEstimator,
        "follow_estimate",
        lambda learner, _: learner.applied_values.update(gap_zero_m=-2e-5),
    )
    beside.advance(3.5, 40e-6)
    monkeypatch.undo()
    assert not beside.learner.is_on
    assert "without corrections" in beside.learner.status()["trouble"]
    beside.advance(2.0, 40e-6)
    assert beside.off() < 1.1 * beside.learner.status()["before"]["full"]


@pytest.mark.slow
def test_learning_pauses_while_the_compensation_is_off(beside: Beside) -> None:
    reports: list[str] = []
    beside.learner.report = reports.append
    beside.learner.switch(True)
    beside.advance(2.0, 40e-6)
    corrections = beside.learner.laps[-1].values
    beside.bench.apply({"compensation": 0.0})
    count = len(beside.learner.laps)
    beside.advance(3.5, 40e-6)
    assert beside.learner.is_on
    assert len(beside.learner.laps) == count
    assert reports == [beside.learner.status()["trouble"]]
    assert "the compensation is off" in reports[0]
    beside.bench.apply({"compensation": 1.0})
    beside.advance(3.5, 40e-6)
    assert beside.learner.is_on
    assert len(beside.learner.laps) > count
    assert beside.learner.laps[-1].values.keys() >= corrections.keys()
    assert beside.learner.status()["trouble"] == ""
    assert reports[1:] == ["learning continues"]


@pytest.mark.slow
def test_rows_that_were_missed_are_waited_out_until_no_current_flows(beside: Beside) -> None:
    beside.advance(1.0, 40e-6)
    beside.bench.advance(100)  # skip rows, as if they were lost
    count = len(beside.learner.laps)
    beside.advance(1.3, 40e-6)
    assert len(beside.learner.laps) == count
    assert "land and lift again" in beside.learner.status()["trouble"]
    beside.bench.command(Command.LAND)
    beside.advance(0.8)
    beside.bench.command(Command.LIFT)
    beside.advance(0.5)
    beside.advance(1.5, 40e-6)
    assert len(beside.learner.laps) > count


def test_a_model_that_somebody_else_swapped_in_stays_in_force(firmware: Path) -> None:
    beside = Beside(prepared(firmware))
    other = calibrate_magnet(bearings.knowledge(), width_change=0.5).model
    words = fixed_point_block(beside.prepared.compile(other)).words.tolist()
    generation = beside.bench.read_block()[GENERATION_INDEX] + 1
    beside.bench.swap_block(set_generation(words, generation))
    beside.learner.switch(True)
    beside.learner.revert()
    assert not beside.learner.is_on
    assert "another model" in beside.learner.status()["trouble"]
    assert np.array_equal(beside.bench.read_block(), set_generation(words, generation))
    beside.bench.close()


def test_a_pair_that_shares_one_block_is_not_learnt_on(firmware: Path) -> None:
    beside = Beside(prepared(firmware))
    known = bearings.knowledge()
    learner = BearingCalibrator(bearings.pair(), known, lambda _: [], beside.bench)
    with refused("not-learnt-here"):
        learner.switch(True)
    assert "share one block" in learner.status()["refused"]
    beside.bench.close()


@pytest.mark.slow
@pytest.mark.needs("chromium")
def test_the_page_shows_what_a_bearing_learns(serve: Serve, show: Show, firmware: Path) -> None:
    served = serve(prepared=prepared(firmware))
    page = show(served)
    ready(page)
    press(page, "demagnetised")
    press(page, "lift")
    session = served.session
    wait_for(lambda: session.bench.tick > 10_000)
    page.get_by_role("tab", name="9 learning").click()
    press(page, "learn from the motion")
    press(page, "start")
    page.wait_for_selector("#learnt tbody tr")
    assert "±" in page.locator("#learnt tbody tr").first.inner_text()
    heads = page.locator("#learnt tbody th")
    assert heads.first.inner_text() == "Zero of the gap"
    assert heads.first.get_attribute("title") == "gap_zero_m"
    assert not any("_" in text for text in heads.all_inner_texts())
    until(page, "document.getElementById('gained').textContent.includes('N before')")
    assert page.locator("#gained").inner_text().startswith("Full hysteresis compensator: unexplained force")
    page.locator("body").press("c")
    until(page, "document.getElementById('notice').textContent.includes('Learning pauses, because the comp')")
    assert "Learning pauses" in str(page.locator("#log").text_content())
    page.locator("body").press("c")
    press(page, "revert")
    press(page, "stop learning")
    page.keyboard.press("Escape")
