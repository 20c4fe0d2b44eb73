"""Seed faults into the C of one target: each must be found, at the right place."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from anhyst.cli.app import main
from anhyst.verification import TargetResult, verify
from anhyst.verification.bundle import read_bundle
from anhyst.verification.compare import BuildFolder
from anhyst.verification.protocol import COMPENSATOR_RECORD, RANDOM, START, Request
from anhyst.verification.targets import build_reference
from tests.refusals import says
from tests.verification.conftest import Compile, Seed

STEP = 7_013
SOLVE = "int32_t anhyst_compensator_solve_q31(anhyst_compensator *c, int32_t demand, int32_t gap)\n{\n"
SCALE = "  return high * b + ((low * b) >> 16);"
CLAMP = "  return a > high ? high : a;"
POWER = "    2,             /* 10 POWER"
CONDITIONING = "  return (entry)(low + (span * (number)ramp_ticks) / (number)ramp);"


def on_target(line: str, right: str, wrong: str) -> str:
    """Return a line with two versions: unchanged, and another for Cortex-M."""
    return f"#ifdef __thumb__\n{line.replace(right, wrong)}\n#else\n{line}\n#endif"


FAULTS = {
    "a product rounded up": (
        "include/anhyst/numeric/fixed.h",
        SCALE,
        on_target(SCALE, "low * b", "low * b + 0xFFFF"),
        "",
    ),
    "a clamp too high": (
        "include/anhyst/numeric/fixed.h",
        CLAMP,
        on_target(CLAMP, "? high", "? high - 1"),
        "",
    ),
    "a conditioning current off by one": (
        "src/compensator/generic/compensator.h",
        CONDITIONING,
        on_target(CONDITIONING, "/ (number)ramp", "/ (number)ramp + 1"),
        "start 0: hash of the conditioning sequence",
    ),
    "another parameter": (
        "magnet_parameters.c",
        POWER,
        "#ifdef __thumb__\n    1,\n#else\n    2,\n#endif\n/* 10 POWER",
        "start 0: status is -1, not 0",
    ),
}


def only(results: tuple[TargetResult, ...]) -> TargetResult:
    (result,) = results
    return result


@pytest.mark.slow
@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_on_the_target_is_found(with_fault: Seed, fault: str) -> None:
    name, right, wrong, expected = FAULTS[fault]
    folder = with_fault(name, right, wrong)
    found = verify(folder, "cortex-m3", target_steps=2_000)
    assert not found.passed
    assert expected in only(found.results).verdict()


def demand_at(folder: Path, step: int, scratch: Path) -> int:
    """Return the demand that the generator of the host gives at a step."""
    program = build_reference(BuildFolder.create(read_bundle(folder), scratch)).program
    reply = program.run([Request(START, seed=1), Request(RANDOM, steps=step + 1, first_window_step=step)])[-1]
    word = int(reply.window[0, COMPENSATOR_RECORD.record.index("demand")])
    return word - (1 << 32) if word >> 31 else word


@pytest.mark.slow
def test_a_fault_of_a_single_step_is_found_in_that_step(
    compiled: Compile, with_fault: Seed, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    demand = demand_at(compiled("full", "q31"), STEP, tmp_path / "scratch")
    wrong = f"{SOLVE}#ifdef __thumb__\n  gap ^= demand == {demand} ? 1 << 29 : 0;\n#endif\n"
    folder = with_fault("src/compensator/compensator.c", SOLVE, wrong)
    assert main(["verify", str(folder), "--on", "cortex-m3", "--json"]) == 1
    message = capsys.readouterr()
    assert message.err.count("\n") == 1
    assert says(message.err, f"target-failed: random step {STEP}:")
    kept = json.loads((folder / "verify.json").read_text(encoding="utf-8"))
    assert kept == json.loads(message.out)
    assert kept["passed"] is False
    difference = kept["results"][0]["difference"]
    assert (difference["part"], difference["step"]) == ("random", STEP)
    assert difference["quantity"] in {"current", "flags", "flux"}
    assert difference["expected"] != difference["found"]
    assert str(STEP) in (folder / "verify.md").read_text(encoding="utf-8")


@pytest.mark.slow
def test_an_unrepeatable_fault_is_reported_as_such(with_fault: Seed) -> None:
    twist = "  static int32_t calls;\n  demand ^= ++calls == 1500 ? 1 << 29 : 0;"
    wrong = f"{SOLVE}#ifdef __thumb__\n{twist}\n#endif\n"
    folder = with_fault("src/compensator/compensator.c", SOLVE, wrong)
    result = only(verify(folder, "cortex-m3", target_steps=1_000).results)
    assert "not repeatable" in result.verdict()


@pytest.mark.slow
def test_a_golden_vector_that_is_not_met_is_found(with_fault: Seed) -> None:
    folder = with_fault("vectors.csv", "demand,gap,applied,current\n", VECTOR_BEFORE)
    result = only(verify(folder, "cortex-m3", target_steps=100).results)
    assert result.difference is not None
    assert (result.difference.part, result.difference.step) == ("vectors", 0)
    assert result.difference.quantity == "current"
    assert result.difference.expected == 123_456_789


VECTOR_BEFORE = "demand,gap,applied,current\n0,0,0,123456789\n"


@pytest.mark.slow
def test_an_access_to_nowhere_is_reported(with_fault: Seed) -> None:
    wrong = f"{SOLVE}#ifdef __thumb__\n  *(volatile int32_t *)0x40000000 = demand;\n#endif\n"
    result = only(verify(with_fault("src/compensator/compensator.c", SOLVE, wrong), "cortex-m3").results)
    assert "target cortex-m3: " in result.failure
    assert "UNMAPPED" in result.failure


@pytest.mark.slow
def test_a_program_that_does_not_end_is_stopped_and_reported(
    with_fault: Seed, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("anhyst.verification.emulators.TIME_LIMIT_S", 0.5)
    wrong = f"{SOLVE}#ifdef __thumb__\n  for (volatile int on = 1; on;) {{\n  }}\n#endif\n"
    folder = with_fault("src/compensator/compensator.c", SOLVE, wrong)
    result = only(verify(folder, "cortex-m3", target_steps=100).results)
    assert "did not end within" in result.failure


@pytest.mark.slow
@pytest.mark.needs("gcc")
def test_undefined_behaviour_is_found_by_the_sanitizers_alone(
    with_fault: Seed, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("anhyst.verification.targets.HOST_COMPILERS", {"gcc": "gcc"})
    wrong = f"{SOLVE}  volatile int32_t most = 2147483647;\n  most = most + 1;\n"
    found = verify(with_fault("src/compensator/compensator.c", SOLVE, wrong), "host", host_steps=1_000)
    assert [result.passed for result in found.results] == [True, True, True, False]
    assert "signed integer overflow" in found.first_failure()


@pytest.mark.slow
def test_c_that_does_not_compile_is_reported(with_fault: Seed) -> None:
    folder = with_fault(
        "src/compensator/compensator.c", SOLVE, f"{SOLVE}#ifdef __thumb__\n#error no\n#endif\n"
    )
    failure = only(verify(folder, "cortex-m3", target_steps=10).results).failure
    assert says(failure, "does-not-compile cortex-m3: error")
