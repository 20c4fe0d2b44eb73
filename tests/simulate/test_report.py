"""The report of a simulation tells what it was given, needs nothing else, and can be read."""

from __future__ import annotations

import itertools
import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from tests.page import NAMESPACES, Page

from anhyst.data.loopset import Loop, LoopSet
from anhyst.data.units import QUANTITIES
from anhyst.report.blocks import Items, Note
from anhyst.simulate.controllerfile import ControllerTable, Variant, read_controller
from anhyst.simulate.linear import Margins
from anhyst.simulate.metrics import Interval, no_mean
from anhyst.simulate.recording import COLUMNS, Recording
from anhyst.simulate.report import Subject, write_simulation_report
from anhyst.simulate.report.block_diagram import figure_structure
from anhyst.simulate.report.force_current import LoopCurve, figure_force_current, nearest_loops
from anhyst.simulate.report.look import COLOURS, DASHES, MOST_POINTS, interval_text, thinned
from anhyst.simulate.report.over_frequency import Response, figure_sensitivity
from anhyst.simulate.report.over_runs import (
    BenefitCell,
    Candidate,
    Outcome,
    Spread,
    Tuning,
    figure_benefit,
    figure_drift,
    figure_pareto,
    pareto_front,
)
from anhyst.simulate.report.over_time import StepPanel, figure_forces, figure_steps
from anhyst.simulate.report.page import render
from anhyst.simulate.report.subject import Comparison, Tracking, grouped
from anhyst.simulate.report.tables import difference
from anhyst.simulate.responses import Cell
from anhyst.simulate.rigfile import BearingRig, DisturbanceTable, read_bearing
from anhyst.simulate.scenario import Step

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "bearing"
SHOWN: tuple[Variant, ...] = ("ratio", "static", "full")
RATE, BEGIN, HEIGHT, GAP = 20e3, 200, 10e-6, 0.45e-3
# Overshoot in % of the height at 10 and 50 um: mean, half width.
OVERSHOOT: Mapping[Variant, tuple[tuple[float, float], ...]] = {
    "ratio": ((30.25, 0.4), (24.75, 0.3)),
    "static": ((10.0, 0.3), (7.125, 0.3)),
    "full": ((12.1, 0.25), (7.25, 0.25)),
}
NOISE = 0.5


@pytest.fixture(scope="module")
def rig() -> BearingRig:
    return read_bearing(EXAMPLE / "rig.toml")


@pytest.fixture(scope="module")
def controller() -> ControllerTable:
    return read_controller(EXAMPLE / "controller.toml").settings


def response(overshoot: float, seed: int) -> Recording:
    """A record with one step of 10 um up that overshoots, with noise."""
    table = np.zeros((800, len(COLUMNS)))
    time = np.arange(800) / RATE
    since = np.maximum(time - BEGIN / RATE, 0.0)
    decay = -math.log(overshoot / 100.0) * 250.0 / math.pi
    way = 1.0 - np.exp(-decay * since) * (
        np.cos(250.0 * since) + decay / 250.0 * np.sin(250.0 * since)
    )
    noise = 5e-9 * np.random.default_rng(seed).standard_normal(800)
    values = {
        "t_s": 3.0 + time,
        "reference_m": GAP + HEIGHT / 2 - HEIGHT * (np.arange(800) >= BEGIN),
        "gap_m": GAP + HEIGHT / 2 - HEIGHT * way + noise,
        "demand_N": 150.0 + 20.0 * np.exp(-400.0 * since) * (since > 0.0),
        "force_N": 150.0 + 18.0 * np.exp(-300.0 * since) * (since > 0.0),
        "current_A": 2.8 + 0.3 * np.exp(-300.0 * since) * (since > 0.0),
    }
    for name, column in values.items():
        table[:, COLUMNS.index(name)] = column
    return Recording(table)


@pytest.fixture(scope="module")
def runs() -> dict[Variant, Recording]:
    return {name: response(OVERSHOOT[name][0][0], place) for place, name in enumerate(SHOWN)}


def cells() -> list[Cell]:
    return [
        Cell(
            name,
            GAP,
            height,
            150.0,
            {
                "overshoot_percent": Interval(*OVERSHOOT[name][place], 20),
                "noise_percent": Interval(NOISE, 0.05, 20),
                "settling_in_noise_s": Interval(6.25e-3, 0.1e-3, 20),
                "steady_error_m": Interval(1e-9, 2e-9, 20),
            },
            lost=0,
            runs=20,
        )
        for place, height in enumerate((10e-6, 50e-6))
        for name in SHOWN
    ]


