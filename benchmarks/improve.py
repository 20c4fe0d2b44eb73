"""Improve the model of a running bench with an unknown iron, and detect a change of the iron."""

from __future__ import annotations

import os
import shutil
import tempfile
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from anhyst.data.reading import read_loops
from anhyst.support.numeric import FloatArray
from anhyst.support.states import Command, State
from anhyst_rigs.dashboard.improver import Improver
from anhyst_rigs.dashboard.orders import perform
from anhyst_rigs.dashboard.session import LiveSession
from anhyst_rigs.rig.bench.force import ForceBench
from anhyst_rigs.rig.bench.protocol import Bench
from anhyst_rigs.rig.force.file import read_rig
from anhyst_rigs.study.bench import prepare_bench
from anhyst_rigs.study.force_control import build_program
from anhyst_rigs.study.improve import MONITOR_RATE_HZ, BenchMonitor
from anhyst_rigs.study.prepared_benches import PreparedForce
from rows import ROOT, Row

SOLENOID = ROOT / "examples" / "solenoid"
PINNING_RATIO = 1.6
"""Ratio of the pinning of the unknown iron to that of the iron in the controller's model."""
MAX_TOTAL_S = 90.0
MAX_OFF_LINE_RATIO = 1.1
"""Largest permitted ratio of the force error to that of an off-line model from the same loops."""
LEARNING_CYCLES = 15
"""Number of cycles of 1 s before the pinning of the iron increases."""
HOUR = 3600


def rows() -> list[Row]:
    """Improve the model of the bundled solenoid with another iron; then test the drift monitor."""
    with tempfile.TemporaryDirectory() as folder_name:
        folder = Path(folder_name) / "rig"
        shutil.copytree(SOLENOID, folder)
        known_controller = prepare_bench(folder / "rig.toml", None, Path(folder_name) / "known")
        assert isinstance(known_controller, PreparedForce)
        unknown_iron = scale_pinning(known_controller, PINNING_RATIO)
        return [
            *measure_improvement(unknown_iron, Path(folder_name)),
            measure_drift_detection(known_controller),
            measure_false_alarms(known_controller),
        ]


def scale_pinning(prepared_bench: PreparedForce, factor: float) -> PreparedForce:
    """Return the same controller on an iron whose pinning is multiplied by a factor."""
    file = prepared_bench.complete_rig.solenoid_file
    assert file is not None
    pinning_scale = file.iron.pinning_scale_A_per_m * factor  # type: ignore[union-attr]
    iron = file.iron.model_copy(update={"pinning_scale_A_per_m": pinning_scale})
    changed_file = file.model_copy(update={"iron": iron})
    return replace(
        prepared_bench, complete_rig=replace(prepared_bench.complete_rig, solenoid_file=changed_file)
    )


def measure_improvement(prepared_bench: PreparedForce, build_folder: Path) -> list[Row]:
    """Measure, identify, compile and swap with page commands; compare with an off-line model."""
    bench = prepared_bench.open()
    session = LiveSession(bench, improver=Improver(prepared_bench, bench))
    improver = session.improver
    assert improver is not None
    error_before = session.run_between_chunks(lambda: force_error(bench))
    session.start()
    step_seconds = {}
    for step in ("measure", "identify", "compile", "swap"):
        start_time = time.monotonic()
        page_command = {"do": "improve", "step": step}
        session.run_between_chunks(partial(perform, session, "benchmark", page_command))
        while improver.status()["step"]:
            time.sleep(0.02)
        assert step in improver.results, improver.status()["trouble"]
        step_seconds[step] = time.monotonic() - start_time
    session.pacer.pause()
    slips = session.pacer.pacing().slip_count
    error_after = session.run_between_chunks(lambda: force_error(bench))
    loops = read_loops(improver.folder / "loops.csv")
    model = prepared_bench.identify(loops)
    session.close()
    program = build_program(
        "full",
        model,
        prepared_bench.complete_rig.settings.timing.rate_Hz,
        "library",
        build_folder / "off-line",
    )
    off_line_bench = replace(prepared_bench, program=program).open()
    off_line_error = force_error(off_line_bench)
    off_line_bench.close()
    total_seconds = sum(step_seconds.values())
    step_texts = ", ".join(f"{step} {seconds:.1f} s" for step, seconds in step_seconds.items())
    return [
        Row(
            "virtual solenoid, unknown pinning: measure, identify (auto), compile, swap during operation",
            f"<= {MAX_TOTAL_S:g} s in total",
            f"{total_seconds:.0f} s on {os.cpu_count()} cores: {step_texts}; {slips} pacing slips",
            total_seconds <= MAX_TOTAL_S,
        ),
        Row(
            "virtual solenoid, force error after the swap, 7 gaps",
            f"<= {MAX_OFF_LINE_RATIO:g} times that of an off-line model from the same loops",
            f"rms {error_after:.3f} N, off line {off_line_error:.3f} N; before {error_before:.3f} N",
            error_after <= MAX_OFF_LINE_RATIO * off_line_error,
        ),
    ]


