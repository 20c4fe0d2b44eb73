"""Test ``anhyst tune`` on the command line: files, exit codes, interruption."""

from __future__ import annotations

import inspect
import json
import re
import shutil
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from anhyst.cli import app as cli
from anhyst.control.controller_file import read_controller
from anhyst.model.writer import write_model
from anhyst_rigs.study.bearing.simulate import compared_variants
from anhyst_rigs.study.tuning import search
from anhyst_rigs.verbs.tune import tune as command
from tests.cli.command import Result, quick, refused, shares_said, speaking
from tests.refusals import says
from tests.study import bearings


@cache
def files() -> tuple[str, str]:
    """Rig and controller of the example with few trials."""
    rig = (bearings.EXAMPLE / "rig.toml").read_text(encoding="utf-8")
    for key, value in {
        "also_gaps_m": "[]",
        "heights_m": "[10e-6, 50e-6]",
        "hold_s": "0.03",
        "noise_seeds": "2",
    }.items():
        rig = re.sub(rf"^{key} = .*$", f"{key} = {value}", rig, flags=re.MULTILINE)
    controller = (bearings.EXAMPLE / "controller.toml").read_text(encoding="utf-8")
    controller = controller.replace('variant = "full"', 'variant = "linearised"')
    return rig, controller.replace('applied = "reference"', 'applied = "reference"\nmodel = "m.toml"')


@pytest.fixture
def here(tmp_path: Path) -> Path:
    """Folder with a bearing that tunes quickly and has an identified model."""
    rig, controller = files()
    (tmp_path / "rig.toml").write_text(rig, encoding="utf-8")
    (tmp_path / "controller.toml").write_text(controller, encoding="utf-8")
    for name in ("loops.csv", "loops.toml"):
        shutil.copy(bearings.EXAMPLE / name, tmp_path)
    write_model(bearings.knowledge().model, tmp_path / "m.toml")
    return tmp_path


def tune(here: Path, *arguments: object) -> Result:
    return quick("tune", "rig.toml", "--out", "tuned", "--budget", 10, *arguments, cwd=here)


@pytest.mark.slow
def test_a_tuned_controller_is_written_that_can_be_tuned_again(here: Path) -> None:
    result = tune(here)
    assert result.returncode == 0, result.stderr
    assert result.stderr == ""
    assert "linearised" in result.stdout
    assert "verdict: no verdict: only 'linearised' was tuned" in result.stdout
    folder = here / "tuned"
    assert sorted(path.name for path in folder.iterdir()) == [
        "controller.toml",
        "pareto.png",
        "tuning.json",
        "tuning.md",
    ]
    tuned = read_controller(folder / "controller.toml")
    assert tuned.settings.gains is not None
    assert tuned.model is not None
    assert tuned.model.samefile(here / "m.toml")
    note = (folder / "controller.toml").read_text(encoding="utf-8")
    assert "# Aims: overshoot <= 2 %, peak sensitivity <= 3; then the least settling time." in note
    figures = json.loads((folder / "tuning.json").read_text(encoding="utf-8"))
    one = figures["variants"]["linearised"]
    assert one["met"]
    assert one["figures"]["overshoot_percent"] <= 2.0
    assert one["gains"]["K_p_N_per_m"] == tuned.settings.gains.K_p_N_per_m
    assert one["figures"]["settling_time_s"] < one["before"]["settling_time_s"]
    assert len(one["conditions"]) == 2
    assert len(one["steps"]) == 4
    assert "| linearised |" in (folder / "tuning.md").read_text(encoding="utf-8")


@pytest.mark.slow
def test_aims_that_cannot_be_met_are_a_negative_result_after_per_cents_of_the_way(here: Path) -> None:
    given = ("rig.toml", "--out", "tuned", "--budget", 10, "--settling", 1e-3, "--json")
    result = speaking(0.2, "tune", *given, cwd=here)
    assert result.returncode == 1
    figures = json.loads((here / "tuned" / "tuning.json").read_text(encoding="utf-8"))
    assert json.loads(result.stdout) == figures
    assert "settling_time_s" in figures["variants"]["linearised"]["misses"]
    *on_the_way, last = result.stderr.splitlines(keepends=True)
    assert says(last, "aims-missed")
    assert "ms (aim 1 ms); what limits: " in last
    shares = shares_said("tuning", result.stderr)
    assert len(shares) == len(on_the_way)
    assert shares == sorted(shares)
    assert len({share for share in shares if 0 < share < 100}) >= 4, result.stderr
    note = (here / "tuned" / "controller.toml").read_text(encoding="utf-8")
    assert "# It MISSES its aims." in note


