"""The compensator in floating point: against the model, the fixed-point one, and itself."""

from __future__ import annotations

import shutil
import subprocess
from functools import cache
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from anhyst.compensate.floating import COLUMNS, RealBlock, RealIo, RealKind, build_real

from anhyst._core import Compensator, Parameters
from anhyst.compensate.block import DemandLimits, TableSizes
from anhyst.compensate.force_controller import FixedTwin, RealTwin
from anhyst.compilation.parameters import c_parameters, literal
from anhyst.compilation.toolchain import SINGLE
from anhyst.model.actuator import least_slope
from anhyst.model.parameters import GapMap
from anhyst.support.atomic import core_folder
from anhyst.support.block_words import Names, Scales
from anhyst.support.numeric import FloatArray
from tests.actuators import (
    CURRENTS,
    GAPS,
    WIDE,
    closed_form,
    compiled,
    largest_force,
    magnet,
    nested,
    ranges,
    reversals,
    ring,
)

KINDS: tuple[RealKind, ...] = ("full", "simplified")
IOS: tuple[RealIo, ...] = ("f32", "f64")
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
) -> RealBlock:
    scales, limits = ranges(gap_map, play)
    law = closed_form(gap_map) if kind == "simplified" else None
    return build_real(magnet(gap_map, play), kind, scales, limits, sizes, law=law)


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
    gap_map: GapMap, play: float, io: RealIo
) -> None:
    demand = demanding(largest_force(gap_map, play, GAPS[-1]))
    gap = moving(demand.size)
    drive = RealTwin(real("full", gap_map, play), io).run(demand, gap)
    force = magnet(gap_map, play).predict(drive, gap, history="demagnetised").output
    # Where the current all but stands still as the flux rises, any error of it counts for more.
    flattest = min(1.0, float(least_slope(magnet(gap_map, play), np.array(GAPS)).min()))
    most = 2e-5 / flattest * largest_force(gap_map, play, GAPS[0])
    assert np.abs(force - demand).max() < most


@pytest.mark.parametrize("play", [0.0, 4.0])
def test_full_gives_the_demanded_flux_of_either_sign(play: float) -> None:
    model = ring(play)
    top = float(model.predict([0.0, 150.0], history="demagnetised").output[-1])
    limits = DemandLimits((-top, top), (-150.0, 150.0))
    block = build_real(model, "full", Scales(1.1 * top, 160.0, 0.0, 0.0), limits, FINE)
    demand = np.concatenate(
        [reversals(-0.95 * top, 0.95 * top, 100, 7), np.tile([0.95 * top, -0.95 * top], 50)]
    )
    flux_density = model.predict(RealTwin(block).run(demand), history="demagnetised").output
    assert np.abs(flux_density - demand).max() < 1e-4 * top


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("gap_map", ["scaling", "reluctance"])
def test_fixed_point_with_the_same_tables_differs_by_its_rounding(
    kind: RealKind, gap_map: GapMap
) -> None:
    """In force: words of 16 bits in tables and arms, and the root's and field's last places."""
    demand = demanding(largest_force(gap_map, 0.0, GAPS[-1]))
    gap = moving(demand.size)
    exact = RealTwin(real(kind, gap_map, 0.0, SAME), "f64").run(demand, gap)
    fixed = FixedTwin(compiled(kind, gap_map, 0.0, SAME)).run(demand, gap)
    model = magnet(gap_map)
    forces = [model.predict(i, gap, history="demagnetised").output for i in (exact, fixed)]
    apart = np.abs(forces[0] - forces[1]).max() / largest_force(gap_map, 0.0, GAPS[0])
    assert 1e-6 < apart < 5e-4


@pytest.mark.parametrize("kind", KINDS)
def test_single_precision_follows_double(kind: RealKind) -> None:
    demand = demanding(HIGH)
    gap = moving(demand.size)
    single, double = (RealTwin(real(kind), io).run(demand, gap) for io in IOS)
    assert 0.0 < np.abs(single - double).max() < 5e-6 * CURRENTS[1]