def lag(corner: float, gain: float) -> Response:
    frequency = np.geomspace(5.0, 5e3, 60)
    return Response(frequency, np.asarray(gain / (1.0 + 1j * frequency / corner), np.complex128))


@pytest.fixture(scope="module")
def subject(
    rig: BearingRig, controller: ControllerTable, runs: dict[Variant, Recording]
) -> Subject:
    """Everything that a report can hold."""
    step = Step(BEGIN, 800, GAP + HEIGHT / 2, GAP - HEIGHT / 2)
    overshoot = {name: Interval(*OVERSHOOT[name][0], 20) for name in SHOWN}
    current = np.concatenate([np.linspace(0.0, 4.0, 40), np.linspace(4.0, 0.0, 40)])
    benefit = tuple(
        BenefitCell("overshoot", against, rival, width, share, share < 0.1, height, ratio, outcome)
        for against, rival, base in (("ratio", "ratio", 0.3), ("the strongest", "static", 0.9))
        for width, share, ratio in ((0.02, 0.05, base), (0.05, 0.15, base + 0.08))
        for height in (10e-6, 50e-6)
        for outcome in (("gain" if ratio < 0.95 else "no gain"),)
    )
    chosen = Candidate("full", 5.5e-3, 2.125, kept=True)
    others = (Candidate("full", 4e-3, 3.5, kept=True), Candidate("full", math.inf, 1.2, kept=False))
    margins = Margins(True, 0.31, 3.7, 41.5, 1.2e-4, 392.0, 1.82, 650.0)
    return Subject(
        rig=rig,
        controller=controller,
        seeds=20,
        panels=(StepPanel(step, runs, overshoot),),
        steps=grouped(cells()),
        forces=runs,
        run=runs,
        measured=(LoopCurve(0.42e-3, current, 20.0 * current**2),),
        identified=LoopCurve(GAP, current, 18.0 * current**2),
        tracked=(Tracking("triangle of 20 µm", runs),),
        standstill={name: run.part(0, BEGIN) for name, run in runs.items()},
        sensitivity={
            name: lag(800.0, gain) for name, gain in zip(SHOWN, (4.4, 2.0, 1.5), strict=True)
        },
        linear_sensitivity={"full": lag(700.0, 1.5)},
        loop_gain={"full": lag(90.0, 40.0)},
        margins={"full": margins},
        tables={
            "standstill": (
                Comparison(
                    "Standstill <rms>",
                    "nm",
                    1e9,
                    {"still": {"full": Interval(14.25e-9, 5e-10, 20), "ratio": no_mean(3, 20)}},
                ),
            )
        },
        blocks={"tuning": (Items("What limits", ("The encoder of 50 nm limits.",)),)},
        benefit=benefit,
        drift=(Spread("overshoot (%)", {"full": np.arange(1.0, 101.0)}),),
        plants=100,
        tuning=Tuning((chosen, *others), {"full": chosen}, 6e-3, 3.0),
        notes=(Note("warn", "Note", "noise <b>was</b> added"),),
        files={"rig.toml": "ab" * 32},
        command="anhyst simulate rig.toml --out run.csv",
    )


