"""Lag and creep of a model: the inverse compensates both, and reports missing inputs."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from anhyst.laws.cells import CellWeights
from anhyst.model.actuator import Model, read_model
from anhyst.model.dynamics import Dynamics
from anhyst.model.schema import ValidRange
from anhyst.model.writer import write_model
from anhyst.support.units import MU_0, QUANTITIES
from tests.refusals import refused

CELLS = CellWeights(np.array([0.0, 10.0, 40.0]), np.array([200.0]), np.array([[3000.0], [500.0], [500.0]]))
STACK = Model(
    "stack",
    QUANTITIES["voltage"],
    QUANTITIES["displacement"],
    {"alpha": 0.0, "c_H": 1.0, "c_out": 1.5e-8 / MU_0, "in_0": -20.0, "out_0": 1e-6},
    law="play-cells",
    cells=CELLS,
    dynamics=Dynamics(0.0, (0.1, 3.0), (0.02, 0.03)),
)
TIME = np.cumsum(np.random.default_rng(1).uniform(0.5e-2, 2e-2, 800))
DRIVE = 60.0 - 60.0 * np.cos(2.0 * np.pi * 0.5 * (TIME - TIME[0]))


@pytest.mark.parametrize("history", ["demagnetised", "conditioned:0,100,0", "settled"])
def test_the_inverse_with_creep_returns_the_drive_on_an_uneven_clock(history: str) -> None:
    found = STACK.predict(DRIVE, time=TIME, history=history)
    back = STACK.invert(found.output, time=TIME, history=history)
    assert back.drive == pytest.approx(DRIVE, abs=1e-6)


def test_a_constant_drive_creeps_to_the_sum_of_the_creep_terms() -> None:
    time = np.arange(0.0, 40.0, 0.02)
    drive = np.full(time.size, 100.0)
    still = replace(STACK, dynamics=None).predict(drive).output - 1e-6
    crept = STACK.predict(drive, time=time).output - 1e-6
    assert crept[0] == pytest.approx(still[0])
    assert crept[-1] == pytest.approx(1.05 * still[-1], rel=1e-4)


def test_a_settled_cycle_with_creep_closes() -> None:
    time = np.arange(400) / 200.0
    drive = 60.0 - 60.0 * np.cos(2.0 * np.pi * 0.5 * time)
    found = STACK.predict(drive, time=time, history="settled").output
    twice = STACK.predict(np.tile(drive, 2), time=np.arange(800) / 200.0, history="settled").output
    assert twice[400:] == pytest.approx(found, abs=1e-12)


def test_a_lag_delays_the_output_and_the_inverse_asks_earlier() -> None:
    late = replace(STACK, dynamics=Dynamics(lag=0.05))
    time = np.arange(600) * 0.01
    drive = 60.0 - 60.0 * np.cos(2.0 * np.pi * 0.5 * time)
    at_once = replace(STACK, dynamics=None).predict(drive).output
    output = late.predict(drive, time=time).output
    assert output[5:] == pytest.approx(at_once[:-5], abs=1e-12)
    assert late.invert(output, time=time).drive[:-5] == pytest.approx(drive[:-5], abs=1e-6)


def test_the_file_keeps_it(tmp_path: Path) -> None:
    model = replace(STACK, dynamics=Dynamics(0.004, (0.1, 3.0), (0.02, 0.03), 5.0))
    write_model(model, tmp_path / "m.toml")
    assert read_model(tmp_path / "m.toml") == model


def test_a_missing_time_is_reported() -> None:
    with refused("time-missing"):
        STACK.predict(DRIVE)


def test_a_run_faster_than_the_fitted_data_is_flagged() -> None:
    limits = ValidRange((0.0, 120.0), (0.0, 1e-2), input_rate=190.0)
    for model in (replace(STACK, valid=limits), replace(STACK, valid=limits, dynamics=None)):
        slow = model.predict(DRIVE, time=TIME)
        fast = model.predict(DRIVE, time=TIME / 10.0)
        back = model.invert(fast.output, time=TIME / 10.0)
        assert slow.valid.all()
        assert not slow.warnings
        assert not fast.valid.all()
        assert sum("loops up to 190 V/s were fitted" in text for text in fast.warnings) == 1
        assert sum("loops up to 190 V/s were fitted" in text for text in back.warnings) == 1
        assert model.predict(DRIVE, time=TIME, history="settled").valid.all()
    unknown = replace(STACK, valid=replace(limits, input_rate=None))
    assert not unknown.predict(DRIVE, time=TIME / 10.0).warnings


@pytest.mark.parametrize(
    ("wrong", "what"),
    [
        ({"lag": -1.0}, "out-of-range"),
        ({"times": (1.0,)}, "length-differs"),
        ({"times": (2.0, 1.0), "shares": (0.1, 0.1)}, "not-ascending"),
    ],
)
def test_numbers_that_make_no_sense_are_refused(wrong: dict[str, float], what: str) -> None:
    with refused(what):
        Dynamics(**wrong)  # type: ignore[arg-type]


def test_step_by_step_it_creeps_as_over_a_record() -> None:
    found = STACK.predict(DRIVE, time=TIME, history="conditioned:0,100,0").output
    back = STACK.stepper(history="conditioned:0,100,0")
    steps = [None, *np.diff(TIME).tolist()]
    for drive, output, dt in zip(DRIVE.tolist(), found.tolist(), steps, strict=True):
        assert back.solve(output, dt=dt).drive == pytest.approx(drive, abs=1e-6)
        assert back.commit(drive, dt=dt) == pytest.approx(output, abs=1e-15)
