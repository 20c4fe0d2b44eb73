"""Measure the virtual bench in real time: largest speed, lateness, and lost ticks."""

from __future__ import annotations

import os
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from anhyst.support.states import Command, State
from anhyst_rigs.rig.bearing.loop import BearingSetup
from anhyst_rigs.rig.bearing.scenario import ScenarioBuilder, land_time
from anhyst_rigs.rig.bench.bearing import BearingBench
from anhyst_rigs.rig.bench.pace import PacedBench, Pacing
from anhyst_rigs.rig.loop import Scenario, SimulatedLoop
from anhyst_rigs.study.bearing.inputs import check_inputs, read_files
from anhyst_rigs.study.bearing.on_board import build_firmware
from rows import ROOT, Row, Stopwatch

RIG = ROOT / "examples" / "bearing" / "rig.toml"
RUN_S = 10.0
PACED_S = 60.0
TICKS = 1_000_000
LATE_S = 0.02


def rows() -> list[Row]:
    """Build the firmware of the bundled bearing and run it on the bench."""
    rig, controller = read_files(RIG, None)
    ready = check_inputs(rig, controller)
    with tempfile.TemporaryDirectory() as folder_name:
        setup, firmware = build_firmware(
            ready.rig, controller, ready.identify_magnet(), "library", Path(folder_name)
        )
        with use_one_core():
            one_core_row = measure_speed("one core", setup, firmware)
        return [
            one_core_row,
            measure_speed(f"{os.cpu_count()} cores", setup, firmware),
            measure_pacing(setup, firmware),
            compare_million_ticks(setup, firmware),
        ]


@contextmanager
def use_one_core() -> Iterator[None]:
    """Restrict this process and its child processes to one core."""
    cores = os.sched_getaffinity(0)
    os.sched_setaffinity(0, {min(cores)})
    try:
        yield
    finally:
        os.sched_setaffinity(0, cores)


def measure_speed(core_text: str, setup: BearingSetup, firmware: Path) -> Row:
    """Levitate without pacing and measure the ratio of simulated time to wall time."""
    watch = Stopwatch()
    bench = BearingBench(setup, firmware)
    lift_off(bench)
    start_time = time.perf_counter()
    ticks = round(RUN_S * bench.rate)
    for _ in range(ticks // 200):
        bench.advance(200)
    wall_seconds = time.perf_counter() - start_time
    bench.close()
    real_time_factor = RUN_S / wall_seconds
    return Row(
        f"virtual bearing, {bench.rate:g} Hz, independent iron, full, 4 sub-steps, {core_text}",
        ">= 1 times real time",
        f"{real_time_factor:.2f} times real time, {1e6 * wall_seconds / ticks:.1f} us per tick, "
        f"{1e6 * watch.processor / bench.tick:.1f} us of processor time of plant and firmware",
        real_time_factor >= 1.0,
        watch.processor,
    )


def lift_off(bench: BearingBench) -> None:
    """Lift the armature off."""
    bench.advance(200)
    bench.command(Command.DEMAGNETISED)
    bench.command(Command.LIFT)
    bench.advance(round(0.5 * bench.rate))


def measure_pacing(setup: BearingSetup, firmware: Path) -> Row:
    """Levitate in real time while a recorder and a viewer receive the signals."""
    bench = BearingBench(setup, firmware)
    lift_off(bench)
    first_tick = bench.tick + 1
    pacer = PacedBench(bench, is_paused=True)
    recorder, row_blocks = pacer.subscribe("recorder", needs_every_tick=True), []
    pacer.subscribe("viewer", max_chunks=3)

    def record() -> None:
        while (chunk := recorder.get()) is not None:
            row_blocks.append(chunk[:, 0])

    thread = threading.Thread(target=record)
    thread.start()
    start_time, tick = time.monotonic(), bench.tick
    pacer.resume()
    pacings: list[Pacing] = []
    while time.monotonic() < start_time + PACED_S:
        time.sleep(0.5)
        pacings.append(pacer.pacing())
    elapsed, tick_count = time.monotonic() - start_time, pacings[-1].tick - tick
    pacer.close()
    thread.join()
    bench.close()
    tick_numbers = np.concatenate(row_blocks)
    is_complete = bool((tick_numbers == np.arange(first_tick, first_tick + tick_numbers.size)).all())
    max_lateness = max(pacing.max_lateness for pacing in pacings)
    real_time_factor = tick_count / bench.rate / elapsed
    return Row(
        f"virtual bearing, paced in real time for {PACED_S:g} s, recorded",
        f"1 times real time, no chunk later than {1e3 * LATE_S:g} ms, no tick lost",
        f"{real_time_factor:.3f} times, "
        f"lateness {1e3 * float(np.mean([pacing.mean_lateness for pacing in pacings])):.1f} ms "
        f"mean, {1e3 * max_lateness:.1f} ms at most, {pacings[-1].slip_count} pacing slips, "
        f"{'none' if is_complete else 'some'} lost",
        is_complete and max_lateness <= LATE_S and real_time_factor >= 0.99,
    )


def compare_million_ticks(setup: BearingSetup, firmware: Path) -> Row:
    """Run a million ticks on the bench and in the simulated loop, and compare them."""
    script = ScenarioBuilder(setup.rig, setup.rig.settings.gap_m).lift_off(setup.controller)
    landing = script.tick_count(land_time(setup.rig, setup.controller))
    while script.ticks < TICKS - landing:
        for gap, load in ((0.41e-3, 130.0), (0.49e-3, 165.0), (0.45e-3, 150.0)):
            script.set_load(load).step(gap, 0.1)
    scenario = script.command(Command.LAND).hold(landing * setup.rig.dt).build()
    watch = Stopwatch()
    bench = BearingBench(setup, firmware)
    recorded = follow_scenario(bench, scenario)
    bench.close()
    simulated = SimulatedLoop(setup).run(scenario)
    signal_index = [signal.name for signal in bench.signals].index
    differing_ticks = np.zeros(scenario.ticks, dtype=bool)
    for name, column_name in (("gap", "gap_m"), ("command", "command_A"), ("force", "force_N")):
        differing_ticks |= recorded[:, 1 + signal_index(name)] != simulated[column_name]
    landed = recorded[-1, 1 + signal_index("state")] == State.READY
    return Row(
        f"{scenario.ticks} ticks of steps on the bench against the simulated loop",
        "no tick lost, no tick differs",
        f"{scenario.ticks - len(recorded)} lost, {np.count_nonzero(differing_ticks)} differ",
        len(recorded) == scenario.ticks and not differing_ticks.any() and bool(landed),
        watch.processor,
    )


def follow_scenario(bench: BearingBench, scenario: Scenario) -> np.ndarray:
    """Apply the commands, set-points and loads of a scenario to the bench and return its rows."""
    events = (scenario.command != 0) | (np.diff(scenario.target, prepend=np.nan) != 0.0)
    events |= np.diff(scenario.load, prepend=np.nan) != 0.0
    begins = np.flatnonzero(events)
    table_blocks = []
    for begin_tick, end in zip(begins, [*begins[1:], scenario.ticks], strict=True):
        if scenario.command[begin_tick]:
            bench.command(Command(int(scenario.command[begin_tick])))
        bench.demand(float(scenario.target[begin_tick]))
        bench.load(float(scenario.load[begin_tick]))
        table_blocks.append(bench.advance(int(end - begin_tick)))
    return np.concatenate(table_blocks)
