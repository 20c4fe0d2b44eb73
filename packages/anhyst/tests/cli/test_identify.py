"""``identify`` and ``inspect`` through the real command line, on the bundled example."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from tests.refusals import says
from tests.repository import ROOT

from .command import quick

EXAMPLE = ROOT / "examples" / "electromagnet"
TWO_GAPS = ("0.00030", "0.00060")


def test_identify_gives_a_model_that_predicts_unseen_gaps(tmp_path: Path) -> None:
    given = [EXAMPLE / "loops.csv", "--out", "model.toml", "--json", "--law", "effective-field"]
    result = quick("identify", *given, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    summary = json.loads(result.stdout)
    assert summary["gap_map"] in {"scaling", "reluctance"}
    assert set(summary["fit"]["left_out"]) >= {"scaling", "reluctance"}
    assert not summary["interrupted"]
    assert [path.name for path in tmp_path.iterdir()] == ["model.toml"]
    unseen = EXAMPLE / "unseen_truth.csv"
    result = quick("predict", "model.toml", unseen, "-o", "f.csv", "--json", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    apart = json.loads(result.stdout)["deviation"]
    assert apart["mean_abs"] < 0.005 * apart["largest"]


@pytest.mark.slow
def test_a_model_that_fails_its_acceptance_test_is_written_and_reported(tmp_path: Path) -> None:
    text = (EXAMPLE / "loops.csv").read_text()
    for old, new in (("0.00030", "x"), ("0.00060", "0.00030"), ("x", "0.00060")):
        text = text.replace(f",{old},", f",{new},")
    (tmp_path / "swapped.csv").write_text(text)
    arguments = ["swapped.csv", "--history", "settled", "--gap-map", "scaling", "-o", "model.toml"]
    arguments += ["--law", "effective-field"]
    result = quick("identify", *arguments, cwd=tmp_path)
    assert result.returncode == 1
    last = result.stderr.splitlines()[-1]
    assert says(last, "acceptance-failed: model.toml")
    assert "monotone = false" in (tmp_path / "model.toml").read_text()


def test_a_model_that_cannot_be_compiled_is_reported_with_the_option_that_helps(tmp_path: Path) -> None:
    shutil.copy(EXAMPLE / "loops.toml", tmp_path)
    lines = (EXAMPLE / "loops.csv").read_text().splitlines(keepends=True)
    kept = [line for line in lines if line[0] in "#t" or line.split(",")[3] in TWO_GAPS]
    (tmp_path / "loops.csv").write_text("".join(kept))
    arguments = ["--gap-map", "free", "--law", "effective-field", "--out", "model.toml"]
    result = quick("identify", "loops.csv", *arguments, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    (message,) = (line for line in result.stderr.splitlines() if "cannot be compiled" in line)
    assert message.startswith("anhyst: warning: gap map 'free'")
    assert "--gap-map scaling or reluctance" in message
    assert (
        message.split(": ", 2)[2]
        in quick("compile", "model.toml", "--rate", "2e4", "--out", "c", cwd=tmp_path).stderr
    )


def test_inspect_shows_the_loops_and_the_verdict(tmp_path: Path) -> None:
    result = quick("inspect", EXAMPLE / "loops.csv", "--plot", "loops.png", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert "16 loops, current to force" in result.stdout
    assert "A hysteresis model is worth it" in result.stdout
    assert (tmp_path / "loops.png").read_bytes().startswith(b"\x89PNG")
    found = json.loads(quick("inspect", EXAMPLE / "loops.csv", "--json", cwd=tmp_path).stdout)
    assert found["schedule_values"] == pytest.approx([3e-4, 4e-4, 5e-4, 6e-4])
    assert found["verdict"]["worthwhile"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["inspect", "none.csv"], "no-such-file: none.csv"),
        (["inspect", "x.csv", "--plot", "x.gif"], "wrong-ending"),
        (["inspect", "x.csv", "--columns", "I_A"], "not-name-value columns: 'I_A'"),
        (["inspect", EXAMPLE / "loops.csv", "--clean", "wash"], "unknown-cleaning-step wash"),
        (["identify", "x.csv", "--out", "none/m.toml"], "cannot-be-written: none/m.toml"),
    ],
)
def test_bad_input_is_one_line(tmp_path: Path, arguments: list[object], message: str) -> None:
    result = quick(*arguments, cwd=tmp_path)
    assert result.returncode == 2
    assert result.stdout == ""
    assert result.stderr.startswith("anhyst: error: ")
    assert says(result.stderr, message)
    assert result.stderr.count("\n") == 1
    assert not list(tmp_path.iterdir())
