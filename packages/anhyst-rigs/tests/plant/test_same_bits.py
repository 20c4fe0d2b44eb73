"""Check that runs of the plant are bit-identical for all compilers and processors."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from tests.core.test_c_core import tool
from tests.plant.test_sanitized import sources

pytestmark = pytest.mark.depends("core", "plant", "tests/core", "packages/anhyst-rigs/tests/plant")

FLAGS = ("-O0", "-O2", "-O3", "-O3 -march=native")
"""Compiler options; processors may fuse products into sums unless this is disabled."""

RUNS = (
    "ok cells, 1 magnets, voltage, c3964ec9365790fa",
    "ok cells, 1 magnets, current, 245d0e78a3bdf201",
    "ok law, 1 magnets, voltage, 1be65399f2823a09",
    "ok law, 1 magnets, current, 0e4044597ad02e97",
    "ok preisach, 1 magnets, voltage, 01d89dbf66f25de1",
    "ok preisach, 1 magnets, current, 5e6028b8e8be1ef9",
    "ok duhem, 1 magnets, voltage, f9dbb93c7152b84b",
    "ok duhem, 1 magnets, current, 8484f57d7cec83e0",
    "ok solid, 1 magnets, voltage, 3c855433693fad01",
    "ok solid, 1 magnets, current, 034ec79ea96fd9c7",
    "ok cone, 1 magnets, voltage, 2ef0d94579e34d41",
    "ok cone, 1 magnets, current, 592b057490ce960a",
    "ok cells, held, f8d779d51bf5da71",
    "ok cells, 2 magnets, voltage, bcdb025991aa9da5",
    "ok cells, six axes, voltage, e2aaa0b0dc1ab9e6",
    "ok cells, 2 magnets, current, d1f619427449ea73",
    "ok cells, six axes, current, 76c789ef7b8f524b",
    "ok law, 2 magnets, voltage, 48293fb37b4a0226",
    "ok law, six axes, voltage, bc6402720961f835",
    "ok law, 2 magnets, current, 1a4eb3f55b1742f4",
    "ok law, six axes, current, 40cba574d3346f3a",
    "ok preisach, held, 5b9888b0b174d058",
    "ok preisach, 2 magnets, voltage, 10bea9bd94dbf44b",
    "ok preisach, six axes, voltage, b28bf954dafa6205",
    "ok preisach, 2 magnets, current, 332a8b2aaea5ed36",
    "ok preisach, six axes, current, 1dede93184529d99",
    "ok duhem, held, 5ba82fa441251346",
    "ok duhem, 2 magnets, voltage, fb1120ff45082fb3",
    "ok duhem, six axes, voltage, 73a26238cc93d8d6",
    "ok duhem, 2 magnets, current, d0351f4be57fe706",
    "ok duhem, six axes, current, 2929ba48e373545c",
    "ok solid, held, e999a6f170cd8c6b",
    "ok solid, 2 magnets, voltage, 8b998a7118ba76d3",
    "ok solid, six axes, voltage, b5d1b5365f8c109a",
    "ok solid, 2 magnets, current, f5c2b520ccb64b94",
    "ok solid, six axes, current, 9c9b84efd99bdef5",
    "ok cone, held, b658b6f4ac4fe739",
    "ok cone, 2 magnets, voltage, eb0a8ae89059f08c",
    "ok cone, six axes, voltage, 262b88e45cab1463",
    "ok cone, 2 magnets, current, b53be9103771ccfc",
    "ok cone, six axes, current, 473610ab66af2844",
)
"""Output of every build on every processor."""


def built(compiler: str, flags: str, folder: Path) -> Path:
    """Compile core, plant and runs without fused multiply-add."""
    program = folder / "runs"
    command = [
        *compiler.split(),
        "-std=c99",
        *flags.split(),
        "-ffp-contract=off",
        *sources(),
        "-lm",
        "-o",
        str(program),
    ]
    completed = subprocess.run(command, capture_output=True, text=True, check=False)
    assert completed.returncode == 0, completed.stderr
    return program


def runs_of(*command: object) -> tuple[str, ...]:
    completed = subprocess.run(
        list(map(str, command)), capture_output=True, text=True, check=True, timeout=600
    )
    return tuple(completed.stdout.splitlines())


@pytest.mark.first(1)
@pytest.mark.parametrize("flags", FLAGS)
@pytest.mark.parametrize("compiler", ["gcc", "clang"])
def test_compilers_and_their_flags_do_not_change_a_bit(compiler: str, flags: str, tmp_path: Path) -> None:
    assert runs_of(built(tool(compiler), flags, tmp_path)) == RUNS


@pytest.mark.slow
def test_another_processor_does_not_change_a_bit(tmp_path: Path) -> None:
    emulator = tool("qemu-aarch64", "qemu-aarch64-static")
    program = built(f"{tool('python-zig')} cc -target aarch64-linux-musl", "-O2", tmp_path)
    assert runs_of(emulator, program) == RUNS
