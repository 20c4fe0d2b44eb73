"""With default options, loops of the test magnets become models with correct claims."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from anhyst.model.actuator import Model, read_model
from anhyst.model.writer import write_model
from tests.cli.command import quick, unwrapped
from tests.foreign.identified import identified_once
from tests.foreign.magnets import MAGNETS, ForeignMagnet

NAMES = [pytest.param(name, marks=[pytest.mark.slow] * (name != "u")) for name in sorted(MAGNETS)]
Found = Callable[[str], tuple[Model, Any]]


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("foreign")


def identified(place: Path, magnet: ForeignMagnet, *options: str) -> tuple[Model, Any]:
    """Identify a magnet's loops on the command line; return the model and the printed JSON."""
    loops = magnet.write_loops(place / f"{magnet.name}.csv")
    out = place / f"{magnet.name}.toml"
    completed = quick("identify", loops, "--out", out, "--json", *options, cwd=place)
    assert completed.returncode == 0, completed.stderr
    return read_model(out), json.loads(completed.stdout)


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> Found:
    """Return a function that gives the model of a magnet by its name, and the printed JSON."""

    def give(name: str) -> tuple[Model, Any]:
        folder = identified_once(tmp_path_factory, name)
        return read_model(folder / "model.toml"), json.loads((folder / "said.json").read_text())

    return give


@pytest.fixture(scope="module")
def hard(place: Path) -> tuple[Model, Any]:
    """Return the model of the magnet ``hard`` with a given law."""
    return identified(place, MAGNETS["hard"], "--law", "effective-field")


def missed(model: Model, magnet: ForeignMagnet) -> list[float]:
    """Return the mean error at each withheld gap, relative to the largest force, without noise."""
    assert model.fit is not None
    history = "demagnetised" if magnet.demagnetised else "settled"
    errors = []
    for gap in magnet.unseen:
        gap_errors = []
        for _, _, current, force in replace(magnet, gaps=(gap,))._records():
            read = current + magnet.sensors.current_offset
            output = model.predict(read, gap, history=history).output
            gap_errors.append(np.abs(output - force - magnet.sensors.force_offset))
        errors.append(float(np.mean(np.concatenate(gap_errors))) / model.fit.largest_output)
    return errors


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_the_default_can_be_compiled_and_passes_its_acceptance_test(found: Found, name: str) -> None:
    model, reported = found(name)
    assert model.gap_map in {"scaling", "reluctance", "circuit"}
    assert set(reported["fit"]["left_out"]) == {"scaling", "reluctance", "circuit"}
    assert model.acceptance().passed is True
    assert not any("compiled" in text for text in reported["warnings"])


@pytest.mark.slow
@pytest.mark.parametrize("name", ["u", pytest.param("soft", marks=pytest.mark.slow)])
def test_no_offset_is_reported_for_a_magnet_without_one(found: Found, name: str) -> None:
    """No offset of the current is above 0.02 % of its range; an iron may cause this much."""
    model, reported = found(name)
    assert np.all(np.abs(model.parameters["in_0"]) < 1e-3)
    assert not np.any(model.parameters["out_0"])
    for gap in model.nodes:
        others = model.predict([0.0], gap, history="demagnetised").output
        assert abs(others[0]) < 1e-4 * reported["fit"]["largest_output"]


@pytest.mark.slow
def test_the_offset_of_the_current_sensor_is_found(hard: tuple[Model, Any]) -> None:
    model, reported = hard
    true = MAGNETS["hard"].sensors.current_offset
    assert model.parameters["in_0"] == pytest.approx(true, abs=3e-3)
    uncertain = reported["uncertainty"]
    std = dict(zip(uncertain["names"], uncertain["std"], strict=True))["input offset (A)"]
    assert 1e-4 < std < 5e-3
    assert abs(model.parameters["in_0"] - true) < 4.0 * std  # type: ignore[operator]


