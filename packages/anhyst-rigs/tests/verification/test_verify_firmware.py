"""Test a whole firmware as a target of ``anhyst verify``."""

from __future__ import annotations

from pathlib import Path

import pytest

from anhyst.compensate.plan import CompileRequest
from anhyst.compilation.output import compile_model
from anhyst.verification.verify import verify
from anhyst_rigs.link.verification import FirmwareRun, compare_runs
from tests.truths import path_of


@pytest.mark.slow
@pytest.mark.needs("qemu-system-arm")
def test_the_whole_firmware_agrees_with_the_host(tmp_path: Path) -> None:
    model = path_of("electromagnet-effective-field-scaling")
    request = CompileRequest("full", "q31", 10_000.0, name="magnet")
    folder = compile_model(model, tmp_path / "controller", request).out
    found = verify(folder, "cortex-m3-qemu", target_steps=300)
    assert found.passed, found.first_failure()
    (result,) = found.results
    assert (result.build, result.steps, result.warnings) == ("firmware", 300, 0)


def test_a_firmware_that_drives_another_current_is_found() -> None:
    answer = {"tick": 1, "drive": 5}
    right = FirmwareRun([1, 2, 3], [answer])
    assert compare_runs(right, right) is None
    wrong = compare_runs(right, FirmwareRun([1, 2, 4], [answer]))
    assert wrong is not None
    assert wrong.text() == "tick 2: drive is 4, not 3"
    wrong = compare_runs(right, FirmwareRun([1, 2, 3], [{"tick": 1, "drive": 6}]))
    assert wrong is not None
    assert wrong.text() == "answer to demand 0: drive is 6, not 5"
