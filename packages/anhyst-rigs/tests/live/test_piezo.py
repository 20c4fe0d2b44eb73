"""Test a piezo stage on the page and the command line: driven, switched, recorded, stopped."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from websockets.sync.client import connect
from websockets.typing import Origin

import anhyst
from anhyst.cli.app import main
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray, rms
from anhyst.support.states import Command, State
from anhyst_rigs.dashboard.generator import PeriodicWave
from anhyst_rigs.dashboard.serving import open_prepared
from anhyst_rigs.dashboard.session import LiveSession
from anhyst_rigs.study import bench as opening
from anhyst_rigs.study.bench import prepare_cached
from anhyst_rigs.study.prepared_benches import PreparedPiezo
from tests.cli.command import unwrapped
from tests.live.conftest import Serve, Show, wait_for
from tests.live.test_page import last, press, ready, seen, state_is, until
from tests.live.test_recorder import numbers
from tests.study import piezos

if TYPE_CHECKING:
    from playwright.sync_api import Page

RIG = piezos.EXAMPLE / "rig.toml"


def test_a_generator_adds_to_the_triangle_and_is_refused_beyond_the_stack() -> None:
    session = LiveSession(open_prepared(piezos.prepared())[0])
    rows: list[FloatArray] = []
    session.subscribe(rows.append)
    names = [signal.name for signal in session.bench.signals]
    try:
        session.start()
        session.run_between_chunks(lambda: session.bench.command(Command.RUN))
        session.run_between_chunks(
            lambda: session.generate(PeriodicWave("sine", 2e-6, 5.0, session.bench.tick + 1))
        )
        wait_for(lambda: session.bench.tick > 6000)
        place = np.concatenate(rows)[3000:, 1 + names.index("position")]
        assert place.max() > 34.5e-6
        assert session.status()["next"] == ""
        assert session.status()["refused"]["run"]
        session.run_between_chunks(
            lambda: session.generate(PeriodicWave("sine", 4e-6, 5.0, session.bench.tick + 1))
        )
        session.run_between_chunks(lambda: session.bench.demand(8e-6))
        wait_for(lambda: session.status()["generator"] is None)
        assert "lower the offset or the stroke" in session.log[-1].text
        assert session.status()["state"] == State.RUN
    finally:
        session.close()


def check_offset_names(page: Page) -> None:
    legends = page.locator("#panel legend").all_inner_texts()
    assert "Offset of the motion" in legends
    assert "Target" not in legends
    assert page.locator("#step-up").get_attribute("title") == "Raise the offset of the motion by this height"
    page.keyboard.press("3")
    until(page, "document.getElementById('steps').textContent.includes('a running motion has none')")


def check_gauge(page: Page) -> None:
    ends = page.evaluate(
        """async () => {
          const { gauge } = await import("/assets/instruments.js");
          const { element, draw } = gauge(anhyst.context, { signal: "reference" }, () => {});
          draw();
          return element.querySelector(".ends").textContent;
        }"""
    )
    assert ends == "0 µm50 µm"  # the reference reaches 34 µm


@pytest.mark.slow
@pytest.mark.needs("chromium")
def test_it_is_driven_switched_and_recorded_on_the_page(serve: Serve, show: Show, tmp_path: Path) -> None:
    record = tmp_path / "run.csv"
    served = serve(prepared=piezos.prepared(), record=record)
    page = show(served)
    ready(page)
    state_is(page, "ready")
    tabs = [tab.text_content() for tab in page.locator("#tabs button").all() if tab.is_visible()]
    assert [str(tab).split()[1] for tab in tabs] == [
        "Scope", "Loop", "Steps", "Parameters", "Log", "Spectrum",
    ]  # fmt: skip
    assert "Run" in page.locator("#next").inner_text()
    check_offset_names(page)
    assert seen(page, "[...page.scope.plot.names]") == ["error", "force", "voltage"]
    press(page, "run")
    state_is(page, "run")
    until(page, "document.getElementById('next').textContent === ''")
    wait_for(lambda: last(page, "lap") > 4)
    check_gauge(page)
    page.locator("body").press("c")
    until(page, "document.getElementById('compensation').textContent === 'Off (C)'")
    off = served.session.last_applied_tick
    wait_for(lambda: served.session.bench.tick > off + 5000)
    page.keyboard.press("2")
    until(page, "window.anhyst.views.get('loop')?.drawn?.ticks.length > 1000")
    shown = page.locator("#loop").inner_text()
    assert "position − demand: rms" in shown
    assert " nm" in shown
    page.keyboard.press("6")
    assert not page.locator("#improve").is_visible()
    page.keyboard.press("Escape")
    state_is(page, "ready")
    page.locator("#target").fill("10")
    page.locator("#go").click()
    until(page, "document.querySelector('#panel').innerText.includes('now 10 µm')")
    until(page, "document.getElementById('log').textContent.includes('Offset of the motion 10 µm')")
    tick = served.session.bench.tick
    wait_for(lambda: served.session.bench.tick > tick + 3000)
    served.end()
    rows = numbers(record)
    names = [signal.name for signal in served.session.bench.signals]
    error = rows[:, 2 + names.index("error")]
    lap = rows[:, 2 + names.index("lap")]
    assert np.array_equal(rows[:, 0], np.arange(1, len(rows) + 1))
    assert rms(error[off - 3001 : off - 1]) < 0.2 * rms(error[off + 999 : off + 3999])
    assert lap[off - 1] == lap[off - 2] + 1.0  # the switch is at the start of a period
    assert np.abs(np.diff(rows[:, 2 + names.index("voltage")])[off - 3 : off + 1]).max() < 1.0
    notes = [line for line in record.read_text().splitlines() if line.startswith("#")]
    for text in ("run", "compensation = 0", "emergency stop", "offset of the motion"):
        assert any(text in line for line in notes), text
    columns = {"t_s": rows[:, 1], "U_V": rows[:, 2 + names.index("voltage")],
               "x_m": rows[:, 2 + names.index("position_read")]}  # fmt: skip
    whole = {name: values[lap == 3.0] for name, values in columns.items()}
    (loop,) = anhyst.read_loops(whole).loops
    assert np.ptp(loop.output) == pytest.approx(30e-6, rel=0.03)


@pytest.mark.slow
def test_a_rig_is_prepared_once_and_again_after_a_change(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    rig = tmp_path / "rig.toml"
    rig.write_text(RIG.read_text(encoding="utf-8"), encoding="utf-8")
    with prepare_cached(rig, None) as first:
        assert isinstance(first, PreparedPiezo)
    prepares: list[object] = []

    def again(*given: object) -> PreparedPiezo:
        prepares.append(given)
        return first

    monkeypatch.setattr(opening, "prepare_bench", again)
    with prepare_cached(rig, None) as second:
        assert isinstance(second, PreparedPiezo)
        assert prepares == []
        benches = first.open(), second.open()
    for bench in benches:
        bench.command(Command.RUN)
    assert np.array_equal(benches[0].advance(500), benches[1].advance(500))
    rig.write_text(rig.read_text(encoding="utf-8") + "\n", encoding="utf-8")
    with prepare_cached(rig, None):
        assert len(prepares) == 1
    with pytest.raises(InputError, match="a piezo stage has no controller"), prepare_cached(rig, rig):
        pass  # it is cached, but must still be rejected


@pytest.mark.slow
def test_the_command_records_the_bench_and_inspect_reads_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "run.csv"
    command = [sys.executable, "-m", "anhyst.cli.app", "live", str(RIG), "--listen", "0"]
    with subprocess.Popen(
        [*command, "--record", str(path)],
        stdout=subprocess.PIPE,
        text=True,
        env=os.environ | {"XDG_CACHE_HOME": str(tmp_path / "cache")},
    ) as process:
        try:
            assert process.stdout is not None
            address = process.stdout.readline().split()[0].removesuffix("/")
            assert "the rig runs\n" in process.stdout  # reads until this line
            # The page answers before the bench runs. A command at that time would be recorded at
            # tick 0.
            wait_for(lambda: path.is_file() and path.stat().st_size > 1e5)
            with connect(f"ws{address[4:]}/live", origin=Origin(address), max_size=None) as line:
                line.send(json.dumps({"do": "command", "name": "run", "id": 1}))
                at_rest = path.stat().st_size  # its size depends on the load of the machine
                wait_for(lambda: path.stat().st_size > at_rest + 2e6)
        finally:
            process.send_signal(signal.SIGINT)
        assert f"written: {path}" in unwrapped(process.stdout.read())
    assert process.returncode == 0
    rows = numbers(path)
    (begun,) = np.flatnonzero(np.diff(rows[:, -1]) == 1.0)[:1]  # start of the first period
    bench = piezos.bench()
    same = [bench.advance(int(begun) + 1)]
    bench.command(Command.RUN)
    same.append(bench.advance(len(rows) - int(begun) - 1))
    assert np.array_equal(np.delete(rows, 1, axis=1), np.concatenate(same))
    given = ["--columns", "position_read_m=x_m", "--loop", "lap"]
    assert main(["inspect", str(path), *given]) == 0
    # The jump to the first position excites the stage's resonance at 480 Hz. The time of rest
    # afterwards depends on the machine, so the recording is cut there.
    assert begun > 400
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    path.write_text("".join(lines[:401]), encoding="utf-8")
    capsys.readouterr()
    assert main(["inspect", str(path), *given]) == 0
    assert "the output resonates near 48" in unwrapped(capsys.readouterr().out)
