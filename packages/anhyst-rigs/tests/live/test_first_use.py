"""Test what an engineer needs who sees the page for the first time: each action has a visible result."""

from __future__ import annotations

import re
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from anhyst_rigs.dashboard.recording import RecordingSpan
from tests.live.conftest import Served, Show, sending_all_samples, shown, wait_for
from tests.live.test_desk import drop_file, record
from tests.live.test_page import last, lift, press, ready, seen, until
from tests.refusals import refused

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

pytestmark = pytest.mark.needs("chromium")


@pytest.fixture(scope="module")
def opened(browser: Browser, bearing: Served) -> Iterator[Page]:
    """One page of one lifted bearing, for all tests of this module."""
    with sending_all_samples(), shown(browser, bearing) as page:
        lift(page, bearing)
        yield page


@pytest.fixture
def page(opened: Page) -> Page:
    """The scope with a running picture, without trigger and overlays."""
    opened.set_viewport_size({"width": 1440, "height": 900})
    opened.locator("[data-view=scope]").click()
    opened.select_option("#trigger-mode", "off")
    for remove in opened.locator(".overlays button").all():
        remove.click()
    seen(opened, "page.scope.follow()")
    seen(opened, "page.scope.setWindow(0.5)")
    return opened


def legend(page: Page) -> list[str]:
    values: list[str] = page.locator("#scope .legend output").all_inner_texts()
    return values


def test_a_held_picture_keeps_its_rows_and_values_until_follow(bearing: Served, show: Show) -> None:
    page = show(bearing)
    ready(page)
    page.keyboard.press("Space")
    until(page, "window.anhyst.scope.view.to === window.anhyst.scope.held")
    page.wait_for_timeout(300)
    before, values = seen(page, "page.scope.table()"), legend(page)
    assert len(before["tick"]) > 1000
    page.evaluate(
        """() => {
          const { live } = anhyst.scope;
          const rows = 1 << 19;
          const ticks = Float64Array.from({ length: rows }, (_, n) => live.newest + 1 + n);
          const data = anhyst.bench.signals.map(() => new Float32Array(rows).fill(1));
          live.push({ first: ticks[0], last: ticks.at(-1), ticks, data });
        }"""
    )
    assert seen(page, "page.store.oldest > page.scope.view.to")
    page.wait_for_timeout(300)
    assert seen(page, "page.scope.table()") == before
    assert legend(page) == values
    page.keyboard.press("Space")
    assert seen(page, "page.scope.store === page.store")


def drawn_pixels(page: Page) -> int:
    """Return the number of pale pixels in the strips."""
    return int(
        page.evaluate(
            """() => [...document.querySelectorAll("#scope canvas")].reduce((sum, canvas) => {
              const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
              for (let n = 0; n < data.length; n += 4)
                if (data[n + 3] > 90 && data[n + 3] < 115) sum++;
              return sum;
            }, 0)"""
        )
    )


@pytest.mark.parametrize("mode", ["off", "auto", "normal", "single"])
def test_a_recording_is_visible_immediately_in_every_trigger_mode(
    page: Page, bearing: Served, mode: str
) -> None:
    path = record(bearing, f"old-{mode}.csv", RecordingSpan(1.0, 0.0))
    page.select_option("#trigger-mode", mode)
    if mode != "off":
        page.select_option("#trigger-signal", "force")
        page.locator("#trigger-level").fill("9999")  # N, which the force never crosses
        page.locator("#trigger-level").press("Tab")
    before = drawn_pixels(page)
    with page.expect_file_chooser() as chooser:
        page.locator("#overlay").select_option("file")
    chooser.value.set_files(path)
    until(page, "window.anhyst.scope.overlays.length === 1")
    entry = page.locator(".overlays .key")
    assert entry.locator("span").first.inner_text() == f"old-{mode}.csv: wide pale line, 1 s, its end at now"
    page.wait_for_timeout(200)
    assert seen(page, "page.scope.window") >= 1.0  # s; the whole recording is visible
    assert drawn_pixels(page) > before + 1000
    assert (
        seen(page, "page.scope.overlays[0].ticks.at(-1) + page.scope.overlays[0].shift - page.scope.view.to")
        == 0
    )
    entry.locator("input").fill("5000")
    until(page, "document.querySelector('.overlays .key').textContent.includes('outside the window')")
    low = seen(page, "page.scope.plot.strips[0].plot.scales.y.min")
    assert low > 440.0  # rows outside the window do not stretch the axis