@pytest.mark.slow
@pytest.mark.parametrize("offset", [-2.5, pytest.param(2.5, marks=pytest.mark.slow)])
def test_an_offset_of_the_force_is_read_before_the_iron_is_magnetised(place: Path, offset: float) -> None:
    u = MAGNETS["u"]
    magnet = replace(u, name="tared", sensors=replace(u.sensors, force_offset=offset))
    fast = ("--gap-map", "reluctance", "--law", "effective-field")
    model, reported = identified(place, magnet, *fast)
    assert model.parameters["out_0"] == pytest.approx(offset, abs=0.4)
    assert not np.any(model.parameters["in_0"])
    assert "output offset (N)" in reported["uncertainty"]["names"]
    none, _ = identified(place, magnet, *fast, "--no-offsets")
    assert none.parameters["out_0"] == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_the_error_at_unseen_gaps_is_within_the_stated_interval(found: Found, name: str) -> None:
    model, reported = found(name)
    assert model.fit is not None
    promised = model.fit.cross_validation
    assert promised is not None
    assert reported["fit"]["cross_validation"]["error"] == promised.error
    low, high = promised.interval
    for error in missed(model, MAGNETS[name]):
        # For the expected error, the law is selected again from fewer gaps, so it may be a simpler
        # one.
        assert 0.1 * low < error < high
    assert high < 5.0 * promised.error  # an interval that contains everything has no meaning


@pytest.mark.slow
def test_a_record_from_the_demagnetised_state_is_used_from_its_first_sample(
    place: Path, found: Found
) -> None:
    """The initial curve is predicted as well as the other samples, and the fit is not worse."""
    model, _ = found("u")
    assert str(model.history) == "demagnetised"
    same = ("--law", model.law, "--gap-map", model.gap_map)
    settled, _ = identified(place, replace(MAGNETS["u"], name="s"), "--history", "settled", *same)
    assert model.fit is not None
    assert settled.fit is not None
    assert model.fit.rms < 1.01 * settled.fit.rms
    assert max(missed(model, MAGNETS["u"])) < 1.02 * max(missed(settled, MAGNETS["u"]))
    rise = MAGNETS["u"].sweep_between(0.0, MAGNETS["u"].top)
    for gap in MAGNETS["u"].unseen:
        off = model.predict(rise, gap, history="demagnetised").output
        off = off - MAGNETS["u"].force(rise, gap)
        assert np.mean(np.abs(off)) < 5e-3 * model.fit.largest_output


def test_a_force_that_falls_as_the_current_rises_is_a_negative_result(place: Path, found: Found) -> None:
    """An earlier version fitted an offset of 3.4 % of the range where there is none."""
    model, _ = found("u")
    shifted = dict(model.parameters) | {"in_0": 0.17, "out_0": 2.75}
    failing = replace(model, parameters=shifted).acceptance()
    assert failing.passed is False
    assert failing.over_drive is not None
    assert "falls as the drive rises" in failing.text("A")
    assert "from the demagnetised state" in failing.text("A")


@pytest.mark.slow
def test_the_report_shows_offsets_and_the_expected_error(place: Path, hard: tuple[Model, Any]) -> None:
    write_model(hard[0], place / "hard.toml")
    assert quick("report", "hard.toml", "--out", "hard.html", cwd=place).returncode == 0
    text = (place / "hard.html").read_text(encoding="utf-8")
    assert "Expected at a gap between those measured" in text
    assert "input offset (A)" in text
    assert "never falls as the drive rises from rest" in text.replace("\n", " ")


@pytest.mark.slow
def test_offsets_and_the_expected_error_are_printed(place: Path) -> None:
    loops = MAGNETS["soft"].write_loops(place / "again.csv")
    completed = quick("identify", loops, "--law", "effective-field", "--out", "again.toml", cwd=place)
    assert "offsets of input and output: none, because the loops do not require any" in unwrapped(
        completed.stdout
    )
    assert "expected error between the measured values" in unwrapped(completed.stdout)


@pytest.mark.slow
def test_an_untared_load_cell_is_detected(place: Path) -> None:
    soft = MAGNETS["soft"]
    untared = replace(soft, name="untared", sensors=replace(soft.sensors, force_offset=4.0))
    model, _ = identified(place, untared, "--law", "effective-field")
    assert model.parameters["out_0"] == pytest.approx(4.0, abs=0.02)


@pytest.mark.slow
def test_an_arbitrary_zero_of_the_position_sensor_is_accepted(place: Path, measurements: Path) -> None:
    # A piezo actuator: the displacement starts at -123 um, two and a half times its range.
    loops = measurements / "piezo_flexure" / "model_run.csv"
    out = place / "piezo.toml"
    options = ("--columns", "V_in=u_V,y_um=x_um", "--clean", "skew", "--out", out, "--json")
    completed = quick("identify", loops, *options, cwd=place)
    assert completed.returncode == 0, completed.stderr
    fit = json.loads(completed.stdout)["fit"]
    assert fit["mean_abs"] < 0.01 * fit["largest_output"]
