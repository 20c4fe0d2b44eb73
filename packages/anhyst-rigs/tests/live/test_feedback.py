"""Test that each action on the page has a visible result, and that nothing covers values or moves them."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from anhyst_rigs.dashboard.server import OperatorDesk
from tests.live.conftest import Serve, Served, shown, wait_for
from tests.live.test_desk import fill_derived
from tests.live.test_page import press, ready, seen, until

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

pytestmark = pytest.mark.needs("chromium")


@pytest.fixture(scope="module")
def opened(browser: Browser, bearing: Served) -> Iterator[Page]:
    """One page of one bearing, for the tests of this module."""
    with shown(browser, bearing) as page:
        page.set_viewport_size({"width": 1440, "height": 900})
        ready(page)
        yield page


@pytest.fixture
def page(opened: Page) -> Page:
    """The scope without trigger."""
    opened.locator("[data-view=scope]").click()
    opened.select_option("#trigger-mode", "off")
    return opened


def top(page: Page, place: str) -> float:
    """Return the upper edge of an element, pixels."""
    box = page.locator(place).bounding_box()
    assert box is not None
    return box["y"]


def test_the_reason_for_a_refusal_names_whether_anybody_operates() -> None:
    desk = OperatorDesk()
    for client in (1, 2):
        desk.join(client)
    assert desk.refusal_reason(1) == ""
    assert desk.refusal_reason(2).startswith("another browser operates")
    desk.leave(1)
    assert desk.refusal_reason(2) == "nobody operates; take over"


def test_a_telephone_shows_the_role_and_the_answer_to_its_request(serve: Serve, browser: Browser) -> None:
    served = serve()
    with shown(browser, served) as keeper:  # operates first
        ready(keeper)
        seen(keeper, "page.parameters.put({ gain_p: 4e6 })")
        with shown(browser, served) as phone:
            phone.set_viewport_size({"width": 390, "height": 844})
            ready(phone)
            role = phone.locator("#role b")
            until(phone, "document.body.classList.contains('watching')")
            assert role.is_visible()
            assert role.inner_text() == "Browser 1 operates, you watch"
            assert "µm" in phone.locator("#scope .legend output").first.inner_text()
            label = "page.parameters.label(1e12)"
            assert "Proportional gain × 1.17" in seen(phone, label)
            assert seen(phone, label) == seen(keeper, label)
            press(phone, "take over")
            press(keeper, "keep")
            until(phone, "document.getElementById('notice').textContent.includes('Browser 1 keeps control')")
            assert phone.locator("#notice").is_visible()
            keeper.goto("about:blank")
            until(phone, "document.querySelector('#role b').textContent === 'Nobody operates'")
            until(phone, "document.getElementById('go').title === 'nobody operates; take over'")
            press(phone, "take over")
            until(phone, "document.querySelector('#role b').textContent === 'You operate'")
            assert phone.evaluate("document.documentElement.scrollWidth") <= 390


def test_a_repeated_refusal_is_counted_and_ends_with_an_accepted_order(page: Page) -> None:
    page.locator("#record-name").fill("")
    message = page.locator("#notice span")
    for count in ("", " (2 times)"):
        page.locator("#record").click()
        until(page, f"document.querySelector('#notice span')?.textContent.endsWith('name{count}')")
    assert message.inner_text() == "record: give the recording a name (2 times)"
    assert top(page, "#notice") >= page.evaluate(
        "document.querySelector('main').getBoundingClientRect().bottom"
    )
    press(page, "demagnetised")
    until(page, "document.getElementById('notice').hidden")


def test_a_frequency_is_checked_in_its_field(page: Page, bearing: Served) -> None:
    for shape, field in (("sine", "#frequency"), ("chirp", "#chirp-high")):
        page.select_option("#shape", shape)
        page.locator(field).fill("99999")
        page.locator("#generate").click()
        message = page.locator("[data-order=generator] .invalid").locator("visible=true")
        assert message.inner_text() == "Choose 0.01 to 50 Hz."
        assert page.locator(field).evaluate("(input) => input === document.activeElement")
        page.locator(field).fill("50")
        assert message.count() == 0
    assert bearing.session.status()["generator"] is None


def test_neither_a_trigger_nor_another_desk_moves_the_plots(page: Page) -> None:
    before = {place: top(page, place) for place in ("#work", "#png", "[data-view=bode]")}
    page.select_option("#trigger-mode", "normal")
    page.locator("#trigger-level").fill("9999")
    page.locator("#trigger-level").press("Tab")
    page.get_by_text("not triggered").wait_for(state="visible")
    assert top(page, "#work") == before["#work"]
    for _ in range(7):
        page.get_by_role("button", name="add a desk").click()
        assert {place: top(page, place) for place in before} == before
    left, width, all_tabs = page.locator("#desktabs").evaluate(
        "(tabs) => [tabs.scrollLeft, tabs.clientWidth, tabs.scrollWidth]"
    )
    assert left == pytest.approx(all_tabs - width, abs=1.0)  # the new desk is in view
    assert all_tabs > width


def test_a_panel_of_an_unknown_kind_is_named(page: Page, tmp_path: Path) -> None:
    place = {"x": 0, "y": 0, "w": 3, "h": 2}
    panels = [{"kind": kind, **place} for kind in ("compass", "gauge")]
    path = tmp_path / "other.json"
    path.write_text(
        json.dumps({"format": "anhyst-desks", "version": 1, "desks": [{"name": "A", "panels": panels}]})
    )
    page.locator("[data-view='desk 0']").click()
    page.locator(".desk input[type=file]").first.set_input_files(path)
    expected = "other.json: imported without the panels of unknown kind: compass"
    until(page, f"document.querySelector('#notice span')?.textContent === '{expected}'")
    assert [one["kind"] for one in seen(page, "page.desks.layouts[0].panels")] == ["gauge"]


def test_a_new_derived_signal_is_in_view_and_in_the_plot(page: Page) -> None:
    fill_derived(page, "never", "force / 0")
    until(page, "document.querySelector('#derived .invalid').textContent.includes('never a finite number')")
    fill_derived(page, "later", "sqrt(force - 1e5)")
    entry = page.locator("#signal-list [data-signal=later]")
    entry.wait_for()
    until(page, "document.querySelector('[data-signal=later] output').textContent === 'not finite'")
    assert entry.locator("input").is_checked()
    assert seen(page, "page.scope.plot.names.has('later')")
    box, frame = entry.bounding_box(), page.locator("#signal-list").bounding_box()
    assert box is not None
    assert frame is not None
    assert frame["y"] <= box["y"]
    assert box["y"] + box["height"] <= frame["y"] + frame["height"] + 1.0
    page.get_by_role("button", name="delete later").click()
    wait_for(lambda: entry.count() == 0)


def test_all_columns_of_the_step_table_are_visible(page: Page) -> None:
    page.locator("[data-view=steps]").click()
    page.evaluate(
        """() => {
          const label = "without compensation, Proportional gain × 1.17, Derivative gain × 1.1";
          const step = (n) => ({ label, tick: n, height: 2.034e-5 + 1e-7 * n, noise: 10.3 + n, overshoot: 30.7 + n,
            rise: 0.01234 + 1e-3 * n, settling: 0.0345 + 1e-3 * n, times: [0, 1e-3], part: [0, 1] });
          Object.assign(anhyst.finder, { settings: [label], steps: [0, 1, 2].map(step) });
        }"""
    )
    until(
        page,
        "document.querySelector('#steps tbody td:last-child')?.textContent === '35.5 ms (34.5 ms to 36.5 ms)'",
    )
    frame = page.locator("#steps .scroll").evaluate("(one) => [one.scrollWidth, one.clientWidth]")
    assert frame[0] <= frame[1]
