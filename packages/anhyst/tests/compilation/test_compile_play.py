"""Test a map with one play as a folder of C: content, execution, and rejected options."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import pytest

from anhyst.cli.app import main
from anhyst.compilation.play import CompiledPlay, compile_play, max_magnitude
from anhyst.model.writer import write_model
from anhyst.support.numeric import rms
from anhyst.verification import verify
from tests.actuators import magnet, ring
from tests.compilation.test_compile import WARNINGS, measured
from tests.core.test_c_core import tool
from tests.docs.blocks import blocks
from tests.refusals import refused, says


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("play")
    write_model(measured(magnet(play=105.0)), folder / "magnet.toml")
    write_model(measured(ring(), -600.0, 600.0), folder / "ring.toml")
    return folder


@pytest.fixture(scope="module")
def compiled(place: Path) -> CompiledPlay:
    return compile_play(place / "magnet.toml", place / "c", 2e4, "q31", "upper")


def test_the_example_builds_without_warnings_and_gives_the_golden_currents(
    compiled: CompiledPlay, tmp_path: Path
) -> None:
    sources = ["main.c", "upper_parameters.c", *map(str, compiled.out.glob("src/*/*.c"))]
    program = tmp_path / "example"
    subprocess.run(
        [tool("cc"), *WARNINGS, "-Iinclude", "-I.", *sources, "-o", program], cwd=compiled.out, check=True
    )
    with (compiled.out / "vectors.csv").open() as vectors:
        run = subprocess.run([program], stdin=vectors, capture_output=True, text=True, check=False)
    assert (run.returncode, run.stdout) == (0, "1000 rows, 0 differ\n")


def test_the_example_of_the_drop_in_guide_compiles(compiled: CompiledPlay, tmp_path: Path) -> None:
    text = (compiled.out / "DROP_IN.md").read_text(encoding="utf-8")
    source = tmp_path / "guide.c"
    source.write_text("\n".join(block.code for block in blocks(text) if block.language == "c"))
    include = [f"-I{compiled.out / 'include'}", f"-I{compiled.out}"]
    command = [tool("cc"), *WARNINGS, *include, "-c", str(source), "-o", str(tmp_path / "guide.o")]
    subprocess.run(command, check=True)


def test_the_folder_refuses_a_damaged_block(compiled: CompiledPlay, tmp_path: Path) -> None:
    written = (compiled.out / "upper_parameters.c").read_text(encoding="utf-8")
    words = compiled.play.block("fixed", int(compiled.manifest["model"]["sha256"][:8], 16))
    head, table = written.rsplit("*/", 1)
    damaged = tmp_path / "upper_parameters.c"
    last = str(int(words[-1]))
    at = table.rindex(last)
    damaged.write_text(f"{head}*/{table[:at]}{int(words[-1]) ^ 1}{table[at + len(last) :]}", encoding="utf-8")
    program = tmp_path / "example"
    sources = ["main.c", str(damaged), *map(str, compiled.out.glob("src/*/*.c"))]
    command = [tool("cc"), "-std=c99", "-Iinclude", "-I.", *sources, "-o", str(program)]
    subprocess.run(command, cwd=compiled.out, check=True)
    run = subprocess.run([program], input="", capture_output=True, text=True, check=False)
    assert run.returncode != 0
    assert "0 differ" not in run.stdout


@pytest.mark.slow
@pytest.mark.needs("gcc")
def test_every_target_agrees_with_the_host_bit_for_bit(
    compiled: CompiledPlay, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("anhyst.verification.targets.HOST_COMPILERS", {"gcc": "gcc"})
    found = verify(compiled.out, "host,cortex-m4", 20_000, 2_000)
    assert found.passed, found.first_failure()
    assert [result.label for result in found.results if result.warnings] == []
    costs = {
        cost.part: cost.most
        for result in found.results
        if result.label == "cortex-m4 (port header)"
        for cost in result.costs
    }
    assert costs["solve"] < 300
    assert costs["commit, solved"] < 100
    with refused("target-not-for-this --on"):
        verify(compiled.out, "cortex-m3-qemu")


def test_the_stated_accuracy_shows_the_gain_of_the_play(place: Path, compiled: CompiledPlay) -> None:
    play, without = compiled.errors["play"], compiled.errors["single-valued"]
    assert rms(play.major) < 0.3 * rms(without.major)
    assert rms(play.small) < rms(without.small)
    message = json.loads((compiled.out / "manifest.json").read_text())["accuracy"]
    assert message["play"]["major_worst_percent"] == pytest.approx(
        100.0 * max_magnitude(play.major) / message["largest_output"]
    )
    again = compile_play(place / "magnet.toml", place / "again", 2e4, "q31", "upper")
    for name in compiled.files:
        assert (compiled.out / name).read_bytes() == (again.out / name).read_bytes()


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (["magnet.toml", "--io", "q15"], "option-not-for-this --io"),
        (["magnet.toml", "--io", "q31", "--accuracy", "1"], "option-not-for-this --accuracy"),
        (["ring.toml", "--io", "q31"], "option-not-for-this --kind"),
        (["magnet.toml", "--io", "q31", "--controller", "x"], "option-not-for-this --controller"),
    ],
)
def test_inputs_that_do_not_fit_are_refused(
    place: Path,
    options: list[str],
    said: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(place)
    code = main(["compile", *options, "--kind", "play", "--rate", "1e4", "--out", "other"])
    assert code == 2
    assert says(" ".join(capsys.readouterr().err.split()), said)
    assert not (place / "other").exists()


@pytest.mark.slow
def test_the_command_shows_both_accuracies(
    place: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(place)
    given = ["magnet.toml", "--kind", "play", "--io", "q31", "--rate", "1e4", "--out", "shown"]
    assert main(["compile", *given]) == 0
    shown = capsys.readouterr().out
    assert "map with one play" in shown
    assert "single-valued curve" in shown
