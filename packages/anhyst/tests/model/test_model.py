"""The actuator model in both directions, with every gap map and history, and its flags."""

from __future__ import annotations

import pickle
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from anhyst.data.path import History
from anhyst.model.actuator import Model
from anhyst.model.parameters import GapMap, Parameter
from anhyst.model.schema import ValidRange
from anhyst.support.errors import NegativeResult
from anhyst.support.numeric import FloatArray
from anhyst.support.units import QUANTITIES
from tests.refusals import refused

GAPS = (0.3e-3, 0.4e-3, 0.6e-3)
I_MAX = 2.0

IRON: dict[str, Parameter] = {"M_s": 1.3e6, "a": 400.0, "k": 300.0, "c": 0.15}
AROUND: dict[GapMap, dict[str, Parameter]] = {
    "none": {"alpha": -0.02, "c_H": 7000.0, "rho": 0.0},
    "scaling": {"alpha": -0.02, "c_H": (9000.0, 7000.0, 5000.0)},
    "reluctance": {"c_H": 9000.0, "rho": (0.004, 0.0053, 0.008)},
    "circuit": {"c_H": 9000.0, "rho": (0.004, 0.0053, 0.008)},
    "free": {"alpha": -0.02, "c_H": (9000.0, 7000.0, 5000.0), "k": (300.0, 280.0, 250.0)},
}
MOVING: tuple[GapMap, ...] = ("none", "scaling", "reluctance")


def magnet(gap_map: GapMap = "reluctance", **changes: Parameter) -> Model:
    parameters = IRON | AROUND[gap_map] | {"c_out": 60.0, "in_0": 0.02, "out_0": 0.5} | changes
    return Model(
        name="magnet",
        input=QUANTITIES["current"],
        output=QUANTITIES["force"],
        parameters=parameters,
        gap_map=gap_map,
        schedule=QUANTITIES["gap"],
        nodes=GAPS,
        valid=ValidRange((0.0, I_MAX), (0.0, 200.0), (GAPS[0], GAPS[-1])),
    )


def up_and_down(peak: float, n: int = 50) -> FloatArray:
    half = np.linspace(0.0, peak, n)
    return np.concatenate([half, half[-2::-1]])


def wave(n: int = 400) -> tuple[FloatArray, FloatArray, FloatArray]:
    time = np.linspace(0.0, 1.0, n)
    drive = 1.1 + 0.9 * np.sin(9.0 * time) * np.cos(31.0 * time)
    gap = 0.45e-3 + 0.14e-3 * np.sin(17.0 * time)
    return time, drive, gap


@pytest.mark.parametrize("gap_map", MOVING)
@pytest.mark.parametrize("gamma", [0.0, 0.5])
@pytest.mark.parametrize("history", ["demagnetised", "settled", "conditioned:0,2,0,2,0.3"])
def test_inverse_undoes_predict_while_the_gap_moves(gap_map: GapMap, gamma: float, history: str) -> None:
    model = magnet(gap_map, gamma=gamma, in_0=0.0)
    time, drive, gap = wave()
    there = model.predict(drive, gap, time, history)
    assert there.flux_density.min() > 0.0  # the inverse of a force is unipolar
    back = model.invert(there.output, gap, time, history)
    assert np.abs(back.drive - drive).max() < 1e-7 * I_MAX
    assert np.array_equal(back.output, there.output)


@given(
    st.lists(st.floats(0.1, 2.0), min_size=2, max_size=30),
    st.lists(st.floats(GAPS[0], GAPS[-1]), min_size=30, max_size=30),
    st.sampled_from(MOVING),
)
def test_inverse_undoes_predict_however_coarse(
    drive: list[float], gaps: list[float], gap_map: GapMap
) -> None:
    model = magnet(gap_map, in_0=0.0, out_0=-0.2)
    gap = gaps[: len(drive)]
    there = model.predict(drive, gap, history="conditioned:0,2,0,2,0.1")
    if there.flux_density.min() <= 0.0:
        return
    back = model.invert(there.output, gap, history="conditioned:0,2,0,2,0.1")
    assert np.abs(back.drive - np.array(drive)).max() < 1e-6 * I_MAX


