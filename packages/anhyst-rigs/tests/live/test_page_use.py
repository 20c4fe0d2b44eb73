"""Test the page on a telephone, with cursors, as a saved file, and after a reload."""

from __future__ import annotations

import io
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import matplotlib.image
import numpy as np
import pytest

from anhyst.support.numeric import FloatArray
from anhyst_rigs.dashboard.recording import RecordingSpan
from tests.live.conftest import Served, sending_all_samples, shown, wait_for
from tests.live.test_page import lift, press, ready, seen, state_is, until
from tests.live.test_recorder import numbers

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

pytestmark = pytest.mark.needs("chromium")


@pytest.fixture(scope="module")
def opened(browser: Browser, bearing: Served) -> Iterator[Page]:
    """One page of one bearing, for all tests of this module."""
    with sending_all_samples(), shown(browser, bearing) as page:
        ready(page)
        yield page


@pytest.fixture
def page(opened: Page, bearing: Served) -> Page:
    """The scope with a short live window and without cursors."""
    bearing.session.pacer.resume()
    opened.keyboard.press("1")
    seen(opened, "page.scope.setWindow(0.1), page.scope.follow()")
    seen(opened, "(page.scope.cursors.ticks = []).length")
    return opened


def at(page: Page, share: float) -> tuple[float, float]:
    """Return a point in the first strip at this fraction of its width from the left."""
    box = page.locator("#scope .u-over").first.bounding_box()
    assert box is not None
    return box["x"] + share * box["width"], box["y"] + 30.0


def columns(page: Page) -> dict[str, FloatArray]:
    """Return the visible samples of the scope by column name."""
    table: dict[str, Any] = seen(page, "page.scope.table()")
    return {head: np.array(column) for head, column in table.items()}


BOXES = """() => [...document.querySelectorAll("button, input, select, output, dd, legend")]
  .filter((one) => one.checkVisibility() && !one.closest("#stopbar, #notice, #signal-list, nav"))
  .map((one) => [one.id || one.textContent || one.className, one.getBoundingClientRect()])
  .filter(([, box]) => box.width && box.height)
  .map(([name, box]) => [name, box.left, box.top, box.right, box.bottom])"""


def overlapping(boxes: list[tuple[str, float, float, float, float]]) -> list[tuple[str, str]]:
    """Return the pairs of boxes that overlap by more than a pixel."""
    sides = np.array([box[1:] for box in boxes])
    low = np.maximum(sides[:, None, :2], sides[None, :, :2])
    high = np.minimum(sides[:, None, 2:], sides[None, :, 2:])
    first, second = np.nonzero(np.triu(np.all(high - low > 1.0, axis=2), 1))
    return [(boxes[i][0], boxes[j][0]) for i, j in zip(first, second, strict=True)]


@pytest.mark.slow
def test_on_a_telephone_nothing_overlaps_and_stop_is_in_reach(page: Page) -> None:
    page.set_viewport_size({"width": 390, "height": 844})
    for view in range(1, 9):
        page.keyboard.press(str(view))
        boxes = page.evaluate(BOXES)
        assert overlapping(boxes) == []
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
        assert [box[0] for box in boxes if box[1] < 0.0 or box[3] > 390.0] == []
        for top in (0, 1_000_000):
            page.evaluate(f"scrollTo(0, {top})")
            stop = page.locator("#stop").bounding_box()
            assert stop is not None
            middle = f"{stop['x'] + stop['width'] / 2}, {stop['y'] + stop['height'] / 2}"
            assert page.evaluate(f"document.elementFromPoint({middle}).closest('#stop') !== null")
            if top:
                assert max(box[4] for box in page.evaluate(BOXES)) <= stop["y"]
    page.set_viewport_size({"width": 1440, "height": 860})


@pytest.mark.slow
def test_a_stop_names_the_next_command_and_disables_others(page: Page, bearing: Served) -> None:
    lift_button = page.locator("#panel [data-order=lift]")
    until(page, "document.querySelector('[data-order=lift]').title.includes('ready')")
    assert lift_button.is_disabled()
    lift(page, bearing)
    assert lift_button.is_disabled()
    assert page.locator("#next").inner_text() == ""
    page.keyboard.press("Escape")
    state_is(page, "fault")
    until(page, "document.getElementById('next').textContent.startsWith('Press Clear fault')")
    for name, label in (("clear", "Clear fault"), ("demagnetised", "Assume demagnetised"), ("lift", "Lift")):
        until(page, f"document.getElementById('next').textContent.includes('{label}')")
        press(page, name)
    state_is(page, "run")


