"""Test that the simulated loop gives every current code of the code that would be flashed.

The test feeds the recorded readings to the fixed-point controller of the core and to the compiled
block. Both run separately, in integers, without any part of the simulation.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from anhyst._core import FixedCompensator, FixedController, FixedForceController
from anhyst.compensate.block import Block
from anhyst.compensate.methods import HysteresisInverse
from anhyst.support.kinds import MethodName
from anhyst.support.states import Command
from anhyst_rigs.rig.bearing.loop import BearingSetup
from anhyst_rigs.rig.loop import DROP_SAMPLE_BIT, Scenario
from anhyst_rigs.rig.recording import (
    BREAKAWAY_CODE,
    COLUMNS,
    DESCEND_CODE,
    HOVER_CODE,
    READY_CODE,
    RISE_CODE,
    SET_DOWN_CODE,
    Recording,
)
from tests.study import bearings
from tests.study.bearings import GAP

Q31 = 2.0**31
NO_FLUX = -(2**31)


def steps(setup: BearingSetup) -> Scenario:
    """Difficult script: steps, a lost sample, a load beyond the largest force."""
    script = bearings.lifted(setup)
    for gap in (GAP - 50e-6, GAP + 50e-6, GAP):
        script.step(gap, 0.02)
    script.command(DROP_SAMPLE_BIT).step(GAP - 20e-6, 0.02)
    script.set_load(310.0).hold(0.02).set_load(150.0).hold(0.1)
    return script.command(Command.LAND).hold(0.3).build()


class Pieces:
    """Separate controller and compiled block of a setup; signals are codes."""

    def __init__(self, setup: BearingSetup) -> None:
        control = setup.position_control
        self.words = dict(control.settings("fixed"))
        gains = control.gains("fixed")
        assert gains.dtype == np.int32
        self.controller = FixedController(gains.astype(np.int32))
        drive = setup.compensator.reset_copy().native
        assert isinstance(drive, FixedForceController)
        self.drive = drive
        self.compensator = flashed(setup)
        self.demand = 0

    def code(self, value: float, name: str) -> int:
        """Nearest code of a reading, as a converter of the rig would return it."""
        return int(np.floor(value / self.words[f"{name}_full"] * Q31 + 0.5))

    def position(self, gap: float) -> int:
        return self.code(self.words["gap_middle"] - gap, "position")

    def gap(self, position: int) -> int:
        """Convert a position code to a gap code of the drive."""
        mantissa, shift = (int(self.words[f"gap_{name}_1"]) for name in ("mantissa", "shift"))
        part = (position * mantissa // 65536) >> -shift
        return max(-(2**31), min(2**31 - 1, int(self.words["gap_offset_1"]) + 2 * part))

    def on_grid(self, current: int) -> int:
        """Nearest code of the converter."""
        low, high, step = (int(self.words[f"current_{end}"]) for end in ("low", "high", "step"))
        held = max(low, min(high, current))
        return low + (2 * (held - low) + step) // (2 * step) * step


def flashed(setup: BearingSetup) -> FixedCompensator | None:
    """The block and the compensator that ``anhyst compile`` writes, or None without hysteresis."""
    law = setup.compensator.parameters
    if not isinstance(law, HysteresisInverse):
        return None
    assert isinstance(law.block, Block)
    return FixedCompensator(law.block.kind, law.block.words)


def replay(setup: BearingSetup, recording: Recording) -> Iterator[tuple[int, int, int]]:
    """Yield tick, current code and demand code of the separate parts."""
    pieces = Pieces(setup)
    controls = (RISE_CODE, HOVER_CODE, DESCEND_CODE)
    rows = [dict(zip(COLUMNS, row, strict=True)) for row in recording.table.tolist()]
    position, before, current = 0, 0, 0
    for tick, row in enumerate(rows):
        state = int(row["state"])
        if not np.isnan(row["gap_read_m"]):
            position = pieces.position(row["gap_read_m"])
        gap = pieces.gap(position)
        if state in controls:
            reference = pieces.position(row["reference_m"])
            if before not in controls:
                pieces.controller.start(reference, position, 0, pieces.demand)
            pieces.demand = pieces.controller.solve(reference, position, 0)
        else:
            pieces.demand = pieces.code(row["demand_N"], "demand")
        if state in (*controls, BREAKAWAY_CODE, SET_DOWN_CODE):
            wanted = pieces.drive.solve(pieces.demand, gap, NO_FLUX)
            if pieces.compensator is not None:
                assert pieces.compensator.solve_q31(pieces.demand, gap) == wanted
        else:
            wanted = max(0, current - int(pieces.words["release"]))
        current = pieces.on_grid(wanted)
        force = pieces.drive.commit(current, gap)
        if pieces.compensator is not None:
            pieces.compensator.commit_q31(current, gap)
        if state in controls:
            limited = int(row["flags"]) & 7
            pieces.controller.commit(force if limited else pieces.demand)
        before = state
        yield tick, current, pieces.demand


def differs_at(setup: BearingSetup, recording: Recording) -> int | None:
    """First tick whose current or demand differs from the recording."""
    pieces = Pieces(setup)
    currents = [pieces.code(value, "current") for value in recording["command_A"].tolist()]
    demands = [pieces.code(value, "demand") for value in recording["demand_N"].tolist()]
    assert [pieces.on_grid(code) for code in currents] == currents
    for tick, current, demand in replay(setup, recording):
        if (current, demand) != (currents[tick], demands[tick]):
            return tick
    return None


@pytest.mark.slow
@pytest.mark.parametrize("variant", ["full", "simplified", "single-valued"])
def test_the_pieces_give_every_current_of_the_loop(variant: MethodName) -> None:
    setup = bearings.single(variant)
    scenario = steps(setup)
    recording = bearings.run(setup, scenario, seed=2)
    assert len(recording) == scenario.ticks
    assert recording["state"][-1] == READY_CODE
    assert {1, 2, 3} & set(recording["flags"]), "no limit was in the way"
    assert np.isnan(recording["gap_read_m"]).sum() == 1
    assert len(set(recording["command_A"])) > 1000
    assert differs_at(setup, recording) is None


@pytest.mark.slow
def test_a_single_step_of_the_encoder_is_noticed() -> None:
    setup = bearings.single("full")
    recording = bearings.run_plant(setup, bearings.lifted(setup))
    table = recording.table.copy()
    table[8000, COLUMNS.index("gap_read_m")] += 50e-9
    assert differs_at(setup, Recording.from_table(table)) == 8000
    other = bearings.single("simplified")
    assert differs_at(BearingSetup(setup.rig, other.compensator, setup.controller), recording) is not None