def test_a_recording_of_the_bench_is_overlaid_and_saved_without_leaving_the_page(
    page: Page, bearing: Served
) -> None:
    name = page.locator("#record-name").input_value()
    page.select_option("#record-kind", ".mf4")
    press(page, "Keep last 10 s")
    page.get_by_text(re.compile(r"^Recordings \(")).click()
    link = page.locator("#recordings a").first
    until(page, f"document.querySelector('#recordings a')?.textContent === '{name}.mf4'")
    with page.expect_download() as saved:
        link.click()
    written = (bearing.session.recorder.folder / f"{name}.mf4").read_bytes()
    assert saved.value.path().read_bytes() == written
    page.locator("#overlay").select_option(f"{name}.mf4")
    until(page, "window.anhyst.scope.overlays.length === 1")
    assert seen(page, "page.scope.overlays[0].ticks.length") > 1000
    assert page.locator("#overlay").input_value() == ""


def test_a_table_of_a_held_picture_is_overlaid_on_it(page: Page, bearing: Served) -> None:
    page.keyboard.press("Space")
    with page.expect_download() as saved:
        press(page, "CSV")
    path = bearing.session.recorder.folder / saved.value.suggested_filename
    path.write_bytes(saved.value.path().read_bytes())
    drop_file(page, "#scope .timeplot", path)
    until(page, "window.anhyst.scope.overlays.length === 1")
    page.wait_for_timeout(200)
    assert seen(page, "page.scope.overlays[0].shift") == 0
    assert "its end at hold" in page.locator(".overlays .key").inner_text()
    page.locator("#scope .u-over").first.hover(position={"x": 400, "y": 30})
    page.mouse.wheel(0, -240)
    page.wait_for_timeout(200)
    assert seen(page, "page.scope.overlays[0].shift") == 0


def test_steps_of_an_earlier_setting_remain_with_their_colour(page: Page) -> None:
    kept = page.evaluate(
        """async () => {
          const { StepFinder } = await import("/assets/stepfinder.js");
          const { StepView } = await import("/assets/steps.js");
          let setting = "with compensation";
          const finder = new StepFinder({ rate: 1000, every: 1 }, 0, 1, () => setting);
          const place = document.createElement("div");
          const view = new StepView(place, anhyst.bench, finder);
          let tick = 0;
          const step = () => {
            const value = tick % 200 ? 2 : 1;
            const ticks = Array.from({ length: 100 }, () => ++tick);
            const actual = ticks.map((_, n) => value + 1e-3 * (n % 2));
            finder.feed({ ticks, data: [ticks.map(() => value), actual] });
          };
          const shown = () => {
            view.draw();
            return [...place.querySelectorAll("tbody tr")].map((row) => [
              row.children[1].textContent, row.children[4].textContent, row.querySelector("i").style.background]);
          };
          const many = (count) => { for (let n = 0; n < count; n++) step(); };
          many(3);
          const first = shown();
          setting = "with compensation, Proportional gain × 0.8";
          many(50);
          const second = shown();
          for (let n = 0; n < 7; n++) {
            setting = `with compensation, Proportional gain × ${2 + n}`;
            many(1);
          }
          return [first, second, shown()];
        }"""
    )
    first, second, third = kept
    assert [row[0] for row in first] == ["with compensation, 2 steps"]
    assert [row[0] for row in second] == [
        "with compensation, Proportional gain × 1, 2 steps",
        "with compensation, Proportional gain × 0.8, 12 steps",
    ]
    assert first[0][2] == second[0][2] != second[1][2]
    assert len(third) == len({row[2] for row in third}) == 8
    assert third[1][0::2] == [second[1][0], second[1][2]]
    assert (
        third[0][0] == "with compensation, Proportional gain × 8, 1 step"
    )  # the oldest setting was replaced


