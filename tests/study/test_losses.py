"""A magnet is lost in flight: the others carry on, or the body is set down."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Literal

import numpy as np
import pytest

from anhyst.rig.case_table import LossCase
from anhyst.rig.magnet_table import LikeTable
from anhyst.rig.stage.file import spare
from anhyst.rig.stage.loop import Feedforward, StageSetup, axes_controller, make_stage, track
from anhyst.rig.stage.setpoint import motion_of
from anhyst.study.tracking.losses import Losses, LostMagnet
from tests.control.test_wrench import LAYOUTS
from tests.study import bearings
from tests.study.test_axes import planar


@cache
def laid(name: str, peaks: tuple[float, ...] = (22.0, 10.0)) -> StageSetup:
    """Return the example with the magnets of a layout, which looks for lost ones."""
    file, lines = planar().settings, LAYOUTS[name]
    like = next(one for one in file.magnets if isinstance(one, LikeTable))
    magnets = [
        (like if number else file.magnet).model_copy(
            update={
                "name": f"m{number}",
                "position_m": [*place],
                "direction": [*along],
                **({"like": "m0"} if number else {}),
            }
        )
        for number, (place, along) in enumerate(lines)
    ]
    scan = file.scan.model_copy(update={"test_m_per_s2": [*peaks]})
    changed = file.model_copy(update={"magnets": magnets, "cases": [scan]})
    rig = replace(planar(), settings=changed.changed({"control.lost_A": 0.25}))
    return make_stage(rig, bearings.knowledge(), "full")


def lose(
    setup: StageSetup, magnets: Sequence[int], circuit: Literal["open", "short"] = "open"
) -> list[LostMagnet]:
    case = LossCase(kind="loss", circuit=circuit, magnets=[f"m{one}" for one in magnets])
    return Losses(setup, Feedforward(), case).all()


@pytest.mark.parametrize(("name", "count"), [("8", 0), ("10", 0), ("12", 8), ("14", 14)])
def test_what_can_be_spared_is_what_the_linear_programme_leaves_movable(
    name: str, count: int
) -> None:
    assert spare(laid(name).rig.settings) == (1 << count) - 1


def test_looking_for_lost_magnets_moves_no_bit_where_none_is() -> None:
    setup = laid("10")
    blind = replace(setup.rig, settings=setup.rig.settings.changed({"control.lost_A": None}))
    scan = setup.rig.settings.scan
    motion = motion_of(scan, scan.test_m_per_s2)
    runs = [track(replace(setup, rig=rig), motion, Feedforward()) for rig in (setup.rig, blind)]
    for name in runs[0].columns:
        assert np.array_equal(runs[0][name], runs[1][name])


@pytest.mark.slow
def test_what_can_be_spared_flies_on_and_is_as_exact_in_the_end() -> None:
    for one in [*lose(laid("12"), [1, 4]), *lose(laid("14"), [8, 12])]:
        assert one.outcome == "flies on"
        assert one.noticed_s is not None
        assert one.noticed_s < 1e-3
        assert max(one.error_end[name] for name in ("error_x_m", "error_z_m")) < 20e-9
        assert max(value for name, value in one.error.items() if name.endswith("_m")) < 5e-6


@pytest.mark.slow
def test_too_little_left_for_the_acceleration_brakes_without_touching_a_stop() -> None:
    (one,) = lose(laid("12"), [0])
    assert one.outcome == "brakes"
    assert one.touch_m_per_s == 0.0
    assert one.error_end["error_x_m"] < 20e-9
    assert one.unaware[1] > 0.02


@pytest.mark.slow
@pytest.mark.parametrize("circuit", ["open", "short"])
def test_what_cannot_be_spared_is_set_down(circuit: Literal["open", "short"]) -> None:
    for one in lose(laid("10"), [0, 4, 6], circuit):
        assert one.outcome == "lands"
        assert 0.0 < one.down_m_per_s < 0.015
        assert one.down_m_per_s < 0.3 * one.let_go[0]


def lost_after(read: Sequence[Sequence[float]]) -> list[int]:
    """Return what is lost after each tick in which so much is read of the first magnets."""
    controller, told, found = axes_controller(laid("10")), [0.0] * 10, []
    for row in [*[[]] * 40, *read]:
        now = [*row, *told[len(row) :]]
        told, _, _, lost, _ = controller.tick(
            [0.0] * 6, [100.0, 0.0, 196.2, 0.0, 0.0, 0.0], [0.45e-3] * 10, now
        )
        assert min(told) >= 0.0
        assert max(told) <= 4.5
        found.append(lost)
    return found[40:]


def test_one_wrong_reading_and_none_lose_nothing_and_more_of_them_do() -> None:
    assert not any(lost_after([[0.0], [], [], []] * 5))
    assert not any(lost_after([[math.nan] * 10] * 50))
    assert lost_after([[0.0]] * 8) == [0, 0, 0, 0, 1, 1, 1, 1]
    assert lost_after([[math.inf]] * 5)[-1] == 1
    assert lost_after([[0.0]] * 5 + [[0.0, 9.0]] * 5)[-1] == 0b11


def test_with_all_magnets_lost_nothing_is_driven() -> None:
    controller, forward = axes_controller(laid("14")), [0.0, 0.0, 196.2, 0.0, 0.0, 0.0]
    told: list[float] = []
    for _ in range(2000):
        told, _, _, lost, state = controller.tick([0.0] * 6, forward, [0.45e-3] * 14, [9.0] * 14)
    assert lost == (1 << 14) - 1
    assert state == 2
    assert not any(told)