def force_error(bench: ForceBench) -> float:
    """Return the rms force error, N, over several gaps; each starts with conditioning."""
    gaps = next(parameter for parameter in bench.parameters() if parameter.name == "gap")
    errors = []
    for gap in np.linspace(gaps.low, gaps.high, 7):
        if advance_and_read_state(bench) is State.RUN:
            bench.command(Command.IDLE)
        advance_until(bench, State.IDLE)
        bench.apply({"gap": float(gap)})
        bench.advance(200)
        bench.command(Command.CONDITION)
        advance_until(bench, State.READY)
        bench.command(Command.RUN)
        for force in (32.0, 6.0, 25.0, 12.0, 32.0, 2.0):
            bench.demand(force)
            errors.append(read_signal(bench, bench.advance(300)[150:], "force") - force)
    return float(np.sqrt(np.mean(np.square(np.concatenate(errors)))))


def advance_until(bench: Bench, target_state: State) -> None:
    """Advance the bench until it is in a state."""
    for _ in range(400):
        if advance_and_read_state(bench) is target_state:
            return
    raise AssertionError(f"never {target_state.name}")


def advance_and_read_state(bench: Bench) -> State:
    """Advance the bench by 50 ticks and return its state."""
    return State(int(read_signal(bench, bench.advance(50), "state")[-1]))


def read_signal(bench: Bench, table: FloatArray, name: str) -> FloatArray:
    """Return a signal from rows of the bench."""
    return table[:, 1 + [signal.name for signal in bench.signals].index(name)]


def run_cycles(prepared_bench: PreparedForce, cycles: int) -> FloatArray:
    """Return the rows of a bench whose force alternates between two values once a second."""
    bench = prepared_bench.open()
    bench.advance(50)
    bench.command(Command.DEMAGNETISED)
    bench.command(Command.RUN)
    low_force, high_force, half_period = 5.0, 35.0, round(0.5 * bench.rate)
    bench.apply({"demand_slew": 2.4 * (high_force - low_force)})
    chunks = []
    for _ in range(cycles):
        for force in (high_force, low_force):
            bench.demand(force)
            chunks.append(bench.advance(half_period))
    bench.close()
    return np.concatenate(chunks)


def measure_drift_detection(prepared_bench: PreparedForce) -> Row:
    """Test whether the monitor detects an iron whose pinning increases by 20 % at a tick."""
    rate = prepared_bench.complete_rig.settings.timing.rate_Hz
    change_tick = round(LEARNING_CYCLES * rate)
    usual_rows, pinned_rows = (
        run_cycles(prepared_bench, LEARNING_CYCLES + 15),
        run_cycles(scale_pinning(prepared_bench, 1.2), LEARNING_CYCLES + 15),
    )
    monitor_without_drift = BenchMonitor(prepared_bench.model, ForceBench.signals, rate)
    monitor_without_drift.add_rows(usual_rows)
    monitor, ticks = BenchMonitor(prepared_bench.model, ForceBench.signals, rate), 0
    monitor.add_rows(usual_rows[:change_tick])
    for row in np.array_split(pinned_rows[change_tick:], 15 * 20):
        monitor.add_rows(row)
        ticks += len(row)
        if monitor.status()["state"] == "drifted":
            break
    status = monitor.status()
    seconds = ticks / rate
    is_met = (
        status["state"] == "drifted" and seconds <= 10.0 and monitor_without_drift.status()["state"] == "fits"
    )
    return Row(
        "drift monitor on the rows of the bench: pinning +20 %, cycles of 1 Hz",
        "detected within 10 s of motion",
        f"after {seconds:.1f} s; residual {status['left_N']:.3f} N rms instead of "
        f"{status['usual_N']:.3f} N; without drift: {monitor_without_drift.status()['text']}",
        is_met,
    )


def measure_false_alarms(prepared_bench: PreparedForce) -> Row:
    """Test for false alarms during one hour of a steady-state cycle with noise of all sensors."""
    rate = prepared_bench.complete_rig.settings.timing.rate_Hz
    step_ticks = round(rate / MONITOR_RATE_HZ)
    second_ticks = round(rate)
    cycle_rows = run_cycles(prepared_bench, 6)[-second_ticks::step_ticks]
    signal_index = [signal.name for signal in ForceBench.signals].index
    true_values = [cycle_rows[:, 1 + signal_index(name)] for name in ("current", "gap", "force")]
    sensors = read_rig(prepared_bench.rig).make_sensors([9], step_ticks / rate)
    read_sensors = [sensors[name] for name in ("current", "gap", "force")]
    read_columns = [1 + signal_index(name) for name in ("current_read", "gap_read", "force_read")]
    monitor = BenchMonitor(prepared_bench.model, ForceBench.signals, rate)
    alarm = ""
    for elapsed_s in range(HOUR):
        table = cycle_rows.copy()
        table[:, 0] = elapsed_s * second_ticks + step_ticks * np.arange(1, len(cycle_rows) + 1)
        for column, sensor, values in zip(read_columns, read_sensors, true_values, strict=True):
            table[:, column] = sensor.read(values)
        monitor.add_rows(table)
        if monitor.status()["state"] == "drifted":
            alarm = monitor.status()["text"]
            break
    status = monitor.status()
    return Row(
        "drift monitor, one hour of noise",
        "no false alarm",
        alarm or f"none in {status['cycles']} cycles; specified: one in {status['run_length']:g}",
        not alarm and status["cycles"] >= HOUR - 5,
    )
