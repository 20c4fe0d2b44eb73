"""A controller file of an older release is read, and every renamed word is reported at its line."""

from __future__ import annotations

import warnings
from pathlib import Path

import pytest

from anhyst.control.controller_file import read_controller
from anhyst.support.errors import RenamedWarning
from tests.cli.command import quick
from tests.refusals import refused

EXAMPLE = Path(__file__).parents[2] / "examples" / "bearing" / "controller.toml"


def older(folder: Path, *changes: tuple[str, str]) -> Path:
    text = EXAMPLE.read_text()
    for now, then in changes:
        assert now in text
        text = text.replace(now, then)
    path = folder / "controller.toml"
    path.write_text(text)
    return path


@pytest.mark.parametrize(("then", "now"), [("static", "single-valued"), ("ratio-chord", "secant")])
def test_an_older_name_of_a_method_is_read(tmp_path: Path, then: str, now: str) -> None:
    path = older(tmp_path, ('variant = "full"', f'variant = "{then}"'))
    text = rf':\d+: compensation\.variant: "{then}" is now called "{now}"; write that$'
    with pytest.warns(RenamedWarning, match=text):
        assert read_controller(path).settings.compensation.variant == now


def test_an_older_key_is_read_and_reported_at_its_line(tmp_path: Path) -> None:
    path = older(tmp_path, ("max_missing_samples = 3", "patience_ticks = 5"))
    text = r":43: safety\.patience_ticks: is now called max_missing_samples; write that$"
    with pytest.warns(RenamedWarning, match=text):
        assert read_controller(path).settings.safety.max_missing_samples == 5
    path.write_text(path.read_text().replace("patience_ticks = 5", "patience_ticks = -5"))
    with (
        pytest.warns(RenamedWarning),
        refused("greater-than-equal safety.max_missing_samples: :43:"),
    ):
        read_controller(path)


def test_what_is_written_today_warns_of_nothing() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        read_controller(EXAMPLE)


def test_the_command_line_prints_the_warning(tmp_path: Path) -> None:
    controller = older(
        tmp_path, ('variant = "full"', 'variant = "static"'), ("rate_Hz = 20000.0", "rate_Hz = 3e4")
    )
    rig = EXAMPLE.with_name("rig.toml")
    done = quick("simulate", rig, "--controller", controller, "--out", "run.csv", cwd=tmp_path)
    warning, error = done.stderr.splitlines()
    assert warning.startswith(f"anhyst: warning: {controller}:")
    assert warning.endswith('"static" is now called "single-valued"; write that')
    assert "rate_Hz" in error
