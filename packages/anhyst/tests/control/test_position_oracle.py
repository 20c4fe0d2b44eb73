"""Test the fixed-point controller against exact integers, tick by tick and bit for bit."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import cast

import numpy as np
import pytest
from numpy.typing import NDArray

from anhyst._core import FixedForceController, FixedPosition
from anhyst.control import PositionControl
from anhyst.support.states import Command, Phase, State
from tests.control.levitating import CONTROL, PAIR, REST, TARGET, Rig, Tick, codes, make_drive, place
from tests.control.position_oracle import Oracle, Sample

Q31 = 2.0**31


class Twin(FixedPosition):
    """Controller of the core, with the oracle in parallel in every tick."""

    def __init__(self, control: PositionControl) -> None:
        settings = dict(control.settings("fixed"))
        gains = cast(NDArray[np.int32], control.gains("fixed"))
        magnets = 1 if control.gap_total is None else 2
        drives = [cast(FixedForceController, make_drive("fixed")) for _ in range(2 * magnets)]
        super().__init__(gains, drives[:magnets], settings)
        self.oracle = Oracle(gains, drives[magnets:], settings)
        self.scale = settings
        self.seen: set[tuple[State, Phase]] = set()

    def code(self, value: float, name: str) -> int:
        return codes(value, self.scale[f"{name}_full"])

    def tick(
        self,
        gap: float,
        target: float,
        load: float = 0.0,
        current: tuple[float, float] = (0.0, 0.0),
        flux: tuple[float, float] = (math.nan, math.nan),
        command: int = 0,
    ) -> Tick:
        answer = super().tick(gap, target, load, current, flux, command)
        middle = self.scale["gap_middle"]
        sample = Sample(
            position=None if math.isnan(gap) else self.code(middle - gap, "position"),
            target=self.code(middle - target, "position"),
            load=self.code(load, "load"),
            current=(self.code(current[0], "current"), self.code(current[1], "current")),
            command=command,
        )
        currents, reference, demand, state, flags = self.oracle.tick(sample)
        found = [self.code(value, "current") for value in answer[: len(currents)]]
        assert found == currents
        assert answer[2] == middle - reference / Q31 * self.scale["position_full"]
        assert self.code(answer[3], "demand") == demand
        assert answer[4:] == (state, flags)
        assert self.fault == self.oracle.levitation.fault
        self.seen.add(place(answer))
        return answer


CASES = {
    "single": CONTROL,
    "measured": replace(CONTROL, uses_measured_currents=True),
    "second derivative": replace(CONTROL, pidd2=replace(CONTROL.pidd2, K_dd=0.3)),
    "pair": PAIR,
}


@pytest.mark.slow
@pytest.mark.parametrize("control", CASES.values(), ids=CASES.keys())
def test_a_whole_run(control: PositionControl) -> None:
    """Lift-off, steps, load, saturation, lost samples, hold, landing and fault give the same bits."""
    twin = Twin(control)
    load = 150.0 if control.gap_total is None else 40.0
    rig = Rig(twin, load=load, gap_total=control.gap_total)
    rig.hover()
    rng = np.random.default_rng(5)
    noise = iter(rng.normal(0.0, 20e-9, 100_000))
    rig.hidden = lambda gap: round((gap + next(noise)) / 50e-9) * 50e-9
    for target in (TARGET - 20e-6, TARGET + 60e-6, TARGET):
        rig.run(600, target)
    rig.load += 20.0
    for _ in range(300):
        rig.tick(feed=20.0)
    shown = rig.hidden
    for missing in (2, 3, 8):
        rig.hidden = lambda _: math.nan
        rig.run(missing)
        rig.hidden = shown
        rig.run(100)
    rig.run(9000)
    assert place(rig.tick()) == (State.FAULT, Phase.REST)
    rig.run(30, command=Command.CLEAR)
    rig.hover()
    rig.hidden = lambda _: math.nan
    rig.run(3000)
    assert place(rig.tick()) == (State.FAULT, Phase.REST)
    everything = {phase for _, phase in twin.seen}
    assert everything == set(Phase) - {Phase.CONDITION}


@pytest.mark.first(1)
@pytest.mark.parametrize(
    "seed",
    [pytest.param(seed, marks=[pytest.mark.slow, pytest.mark.campaign] * (seed > 0)) for seed in range(4)],
)
@pytest.mark.parametrize("control", CASES.values(), ids=CASES.keys())
def test_signals_that_make_no_sense(control: PositionControl, seed: int) -> None:
    """Random samples of any size and random commands give the same bits."""
    limits = replace(control.limits, step=100e-6, max_missing_samples=1, hold=5, selftest=2)
    levitation = replace(
        control.levitation, lift_rate=4e5, set_down_rate=6e5, rise_speed=0.5, descend_speed=0.8
    )
    rng = np.random.default_rng(seed)
    twin = Twin(replace(control, limits=limits, levitation=levitation))
    gap = REST
    for tick in range(6000):
        gap = float(np.clip(gap + rng.normal(0.0, 30e-6), 0.32e-3, 0.58e-3))
        shown = gap
        if tick % 7 == 0:
            shown = float(rng.choice([math.nan, math.inf, 0.0, 1.0, -3.0, gap + 50e-6]))
        twin.tick(
            shown,
            float(rng.choice([TARGET, gap, 0.0, 1e9, math.nan])),
            float(rng.choice([0.0, 50.0, -1e6, math.nan, -math.inf])),
            (float(rng.normal(2.0, 3.0)), float(rng.normal(2.0, 3.0))),
            command=int(rng.integers(0, 12)) if tick % 5 == 0 else 0,
        )
    assert {state for state, _ in twin.seen} == set(State) - {State.INIT}
    assert len(twin.seen) >= 10


def test_the_oracle_notices() -> None:
    """An error of one code in one gain is found."""
    twin = Twin(CONTROL)
    twin.oracle.pidd2.words[4] += 1  # type: ignore[index]
    with pytest.raises(AssertionError):
        Rig(twin).hover()
