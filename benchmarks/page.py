"""Measure the live page in a real browser: frame rate, server load, delays and a long run.

``python benchmarks/page.py`` prints its rows. ``ANHYST_SOAK_S`` sets the duration of the long run,
s.
"""

from __future__ import annotations

import json
import os
import shutil
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from anhyst.support.states import Command
from anhyst_rigs.dashboard.recording import start_recording
from anhyst_rigs.dashboard.serving import make_server, reduce_latency
from anhyst_rigs.dashboard.session import LiveSession
from anhyst_rigs.dashboard.verb import listen_on
from anhyst_rigs.rig.bench.pace import raised_priority
from anhyst_rigs.study.bench import open_bench
from rows import ROOT, Row

if TYPE_CHECKING:
    from playwright.sync_api import Page

RIG = ROOT / "examples" / "bearing" / "rig.toml"
SIGNALS = 16
DRAWING_S = 20.0
COMMAND_COUNT = 40
SOAK_S = float(os.environ.get("ANHYST_SOAK_S", "60"))
FLOOD_S = 60.0
LATE_S = 0.02
TICK_S = 1.0 / os.sysconf("SC_CLK_TCK")

FRAME_SCRIPT = """seconds => new Promise(resolve => {
  let frames = 0;
  const began = performance.now();
  const next = now => {
    frames += 1;
    if (now - began > 1e3 * seconds) resolve(1e3 * frames / (now - began));
    else requestAnimationFrame(next);
  };
  requestAnimationFrame(next);
})"""

DELAY_SCRIPT = """([name, value]) => new Promise(resolve => {
  const input = document.querySelector(`[aria-label="${name}"]`);
  const shown = document.getElementById("confirmed");
  const seen = new MutationObserver(() => {
    seen.disconnect();
    requestAnimationFrame(now => resolve(performance.now() - began));
  });
  seen.observe(shown, {childList: true, characterData: true, subtree: true});
  const began = performance.now();
  input.value = value;
  input.oninput();
  document.getElementById("apply").click();
})"""


ATTACK_PROGRAM = """
import contextlib, sys, websockets
from websockets.sync.client import connect
address, origin = sys.argv[1:]
with connect(address, origin=origin, max_queue=1):  # never reads
    while True:
        with contextlib.suppress(websockets.WebSocketException, OSError):
            with connect(address, origin=origin) as line:
                while True:
                    line.send('{"do": "load", "value": 150}')
"""
"""Program that floods the server with messages and reconnects after each disconnection."""


def rows() -> list[Row]:
    """Measure the levitated bundled bearing with an open page."""
    with tempfile.TemporaryDirectory() as folder_name, serve_bearing(Path(folder_name)) as (session, page):
        result_rows = [
            measure_frame_rate(session, page, "scope"),
            measure_frame_rate(session, page, "desk 0"),
            measure_delay(page),
            measure_long_run(session, SOAK_S, "page open"),
        ]
        origin = page.url.rstrip("/")
        address = origin.replace("http", "ws") + "/live"
        with subprocess.Popen([sys.executable, "-c", ATTACK_PROGRAM, address, origin]) as attacker:
            title = "page open, one client floods, another never reads"
            result_rows.append(measure_long_run(session, FLOOD_S, title))
            assert attacker.poll() is None
            attacker.kill()
        return result_rows


@contextmanager
def serve_bearing(folder: Path) -> Iterator[tuple[LiveSession, Page]]:
    """Serve the bearing, with recording, to a browser that shows many signals, and lift it off."""
    from playwright.sync_api import sync_playwright

    bench = open_bench(RIG)
    session = LiveSession(bench, start_recording(folder / "run.csv", bench.signals, bench.rate))
    server_socket = listen_on("127.0.0.1", 0)
    port = int(server_socket.getsockname()[1])
    server = make_server(session, "bearing", ("127.0.0.1", port))

    def run() -> None:
        with raised_priority():
            server.run(sockets=[server_socket])

    thread = threading.Thread(target=run, name="server")
    reduce_latency()
    session.start()
    thread.start()
    names = [signal.name for signal in bench.signals[:SIGNALS]]
    choices = {"signals": names, "desks": [{"name": "Desk", "panels": desk_panels(names)}]}
    try:
        with sync_playwright() as api:
            chromium = api.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
            page = chromium.new_page(viewport={"width": 1440, "height": 860})
            for name, value in choices.items():
                text = json.dumps(json.dumps(value))
                page.add_init_script(f"localStorage.setItem('anhyst.bearing.{name}', {text})")
            page.goto(f"http://127.0.0.1:{port}/")
            # The page's content security policy forbids Playwright's wait functions.
            while not page.evaluate("window.anhyst !== undefined && anhyst.store.count > 0"):
                time.sleep(0.05)
            session.run_between_chunks(lambda: session.bench.command(Command.DEMAGNETISED))
            session.run_between_chunks(lambda: session.bench.command(Command.LIFT))
            time.sleep(2.0)
            yield session, page
            chromium.close()
    finally:
        server.should_exit = True
        thread.join()
        session.close()
        server_socket.close()