@pytest.mark.parametrize("kind", KINDS)
def test_rounding_does_not_add_up_over_a_slow_demand(kind: RealKind) -> None:
    """A ramp of 100000 ticks, in steps of a few units in the last place of a float."""
    levels = np.array([0.1, 0.9, 0.3, 0.7]) * HIGH
    demand = np.concatenate([np.linspace(a, b, 100_000) for a, b in pairwise(levels)])
    slow = RealTwin(real(kind), "f32").run(demand, WIDE)
    quick = RealTwin(real(kind), "f64").run(demand[::1000], WIDE)
    assert np.abs(slow[::1000] - quick).max() < 3e-5 * CURRENTS[1]


@pytest.mark.parametrize("io", IOS)
@pytest.mark.parametrize("play", [0.0, 40.0])
@pytest.mark.parametrize("kind", KINDS)
def test_a_standing_demand_leaves_the_memory_alone(kind: RealKind, play: float, io: RealIo) -> None:
    twin = RealTwin(real(kind, "reluctance", play if kind == "full" else 0.0), io)
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
    kind: RealKind, io: RealIo
) -> None:
    """Any other demand in between forbids the shortcut."""
    quick, long = (RealTwin(real(kind), io) for _ in range(2))
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
    twin = RealTwin(build_real(magnet(), kind, scales, low, FINE, law=law))
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
    model, (scales, _) = magnet(), ranges("reluctance")
    block = build_real(model, "full", scales, DemandLimits((0.0, 400.0), CURRENTS))
    twin = RealTwin(block)
    twin.solve(400.0, WIDE)
    assert twin.flags & FLUX_LIMITED


@pytest.mark.parametrize("kind", KINDS)
def test_what_is_no_number_does_no_harm(kind: RealKind) -> None:
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


def test_other_parameters_go_on_from_where_the_iron_is() -> None:
    one, other = real("full"), real("full", sizes=SAME)
    core = Compensator(one.double)
    up = np.linspace(0.1, 0.8, 50) * HIGH
    core.run(up, np.full(50, WIDE))
    before = core.memory
    core.swap(other.double)
    x, y, p, turn, level = core.memory.tolist()
    assert (x, y, p) == tuple(before[:3])
    assert (turn, level) == (p, y)
    goal = 0.85 * HIGH
    assert core.solve(goal, WIDE) == pytest.approx(
        RealTwin(one, "f64").run([*up, goal], WIDE)[-1], rel=3e-3
    )
    with pytest.raises(ValueError, match="another kind"):
        core.swap(real("simplified").double)


@pytest.mark.parametrize(
    "change",
    [
        {"demand_low": 1e9},
        {"current_high": float("nan")},
        {"full_scale": 0.0},
        {"knee": 0.5},
        {"flux_limit": 2e6},
        {"power": 3},
        {"condition_ticks": 1},
        {"iterations": 1},
        {"reversible": 1.5},
        {"octaves": -1.0},
        {"reach": float("inf")},
    ],
)
def test_unsound_numbers_are_refused(change: dict[str, float]) -> None:
    block = real("full", sizes=SAME)
    Parameters(block.kind, block.numbers, block.gaps, block.tables)
    with pytest.raises(ValueError, match="not valid"):
        Parameters(block.kind, block.numbers | change, block.gaps, block.tables)


def test_a_simplified_law_takes_no_more_flux_than_its_unit() -> None:
    block = real("simplified", sizes=SAME)
    with pytest.raises(ValueError, match="not valid"):
        Parameters(block.kind, block.numbers | {"flux_limit": 1.1}, block.gaps, block.tables)


