"""Test the benchmark table: equal output in a pipe, and times that are comparable."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"


@pytest.fixture(scope="module")
def bench() -> Iterator[ModuleType]:
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(BENCHMARKS))
        import run

        yield run


def test_lines_are_whole_however_long_and_times_are_in_yardsticks_too(
    bench: ModuleType, capsys: pytest.CaptureFixture[str]
) -> None:
    machine = bench.Machine("a processor", 2, ("base", "avx2"), "avx2", "cc 1", "Linux", 20e-9)
    rows = [
        bench.Row("a long line " * 20, "<= 3 s | 1 s", "x" * 200, True, 40e-9),
        bench.Row("what is no time", "reported", "1.5 %", None),
    ]
    bench.print_table(rows, machine)
    message = capsys.readouterr().out.splitlines()
    *about, head, rule, first, second = message
    assert "avx2 of base, avx2" in about[0]
    assert "20.0 ns" in about[1]
    assert head.count("|") == rule.count("|") == second.count("|") == 6
    assert first.startswith(f"| {'a long line ' * 20} | <= 3 s \\| 1 s | {'x' * 200} | 2 | yes |")
    assert second == "| what is no time | reported | 1.5 % |  | - |"


def test_the_machine_is_described(bench: ModuleType) -> None:
    machine = bench.this_machine()
    assert machine.processor
    assert machine.level in machine.levels
    assert machine.compiler
    assert 0.1e-9 < machine.yardstick < 1e-6