def test_signed_output_is_inverted_on_both_branches() -> None:
    core = Model(
        "core",
        QUANTITIES["field"],
        QUANTITIES["flux_density"],
        {"M_s": 4e5, "a": 30.0, "k": 20.0, "c": 0.2, "alpha": 1e-5, "c_H": 1.0, "c_out": 1.0},
    )
    drive = 80.0 * np.sin(np.linspace(0.0, 20.0, 300))
    there = core.predict(drive)
    assert there.output.min() < -0.2
    assert np.abs(core.invert(there.output).drive - drive).max() < 1e-9 * 80.0


@pytest.mark.parametrize("gap_map", ["none", "scaling", "reluctance", "free"])
def test_settled_cycle_closes(gap_map: GapMap) -> None:
    model = magnet(gap_map)
    drive = up_and_down(1.5)
    once = model.predict(drive, 0.35e-3, history="settled")
    assert once.cycles > 0
    assert once.output[0] == pytest.approx(once.output[-1], rel=1e-9)
    twice = model.predict(np.concatenate([drive, drive]), 0.35e-3, history="settled")
    assert np.abs(twice.output[drive.size :] - once.output).max() < 1e-9 * once.output.max()
    assert model.predict(drive, 0.35e-3).output[0] != pytest.approx(once.output[0], rel=1e-3)


def test_settled_demand_gives_a_settled_drive() -> None:
    model = magnet()
    there = model.predict(up_and_down(1.5), 0.35e-3, history="settled")
    back = model.invert(there.output, 0.35e-3, history="settled")
    assert np.abs(back.drive - there.drive).max() < 1e-6 * I_MAX


def test_conditioning_is_the_drive_it_names() -> None:
    model = magnet()
    drive = up_and_down(1.2)
    before = np.concatenate([up_and_down(2.0), up_and_down(2.0)[1:]])
    whole = model.predict(np.concatenate([before, drive]), 0.5e-3).output[before.size :]
    short = model.predict(drive, 0.5e-3, history="conditioned:0,2,0,2,0").output
    assert np.abs(short - whole).max() < 1e-9 * whole.max()


def test_history_of_the_model_is_the_default() -> None:
    model = replace(magnet(), history=History("settled"))
    drive = up_and_down(1.0)
    assert model.predict(drive, 0.3e-3).history == History("settled")
    same = magnet().predict(drive, 0.3e-3, history="settled")
    assert np.array_equal(model.predict(drive, 0.3e-3).output, same.output)


def test_force_is_even_and_offset() -> None:
    model = magnet(in_0=0.0, out_0=0.5)
    drive = up_and_down(2.0)
    plus, minus = model.predict(drive, 0.3e-3), model.predict(-drive, 0.3e-3)
    assert np.array_equal(plus.output, minus.output)
    assert plus.output[0] == 0.5
    assert plus.output.max() > 20.0


def test_eddy_currents_widen_a_fast_loop_and_not_a_slow_one() -> None:
    model, drive = magnet(gamma=0.5), up_and_down(2.0)
    still = magnet().predict(drive, 0.4e-3, history="settled").output

    def apart(seconds: float) -> float:
        time = np.linspace(0.0, seconds, drive.size)
        return float(np.abs(model.predict(drive, 0.4e-3, time, "settled").output - still).max())

    assert apart(1e6) < 1e-6 * still.max()
    assert apart(0.01) > 10.0 * apart(1.0) > 0.0


def test_a_gap_without_effect_may_be_omitted() -> None:
    model = magnet("none")
    drive = up_and_down(1.0)
    assert np.array_equal(model.predict(drive).output, model.predict(drive, 0.5e-3).output)


def test_a_free_map_starts_anew_after_a_gap_step() -> None:
    model = magnet("free")
    drive = up_and_down(1.0)
    gap = np.repeat([0.3e-3, 0.5e-3], drive.size)
    both = model.predict(np.concatenate([drive, drive]), gap)
    apart = [model.predict(drive, g).output for g in (0.3e-3, 0.5e-3)]
    assert np.array_equal(both.output, np.concatenate(apart))
    assert any("starts with the history again" in warning for warning in both.warnings)


def test_a_free_map_refuses_a_moving_gap() -> None:
    time, drive, gap = wave()
    with refused("schedule-moves: sample 1; c_H"):
        magnet("free").predict(drive, gap, time)


def test_free_map_that_varies_only_around_the_iron_may_move() -> None:
    model = magnet("free", k=300.0)
    _, drive, gap = wave()
    assert np.array_equal(model.predict(drive, gap).output, magnet("scaling").predict(drive, gap).output)


