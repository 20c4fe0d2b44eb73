"""Test the settings of a position controller: accepted, rejected, and its way to readiness."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from anhyst._core import FixedForceController, FixedPosition, ForceController, Position
from anhyst.control import PositionControl, ReferenceConverter
from anhyst.support.block_words import Scales
from anhyst.support.kinds import NumberFormat
from anhyst.support.states import Command, Phase, State
from tests.actuators import CURRENTS, compiled, magnet, ranges, real_block
from tests.control.levitating import CONTROL, FORMATS, PAIR, REST, TARGET, make_drive, path, place
from tests.refusals import refused


def build(number_format: NumberFormat, change: Mapping[str, Any], drives: int = 1) -> object:
    kind = FixedPosition if number_format == "fixed" else Position
    settings = dict(CONTROL.settings(number_format)) | dict(change)
    settings = {name: value for name, value in settings.items() if value is not None}
    made = [make_drive(number_format) for _ in range(drives)]
    return kind(CONTROL.gains(number_format), made, settings)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("number_format", "change", "text"),
    [
        ("fixed", {"detect": None}, "setting 'detect' is missing"),
        ("f64", {"gap_offset_1": None}, "setting 'gap_offset_1' is missing"),
        ("f64", {"current_full": 5.0}, "there is no setting 'current_full'"),
        ("fixed", {"colour": 1}, "there is no setting 'colour'"),
        (
            "fixed",
            {"max_missing_samples": -1},
            "setting 'max_missing_samples' is of the wrong type or out of range",
        ),
        ("fixed", {"hold": 65536}, "setting 'hold' is of the wrong type or out of range"),
        ("fixed", {"bias": 0.5}, "setting 'bias' is of the wrong type or out of range"),
        ("f64", {"current_step": "fine"}, "setting 'current_step' is of the wrong type"),
        ("f64", {"position_full": math.nan}, "not valid"),
        ("f64", {"current_step": 0.3}, "not valid"),
        ("fixed", {"release": 1}, "not valid"),
        ("fixed", {"position_low": 2**31 - 1}, "not valid"),
    ],
)
def test_settings_are_checked_by_name(
    number_format: NumberFormat, change: Mapping[str, Any], text: str
) -> None:
    with pytest.raises(ValueError, match=text):
        build(number_format, change)


def test_force_controllers_match_the_number_format() -> None:
    with pytest.raises(ValueError, match="one force controller, or two"):
        build("fixed", {}, drives=0)
    with pytest.raises(ValueError, match="one force controller, or two"):
        build("f64", {}, drives=3)
    with pytest.raises(ValueError, match="setting 'gap_offset_2' is missing"):
        build("f64", {}, drives=2)
    settings = dict(PAIR.settings("f64"))
    drive = make_drive("f64")
    with pytest.raises(ValueError, match="a force controller of its own"):
        Position(PAIR.gains("f64"), [drive, drive], settings)  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="force controller of this number format"):
        Position(PAIR.gains("f64"), [make_drive("fixed")], settings)  # type: ignore[arg-type]


def changed(**change: Any) -> PositionControl:
    """Return the controller with a changed field, named part__field."""
    control = CONTROL
    for path_, value in change.items():
        part, _, name = path_.partition("__")
        value_ = replace(getattr(control, part), **{name: value}) if name else value
        control = replace(control, **{part: value_})
    return control


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"limits__step": 0.0}, "not-above-zero step: 0.0"),
        ({"limits__gap_low": 0.6e-3}, "range-reversed gap_low"),
        ({"limits__current_low": 1.0}, "zero-outside-range current_low"),
        ({"limits__max_missing_samples": 70000}, "out-of-range max_missing_samples: 70000"),
        ({"levitation__rise_speed": -1.0}, "not-above-zero rise_speed: -1.0"),
        ({"levitation__detect": math.inf}, "not-above-zero detect"),
        ({"converter__bits": 21}, "out-of-range bits"),
        ({"converter__high": 0.0}, "range-reversed low"),
        ({"bias": 301.0}, "out-of-range bias: 301.0 N"),
        ({"pidd2__high": math.inf}, "not-above-zero high"),
    ],
)
def test_meaningless_settings_are_refused(change: dict[str, Any], text: str) -> None:
    with refused(text):
        changed(**change)


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"converter": ReferenceConverter(0.0, 4.5e-3, 16)}, "converter-too-fine bits"),
        ({"scales": Scales(300.0, 5.0, 0.44e-3, 0.46e-3)}, "range-too-narrow gap_high"),
        ({"levitation__rise_speed": 1e-10}, "rate-too-small rise_speed"),
        ({"converter": ReferenceConverter(5.0, 9.0, 12)}, "range-too-narrow current_high"),
    ],
)
def test_settings_beyond_the_fixed_point_range_are_refused(change: dict[str, Any], text: str) -> None:
    with refused(text):
        changed(**change).settings("fixed")


def test_codes_represent_the_given_values() -> None:
    words = CONTROL.settings("fixed")
    metre, newton = words["position_full"] / 2.0**31, words["demand_full"] / 2.0**31
    ampere = words["current_full"] / 2.0**31
    assert words["gap_middle"] == pytest.approx(0.45e-3)
    assert words["detect"] * metre == pytest.approx(2e-6, rel=1e-6)
    assert words["rise"] * metre == pytest.approx(2e-3 / 20e3, rel=1e-5)
    assert words["lift"] * newton == pytest.approx(1000.0 / 20e3, rel=1e-5)
    assert words["position_low"] * metre == pytest.approx(0.45e-3 - 0.57e-3, rel=1e-6)
    assert words["current_step"] * ampere == pytest.approx(4.5 / 65535, rel=1e-12)
    assert words["current_full"] == pytest.approx(5.0, rel=2e-5)
    assert words["current_high"] * ampere == pytest.approx(4.5, rel=1e-9)
    # Gap of the drive over the position, at both ends of the possible range.
    for gap in (0.33e-3, 0.57e-3):
        position = (words["gap_middle"] - gap) / words["position_full"]
        factor = words["gap_mantissa_1"] / 65536.0 * 2.0 ** words["gap_shift_1"]
        part = words["gap_offset_1"] / 2.0**31 + 2.0 * factor * position
        assert 0.3e-3 + 0.3e-3 * part == pytest.approx(gap, abs=5e-9)


def with_hysteresis(number_format: NumberFormat) -> tuple[Any, Any]:
    """Return a controller with a full compensator, and its force controller."""
    scales, limits = ranges("reluctance")
    control = replace(
        CONTROL,
        scales=scales,
        converter=ReferenceConverter(*CURRENTS, 16),
        limits=replace(CONTROL.limits, current_low=CURRENTS[0], current_high=CURRENTS[1]),
        pidd2=replace(CONTROL.pidd2, K_load=0.0, high=limits.demand[1]),
    )
    drive: ForceController | FixedForceController
    if number_format == "fixed":
        drive = FixedForceController.compensator("full", compiled("full").words)
        kind: Any = FixedPosition
    else:
        words = real_block("f64", magnet(), "full", scales, limits).words
        drive = ForceController.compensator("full", words)
        kind = Position
    return kind(control.gains(number_format), [drive], dict(control.settings(number_format))), drive


def probe(drive: ForceController | FixedForceController) -> float:
    """Return the current for some force at a middle gap; at rest, the state does not change."""
    if isinstance(drive, FixedForceController):
        return drive.solve(2**29, 2**30, -(2**31)) / 2.0**31 * ranges("reluctance")[0].current
    return drive.solve(0.25 * ranges("reluctance")[0].demand, 0.45e-3, math.nan)


@pytest.mark.parametrize("number_format", ["f64", "fixed"])
def test_conditioning_drives_the_sequence_and_makes_ready(number_format: NumberFormat) -> None:
    controller, drive = with_hysteresis(number_format)
    for _ in range(30):
        controller.tick(REST, TARGET)
    fresh = probe(drive)
    ticks = drive.conditioning_length()
    rows = [controller.tick(REST, TARGET, command=Command.CONDITION)]
    rows += [controller.tick(REST, TARGET) for _ in range(ticks + 250)]
    assert path(rows) == [(State.IDLE, Phase.CONDITION), (State.READY, Phase.REST)]
    scale = 1.0 if number_format == "f64" else ranges("reluctance")[0].current / 2.0**31
    expected = [drive.conditioning(i) * scale for i in range(ticks)]
    driven = [row[0] for row in rows[:ticks]]
    assert driven == pytest.approx(expected, abs=2.0 * (CURRENTS[1] - CURRENTS[0]) / 65535)
    assert (min(driven), max(driven)) == pytest.approx(CURRENTS, abs=2e-4)
    assert rows[-1][0] == pytest.approx(0.0, abs=2e-5)
    # The iron keeps this state until a demagnetised state is reported.
    conditioned = probe(drive)
    assert abs(conditioned - fresh) > 5e-4
    controller.tick(REST, TARGET, command=Command.DEMAGNETISED)
    assert probe(drive) == pytest.approx(fresh, abs=1e-6)


def test_stop_ends_conditioning() -> None:
    controller, _ = with_hysteresis("fixed")
    for _ in range(30):
        controller.tick(REST, TARGET)
    for i in range(100):
        controller.tick(REST, TARGET, command=Command.CONDITION if i == 0 else 0)
    stopped = controller.tick(REST, TARGET, command=Command.STOP)
    assert place(stopped) == (State.IDLE, Phase.REST)


def test_conditioning_without_memory_takes_no_time() -> None:
    controller: Any = build("fixed", {})
    for _ in range(30):
        controller.tick(REST, TARGET)
    assert place(controller.tick(REST, TARGET, command=Command.CONDITION)) == (State.READY, Phase.REST)


def test_every_format_has_the_same_levitation() -> None:
    of = [CONTROL.settings(number_format) for number_format in FORMATS]
    shared = set(of[0]) & set(of[2]) - {"current_low", "current_high", "current_step"}
    shared -= {"release", "bias", "gap_offset_1"}
    assert len(shared) > 14
    assert all(settings[name] == of[0][name] for settings in of for name in shared)
    assert np.isfinite([float(value) for value in of[0].values()]).all()
