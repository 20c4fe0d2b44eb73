"""Test a fleet of magnets: tolerance, outliers and scatter."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from anhyst.identification import identify
from anhyst.identification.space import coordinate_kind
from anhyst.model.actuator import Model
from anhyst.support.errors import NegativeResult
from anhyst.support.numeric import FloatArray
from anhyst_rigs.reports.fleet import write_fleet_report
from anhyst_rigs.study import fleet as whole
from anhyst_rigs.study.fleet import Fleet, fleet
from anhyst_rigs.study.fleet_magnets import (
    RESULT_FILE,
    FleetSettings,
    Member,
    choose_law,
    evaluate_magnet,
    find_members,
)
from anhyst_rigs.study.fleet_spread import MagnetEstimate, estimate_spread
from tests.cli.command import quick
from tests.page import Page
from tests.refusals import refused, says
from tests.study.fleets import (
    SCATTER,
    few_loops_of,
    loops_of,
    magnet,
    model_of_quantities,
    quantities_of,
    write_fleet,
)

SETTINGS = FleetSettings(
    rate=1e4, law="effective-field", gap_map="reluctance", tolerance=0.5, history="settled"
)


def draw_magnets(count: int, uncertainty: float, seed: int) -> list[MagnetEstimate]:
    """Draw magnets of mean (2, -30) and scatter (0.1, 3), measured with two correlated errors."""
    rng = np.random.default_rng(seed)
    true = np.array([2.0, -30.0]) + rng.standard_normal((count, 2)) * [0.1, 3.0]
    std = uncertainty * np.array([0.1, 3.0])
    correlation = np.array([[1.0, 0.97], [0.97, 1.0]])
    errors = rng.multivariate_normal([0.0, 0.0], correlation * np.outer(std, std), count)
    return [MagnetEstimate.from_uncertainty(values, std, correlation) for values in true + errors]


@pytest.mark.first(2)
@pytest.mark.parametrize("left", [1e-3, 0.5, 1.0])
def test_mean_and_scatter_describe_magnets_and_not_loops(left: float) -> None:
    found = estimate_spread(draw_magnets(400, left, 3))
    assert found.mean == pytest.approx([2.0, -30.0], rel=0.02)
    assert found.scatter == pytest.approx([0.1, 3.0], rel=0.25)
    assert not found.outlier.any()


def test_undetermined_parameters_come_from_other_magnets() -> None:
    rng = np.random.default_rng(5)
    true = 2.0 + 0.1 * rng.standard_normal((60, 1))
    read = true + 0.2 * rng.standard_normal((60, 1))
    found = estimate_spread([MagnetEstimate.from_uncertainty(values, [0.2], [[1.0]]) for values in read])
    assert np.std(found.values - true) < 0.6 * np.std(read - true)


def test_outliers_are_named_and_do_not_affect_the_mean() -> None:
    magnets = draw_magnets(30, 0.1, 4)
    clean = estimate_spread(magnets)
    odd = replace(magnets[0], values=np.array([2.9, -30.0]))
    found = estimate_spread([*magnets, odd, odd])
    assert list(np.flatnonzero(found.outlier)) == [30, 31]
    assert found.scatter == pytest.approx(clean.scatter, rel=0.1)


def test_an_undetermined_quantity_affects_no_magnet() -> None:
    magnets = draw_magnets(20, 0.1, 6)
    wide = [
        MagnetEstimate.from_uncertainty([*magnet.values, 7.0], [0.01, 0.3, np.inf], []) for magnet in magnets
    ]
    found = estimate_spread(wide)
    assert np.isfinite(found.mean).all()
    assert not found.outlier.any()


def test_a_quantity_at_the_end_of_its_range_is_as_uncertain_as_its_loops_leave_it() -> None:
    # Reversible parts of 0 +- 0.3 and of 0.2 +- 0.01: the first must not count as exact.
    rng = np.random.default_rng(8)
    sure = [
        MagnetEstimate.from_uncertainty([0.2 + 0.01 * deviation], [0.01], [])
        for deviation in rng.standard_normal(12)
    ]
    found = estimate_spread([*sure, *[MagnetEstimate.from_uncertainty([0.0], [0.3], [])] * 5])
    assert found.mean == pytest.approx([0.2], rel=0.05)
    assert found.scatter < 0.02
    assert not found.outlier.any()


def test_a_magnet_is_a_file_or_a_folder(tmp_path: Path) -> None:
    (tmp_path / "b.csv").write_text("I_A,F_N\n")
    (tmp_path / "notes.txt.bak").write_text("x")
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "near.csv").write_text("I_A,F_N\n")
    (tmp_path / "empty").mkdir()
    assert [member.name for member in find_members(tmp_path)] == ["a", "b"]
    (tmp_path / "b").mkdir()
    (tmp_path / "b" / "near.csv").write_text("I_A,F_N\n")
    with refused("name-twice"):
        find_members(tmp_path)
    with refused("no-such-folder"):
        find_members(tmp_path / "none")
    with refused("no-files: empty"):
        find_members(tmp_path / "empty")


def test_an_unreadable_file_is_reported_for_its_magnet(tmp_path: Path) -> None:
    gone = [Member(name, tmp_path / f"{name}.csv") for name in "ab"]
    auto = replace(SETTINGS, law="auto", gap_map="auto")
    choice = choose_law(gone, auto, tmp_path, 1)
    assert choice.settings == auto
    result = evaluate_magnet(choice.task(gone[0], auto, tmp_path))
    assert says(result["error"], "cannot-be-read: a.csv")


def test_results_do_not_become_magnets(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_text("I_A,F_N\n0,0\n")
    for out in (tmp_path, tmp_path / "found"):
        with refused("out-among-inputs"):
            fleet(tmp_path, out, SETTINGS)
    assert [path.name for path in tmp_path.iterdir()] == ["a.csv"]


@pytest.fixture(scope="module")
def magnets(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Write three magnets, one with different pinning, and a damaged file."""
    folder = tmp_path_factory.mktemp("magnets")
    write_fleet(folder, 4)
    loops_of(magnet(1.8, 1.0), 99).save(folder / "odd.csv")
    (folder / "damaged.csv").write_text("I_A,F_N\n1,x\n")
    return folder


