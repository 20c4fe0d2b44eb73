"""``compile`` rejects an unsuitable model, option or folder, and writes nothing."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.refusals import says

from .command import contents, quick, refused
from .records import model

GOOD = model()
COMPILE = ("compile", "model.toml", "--rate", "1e4", "--out", "c")


def edited(**values: str) -> str:
    """Return the good model with some values replaced."""
    text = GOOD
    for key, value in values.items():
        text, count = re.subn(rf"(?m)^({key} =) [^#\n]*", rf"\1 {value} ", text)
        assert count == 1, key
    return text


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "model.toml").write_text(GOOD)
    return tmp_path


@pytest.mark.first(2)
@pytest.mark.parametrize(
    ("values", "said"),
    [
        pytest.param(
            {"law": '"jiles-atherton-1986"'}, "no-fixed-point-form: 'jiles-atherton-1986'", id="law of 1986"
        ),
        pytest.param(
            {"gap_map": '"free"', "k_A_per_m": "[300.0, 310.0]"}, "no-fixed-point-form: 'free'", id="free map"
        ),
        pytest.param({"alpha": "0.05"}, "no-fixed-point-form", id="jumps"),
        pytest.param({"F_N": "[0.0, 5e5]"}, "demand-beyond-saturation flux", id="demand beyond saturation"),
        pytest.param(
            {"F_N": "[0.0, 1e300]"}, "demand-beyond-saturation flux", id="demand beyond any float of C"
        ),
        pytest.param(
            {"M_s_A_per_m": "1e-300"}, "demand-beyond-saturation flux", id="iron without magnetisation"
        ),
        pytest.param({"F_N": "[0.0, 0.0]"}, "range-too-narrow valid", id="no room for a demand"),
        pytest.param({"F_N": "[-5.0, -1.0]"}, "range-too-narrow valid", id="demand below zero"),
        pytest.param({"I_A": "[0.0, 0.0]"}, "range-too-narrow valid", id="no room for a current"),
        pytest.param({"gap_m": "[3e-4, 3e-4]"}, "range-too-narrow valid: 0.0003", id="no room for the gap"),
        pytest.param(
            {"I_A": "[0.0, 1e300]"},
            "not-computed valid: sample 1; 1.66667e+298",
            id="current beyond the tables",
        ),
        pytest.param({"rho": "[1e9, 1e9]"}, "law-beyond-the-tables", id="no room for the law"),
    ],
)
def test_a_model_that_cannot_be_compiled(folder: Path, values: dict[str, str], said: str) -> None:
    (folder / "model.toml").write_text(edited(**values))
    refusal = refused(*COMPILE, cwd=folder)
    assert refusal.startswith("model.toml: ")
    assert says(refusal, said)


@pytest.mark.parametrize(
    ("values", "said"),
    [
        pytest.param({"F_0_N": "5000.0"}, "too-large-for-fixed-point: gap_offset; 8.33", id="offset"),
        pytest.param({"rho": "[0.004, 4e5]"}, "weights-too-uneven current: 23111111", id="arm"),
        pytest.param({"I_0_A": "-3.0"}, "tables-too-steep current: 101", id="field"),
    ],
)
def test_a_table_that_would_overflow(folder: Path, values: dict[str, str], said: str) -> None:
    (folder / "model.toml").write_text(edited(**values))
    said_ = refused(*COMPILE, "--accuracy", "5", cwd=folder)
    assert said_.startswith("model.toml: ")
    assert says(said_, said)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("values", "said"),
    [
        pytest.param({"F_0_N": "499.0"}, "flux-not-moved valid", id="nothing above the offset"),
        pytest.param({"c": "1.0"}, "no-hysteresis", id="no hysteresis"),
    ],
)
def test_a_model_that_no_simplified_law_follows(folder: Path, values: dict[str, str], said: str) -> None:
    (folder / "model.toml").write_text(edited(**values))
    refusal = refused(*COMPILE, "--kind", "simplified", cwd=folder)
    assert refusal.startswith("model.toml: ")
    assert says(refusal, said)


def test_a_damaged_model_is_reported_with_line_and_key(folder: Path) -> None:
    text = edited(k_A_per_m='"300"')
    line = next(n for n, row in enumerate(text.split("\n"), 1) if row.startswith("k_A_per_m"))
    (folder / "model.toml").write_text(text)
    message = refused(*COMPILE, cwd=folder)
    assert says(message, f"finite-number: model.toml:{line}; parameters.k_A_per_m")
    (folder / "model.toml").write_text(GOOD[:900])
    assert refused(*COMPILE, cwd=folder).startswith("model.toml:")
    (folder / "model.toml").unlink()
    assert says(refused(*COMPILE, cwd=folder), "no-such-file: model.toml")


def test_a_model_without_limits(folder: Path) -> None:
    (folder / "model.toml").write_text(GOOD.split("# Smallest and largest")[0])
    message = refused(*COMPILE, cwd=folder)
    assert says(message, "no-valid-range valid: model.toml")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "culprit", "advice"),
    [
        (("--kind", "simplified", "--accuracy", "0.1"), "straight anhysteretic", "compile with --kind full"),
        pytest.param(
            *(("--accuracy", "0.001", "--io", "q31"), "tables", "the tables of a block cannot be larger"),
            marks=pytest.mark.slow,  # also in packages/anhyst/tests/compilation/test_compile.py
        ),
    ],
)
def test_an_accuracy_out_of_reach_names_its_cause(
    folder: Path, options: tuple[str, ...], culprit: str, advice: str
) -> None:
    before = contents(folder)
    result = quick(*COMPILE, *options, cwd=folder)
    assert result.returncode == 1, result
    assert result.stdout == ""
    assert result.stderr.count("\n") == 1
    assert says(result.stderr, f"accuracy-not-reached: {culprit}; {advice}")
    assert contents(folder) == before


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--rate", "0"), "--rate"),
        (("--rate", "nan"), "--rate"),
        (("--rate", "1e9"), "--rate"),
        (("--accuracy", "nan"), "--accuracy"),
        (("--accuracy", "-1"), "--accuracy"),
        (("--kind", "square"), "'square' is not one of 'full', 'simplified'"),
        (("--io", "q7"), "'q7' is not one of 'q15', 'q31', 'f32'"),
    ],
)
def test_options_out_of_range(folder: Path, options: tuple[str, ...], said: str) -> None:
    assert said in refused(*COMPILE, *options, cwd=folder)


def test_a_place_that_is_not_ours(folder: Path) -> None:
    (folder / "mine").mkdir()
    (folder / "mine" / "notes.txt").write_text("mine")

    def said(out: str) -> str:
        return refused(*COMPILE[:-1], out, cwd=folder)

    assert says(said("model.toml"), "is-a-file: model.toml")
    assert says(said("mine"), "folder-holds-other-files")
    assert says(said("no/where"), "no-such-folder")


def test_a_place_that_may_not_be_written(folder: Path) -> None:
    (folder / "locked").mkdir()
    (folder / "locked").chmod(0o555)
    given = (*COMPILE[:-1], "locked/c")
    message = refused(*given, cwd=folder, ordinary=True)
    assert says(message, "cannot-be-written")
