"""Sample the slave for tests with all kinds of DAQ lists, and by polling."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing
from pathlib import Path

import numpy as np
import pytest

from anhyst.support.numeric import FloatArray
from anhyst_rigs.link.foreign.variables import SlaveVariable
from anhyst_rigs.rig.bench.foreign import ForeignBench
from tests.link.foreign.slaves import RunningSlave, running
from tests.refusals import refused

Open = Callable[..., ForeignBench]


@pytest.fixture
def opened(program: Path, tmp_path: Path) -> Iterator[Open]:
    """Open benches of slaves with the given options."""
    with ExitStack() as stack:

        def open_bench(serial: bool = False, **options: int) -> ForeignBench:
            slave = stack.enter_context(running(program, serial, **options))
            description = slave.describe(tmp_path, big=bool(options.get("big")))
            bench = ForeignBench(slave.open, description, search_time=5.0)
            bench.slave = slave  # type: ignore[attr-defined]
            return stack.enter_context(closing(bench))

        yield open_bench


def take(bench: ForeignBench, count: int, seconds: float = 20.0) -> FloatArray:
    """Return at least `count` rows."""
    end, parts = time.monotonic() + seconds, [np.empty((0, 1 + len(bench.signals)))]
    while sum(map(len, parts)) < count:
        assert time.monotonic() < end, "too few rows"
        parts.append(bench.advance(1))
    return np.concatenate(parts)


def check_values(bench: ForeignBench, rows: FloatArray) -> None:
    """Compare each row with what the slave computes at its tick."""
    values = {signal.name: rows[:, 1 + n] for n, signal in enumerate(bench.signals)}
    tick = values["tick"]
    expected = {
        "sig_u8": tick % 256,
        "sig_i8": (-tick + 128) % 256 - 128,
        "sig_u16": 3 * tick % 65536,
        "sig_i16": 0.5 * ((-3 * tick + 32768) % 65536 - 32768) + 10,
        "sig_i32": -100000 * (tick % 10000) / 4,
        "sig_u64": 1000000007.0 * tick,
        "sig_i64": -1000000007.0 * tick,
        "sig_f32": 0.5 * tick,
        "sig_f64": -0.125 * tick,
    }
    for name, wanted in expected.items():
        if name in values:
            np.testing.assert_array_equal(values[name], wanted, err_msg=name)


KINDS = [
    {},
    {"big": 1},
    {"daq": 1},
    {"daq": 1, "big": 1, "identifier": 1},
    {"identifier": 1},
    {"identifier": 3, "big": 1},
    {"identifier": 4},
    {"dto": 8, "cto": 8},
    {"dto": 8, "cto": 8, "identifier": 1, "stamp": 2, "big": 1},
    {"dto": 8, "identifier": 4, "stamp": 4},
    {"dto": 1400, "cto": 255},
    {"entry_granularity": 4, "max_entry": 4},
    {"entry_granularity": 2, "max_entry": 2, "big": 1},
    {"max_entry": 1},
    {"stamp": 0},
    {"stamp": 2, "stamp_fixed": 1, "jitter_us": 400},
    {"stamp": 1},
    {"short_upload": 0, "event_info": 0},
    {"busy": 7},
]


@pytest.mark.parametrize("options", KINDS, ids=lambda kind: ",".join(f"{k}={v}" for k, v in kind.items()))
def test_rows_equal_what_the_slave_computes(opened: Open, options: dict[str, int]) -> None:
    """Every type arrives whole and in order, whatever the DAQ lists of the slave look like."""
    bench = opened(**options)
    assert len(bench.signals) == 10
    rows = take(bench, 200)
    check_values(bench, rows)
    assert bench.rate == pytest.approx(1000.0, rel=0.3 if options.get("stamp") == 0 else 0.01)
    assert np.all(np.diff(rows[:, 0]) == np.diff(rows[:, 1]))


def test_words_are_addressed_by_a_slave_with_word_granularity(opened: Open) -> None:
    """Addresses count words; a variable of one byte is refused, and the earlier choice remains."""
    bench = opened(granularity=2, entry_granularity=2, daq=2)
    names = ["tick", "sig_i16", "sig_f32"]
    bench.choose(names, ["par_level"], None)
    check_values(bench, take(bench, 50))
    bench.apply({"par_level": 3.5})
    assert bench.parameters()[0].value == 3.5
    with refused("xcp-granularity sig_u8"):
        bench.choose(["sig_u8"], [], None)
    assert [signal.name for signal in bench.signals] == names
    check_values(bench, take(bench, 50))


def test_a_slave_without_daq_lists_is_polled(opened: Open) -> None:
    """Each value is one of the slave's, at a rate that the line can carry; the page says so."""
    bench = opened(daq=0)
    rows = take(bench, 4)
    ticks = rows[:, 1]
    assert np.all(np.diff(ticks) > 0)
    assert np.median(np.diff(ticks)) / 1000.0 == pytest.approx(1.0 / bench.rate, rel=0.3)
    assert "not simultaneous" in bench.catalogue.sampling