def test_an_overshoot_within_the_noise_is_not_stated(page: Page) -> None:
    found = page.evaluate(
        """async () => {
          const { measure } = await import("/assets/stepfinder.js");
          const noise = (n) => 1e-3 * (n % 2 ? 1 : -1);
          const value = (top, n) => (n < 10 ? 0 : n < 15 ? top : 1) + noise(n);
          const rows = (top) => Array.from({ length: 80 }, (_, n) => [n, n < 10 ? 0 : 1, value(top, n)]);
          return [1, 1.1].map((top) => measure(rows(top), 10, 1000));
        }"""
    )
    assert [one["noise"] for one in found] == pytest.approx([0.4, 0.4])
    assert found[0]["overshoot"] < found[0]["noise"]
    assert found[1]["overshoot"] == pytest.approx(10.1)


def test_real_steps_are_shown_up_to_three_settling_times(page: Page) -> None:
    page.locator("[data-view=steps]").click()
    for button in ("#step-up", "#step-down"):
        page.locator(button).click()
        page.wait_for_timeout(400)
    row = page.locator("#steps tbody tr").first
    until(page, "document.querySelector('#steps tbody tr td:nth-child(2)').textContent.includes('2 steps')")
    cells = row.locator("td").all_inner_texts()
    assert cells[3].split()[1] == "%"
    settling = max(seen(page, "page.finder.steps.map((step) => step.settling)"))
    end = seen(page, "page.views.get('steps').plane.limits[1]")
    assert end == pytest.approx(1e3 * max(0.005, 3.0 * settling))
    assert end < 60.0


def test_the_table_states_how_many_steps_did_not_settle(page: Page) -> None:
    texts = page.evaluate(
        """async () => {
          const { StepView } = await import("/assets/steps.js");
          const common = { label: "as compiled", noise: 1, overshoot: 0 };
          const times = [[0.002, 0.005, 1e-5], [0.002, Infinity, -1e-5], [NaN, Infinity, 1e-5]];
          const steps = times.map(([rise, settling, height]) => ({ ...common, rise, settling, height }));
          const view = new StepView(document.createElement("div"), anhyst.bench, { settings: ["as compiled"], steps });
          return view.words()[0].map(([text]) => text);
        }"""
    )
    assert texts[1].startswith("Height: ±10 µm")
    assert texts[-2:] == [
        "Rise 10–90 %: 2.00 ms; 1 of 3 did not rise to 90 %",
        "Settling to 5 %: 5.0 ms; 2 of 3 did not settle",
    ]


def test_a_step_beyond_the_range_does_not_block_the_next_one(page: Page) -> None:
    page.locator("#target").fill("540")
    page.locator("#go").click()
    until(page, "Math.abs(window.anhyst.panel.activeTarget - 540e-6) < 1e-9")
    page.locator("#step").fill("20")
    page.locator("#step-up").click()
    page.get_by_text("Choose 350 to").wait_for()
    page.locator("#step-down").click()
    until(page, "Math.abs(window.anhyst.panel.activeTarget - 520e-6) < 1e-9")
    page.locator("#target").fill("450")
    page.locator("#go").click()


def test_a_recording_of_another_rig_is_refused_or_states_what_it_lacks(page: Page, tmp_path: Path) -> None:
    path = tmp_path / "other.csv"
    path.write_text("tick,t_s,gap_m,other_N\n" + "".join(f"{n},{n / 1e4},4e-4,1\n" for n in range(100)))
    drop_file(page, "#scope .timeplot", path)
    until(
        page, "document.getElementById('notice').textContent.includes('10000 ticks per second, but this rig')"
    )
    path.write_text("tick,t_s,gap_m,other_N\n" + "".join(f"{n},{n / 2e4},4e-4,1\n" for n in range(100)))
    drop_file(page, "#scope .timeplot", path)
    entry = page.locator(".overlays .key span").first
    entry.wait_for()
    assert entry.inner_text().startswith("other.csv, only 1 of 21 signals: wide pale line")