@pytest.mark.parametrize(
    ("current", "gap", "inside", "said"),
    [
        (I_MAX, 0.4e-3, True, ""),
        (2.5, 0.6e-3, False, "valid range of current, 0 to 2 A (first: sample 1, 2.5 A)"),
        (1.0, 0.7e-3, False, "valid range of gap, 0.0003 to 0.0006 m (first: sample 0, 0.0007 m)"),
    ],
)
def test_samples_outside_the_valid_range_are_flagged(
    current: float, gap: float, inside: bool, said: str
) -> None:
    result = magnet().predict([0.0, current], gap)
    assert result.valid[1] == inside
    assert said in " ".join(result.warnings)
    assert np.isfinite(result.output).all()


def test_computed_values_outside_the_valid_range_are_flagged() -> None:
    model = replace(magnet(), valid=ValidRange((0.0, 1.0), (0.0, 20.0), (GAPS[0], GAPS[-1])))
    high = model.predict(up_and_down(1.0), GAPS[0])
    assert high.output.max() > 21.0
    assert np.array_equal(high.valid, high.output <= 20.4)
    back = replace(model, valid=ValidRange((0.0, 0.4), (0.0, 20.0), (0.0, 1.0)))
    assert not back.invert([0.0, 20.0], GAPS[-1]).valid[1]  # needs 0.5 A


def test_a_demand_below_the_least_output_is_flagged() -> None:
    result = magnet(out_0=0.5).invert([1.0, 0.2, 1.0], 0.4e-3)
    assert result.valid.tolist() == [True, False, True]
    assert result.flux_density[1] == 0.0
    assert result.output[1] == 0.5
    assert "demand an output that is too low for every drive (first: sample 1, 0.2 N)" in result.warnings[0]


def test_settling_an_open_record_is_reported() -> None:
    result = magnet().predict(np.linspace(0.0, 2.0, 50), 0.4e-3, history="settled")
    assert any("does not end where it starts" in warning for warning in result.warnings)


@pytest.mark.parametrize(
    ("arguments", "reason"),
    [
        ({"drive": []}, "wrong-shape drive"),
        ({"drive": [0.0, np.nan], "schedule": 3e-4}, "not-finite drive: sample 1"),
        ({"drive": [0.0, 1.0], "schedule": [3e-4]}, "length-differs schedule"),
        ({"drive": [0.0, 1.0]}, "schedule-missing: gap_m"),
        ({"drive": [0.0], "schedule": 3e-4, "history": "warm"}, "unknown-history history: 'warm'"),
        ({"drive": [0.0], "schedule": -1e-2}, "too-far-beyond-nodes rho"),
        ({"drive": [0.0, 1e9], "schedule": 3e-4}, "sample-refused drive: sample 1; 1e+09"),
    ],
)
def test_bad_input_is_refused_with_the_sample(arguments: dict[str, object], reason: str) -> None:
    with refused(reason):
        magnet().predict(**arguments)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("time", "reason"), [(None, "time-missing"), ([0.0, 1.0, 1.0], "time-not-rising time: sample 2")]
)
def test_eddy_currents_need_time(time: list[float] | None, reason: str) -> None:
    with refused(reason):
        magnet(gamma=0.5).predict([0.0, 1.0, 0.0], 3e-4, time)


def test_a_cycle_too_small_to_close_is_a_negative_result() -> None:
    model = magnet("none", k=4e5)
    with refused("cycle-does-not-close", NegativeResult):
        model.predict([1e-7, 2e-7, 1e-7], history="settled")


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"k": -1.0}, "out-of-range k"),
        ({"c": 1.5}, "out-of-range c"),
        ({"alpha": 1.0}, "out-of-range alpha"),
        ({"r_d": -1.0}, "out-of-range r_d"),
        ({"rho": (1.0, 2.0)}, "length-differs rho"),
        ({"k": (1.0, 2.0, 3.0)}, "may-not-vary k: 'reluctance'"),
        ({"M_s": np.inf}, "out-of-range M_s"),
        ({"kappa": 1.0}, "extra-forbidden kappa"),
    ],
)
def test_impossible_parameters_are_refused(changes: dict[str, Parameter], reason: str) -> None:
    with refused(reason):
        magnet("reluctance", **changes)


