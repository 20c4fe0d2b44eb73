"""Test the signals, the desks, the inputs and the messages of the page, as an engineer uses them."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

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
def page(opened: Page) -> Page:
    """The scope with a running picture."""
    opened.set_viewport_size({"width": 1440, "height": 900})
    opened.locator("[data-view=scope]").click()
    seen(opened, "page.scope.follow()")
    return opened


def desk_of(page: Page) -> dict[str, Any]:
    """Return the layout of the first desk."""
    found: dict[str, Any] = seen(page, "page.desks.layouts[0]")
    return found


def open_desk(page: Page) -> None:
    """Open the first desk, and wait for the code of its panels."""
    page.locator("[data-view='desk 0']").click()
    until(page, "window.anhyst.desks.desks[0].open.every(({ panel }) => panel.element)")


def drop_file(page: Page, place: str, path: Path) -> None:
    """Drop a file on an element of the page."""
    page.evaluate(
        """([place, name, text]) => {
          const transfer = new DataTransfer();
          transfer.items.add(new File([Uint8Array.from(atob(text), (one) => one.charCodeAt(0))], name));
          const drop = new DragEvent("drop", { dataTransfer: transfer, bubbles: true, cancelable: true });
          document.querySelector(place).dispatchEvent(drop);
        }""",
        [place, path.name, base64.b64encode(path.read_bytes()).decode()],
    )


def record(served: Served, name: str, span: RecordingSpan) -> Path:
    """Record some time of the bench; return the path of the file."""
    served.session.run_between_chunks(lambda: served.session.record(name, span))
    wait_for(lambda: served.session.recorder.status() is None)
    return served.session.recorder.folder / name


def test_signals_have_distinct_lines_and_readable_names(page: Page) -> None:
    signals = seen(page, "page.bench.signals")
    lines = {(one["colour"], str(one["dash"])) for one in signals}
    assert len(lines) == len(signals) > 20
    assert [one["label"] for one in signals if "_" in one["label"]] == []
    entry = page.locator("#signal-list [data-signal=current_read]")
    assert entry.inner_text().startswith("Measured current i")
    assert "current_read" in (entry.get_attribute("title") or "")


def test_the_list_is_searched_and_a_signal_is_dragged_into_the_plot(page: Page) -> None:
    page.locator("#signal-search").fill("flux dens")
    visible = [one for one in page.locator("#signal-list li").all() if one.is_visible()]
    assert [one.get_attribute("data-signal") for one in visible] == ["flux_density"]
    assert not seen(page, "page.scope.plot.names.has('flux_density')")
    page.locator("[data-signal=flux_density]").drag_to(page.locator("#scope .u-over").first)
    assert seen(page, "page.scope.plot.names.has('flux_density')")
    page.locator("#signal-search").fill("no such thing")
    assert page.get_by_text("No signal has this name.").is_visible()
    page.locator("#signal-search").fill("")
    box = page.locator("#signal-list").get_by_label("flux_density", exact=True)
    wait_for(box.is_checked)
    box.uncheck()
    assert not seen(page, "page.scope.plot.names.has('flux_density')")


def test_times_are_relative_and_the_axes_have_names(page: Page) -> None:
    view = seen(page, "page.scope.view")
    assert view["zero"] == view["to"]
    strips = "page.scope.plot.strips"
    name = seen(page, f"{strips}[0].plot.axes[1].label({strips}[0].plot)")
    assert name == "Gap, Reference / µm"
    assert seen(page, f"{strips}.at(-1).plot.axes[0].label()") == "Time from now / ms"
    page.keyboard.press("Space")
    assert seen(page, f"{strips}.at(-1).plot.axes[0].label()") == "Time from hold / ms"


def test_panels_are_added_moved_resized_and_removed_by_keys(page: Page) -> None:
    open_desk(page)
    count = len(desk_of(page)["panels"])
    page.get_by_label("add a panel").locator("visible=true").select_option("gauge")
    panels = desk_of(page)["panels"]
    assert len(panels) == count + 1
    new = panels[-1]
    title = page.locator(".panel h2", has_text="Gauge").last
    title.focus()
    page.keyboard.press("ArrowRight")
    page.keyboard.press("Shift+ArrowRight")
    moved = desk_of(page)["panels"][-1]
    assert (moved["x"], moved["w"]) == (new["x"] + 1, new["w"] + 1)
    page.keyboard.press("Delete")
    assert len(desk_of(page)["panels"]) == count


def test_a_loop_fills_its_panel(page: Page) -> None:
    open_desk(page)
    panel = page.locator(".panel", has=page.locator(".loop-panel"))
    boxes = [panel.locator(place).first.bounding_box() for place in ("canvas", ".body")]
    assert boxes[0] is not None
    assert boxes[1] is not None
    assert boxes[0]["height"] > 0.9 * boxes[1]["height"]


def test_a_panel_is_dragged_and_no_panels_overlap(page: Page) -> None:
    open_desk(page)
    before = desk_of(page)["panels"][0]
    title = page.locator(".panel h2", has_text="Plot").first
    box = title.bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 5, box["y"] + 5)
    page.mouse.down()
    page.mouse.move(box["x"] + 300, box["y"] + 8, steps=5)
    page.mouse.up()
    panels = desk_of(page)["panels"]
    assert panels[0]["x"] > before["x"]
    cells = [
        (x, y)
        for one in panels
        for x in range(one["x"], one["x"] + one["w"])
        for y in range(one["y"], one["y"] + one["h"])
    ]
    assert len(cells) == len(set(cells))


def test_desks_survive_a_reload_and_a_way_through_a_file(page: Page, tmp_path: Path) -> None:
    open_desk(page)
    page.get_by_label("add a panel").locator("visible=true").select_option("number")
    layouts = seen(page, "page.desks.layouts")
    with page.expect_download() as saved:
        page.get_by_role("button", name="Export").locator("visible=true").click()
    path = tmp_path / "desks.json"
    path.write_bytes(saved.value.path().read_bytes())
    assert json.loads(path.read_text())["desks"] == layouts
    page.reload()
    ready(page)
    assert seen(page, "page.desks.layouts") == layouts
    page.get_by_role("button", name="Remove desk").locator("visible=true").click()
    assert desk_of(page)["panels"] == []
    page.get_by_text("This desk is empty.").wait_for()
    page.locator(".desk input[type=file]").first.set_input_files(path)
    until(page, "window.anhyst.desks.layouts[0].panels.length > 0")
    assert seen(page, "page.desks.layouts") == layouts
    path.write_text("{}")
    page.locator(".desk input[type=file]").first.set_input_files(path)
    until(page, "document.getElementById('notice').textContent.includes('is not a file of desks')")


def test_both_file_formats_give_the_recorded_values(page: Page, bearing: Served) -> None:
    found = {}
    for kind, reader in ((".csv", "readCsv"), (".mf4", "readMdf")):
        path = record(bearing, f"read{kind}", RecordingSpan(0.2, 0.0))
        found[kind] = page.evaluate(
            """async ([text, reader]) => {
              const bytes = Uint8Array.from(atob(text), (one) => one.charCodeAt(0));
              const files = await import("/assets/recordings.js");
              const table = files[reader](reader === "readCsv" ? new TextDecoder().decode(bytes) : bytes.buffer);
              return [[...table.ticks], [...(table.columns.get("voltage_V") ?? table.columns.get("voltage"))]];
            }""",
            [base64.b64encode(path.read_bytes()).decode(), reader],
        )
    rows = numbers(bearing.session.recorder.folder / "read.csv")
    head = (bearing.session.recorder.folder / "read.csv").read_text().splitlines()[0].split(",")
    ticks, voltages = found[".csv"]
    assert ticks == rows[:, 0].tolist()
    assert np.array_equal(np.array(voltages, "f4"), rows[:, head.index("voltage_V")].astype("f4"))
    ticks, _ = found[".mf4"]
    assert np.all(np.diff(ticks) == 1.0)
    assert len(ticks) == 4000


def test_a_dropped_recording_is_overlaid_and_aligned_by_the_trigger(page: Page, bearing: Served) -> None:
    lift(page, bearing)
    record_start = bearing.session.bench.tick
    bearing.session.run_between_chunks(lambda: bearing.session.record("step.mf4", RecordingSpan(0.0, 0.5)))
    page.locator("#target").fill("430")
    page.locator("#go").click()
    wait_for(lambda: bearing.session.recorder.status() is None)
    page.select_option("#trigger-mode", "single")
    page.select_option("#trigger-signal", "reference")
    page.select_option("#trigger-edge", "falling")
    page.locator("#trigger-level").fill("425")
    drop_file(page, "#scope .timeplot", bearing.session.recorder.folder / "step.mf4")
    until(page, "window.anhyst.scope.overlays.length === 1")
    assert page.get_by_text("step.mf4: wide pale line").is_visible()
    page.locator("#trigger-level").fill("440")
    page.locator("#trigger-level").press("Tab")
    page.locator("#target").fill("450")
    page.keyboard.press("Enter")
    page.locator("#target").fill("430")
    page.keyboard.press("Enter")
    until(page, "window.anhyst.scope.held !== null && window.anhyst.scope.shot")
    hit = seen(page, "page.scope.shot.hit")
    crossed = seen(
        page,
        """(() => { const { ticks, columns, shift } = page.scope.overlays[0];
        const r = columns.get("reference");
        const n = r.findIndex((value, i) => i && r[i - 1] > 440e-6 && value <= 440e-6);
        return ticks[n] + shift; })()""",
    )
    assert crossed == hit
    assert hit > record_start + 10_000
    drop_file(page, "#scope .timeplot", Path(__file__))
    until(page, "document.getElementById('notice').textContent.includes('is not a recording')")
    page.select_option("#trigger-mode", "off")
    page.get_by_role("button", name="remove step.mf4").click()
    press(page, "land")
    state_is(page, "ready")


def fill_derived(page: Page, name: str, expression: str, unit: str = "") -> None:
    """Fill the form of a derived signal, and send it."""
    page.evaluate("document.getElementById('derived').open = true")
    for field, text in (("name", name), ("expression", expression), ("unit", unit)):
        page.locator(f"#derived-{field}").fill(text)
    page.locator("#derived-add").click()


def test_a_derived_signal_is_plotted_and_a_wrong_one_gives_its_reason(page: Page, bearing: Served) -> None:
    fill_derived(page, "sum", "gap + gapp")
    until(page, "document.querySelector('#derived .invalid').textContent.includes('not a signal')")
    fill_derived(page, "sum", "2 * gap_m", "m")
    wait_for(page.locator("#signal-list").get_by_label("sum", exact=True).is_checked)
    column = "page.bench.signals.findIndex((one) => one.name === 'sum')"
    until(
        page,
        f"(() => {{ const page = window.anhyst; return page.store.value({column}, page.store.count - 1) > 0 }})()",
    )
    double, gap = seen(page, f"[{column}, 0].map((n) => page.store.value(n, page.store.count - 1))")
    assert double == pytest.approx(2.0 * gap, rel=1e-5)
    page.get_by_role("button", name="delete sum").click()
    until(page, "window.anhyst.bench.signals.at(-1).name === 'flags'")
    assert bearing.session.derived.definitions == ()


def define(page: Page, name: str, expression: str) -> None:
    fill_derived(page, name, expression, "m")
    until(page, f"window.anhyst.bench.signals.at(-1).name === '{name}'")


def test_the_page_goes_on_after_a_shown_derived_signal_was_deleted(page: Page) -> None:
    define(page, "first", "2 * gap")
    define(page, "second", "3 * gap")
    page.select_option("#trigger-mode", "auto")
    page.select_option("#trigger-signal", "second")
    page.locator("[data-view=spectrum]").click()
    page.select_option("#spectrum-signal", "second")
    open_desk(page)
    places = [f".{panel}-panel" for panel in ("number", "gauge", "loop")]
    for place in places:
        page.locator(".panel", has=page.locator(place)).locator("select").first.select_option("first")
    page.get_by_role("button", name="delete first").click()
    until(page, "window.anhyst.bench.signals.at(-1).name === 'second'")
    for place in places:
        page.locator(place, has_text="does not exist any more").wait_for()
    assert seen(page, "page.scope.triggers.mode.value") == "auto"  # its column has moved
    page.get_by_role("button", name="delete second").click()
    until(page, "window.anhyst.scope.triggers.mode.value === 'off'")
    options = page.locator("#trigger-signal, #spectrum-signal, #record-signal").locator("option")
    assert not {"first", "second"} & set(options.evaluate_all("all => all.map((one) => one.value)"))
    page.locator("[data-view=spectrum]").click()
    until(page, "document.getElementById('spectrum-note').textContent.includes('does not exist any more')")
    page.select_option("#spectrum-signal", "gap")
    until(page, "document.getElementById('spectrum-note').textContent.includes('rms')")
    open_desk(page)
    for place, name in zip(places, ("gap", "current", "force"), strict=True):
        page.locator(".panel", has=page.locator(place)).locator("select").first.select_option(name)
    drawn = seen(page, "page.store.newest")
    until(page, f"window.anhyst.scope.view.to > {drawn} + 2000")


def test_a_field_accepts_units_and_states_its_range(page: Page, bearing: Served) -> None:
    target = page.locator("#target")
    message = page.locator("fieldset[data-order=target] .invalid").first
    for text, expected in (
        ("9999", "Choose 350 to 550 µm."),
        ("abc", "Enter a number"),
        ("5 kg", "is not a unit"),
    ):
        target.fill(text)
        assert expected in message.inner_text()
        assert target.get_attribute("aria-invalid") == "true"
        target.press("Enter")
    assert bearing.session.status()["target"] == pytest.approx(430e-6)
    for text, expected_um in (("0.4 mm", 400.0), ("410", 410.0), ("420 um", 420.0), ("0,00043 m", 430.0)):
        target.fill(text)
        assert message.is_hidden()
        target.press("Enter")
        until(page, f"document.getElementById('panel').innerText.includes('now {expected_um:g} µm')")
        assert bearing.session.status()["target"] == pytest.approx(1e-6 * expected_um)
    target.press("ArrowUp")
    assert float(target.input_value()) == pytest.approx(432.0)
    target.press("Shift+ArrowDown")
    assert float(target.input_value()) == pytest.approx(431.8)


def test_a_parameter_beyond_its_range_cannot_be_staged(page: Page) -> None:
    page.locator("[data-view=parameters]").click()
    page.get_by_label("Proportional gain", exact=True).fill("999999999")
    assert page.locator("#apply").is_disabled()
    assert "1.706 to 6.821 MN/m" in page.locator("#parameters .invalid").locator("visible=true").inner_text()
    value = seen(page, "page.parameters.value('gain_p')")
    page.get_by_label("Proportional gain", exact=True).fill("4")
    page.get_by_label("Proportional gain", exact=True).fill("49")
    page.keyboard.press("Control+Enter")  # 4 MN/m is staged, but is not what the field shows
    page.wait_for_timeout(300)
    assert seen(page, "page.parameters.value('gain_p')") == value
    page.get_by_label("Proportional gain", exact=True).fill("4000 kN/m")
    assert page.locator("#apply").is_enabled()
    page.get_by_role("button", name="Discard").click()


def test_each_state_has_one_main_command_and_is_marked(page: Page) -> None:
    current = "document.querySelector('.states [aria-current] b').textContent"
    main = page.locator(".main button")
    if seen(page, current) == "Idle":
        assert main.inner_text() == "Condition iron"
        press(page, "demagnetised")
    until(page, f"{current} === 'Ready'")
    until(page, "document.querySelector('.main button')?.textContent === 'Lift'")
    assert "hold it at the target" in (main.get_attribute("title") or "")
    main.click()
    until(page, f"{current} === 'Run'")
    until(page, "document.getElementById('go').classList.contains('primary')")
    assert main.count() == 0
    press(page, "land")
    until(page, f"{current} === 'Ready'")


def test_an_error_names_no_folder_and_does_not_move_the_page(page: Page, bearing: Served) -> None:
    record(bearing, "twice.csv", RecordingSpan(0.1, 0.0))
    before = page.locator("#scope").bounding_box()
    page.locator("#record-name").fill("twice")
    page.select_option("#record-kind", ".csv")
    page.locator("#record").click()
    until(page, "document.getElementById('notice').textContent.includes('exists already')")
    assert page.locator("#notice span").inner_text() == "twice.csv: exists already; choose a new name"
    assert page.locator("#scope").bounding_box() == before


def test_on_a_telephone_the_plot_is_first(page: Page) -> None:
    page.set_viewport_size({"width": 390, "height": 844})
    plot = page.locator("#scope .u-over").first.bounding_box()
    assert plot is not None
    assert plot["y"] < 200.0
    below = page.locator("#signals").bounding_box()
    assert below is not None
    assert below["y"] > plot["y"] + plot["height"]
