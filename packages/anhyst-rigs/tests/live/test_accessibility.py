"""Test that every view of the page on every kind of rig is accessible, and that the keyboard reaches all of it."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from typing import TYPE_CHECKING

import pytest

from anhyst_rigs.dashboard.recording import RecordingSpan
from anhyst_rigs.rig.bench.foreign import open_foreign
from anhyst_rigs.rig.bench.stage import StageBench
from anhyst_rigs.study.improve import make_drawn_loops
from anhyst_rigs.study.prepared_benches import PreparedForce
from tests.link.foreign import slaves
from tests.live.conftest import Serve, Served, Show
from tests.live.test_body import setups
from tests.live.test_desk import record
from tests.live.test_page import seen, until
from tests.live.test_stage import prepared as prepared_stage
from tests.study import bearings, piezos
from tests.study.test_axes import planar

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.needs("chromium")

SIZES = ((1440, 900), (390, 844))
THEMES = ("light", "dark")
SERIOUS = ("serious", "critical")

Rig = Callable[[pytest.FixtureRequest, Serve, ExitStack], Served]


def _bearing(_request: pytest.FixtureRequest, serve: Serve, _stack: ExitStack) -> Served:
    known = bearings.knowledge()
    served = serve(curves=make_drawn_loops(known.loops, known.model))
    record(served, "listed.csv", RecordingSpan(0.0, 0.01))
    return served


def _force(request: pytest.FixtureRequest, serve: Serve, _stack: ExitStack) -> Served:
    found: PreparedForce = request.getfixturevalue("prepared")
    return serve(prepared=found)


def _foreign(request: pytest.FixtureRequest, serve: Serve, stack: ExitStack) -> Served:
    program = slaves.build(request.getfixturevalue("tmp_path_factory"))
    slave = stack.enter_context(slaves.running(program))
    return serve(open_foreign(program, slave.url))


RIGS: dict[str, Rig] = {
    "bearing": _bearing,
    "force": _force,
    "stage": lambda _request, serve, _stack: serve(prepared=prepared_stage()),
    "body": lambda _request, serve, _stack: serve(bench=StageBench(setups(planar()))),
    "piezo": lambda _request, serve, _stack: serve(prepared=piezos.prepared()),
    "foreign": _foreign,
}


def faults(page: Page) -> list[str]:
    """Return the serious and critical faults of what the page shows, with the elements."""
    api = pytest.importorskip(
        "axe_playwright_python.sync_playwright",
        reason="axe is not installed: pip install axe-playwright-python",
    )
    violations = api.Axe().run(page).response["violations"]
    return [
        f"{one['id']}: {node['html'][:160]} {node['any'][0]['message'] if node['any'] else ''}"
        for one in violations
        if one["impact"] in SERIOUS
        for node in one["nodes"]
    ]


def tabs(page: Page) -> list[str]:
    names: list[str] = page.evaluate(
        "[...document.querySelectorAll('[role=tab]')].map((one) => one.dataset.view)"
    )
    return names


def open_tab(page: Page, name: str) -> None:
    """Open a view by its tab, and all folded parts of it."""
    page.locator(f"[data-view='{name}']").click()
    until(page, "document.querySelector('#sections > .view:not([hidden])').childElementCount > 0")
    page.evaluate("for (const one of document.querySelectorAll('details')) one.open = true")
    page.wait_for_timeout(150)  # the first pictures and values


def faults_of_views(page: Page) -> list[str]:
    """Return the faults of all views: large in the light theme, small in the dark theme.

    Contrast depends on the theme and not on the size, and all other rules on neither or on the size.
    """
    found = []
    for theme, (width, height) in zip(THEMES, SIZES, strict=True):
        if page.evaluate("document.documentElement.dataset.theme") != theme:
            page.locator("#theme").click()
        page.set_viewport_size({"width": width, "height": height})
        for name in tabs(page):
            open_tab(page, name)
            found += [f"{name}, {theme}, {width}: {fault}" for fault in faults(page)]
    return found


@pytest.mark.slow
@pytest.mark.parametrize("rig", RIGS)
def test_every_view_of_a_rig_is_accessible(
    request: pytest.FixtureRequest, serve: Serve, show: Show, rig: str
) -> None:
    with ExitStack() as stack:
        page = show(RIGS[rig](request, serve, stack))
        until(page, "window.anhyst?.store.count > 100")
        assert faults_of_views(page) == []


def test_an_unnamed_control_and_pale_text_are_found(bearing: Served, show: Show) -> None:
    page = show(bearing)
    until(page, "window.anhyst?.store.count > 100")
    page.evaluate(
        "document.getElementById('png').replaceChildren(), document.getElementById('png').removeAttribute('title')"
    )
    page.evaluate("document.getElementById('title').style.color = '#bbb'")
    found = faults(page)
    assert any("button-name" in fault for fault in found)
    assert any("color-contrast" in fault for fault in found)


CONTROLS = """() => [...document.querySelectorAll("button, input, select, summary, [tabindex='0']")]
  .filter((one) => one.checkVisibility() && !one.disabled && one.tabIndex >= 0)
  .map((one) => { one.dataset.control ??= String(Math.random()); return one.dataset.control; })"""

LISTEN = """() => {
  window.reached = new Set();
  document.addEventListener("focusin", ({ target }) => window.reached.add(target.dataset.control));
}"""

MISSED = """(ids) => ids.filter((id) => !window.reached.has(id))
  .map((id) => document.querySelector(`[data-control="${id}"]`)?.outerHTML.slice(0, 120))"""


@pytest.mark.slow
@pytest.mark.parametrize("name", ["scope", "parameters", "desk 0"])
def test_the_tab_key_reaches_every_control(bearing: Served, show: Show, name: str) -> None:
    page = show(bearing)
    until(page, "window.anhyst?.store.count > 100")
    open_tab(page, name)
    controls = page.evaluate(CONTROLS)
    page.evaluate(LISTEN)
    page.locator("#theme").focus()  # the first control
    for _ in range(len(controls) + 20):
        page.keyboard.press("Tab")
    assert len(controls) > 40
    assert page.evaluate(MISSED, controls) == []


@pytest.mark.slow
def test_a_panel_is_filled_and_cursors_are_moved_by_keys(bearing: Served, show: Show) -> None:
    page = show(bearing)
    until(page, "window.anhyst?.store.count > 100")
    page.locator("[data-view='desk 0']").focus()
    page.keyboard.press("Enter")
    page.get_by_label("add a signal to the table").select_option("voltage")
    assert page.get_by_label("add a signal to the table").input_value() == ""
    until(
        page, "[...document.querySelectorAll('.panel tbody th')].some((one) => one.textContent === 'Voltage')"
    )
    remove = page.get_by_role("button", name="remove Voltage")
    remove.focus()
    page.wait_for_timeout(600)  # new values do not move the focus
    page.keyboard.press("Enter")
    until(
        page,
        "![...document.querySelectorAll('.panel tbody th')].some((one) => one.textContent === 'Voltage')",
    )
    page.keyboard.press("1")
    page.locator("#scope .strips").focus()
    page.keyboard.press("Enter")
    page.keyboard.press("Enter")
    assert len(seen(page, "page.scope.cursors.ticks")) == 2
    first, last = seen(page, "page.scope.cursors.ticks")
    page.keyboard.press("ArrowLeft")
    moved = seen(page, "page.scope.cursors.ticks")
    assert moved != [first, last]


@pytest.mark.slow
def test_the_arrow_keys_move_the_cursor_of_a_spectrum(bearing: Served, show: Show) -> None:
    page = show(bearing)
    until(page, "window.anhyst?.store.count > 2000")
    open_tab(page, "spectrum")
    page.select_option("#spectrum-length", "1024")
    until(page, "document.getElementById('spectrum-note').textContent.includes('rms')")
    page.locator("#spectrum figure").focus()
    frequencies = []
    for key in ("ArrowRight", "ArrowRight", "ArrowLeft"):
        before = page.locator("#spectrum-reading").inner_text()
        page.keyboard.press(key)
        until(page, f"document.getElementById('spectrum-reading').textContent !== {before!r}")
        frequencies.append(float(page.locator("#spectrum-reading").inner_text().split()[0]))
    assert frequencies[0] == frequencies[2] < frequencies[1]
    page.keyboard.press("Tab")
    until(page, "document.getElementById('spectrum-reading').textContent === ''")
