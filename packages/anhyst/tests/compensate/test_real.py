"""Test the compensator in floating point against the model and against fixed point."""

from __future__ import annotations

import shutil
import subprocess
from dataclasses import replace
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from anhyst._core import Compensator, CompensatorF32
from anhyst.compensate.block import Block, DemandLimits, TableSizes, make_real_core
from anhyst.compensate.force_controller import FixedTwin, RealTwin
from anhyst.compilation.parameters import define_parameters, float_literal
from anhyst.compilation.toolchain import KIND_SOURCES_F32
from anhyst.model.actuator import least_slope
from anhyst.model.parameters import GapMap
from anhyst.support.atomic import core_folder
from anhyst.support.block_layout import WORD_INDEX
from anhyst.support.block_words import Scales, SignalUnits
from anhyst.support.numeric import FloatArray
from tests.actuators import (
    CURRENTS,
    GAPS,
    WIDE,
    RealKind,
    RealSignalFormat,
    closed_form,
    compiled,
    largest_force,
    magnet,
    nested,
    ranges,
    real_block,
    reversals,
    ring,
)
from tests.compensate.test_block import sealed

KINDS: tuple[RealKind, ...] = ("full", "simplified")
IOS: tuple[RealSignalFormat, ...] = ("f32", "f64")
FINE = TableSizes(
    gap_segments=6,
    curve_segments=11,
    inverse_segments=9,
    iterations=8,
    octaves=14,
    octave_segments=6,
    root_knee=8,
)
SAME = TableSizes(iterations=8)
DEMAND_LIMITED, CURRENT_LIMITED, FLUX_LIMITED = 1, 2, 4
HIGH = largest_force("reluctance", 0.0, GAPS[-1])


@cache
def real(
    kind: RealKind,
    gap_map: GapMap = "reluctance",
    play: float = 0.0,
    sizes: TableSizes = FINE,
    io: RealSignalFormat = "f32",
) -> Block:
    scales, limits = ranges(gap_map, play)
    law = closed_form(gap_map) if kind == "simplified" else None
    return real_block(io, magnet(gap_map, play), kind, scales, limits, sizes, law=law)


def demanding(high: float) -> FloatArray:
    """Return nested loops, random reversals, and full-range jumps in one sample."""
    jumps = np.tile([0.95 * high, 0.04 * high], 50)
    return np.concatenate([nested(high, 60), reversals(0.04 * high, 0.95 * high, 60, 3), jumps])


def moving(samples: int) -> FloatArray:
    middle, half = (GAPS[0] + GAPS[-1]) / 2.0, (GAPS[-1] - GAPS[0]) / 2.0
    return np.asarray(middle + half * np.sin(0.037 * np.arange(samples)))


@pytest.mark.parametrize("io", IOS)
@pytest.mark.parametrize("play", [0.0, 40.0])
@pytest.mark.parametrize("gap_map", ["scaling", "reluctance", "circuit"])
def test_full_with_fine_tables_gives_the_demanded_force(
    gap_map: GapMap, play: float, io: RealSignalFormat
) -> None:
    demand = demanding(largest_force(gap_map, play, GAPS[-1]))
    gap = moving(demand.size)
    drive = RealTwin(real("full", gap_map, play, io=io)).run(demand, gap)
    force = magnet(gap_map, play).predict(drive, gap, history="demagnetised").output
    # Where the current hardly changes with the flux, its errors have a larger effect.
    flattest = min(1.0, float(least_slope(magnet(gap_map, play), np.array(GAPS)).min()))
    largest = 2e-5 / flattest * largest_force(gap_map, play, GAPS[0])
    assert np.abs(force - demand).max() < largest