def test_the_recorder_says_what_it_has_written(page: Page, bearing: Served) -> None:
    bench = bearing.session.bench
    wait_for(lambda: bench.tick > 10.5 * bench.rate)
    page.locator("#record-name").fill("told")
    page.select_option("#record-kind", ".mf4")
    page.locator("#keep").click()
    until(page, "document.getElementById('recorded').textContent.startsWith('told.mf4 written, 10.0 s')")
    folder = bearing.session.recorder.folder.resolve()
    assert page.locator("#recorded").inner_text().endswith(f", in {folder}")
    page.locator("#record").click()
    until(page, "document.getElementById('recorded').textContent.includes('told-2.mf4: ')")
    page.locator("#record-stop").click()
    until(page, "document.getElementById('recorded').textContent.startsWith('told-2.mf4 written, ')")


def test_a_trigger_starts_at_the_mean_of_its_signal(page: Page) -> None:
    page.select_option("#trigger-mode", "auto")
    page.select_option("#trigger-signal", "gap")
    level = page.locator("#trigger-level")
    target = seen(page, "1e6 * page.panel.activeTarget")
    assert float(level.input_value()) == pytest.approx(target, abs=0.5)
    until(page, "window.anhyst.scope.shot")  # noise crosses the mean
    page.select_option("#trigger-signal", "current")
    assert float(level.input_value()) == pytest.approx(last(page, "current"), rel=0.1)
    level.fill("99")
    level.press("Tab")
    waits = page.get_by_text("not triggered")
    waits.wait_for(state="visible")
    page.select_option("#trigger-signal", "reference")
    assert float(level.input_value()) > target  # a constant signal never crosses its mean
    page.locator("#step-up").click()
    waits.wait_for(state="hidden")
    page.select_option("#trigger-signal", "current")
    assert level.input_value() == "99"
    page.locator("#step-down").click()


def test_the_sliders_follow_the_target(page: Page, bearing: Served) -> None:
    slider = page.get_by_label("target, slider", exact=True)

    def slider_value() -> float:
        return 350.0 + 0.2 * float(slider.input_value())

    for value in (450.0, 470.0):
        page.locator("#target").fill(str(value))
        page.locator("#go").click()
        until(page, f"Math.abs(window.anhyst.panel.activeTarget - {1e-6 * value}) < 1e-9")
        assert slider_value() == pytest.approx(value, abs=0.5)
    page.locator("#step").fill("20")
    page.locator("#step-down").click()
    until(page, "Math.abs(window.anhyst.panel.activeTarget - 450e-6) < 1e-9")
    assert slider_value() == pytest.approx(450.0, abs=0.5)
    bearing.session.run_between_chunks(lambda: bearing.session.bench.demand(440e-6))
    until(page, "document.getElementById('target').value === '440'")
    assert slider_value() == pytest.approx(440.0, abs=0.5)
    box = slider.bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + 0.75 * box["width"], box["y"] + box["height"] / 2)
    page.mouse.down()
    bearing.session.run_between_chunks(lambda: bearing.session.bench.demand(450e-6))
    until(page, "Math.abs(window.anhyst.panel.activeTarget - 450e-6) < 1e-9")
    assert slider_value() > 480.0  # the user holds the slider
    page.mouse.up()


def test_a_slider_panel_follows_the_target(page: Page, bearing: Served) -> None:
    page.locator("[data-view='desk 0']").click()
    page.get_by_label("add a panel").locator("visible=true").select_option("slider")
    demand = bearing.session.bench.demand
    for value in (460, 450):
        bearing.session.run_between_chunks(partial(demand, 1e-6 * value))
        until(
            page, f"[...document.querySelectorAll('.slider-panel input.number')].at(-1).value === '{value}'"
        )


