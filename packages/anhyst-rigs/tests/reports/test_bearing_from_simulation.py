"""Run a simulation from the command line and compare its results with the report."""

from __future__ import annotations

import io
import json
import re
from contextlib import redirect_stdout
from pathlib import Path

import pytest

from anhyst.cli.app import main
from anhyst.compensate.methods import BASELINE_METHODS
from anhyst.control.controller_file import read_controller
from anhyst.support.page import format_number
from anhyst_rigs.reports.benefit import render_bearing
from anhyst_rigs.reports.study.page import interval_text
from anhyst_rigs.rig.body import read_bearing
from anhyst_rigs.study.benefit import map_bearing_benefit
from anhyst_rigs.study.engine.table import Interval
from tests.cli.command import unwrapped
from tests.page import Page
from tests.refusals import says
from tests.study import bearings

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The bundled bearing with one gap, one step and two noise seeds."""
    folder = tmp_path_factory.mktemp("bearing")
    text = bearings.copy_known(folder).read_text(encoding="utf-8")
    for key, value in {
        "also_gaps_m": "[]",
        "heights_m": "[20e-6]",
        "noise_seeds": "2",
        "amplitude_m": "5e-6",
        "frequency_Hz": "20.0",
    }.items():
        text, count = re.subn(rf"^{key} = .*$", f"{key} = {value}", text, flags=re.MULTILINE)
        assert count == 1
    text = text.replace('"triangle"', '"sine"')
    (folder / "rig.toml").write_text(text, encoding="utf-8")
    return folder


@pytest.fixture(scope="module")
def run(small: Path) -> Path:
    out = small / "run.csv"
    with redirect_stdout(io.StringIO()) as printed:
        assert main(["simulate", str(small / "rig.toml"), "--out", str(out)]) == 0
    (small / "printed.txt").write_text(printed.getvalue(), encoding="utf-8")
    return out


@pytest.fixture(scope="module")
def page(run: Path) -> Page:
    return Page((run.parent / "report.html").read_text(encoding="utf-8"))


def test_every_section_of_a_simulation_is_present(page: Page) -> None:
    assert page.open == []
    assert page.sections() == [
        "steps", "forces", "loops", "tracking", "standstill", "frequency", "structure",
        "tables", "origin",
    ]  # fmt: skip
    page.check_answer_first()


def test_the_page_shows_the_metrics_of_the_run(run: Path, page: Page) -> None:
    figures = json.loads((run.parent / "figures.json").read_text(encoding="utf-8"))
    assert {row["variant"] for row in figures["steps"]} >= {"ratio", "single-valued", "full", "flux"}
    for row in figures["steps"]:
        assert interval_text(Interval(**row["overshoot_percent"])) in page.text
    for found in figures["standstill"].values():
        assert interval_text(Interval(**found["rms_m"]), factor=1e9) in page.text
    for name, found in figures["sensitivity"].items():
        assert f"{name}: peak {found['peak']:.2f}, zone {found['zone']}" in page.text


def test_terminal_and_page_give_the_verdict_in_one_sentence(run: Path, page: Page) -> None:
    printed = unwrapped((run.parent / "printed.txt").read_text(encoding="utf-8"))
    (said,) = re.findall(r"^verdict: (.*)$", printed, flags=re.MULTILINE)
    figures = json.loads((run.parent / "figures.json").read_text(encoding="utf-8"))
    overshoot = {
        row["variant"]: row["overshoot_percent"]["mean"]
        for row in figures["steps"]
        if row["variant"] in BASELINE_METHODS
    }
    strongest = min(overshoot, key=lambda name: overshoot[name])
    assert f"of '{strongest}'" in said
    assert "measured flux" in said
    title, sentence = said.split(": ", 1)
    assert f"{title[:1].upper()}{title[1:]}. {sentence[:1].upper()}{sentence[1:]}." in page.text
    assert f"best without hysteresis model ({strongest})" in page.text  # in the tile


def test_the_page_gives_its_command(small: Path, page: Page) -> None:
    assert f"anhyst simulate {small / 'rig.toml'} --out {small / 'run.csv'}" in page.text
    assert "controller.toml" in page.text


def test_a_monte_carlo_run_is_extended_and_reported(small: Path) -> None:
    out = small / "plants.jsonl"
    command = ["simulate", str(small / "rig.toml"), "--out", str(out), "--monte-carlo"]
    assert main([*command, "2"]) == 0
    first = out.read_bytes()
    assert main([*command, "3"]) == 0
    assert out.read_bytes().startswith(first)
    figures = json.loads((small / "montecarlo.json").read_text(encoding="utf-8"))
    assert figures["plants"] == 3
    page = Page((small / "report.html").read_text(encoding="utf-8"))
    assert page.sections() == ["drift", "origin"]
    page.check_answer_first()
    assert f"{command[-2]} --monte-carlo 3" in page.text
    for name, found in figures["variants"].items():
        median = format_number(found["standstill_rms_m"]["p50"] * 1e9)
        row = rf"standstill, rms \(nm\) {name} \S+ {re.escape(median)} "
        assert re.search(row, page.text)


def test_plants_are_written_as_lines(small: Path, capsys: pytest.CaptureFixture[str]) -> None:
    out = str(small / "plants.csv")
    assert main(["simulate", str(small / "rig.toml"), "--out", out, "--monte-carlo", "2"]) == 2
    assert says(capsys.readouterr().err, "wrong-ending: plants.csv")


def test_the_map_of_benefit_is_reported_cell_by_cell(small: Path) -> None:
    rig = read_bearing(small / "rig.toml")
    controller = read_controller(small / "controller.toml")
    found = map_bearing_benefit(rig, controller, scales=(1.0,), fractions=(0.05, 0.3), jobs=1)
    page = Page(render_bearing(rig, controller, found, "anhyst simulate"))
    assert page.sections() == ["benefit", "structure", "tables", "origin"]
    page.check_answer_first()
    for measure, title in (("overshoot_percent", "Overshoot"), ("settling_in_noise_s", "Settling time")):
        gains = sum(cell.ratio[measure].outcome == "gain" for cell in found.cells)
        assert f"{title} against ratio: a significant gain in {gains} of 2 cells" in page.text
        gains = sum(cell.strongest[measure].outcome == "gain" for cell in found.cells)
        assert f"{title} against the strongest baseline: a significant gain in {gains} of 2" in page.text


@pytest.mark.parametrize(
    ("arguments", "reported"),
    [
        (["--out", "map.csv", "--benefit"], "wrong-ending: map.csv"),
        (["--out", "map.json", "--benefit", "--monte-carlo", "2"], "options-together"),
    ],
)
def test_a_map_that_cannot_be_made_is_refused_at_once(
    small: Path, arguments: list[str], reported: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["simulate", str(small / "rig.toml"), *arguments]) == 2
    assert says(capsys.readouterr().err, reported)