@pytest.mark.parametrize("play", [0.0, 4.0])
def test_full_gives_the_demanded_flux_of_either_sign(play: float) -> None:
    model = ring(play)
    top = float(model.predict([0.0, 150.0], history="demagnetised").output[-1])
    limits = DemandLimits((-top, top), (-150.0, 150.0))
    block = real_block("f32", model, "full", Scales(1.1 * top, 160.0, 0.0, 0.0), limits, FINE)
    demand = np.concatenate(
        [reversals(-0.95 * top, 0.95 * top, 100, 7), np.tile([0.95 * top, -0.95 * top], 50)]
    )
    flux_density = model.predict(RealTwin(block).run(demand), history="demagnetised").output
    assert np.abs(flux_density - demand).max() < 1e-4 * top


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("gap_map", ["scaling", "reluctance"])
def test_fixed_point_with_the_same_tables_differs_by_its_rounding(kind: RealKind, gap_map: GapMap) -> None:
    """The force differs by the 16-bit words of tables and coefficients, and by the last digits of
    root and field."""
    demand = demanding(largest_force(gap_map, 0.0, GAPS[-1]))
    gap = moving(demand.size)
    exact = RealTwin(real(kind, gap_map, 0.0, SAME, "f64")).run(demand, gap)
    fixed = FixedTwin(compiled(kind, gap_map, 0.0, SAME)).run(demand, gap)
    model = magnet(gap_map)
    forces = [model.predict(i, gap, history="demagnetised").output for i in (exact, fixed)]
    apart = np.abs(forces[0] - forces[1]).max() / largest_force(gap_map, 0.0, GAPS[0])
    assert 1e-6 < apart < 5e-4


@pytest.mark.parametrize("kind", KINDS)
def test_single_precision_follows_double(kind: RealKind) -> None:
    demand = demanding(HIGH)
    gap = moving(demand.size)
    single, double = (RealTwin(real(kind, io=io)).run(demand, gap) for io in IOS)
    assert 0.0 < np.abs(single - double).max() < 2e-5 * CURRENTS[1]


@pytest.mark.parametrize("kind", KINDS)
def test_rounding_does_not_add_up_over_a_slow_demand(kind: RealKind) -> None:
    """A ramp of 100,000 ticks, in steps of a few ulp of a float."""
    levels = np.array([0.1, 0.9, 0.3, 0.7]) * HIGH
    demand = np.concatenate([np.linspace(a, b, 100_000) for a, b in pairwise(levels)])
    slow = RealTwin(real(kind)).run(demand, WIDE)
    quick = RealTwin(real(kind, io="f64")).run(demand[::1000], WIDE)
    assert np.abs(slow[::1000] - quick).max() < 3e-5 * CURRENTS[1]


@pytest.mark.parametrize("io", IOS)
@pytest.mark.parametrize("play", [0.0, 40.0])
@pytest.mark.parametrize("kind", KINDS)
def test_a_constant_demand_keeps_the_memory(kind: RealKind, play: float, io: RealSignalFormat) -> None:
    twin = RealTwin(real(kind, "reluctance", play if kind == "full" else 0.0, io=io))
    for level in np.random.default_rng(1).uniform(0.05, 0.95, 20).tolist():
        twin.run([level * HIGH] * 4, WIDE)
        rest = twin.memory
        current = twin.run([level * HIGH] * 500, WIDE)
        assert np.array_equal(twin.memory, rest)
        assert np.ptp(current) == 0.0


@pytest.mark.parametrize("kind", KINDS)
def test_solving_touches_no_memory_and_may_be_repeated(kind: RealKind) -> None:
    plain, curious = RealTwin(real(kind)), RealTwin(real(kind))
    demand = demanding(HIGH)[::3]
    for wanted, gap in zip(demand.tolist(), moving(demand.size).tolist(), strict=True):
        before = curious.memory
        for other in (0.0, 0.9 * HIGH, 0.3 * wanted):
            curious.solve(other, GAPS[0])
        current = curious.solve(wanted, gap)
        assert current == plain.solve(wanted, gap)
        assert np.array_equal(curious.memory, before)
        assert curious.commit(current, gap) == plain.commit(current, gap)
        assert np.array_equal(curious.memory, plain.memory)


