"""Test the rows sent to a page: no spike is lost, and no page makes the bench wait."""

from __future__ import annotations

import struct

import numpy as np

from anhyst.support.numeric import FloatArray
from anhyst_rigs.dashboard.browsers import MAX_FRAME_ROWS, RowQueue, RowRun, encode_frame, thin_to_extremes


def rows(first: int, count: int) -> FloatArray:
    ticks = np.arange(first, first + count, dtype=float)
    return np.column_stack((ticks, np.sin(ticks / 50.0), np.zeros(count)))


def test_a_spike_of_one_tick_survives_any_thinning() -> None:
    outbox = RowQueue()
    for n in range(500):
        block = rows(1 + 1000 * n, 1000)
        if n == 123:
            block[456, 2] = -7.0
        outbox.put(block)
    (run,) = outbox.take_all()
    assert (run.first_tick, run.last_tick, run.is_thinned) == (1, 500_000, True)
    assert run.rows[:, 2].min() == -7.0
    assert np.count_nonzero(run.rows[:, 2]) == 1
    assert np.all(np.diff(run.rows[:, 0]) >= 0.0)


def test_a_stalled_page_queues_a_bounded_number_of_rows() -> None:
    outbox = RowQueue()
    for n in range(2000):
        outbox.put(rows(1 + 1000 * n, 997))  # three ticks are missing each time
        assert outbox.waiting <= MAX_FRAME_ROWS
    runs = outbox.take_all()
    assert len(runs) < 100
    assert runs[-1].last_tick == 1999 * 1000 + 997


def test_a_page_that_keeps_up_gets_every_row() -> None:
    outbox, got = RowQueue(), []
    for n in range(50):
        outbox.put(rows(1 + 333 * n, 333))
        got += outbox.take_all()
    assert not any(run.is_thinned for run in got)
    assert np.array_equal(np.concatenate([run.rows for run in got]), rows(1, 50 * 333))


def test_missing_ticks_begin_another_run() -> None:
    outbox = RowQueue()
    outbox.put(np.delete(rows(1, 100), slice(40, 45), axis=0))
    assert [(run.first_tick, run.last_tick) for run in outbox.take_all()] == [(1, 40), (46, 100)]


def test_a_frame_encodes_all_values_of_the_run() -> None:
    block = rows(10**9, 5)
    data = encode_frame(RowRun(10**9, 10**9 + 4, block, False))
    assert struct.unpack_from("<IIdd", data) == (5, 2, 1e9, 1e9 + 4)
    assert np.array_equal(np.frombuffer(data, "<f8", 5, 24), block[:, 0])
    columns = np.frombuffer(data, "<f4", 10, 64).reshape(2, 5)
    assert np.array_equal(columns, block[:, 1:].T.astype("f4"))
    assert len(data) == 64 + 40 + 4


def test_thinning_keeps_the_extremes_of_each_stretch() -> None:
    block = rows(1, 1000)
    pairs = thin_to_extremes(block, 10)
    assert len(pairs) == 10
    for n, stretch in enumerate(np.split(block, 5)):
        assert np.array_equal(pairs[2 * n], stretch.min(axis=0))
        assert np.array_equal(pairs[2 * n + 1], stretch.max(axis=0))