def desk_panels(names: list[str]) -> list[dict[str, object]]:
    """Return the panels of a desk with two plots, an X-Y loop and a table."""
    half = len(names) // 2
    return [
        {"kind": "plot", "x": 0, "y": 0, "w": 8, "h": 6, "settings": {"signals": names[:half]}},
        {"kind": "plot", "x": 0, "y": 6, "w": 8, "h": 6, "settings": {"signals": names[half:]}},
        {"kind": "loop", "x": 8, "y": 0, "w": 4, "h": 6, "settings": {}},
        {"kind": "table", "x": 8, "y": 6, "w": 4, "h": 6, "settings": {"signals": names}},
    ]


def thread_times() -> dict[str, float]:
    """Return the processor time of each thread of this process, s."""
    seconds_by_thread = {}
    for thread in threading.enumerate():
        fields = Path(f"/proc/self/task/{thread.native_id}/stat").read_text().rpartition(")")[2]
        user, system = fields.split()[11:13]
        seconds_by_thread[thread.name] = TICK_S * (int(user) + int(system))
    return seconds_by_thread


def measure_frame_rate(session: LiveSession, page: Page, view: str) -> Row:
    """Show many signals at the full rate; measure frame rate, script time and the processor load."""
    page.locator(f"[data-view='{view}']").click()
    time.sleep(2.0)
    devtools = page.context.new_cdp_session(page)
    devtools.send("Performance.enable")

    def script_seconds() -> float:
        metrics = devtools.send("Performance.getMetrics")["metrics"]
        return next(float(one["value"]) for one in metrics if one["name"] == "ScriptDuration")

    times_before, start_time, script_before = thread_times(), time.perf_counter(), script_seconds()
    frames = page.evaluate(FRAME_SCRIPT, DRAWING_S)
    script_ms = 1e3 * (script_seconds() - script_before) / (frames * DRAWING_S)
    took, times_after = time.perf_counter() - start_time, thread_times()
    core_fractions = {name: (times_after[name] - times_before.get(name, 0.0)) / took for name in times_after}
    server = core_fractions["server"] + core_fractions["pages"]
    return Row(
        f"{SIGNALS} signals at {session.bench.rate:g} Hz in Chromium, {view.split(maxsplit=1)[0]}",
        ">= 55 frames per second; server <= 15 % of a core",
        f"{frames:.1f} frames per second, {script_ms:.1f} ms of script each; server {100 * server:.1f} %, recording "
        f"{100 * core_fractions['recorder']:.1f} %, plant {100 * core_fractions['pacer']:.1f} % of a core",
        frames >= 55.0 and server <= 0.15,
    )


def measure_delay(page: Page) -> Row:
    """Measure the time from a parameter change until the page shows the first tick that used it."""
    page.get_by_role("tab", name="4 parameters").click()
    delays = []
    for n in range(COMMAND_COUNT):
        delays.append(page.evaluate(DELAY_SCRIPT, ["Load damping", str(5.0 + n)]))
        time.sleep(0.1)
    page.get_by_role("tab", name="1 scope").click()
    median = statistics.median(delays)
    return Row(
        "changed value until its first tick is shown",
        "<= 60 ms, median",
        f"{median:.0f} ms, {max(delays):.0f} ms at most, of {COMMAND_COUNT}",
        median <= 60.0,
    )


def measure_long_run(session: LiveSession, seconds: float, load_text: str) -> Row:
    """Levitate for a long time with recording; measure lateness and memory growth."""
    start_time, first_tick = time.monotonic(), session.bench.tick
    slips, max_lateness = session.pacer.pacing().slip_count, 0.0
    memory_sizes = []
    while (elapsed := time.monotonic() - start_time) < seconds:
        time.sleep(0.5)
        max_lateness = max(max_lateness, session.pacer.pacing().max_lateness)
        if elapsed > 0.1 * seconds:  # buffers are full from here on
            memory_sizes.append(resident_memory())
    pace = session.pacer.pacing()
    real_time_factor = (pace.tick - first_tick) / session.bench.rate / (time.monotonic() - start_time)
    memory_growth = statistics.median(memory_sizes[-10:]) / statistics.median(memory_sizes[:10]) - 1.0
    return Row(
        f"levitates for {seconds:g} s, recorded, {load_text}",
        f"1 times real time, no chunk later than {1e3 * LATE_S:g} ms; memory flat within 5 %",
        f"{real_time_factor:.4f} times, lateness {1e3 * max_lateness:.1f} ms at most, {pace.slip_count - slips} "
        f"pacing slips; memory {100 * memory_growth:+.1f} % of {memory_sizes[0]:.0f} MB",
        real_time_factor >= 0.999 and max_lateness <= LATE_S and abs(memory_growth) <= 0.05,
    )


def resident_memory() -> float:
    """Return the resident memory of this process, MB."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


if __name__ == "__main__":
    for row in rows():
        print(f"{row.what}: {row.measured} (target: {row.reach})")
