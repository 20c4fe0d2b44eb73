"""Test the compiled position controller on every target: same bits, and cost of a tick."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import pytest

from anhyst.cli.app import main
from anhyst.compensate.plan import CompileRequest
from anhyst.compilation.output import compile_model
from anhyst.verification import TargetResult, verify
from anhyst.verification.bundle import read_bundle
from anhyst.verification.compare import BuildFolder
from anhyst.verification.protocol import CONTROLLER_RECORD, RANDOM, START
from anhyst.verification.protocol import Request as Asked
from anhyst.verification.result import Verification
from anhyst.verification.targets import build_reference
from tests.once import made_once
from tests.refusals import says
from tests.repository import ROOT
from tests.truths import path_of
from tests.verification.conftest import sign
from tests.verification.test_verify_targets import needs_avr

BEARING = ROOT / "examples" / "bearing"
TICKS = ["tick, controls", "tick, ramps", "tick, rests", "tick"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Compile the controller of the bundled bearing."""
    return made_once(tmp_path_factory, "compiled-bearing", compile_bearing) / "out"


def compile_bearing(place: Path) -> None:
    request = CompileRequest("full", "q31", 20e3, name="bearing")
    compile_model(path_of("bearing"), place / "out", request, BEARING / "controller.toml")


def ticks_of(found: Verification) -> list[TargetResult]:
    """Return the results of the controller; the bits of the compensator are the same too."""
    assert found.passed, found.first_failure()
    assert not any(result.warnings for result in found.results)
    results = [result for result in found.results if result.build.endswith(", controller")]
    assert len(results) == len(found.results) / 2
    return results


def plausible(result: TargetResult, folder: Path) -> None:
    assert [cost.part for cost in result.costs] == TICKS
    for cost in result.costs:
        assert 0 < cost.least <= cost.mean <= cost.most, cost
    controls, _, rests, tick = result.costs
    assert rests.most < controls.most <= tick.most
    rows = len((folder / "controller.csv").read_text().splitlines()) - 1
    assert result.vectors == rows > 1000
    assert result.sizes is not None
    assert result.sizes.variables == 0
    assert result.stack_measured is not None
    assert 0 < result.stack_measured < 1280


@pytest.mark.slow
def test_cortex_m4_agrees_with_the_host_bit_for_bit(folder: Path) -> None:
    portable, port = ticks_of(verify(folder, "cortex-m4", target_steps=1_000))
    manifest = json.loads((folder / "manifest.json").read_text())
    for result in (portable, port):
        plausible(result, folder)
        assert result.steps == 1_000
        assert result.state_bytes == manifest["controller"]["state_bytes"]
        assert result.stack_static is not None
        assert result.stack_static >= (result.stack_measured or 0)
    assert port.costs[-1].most < portable.costs[-1].most


@pytest.mark.slow
def test_a_dsc_is_estimated_for_the_tick_too(folder: Path) -> None:
    found = verify(folder, "cortex-m0plus", target_steps=2_000)
    (result,) = ticks_of(found)
    plausible(result, folder)
    cycles = {(estimate.prices, estimate.part): estimate.cycles for estimate in found.estimates}
    for part in TICKS:
        at_best, cautious = (cycles[name, f"controller: {part}"] for name in ("at best", "cautious"))
        assert 0 < at_best < cautious
    assert cycles["at best", "controller: tick"] > cycles["at best", "solve"]


def test_random_steps_reach_lifting_landing_and_rest(folder: Path, tmp_path: Path) -> None:
    program = build_reference(BuildFolder.create(read_bundle(folder), tmp_path / "w", "controller")).program
    reply = program.run([Asked(START), Asked(RANDOM, steps=10_000)])[-1]
    counts = dict(zip(CONTROLLER_RECORD.sections, (s.count for s in reply.sections), strict=True))
    assert counts["tick"] == 10_000
    assert min(counts[name] for name in TICKS) > 200


@pytest.mark.slow
@pytest.mark.needs("gcc")
def test_host_builds_agree_under_sanitizers_too(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("anhyst.verification.targets.HOST_COMPILERS", {"gcc": "gcc"})
    builds = [result.build for result in ticks_of(verify(folder, "host", host_steps=20_000))]
    levels = ("-O0", "-O2", "-O3", "sanitizers")
    assert builds == [f"gcc {level}, controller" for level in levels]


@pytest.mark.slow
@needs_avr
def test_avr_agrees_with_the_host_bit_for_bit(folder: Path) -> None:
    (result,) = ticks_of(verify(folder, "avr", target_steps=300))
    plausible(result, folder)
    assert result.unit == "cycles"


@pytest.mark.slow
@pytest.mark.needs("mspdebug")
def test_msp430_agrees_with_the_host_bit_for_bit(folder: Path) -> None:
    (result,) = ticks_of(verify(folder, "msp430", target_steps=300))
    plausible(result, folder)
    assert result.sizes is not None
    assert result.sizes.code + result.sizes.control_code < 0xD000


def spoiled(folder: Path, name: str, right: str, wrong: str, place: Path) -> Path:
    """Return a copy with a replaced text in one of its files, and an updated manifest."""
    shutil.copytree(folder, place)
    text = (place / name).read_text()
    assert text.count(right) >= 1, right
    (place / name).write_text(text.replace(right, wrong, 1))
    sign(place)
    return place


FAULTS = {
    "a setting": (
        "bearing_controller.c",
        ".rise = ",
        "\n#ifdef __thumb__\n      .rise = 1 +\n#else\n      .rise = \n#endif\n",
        None,
    ),
    "a limit": (
        "bearing_controller.c",
        ".current_high = ",
        "\n#ifdef __thumb__\n    .current_high = -29492 +\n#else\n    .current_high = \n#endif\n",
        "hash of the limits",
    ),
    "the side of a comparison": (
        "src/control/levitation.c",
        "if (l->reference == target) {",
        "\n#ifdef __thumb__\n    if (l->reference >= target) {\n#else\n"
        "    if (l->reference == target) {\n#endif\n",
        None,
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_on_the_target_is_found_in_the_controller_alone(
    folder: Path, tmp_path: Path, fault: str
) -> None:
    name, right, wrong, quantity = FAULTS[fault]
    found = verify(spoiled(folder, name, right, wrong, tmp_path / "out"), "cortex-m3")
    compensator, controller = found.results
    assert compensator.passed
    assert controller.difference is not None
    assert quantity in {None, controller.difference.quantity}
    assert "cortex-m3 (portable, controller): " in controller.verdict()


@pytest.mark.slow
def test_a_wrong_golden_output_is_found(folder: Path, tmp_path: Path) -> None:
    line = (folder / "controller.csv").read_text().splitlines()[801]
    *cells, demand, state, flags = line.split(",")
    wrong = ",".join([*cells, str(int(demand) + 1), state, flags])
    place = spoiled(folder, "controller.csv", f"\n{line}\n", f"\n{wrong}\n", tmp_path / "out")
    difference = verify(place, "cortex-m3", target_steps=10).results[1].difference
    assert difference is not None
    assert (difference.part, difference.step, difference.quantity) == ("vectors", 800, "demand")
    assert difference.expected == difference.found + 1


def test_golden_vectors_without_a_column_are_reported(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    place = spoiled(folder, "controller.csv", "dropped", "lost", tmp_path / "out")
    assert main(["verify", str(place), "--on", "cortex-m3"]) == 2
    message = capsys.readouterr().err
    assert says(message, "damaged-vectors")
    assert message.count("\n") == 1
