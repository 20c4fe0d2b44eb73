"""Test a stage with a solid core: compensators with and without eddy currents."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from anhyst.data.speeds import group_by_speed
from anhyst.model.dynamics import Layers
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.drift import NO_DRIFT, Drift, change_rig, drifted_file, sample_drift
from anhyst_rigs.rig.fitting import IdentifiedMagnet, check_plant, identify_magnet
from anhyst_rigs.rig.magnet_table import SolidTable
from anhyst_rigs.rig.measuring import loop_file_texts, measure_loops
from anhyst_rigs.rig.stage.fitted import make_stage
from anhyst_rigs.rig.stage.loop import Feedforward, track
from anhyst_rigs.study.plants import ERROR_CASES, varied_errors
from anhyst_rigs.study.tracking.measures import Measures, measure
from anhyst_rigs.study.tracking.simulate import make_variants
from tests.study import bearings, stages

SOLID = SolidTable(depth_m=4e-3, conductivity_S_per_m=2e6, path_m=0.05)


def solid(**changes: Any) -> BodyRig:
    """Return the short example with solid iron, its compensators in double precision."""
    given = {"magnet.solid": SOLID, "control.format": "f64"}
    return change_rig(stages.stage(), given | changes)


@cache
def solid_magnet() -> IdentifiedMagnet:
    """The identified magnet with layers that are set by hand."""
    known = bearings.knowledge()
    parameters = {**known.model.parameters, "gamma": 60.0}
    return replace(known, model=replace(known.model, parameters=parameters, layers=Layers(3, 0.2, 0.5)))


@pytest.mark.slow
def test_the_quasi_static_variant_is_compared_only_for_solid_iron() -> None:
    names = ("full", "at-rest")
    made, _ = make_variants(solid(), solid_magnet())
    assert set(names) <= set(made)
    assert "at-rest" not in make_variants(solid(), bearings.knowledge())[0]


@pytest.mark.parametrize("number_format", ["f64", "fixed"])
def test_the_quasi_static_variant_is_the_compensator_of_thin_iron(number_format: str) -> None:
    rig = solid(**{"control.format": number_format})
    demand = 40.0 + 30.0 * np.sin(np.linspace(0.0, 12.0, 400))

    def run(magnet: IdentifiedMagnet, method: Any) -> np.ndarray:
        return make_stage(rig, magnet, method).compensator.run(demand, 0.45e-3)

    thin = run(bearings.knowledge(), "full")
    assert np.array_equal(run(solid_magnet(), "at-rest"), thin)
    assert np.abs(run(solid_magnet(), "full") - thin).max() > 1e-3 * thin.max()


def test_loops_of_further_speeds_are_measured_in_time() -> None:
    rig = solid(**{"measurement.fast_A_per_s": [45.0, 450.0], "measurement.gaps_m": [0.45e-3]})
    loops = measure_loops(rig)
    speeds = group_by_speed(loops)
    assert speeds is not None
    assert [len(group) for group in speeds.fast] == [1, 1]
    assert speeds.fastest_rate == pytest.approx(50.0, rel=0.02)
    assert loop_file_texts(loops, "")["loops.csv"].startswith("t_s,I_A,F_N,gap_m,loop\n0,")


def test_a_plant_is_compared_with_slow_loops_only() -> None:
    rig = solid(**{"measurement.fast_A_per_s": [450.0], "measurement.gaps_m": [0.45e-3]})
    known = replace(bearings.knowledge(), loops=measure_loops(rig))
    found = check_plant(rig, known)
    assert found.plant.mean_deviation < 0.004 * found.plant.force_max
    assert found.plant.max_deviation < 0.02 * found.plant.force_max


def test_conductivity_varies_only_for_solid_iron() -> None:
    file = solid().settings
    drawn = sample_drift(file, np.random.default_rng(1))
    assert drawn.conductivity != 0.0
    plain = sample_drift(stages.stage().settings, np.random.default_rng(1))
    assert replace(drawn, conductivity=0.0) == plain
    moved = drifted_file(file, Drift(conductivity=0.1)).magnet.solid
    assert moved is not None
    assert moved.conductivity_S_per_m == pytest.approx(2.2e6)
    plain_cases = varied_errors(stages.stage().settings)
    assert set(varied_errors(file)) - set(plain_cases) == {"conductivity"}
    assert {"gap zero", "eddy lag", "all"} < set(plain_cases) < set(ERROR_CASES)
    assert drawn.select(varied_errors(file)["all"]) == drawn


@pytest.mark.slow
def test_modelling_solid_iron_and_its_delay_reduces_the_error() -> None:
    """The loops come from the plant's simulated sensors at three speeds."""
    rig = solid(**{"measurement.fast_A_per_s": [45.0, 450.0], "force_sensor.bandwidth_Hz": 20e3})
    magnet = identify_magnet(measure_loops(rig), rig.settings.loops)
    motion, slit = stages.evaluation_set_point(rig), rig.settings.scan.slit_s

    def found(method: Any, drift: Drift = NO_DRIFT) -> Measures:
        made = replace(make_stage(rig, magnet, method), drift=drift)
        return measure(track(made, motion, Feedforward(), 1), motion, slit)

    full, still = found("full"), found("at-rest")
    assert full.average_m < still.average_m / 3.0
    assert full.force_rms_N < still.force_rms_N / 3.0
    assert found("full", Drift(conductivity=0.3)).force_rms_N > full.force_rms_N
