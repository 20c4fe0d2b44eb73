"""Contradicting options are rejected before any work."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from tests.refusals import says

from .command import ENVIRONMENT, quick, refused
from .records import PLAIN, model, table

IDENTIFY = ["identify", "loops.csv", "--out", "model.toml"]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "loops.csv").write_text(table())
    return tmp_path


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["predikt"], "No such command 'predikt'. Did you mean 'predict'? See 'anhyst --help'."),
        (["--frce"], "No such option: --frce"),
        ([*IDENTIFY, "--gap", "scaling"], "No such option: --gap (Possible options: --gap-map"),
        (
            [*IDENTIFY, "--law", "preisach"],
            "law 'preisach' is unknown; use one of "
            "effective-field, jiles-atherton-1986, play-cells, play-cells-langevin, auto",
        ),
        ([*IDENTIFY, "--search", "grid"], "Invalid value for '--search': 'grid' is not one of"),
        ([*IDENTIFY, "--gap-map", "spline"], "Invalid value for '--gap-map': 'spline' is not one"),
        ([*IDENTIFY, "--weights", "x"], "Invalid value for '--weights': 'x' is not one of 'loops'"),
        ([*IDENTIFY, "--seed", "one"], "Invalid value for '--seed': "),
        ([*IDENTIFY, "--seed", "-1"], "Invalid value for '--seed': "),
        (["identify", "--out", "model.toml"], "Missing argument 'LOOPS'"),
        (["identify", "loops.csv"], "Missing option '--out'"),
        (["diff", "model.toml"], "Missing argument 'B'"),
    ],
)
def test_wrong_usage_is_refused(folder: Path, arguments: list[str], message: str) -> None:
    assert refused(*arguments, cwd=folder).startswith(message)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([*IDENTIFY, "--clean", "wash"], "unknown-cleaning-step wash"),
        ([*IDENTIFY, "--history", "virgin"], "unknown-history history: 'virgin'"),
        ([*IDENTIFY, "--columns", "F_N"], "not-name-value columns: 'F_N'"),
        ([*IDENTIFY, "--columns", "F=F_N"], "no-such-column F: loops.csv; t_s"),
        ([*IDENTIFY, "--columns", "F_N=F_lbf"], "bad-header: loops.csv; 'F_N'; 'F_lbf'"),
        ([*IDENTIFY, "--constants", "T_C=warm"], "bad-constant T_C: loops.csv; 'warm'"),
        ([*IDENTIFY, "--constants", "T=20"], "bad-constant T: loops.csv; 'T_C'"),
        ([*IDENTIFY, "--constants", "gap_mm=1"], "column-and-constant gap: loops.csv"),
        ([*IDENTIFY, "--schedule", "humidity"], "column-missing humidity: loops.csv"),
        ([*IDENTIFY, "--loop", "run"], "no-such-column run: loops.csv"),
        ([*IDENTIFY, "--sidecar", "none.toml"], "cannot-be-read: none.toml"),
        (["inspect", "loops.csv", "--plot", "loops.gif"], "wrong-ending"),
    ],
)
def test_an_option_that_does_not_fit_is_refused(folder: Path, arguments: list[str], message: str) -> None:
    assert says(refused(*arguments, cwd=folder), message)


@pytest.mark.slow
@pytest.mark.parametrize("level", ["avx1024", "", "AVX2"])
def test_an_unavailable_instruction_set_is_refused(folder: Path, level: str) -> None:
    message = refused(*IDENTIFY, cwd=folder, variables={"ANHYST_DISPATCH": level})
    assert says(message, f"unknown-level: {level!r}")
    assert "base" in message


def test_an_input_file_is_not_overwritten(folder: Path) -> None:
    (folder / "model.toml").write_text(model())
    (folder / "loops.toml").write_text('history = "settled"\n')
    (folder / "link.csv").symlink_to("loops.csv")
    for out in ("loops.csv", "link.csv", "loops.toml", "../" + folder.name + "/loops.csv"):
        assert says(refused("identify", "loops.csv", "-o", out, cwd=folder), f"writes-over-input: {out}")
    for out in ("loops.csv", "model.toml"):
        reported = refused("predict", "model.toml", "loops.csv", "-o", out, cwd=folder)
        assert says(reported, f"writes-over-input: {out}")
    assert says(
        refused("report", "model.toml", "-o", "model.toml", cwd=folder), "writes-over-input: model.toml"
    )


@pytest.mark.slow
def test_a_model_next_to_its_measurements_is_not_read_as_their_settings(folder: Path) -> None:
    call = ["identify", "loops.csv", "--out", "loops.toml", *PLAIN]
    first = quick(*call, cwd=folder)
    assert first.returncode == 0, first.stderr
    text = (folder / "loops.toml").read_text()
    again = quick(*call, cwd=folder)
    assert again.returncode == 0, again.stderr
    assert (folder / "loops.toml").read_text() == text


def test_the_installed_command_ends_the_same(folder: Path) -> None:
    script = Path(sys.executable).with_name("anhyst")
    if not script.exists():
        pytest.skip("anhyst is not installed beside this Python")
    result = subprocess.run(
        [script, "inspect", "none.csv"],
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
        env=ENVIRONMENT,
    )
    assert result.returncode == 2
    assert result.stdout == ""
    assert says(result.stderr, "no-such-file: none.csv")
