"""Measure what a browser with an empty cache loads for the page: bytes on the wire and bytes of source."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import pytest

from tests.live.conftest import Served
from tests.live.test_page import ready

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

pytestmark = pytest.mark.needs("chromium")

LOADED = """() => [...performance.getEntriesByType("navigation"), ...performance.getEntriesByType("resource")]
  .map((one) => [new URL(one.name).pathname, one.transferSize, one.decodedBodySize])"""


class Size(NamedTuple):
    """Bytes of all files of the page without uPlot, and their number."""

    transferred: int
    """With the headers of the answers and with compression."""
    source: int
    files: int


def size_of(page: Page) -> Size:
    loaded = page.evaluate(LOADED)
    assert "/assets/uplot/uPlot.esm.js" in [path for path, _, _ in loaded]
    own = [sizes for path, *sizes in loaded if "uplot" not in path]
    assert all(transferred > 0 for transferred, _ in own)  # not from a cache
    return Size(sum(one[0] for one in own), sum(one[1] for one in own), len(own))


def test_the_page_of_a_bearing_is_small_without_uplot(browser: Browser, bearing: Served) -> None:
    with browser.new_context() as context:
        page = context.new_page()
        page.goto(bearing.address)
        ready(page)
        first = size_of(page)
        for tab in page.locator("[role=tab]").all():
            tab.click()
            page.wait_for_timeout(300)
        every = size_of(page)
    print(f"page {first}; with all views {every}")
    assert first.transferred < 80_000
    assert first.source < 170_000
    assert every.files > first.files + 5
    assert every.transferred < 120_000
