"""Test the simulation report: it shows its inputs, uses only one file, and is readable."""

from __future__ import annotations

import math
import re
import shutil
import subprocess
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import pytest

from anhyst.control.controller_file import ControllerTable, read_controller
from anhyst_rigs.reports.bearing.figures import window_s
from anhyst_rigs.reports.bearing.page import render
from anhyst_rigs.reports.bearing.subject import SimulationSubject, difference_text
from anhyst_rigs.reports.benefit import render_bearing
from anhyst_rigs.reports.study.page import COLOURS, interval_text
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.study.bearing.responses import group_by_step, judge_steps
from anhyst_rigs.study.engine.beneficial_conditions import BENEFICIAL_CONDITIONS
from anhyst_rigs.study.engine.table import Interval, compare
from tests.page import NAMESPACES, Page
from tests.reports import bearing_reports
from tests.reports.bearing_reports import EXAMPLE, GAP, OVERSHOOT, cells, rig


@pytest.fixture(scope="module")
def html(subject: SimulationSubject) -> str:
    return render(subject)


@pytest.fixture(scope="module")
def page(html: str) -> Page:
    return Page(html)


def test_every_part_has_its_section_in_order(page: Page) -> None:
    assert page.sections() == [
        "steps", "forces", "loops", "tracking", "standstill", "frequency", "structure",
        "tables", "origin",
    ]  # fmt: skip


def test_absent_parts_have_no_section(rig: BodyRig, controller: ControllerTable) -> None:
    bare = Page(render(SimulationSubject(rig, controller, seeds=20)))
    assert bare.sections() == ["structure", "tables", "origin"]


def test_the_answer_comes_first_and_no_prose_contains_identifiers(page: Page) -> None:
    page.check_answer_first()


def test_the_check_of_a_page_fails_on_an_identifier_and_on_an_early_table(html: str) -> None:
    with pytest.raises(AssertionError):
        Page(html.replace("<h1>", "<h1>gap_m ")).check_answer_first()
    with pytest.raises(AssertionError):
        Page(
            html.replace('<ul class="tiles">', '<div class="table"></div><ul class="tiles">')
        ).check_answer_first()


@pytest.mark.parametrize(
    ("settling_times", "hold_s", "window"),
    [
        ([0.006, 0.05], 0.2, 0.0625),
        ([0.05], 0.055, 0.055),
        ([0.01, math.inf], 0.2, 0.2),
        ([], 0.2, 0.2),
        ([0.0], 0.2, 0.2),
    ],
)
def test_the_window_contains_the_settling_and_ends_with_the_hold(
    settling_times: list[float], hold_s: float, window: float
) -> None:
    assert window_s(settling_times, hold_s) == pytest.approx(window)


def test_the_page_fetches_nothing(html: str, page: Page) -> None:
    assert set(re.findall(r"https?://[^\s\"'<>)]+", html)) <= NAMESPACES
    assert not {"script", "link", "iframe", "object", "embed", "base"} & {t for t, _ in page.tags}
    for _, given in page.tags:
        for name in ("src", "href", "xlink:href"):
            assert (given.get(name) or "#").startswith(("#", "data:image/png;base64,"))
    assert all(target.startswith("#") for target in re.findall(r"url\(([^)]*)\)", html))


def test_the_page_is_well_formed_and_its_figures_have_descriptions(html: str, page: Page) -> None:
    assert page.open == []
    ids = [given["id"] for _, given in page.tags if given.get("id")]
    assert len(ids) == len(set(ids))
    drawn = re.findall(r"<svg\b.*?</svg>", html, flags=re.DOTALL)
    reported = [given.get("aria-label") or "" for _, given in page.tags if given.get("role") == "img"]
    assert len(drawn) == len(reported) == 10
    assert all(len(text) > 40 for text in reported)
    for text in drawn:
        assert ET.fromstring(text).tag == "{http://www.w3.org/2000/svg}svg"


@pytest.mark.slow
def test_equal_subjects_give_equal_bytes(html: str, subject: SimulationSubject) -> None:
    assert render(subject) == html