@pytest.fixture(scope="module")
def html(subject: Subject, tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("report") / "report.html"
    write_simulation_report(path, subject)
    return path.read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def page(html: str) -> Page:
    return Page(html)


def test_every_part_has_its_section_in_order(page: Page) -> None:
    assert page.sections() == [
        "structure", "steps", "forces", "loops", "tracking", "standstill", "frequency", "drift",
        "benefit", "tuning", "origin",
    ]  # fmt: skip


def test_absent_parts_have_no_section(rig: BearingRig, controller: ControllerTable) -> None:
    bare = Page(render(Subject(rig, controller, seeds=20)))
    assert bare.sections() == ["structure", "origin"]


def test_the_page_fetches_nothing(html: str, page: Page) -> None:
    assert set(re.findall(r"https?://[^\s\"'<>)]+", html)) <= NAMESPACES
    assert not {"script", "link", "iframe", "object", "embed", "base"} & {t for t, _ in page.tags}
    for _, given in page.tags:
        for name in ("src", "href", "xlink:href"):
            assert (given.get(name) or "#").startswith(("#", "data:image/png;base64,"))
    assert all(target.startswith("#") for target in re.findall(r"url\(([^)]*)\)", html))


def test_the_page_is_well_formed_with_figures_told_in_words(html: str, page: Page) -> None:
    assert page.open == []
    ids = [given["id"] for _, given in page.tags if given.get("id")]
    assert len(ids) == len(set(ids))
    drawn = re.findall(r"<svg\b.*?</svg>", html, flags=re.DOTALL)
    told = [given.get("aria-label") or "" for _, given in page.tags if given.get("role") == "img"]
    assert len(drawn) == len(told) == 12
    assert all(len(text) > 40 for text in told)
    for text in drawn:
        assert ET.fromstring(text).tag == "{http://www.w3.org/2000/svg}svg"


def test_the_same_subject_gives_the_same_bytes(html: str, subject: Subject) -> None:
    assert render(subject) == html


def test_what_comes_from_outside_is_escaped(html: str, page: Page) -> None:
    assert "noise &lt;b&gt;was&lt;/b&gt; added" in html
    assert "Standstill <rms> (nm)" in page.text


def test_figures_stand_with_their_intervals(page: Page) -> None:
    for told in ("30.25 ± 0.40", "10.00 ± 0.30", "12.10 ± 0.25", "6.25 ± 0.10", "14.25 ± 0.50"):
        assert told in page.text
    assert "Mean and 95 % confidence interval over 20 noise seeds" in page.text
    assert "3 of 20 lost" in page.text  # the variant that fell
    assert "The encoder of 50 nm limits." in page.text


def test_every_percentage_names_its_baseline(page: Page) -> None:
    assert "Against ratio. At 2 of 2 steps full certainly overshoots less than ratio" in page.text
    assert "60 to 71 % of the overshoot of ratio are gone" in page.text
    assert (
        "Against static. At 0 of 2 steps full certainly overshoots less than static, at 1 more"
        in page.text
    )
    assert "it is 2.1 percentage points of the height more" in page.text


def test_the_map_says_against_whom_and_where_there_is_no_gain(page: Page) -> None:
    assert "Overshoot against ratio: a certain gain in 4 of 4 cells" in page.text
    assert "at best 70 % less than ratio (step of 10 µm, reversible fraction 0.05" in page.text
    assert "Overshoot against the strongest: a certain gain in 2 of 4 cells" in page.text
    assert "10 % less than static" in page.text


def test_zones_follow_the_peak(page: Page) -> None:
    assert "ratio: peak 4.40, zone C; static: peak 2.00, zone A" in page.text


def test_lost_levitation_is_told_first(subject: Subject) -> None:
    fallen = [
        replace(cell, figures={}, lost=7) if cell.variant == "ratio" else cell for cell in cells()
    ]
    text = Page(render(replace(subject, steps=grouped(fallen)))).text
    assert "ratio at 10 µm at 0.45 mm: 7 of 20 runs" in text
    assert text.index("Levitation lost") < text.index("Against static")
    assert "7 of 20 lost" in text
    assert "Against ratio. Nothing to compare: ratio or full lost the armature" in text
    assert "nan" not in text


def test_an_overshoot_that_is_noise_is_marked(subject: Subject) -> None:
    same = Interval(OVERSHOOT["full"][1][0], 0.3, 20)
    noisy = [
        replace(cell, figures={**cell.figures, "noise_percent": same})
        if (cell.variant, cell.height) == ("full", 50e-6)
        else cell
        for cell in cells()
    ]
    text = Page(render(replace(subject, steps=grouped(noisy)))).text
    assert "7.25 ± 0.25 % ≤ noise" in text.replace("\N{NO-BREAK SPACE}", " ")
    assert "12.10 ± 0.25 % ≤ noise" not in text.replace("\N{NO-BREAK SPACE}", " ")
    assert "24.75 ± 0.30 7.12 ± 0.30 7.25 ± 0.25 ≤ noise" in text


def test_no_difference_within_the_noise_of_a_standstill_is_certain(subject: Subject) -> None:
    loud = Interval(2.5, 0.05, 20)
    noisy = [
        replace(cell, figures={**cell.figures, "noise_percent": loud})
        if cell.variant == "static"
        else cell
        for cell in cells()
    ]
    text = Page(render(replace(subject, steps=grouped(noisy)))).text
    assert (
        "Against static. At 0 of 2 steps full certainly overshoots less than static, at 0 more"
        in text
    )
    assert "Against ratio. At 2 of 2 steps full certainly overshoots less than ratio" in text


@pytest.mark.parametrize(
    ("mine", "other", "floor", "text"),
    [
        ((5.0, 0.1), (10.0, 0.1), 0.2, "50 % less"),
        ((5.0, 3.0), (8.0, 1.0), 0.2, "alike"),
        ((1.5, 0.1), (1.0, 0.1), 0.2, "+0.50 points"),
        ((1.5, 0.1), (1.0, 0.1), 0.6, "alike"),
        ((math.nan, math.nan), (1.0, 0.1), math.nan, "–"),
    ],
)
def test_a_difference_within_the_noise_is_none(
    mine: tuple[float, float], other: tuple[float, float], floor: float, text: str
) -> None:
    found = difference(Interval(*mine, 20), Interval(*other, 20), floor)
    assert found.text.replace("\N{NO-BREAK SPACE}", " ") == text


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
def test_an_interval_is_never_told_narrower_than_it_is(
    given: tuple[float, float], text: str
) -> None:
    assert interval_text(Interval(*given, 20)) == text


def texts_of(figure: Figure) -> list[str]:
    return [text.get_text() for ax in figure.axes for text in ax.texts]


def test_the_diagram_holds_the_numbers_of_the_files(
    rig: BearingRig, controller: ControllerTable
) -> None:
    told = texts_of(figure_structure(rig, controller))
    gains = controller.law()
    for text in (
        f"K_d {gains.K_d:.0f} N s/m", "full hysteresis compensator", "fixed point",
        "20 kHz, tick 50 µs", "16 bits, 69 µA a step", "supply ±150 V", "250 turns, 1.2 Ω",
        "reversible fraction 0.15", "mass 2 kg", "stops at 0.35 and 0.55 mm", "150 N, 500 Hz",
        "encoder: step 50 nm", "noise 5 nm rms, 20 kHz",
    ):  # fmt: skip
        assert text in told
    heavier = rig.settings.mechanics.model_copy(update={"mass_kg": 3.5})
    other = replace(rig, settings=rig.settings.model_copy(update={"mechanics": heavier}))
    assert "mass 3.5 kg" in texts_of(figure_structure(other, controller))


def fullest(rig: BearingRig) -> BearingRig:
    """A rig in which every block has as much to say as it can."""
    magnet = rig.settings.magnet.model_copy(
        update={
            "arrangement": "pair", "gap_total_m": 0.9e-3, "bias_force_N": 120.5,
            "eddy_time_s": 12.5e-6,
        }
    )  # fmt: skip
    load = rig.settings.load.model_copy(
        update={
            "stiffness_N_per_m": 12500.0,
            "damping_N_s_per_m": 12.5,
            "disturbance": [DisturbanceTable(kind="sine", force_N=12.5, frequency_Hz=50.0)] * 3,
        }
    )
    mechanics = rig.settings.mechanics.model_copy(
        update={"damping_N_s_per_m": 12.5, "gravity_m_per_s2": 9.81}
    )
    amplifier = rig.settings.amplifier.model_copy(update={"delay_s": 12.5e-6})
    sensor = rig.settings.position_sensor.model_copy(update={"kind": "laser", "delay_s": 1e-5})
    changes = {
        "magnet": magnet, "load": load, "mechanics": mechanics, "amplifier": amplifier,
        "position_sensor": sensor,
    }  # fmt: skip
    return replace(rig, settings=rig.settings.model_copy(update=changes))


@pytest.mark.parametrize("variant", list(COLOURS))
@pytest.mark.parametrize("full", [False, True])
def test_no_text_of_the_diagram_leaves_its_box_or_meets_another(
    rig: BearingRig, controller: ControllerTable, variant: Variant, full: bool
) -> None:
    chosen = controller.compensation.model_copy(update={"variant": variant, "applied": "measured"})
    table = controller.model_copy(update={"compensation": chosen})
    figure = figure_structure(fullest(rig) if full else rig, table)
    renderer = FigureCanvasAgg(figure).get_renderer()  # type: ignore[no-untyped-call]
    (ax,) = figure.axes
    boxes = {
        str(patch.get_gid()): patch.get_window_extent(renderer)
        for patch in ax.patches
        if str(patch.get_gid()).startswith("box-")
    }
    assert len(boxes) == 9
    placed = [(text, text.get_window_extent(renderer)) for text in ax.texts if text.get_text()]
    for text, place in placed:
        if text.get_gid():
            box = boxes[f"box-{str(text.get_gid()).partition('-')[2]}"]
            inside = (box.x0 < place.x0, place.x1 < box.x1, box.y0 < place.y0, place.y1 < box.y1)
            assert all(inside), text.get_text()
        else:
            assert not any(place.overlaps(box) for box in boxes.values()), text.get_text()
    for (one, first), (two, second) in itertools.combinations(placed, 2):
        assert not first.overlaps(second), (one.get_text(), two.get_text())


# Machado, Oliveira and Fernandes (2009): how a dichromat sees linear RGB.
SIGHT: Mapping[str, list[list[float]]] = {
    "normal": [[1, 0, 0], [0, 1, 0], [0, 0, 1]],
    "protanopia": [
        [0.152286, 1.052583, -0.204868], [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
    "deuteranopia": [
        [0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ],
}  # fmt: skip


def lab(colour: str, sight: str) -> np.ndarray:
    rgb = np.array(mpl.colors.to_rgb(colour))
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    seen = np.clip(np.array(SIGHT[sight]) @ linear, 0.0, 1.0)
    to_xyz = [[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]
    x, y, z = np.cbrt(np.maximum(np.array(to_xyz) @ seen / [0.9505, 1.0, 1.089], 1e-6))
    return np.array([116.0 * y - 16.0, 500.0 * (x - y), 200.0 * (y - z)])


@pytest.mark.parametrize("sight", list(SIGHT))
def test_variants_are_told_apart_by_colour_or_by_dash(sight: str) -> None:
    for one, two in itertools.combinations(COLOURS, 2):
        apart = float(np.linalg.norm(lab(COLOURS[one], sight) - lab(COLOURS[two], sight)))
        assert apart > (20.0 if DASHES[one] == DASHES[two] else 8.0), (one, two, apart)


def test_steps_show_reference_and_every_variant_with_its_overshoot(subject: Subject) -> None:
    (ax,) = figure_steps(subject.panels).axes
    labels = [str(line.get_label()) for line in ax.lines]
    assert labels == [
        "reference",
        "ratio: overshoot 30.25 ± 0.40\N{NO-BREAK SPACE}%",
        "static: overshoot 10.00 ± 0.30\N{NO-BREAK SPACE}%",
        "full: overshoot 12.10 ± 0.25\N{NO-BREAK SPACE}%",
    ]
    for line, name in zip(ax.lines[1:], SHOWN, strict=True):
        position = np.asarray(line.get_ydata())
        assert position.max() == pytest.approx(10.0 + OVERSHOOT[name][0][0] / 10.0, abs=0.05)
        assert np.asarray(line.get_xdata())[0] == pytest.approx(-2.0)


def test_forces_tell_the_error_of_what_is_shown(runs: dict[Variant, Recording]) -> None:
    figure = figure_forces(runs)
    error = runs["full"]["force_N"] - runs["full"]["demand_N"]
    worst = f"worst {np.abs(error).max():.2f} N"
    assert any(worst in ax.get_title(loc="left") for ax in figure.axes)


def test_the_run_lies_over_the_nearest_loops() -> None:
    current = np.array([0.0, 2.0, 4.0, 2.0, 0.0])
    loops = LoopSet(
        tuple(
            Loop("a", current, 1e-6 * current / gap, np.full(5, gap))
            for gap in (0.35e-3, 0.42e-3, 0.48e-3, 0.55e-3)
        ),
        QUANTITIES["current"],
        QUANTITIES["force"],
        QUANTITIES["gap"],
    )
    assert [loop.gap for loop in nearest_loops(loops, 0.45e-3)] == [0.42e-3, 0.48e-3]
    assert [loop.gap for loop in nearest_loops(loops, 0.48e-3)] == [0.48e-3, 0.55e-3]
    assert [loop.gap for loop in nearest_loops(loops, 0.6e-3)] == [0.55e-3]


def test_the_second_panel_of_the_plane_holds_the_whole_run(
    runs: dict[Variant, Recording], subject: Subject
) -> None:
    _, near = figure_force_current(runs, subject.measured, subject.identified).axes
    low, high = near.get_xlim()
    current = runs["full"]["current_A"]
    assert low < current.min()
    assert current.max() < high < 3.5


def test_thinning_keeps_peaks() -> None:
    time = np.arange(50_000.0)
    signal = np.zeros(50_000)
    signal[12_345], signal[43_211] = 7.0, -3.0
    at, kept = thinned(time, signal)
    assert kept.size <= MOST_POINTS + 3
    assert (kept.max(), kept.min()) == (7.0, -3.0)
    assert at[kept.argmax()] == 12_345.0
    assert at[-1] == 49_999.0


def test_sensitivities_beyond_the_figure_widen_it() -> None:
    (ax,) = figure_sensitivity({"full": lag(800.0, 40.0)}, {}).axes
    assert ax.get_ylim()[1] > 20.0 * math.log10(40.0)


def test_cells_without_a_certain_gain_are_hatched(subject: Subject) -> None:
    figure = figure_benefit(subject.benefit, "full")
    maps = [ax for ax in figure.axes if ax.get_title(loc="left")]
    hatched = {ax.get_title(loc="left"): len(ax.patches) for ax in maps}
    assert hatched == {
        "10 µm, against ratio": 0,
        "50 µm, against ratio": 0,
        "10 µm, against the strongest": 1,
        "50 µm, against the strongest": 1,
    }
    for ax in maps:
        (squares,) = ax.collections
        assert all(patch.get_zorder() > squares.get_zorder() for patch in ax.patches)
    assert sorted(texts_of(figure)) == sorted(
        2 * ["0.30†", "0.38", "0.90†\nstatic", "0.98\nstatic"]
    )


def test_every_outcome_but_a_gain_has_a_hatch_of_its_own(subject: Subject) -> None:
    outcomes: tuple[Outcome, ...] = ("gain", "no gain", "nothing to gain", "loss")
    cells = [
        replace(subject.benefit[0], reversible=0.1 * place, outcome=outcome)
        for place, outcome in enumerate(outcomes)
    ]
    figure = figure_benefit(cells, "full")
    (ax,) = (ax for ax in figure.axes if ax.get_title(loc="left"))
    hatches = {patch.get_hatch() for patch in ax.patches}
    assert len(hatches) == len(ax.patches) == 3
    (legend,) = figure.legends
    assert {patch.get_hatch() for patch in legend.get_patches()} == hatches
    assert "certain loss" in {text.get_text() for text in legend.get_texts()}


def test_nothing_on_the_front_is_beaten() -> None:
    rng = np.random.default_rng(5)
    tried = [
        Candidate("full", settling, peak, kept=True)
        for settling, peak in rng.uniform(1.0, 2.0, (200, 2)).tolist()
    ]
    front = pareto_front(tried)
    beaten = [
        one
        for one in tried
        if any(
            two.settling <= one.settling and two.peak <= one.peak and two is not one
            for two in tried
        )
    ]
    assert {id(one) for one in front} == {id(one) for one in tried} - {id(one) for one in beaten}


def test_the_pareto_picture_shows_what_was_chosen_and_leaves_out_what_never_settles(
    subject: Subject,
) -> None:
    assert subject.tuning is not None
    (ax,) = figure_pareto(subject.tuning).axes
    labels = [str(line.get_label()) for line in ax.lines]
    assert "chosen, full: 5.50 ms, peak 2.12" in labels
    assert sum(np.asarray(points.get_offsets()).shape[0] for points in ax.collections) == 2


def test_plants_that_were_lost_stay_below_nothing(subject: Subject) -> None:
    values = np.array([*range(1, 91), *[math.inf] * 10], dtype=np.float64)
    (ax,) = figure_drift([Spread("overshoot (%)", {"full": values})]).axes
    shares = np.asarray(ax.lines[0].get_ydata())
    assert shares.max() == pytest.approx(90.0)
    text = Page(render(replace(subject, drift=(Spread("overshoot (%)", {"full": values}),)))).text
    assert "overshoot (%) full 5.00 50.0 ∞ ∞" in text
    assert "pinning 10 %, reversible fraction 20 %" in text
