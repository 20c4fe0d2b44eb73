"""A damaged model file is rejected by each command that reads it, with line and key."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.refusals import says

from .command import quick, refused
from .records import model, table

GOOD = model()

VERBS = {
    "predict": ["predict", "model.toml", "drive.csv", "--out", "force.csv"],
    "invert": ["invert", "model.toml", "drive.csv", "--out", "current.csv"],
    "report": ["report", "model.toml", "--out", "report.html"],
    "diff": ["diff", "good.toml", "model.toml"],
}


def edited(key: str, value: str) -> str:
    """Return the good model with one value replaced."""
    text, count = re.subn(rf"(?m)^({re.escape(key)} =) [^#\n]*", rf"\1 {value} ", GOOD)
    assert count == 1
    return text


def line_of(text: str, beginning: str) -> int:
    return next(number for number, line in enumerate(text.split("\n"), 1) if line.startswith(beginning))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "good.toml").write_text(GOOD)
    (tmp_path / "drive.csv").write_text(table())
    return tmp_path


def damage(folder: Path, content: str | bytes) -> Path:
    data = content.encode() if isinstance(content, str) else content
    (folder / "model.toml").write_bytes(data)
    return folder


def test_the_good_model_is_good(folder: Path) -> None:
    damage(folder, GOOD)
    for verb in ("predict", "invert", "diff"):
        result = quick(*VERBS[verb], cwd=folder)
        assert result.returncode == 0, result.stderr


@pytest.mark.parametrize(
    ("key", "value", "message"),
    [
        pytest.param("version", "2", "wrong-version version", id="another version"),
        pytest.param("format", '"recipe"', "wrong-format format", id="another format"),
        pytest.param("law", '"preisach"', "unknown-choice law: 'effective-field'", id="unknown law"),
        pytest.param("gap_map", '"spline"', "literal-error gap_map: 'none'; 'scaling'", id="unknown map"),
        pytest.param("history", '"virgin"', "unknown-history history: 'virgin'", id="unknown history"),
        pytest.param("k_A_per_m", "nan", "not-a-number parameters.k_A_per_m", id="NaN"),
        pytest.param("M_s_A_per_m", "inf", "not-a-number parameters.M_s_A_per_m", id="Inf"),
        pytest.param(
            "a_A_per_m", "1" + "0" * 400, "not-a-number parameters.a_A_per_m", id="beyond any float"
        ),
        pytest.param("k_A_per_m", '"300"', "not-a-number parameters.k_A_per_m", id="text in a number"),
        pytest.param("k_A_per_m", "-300.0", "out-of-range parameters.k_A_per_m: -300", id="negative"),
        pytest.param("c", "1.5", "out-of-range parameters.c: 1.5", id="out of range"),
        pytest.param("alpha", "1.0", "out-of-range parameters.alpha", id="runaway"),
        pytest.param(
            "rho", "[0.004, -0.008]", "out-of-range parameters.rho: -0.008", id="negative at a node"
        ),
        pytest.param("rho", "[0.004]", "length-differs parameters.rho", id="too few values"),
        pytest.param("nodes_m", "[0.6e-3, 0.3e-3]", "not-ascending schedule.nodes_m", id="nodes descend"),
        pytest.param("nodes_m", "[0.3e-3, 0.3e-3]", "not-ascending schedule.nodes_m", id="duplicate gaps"),
        pytest.param("I_A", "[2.0, 0.0]", "range-reversed valid.I_A", id="empty range"),
    ],
)
def test_a_wrong_value_is_reported_with_its_line_and_key(
    folder: Path, key: str, value: str, message: str
) -> None:
    text = edited(key, value)
    place = f"model.toml:{line_of(text, f'{key} = ')}: "
    refusal = refused(*VERBS["predict"], cwd=damage(folder, text))
    assert refusal.startswith(place)
    assert says(refusal, message)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        pytest.param("\nk_A_per_m", "\nk", "unit-missing parameters.k", id="no unit"),
        pytest.param("\nk_A_per_m", "\nk_Oe", "unit-missing parameters.k_Oe", id="another unit"),
        pytest.param('unit = "A"', 'unit = "mA"', "unit-not-si input.unit: 'mA'", id="not SI"),
        pytest.param('unit = "N"', "", "missing output.unit", id="no unit of the output"),
        pytest.param("alpha = ", "alfa = ", "extra-forbidden parameters.alfa: alpha", id="misspelt key"),
        pytest.param("[valid]", "[walid]", "extra-forbidden walid", id="unknown table"),
        pytest.param("\nk_A_per_m", "\n#", "missing parameters.k_A_per_m", id="missing key"),
        pytest.param("version = 1", "", "wrong-version version", id="no version"),
        pytest.param("alpha = ", "c = ", "damaged-toml", id="key twice"),
        pytest.param("[parameters]", "[parameters", "damaged-toml: ']'", id="open bracket"),
    ],
)
def test_a_wrong_key_is_reported(folder: Path, old: str, new: str, message: str) -> None:
    assert old in GOOD
    reported = refused(*VERBS["predict"], cwd=damage(folder, GOOD.replace(old, new, 1)))
    assert reported.startswith("model.toml:")
    assert says(reported, message)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        pytest.param("", "wrong-format format: model.toml", id="empty"),
        pytest.param(GOOD.encode("utf-16"), "not-utf8: model.toml", id="UTF-16"),
        pytest.param(bytes(range(256)) * 9, "not-utf8: model.toml", id="binary"),
        pytest.param(table(), "damaged-toml: model.toml:1:", id="measurements"),
        pytest.param("a = " + "[" * 9000, "damaged-toml: model.toml", id="endless brackets"),
        pytest.param("a = " + "9" * 9000, "damaged-toml: model.toml", id="endless number"),
    ],
)
def test_a_file_that_is_not_a_model_is_refused(folder: Path, content: str | bytes, message: str) -> None:
    assert says(refused(*VERBS["predict"], cwd=damage(folder, content)), message)


def test_a_truncated_model_is_refused_wherever_it_ends(folder: Path) -> None:
    for share in (0.2, 0.55, 0.8):
        message = refused(*VERBS["predict"], cwd=damage(folder, GOOD[: int(share * len(GOOD))]))
        assert message.startswith("model.toml")


@pytest.mark.parametrize("verb", ["invert", "report", "diff"])
def test_every_verb_refuses_a_damaged_model(folder: Path, verb: str) -> None:
    text = edited("c", "1.5")
    message = refused(*VERBS[verb], cwd=damage(folder, text))
    assert says(message, f"out-of-range parameters.c: model.toml:{line_of(text, 'c = ')}:; 1.5")
    (folder / "model.toml").unlink()
    assert says(refused(*VERBS[verb], cwd=folder), "no-such-file: model.toml")


def test_several_faults_are_reported_at_once(folder: Path) -> None:
    text = edited("c", "1.5").replace("k_A_per_m", "k").replace("alpha", "alfa")
    message = refused(*VERBS["predict"], cwd=damage(folder, text))
    assert "; also wrong: " in message
    assert all(key in message for key in ("parameters.k", "parameters.alfa"))


def test_a_folder_is_no_model(folder: Path) -> None:
    (folder / "model.toml").mkdir()
    assert says(refused(*VERBS["predict"], cwd=folder), "cannot-be-read")
