"""Test the page from measurement to model swap in a real browser."""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

from anhyst.support.states import State
from anhyst_rigs.study.prepared_benches import PreparedForce
from tests.live.conftest import Serve, Show, wait_for
from tests.live.test_page import press, ready, state_is, until

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = [pytest.mark.needs("chromium"), pytest.mark.slow]


def cell(page: Page, column: int) -> float:
    """Return a value of the comparison of both models, N."""
    text = page.locator("#misfits tbody tr").first.locator("td").nth(column).inner_text()
    return float(text.removesuffix(" N"))


def test_a_view_opens_with_the_refusals_of_the_newest_status(
    serve: Serve, show: Show, prepared: PreparedForce
) -> None:
    page = show(serve(prepared=prepared))
    ready(page)
    page.evaluate("window.anhyst.views.values = () => []")  # later messages reach no view
    page.get_by_role("tab", name="improve").click()
    assert page.get_by_role("button", name="1. measure").is_enabled()
    assert page.get_by_role("tab", name="levitation").count() == 0  # nothing levitates on a force rig
    assert page.get_by_role("button", name="2. identify").is_disabled()


def test_an_unknown_iron_is_improved_without_leaving_the_page(
    serve: Serve, show: Show, prepared: PreparedForce
) -> None:
    served = serve(prepared=prepared)
    page = show(served)
    ready(page)
    page.get_by_role("tab", name="improve").click()
    assert page.get_by_role("button", name="2. identify").is_disabled()
    assert "Start with Measure." in page.locator("#improve").inner_text()
    assert page.locator("#improve .pair").is_hidden()
    page.get_by_label("largest current").fill("5")
    press(page, "1. measure")
    said = "current: 5 A is not above 0 and at most 1.2 A, the limit of the rig file"
    until(page, f"document.getElementById('notice').textContent.includes('{said}')")
    page.get_by_label("largest current").fill("1.2")
    press(page, "1. measure")
    until(page, "document.getElementById('improve').textContent.includes('ran faster than real time')")
    assert page.locator("#improve .pair").is_visible()
    page.get_by_role("button", name="2. identify").click()
    page.get_by_role("button", name="3. compile").click()
    page.get_by_role("button", name="4. swap").click()
    until(page, "document.getElementById('improving').textContent.startsWith('new model in force')")
    assert cell(page, 2) < 0.3 * cell(page, 0)
    with page.expect_download() as saved:
        press(page, "save files")
    assert saved.value.suggested_filename in {"loops.csv", "loops.toml", "model.toml"}
    state_is(page, "idle")
    press(page, "condition")
    wait_for(lambda: served.session.status()["state"] == State.READY)
    press(page, "watch for drift")
    until(page, "document.getElementById('watched').dataset.watch === 'learning'")
    press(page, "swap back")
    until(page, "document.getElementById('improving').textContent.startsWith('model before')")