@pytest.mark.slow
def test_all_variants_are_tuned_alike_and_compared(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("anhyst_rigs.study.bearing.simulate.COMPARED_VARIANTS", ("ratio", "flux"))
    monkeypatch.chdir(here)
    given = ["tune", "rig.toml", "--out", "tuned", "--budget", "10", "--all-variants"]
    assert cli.main(given) == 0
    names = {"ratio", "flux", "linearised"}
    figures = json.loads((here / "tuned" / "tuning.json").read_text(encoding="utf-8"))
    assert set(figures["variants"]) == names
    table = (here / "tuned" / "tuning.md").read_text(encoding="utf-8")
    for name in names:
        assert f"| {name} |" in table
        settings = read_controller(here / "tuned" / f"controller-{name}.toml").settings
        assert settings.compensation.variant == name
        assert figures["variants"][name]["tried"] >= 15


def test_every_variant_is_compared_and_flux_only_with_a_probe() -> None:
    rig = bearings.example()
    names = compared_variants(rig, "secant")
    assert set(names) == {
        *("ratio", "linearised", "single-valued", "play", "flux", "simplified", "full", "secant")
    }
    blind = bearings.without_probe(rig)
    assert set(compared_variants(blind, "full")) == {
        *("ratio", "secant", "linearised", "single-valued", "play", "simplified", "full")
    }


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--overshoot", 0], "not-above-zero: overshoot_percent; 0.0"),
        (["--peak", 0.9], "out-of-range: 0.9"),
        (["--budget", 3], "out-of-range"),
        (["--controller", "none.toml"], "no-such-file: none.toml"),
        (["--out", "."], "writes-over-input: controller.toml"),
        (["--out", "rig.toml"], "is-a-file: rig.toml"),
    ],
)
def test_bad_input_is_one_line(here: Path, arguments: list[object], said: str) -> None:
    assert says(refused("tune", "rig.toml", "--out", "tuned", *arguments, cwd=here), said)


def test_an_unsuitable_controller_leaves_no_file(here: Path) -> None:
    text = (here / "controller.toml").read_text(encoding="utf-8")
    (here / "controller.toml").write_text(text.replace("20000.0", "10000.0"), encoding="utf-8")
    message = refused("tune", "rig.toml", "--out", "tuned", cwd=here)
    assert message.startswith("controller.toml:7: rate_Hz: ")
    assert says(message, "differs-from-rig rate_Hz")


@pytest.mark.slow
def test_ctrl_c_keeps_the_best_so_far(
    here: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    attempt = search.GainSearch._evaluate_points

    def stop(self: search.GainSearch, *given: Any) -> Any:
        found = attempt(self, *given)
        if self._tried_count >= 15:
            raise KeyboardInterrupt
        return found

    monkeypatch.setattr(search.GainSearch, "_evaluate_points", stop)
    monkeypatch.chdir(here)
    assert cli.main(["tune", "rig.toml", "--out", "tuned", "--budget", "100"]) == 130
    kept = str(Path("tuned") / "controller.toml")
    assert capsys.readouterr().err == (
        f"anhyst: interrupted: the best gains until then, not checked, are in {kept}\n"
    )
    assert read_controller(here / kept).settings.gains is not None
    assert "(the search was interrupted)" in (here / kept).read_text(encoding="utf-8")


def test_ctrl_c_before_any_gains_writes_nothing(
    here: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def stop(_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(search.GainSearch, "run", stop)
    monkeypatch.chdir(here)
    assert cli.main(["tune", "rig.toml", "--out", "tuned"]) == 130
    assert "no gains were found yet, nothing was written" in capsys.readouterr().err
    assert not (here / "tuned").exists()


def test_the_budget_of_the_command_is_that_of_the_function() -> None:
    assert inspect.signature(command).parameters["budget"].default == search.DEFAULT_BUDGET
