"""Test the compiled compensators on every target: same bits, and their cost."""

from __future__ import annotations

import pytest

from anhyst.verification import TargetResult, verify
from anhyst.verification.protocol import COMPENSATOR_RECORD
from anhyst.verification.result import Verification
from tests.verification.conftest import Compile

needs_avr = pytest.mark.needs("avr-gcc", "cc", "/usr/include/simavr/sim_avr.h")

KINDS = [("full", "q31"), ("cells", "q31"), ("simplified", "q15")]
PARTS = list(COMPENSATOR_RECORD.sections[1:])


def agrees(found: Verification) -> Verification:
    """Whether every build gave the same bits, without a warning."""
    assert found.passed, found.first_failure()
    assert [result.label for result in found.results if result.warnings] == []
    return found


def plausible(result: TargetResult) -> None:
    assert [cost.part for cost in result.costs] == PARTS
    for cost in result.costs:
        assert 0 < cost.least <= cost.mean <= cost.most, cost
        assert 0 <= cost.most_at < result.steps
    largest = {cost.part: cost.most for cost in result.costs}
    parts = largest["solve"] + largest["commit, other"] + largest["pidd2"]
    assert largest["solve"] < largest["tick"] <= max(parts, largest["solve"] + largest["commit, solved"]) * 2
    sizes = result.sizes
    assert sizes is not None
    assert sizes.code > 1000
    assert sizes.parameters >= 2 * 48
    assert sizes.variables == 0
    assert result.state_bytes <= 180
    assert result.stack_measured is not None
    assert 0 < result.stack_measured < 1024


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "io", "rounded", "worst"),
    [
        pytest.param("full", "q31", 2450, 3700, marks=pytest.mark.slow),
        ("cells", "q31", 3500, 4600),
        pytest.param("simplified", "q15", 1570, 1840, marks=pytest.mark.slow),
    ],
)
def test_cortex_m4_agrees_with_the_host_and_converter_rounding_costs_no_second_search(
    compiled: Compile, kind: str, io: str, rounded: int, worst: int
) -> None:
    """The limits are the instructions of the worst tick of this magnet plus 10 %."""
    found = agrees(verify(compiled(kind, io), "cortex-m4", target_steps=5_000))
    assert [result.build for result in found.results] == ["portable", "port header"]
    for result in found.results:
        plausible(result)
        assert result.steps == 5_000
        assert result.vectors >= 100
        assert result.stack_static is not None
        assert result.stack_static >= (result.stack_measured or 0)
    portable, port = found.results
    assert port.costs[0].most < portable.costs[0].most
    largest = {cost.part: cost.most for cost in port.costs}
    assert largest["tick, rounded"] < rounded
    assert largest["tick"] < worst


@pytest.mark.slow
def test_single_precision_is_bit_identical_with_and_without_a_floating_point_unit(compiled: Compile) -> None:
    found = agrees(verify(compiled("full", "f32"), "cortex-m4", target_steps=1_000))
    soft, hard = found.results
    assert (soft.build, hard.build) == ("soft float", "hard float")
    for result in found.results:
        plausible(result)
        assert result.stack_static is not None
        assert result.stack_static >= (result.stack_measured or 0)
    assert hard.costs[0].most < soft.costs[0].most / 4


@pytest.mark.slow
@pytest.mark.parametrize("target", ["cortex-m3", "cortex-m7"])
def test_the_other_cortex_m_do_too(compiled: Compile, target: str) -> None:
    for result in agrees(verify(compiled("full", "q31"), target, target_steps=2_000)).results:
        plausible(result)


@pytest.mark.slow
def test_a_dsc_is_estimated_from_two_lists_of_prices(compiled: Compile) -> None:
    found = agrees(verify(compiled("simplified", "q15"), "cortex-m0plus", target_steps=2_000))
    plausible(found.results[0])
    cycles = {(estimate.prices, estimate.part): estimate.cycles for estimate in found.estimates}
    instructions = found.results[0].cost("tick")
    assert instructions is not None
    for part in PARTS:
        assert 0 < cycles["at best", part] < cycles["cautious", part]
    for each in found.estimates:
        assert each.rate == pytest.approx(60e6 / each.cycles)


@pytest.mark.parametrize(
    "compiler",
    [
        pytest.param("gcc", marks=pytest.mark.needs("gcc")),
        pytest.param("clang", marks=[pytest.mark.needs("clang"), pytest.mark.slow]),
    ],
)
def test_host_builds_agree_under_sanitizers_too(
    compiled: Compile, compiler: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("anhyst.verification.targets.HOST_COMPILERS", {compiler: compiler})
    found = agrees(verify(compiled("full", "q31"), "host", host_steps=5_000))
    assert [result.build for result in found.results] == [
        *(f"{compiler} {level}" for level in ("-O0", "-O2", "-O3")),
        f"{compiler} sanitizers",
    ]
    assert {result.costs for result in found.results} == {()}


@pytest.mark.slow
@needs_avr
@pytest.mark.parametrize(
    ("kind", "io"), [pytest.param(*one, marks=[pytest.mark.slow] * (one[0] != "simplified")) for one in KINDS]
)
def test_avr_agrees_with_the_host_bit_for_bit(compiled: Compile, kind: str, io: str) -> None:
    (result,) = agrees(verify(compiled(kind, io), "avr", target_steps=300)).results
    plausible(result)
    assert result.unit == "cycles"


@pytest.mark.slow
@pytest.mark.needs("mspdebug")
def test_msp430_agrees_with_the_host_bit_for_bit(compiled: Compile) -> None:
    (result,) = agrees(verify(compiled("simplified", "q15"), "msp430", target_steps=300)).results
    plausible(result)
    assert result.unit == "cycles"
