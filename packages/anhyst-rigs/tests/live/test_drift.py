"""Test that the samples of a test bench show whether the active model still fits."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from anhyst.support.numeric import FloatArray
from anhyst_rigs.dashboard.improver import Improver
from anhyst_rigs.rig.bench.bearing import BearingBench
from anhyst_rigs.rig.bench.force import ForceBench
from anhyst_rigs.rig.bench.protocol import Signal
from anhyst_rigs.study.improve import BenchMonitor
from anhyst_rigs.study.prepared_benches import PreparedBearing, PreparedForce
from tests.live.improving import pinned_more, swung
from tests.refusals import refused
from tests.study import bearings

RATE = 1000.0
LEARNT = 14
"""Cycles of one second before the drift begins."""


@pytest.fixture(scope="module")
def usual(prepared: PreparedForce) -> FloatArray:
    return swung(prepared, LEARNT + 10)


def watched(prepared: PreparedForce, *parts: FloatArray) -> BenchMonitor:
    watch = BenchMonitor(prepared.model, ForceBench.signals, RATE)
    for part in parts:
        watch.add_rows(part)
    return watch


@pytest.mark.slow
def test_a_pinning_increase_of_20_percent_is_found_within_ten_seconds(
    prepared: PreparedForce, usual: FloatArray
) -> None:
    fine = watched(prepared, usual).status()
    assert fine["state"] == "fits"
    assert fine["cycles"] >= LEARNT + 8
    begin = round(LEARNT * RATE)
    drifted = swung(pinned_more(prepared, 1.2), LEARNT + 10)
    found = watched(prepared, usual[:begin], drifted[begin:]).status()
    assert found["state"] == "drifted"
    assert found["left_N"] > found["usual_N"]
    assert found["gain_N"] == pytest.approx(found["left_N"] - found["usual_N"])
    assert f"residual is {found['left_N']:.3g} N rms instead of" in found["text"]


def test_the_monitor_does_not_depend_on_the_chunks_of_rows(
    prepared: PreparedForce, usual: FloatArray
) -> None:
    pieces = np.array_split(usual, 577)
    assert watched(prepared, *pieces).status() == pytest.approx(watched(prepared, usual).status())


def test_a_bench_without_the_needed_signals_is_refused(prepared: PreparedForce) -> None:
    with refused("no-such-signal: gap_read"):
        BenchMonitor(prepared.model, [Signal("current_read", "A", "")], RATE)


@pytest.mark.slow
def test_a_pair_of_magnets_is_refused_because_only_its_total_force_is_measured(
    firmware: Path, bench: BearingBench
) -> None:
    single = PreparedBearing(bearings.single(), bearings.knowledge().model, firmware)
    pair = replace(single, setup=replace(single.setup, rig=bearings.pair_rig()))
    for prepared, watched in ((single, True), (pair, False)):
        improver = Improver(prepared, bench)
        if watched:
            BenchMonitor(improver.model_to_monitor().model, bench.signals, bench.rate).add_rows(
                bench.advance(400)
            )
        else:
            with refused("force-of-a-pair"):
                improver.model_to_monitor()
        improver.close()