def test_lost_samples_leave_gaps_and_no_mixed_rows(opened: Open) -> None:
    """A sample whose packet is lost is dropped as a whole, and its tick is missing."""
    bench = opened(dto=16, lose_sample=23)
    rows = take(bench, 200)
    check_values(bench, rows)
    steps = np.diff(rows[:, 0])
    np.testing.assert_array_equal(steps, np.diff(rows[:, 1]))
    assert steps.max() > 1.0


def test_samples_of_a_wrong_length_are_refused(opened: Open) -> None:
    """A slave whose samples are too short is refused when it is opened."""
    with refused("no-tick: too short"):
        opened(cut_sample=1)


def test_overload_bits_are_reported(opened: Open) -> None:
    """A marked identifier is no other ODT, and the log says that samples were dropped."""
    bench = opened(overload_bit=1)
    check_values(bench, take(bench, 400))
    assert any("dropped samples" in text for text in bench.take_messages())


def test_events_differ_in_their_period(opened: Open) -> None:
    """The slow event samples at a tenth of the rate; an event that never occurs is refused."""
    bench = opened()
    assert [event["name"] for event in bench.catalogue.events] == ["fast", "slow", "never"]
    bench.choose(["tick", "sig_f64"], [], 1)
    rows = take(bench, 20)
    assert bench.rate == pytest.approx(100.0, rel=0.01)
    assert set(np.diff(rows[:, 1])) == {10.0}
    with refused("no-tick: never"):
        bench.choose(["tick"], [], 2)
    assert bench.catalogue.event == 1
    assert set(np.diff(take(bench, 5)[:, 1])) == {10.0}


def test_a_wrong_stated_period_is_corrected_by_the_time_stamps(opened: Open) -> None:
    """The time axis follows the slave's clock, not the statement of its description."""
    bench = opened(stated_us=4000)
    assert bench.rate == pytest.approx(1000.0, rel=0.01)
    assert "stated: 0.004 s" in bench.catalogue.sampling


@pytest.mark.parametrize("one_extension", [0, 1])
def test_address_extensions_are_separate_memories(opened: Open, one_extension: int) -> None:
    """A variable of another extension is read from there, in an ODT of its own if necessary."""
    bench = opened(one_extension=one_extension)
    extra = SlaveVariable("bank", 0x104, "<u4", extension=1)
    bench.description.variables["bank"] = extra
    bench.choose(["tick", "bank", "sig_f64"], [], None)
    rows = take(bench, 50)
    np.testing.assert_array_equal(rows[:, 2], 7 * rows[:, 1])


def test_too_many_signals_for_the_lists_are_refused(opened: Open) -> None:
    """The message names the number of ODTs; the earlier signals continue."""
    bench = opened(daq=1, dto=12)
    names = [signal.name for signal in bench.signals]
    with refused("too-many-signals: choose fewer signals"):
        bench.choose([*bench.description.variables], [], None)
    assert [signal.name for signal in bench.signals] == names
    check_values(bench, take(bench, 20))


def test_lost_answers_are_repeated(opened: Open) -> None:
    """A lost answer costs a second, and no wrong value."""
    bench = opened(lose_answer=60)
    check_values(bench, take(bench, 20))
    bench.apply({"par_gain": 7.0})
    assert bench.parameters()[0].value == 7.0


def test_a_short_answer_names_the_command(opened: Open) -> None:
    """An answer with a missing byte is not used."""
    with refused("xcp-wrong-length: cannot read; the slave does not follow"):
        opened(cut_answer=1)


def test_protected_lists_need_a_key(opened: Open) -> None:
    """Without a key function, the message names the protection."""
    with refused("xcp-locked: seed and key; DAQ lists"):
        opened(locked=4)


def test_a_lost_slave_is_searched_for(opened: Open, program: Path) -> None:
    """A mute slave is reported as lost; after its return, rows continue with larger tick numbers."""
    bench = opened()
    last = take(bench, 50)[-1, 0]
    slave: RunningSlave = bench.slave  # type: ignore[attr-defined]
    os.kill(slave.process.pid, signal.SIGSTOP)
    end = time.monotonic() + 20.0
    while not bench.loss_reason:
        assert time.monotonic() < end
        bench.advance(1)
    assert "lost" in bench.take_messages()[-1]
    with running(program) as again:
        slave.url = again.url
        rows = take(bench, 20)
        assert rows[0, 0] > last + 500
        check_values(bench, rows)
        assert "back after" in bench.take_messages()[-1]


def test_a_serial_port_takes_as_many_samples_as_it_carries(opened: Open) -> None:
    """At 921600 baud, 55 bytes of 2 kHz fit only at every second event; the rows say which."""
    bench = opened(serial=True, period_us=500)
    rows = take(bench, 100)
    check_values(bench, rows)
    assert bench.ticks_per_row == 2
    assert set(np.diff(rows[:, 0])) == set(np.diff(rows[:, 1])) == {2.0}