def test_parameters_the_core_refuses_are_bad_input() -> None:
    with refused("parameters-out-of-range parameters: 0.001; 1000"):
        magnet(k=1e9).predict([0.0], 3e-4)


def test_both_laws_agree_without_a_reversible_part() -> None:
    models = [replace(magnet("none", c=0.0), law=law) for law in ("effective-field", "jiles-atherton-1986")]
    one, other = (model.predict(up_and_down(2.0, 400)).output for model in models)
    assert np.abs(one - other).max() < 1e-4 * one.max()


def test_parameters_at_a_node_equal_the_node_values() -> None:
    at = magnet().parameters_at(GAPS[1])
    assert at["rho"] == 0.0053
    assert at["c_H"] == 9000.0
    assert at["gamma"] == 0.0


def test_models_compare_and_pickle_by_value() -> None:
    model = magnet()
    model.predict([0.0, 1.0], 3e-4)  # fills the caches
    assert pickle.loads(pickle.dumps(model)) == model == magnet()
    assert model != magnet(k=301.0)


@pytest.mark.parametrize("gap_map", ["scaling", "reluctance", "free"])
def test_a_model_with_force_rising_as_the_gap_closes_is_accepted(gap_map: GapMap) -> None:
    check = magnet(gap_map, in_0=0.0).check_over_gap()
    assert check is not None
    assert check.passed, check.text("A")
    assert "rises as the gap closes" in check.text("A")


@pytest.mark.parametrize("law", ["effective-field", "play-cells"])
def test_turning_points_at_another_gap_follow_the_drive_at_that_gap(law: str) -> None:
    """At a large gap, no current reaches the flux that the iron had at a small gap."""
    cells: dict[str, Parameter] = {"M_0": 2e5, "a_0": 400.0, "M_1": 1e6, "a_1": 400.0, "k_1": 300.0,
                                   "s_1": 2.0}  # fmt: skip
    model = magnet("reluctance", in_0=0.0)
    if law == "play-cells":
        rest = {name: model.parameters[name] for name in ("c_H", "rho", "c_out", "out_0")}
        model = replace(model, law=law, parameters=cells | rest)
    drive = 0.8 - up_and_down(0.7, 30)
    before, gaps = np.array([0.0, 0.8, 0.8]), np.array([3e-4, 3e-4, 6e-4])
    past = "conditioned:0,0.8@0.0003;0.8"
    found = model.predict(drive, 6e-4, history=past)
    at = np.concatenate([gaps, np.full(drive.size, 6e-4)])
    whole = model.predict(np.concatenate([before, drive]), at, history="demagnetised").output
    np.testing.assert_allclose(found.output, whole[3:], rtol=1e-12)
    assert History.parse(str(found.history)) == found.history
    here = model.predict(drive, 6e-4, history="conditioned:0,0.8").output
    assert np.abs(here - found.output).max() > 0.05 * found.output.max()


def test_model_that_overshoots_between_the_gaps_is_refused() -> None:
    model = magnet("scaling", c_H=(5000.0, 7000.0, 4000.0), in_0=0.0)
    check = model.check_over_gap()
    assert check is not None
    assert not check.passed
    assert check.gap == pytest.approx(GAPS[0])
    assert "falls as the gap closes: by" in check.text("A")


def test_offsets_of_sensors_that_differ_from_gap_to_gap_are_no_fall_of_the_force() -> None:
    """This applies to plausible sensor offsets; larger ones are a fault of the model."""
    sensors = {"in_0": (0.01, 0.03, -0.01), "out_0": (-0.5, 0.7, 0.3)}
    plain, dirty = (magnet("circuit", **one).check_over_gap() for one in ({"in_0": 0.0}, sensors))
    assert plain is not None
    assert dirty is not None
    assert plain.passed
    assert dirty.passed, dirty.text("A")
    for large in ({"out_0": (-9.0, 9.0, 0.0)}, {"in_0": (0.5, 0.0, 0.0)}):
        check = magnet("circuit", **{"in_0": 0.0} | large).check_over_gap()
        assert check is not None
        assert not check.passed


@pytest.mark.parametrize("changes", [{"schedule": None, "nodes": ()}, {"valid": None}, {}])
def test_acceptance_test_without_a_gap_does_not_apply(changes: dict[str, object]) -> None:
    model = replace(magnet("none"), **changes)  # type: ignore[arg-type]
    assert model.check_over_gap() is None
