"""Test the page in a real browser as an engineer sees and operates it."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from anhyst.support.states import Fault, State
from tests.live.conftest import Serve, Served, Show, sending_all_samples, wait_for
from tests.live.test_recorder import numbers

if TYPE_CHECKING:
    from playwright.sync_api import Page

pytestmark = pytest.mark.needs("chromium")

GAP = 0.45e-3


def press(page: Page, name: str) -> None:
    """Press a command of the controller, or the button with a name in upper or lower case."""
    command = page.locator(f"#panel button[data-order='{name}']")
    if not command.count():
        command = page.get_by_role("button", name=re.compile(f"^{re.escape(name)}$", re.IGNORECASE))
    command.click()


def labelled(name: str) -> str:
    """Return the readable name of a parameter."""
    return name.replace("_", " ").capitalize()


def seen(page: Page, text: str) -> Any:
    """Return the value of a JavaScript expression; in it, `page` is the object with the views."""
    return page.evaluate(f"(() => {{ const page = window.anhyst; return {text}; }})()")


def until(page: Page, condition: str) -> None:
    """Wait for a condition in the page; its security policy forbids Playwright's wait function.

    A condition on an element that does not exist yet is false, because views load their code late.
    """
    reason = "if (error instanceof TypeError) return false; throw error;"
    guarded = f"() => {{ try {{ return {condition}; }} catch (error) {{ {reason} }} }}"
    wait_for(lambda: page.evaluate(guarded))


def ready(page: Page) -> None:
    until(page, "window.anhyst?.store.count > 1000")


def state_is(page: Page, name: str) -> None:
    until(page, f"document.getElementById('state').textContent === '{name}'")


def lift(page: Page, served: Served) -> None:
    ready(page)
    state_is(page, "idle")
    press(page, "demagnetised")
    state_is(page, "ready")
    press(page, "lift")
    state_is(page, "run")
    tick = served.session.bench.tick
    wait_for(lambda: served.session.bench.tick > tick + 0.5 * served.session.bench.rate)


def last(page: Page, name: str) -> float:
    column = f"page.bench.signals.findIndex((one) => one.name === '{name}')"
    return float(seen(page, f"page.store.value({column}, page.store.count - 1)"))


def test_the_armature_is_lifted_and_stopped_by_one_key(serve: Serve, show: Show) -> None:
    served = serve()
    page = show(served)
    lift(page, served)
    until(
        page,
        "(() => { const s = window.anhyst.store; return Math.abs(s.value(0, s.count - 1) - 450e-6) < 1e-6 })()",
    )
    assert abs(last(page, "gap") - GAP) < 1e-6
    assert page.locator("#stop").is_visible()
    page.locator("#target").focus()  # Escape stops from anywhere, even from a field
    page.keyboard.press("Escape")
    state_is(page, "fault")
    until(page, "document.getElementById('fault').textContent === 'stopped'")
    assert served.session.status()["state"] == State.FAULT
    assert served.session.status()["fault"] == Fault.STOPPED


@pytest.mark.slow
def test_a_refused_order_gives_its_reason(serve: Serve, show: Show) -> None:
    page = show(serve())
    ready(page)
    page.locator("#record-name").fill("a/b")
    page.locator("#record").click()
    until(page, "!document.getElementById('notice').hidden")
    assert "no folder" in page.locator("#notice").inner_text()
    page.get_by_role("button", name="dismiss the message").click()
    assert page.locator("#notice").is_hidden()
    page.get_by_role("tab", name="5 log").click()
    entry = page.locator("#log li.failed")
    assert "no folder" in entry.inner_text()
    assert entry.locator("time").inner_text().endswith(" s")


@pytest.mark.slow
def test_an_observer_may_stop_and_take_control(serve: Serve, show: Show) -> None:
    served = serve()
    first = show(served)
    ready(first)
    second = show(served)
    ready(second)
    until(second, "document.body.classList.contains('watching')")
    for place in ("[data-order=demagnetised]", "#go", "#generate", "#record"):
        button = second.locator(f"#panel {place}").last
        assert button.is_disabled()
        assert "another browser" in (button.get_attribute("title") or "")
    press(second, "take over")
    press(first, "hand over to browser 2")
    until(first, "document.body.classList.contains('watching')")
    until(second, "!document.body.classList.contains('watching')")
    lift(second, served)
    first.keyboard.press("Escape")  # a watching browser can stop too
    state_is(second, "fault")


@pytest.fixture
def _every_row() -> Iterator[None]:
    with sending_all_samples():
        yield


@pytest.mark.slow
@pytest.mark.usefixtures("_every_row")
def test_a_trigger_shows_the_sample_that_crossed(serve: Serve, show: Show) -> None:
    served = serve()
    page = show(served)
    lift(page, served)
    page.select_option("#trigger-mode", "single")
    page.select_option("#trigger-signal", "gap")
    page.select_option("#trigger-edge", "falling")
    page.locator("#trigger-level").fill("440")
    page.locator("#target").fill("430")
    page.locator("#go").click()
    until(page, "window.anhyst.scope.held !== null && window.anhyst.scope.shot")
    hit, end = seen(page, "[page.scope.shot.hit, page.scope.shot.end]")
    before, at = seen(page, f"[-1, 0].map((n) => page.store.value(0, page.store.find({hit}) + n))")
    assert at <= 440e-6 < before
    window = seen(page, "page.scope.window") * served.session.bench.rate
    assert end - hit == pytest.approx(0.8 * window, abs=1)


@pytest.mark.slow
@pytest.mark.usefixtures("_every_row")
def test_a_trigger_at_minus_5_newtons_shows_and_records_the_sample_that_crossed(
    serve: Serve, show: Show
) -> None:
    served = serve()
    page = show(served)
    ready(page)
    page.select_option("#trigger-mode", "single")
    page.select_option("#trigger-signal", "load")
    page.select_option("#trigger-edge", "falling")
    page.locator("#trigger-level").fill("-5")
    page.locator("#record-name").fill("crossing")
    page.select_option("#record-kind", ".csv")
    page.get_by_text("Start and end").click()
    page.locator("#record-before").fill("0.05")
    page.locator("#record-lasts").fill("0.1")
    page.select_option("#record-edge", "falling")
    page.select_option("#record-signal", "load")
    page.locator("#record-level").fill("-5")
    page.locator("#record").click()
    until(page, "document.getElementById('recorded').textContent.includes('waits')")
    page.locator("#load").fill("-50")
    until(page, "window.anhyst.scope.held !== null && window.anhyst.scope.shot")
    hit = int(seen(page, "page.scope.shot.hit"))
    column = [signal.name for signal in served.session.bench.signals].index("load")
    drawn = [seen(page, f"page.store.value({column}, page.store.find({hit}) + {n})") for n in (-1, 0)]
    assert drawn[1] <= -5.0 < drawn[0]
    wait_for(lambda: served.session.recorder.status() is None)
    path = served.session.recorder.folder / "crossing.csv"
    rows = numbers(path)
    assert np.array_equal(rows[:, 0], np.arange(hit - 1000, hit + 2000))
    assert rows[999:1001, 2 + column].astype("f4").tolist() == drawn
    text = path.read_text()
    assert "in force: " in text
    assert "load_damping = 0.0 N s/m" in text
    assert "browser 1: load -50 N" in text


@pytest.mark.slow
def test_the_page_names_files_of_one_folder_alone(serve: Serve, show: Show) -> None:
    served = serve()
    page = show(served)
    ready(page)
    page.locator("#record-name").fill("../elsewhere")
    page.locator("#record").click()
    until(page, "document.getElementById('notice').textContent.includes('but no folder')")
    page.locator("#record-name").fill("last")
    page.locator("#keep").click()
    wait_for((served.session.recorder.folder / "last.mf4").exists)
    wait_for(lambda: served.session.recorder.status() is None)
    until(page, "document.getElementById('record-name').value === 'last-2'")
    assert [one.name for one in served.session.recorder.folder.iterdir()] == ["last.mf4"]


@pytest.mark.slow
def test_step_metrics_agree_with_the_recording(serve: Serve, show: Show, tmp_path: Path) -> None:
    record = tmp_path / "run.csv"
    served = serve(record=record)
    page = show(served)
    lift(page, served)
    page.locator("#target").fill("430")
    page.locator("#go").click()
    page.keyboard.press("Tab")
    page.get_by_role("tab", name="3 steps").click()
    page.wait_for_selector("#steps tbody tr")
    (step,) = seen(page, "page.finder.steps")
    stated = page.locator("#steps tbody tr td").nth(4).inner_text()
    served.end()
    rows = numbers(record)
    gap, reference = rows[:, 2], rows[:, 5]
    (jump,) = np.flatnonzero(np.abs(np.diff(reference)) > 19e-6) + 1
    after = gap[jump : jump + 1200]
    assert step["overshoot"] == pytest.approx(max(0.0, 100.0 * (430e-6 - after.min()) / 20e-6), abs=0.15)
    before = gap[jump - 1000 : jump]
    assert step["noise"] == pytest.approx(4.0 * 100.0 * before.std() / 20e-6, rel=0.01)
    assert step["overshoot"] < step["noise"]
    assert stated == f"none above the noise of {step['noise']:.1f} %"


@pytest.mark.slow
def test_switching_the_compensation_off_shows_a_larger_overshoot(serve: Serve, show: Show) -> None:
    served = serve()
    page = show(served)
    lift(page, served)
    page.get_by_role("tab", name="3 steps").click()
    for taken, on in ((1, "true"), (2, "false")):
        page.wait_for_selector(f"#compensation[aria-pressed={on}]")
        page.locator("#step-down").click()
        page.wait_for_selector(f"#steps tbody tr:nth-child({taken})")
        page.keyboard.press("c")  # off, then on again
    page.wait_for_selector("#compensation[aria-pressed=true]")
    rows = [row.split("\t") for row in page.locator("#steps tbody tr").all_inner_texts()]
    assert [row[1] for row in rows] == ["with compensation, 1 step", "without compensation, 1 step"]
    assert rows[0][4].startswith("none above the noise of 0.")
    assert float(rows[1][4].split()[0]) > 4.0
    message = [entry.text for entry in served.session.log if "compensation" in entry.text]
    assert message == ["compensation = 0", "compensation = 1"]


@pytest.mark.slow
def test_staged_values_are_applied_on_one_tick(serve: Serve, show: Show) -> None:
    served = serve()
    page = show(served)
    ready(page)
    page.get_by_role("tab", name="4 parameters").click()
    old = {parameter.name: parameter.value for parameter in served.session.parameters}
    drive = [parameter for parameter in served.session.parameters if parameter.name.startswith("load_")]
    staged = {one.name: 0.5 * one.high for one in drive}
    for name, value in staged.items():
        unit = next(one.unit for one in drive if one.name == name)
        page.get_by_label(labelled(name), exact=True).fill(f"{value} {unit}")
        page.get_by_label(labelled(name), exact=True).press("Tab")
    assert {parameter.name: parameter.value for parameter in served.session.parameters} == old
    page.get_by_role("button", name="Apply 2 staged").click()
    until(page, "document.getElementById('confirmed').textContent.includes('tick')")
    now = {parameter.name: parameter.value for parameter in served.session.parameters}
    assert {name: now[name] for name in old if now[name] != old[name]} == staged
    (entry,) = [one for one in served.session.log if " = " in one.text]
    assert all(name in entry.text for name in staged)
    assert str(entry.tick + 1) in page.locator("#confirmed").inner_text()
    page.keyboard.press("Tab")
    page.get_by_role("button", name="Roll back").click()
    wait_for(lambda: {parameter.name: parameter.value for parameter in served.session.parameters} == old)


@pytest.mark.slow
def test_drawn_values_equal_the_recording(serve: Serve, show: Show, tmp_path: Path) -> None:
    record = tmp_path / "run.csv"
    served = serve(record=record)
    page = show(served)
    lift(page, served)
    page.keyboard.press("Space")
    columns = seen(page, "page.bench.signals.length")
    pick = "Array.from({length: 500}, (_, i) => page.store.count - 500 + i)"
    ticks = seen(page, f"{pick}.map((row) => page.store.tick(row))")
    assert ticks == list(range(int(ticks[0]), int(ticks[0]) + 500))
    many = "Array.from({length: 500}, (_, i) => i)"
    table = [
        seen(page, f"{many}.map((i) => page.store.value({n}, page.store.find({ticks[0]}) + i))")
        for n in range(columns)
    ]
    served.end()
    rows = numbers(record)
    assert np.array_equal(rows[:, 0], np.arange(1, len(rows) + 1))
    expected = rows[int(ticks[0]) - 1 : int(ticks[-1]), 2:]
    assert np.array_equal(np.array(table).T, expected.astype("f4").astype(float))


@pytest.mark.slow
def test_no_spike_is_lost_between_pixels_and_missing_ticks_are_marked(serve: Serve, show: Show) -> None:
    page = show(serve())
    ready(page)
    low, high, holes, missing = page.evaluate(
        """async () => {
          const { Store } = await import("/assets/store.js");
          const store = new Store(1);
          const push = (first, n) => store.push({
            first, last: first + n - 1,
            ticks: Float64Array.from({ length: n }, (_, i) => first + i),
            data: [Float32Array.from({ length: n }, (_, i) => first + i === 54321 ? -9 : 0)],
          });
          for (let first = 1; first < 100000; first += 1000) push(first, first === 70001 ? 900 : 1000);
          const [column] = store.envelope([0], 1, 100000, 300).columns;
          const numbers = column.filter((value) => !Number.isNaN(value));
          return [Math.min(...numbers), Math.max(...numbers), column.filter((v) => Number.isNaN(v)).length,
                  store.missing];
        }"""
    )
    assert (low, high) == (-9, 0)
    assert holes > 0
    assert missing == [[70901, 71000]]


@pytest.mark.slow
def test_keys_choose_views_and_turn_the_light_off(serve: Serve, show: Show) -> None:
    page = show(serve())
    ready(page)
    theme = page.evaluate("document.documentElement.dataset.theme")
    for key, view in zip("2345", ("loop", "steps", "parameters", "log"), strict=True):
        page.keyboard.press(key)
        assert page.locator(f"#{view}").is_visible()
        assert page.locator("#stop").is_visible()
    page.keyboard.press("t")
    assert page.evaluate("document.documentElement.dataset.theme") != theme


@pytest.mark.slow
def test_the_token_is_requested_and_never_in_an_address(serve: Serve, show: Show) -> None:
    page = show(serve(token="a-token"))
    page.locator("#token input").fill("a-token")
    press(page, "Connect")
    ready(page)
    assert "a-token" not in page.url