@pytest.fixture
def _undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Omit the figures, because these tests check texts and tables only."""
    monkeypatch.setattr("anhyst_rigs.reports.study.page.svg_text", lambda figure, prefix: "<svg/>")


def every_variant(subject: SimulationSubject) -> SimulationSubject:
    """Steps at three gaps with every variant, most of them with remarks."""
    (one,) = (cell for cell in cells() if cell.variant == "full" and cell.height == 10e-6)
    noise = {**one.figures, "noise_percent": Interval(20.0, 0.05, 20)}
    steps = [
        replace(one, variant=name, gap=gap, height=height, figures=noise)
        for name in COLOURS
        for gap in (0.42e-3, GAP, 0.48e-3)
        for height in (10e-6, 100e-6)
    ]
    return replace(subject, steps=group_by_step(steps))


@pytest.mark.usefixtures("_undrawn")
def test_tables_with_every_variant_wrap_and_narrow_ones_do_not(subject: SimulationSubject) -> None:
    page = Page(render(every_variant(subject)))
    tables = [str(given.get("class")) for tag, given in page.tags if tag == "figure"]
    assert tables.count("table wide") >= 3
    assert tables.count("table") >= 3


@pytest.mark.slow
@pytest.mark.usefixtures("_undrawn")
def test_a_browser_shows_every_table_whole(subject: SimulationSubject, tmp_path: Path) -> None:
    chromium = shutil.which("chromium")
    if chromium is None:
        pytest.skip("chromium is missing: apt install chromium")
    beyond = (
        "<script>document.body.setAttribute('data-beyond', Math.max(...Array.from("
        "document.querySelectorAll('.scroll'), one => one.scrollWidth - one.clientWidth)))"
        "</script></body>"
    )
    place = tmp_path / "report.html"
    place.write_text(render(every_variant(subject)).replace("</body>", beyond), encoding="utf-8")
    words = (
        "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--dump-dom",
        "--disable-background-networking", f"--user-data-dir={tmp_path / 'browser'}",
        "--window-size=1100,900", place.as_uri(),
    )  # fmt: skip
    shown = subprocess.run(
        [chromium, *words], capture_output=True, text=True, timeout=600, check=False
    ).stdout
    found = re.search(r'data-beyond="(-?\d+)"', shown)
    assert found is not None
    assert int(found[1]) <= 1


def test_the_page_has_a_style_for_print_that_cuts_nothing(html: str) -> None:
    style = html[html.index("@media print") : html.index("</style>")]
    for rule in (
        ".scroll { overflow: visible; }",
        ".picture svg { min-width: 0; max-height",
        "white-space: normal",
        "break-inside: avoid",
    ):
        assert rule in style


def test_text_from_files_is_escaped(html: str, page: Page) -> None:
    assert "noise &lt;b&gt;was&lt;/b&gt; added" in html


def test_metrics_have_their_intervals(page: Page) -> None:
    for reported in ("30.25 ± 0.40", "10.00 ± 0.30", "12.10 ± 0.25", "6.25 ± 0.10", "14.25 ± 0.50"):
        assert reported in page.text
    assert "Mean and 95 % confidence interval over 20 noise seeds" in page.text
    assert "3 of 20 lost" in page.text  # the variant that lost levitation


def test_every_percentage_names_its_baseline(page: Page) -> None:
    text = page.text.replace("\N{NO-BREAK SPACE}", " ")
    assert (
        "Not worth it here. Full compared with the strongest baseline without hysteresis model: larger in "
        "overshoot 1.2 times that of 'single-valued'; equal within the noise in overshoot" in text
    )
    assert "60 % less +2.1 points" in text  # compared with ratio, in the table below


@pytest.mark.usefixtures("_undrawn")
def test_the_tiles_name_the_strongest_baseline_and_measured_flux(subject: SimulationSubject) -> None:
    flux = [replace(cell, variant="flux") for cell in cells() if cell.variant == "full"]
    with_flux = replace(subject, steps=group_by_step([*cells(), *flux]))
    text = Page(render(with_flux)).text.replace("\N{NO-BREAK SPACE}", " ")
    tile = text[text.index("overshoot, 50 µm step") : text.index("settling time, 50 µm step")]
    assert "best without hysteresis model (single-valued): 7.12 ± 0.30 %" in tile
    assert "measured flux: 7.25 ± 0.25 %" in tile
    assert "ratio" not in tile
    assert "compared with measured flux, less at 0 and more at 0" in text


@pytest.mark.parametrize(
    ("baseline", "level"), [((30.0, 40.0), "yes"), ((1.0, 1.0), "no"), ((30.0, 1.0), "mixed")]
)
def test_the_verdict_follows_the_strongest_baseline(baseline: tuple[float, float], level: str) -> None:
    changed = [
        replace(
            cell,
            figures={**cell.figures, "overshoot_percent": Interval(baseline[cell.height > 20e-6], 0.1, 20)},
        )
        if cell.variant == "single-valued"
        else cell
        for cell in cells()
        if cell.variant != "ratio"
    ]
    found = judge_steps(group_by_step(changed), "full")
    assert found.level == level
    assert (BENEFICIAL_CONDITIONS["feedback"] in found.text) == (level != "yes")
    assert "of 'single-valued'" in found.text
    assert judge_steps(group_by_step(changed), "single-valued").text == found.text


def test_without_a_hysteresis_model_the_verdict_remains_open() -> None:
    alone = [cell for cell in cells() if cell.variant != "full"]
    assert judge_steps(group_by_step(alone), "single-valued").level == "unknown"


def test_the_map_names_baselines_and_cells_without_gain() -> None:
    found = read_controller(EXAMPLE / "controller.toml")
    page = Page(render_bearing(rig(), found, bearing_reports.gains(), "anhyst simulate"))
    assert "Overshoot against ratio: a significant gain in 4 of 4 cells" in page.text
    assert "at best 70 % less than ratio (step of 10 µm, reversible fraction 0.05" in page.text
    assert "Overshoot against the strongest baseline: a significant gain in 2 of 4 cells" in page.text
    assert "10 % less than single-valued" in page.text
    page.check_answer_first()


def test_zones_follow_the_peak(page: Page) -> None:
    assert "ratio: peak 4.40, zone C; single-valued: peak 2.00, zone A" in page.text


@pytest.mark.usefixtures("_undrawn")
def test_lost_levitation_is_reported_first(subject: SimulationSubject) -> None:
    fallen = [replace(cell, figures={}, lost=7) if cell.variant == "ratio" else cell for cell in cells()]
    text = Page(render(replace(subject, steps=group_by_step(fallen)))).text
    assert "ratio at 10 µm at 0.45 mm: 7 of 20 runs" in text
    assert text.index("Levitation lost") < text.index("Not worth it here")
    assert "7 of 20 lost" in text
    assert "nan" not in text


@pytest.mark.slow
@pytest.mark.usefixtures("_undrawn")
def test_an_overshoot_that_is_noise_is_marked(subject: SimulationSubject) -> None:
    same = Interval(OVERSHOOT["full"][1][0], 0.3, 20)
    noisy = [
        replace(cell, figures={**cell.figures, "noise_percent": same})
        if (cell.variant, cell.height) == ("full", 50e-6)
        else cell
        for cell in cells()
    ]
    text = Page(render(replace(subject, steps=group_by_step(noisy)))).text
    assert "7.25 ± 0.25 % ≤ noise" in text.replace("\N{NO-BREAK SPACE}", " ")
    assert "12.10 ± 0.25 % ≤ noise" not in text.replace("\N{NO-BREAK SPACE}", " ")
    assert "24.75 ± 0.30 7.12 ± 0.30 7.25 ± 0.25 ≤ noise" in text


@pytest.mark.usefixtures("_undrawn")
def test_no_difference_within_the_noise_of_a_standstill_is_certain(subject: SimulationSubject) -> None:
    loud = Interval(2.5, 0.05, 20)
    noisy = [
        replace(cell, figures={**cell.figures, "noise_percent": loud})
        if cell.variant == "single-valued"
        else cell
        for cell in cells()
    ]
    text = Page(render(replace(subject, steps=group_by_step(noisy)))).text
    assert "model: equal within the noise in overshoot" in text


@pytest.mark.parametrize(
    ("mine", "other", "floor", "text"),
    [
        ((5.0, 0.1), (10.0, 0.1), 0.2, "50 % less"),
        ((5.0, 3.0), (8.0, 1.0), 0.2, "equal"),
        ((1.5, 0.1), (1.0, 0.1), 0.2, "+0.50 points"),
        ((1.5, 0.1), (1.0, 0.1), 0.6, "equal"),
        ((math.nan, math.nan), (1.0, 0.1), math.nan, "–"),
    ],
)
def test_a_difference_within_the_noise_is_not_reported(
    mine: tuple[float, float], other: tuple[float, float], floor: float, text: str
) -> None:
    found = compare("", "", Interval(*mine, 20), Interval(*other, 20), floor)
    assert difference_text(found).replace("\N{NO-BREAK SPACE}", " ") == text


@pytest.mark.parametrize(
    ("given", "text"),
    [
        ((8.1234, 0.213), "8.12 ± 0.22"),
        ((1234.0, 0.5), "1234 ± 1"),
        ((-0.0001, 0.02), "0.000 ± 0.020"),
        ((math.inf, math.nan), "never"),
        ((math.nan, math.nan), "–"),
        ((7.5, 0.0), "7.5"),
    ],
)
def test_an_interval_is_never_reported_narrower_than_it_is(given: tuple[float, float], text: str) -> None:
    assert interval_text(Interval(*given, 20)) == text