@pytest.mark.slow
def test_cursors_report_the_difference_between_them(page: Page) -> None:
    for share in (0.9, 0.2, 0.3):  # the last click moves the nearer cursor
        page.mouse.click(*at(page, share))
        page.mouse.move(*at(page, share + 0.05))  # so that two clicks do not form a double click
    until(page, "window.anhyst.scope.cursors.found.length === 4")
    assert seen(page, "page.scope.held") is not None
    first, last = seen(page, "page.scope.cursors.ticks")
    seen_now = columns(page)
    begin, end = seen_now["tick"][0], seen_now["tick"][-1]
    assert (np.array([first, last]) - begin) / (end - begin) == pytest.approx([0.3, 0.9], abs=0.01)
    between = (seen_now["tick"] >= first) & (seen_now["tick"] <= last)
    gap = seen_now["gap_m"][between]
    found = seen(page, "page.scope.cursors.found[0]")
    assert found["dy"] == pytest.approx(gap[-1] - gap[0], abs=1e-12)
    assert found["rms"] == pytest.approx(np.sqrt(np.mean(gap**2)), rel=1e-6)
    assert found["ripple"] == pytest.approx(np.std(gap), rel=1e-3)
    rate = seen(page, "page.bench.rate")
    message = page.locator("#cursor-time").inner_text()
    assert f"dt {1e3 * (last - first) / rate:.4g} ms" in message
    assert f"1/dt {rate / (last - first):.6g} Hz" in message


def test_the_wheel_zooms_at_the_pointer_and_a_double_click_resets(page: Page) -> None:
    page.keyboard.press("Space")
    held = seen(page, "page.scope.held")
    page.mouse.click(*at(page, 0.5))
    window, ticks = seen(page, "[page.scope.window, page.scope.cursors.ticks]")
    page.mouse.move(*at(page, 0.25))
    for _ in range(5):
        page.mouse.wheel(0, -120)
    until(page, f"window.anhyst.scope.window < {0.4 * window}")
    until(page, "window.anhyst.scope.view.to === window.anhyst.scope.held")
    zoomed = seen(page, "page.scope.view")
    rate = seen(page, "page.bench.rate")
    place = held - 0.75 * window * rate  # tick at the pointer before zooming
    share = (place - zoomed["from"]) / (zoomed["to"] - zoomed["from"])
    assert share == pytest.approx(0.25, abs=0.01)
    page.mouse.dblclick(*at(page, 0.7))
    assert seen(page, "[page.scope.window, page.scope.held]") == [window, held]
    assert seen(page, "page.scope.cursors.ticks") == ticks
    page.mouse.dblclick(*at(page, 0.7))
    assert seen(page, "page.scope.held") is None


@pytest.mark.slow
def test_the_view_is_saved_as_a_table_and_as_a_picture(page: Page, bearing: Served) -> None:
    bearing.session.pacer.pause()  # keep all visible samples in the buffer
    page.keyboard.press("Space")
    until(page, "window.anhyst.scope.view.to === window.anhyst.scope.held")
    expected = columns(page)
    with page.expect_download() as table:
        press(page, "CSV")
    rows = np.genfromtxt(table.value.path(), delimiter=",", names=True)
    assert rows.dtype.names == ("tick", "t_s", "gap_m", "reference_m", "F_N", "I_A")
    assert np.array_equal(rows["tick"], expected["tick"])
    bearing.session.run_between_chunks(lambda: bearing.session.record("last.csv", RecordingSpan(10.0, 0.0)))
    path = bearing.session.recorder.folder / "last.csv"
    wait_for(lambda: bearing.session.recorder.status() is None)
    recorded = numbers(path)
    mine = recorded[np.isin(recorded[:, 0], rows["tick"])]
    gap = path.read_text().splitlines()[0].split(",").index("gap_m")
    assert np.array_equal(rows["gap_m"].astype("f4"), mine[:, gap].astype("f4"))
    with page.expect_download() as picture:
        press(page, "PNG")
    assert picture.value.suggested_filename.startswith("bearing-scope-")
    drawn = matplotlib.image.imread(io.BytesIO(picture.value.path().read_bytes()))
    assert drawn.shape[0] > 400
    assert drawn.shape[1] > 800
    assert len(np.unique(drawn.reshape(-1, drawn.shape[2]), axis=0)) > 10  # not empty
    page.keyboard.press("5")
    assert page.get_by_role("button", name="PNG", exact=True).is_disabled()


@pytest.mark.slow
def test_choices_for_this_rig_survive_a_reload(page: Page) -> None:
    page.get_by_role("checkbox", name="velocity").check()
    page.locator("#window").select_option("0.2")
    page.get_by_role("tab", name="2 loop").click()
    page.reload()
    ready(page)
    assert page.locator("#loop").is_visible()
    page.keyboard.press("1")
    wait_for(page.get_by_role("checkbox", name="velocity").is_checked)
    assert seen(page, "page.scope.window") == 0.2
    of_rig = page.evaluate("Object.keys(localStorage).filter((one) => one !== 'anhyst.theme')")
    assert of_rig
    assert all(one.startswith("anhyst.bearing.") for one in of_rig)
