"""Values in the wrong unit cause one warning with the likely unit."""

from __future__ import annotations

from pathlib import Path

import pytest

from anhyst.model.actuator import Model, read_model
from anhyst.support.errors import ImplausibleWarning
from tests.cli.command import quick
from tests.cli.records import model, rows, table


@pytest.fixture
def known(tmp_path: Path) -> Model:
    """Return a model of 0 to 2 A, 0 to 500 N and 0.3 to 0.6 mm."""
    (tmp_path / "model.toml").write_text(model())
    return read_model(tmp_path / "model.toml")


def warned(folder: Path, content: str, verb: str = "predict") -> list[str]:
    """Return the warnings of a command that uses a model, one for each line."""
    (folder / "model.toml").write_text(model())
    (folder / "in.csv").write_text(content)
    result = quick(verb, "model.toml", "in.csv", "--out", "out.csv", cwd=folder)
    assert result.returncode == 0, result
    lines = result.stderr.splitlines()
    assert all(line.startswith("anhyst: warning: ") for line in lines)
    return lines


def inspected(folder: Path, header: str, factors: tuple[float, float, float]) -> list[str]:
    """Return warnings about loops whose current, force and gap are multiplied by factors."""
    body = [
        [row[0], *(f"{float(text) * by:.9g}" for text, by in zip(row[1:], factors, strict=True))]
        for row in rows()
    ]
    (folder / "loops.csv").write_text(table(body, header))
    result = quick("inspect", "loops.csv", cwd=folder)
    assert result.returncode == 0, result
    return result.stderr.splitlines()


def test_metres_for_millimetres_warn_once_with_the_likely_unit(known: Model) -> None:
    with pytest.warns(ImplausibleWarning) as caught:
        known.predict([0.0, 1.0, 2.0], 0.3)
    assert [str(one.message) for one in caught] == [
        "gap 0.3 m is 500 times the largest gap of the model; given in mm?"
    ]
    assert caught[0].filename == __file__
    with pytest.warns(ImplausibleWarning, match="given in mm"):
        known.invert([0.0, 10.0], 0.3)
    with pytest.warns(ImplausibleWarning, match="given in mm"):
        known.stepper(0.3, "demagnetised")


def test_milliamperes_for_amperes_warn_with_the_likely_unit(known: Model) -> None:
    with pytest.warns(ImplausibleWarning, match="current 2000 A is 1e.03 times .*given in mA"):
        known.predict([0.0, 2000.0], 0.45e-3)


def test_micrometres_and_metres_for_millimetres_are_reported_apart(known: Model) -> None:
    with pytest.warns(ImplausibleWarning, match="given in um"):
        known.predict([0.0, 1.0], 450.0)
    with pytest.warns(ImplausibleWarning, match="less than the smallest gap .*instead of mm"):
        known.predict([0.0, 1.0], 0.45e-6)


def test_values_a_little_outside_are_flagged_but_no_warning(known: Model) -> None:
    assert known.predict([0.0, 6.0], 2e-3).flags
    assert known.invert([0.0, 1500.0], 0.1e-3).flags


@pytest.mark.parametrize(
    ("content", "likely"),
    [
        ("I_A,gap_m\n0,0.3\n1,0.3\n2,0.3\n", "given in mm?"),
        ("I_A,gap_mm\n0,0.4\n1000,0.4\n2000,0.4\n", "given in mA?"),
        ("I_A,gap_mm\n0,0.0003\n1,0.0003\n2,0.0003\n", "metres instead of mm?"),
    ],
)
def test_a_drive_in_the_wrong_unit_warns_in_one_line(tmp_path: Path, content: str, likely: str) -> None:
    (complaint,) = warned(tmp_path, content)
    assert complaint.endswith(likely)


def test_a_demand_in_the_wrong_unit_warns_in_one_line(tmp_path: Path) -> None:
    (complaint,) = warned(tmp_path, "F_N,gap_mm\n0,0.4\n100000,0.4\n", "invert")
    assert complaint.endswith("given in mN?")


@pytest.mark.parametrize(
    ("header", "factors", "words"),
    [
        ("t_s,I_A,F_N,gap_mm", (1.0, 1.0, 1.0), "smaller than the flatness of surfaces"),
        ("t_s,I_A,F_kN,gap_m", (1.0, 1.0, 1.0), "the largest force is"),
        ("t_s,I_A,F_N,gap_m", (1e3, 1.0, 1.0), "the largest current is 2000 A"),
        ("t_s,I_A,F_N,gap_m", (1.0, 1.0, 1e3), "very wide for an electromagnet"),
        ("t_s,H_A_per_m,B_T,gap_m", (1.0, 1.0, 1.0), "the largest flux density is"),
    ],
)
def test_loops_in_the_wrong_unit_are_warned_of_once(
    tmp_path: Path, header: str, factors: tuple[float, float, float], words: str
) -> None:
    (complaint,) = inspected(tmp_path, header, factors)
    assert words in complaint


def test_plausible_loops_are_not_warned_of(tmp_path: Path) -> None:
    assert inspected(tmp_path, "t_s,I_A,F_N,gap_m", (1.0, 1.0, 1.0)) == []