@pytest.fixture(scope="module")
def found(magnets: Path, tmp_path_factory: pytest.TempPathFactory) -> Fleet:
    return fleet(magnets, tmp_path_factory.mktemp("fleet"), SETTINGS)


@pytest.mark.slow
def test_a_fleet_is_evaluated_despite_a_damaged_file(found: Fleet) -> None:
    assert [result["name"] for result in found.evaluated] == ["m00", "m01", "m02", "m03", "odd"]
    assert list(found.failed) == ["damaged"]
    assert "damaged.csv: line 2" in found.failed["damaged"]
    # Each magnet is good with its own controller. A common model does not suit outputs that differ
    # by 5 %.
    assert all(found.is_good)
    assert sum(found.is_good_shared) < 4
    assert found.outliers == ["odd"]
    assert found.typical != "odd"
    assert found.spread is not None
    scatter = dict(zip(found.quantities, found.spread.scatter / found.spread.mean, strict=True))
    assert 0.3 * SCATTER < scatter["output at saturation (N)"] < 3.0 * SCATTER
    assert abs(scatter["a/c_H (A)"]) < 0.2 * SCATTER
    content = json.loads((found.out / "fleet.json").read_text())
    assert content["yield"] == pytest.approx(5 / 6)
    assert (found.out / "m02" / "controller" / "DROP_IN.md").is_file()
    assert len((found.out / "fleet.csv").read_text().splitlines()) == 6
    assert len(found.plot().lines) == 3


