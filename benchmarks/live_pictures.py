"""Draw the pictures of the live page in docs/img, in Chromium at 1440 x 900 pixels.

    python benchmarks/live_pictures.py [bearing] [unknown] [stage] [piezo] [planar]

The script starts ``anhyst live`` with each of these examples, operates its page and takes pictures:
of a bearing the scope, loop, steps, parameters, levitation, spectrum, a desk and the frequency
response; of a bearing with an unknown iron the improved model; of a stage its learning; of a piezo
stage the scope; and of the planar stage the body.
"""

from __future__ import annotations

import shutil
import signal
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from subprocess import PIPE, Popen

from playwright.sync_api import Page, expect, sync_playwright

from rows import ROOT

_TIMEOUT_MS = 40_000
_JOB_TIMEOUT_MS = 180_000
"""Longest time of a measurement, an identification or a compilation, ms."""
_SETTLING_MS = 2_000
"""Time before a picture, in which a view draws, ms."""


@contextmanager
def run_rig(name: str) -> Iterator[str]:
    """Run an example, and return the address of its page when the rig runs."""
    with tempfile.TemporaryDirectory() as folder:
        rig = Path(folder) / name
        shutil.copytree(ROOT / "examples" / ("bearing" if name == "unknown" else name), rig)
        if name == "unknown":
            text = (rig / "rig.toml").read_text(encoding="utf-8")
            text = text.replace("pinning_scale_A_per_m = 170.0", "pinning_scale_A_per_m = 340.0")
            (rig / "rig.toml").write_text(text, encoding="utf-8")
        command = [sys.executable, "-m", "anhyst.cli.app", "live", "rig.toml", "--listen", "0"]
        with Popen(command, stdout=PIPE, text=True, cwd=rig) as process:
            yield from _wait_for_rig(process)


def _wait_for_rig(process: Popen[str]) -> Iterator[str]:
    """Yield the address of the page when the rig runs, and end the rig afterwards."""
    assert process.stdout is not None
    try:
        address = process.stdout.readline().split()[0]
        for line in process.stdout:
            if line == "the rig runs\n":
                break
        yield address
    finally:
        process.send_signal(signal.SIGINT)


def save(page: Page, name: str) -> None:
    """Save the page as a picture when it is drawn."""
    page.wait_for_timeout(_SETTLING_MS)
    page.screenshot(path=ROOT / "docs" / "img" / f"live-{name}.png")


def order(page: Page, *names: str) -> None:
    """Press buttons of the controller, each as soon as the controller accepts it."""
    for name in names:
        page.locator(f"#panel button[data-order='{name}']:enabled").click()


def show_signals(page: Page, shown: set[str]) -> None:
    """Tick these signals in the list, and no others."""
    for box in page.locator("#signal-list input[type=checkbox]").all():
        box.set_checked(box.get_attribute("aria-label") in shown)


def open_view(page: Page, view: str) -> None:
    """Open a view by its tab."""
    page.locator(f"[role=tab][data-view='{view}']").click()


def draw_bearing(page: Page) -> None:
    """Lift the bearing, move it in steps, and draw all its views."""
    order(page, "demagnetised", "lift")
    expect(page.locator("#state")).to_have_text("run")
    page.locator("#generate").click()
    page.locator("#window").select_option(label="500 ms")
    page.locator("summary", has_text="Derived signal").click()
    page.get_by_placeholder("name, such as power").fill("power")
    page.get_by_placeholder("lowpass(force_N * current_A, 200)").fill("force * velocity")
    page.get_by_placeholder("unit, such as W").fill("W")
    page.get_by_role("button", name="Add signal").click()
    page.locator("#signal-list").get_by_label("power", exact=True).wait_for()
    show_signals(page, {"gap", "reference", "force", "current", "power"})
    save(page, "scope")
    for view in ("loop", "steps", "parameters", "levitation", "spectrum"):
        open_view(page, view)
        save(page, view)
    open_view(page, "desk 0")
    save(page, "desk")
    page.get_by_role("button", name="Off", exact=True).click()
    page.wait_for_timeout(_SETTLING_MS)
    open_view(page, "bode")
    page.locator("#measure-response").click()
    expect(page.locator("#bode")).to_contain_text("Zone", timeout=_JOB_TIMEOUT_MS)
    save(page, "bode")


def draw_unknown(page: Page) -> None:
    """Measure, identify and activate a model of an iron that the controller does not know."""
    order(page, "demagnetised", "lift")
    expect(page.locator("#state")).to_have_text("run")
    open_view(page, "improve")
    for step in ("Measure", "Identify", "Compile", "Swap"):
        button = page.locator("#improve button", has_text=step).first
        expect(button).to_be_enabled(timeout=_JOB_TIMEOUT_MS)
        button.click()
    expect(page.locator("#improve button", has_text="Swap back")).to_be_enabled(timeout=_JOB_TIMEOUT_MS)
    save(page, "improve")


def draw_stage(page: Page) -> None:
    """Run a sampled plant with both compensations, and then learn from its motion."""
    open_view(page, "parameters")
    page.get_by_label("Plant", exact=True).fill("3")
    page.locator("#apply").click()
    order(page, "run")
    page.wait_for_timeout(9_000)
    page.keyboard.press("c")
    page.wait_for_timeout(4_000)
    page.keyboard.press("c")
    page.wait_for_timeout(4_000)
    open_view(page, "improve")
    page.locator("#learn").click()
    page.wait_for_timeout(25_000)
    save(page, "learn")


def draw_piezo(page: Page) -> None:
    """Run the piezo stage, and switch its compensation off in the middle of the window."""
    page.locator("#window").select_option(label="1 s")
    show_signals(page, {"error", "voltage"})
    order(page, "run")
    page.wait_for_timeout(2_000)
    page.keyboard.press("c")
    page.get_by_role("button", name="Off (C)").wait_for()
    page.wait_for_timeout(300)
    page.keyboard.press("Space")
    save(page, "piezo")


def draw_planar(page: Page) -> None:
    """Run the planar stage, and draw its body in the gaps while time runs slowly."""
    open_view(page, "body")
    page.select_option("#pose", "gap")
    order(page, "run")
    page.wait_for_timeout(2_000)
    page.locator("#pause").click()
    save(page, "body")


RIGS: Mapping[str, Callable[[Page], None]] = {
    "bearing": draw_bearing,
    "unknown": draw_unknown,
    "stage": draw_stage,
    "piezo": draw_piezo,
    "planar": draw_planar,
}


def main(names: list[str]) -> None:
    """Draw the pictures of these rigs."""
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        for name in names:
            with run_rig(name) as address:
                page = chromium.new_page(viewport={"width": 1440, "height": 900})
                page.set_default_timeout(_TIMEOUT_MS)
                expect.set_options(timeout=_TIMEOUT_MS)
                page.goto(address)
                RIGS[name](page)
                page.close()
        chromium.close()


if __name__ == "__main__":
    main(sys.argv[1:] or list(RIGS))