@pytest.mark.parametrize("io", IOS)
@pytest.mark.parametrize("kind", KINDS)
def test_the_shortcut_of_a_commit_agrees_with_finding_the_flux_from_the_current(
    kind: RealKind, io: RealSignalFormat
) -> None:
    """Any other demand in between prevents the shortcut."""
    quick, long = (RealTwin(real(kind, io=io)) for _ in range(2))
    demand = demanding(HIGH)
    worst = 0.0
    for wanted in demand.tolist():
        current = quick.solve(wanted, WIDE)
        long.solve(0.5 * wanted + 1.0, WIDE)
        worst = max(worst, abs(quick.commit(current, WIDE) - long.commit(current, WIDE)))
        assert quick.output == pytest.approx(wanted, abs=1e-5 * HIGH)
    assert 0.0 < worst < 2e-5 * HIGH


def test_expected_force_is_that_of_the_current_a_slow_amplifier_gave() -> None:
    demand = demanding(HIGH)
    gap = moving(demand.size)
    twin = RealTwin(real("full"))
    applied, expected = np.empty(demand.size), np.empty(demand.size)
    current = 0.0
    for i, (wanted, at) in enumerate(zip(demand.tolist(), gap.tolist(), strict=True)):
        current += 0.4 * (twin.solve(wanted, at) - current)
        applied[i], expected[i] = current, twin.commit(current, at)
    force = magnet().predict(applied, gap, history="demagnetised").output
    assert np.abs(expected - demand).max() > 0.1 * HIGH
    assert np.abs(expected - force).max() < 2e-5 * largest_force("reluctance", 0.0, GAPS[0])


@pytest.mark.parametrize("kind", KINDS)
def test_limits_are_kept_and_reported(kind: RealKind) -> None:
    scales, limits = ranges("reluctance")
    low = DemandLimits(limits.demand, (CURRENTS[0], 0.8))
    law = closed_form("reluctance") if kind == "simplified" else None
    twin = RealTwin(real_block("f32", magnet(), kind, scales, low, FINE, law=law))
    demand_high = limits.demand[1]
    twin.run([0.3 * HIGH], WIDE)
    assert twin.flags == 0
    top = twin.solve(demand_high, GAPS[-1])
    assert twin.flags & CURRENT_LIMITED
    assert top == pytest.approx(0.8)
    assert twin.commit(top, GAPS[-1]) < 0.99 * demand_high
    assert twin.solve(2.0 * demand_high, WIDE) == twin.solve(demand_high, WIDE)
    assert twin.solve(-1.0, WIDE) == twin.solve(0.0, WIDE)
    assert twin.flags & DEMAND_LIMITED
    assert twin.solve(0.3 * HIGH, 1.0) == twin.solve(0.3 * HIGH, GAPS[-1])
    assert twin.solve(0.3 * HIGH, -1.0) == twin.solve(0.3 * HIGH, GAPS[0])


def test_more_flux_than_saturation_is_limited_and_reported() -> None:
    model, scales = magnet(), replace(ranges("reluctance")[0], demand=500.0)
    block = real_block("f32", model, "full", scales, DemandLimits((0.0, 400.0), CURRENTS))
    twin = RealTwin(block)
    twin.solve(400.0, WIDE)
    assert twin.flags & FLUX_LIMITED


@pytest.mark.parametrize("kind", KINDS)
def test_nan_inputs_do_no_harm(kind: RealKind) -> None:
    twin = RealTwin(real(kind))
    twin.run(nested(HIGH, 40), WIDE)
    rest, nan = twin.memory, float("nan")
    assert twin.solve(nan, WIDE) == twin.solve(0.0, WIDE)
    assert twin.solve(0.5 * HIGH, nan) == twin.solve(0.5 * HIGH, GAPS[0])
    for current in (nan, float("inf"), -float("inf")):
        twin.commit(current, WIDE)
        assert np.array_equal(twin.memory, rest)
    assert twin.commit(0.5, nan) == pytest.approx(twin.output)
    assert np.isfinite(twin.memory).all()


def test_swapped_parameters_continue_from_the_state_of_the_iron() -> None:
    one, other = (real("full", sizes=sizes, io="f64") for sizes in (FINE, SAME))
    twin = RealTwin(one)
    up = np.linspace(0.1, 0.8, 50) * HIGH
    twin.run(up, WIDE)
    before = twin.output
    twin._core.swap(other.words)
    assert twin.output == pytest.approx(before, rel=1e-12)
    goal = 0.85 * HIGH
    assert twin.solve(goal, WIDE) == pytest.approx(RealTwin(one).run([*up, goal], WIDE)[-1], rel=3e-3)
    with pytest.raises(ValueError, match="not valid"):
        twin._core.swap(real("simplified", io="f64").words)


