"""Solid iron in a model: its file, its inputs, and its static behaviour."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from anhyst.model.actuator import Model, read_model
from anhyst.model.diff import diff
from anhyst.model.dynamics import Dynamics, Layers
from anhyst.model.schema import ValidRange
from anhyst.model.writer import write_model
from anhyst.support.units import QUANTITIES
from tests.refusals import refused

PLAIN = Model(
    "magnet",
    QUANTITIES["current"],
    QUANTITIES["force"],
    {"M_1": 9e5, "a_1": 90.0, "k_1": 60.0, "s_1": 2.0, "c_H": 1250.0, "rho": 3e-3, "c_out": 170.0},
    law="play-cells",
)
SOLID = replace(
    PLAIN,
    parameters={**PLAIN.parameters, "gamma": 5.0},
    layers=Layers(3, 0.1, 0.25),
    dynamics=Dynamics(fastest=50.0),
)
DRIVE = 2.0 - 2.0 * np.cos(np.linspace(0.0, 4.0 * np.pi, 400))
FAST, SLOW = (np.linspace(0.0, seconds, 400) for seconds in (0.04, 4e3))


def test_a_written_model_predicts_as_before_bit_for_bit(tmp_path: Path) -> None:
    write_model(SOLID, tmp_path / "m.toml")
    again = read_model(tmp_path / "m.toml")
    assert again == SOLID
    first, second = (one.predict(DRIVE, time=FAST).output for one in (SOLID, again))
    assert np.array_equal(first, second)


def test_slow_drives_give_the_quasi_static_force_and_fast_ones_do_not() -> None:
    still = SOLID.at_rest.predict(DRIVE).output
    assert np.abs(SOLID.predict(DRIVE, time=SLOW).output - still).max() < 1e-4 * still.max()
    assert np.abs(SOLID.predict(DRIVE, time=FAST).output - still).max() > 0.05 * still.max()


def test_the_inverse_returns_the_drive() -> None:
    force = SOLID.predict(DRIVE, time=FAST).output
    assert SOLID.invert(force, time=FAST).drive == pytest.approx(DRIVE, abs=1e-6)


def test_a_settled_cycle_is_that_which_it_becomes_when_repeated() -> None:
    cycle, time = DRIVE[:199], FAST[:199]
    settled = SOLID.predict(cycle, time=time, history="settled").output
    step = time[1]
    long = SOLID.predict(np.tile(cycle, 12), time=step * np.arange(12 * 199.0)).output
    assert long[-199:] == pytest.approx(settled, abs=1e-4 * settled.max())


def test_time_is_asked_for_and_a_faster_record_is_noted() -> None:
    with refused("time-missing t_s"):
        SOLID.predict(DRIVE)
    measured = replace(SOLID, valid=ValidRange((0.0, 4.0), (0.0, 1e4), input_rate=628.0))
    assert measured.predict(DRIVE, time=FAST).warnings == ()
    assert "628 A/s were fitted" in " ".join(measured.predict(DRIVE, time=FAST / 4.0).warnings)


def test_a_difference_in_layers_is_a_difference() -> None:
    assert diff(SOLID, SOLID).same
    other = replace(SOLID, layers=Layers(2, 0.1, 0.25))
    assert [setting.name for setting in diff(SOLID, other).settings] == ["layers"]


@pytest.mark.parametrize(
    ("key", "value"), [("count", 1), ("count", 17), ("surface", 1.0), ("laminated", -0.1)]
)
def test_layers_out_of_range_are_refused_with_their_line(tmp_path: Path, key: str, value: float) -> None:
    with refused(f"out-of-range {key}"):
        Layers(**{"count": 3, "surface": 0.1, "laminated": 0.0} | {key: value})  # type: ignore[arg-type]
    path = tmp_path / "m.toml"
    write_model(SOLID, path)
    lines = path.read_text().splitlines()
    place = next(n for n, line in enumerate(lines) if line.startswith(f"{key} ="))
    lines[place] = f"{key} = {value}"
    path.write_text("\n".join(lines))
    with refused("out-of-range") as caught:
        read_model(path)
    assert f":{place + 1}:" in str(caught.value)