def test_a_measurement_states_why_no_target_can_be_set(page: Page) -> None:
    note = page.locator(".main p")
    assert note.inner_text() == "Running: set a target, or start the generator."
    place = page.locator("fieldset[data-order=target]")
    before = place.bounding_box()
    page.locator("[data-view=bode]").click()
    page.locator("#measure-response:enabled").wait_for()
    page.locator("#measure-response").click()
    until(page, "document.querySelector('.main p').textContent.startsWith('Running. A measurement drives')")
    assert page.locator("#go").is_disabled()
    assert place.bounding_box() == before  # the longer hint moves nothing
    page.locator("#measure-response").click()
    until(page, "!document.getElementById('go').disabled")


def test_pictures_name_recordings_and_figures_and_the_page_names_the_file(
    page: Page, bearing: Served
) -> None:
    drop_file(page, "#scope .timeplot", record(bearing, "named.csv", RecordingSpan(0.5, 0.0)))
    until(page, "window.anhyst.scope.overlays.length === 1")
    assert "named.csv" in str(seen(page, "page.scope.words()"))
    with page.expect_download() as saved:
        press(page, "PNG")
    name = saved.value.suggested_filename
    assert re.fullmatch(r"bearing-scope-20\d{6}-\d{6}\.png", name)
    until(page, f"document.querySelector('#notice span').textContent === 'saved as {name}'")
    page.locator("[data-view=steps]").click()
    page.locator("#step-up").click()
    until(page, "window.anhyst.finder.steps.length > 0")
    page.locator("#step-down").click()
    words = str(seen(page, "page.views.get('steps').words()"))
    assert re.search(r"with compensation, \d+ steps?', '#0072b2'\], \['Height: ", words)
    assert re.search(r"Noise before: [\d.]+ %", words)
    assert "Settling to 5 %: " in words


def test_the_log_has_the_names_and_units_of_the_page(page: Page) -> None:
    plain = page.evaluate(
        """async () => {
          const { inPlainWords } = await import("/assets/verbs.js");
          const texts = ["compensation = 0, a = 1", "target 0.00047 m",
            "gain_p = 4.093e+06", "load -50 N", "lift", "speed 0.5 m/s",
            "frequency response with a motion up to 5 um", "run.mf4 written, 10.0 s", "derived signal a = 2 * gap"];
          return texts.map((text) => inPlainWords(text, anhyst.bench));
        }"""
    )
    assert plain == [
        "Compensation off, a = 1",
        "Target 470 µm",
        "Proportional gain 4.093 MN/m",
        "Load -50 N",
        "Lift",
        "Speed 0.5 m/s",
        "Frequency response with a motion up to 5 µm",
        "run.mf4 written, 10.0 s",
        "Derived signal a = 2 * gap",
    ]


def test_the_target_of_a_bearing_ends_at_the_stops(page: Page, bearing: Served) -> None:
    target = page.locator("#target")
    target.fill("565")
    assert page.locator("output.invalid:visible").inner_text() == "Choose 350 to 550 µm."
    target.fill("450")
    with refused("out-of-range demand: 0.000565; 0.00055 m"):
        bearing.session.run_between_chunks(lambda: bearing.session.bench.demand(565e-6))


def test_the_compensation_is_a_checkbox_among_the_parameters(page: Page, bearing: Served) -> None:
    page.locator("[data-view=parameters]").click()
    box = page.get_by_label("Compensation, on")
    assert box.is_checked()
    box.uncheck()
    page.locator("#apply").click()
    until(page, "document.getElementById('parameters').textContent.includes('now off')")
    assert not box.is_checked()
    assert {one.name: one.value for one in bearing.session.parameters}["compensation"] == 0.0
    page.keyboard.press("c")
    until(page, "document.getElementById('parameters').textContent.includes('now on')")
    assert box.is_checked()