def takes(block: Block, words: FloatArray) -> bool:
    try:
        Compensator(block.kind, sealed(words))
    except ValueError:
        return False
    return True


NUMBERS = [
    *(("DEMAND_LOW", value) for value in (0.96, np.nan, -1.5)),
    *(("CURRENT_HIGH", value) for value in (np.nan, 1.001, np.inf, -0.9)),
    *(("SCALE_DEMAND", value) for value in (0.0, -1.0, np.nan, np.inf)),
    *(("SCALE_GAP_HIGH", value) for value in (0.0, np.nan, np.inf)),
    *(("ROOT_KNEE", value) for value in (1.0, 9.0, 4.5, np.nan)),
    *(("FLUX_LIMIT", value) for value in (0.0, 1.1, np.nan)),
    *(("POWER", value) for value in (3.0, 1.5, np.nan)),
    *(("CONDITION_TICKS", value) for value in (1.0, 32768.0, 2.5, np.nan)),
    *(("GAP_SEGMENTS", value) for value in (-1.0, 7.0, 1e30, np.nan)),
    *(("GAP_GAIN", value) for value in (0.0, 63.0, 64.5, 1e30, np.inf, np.nan)),
    *(("LENGTH", value) for value in (63.0, 64.5, 1e30, np.inf, np.nan)),
    *(("FULL_ITERATIONS", value) for value in (1.0, 17.0, np.nan)),
    *(("FULL_REVERSIBLE", value) for value in (1.5, -0.1, np.nan)),
    *(("FULL_RATE", value) for value in (-1.0, 0.0, np.inf, np.nan)),
    *(("UNIT_FIELD", value) for value in (0.0, np.inf, np.nan)),
]


@pytest.mark.parametrize(("name", "value"), NUMBERS)
def test_block_with_unsound_number_is_refused(name: str, value: float) -> None:
    block = real("full", sizes=SAME, io="f64")
    assert takes(block, block.words)
    words: FloatArray = block.words.copy()
    words[WORD_INDEX[name]] = value
    assert not takes(block, words)


@pytest.mark.parametrize("kind", KINDS)
def test_a_current_that_would_fall_is_refused(kind: RealKind) -> None:
    block = real(kind, sizes=SAME, io="f64")
    (first, entries), field_arm = block.tables["GAP_FLUX_ARM"], block.table("GAP_FIELD_ARM")
    flux_arm = 0.0
    if kind == "full":  # as low as the largest slope of the flux over the field allows
        share = block.word_value("FULL_REVERSIBLE")
        reversible = np.diff(block.table("FULL_CURVE"))
        pinned = np.diff(block.table("FULL_BRANCH"))[reversible.size :]
        steepest = (share * reversible + (1.0 - share) * pinned).max() * reversible.size
        flux_arm = -field_arm[-1] / (4.0 * block.word_value("FULL_AIR") + steepest)
    for part, is_taken in ((0.97, True), (1.03, kind == "simplified")):
        words: FloatArray = block.words.copy()
        words[first + entries - 1] = part * flux_arm
        assert takes(block, words) == is_taken, part
    words = block.words.copy()
    words[first + entries - 1] = -field_arm[-1]
    assert not takes(block, words)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf, 1e30])
def test_tables_that_fall_or_hold_no_numbers_are_refused(kind: RealKind, wrong: float) -> None:
    block = real(kind, sizes=SAME, io="f64")
    for name, (first, entries) in block.tables.items():
        for place in (first, first + 3, first + entries - 1):
            words: FloatArray = block.words.copy()
            words[place] = wrong
            assert not takes(block, words), (name, place)
        if not name.startswith("GAP"):
            words = block.words.copy()
            words[first + 3] = words[first + 5]
            assert not takes(block, words), name