@pytest.mark.parametrize("kind", KINDS)
def test_a_current_that_would_fall_is_refused(kind: RealKind) -> None:
    block = real(kind, sizes=SAME)
    gaps = block.gaps.copy()
    gaps[-1, COLUMNS.index("flux_arm")] = -0.3 * gaps[-1, COLUMNS.index("field_arm")]
    if kind == "full":  # 1/3 is the steepest a law can ever be
        Parameters(block.kind, block.numbers, gaps, block.tables)
        gaps[-1, COLUMNS.index("flux_arm")] *= 40.0
    with pytest.raises(ValueError, match="not valid"):
        Parameters(block.kind, block.numbers, gaps, block.tables)


@pytest.mark.parametrize("kind", KINDS)
def test_tables_that_fall_or_are_too_short_are_refused(kind: RealKind) -> None:
    block = real(kind, sizes=SAME)
    for name, table in block.tables.items():
        falling = table.copy()
        falling[3] = falling[5]
        with pytest.raises(ValueError, match="not valid"):
            Parameters(block.kind, block.numbers, block.gaps, block.tables | {name: falling})
        with pytest.raises(ValueError, match="wrong length"):
            Parameters(block.kind, block.numbers, block.gaps, block.tables | {name: table[:-1]})


@pytest.mark.parametrize("kind", KINDS)
def test_conditioning_makes_the_start_known(kind: RealKind) -> None:
    known, strange = RealTwin(real(kind)), RealTwin(real(kind))
    memory = {"full": [-3.0, -0.6, -3.0, -3.0, -0.6], "simplified": [0.4, -0.8, 0.4, 0.4, 0.0]}
    strange.start_from(memory[kind])
    currents = known.condition(WIDE)
    assert np.array_equal(strange.condition(WIDE), currents)
    assert (currents.min(), currents.max()) == pytest.approx(CURRENTS)
    goal = 0.4 * HIGH
    assert strange.solve(goal, WIDE) == pytest.approx(known.solve(goal, WIDE), abs=2e-3)


def test_a_memory_must_be_one() -> None:
    twin = RealTwin(real("full"))
    with pytest.raises(ValueError, match="wrong length"):
        twin.start_from([0.0, 0.0])
    with pytest.raises(ValueError, match=r"-1\.\.1"):
        twin.start_from([0.0, 1.5, 0.0, 0.0, 0.0])


PROGRAM = """
#include <stdio.h>
#include <string.h>
int main(void)
{
  static anhyst_compensator_f32 c;
  float demand, gap;
  if (anhyst_compensator_init_f32(&c, &magnet_parameters) != ANHYST_OK) {
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
def test_the_c_that_is_written_out_gives_the_same_bits(
    kind: RealKind, level: str, tmp_path: Path
) -> None:
    compiler = shutil.which("cc") or shutil.which("gcc")
    if compiler is None:
        pytest.skip("gcc is not installed")
    block = real(kind, sizes=TableSizes())
    core = core_folder()
    parameters = c_parameters("magnet", block, Names("N", "A"), magnet().schedule)
    source, program = tmp_path / "all.c", tmp_path / "all"
    head = '#include "anhyst/compensator/compensator_f32.h"\n'
    source.write_text(head + parameters + PROGRAM, encoding="utf-8")
    sources = [str(source), *(f"{core}/src/{name}" for name in SINGLE[kind])]
    strict = ["-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Wconversion", "-Werror"]
    options = [*strict, level, "-ffp-contract=off", f"-I{core}/include"]
    command = [compiler, *options, *sources, "-o", str(program)]
    subprocess.run(command, check=True)
    demand = demanding(HIGH)
    gap = moving(demand.size)
    rows = "\n".join(
        f"{literal(d)[:-1]} {literal(g)[:-1]}" for d, g in zip(demand, gap, strict=True)
    )
    done = subprocess.run([str(program)], input=rows, capture_output=True, text=True, check=True)
    found = np.array([int(line, 16) for line in done.stdout.split()], dtype=np.uint32)
    expected = RealTwin(block).run(demand, gap).astype(np.float32).view(np.uint32)
    assert np.array_equal(found, expected)