@pytest.mark.slow
def test_a_stopped_run_resumes_to_the_same_result(
    magnets: Path, found: Fleet, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = {path: path.read_bytes() for path in found.out.rglob("*.json")}
    kept = found.out / "m00" / RESULT_FILE
    stamp = kept.stat().st_mtime_ns
    (found.out / "m01" / RESULT_FILE).unlink()
    (found.out / "m02" / RESULT_FILE).write_text('{"name": "m02"')  # as after a power failure
    again = fleet(magnets, found.out, SETTINGS, jobs=1)
    assert kept.stat().st_mtime_ns == stamp
    # Any order of work gives the same files, byte for byte; no file contains a time.
    assert {path: path.read_bytes() for path in found.out.rglob("*.json")} == before
    assert again.as_dict() == found.as_dict()
    monkeypatch.setattr(whole, "map_ordered", lambda *_: [{"name": "a", "error": "broken"}])
    with refused("no-magnet-judged", NegativeResult):
        fleet(magnets, found.out, SETTINGS)


@pytest.mark.slow
def test_magnets_in_the_light_of_their_fleet_are_nearer_to_the_truth() -> None:
    # With few loops and 1 % noise, estimates of gap and pinning are correlated in each magnet.
    rng = np.random.default_rng(11)
    made = [magnet(*(1.0 + SCATTER * rng.standard_normal(2))) for _ in range(12)]
    fits = [
        identify(
            few_loops_of(magnet, place),
            law="effective-field",
            gap_map="reluctance",
            offsets=False,
            dead_band=False,  # the true magnets have none
        ).model.uncertainty
        for place, magnet in enumerate(made)
    ]
    estimates = [fit for fit in fits if fit is not None]
    ways = [coordinate_kind("effective-field", name) for name in estimates[0].names]
    assert ways == ["log", "plain", "asinh", "asinh", "log", "log"]
    found = estimate_spread(
        [MagnetEstimate.from_uncertainty(u.values, u.std, u.correlation) for u in estimates], ways
    )
    true = np.array([quantities_of(magnet) for magnet in made])
    own = np.array([fit.values for fit in estimates])

    def force_error(values: FloatArray) -> FloatArray:
        return np.asarray(np.sqrt(np.mean((values / true - 1.0) ** 2, axis=0)))

    assert (force_error(found.values) < 0.9 * force_error(own)).all()
    drive = np.concatenate([np.linspace(0.0, 2.5, 60), np.linspace(2.5, 0.5, 60)])

    def forces(magnets: list[Model]) -> FloatArray:
        """Return the forces at a gap without measured loops."""
        return np.array([magnet(drive, 8e-4, history="demagnetised") for magnet in magnets])

    def force_off(values: FloatArray) -> float:
        return float(
            np.std(forces([model_of_quantities(quantities) for quantities in values]) - forces(made))
        )

    assert force_off(found.values) < 0.95 * force_off(own)


@pytest.mark.slow
def test_the_magnets_that_choose_are_identified_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "magnets").mkdir()
    write_fleet(tmp_path / "magnets", 4)
    count: list[str] = []

    def counted(*given: Any, **named: Any) -> Any:
        count.append(named["law"])
        chosen = {"law": "effective-field", "gap_map": "reluctance"}  # the choice of auto
        return identify(*given, **named | chosen)

    monkeypatch.setattr("anhyst_rigs.study.fleet_magnets.identify", counted)
    settings = replace(SETTINGS, law="auto", gap_map="auto")
    out = tmp_path / "out"
    found = fleet(tmp_path / "magnets", out, settings, jobs=1)
    assert (found.settings.law, found.settings.gap_map) == ("effective-field", "reluctance")
    assert count == ["auto", "auto", "auto", "effective-field"]
    before = (out / "m01" / "model.toml").read_bytes()
    (
        out / "m01" / RESULT_FILE
    ).unlink()  # stopped before the evaluation: it is identified again with its first settings
    count.clear()
    again = fleet(tmp_path / "magnets", out, replace(settings, tolerance=0.01), jobs=1)
    assert count == ["auto"]
    assert (out / "m01" / "model.toml").read_bytes() == before
    assert not any(again.is_good)  # a changed tolerance uses stored results
    write_fleet_report(tmp_path / "report.html", again)
    assert "No magnet is good" in (tmp_path / "report.html").read_text()


@pytest.mark.slow
def test_the_verb_writes_a_report(magnets: Path, found: Fleet) -> None:
    completed = quick(
        *("fleet", magnets, "--out", found.out, "--tolerance", "0.5", "--history", "settled"),
        *("--law", "effective-field", "--gap-map", "reluctance", "--json"),
        cwd=found.out.parent,
    )
    assert completed.returncode == 0, completed.stderr
    assert json.loads(completed.stdout)["outliers"] == ["odd"]
    assert "warning: damaged: " in completed.stderr
    page = (found.out / "report.html").read_text()
    assert "Outliers" in page
    assert "Individual models help" in page
    Page(page).check_answer_first()


@pytest.mark.slow
def test_an_empty_folder_is_refused_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "magnets").mkdir()
    completed = quick("fleet", "magnets", "--out", "out", cwd=tmp_path)
    assert completed.returncode == 2
    assert says(completed.stderr, "no-files: magnets")
    assert not (tmp_path / "out").exists()
