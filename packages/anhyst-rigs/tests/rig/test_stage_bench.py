"""Test the virtual bench of a stage: repeated set-points, and changes while it runs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from anhyst._core import Coil, Magnet
from anhyst.support.numeric import FloatArray
from anhyst.support.states import Command, Fault, State
from anhyst_rigs.rig.bench import stage
from anhyst_rigs.rig.bench.stage import StageBench
from anhyst_rigs.rig.parts.magnet import circuit_parameters
from anhyst_rigs.rig.recording import Loss
from anhyst_rigs.rig.stage.fitted import make_stage
from anhyst_rigs.rig.stage.geometry import magnet_rows
from anhyst_rigs.rig.stage.loop import Feedforward, StageSetup, track
from tests.refusals import refused
from tests.study import bearings, stages
from tests.study.test_axes import planar

SUBSTEPS = 4


def setups(dac_bits: int | None = None) -> tuple[StageSetup, StageSetup]:
    off, on = (stages.setup(method, SUBSTEPS) for method in ("single-valued", "full"))
    if dac_bits is not None:
        settings = on.rig.settings.with_changes({"amplifier.dac_bits": dac_bits})
        off, on = (replace(one, rig=replace(one.rig, settings=settings)) for one in (off, on))
    return off, on


@pytest.fixture
def bench() -> StageBench:
    return StageBench(setups())


def column(bench: StageBench, rows: FloatArray, name: str) -> FloatArray:
    found: FloatArray = rows[:, 1 + [signal.name for signal in bench.signals].index(name)]
    return found


def lap(bench: StageBench) -> int:
    """Return the number of ticks of a set-point that has begun."""
    return bench.cycles[-1].tick_count


def going(bench: StageBench, laps: int = 1) -> FloatArray:
    """Start a bench and advance by some cycles."""
    bench.command(Command.RUN)
    first = bench.advance(1)
    return np.concatenate([first, bench.advance(laps * lap(bench) - 1)])


def test_the_first_cycle_agrees_with_a_simulation() -> None:
    """Codes of 24 bits hide the last bits of a sine, which differ between processors."""
    bench = StageBench(setups(24))
    rows = going(bench)
    setup = bench.setups[1]
    run = track(setup, bench.cycles[0].motion, Feedforward(), seed=0)
    for name in ("error_m", "demand_N", "command_A", "gap_read_m"):
        seen = column(bench, rows, name.rpartition("_")[0])
        assert np.allclose(seen, run[name], rtol=1e-6, atol=1e-4 * np.ptp(run[name])), name


def test_rows_do_not_depend_on_how_they_are_cut(bench: StageBench) -> None:
    whole = going(bench, 2)
    other = StageBench(setups())
    other.command(Command.RUN)
    cuts = [1, 2, 333, 5, 1000]
    parts = [other.advance(count) for count in cuts]
    parts.append(other.advance(len(whole) - sum(cuts)))
    assert np.array_equal(np.concatenate(parts), whole)


def test_the_body_returns_after_two_cycles_and_rests_between_them(bench: StageBench) -> None:
    rows = going(bench, 2)
    place = column(bench, rows, "reference")
    assert np.ptp(place) > 5e-3
    half = len(rows) // 2
    assert np.array_equal(place[half : half + 100], np.full(100, place[half]))
    assert abs(place[-1]) < 1e-12
    assert np.allclose(place[half:] - place[half], -(place[:half] - place[0]), atol=1e-12)
    assert set(column(bench, rows, "lap")) == {1.0, 2.0}


def test_applied_values_act_from_the_reported_tick(bench: StageBench) -> None:
    other = StageBench(setups())
    for one in (bench, other):
        going(one)
        one.advance(500)
    applied = bench.apply({"compensation": 0.0, "gain_acceleration": 1.02})
    ticks = applied - bench.tick + lap(bench)
    rows, same = bench.advance(ticks), other.advance(ticks)
    differs = np.flatnonzero(np.any(rows[:, 1:] != same[:, 1:], axis=1))
    assert rows[differs[0], 0] == applied
    named = {parameter.name: parameter.value for parameter in bench.parameters()}
    assert (named["compensation"], named["gain_acceleration"]) == (0.0, 1.02)
    at_rest = StageBench(setups())
    assert at_rest.apply({"compensation": 0.0}) == 1


def test_a_controller_change_causes_no_bump_and_keeps_the_currents(bench: StageBench) -> None:
    other = StageBench(setups())
    for one in (bench, other):
        one.load(5.0)  # carried by the integral
        going(one, 2)
    bench.apply({"crossover": bench.rig.settings.tracking.crossover_Hz})
    changed, same = (column(one, one.advance(lap(one)), "error") for one in (bench, other))
    assert np.abs(changed - same).max() < 0.1 * np.abs(same).max()


def test_a_stop_brakes_at_once_with_no_more_force_than_a_turnaround(bench: StageBench) -> None:
    rows = going(bench)
    largest = np.abs(column(bench, rows, "demand")).max()
    for part, share in ((0.3, 1.0), (0.5, 1.0), (0.7, 1.0), (0.3, 0.1)):
        bench.command(Command.STOP)
        bench.advance(round(0.2 * bench.rate))
        bench.apply({"motion": share})
        bench.command(Command.RUN)
        bench.advance(1)
        bench.advance(round(part * lap(bench)))
        bench.command(Command.STOP)
        rows = bench.advance(round(0.2 * bench.rate))
        place = column(bench, rows, "reference")
        assert np.all(place[round(0.1 * bench.rate) :] == place[-1])
        assert np.abs(column(bench, rows, "demand")).max() < 1.1 * largest
        assert np.abs(column(bench, rows, "error")[-100:]).max() < 2e-8
        assert set(column(bench, rows, "state")) == {float(State.READY)}


def test_a_stage_that_is_lost_has_no_current_until_it_is_cleared(bench: StageBench) -> None:
    going(bench)
    bench.apply({"gain_acceleration": 2.0, "crossover": 40.0})
    rows = bench.advance(2 * lap(bench))
    assert rows[-1, 0] == bench.tick
    assert np.array_equal(np.diff(rows[:, 0]), np.ones(len(rows) - 1))
    last = {signal.name: value for signal, value in zip(bench.signals, rows[-1, 1:], strict=True)}
    assert (last["state"], last["fault"]) == (State.FAULT, Fault.POSITION_RANGE)
    assert last["command"] == last["current_2"] == 0.0
    with refused("wrong-state"):
        bench.apply({"gain_acceleration": 1.0})
    with refused("wrong-state run"):
        bench.command(Command.RUN)
    bench.command(Command.STOP)
    bench.command(Command.CLEAR)
    bench.apply({"gain_acceleration": 1.0})
    rows = going(bench)
    assert set(column(bench, rows, "state")) == {float(State.RUN)}


def test_commands_and_values_that_it_cannot_take_are_refused(bench: StageBench) -> None:
    with refused("wrong-state clear"):
        bench.command(Command.CLEAR)
    with refused("wrong-state condition"):
        bench.command(Command.CONDITION)
    bench.command(Command.STOP)  # at rest
    going(bench)
    with refused("wrong-state run"):
        bench.command(Command.RUN)
    for values in ({"compensation": 0.5}, {"plant": 1.5}, {"crossover": 1e4}, {"motion": 0.0}):
        with refused("out-of-range"):
            bench.apply(values)
    with refused("unknown-parameter"):
        bench.apply({"gain_p": 1.0})
    with refused("out-of-range demand"):
        bench.demand(1e-3)


def test_the_target_is_added_to_the_set_point(bench: StageBench) -> None:
    bench.advance(200)
    bench.demand(1e-7)
    rows = bench.advance(2000)
    assert np.all(column(bench, rows, "reference") == 1e-7)
    assert abs(column(bench, rows, "position")[-1] - 1e-7) < 1e-8


def test_a_drawn_plant_is_another_one_and_its_iron_is_demagnetised(bench: StageBench) -> None:
    rows = going(bench)
    applied = bench.apply({"plant": 3.0})
    other = bench.advance(applied - bench.tick - 1 + lap(bench))
    error = np.abs(column(bench, other, "error")[-lap(bench) :])
    assert error[:20].max() < 1e-7  # it is switched on at its reference
    wrong = error.max()
    assert wrong > 2.0 * np.abs(column(bench, rows, "error")).max()
    assert bench.cycles[-1].history_start == applied


@pytest.fixture
def axes() -> StageBench:
    return StageBench(
        [make_stage(planar(), bearings.knowledge(), name) for name in ("single-valued", "full")]
    )


def test_the_pulls_of_all_magnets_make_the_wrench_and_their_gaps_the_pose(axes: StageBench) -> None:
    assert axes.body is not None
    axes.advance(400)
    axes.command(Command.RUN)
    rows = axes.advance(3000)
    read = {signal.name: rows[:, 1 + place] for place, signal in enumerate(axes.signals)}

    def all_of(name: str) -> FloatArray:
        return np.column_stack([read[name], *(read[f"{name}_{n}"] for n in range(2, 11))])

    free, file = axes.body["free"], axes.rig.settings
    wrench = np.column_stack([read[f"wrench_{axis}"] for axis in free])
    assert np.ptp(wrench[:, 0]) > 50.0
    # The lines of pull rotate with the body, by tilts of less than 1e-5.
    assert np.allclose(all_of("pull") @ magnet_rows(file), wrench, atol=2e-3)
    opened = all_of("gap") - [one["gap"] for one in axes.body["magnets"]]
    pose = -opened @ np.transpose(axes.body["see"])
    assert np.allclose(-pose @ magnet_rows(file).T, opened, atol=1e-11)
    # The magnets ride on the long stroke, whose path error is along the set-point; others are
    # errors.
    assert np.allclose(pose[:, 1], -read["error_y"], atol=1e-11)


def test_the_force_computed_from_flux_density_agrees_with_the_plant() -> None:
    file = stages.stage().settings
    poles, steel = file.magnet.poles, file.steel
    for one in (poles, replace(poles, outer=poles.reluctance(0.5e-3), bias=2e5, spring=300.0)):
        coil = Coil(Magnet(circuit_parameters(one, 0.0, 0.5e-3), steel.make_steel()))
        for current, gap in ((2.0, 0.45e-3), (0.5, 0.55e-3)):
            coil.hold(current, gap)
            told = one.pull_force(np.array(coil.density), np.array(gap), 0.5e-3)
            assert told == pytest.approx(coil.force, rel=1e-9)


@pytest.mark.slow
def test_the_first_cycle_of_several_coordinates_agrees_with_a_simulation(axes: StageBench) -> None:
    rows = going(axes)
    run = track(axes.setups[1], axes.cycles[0].motion, Feedforward())
    for name in ("error_m", "demand_N", "error_z_m", "error_ry_rad", "gap_5_m", "command_A"):
        seen = column(axes, rows, name.rpartition("_")[0])
        assert np.allclose(seen, run[name], rtol=1e-6, atol=1e-3 * np.ptp(run[name])), name


@pytest.mark.slow
def test_a_law_change_keeps_supporting_the_weight(axes: StageBench) -> None:
    going(axes)
    axes.command(Command.STOP)
    axes.advance(2000)
    due = axes.apply({"compensation": 0.0, "crossover": 100.0})
    rows = axes.advance(1000)
    assert due == rows[0, 0]
    assert axes.cycles[-1].method == "full"
    deviation = np.abs(column(axes, rows, "error_z"))
    assert deviation.max() < 1e-5
    assert deviation[-1] < 1e-7
    assert set(column(axes, rows, "state")) == {float(State.READY)}


@pytest.mark.slow
def test_a_body_stays_at_rest_and_is_braked_from_any_speed(axes: StageBench) -> None:
    deviation = np.abs(column(axes, axes.advance(3000), "error_z"))
    assert deviation.max() < 3e-6  # until the currents carry the weight
    assert deviation[2000:].max() < 1e-9
    axes.command(Command.RUN)
    axes.advance(1500)
    axes.command(Command.STOP)
    rows = axes.advance(3000)
    assert np.ptp(column(axes, rows, "reference")[-500:]) == 0.0
    assert np.abs(column(axes, rows, "error")).max() < 1e-4


@pytest.mark.slow
def test_a_lost_body_has_no_current_until_cleared(axes: StageBench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(stage, "find_stage_loss", lambda *_: Loss(30, "an end stop was reached"))
    rows = axes.advance(200)
    assert len(rows) == 200
    assert set(column(axes, rows, "state")[31:]) == {float(State.FAULT)}
    monkeypatch.undo()
    rows = axes.advance(50)
    assert np.all(column(axes, rows, "current_7") == 0.0)
    # Its weight pulls it away from the magnets above it; the gaps of the lateral magnets are
    # unchanged.
    read = {signal.name: rows[-1, 1 + place] for place, signal in enumerate(axes.signals)}
    gaps = [read["gap"], *(read[f"gap_{number}"] for number in range(2, 11))]
    assert gaps == pytest.approx([0.45e-3] * 6 + [0.55e-3] * 4)
    assert [read["error_z"], read["error"], read["error_rx"]] == pytest.approx([0.1e-3, 0.0, 0.0])
    with refused("wrong-state"):
        axes.apply({"motion": 0.5})
    axes.command(Command.CLEAR)
    rows = axes.advance(500)
    assert np.abs(column(axes, rows, "error_z")).max() < 3e-6


def test_a_drawn_plant_of_several_coordinates_is_another_one(axes: StageBench) -> None:
    axes.advance(400)
    axes.apply({"plant": 1.0})
    rows = axes.advance(400)
    error = np.abs(column(axes, rows, "error_rx"))
    assert error.max() < 20e-6
    assert error[-1] > 1e-8  # its magnets differ


def test_a_push_acts_on_its_coordinate_only_and_is_compensated(axes: StageBench) -> None:
    quiet = axes.advance(3000)
    limits = {
        parameter.name: parameter.high
        for parameter in axes.parameters()
        if parameter.name.startswith("push_")
    }
    # Two pairs along x; the four magnets of 240 N above the body carry 20 kg.
    assert limits["push_x"] == pytest.approx(0.5 * 480.0, rel=0.02)
    assert limits["push_z"] == pytest.approx(0.5 * (20.0 * 9.81 - 2.0), rel=0.02)
    assert axes.apply({"push_z": 20.0}) == axes.tick + 1
    rows = axes.advance(3000)
    deviation = np.abs(column(axes, rows, "error_z"))
    assert deviation.max() > 30.0 * np.abs(column(axes, quiet, "error_z")[-500:]).max()
    assert deviation[-1] < 0.1 * deviation.max()
    assert np.ptp(column(axes, rows, "error_y")) < 0.01 * deviation.max()
    # Another controller takes over the integral of the loop.
    axes.apply({"compensation": 0.0})
    assert np.abs(column(axes, axes.advance(500), "error_z")).max() < deviation.max()
    with refused("out-of-range"):
        axes.apply({"push_z": 1000.0})


def test_a_body_lands_rests_without_current_and_lifts_to_its_position(axes: StageBench) -> None:
    def state(rows: FloatArray) -> list[float]:
        """Return the states in their order."""
        found = column(axes, rows, "state")
        return [float(found[0]), *found[1:][np.diff(found) != 0.0].tolist()]

    axes.advance(1000)
    for command in (Command.LIFT, Command.CLEAR):
        with refused(f"wrong-state {command.name.lower()}"):
            axes.command(command)
    axes.command(Command.LAND)
    axes.advance(500)
    for wanted in (Command.RUN, Command.LAND, Command.LIFT):
        with refused(f"wrong-state {wanted.name.lower()}"):
            axes.command(wanted)
    with refused("wrong-state"):
        axes.apply({"crossover": 100.0})
    rows = axes.advance(3000)
    assert state(rows) == [State.RUN, State.IDLE]
    assert column(axes, rows, "error_z")[-1] == pytest.approx(0.1e-3, rel=0.05)
    assert column(axes, rows, "current_7")[-1] == pytest.approx(0.0, abs=1e-3)
    with refused("wrong-state run"):
        axes.command(Command.RUN)
    # Another controller does not lift off, and its history has no current.
    axes.apply({"compensation": 0.0})
    rows = axes.advance(500)
    assert state(rows) == [State.IDLE]
    axes.apply({"compensation": 1.0})
    axes.advance(500)
    axes.command(Command.LIFT)
    rows = axes.advance(3000)
    assert state(rows) == [State.RUN, State.READY]
    fast = np.diff(column(axes, rows, "error_z")) * axes.rate
    assert np.abs(fast[1000:]).max() < 3e-3
    assert np.abs(column(axes, rows, "error_z")[-200:]).max() < 2e-9
    axes.command(Command.RUN)
    rows = axes.advance(2000)
    assert set(column(axes, rows, "lap")) == {1.0}
    # After the command during a motion, the set-point brakes and no cycle follows.
    axes.command(Command.IDLE)
    rows = axes.advance(4000)
    assert state(rows) == [State.IDLE]
    assert not column(axes, rows, "lap").any()
    assert np.ptp(column(axes, rows, "reference")[-500:]) == 0.0


def test_a_stop_during_lifting_lands_the_body(axes: StageBench) -> None:
    axes.command(Command.IDLE)
    axes.advance(1000)
    axes.command(Command.LIFT)
    axes.advance(400)
    axes.command(Command.STOP)
    rows = axes.advance(3000)
    assert column(axes, rows, "state")[-1] == State.IDLE
    assert column(axes, rows, "error_z")[-1] > 0.09e-3
