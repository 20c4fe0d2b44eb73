"""Test finite waves: a chirp and a user's table, and rejected tables with their line."""

from __future__ import annotations

import math

import numpy as np
import pytest

from anhyst_rigs.dashboard.generator import Chirp, read_wave_table
from anhyst_rigs.dashboard.session import LiveSession
from anhyst_rigs.rig.bench.bearing import BearingBench
from tests.live.conftest import Serve, wait_for
from tests.live.test_guard import meet, next_message, order
from tests.refusals import refused, says

RATE = 20_000.0


def test_a_chirp_spends_equal_times_per_octave() -> None:
    chirp = Chirp(2.0, 1.0, 16.0, 8.0, 1)
    time = np.arange(int(8.0 * RATE)) / RATE
    wave = np.array([chirp.value_at(1 + tick, RATE) for tick in range(len(time))])
    assert np.abs(wave).max() == pytest.approx(2.0, abs=1e-4)
    rises = time[1:][(wave[:-1] < 0.0) & (wave[1:] >= 0.0)]
    seen = 1.0 / np.diff(rises)
    middle = 0.5 * (rises[:-1] + rises[1:])
    assert np.allclose(seen, 2.0 ** (middle / 2.0), rtol=0.03)


def test_a_chirp_of_one_frequency_is_a_sine_and_chirps_may_fall() -> None:
    assert Chirp(1.0, 2.0, 2.0, 3.0, 0).value_at(2500, RATE) == pytest.approx(math.sin(math.pi / 2))
    down = Chirp(1.0, 16.0, 1.0, 8.0, 0)
    assert abs(down.value_at(int(RATE / 64), RATE) - 1.0) < 0.01


@pytest.mark.parametrize(
    ("numbers", "why"),
    [
        ((-1.0, 1.0, 9.0, 5.0), "out-of-range amplitude"),
        ((1.0, 0.0, 9.0, 5.0), "out-of-range frequency"),
        ((1.0, 1.0, 5000.0, 5.0), "out-of-range frequency: 5000 Hz"),
        ((1.0, 0.1, 9.0, 5.0), "out-of-range lasts"),
        ((math.nan, 1.0, 9.0, 5.0), "out-of-range amplitude"),
    ],
)
def test_a_chirp_that_is_refused(numbers: tuple[float, float, float, float], why: str) -> None:
    with refused(why):
        Chirp(*numbers, 0)


def test_a_table_is_read_in_its_units_and_straight_between_rows() -> None:
    table = read_wave_table("# mine\nt_ms, gap [µm]\n0, 0\n\n10, -20\n30, 5\n", "m", 1)
    assert (table.duration_s, table.range) == (0.03, (-20e-6, 5e-6))
    assert table.value_at(1 + 100, RATE) == pytest.approx(-10e-6)
    assert table.value_at(1 + 400, RATE) == pytest.approx(-7.5e-6)
    assert read_wave_table("t_s,F_kN\n0,1\n1,2", "N", 0).range == (1000.0, 2000.0)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("", "no-data"),
        ("t,gap\n0,0\n1,1", "no-header: line 1"),
        ("t_s,F_N\n0,0\n1,1", "no-header: line 1; length"),
        ("t_s,gap_um,x_m\n0,0,0", "no-header: line 1"),
        ("t_s,gap_um\n0,0\n1,many\n", "not-a-number"),
        ("t_s,gap_um\n0,0\n#\n1,1,1\n", "fields-missing: line 4"),
        ("t_s,gap_um\n0,0\n2,1\n2,1\n", "time-not-rising"),
        ("t_s,gap_um\n1,0\n2,1\n", "time-not-from-zero"),
        ("t_s,gap_um\n0,nan\n2,1\n", "not-finite"),
        ("t_s,gap_um\n0,1\n", "rows-out-of-range"),
        ("t_s,gap_um\n0,1\n1e6,2", "rows-out-of-range"),
    ],
)
def test_a_table_that_is_refused_names_the_line(text: str, why: str) -> None:
    with refused(why):
        read_wave_table(text, "m", 0)


def test_a_table_moves_the_target_and_returns_it(bench: BearingBench) -> None:
    session = LiveSession(bench)
    try:
        text = "t_s,gap_um\n0,0\n0.01,-20\n0.02,-20\n"
        session.run_between_chunks(
            lambda: session.generate(read_wave_table(text, "m", session.bench.tick + 1))
        )
        session.pacer.step(2000)
        wait_for(lambda: session.bench.tick == 2000)
        assert session.status()["generator"] is None
        assert session.log[-1].text == "generator off: it is over"
        with refused("out-of-range"):
            session.run_between_chunks(
                lambda: session.generate(Chirp(1.0, 1.0, 9.0, 5.0, session.bench.tick + 1))
            )
    finally:
        session.close()


def test_a_page_starts_both(serve: Serve) -> None:
    served = serve()
    with meet(served) as line:
        next_message(line, "bench")
        fields = {"amplitude": 1e-5, "low": 1.0, "high": 20.0, "lasts": 5.0}
        assert "reason" not in order(line, "generator", shape="chirp", **fields)
        wait_for(lambda: (served.session.status()["generator"] or {}).get("shape") == "chirp")
        answer = order(line, "generator", shape="own CSV", text="t_s,gap_um\n0,0\nx,1\n")
        assert says(answer["reason"], "not-a-number: line 3; 'x'")
        rows = "".join(f"{n / 100},{n % 7}\n" for n in range(1200))
        assert "reason" not in order(line, "generator", shape="own CSV", text=f"t_s,gap_um\n{rows}")
