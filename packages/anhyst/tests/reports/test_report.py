"""The report is one self-contained page that shows negative results clearly."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest

from anhyst.cli import app as cli
from anhyst.data.clean import ReadOptions
from anhyst.data.loops import Loops, Source
from anhyst.data.path import History
from anhyst.data.verdict import GAIN_ADVICE, Level
from anhyst.model.acceptance import Acceptance
from anhyst.model.actuator import Model
from anhyst.model.parameters import Parameter
from anhyst.model.schema import FitFigures, Provenance, ReductionStep, Uncertainty, ValidRange
from anhyst.model.writer import write_model
from anhyst.reports import write_plots, write_report
from anhyst.reports.figures import figure_differences, figure_residuals
from anhyst.reports.figures_over_schedule import figure_between_gaps
from anhyst.reports.page import gather_subject, make_headline
from anhyst.reports.sections_model import section_gap_map
from anhyst.reports.subject import ModelSubject, compute_fit_metrics, gather_measurements
from anhyst.support.figures import svg_text, write_png
from anhyst.support.units import QUANTITIES, Quantity
from tests.page import NAMESPACES, Page
from tests.refusals import refused

IRON: Mapping[str, Parameter] = {
    "M_s": 1.3e6, "a": 3000.0, "k": 1200.0, "c": 0.15, "c_out": 60.0,
}  # fmt: skip
GAPS = (0.3e-3, 0.45e-3, 0.6e-3)
TURNS = (1500.0, 1150.0, 950.0)


def rows_of(model: Model, at: float | None, top: float, seed: int) -> list[str]:
    """CSV lines of a loop of the model with noise, with an input from 0 (force) or around 0."""
    low = 0.0 if model.power == 2 else -top
    half = np.linspace(low, top, 60)
    drive = np.concatenate([half, half[-2::-1]])
    output = model.predict(drive, at, history="settled").output
    output = output + np.random.default_rng(seed).normal(0.0, 2e-3 * np.ptp(output), drive.size)
    end = "" if at is None else f",{at!r}"
    return [f"{i!r},{o!r}{end}" for i, o in zip(drive.tolist(), output.tolist(), strict=True)]


def magnet(folder: Path, **changes: object) -> Model:
    """A model of a magnet at three gaps, with its measurements in a file and all fields set."""
    model = Model(
        "magnet",
        QUANTITIES["current"],
        QUANTITIES["force"],
        {**IRON, "c_H": TURNS},
        gap_map="scaling",
        schedule=QUANTITIES["gap"],
        nodes=GAPS,
        history=History("settled"),
        valid=ValidRange((0.0, 3.0), (0.0, 150.0), (GAPS[0], GAPS[-1])),
        uncertainty=Uncertainty(
            ("k/a", "c", "input offset (A)"),
            (0.75, 0.15, 0.0),
            (0.02, 0.08, 0.01),
            ((1.0, 0.96, 0.1), (0.96, 1.0, 0.2), (0.1, 0.2, 1.0)),
            ("c is hardly determined by these <loops>: uncertain by 53 %",),
        ),
        reduction=(
            ReductionStep("alpha", 0.0017, 0.0018, {"alpha": 0.0018, "k": 0.0035, "c_out": 0.003}),
            ReductionStep("k", 0.0018, 0.0036, {"k": 0.0036}),
        ),
    )
    lines = ["# turned on Monday <img src=x>", "I_A,F_N,gap_m,loop"]
    for place, gap in enumerate(GAPS):
        for name, top in (("full", 3.0), ("small", 0.6)):
            rows = rows_of(model, gap, top, place)
            lines += [f"{row},<b>{name}</b>" for row in rows]
    loops = measured(folder, lines)
    return replace(finished(model, loops, {"scaling": 0.004, "reluctance": 0.003}), **changes)  # type: ignore[arg-type]


def measured(folder: Path, lines: list[str]) -> Loops:
    path = folder / "loops.csv"
    path.write_text("\n".join(lines) + "\n")
    return ReadOptions(history="settled").read([path])


def finished(model: Model, loops: Loops, left_out: Mapping[str, float] | None = None) -> Model:
    """Return a model with the provenance and the fit figures of its loops."""
    sources = tuple(Source(Path(s.path).name, s.sha256, s.columns) for s in loops.sources)
    settings = {"gap_map_reason": "it predicts best", "read_history": "settled"}
    origin = Provenance("1.2.3", 7, sources, settings)
    model = replace(model, provenance=origin)
    fit, _ = compute_fit_metrics(model, gather_measurements(model, Path(loops.sources[0].path).parent))
    assert fit is not None
    return replace(model, fit=replace(fit, left_out=left_out or {}))


def iron_sample(folder: Path, schedule: Quantity | None = None) -> Model:
    """A model from field to flux density, over a temperature or without a scheduling variable."""
    nodes = (-20.0, 10.0) if schedule else ()
    model = Model(
        "sample",
        QUANTITIES["field"],
        QUANTITIES["flux_density"],
        {**IRON, "c_H": 1.0, "c_out": 1.0, "rho": (0.0, 0.01) if schedule else 0.0},
        gap_map="reluctance" if schedule else "none",
        schedule=schedule,
        nodes=nodes,
        history=History("settled"),
        valid=ValidRange((-3e3, 3e3), (-1.6, 1.6), (-20.0, 10.0) if schedule else None),
    )
    lines = ["H_A_per_m,B_T" + (",T_C" if schedule else "")]
    for place, at in enumerate(nodes or (None,)):
        lines += rows_of(model, at, 3e3, place)
    return finished(model, measured(folder, lines))


def report_of(model: Model, folder: Path) -> tuple[str, tuple[str, ...]]:
    write_model(model, folder / "model.toml")
    warnings = write_report(folder / "model.toml", folder / "report.html")
    return (folder / "report.html").read_text(encoding="utf-8"), warnings


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("magnet")


@pytest.fixture(scope="module")
def html(folder: Path) -> str:
    text, warnings = report_of(magnet(folder), folder)
    assert warnings == ()
    return text


@pytest.fixture(scope="module")
def page(html: str) -> Page:
    return Page(html)


@pytest.fixture(scope="module")
def subject(folder: Path, html: str) -> ModelSubject:
    assert html
    return gather_subject(magnet(folder), folder)


def test_sections_are_in_reading_order(page: Page) -> None:
    assert page.sections() == [
        "loops",
        "residuals",
        "parameters-over",
        "reduction",
        "between",
        "parameters",
        "tables",
        "gap-map",
        "measurement",
        "origin",
    ]
    page.check_answer_first()
    links = [given["href"] for tag, given in page.tags if tag == "a"]
    assert links == [f"#{key}" for key in page.sections()]


def test_the_page_fetches_nothing(html: str, page: Page) -> None:
    assert set(re.findall(r"https?://[^\s\"'<>)]+", html)) <= NAMESPACES
    assert not {"script", "link", "iframe", "object", "embed", "base"} & {t for t, _ in page.tags}
    assert "@import" not in html
    for _, given in page.tags:
        for name in ("src", "href", "xlink:href"):
            assert (given.get(name) or "#").startswith(("#", "data:image/png;base64,"))
    assert all(target.startswith("#") for target in re.findall(r"url\(([^)]*)\)", html))


def test_the_page_is_well_formed_and_small(html: str, page: Page) -> None:
    assert page.open == []
    ids = [given["id"] for _, given in page.tags if given.get("id")]
    assert len(ids) == len(set(ids))
    used = {given["xlink:href"] for _, given in page.tags if "xlink:href" in given}
    assert {one for one in used if one and one.startswith("#")} <= {f"#{one}" for one in ids}
    assert len(html.encode()) < 1_500_000


def test_every_figure_has_a_text_description(page: Page) -> None:
    reported = [given.get("aria-label") or "" for _, given in page.tags if given.get("role") == "img"]
    pictures = [given for tag, given in page.tags if tag == "svg"]
    assert len(reported) == len(pictures) == 8
    assert all(len(text) > 60 for text in reported)
    assert all(given["aria-hidden"] == "true" for given in pictures)


def test_hysteresis_is_drawn_by_itself(subject: ModelSubject) -> None:
    measurements = subject.measurements
    assert measurements is not None
    figure = figure_differences(measurements.loops, measurements.fitted, measurements.baseline)
    largest = max(float(np.abs(loop.output).max()) for loop in measurements.loops.loops)
    drawn = [np.asarray(line.get_ydata()) for ax in figure.axes for line in ax.lines]
    most = max(float(np.abs(values).max()) for values in drawn)
    worst = measurements.verdict.single_worst
    assert most < 0.3 * largest  # without the curve itself
    assert most == pytest.approx(worst, rel=0.5)
    ax = figure.axes[0]
    dots, line = np.asarray(ax.lines[1].get_ydata()), np.asarray(ax.lines[2].get_ydata())
    assert np.abs(dots - line).max() < 0.5 * np.abs(dots).max()  # the model shows the same loop
    assert dots.min() < 0.0 < dots.max()


def test_the_headline_reports_metrics_verdict_and_acceptance(page: Page) -> None:
    assert "Worth it. The mean error of the modelled force is" in page.text
    assert "Acceptance test passed. At every drive the output rises as the gap closes" in page.text
    assert "Best single-valued curve" in page.text
    assert "Valid range: current 0 to 3 A; force 0 to 150 N; gap 0.3 to 0.6 mm." in page.text
    assert "mean deviation" in page.text
    assert "% of the largest force" in page.text


def test_the_page_reports_reduction_uncertainty_and_origin(page: Page, folder: Path) -> None:
    assert "c_F 0.30 %, k 0.35 %" in page.text
    assert "0.150 ± 0.080 53 %" in page.text
    assert "What the data do not determine" in page.text
    assert "It predicts best." in page.text
    assert "anhyst 1.2.3" in page.text
    for source in magnet(folder).provenance.sources:
        assert source.sha256 in page.text


def test_text_from_files_is_escaped(html: str, page: Page) -> None:
    assert "<b>full" not in html
    assert "<img" not in html
    assert "<loops>" not in html
    assert "turned on Monday <img src=x>" in page.text
    assert "<b>full</b>" in page.text
    assert "these <loops>" in page.text


@pytest.mark.slow
def test_the_same_model_gives_the_same_bytes(html: str, folder: Path) -> None:
    with mpl.rc_context({"font.size": 30.0, "svg.fonttype": "path", "axes.grid": False}):
        write_report(folder / "model.toml", folder / "again.html")
        assert mpl.rcParams["font.size"] == 30.0
    assert (folder / "again.html").read_text(encoding="utf-8") == html


def test_a_model_without_gap_has_no_sections_about_one(tmp_path: Path) -> None:
    text, _ = report_of(iron_sample(tmp_path), tmp_path)
    page = Page(text)
    assert page.sections() == ["loops", "residuals", "tables", "parameters", "measurement", "origin"]
    assert "does not depend on a gap" in page.text
    assert "H iron" in page.text  # different from the applied field H


@pytest.mark.slow
def test_another_scheduling_variable_keeps_its_name_and_unit(tmp_path: Path) -> None:
    text, _ = report_of(iron_sample(tmp_path, QUANTITIES["temperature"]), tmp_path)
    page = Page(text)
    assert "Parameters over the temperature" in page.text
    assert "temperature −20 °C" in page.text
    assert "this model depends on the temperature" in page.text
    assert "reference gaps" not in page.text
    assert "between" in page.sections()


@pytest.mark.slow
def test_without_measurements_the_report_is_written_from_the_model(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    model = magnet(tmp_path)
    (tmp_path / "loops.csv").unlink()
    text, warnings = report_of(model, tmp_path)
    page = Page(text)
    assert len(warnings) == 1
    assert "loops.csv: no such file" in warnings[0]
    assert "Without measurements." in page.text
    assert "mean deviation" in page.text
    assert "loops" not in page.sections()
    assert "between" in page.sections()
    arguments = ["report", str(tmp_path / "model.toml"), "--out", str(tmp_path / "b.html")]
    assert cli.main(arguments) == 0
    capsys.readouterr()


def test_measurements_that_have_changed_are_not_used(tmp_path: Path) -> None:
    model = magnet(tmp_path)
    with (tmp_path / "loops.csv").open("a") as stream:
        stream.write("# edited\n")
    subject = gather_subject(model, tmp_path)
    assert subject.measurements is None
    assert "file changed after the identification" in subject.missing_reason
    assert "file changed" in str(make_headline(subject))


@pytest.mark.slow
def test_a_model_that_fails_over_the_gap_is_reported_prominently(tmp_path: Path) -> None:
    wild = {**IRON, "c_H": (1500.0, 950.0, 1150.0)}
    model = magnet(tmp_path, parameters=wild, fit=None)
    text, warnings = report_of(model, tmp_path)
    page = Page(text)
    assert "the output falls as the gap closes" in warnings[0]
    assert page.text.count("ACCEPTANCE TEST FAILED.") == 2  # in the head, and at the figure
    first = make_headline(gather_subject(model, tmp_path)).verdict
    assert first.tone == "bad"
    assert "FAILED at" in text


def test_a_gap_that_cannot_be_computed_is_marked(subject: ModelSubject) -> None:
    check = subject.acceptance.over_gap
    assert check is not None
    output = check.output.copy()
    output[5:] = np.nan
    stuck = replace(check, output=output, fall=np.inf, gap=float(check.gaps[5]), failure="no root")
    figure = figure_between_gaps(subject.model, stuck)
    assert figure is not None
    assert "cannot be computed" in svg_text(figure, "f")
    assert "no root" in make_headline(replace(subject, acceptance=Acceptance(stuck, None))).verdict.text


def test_metrics_of_an_edited_model_are_recomputed(subject: ModelSubject, folder: Path) -> None:
    model = subject.model
    edited = replace(model, parameters={**model.parameters, "c_out": 70.0})
    fresh = gather_subject(edited, folder)
    assert "changed after the identification" in fresh.warnings[0]
    assert model.fit is not None
    assert fresh.fit is not None
    assert fresh.fit.mean_abs > 2.0 * model.fit.mean_abs
    assert subject.warnings == ()


def test_a_model_worse_than_a_single_valued_curve_is_reported(subject: ModelSubject, folder: Path) -> None:
    poor = replace(subject.model, parameters={**subject.model.parameters, "c_out": 90.0})
    head = make_headline(gather_subject(poor, folder))
    assert head.verdict.tone == "bad"
    assert head.verdict.title == "Worse than no hysteresis model"
    assert head.tiles[-1].value.endswith("times")


@pytest.mark.parametrize(
    ("level", "title"), [("yes", "Worth it"), ("little", "Small gain"), ("no", "Barely worth it")]
)
def test_the_verdict_is_that_of_the_measurement(subject: ModelSubject, level: Level, title: str) -> None:
    assert subject.measurements is not None
    judged = replace(subject.measurements.verdict, level=level)
    reported = make_headline(
        replace(subject, measurements=replace(subject.measurements, verdict=judged))
    ).verdict
    assert reported.title == title
    assert reported.tone == ("good" if level == "yes" else "warn")
    assert "% of the error of the curve" in reported.text.replace("\xa0", " ")
    assert (GAIN_ADVICE in reported.text) == (level != "yes")


@pytest.mark.slow
def test_a_model_that_cannot_be_run_over_its_loops_is_still_reported(
    subject: ModelSubject, folder: Path
) -> None:
    eddy = replace(subject.model, parameters={**subject.model.parameters, "gamma": 1.0})
    found = gather_subject(eddy, folder)  # the file has no time column
    assert found.measurements is not None
    assert found.measurements.fitted == (None,) * 6
    assert "cannot be computed" in found.warnings[0]
    assert found.fit == eddy.fit
    text, _ = report_of(replace(eddy, fit=None), folder_beside(folder))
    assert "cannot be computed" in Page(text).text


def folder_beside(folder: Path) -> Path:
    beside = folder / "beside"
    beside.mkdir()
    (beside / "loops.csv").write_bytes((folder / "loops.csv").read_bytes())
    return beside


def test_noise_is_reported_from_the_record_before_thinning(tmp_path: Path) -> None:
    model = iron_sample(tmp_path)
    half = np.linspace(-3e3, 3e3, 2600)
    drive = np.concatenate([half, half[-2::-1]])
    output = model.predict(drive, history="settled").output
    rows = [f"{h!r},{b!r}" for h, b in zip(drive.tolist(), output.tolist(), strict=True)]
    measurements = gather_measurements(
        finished(model, measured(tmp_path, ["H_A_per_m,B_T", *rows])), tmp_path
    )
    assert measurements.inspection is not None
    assert measurements.inspection.loops[0].samples == 5199
    assert measurements.loops.loops[0].n <= 4000


def bare_model() -> Model:
    parameters = {**IRON, "c_H": 1.0}
    return Model("bare", QUANTITIES["field"], QUANTITIES["flux_density"], parameters)


def test_a_bare_model_can_be_reported(tmp_path: Path) -> None:
    text, warnings = report_of(bare_model(), tmp_path)
    assert Page(text).sections() == ["parameters", "origin"]
    assert "does not list its measurements" in warnings[0]


def test_infinite_withheld_errors_are_reported_in_words(subject: ModelSubject) -> None:
    assert subject.model.fit is not None
    fit = replace(subject.model.fit, left_out={"scaling": 0.004, "free": float("inf")})
    section = section_gap_map(replace(subject, model=replace(subject.model, fit=fit)))
    assert section is not None
    assert "cannot be computed" in str(section)


def test_a_report_that_cannot_be_written_leaves_no_file(tmp_path: Path) -> None:
    write_model(bare_model(), tmp_path / "model.toml")
    with refused("cannot-be-written ENOENT"):
        write_report(tmp_path / "model.toml", tmp_path / "nowhere" / "report.html")
    assert [path.name for path in tmp_path.iterdir()] == ["model.toml"]


@pytest.mark.slow
def test_plots_are_written_as_pictures(subject: ModelSubject, tmp_path: Path) -> None:
    measurements = subject.measurements
    assert measurements is not None
    found = write_plots(subject.model, measurements.loops, measurements.fitted, tmp_path / "demo")
    names = ["loops", "residuals", "parameters", "between_gaps", "reduction"]
    assert [path.name for path in found] == [f"{name}.png" for name in names]
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in found)
    write_png(figure_residuals(measurements.loops, measurements.fitted), tmp_path / "again.png")
    assert (tmp_path / "again.png").read_bytes() == found[1].read_bytes()


def test_fit_metrics_of_a_perfect_model_do_not_divide_by_zero(subject: ModelSubject) -> None:
    none = FitFigures(0.0, 0.0, 0.0, 0.0)
    head = make_headline(replace(subject, fit=none, measurements=None))
    assert [tile.value for tile in head.tiles] == ["0\xa0N"] * 3
