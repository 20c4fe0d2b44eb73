"""Test derived signals: their values, what is refused, and that recordings contain them."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import butter, lfilter

from anhyst.support.numeric import FloatArray
from anhyst_rigs.dashboard.derived import MAX_DERIVED_SIGNALS, DerivedSignal, DerivedSignals
from anhyst_rigs.dashboard.recording import RecordingSpan, TickRecorder
from anhyst_rigs.rig.bench.protocol import Signal
from tests.live.test_recorder import numbers
from tests.refusals import refused

RATE = 1000.0
SIGNALS = (Signal("gap", "m", "true gap"), Signal("force", "N", "force"), Signal("current", "A", "current"))


def make_rows(count: int) -> FloatArray:
    ticks = np.arange(1.0, count + 1)
    return np.column_stack((ticks, 1e-4 * np.sin(ticks / 30.0), np.cos(ticks / 7.0), 2.0 + ticks / count))


def evaluate(expression: str, rows: FloatArray, chunk: int) -> FloatArray:
    derived = DerivedSignals(SIGNALS, RATE, [DerivedSignal("result", "", expression)])
    parts = [derived.extend(rows[n : n + chunk]) for n in range(0, len(rows), chunk)]
    values: FloatArray = np.concatenate(parts)[:, -1]
    return values


def test_an_expression_is_calculated_from_signals_with_or_without_units() -> None:
    rows = make_rows(100)
    expected = rows[:, 2] * rows[:, 3] - 2.0**0.5
    for expression in ("force_N * current_A - 2 ** 0.5", "force*current - sqrt(2)", "F_N*I_A - 2**0.5"):
        assert np.allclose(evaluate(expression, rows, 100), expected)
    assert np.allclose(evaluate("max(force, 0)", rows, 9), np.maximum(rows[:, 2], 0.0))


@pytest.mark.parametrize(
    "expression", ["derivative(gap)", "lowpass(force, 50)", "highpass(force, 5)", "rms(force, 0.02)"]
)
def test_filters_do_not_depend_on_the_division_into_chunks(expression: str) -> None:
    rows = make_rows(500)
    whole = evaluate(expression, rows, 500)
    for chunk in (1, 7, 100):
        assert np.allclose(evaluate(expression, rows, chunk), whole, equal_nan=True)


def test_filters_equal_their_definitions() -> None:
    rows = make_rows(4000)
    slope = evaluate("derivative(gap)", rows, 100)
    assert np.allclose(slope[1:], np.diff(rows[:, 1]) * RATE)
    assert np.isnan(slope[0])
    rms = evaluate("rms(force, 0.05)", rows, 33)
    assert np.allclose(rms[100:], [np.sqrt(np.mean(rows[n - 49 : n + 1, 2] ** 2)) for n in range(100, 4000)])
    smooth = evaluate("lowpass(force, 5)", rows, 64)
    numerator, denominator = butter(1, 5.0, fs=RATE)
    assert np.allclose(smooth[2000:], lfilter(numerator, denominator, rows[:, 2])[2000:], atol=0.02)


@pytest.mark.parametrize(
    ("expression", "remedy"),
    [
        ("force *", "cannot be read"),
        ("__import__('os')", "is not one of"),
        ("force.real", "may contain"),
        ("[force for x in y]", "may contain"),
        ("forse", "is not a signal"),
        ("lowpass(force)", "has 2 arguments"),
        ("lowpass(force, 900)", "not within 0 to 500 Hz"),
        ("rms(force, 5)", "not within 0 to 1 s"),
        ("rms(force, gap)", "must be a number"),
        ("(" * 150 + "force" + ")" * 30, "cannot be read"),
        ("'text'", "must be a number"),
        ("9**9**9", "never a finite number"),
        ("force / 0", "never a finite number"),
        ("sqrt(-1 - abs(gap))", "never a finite number"),
    ],
)
def test_other_expressions_are_refused_with_a_remedy(expression: str, remedy: str) -> None:
    derived = DerivedSignals(SIGNALS, RATE)
    with refused(f"bad-expression: {remedy}"):
        derived.define(DerivedSignal("result", "", expression))
    assert derived.definitions == ()


def test_names_are_unique_and_their_number_is_limited() -> None:
    derived = DerivedSignals(SIGNALS, RATE)
    for name, code in (("gap", "exists-already"), ("Power", "bad-name"), ("a b", "bad-name")):
        with refused(code):
            derived.define(DerivedSignal(name, "W", "force"))
    for n in range(MAX_DERIVED_SIGNALS):
        derived.define(DerivedSignal(f"one_{n}", "", "force"))
    with refused("too-many-signals"):
        derived.define(DerivedSignal("another", "", "force"))
    derived.delete("one_3")
    with refused("no-such-signal"):
        derived.delete("one_3")


@pytest.mark.parametrize("expression", ["force / current", "sqrt(force - 1000)", "derivative(gap)"])
def test_a_signal_may_be_finite_later(expression: str) -> None:
    assert np.isnan(evaluate(expression, np.zeros((1, 4)), 1)).all()  # and is not refused


def test_a_value_without_a_result_is_nan() -> None:
    rows = make_rows(10)
    rows[3, 3] = 0.0
    values = evaluate("force / current", rows, 10)
    assert np.isnan(values[3])
    assert np.isfinite(np.delete(values, 3)).all()


def test_a_mean_omits_values_without_a_result() -> None:
    rows = make_rows(500)
    values = evaluate("mean(derivative(force), 0.05)", rows, 30)
    assert np.isnan(values[0])
    assert np.all(np.isfinite(values[1:]))


def test_a_recording_contains_the_derived_signals_of_its_start(tmp_path: Path) -> None:
    derived = DerivedSignals(SIGNALS, RATE)
    recorder = TickRecorder(SIGNALS, RATE, tmp_path, lambda _: None, derived)
    derived.define(DerivedSignal("power", "W", "lowpass(force * current, 20)"))
    rows = make_rows(3000)
    recorder._buffer_rows(rows[:2000])  # rows before the recording starts
    recorder.start("run.csv", RecordingSpan(0.5, 0.5), 2000)
    derived.delete("power")  # does not change the recording that runs
    recorder._buffer_rows(rows[2000:])
    deadline = time.monotonic() + 10.0
    while recorder.status() is not None and time.monotonic() < deadline:
        recorder._write_waiting_rows()
    head = (tmp_path / "run.csv").read_text().splitlines()[0]
    assert head == "tick,t_s,gap_m,F_N,I_A,power_W"
    recorded = numbers(tmp_path / "run.csv")
    expected = evaluate("lowpass(force * current, 20)", rows, 3000)
    index = recorded[:, 0].astype(int) - 1
    assert np.allclose(recorded[:, -1], expected[index], atol=1e-9)
