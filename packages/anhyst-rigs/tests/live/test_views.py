"""Test the loop, levitation and spectrum views against the recording and against SciPy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.signal import welch

from anhyst_rigs.study.improve import make_drawn_loops
from tests.live.conftest import Serve, Show
from tests.live.test_page import lift, ready, seen, until
from tests.live.test_recorder import numbers
from tests.study import bearings

pytestmark = pytest.mark.needs("chromium")


@pytest.mark.slow
def test_loop_and_levitation_views_agree_with_the_recording(serve: Serve, show: Show, tmp_path: Path) -> None:
    record = tmp_path / "run.csv"
    known = bearings.knowledge()
    served = serve(record=record, curves=make_drawn_loops(known.loops, known.model))
    page = show(served)
    lift(page, served)
    page.keyboard.press("2")
    until(page, "window.anhyst.views.get('loop')?.drawn?.ticks.length > 1000")
    drawn = seen(page, "page.views.get('loop').drawn")
    assert "the model's green" in page.locator("#loop").inner_text()
    page.get_by_role("tab", name="levitation").click()
    until(page, "window.anhyst.views.get('levitation')?.standstill > 0")
    page.locator("#pause").click()
    until(page, "document.getElementById('pause').textContent === 'Continue'")
    page.wait_for_timeout(500)
    standstill, newest = seen(page, "[page.views.get('levitation').standstill, page.store.newest]")
    assert "hover, run" in page.locator("#levitation").inner_text()
    served.end()
    rows = numbers(record)
    names = [signal.name for signal in served.session.bench.signals]
    column = {name: rows[:, 2 + names.index(name)] for name in names}
    at = np.array(drawn["ticks"], dtype=int) - 1
    for name, key in (("current", "currents"), ("force", "forces")):
        assert np.array_equal(drawn[key], column[name][at].astype("f4"))
    stood = slice(int(newest) - 10_000 - 1, int(newest))
    errors = column["gap"][stood].astype("f4") - column["reference"][stood].astype("f4")
    assert standstill == pytest.approx(1e9 * np.std(errors), rel=1e-3)


@pytest.mark.slow
def test_the_spectrum_is_that_of_scipy(serve: Serve, show: Show) -> None:
    page = show(serve())
    ready(page)
    noise = np.random.default_rng(3).normal(0.0, 1e-6, 4096)
    samples = 450e-6 + noise + 1e-6 * np.sin(0.3 * np.arange(4096))
    for name, window in (("Hann", "hann"), ("flat top", "flattop"), ("none", "boxcar")):
        found = page.evaluate(
            """async ([samples, name]) => {
              const { WINDOWS, density } = await import("/assets/fft.js");
              return density(samples, 20000, 1024, WINDOWS[name]);
            }""",
            [samples.tolist(), name],
        )
        frequencies, power = welch(samples, 20000.0, window=window, nperseg=1024, detrend="constant")
        assert np.allclose(found["frequencies"], frequencies[1:])
        assert np.allclose(found["densities"], np.sqrt(power[1:]), rtol=1e-9, atol=0.0)
    page.get_by_role("tab", name="spectrum").click()
    until(page, "window.anhyst.views.get('spectrum')?.found")
    page.locator("#spectrum canvas").hover()
    until(page, "document.getElementById('spectrum-reading').textContent.includes('nm/√Hz')")