@pytest.mark.parametrize("kind", KINDS)
def test_every_single_flipped_bit_of_a_block_in_single_precision_is_refused(kind: RealKind) -> None:
    few = TableSizes(gap_segments=0, curve_segments=3, inverse_segments=3, octaves=6, octave_segments=2)
    block = real(kind, sizes=few)
    make_real_core(block)
    for at in range(block.words.size):
        for bit in range(32):
            words = block.words.copy()
            words.view(np.uint32)[at] ^= np.uint32(1 << bit)
            with pytest.raises(ValueError, match="not valid"):
                CompensatorF32(kind, words)


@pytest.mark.parametrize("kind", KINDS)
def test_conditioning_makes_the_start_known(kind: RealKind) -> None:
    known, strange = RealTwin(real(kind)), RealTwin(real(kind))
    memory = {"full": [-0.3, -0.6, -0.3, -0.3, -0.6], "simplified": [0.4, -0.8, 0.4, 0.4, 0.0]}
    strange.set_memory(memory[kind])
    currents = known.run_start_up(WIDE)
    assert np.array_equal(strange.run_start_up(WIDE), currents)
    assert (currents.min(), currents.max()) == pytest.approx(CURRENTS)
    goal = 0.4 * HIGH
    assert strange.solve(goal, WIDE) == pytest.approx(known.solve(goal, WIDE), abs=2e-3)


def test_a_memory_must_be_one() -> None:
    twin = RealTwin(real("full"))
    with pytest.raises(ValueError, match="five numbers"):
        twin.set_memory([0.0, 0.0])
    with pytest.raises(ValueError, match=r"-1\.\.1"):
        twin.set_memory([0.0, 1.5, 0.0, 0.0, 0.0])


PROGRAM = """
#include <stdio.h>
#include <string.h>
int main(void)
{
  static anhyst_compensator_f32 c;
  float demand, gap;
  if (anhyst_compensator_init_f32(&c, &KERNEL, magnet_parameters, WORDS) != ANHYST_OK) {
    return 1;
  }
  while (scanf("%f %f", &demand, &gap) == 2) {
    const float current = anhyst_compensator_solve_f32(&c, demand, gap);
    unsigned bits;
    memcpy(&bits, &current, sizeof bits);
    printf("%08x\\n", bits);
    anhyst_compensator_commit_f32(&c, current, gap);
  }
  return 0;
}
"""


@pytest.mark.first(3)
@pytest.mark.parametrize("level", ["-O0", "-O3"])
@pytest.mark.parametrize("kind", KINDS)
def test_the_generated_c_gives_the_same_bits(kind: RealKind, level: str, tmp_path: Path) -> None:
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        pytest.skip("gcc is not installed")
    block = real(kind, sizes=TableSizes())
    core = core_folder()
    parameters = define_parameters("magnet", "WORDS", block, SignalUnits("N", "A"), magnet().schedule)
    source, program = tmp_path / "all.c", tmp_path / "all"
    head = (
        '#include "anhyst/compensator/compensator_f32.h"\n'
        f"#define KERNEL anhyst_kernel_{kind}_f32\n#define WORDS {block.words.size}\n"
    )
    source.write_text(head + parameters + PROGRAM, encoding="utf-8")
    sources = [str(source), *(f"{core}/src/{name}" for name in KIND_SOURCES_F32[kind])]
    strict = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror"]
    options = [*strict, level, "-ffp-contract=off", f"-I{core}/include"]
    command = [compiler, *options, *sources, "-o", str(program)]
    subprocess.run(command, check=True)
    demand = demanding(HIGH)
    gap = moving(demand.size)
    rows = "\n".join(
        f"{float_literal(d)[:-1]} {float_literal(g)[:-1]}" for d, g in zip(demand, gap, strict=True)
    )
    completed = subprocess.run([str(program)], input=rows, capture_output=True, text=True, check=True)
    found = np.array([int(line, 16) for line in completed.stdout.split()], dtype=np.uint32)
    expected = RealTwin(block).run(demand, gap).astype(np.float32).view(np.uint32)
    assert np.array_equal(found, expected)
