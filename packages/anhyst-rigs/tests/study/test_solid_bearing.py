"""Test a bearing with a solid core: simulated, compiled and run by a firmware with layers."""

from __future__ import annotations

import json
from contextlib import closing
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest

from anhyst.compensate.block import Block
from anhyst.compensate.methods import HysteresisInverse
from anhyst.compilation.manifest import controller_bytes, state_bytes
from anhyst.model.actuator import Model
from anhyst.support.kinds import MethodName
from anhyst_rigs.rig.bearing.loop import BearingSetup, make_setup
from anhyst_rigs.rig.bearing.scenario import plan_steps
from anhyst_rigs.rig.bench.bearing import BearingBench
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.drift import change_rig
from anhyst_rigs.rig.fitting import IdentifiedMagnet, identify_magnet
from anhyst_rigs.rig.loop import Scenario, SimulatedLoop
from anhyst_rigs.rig.magnet_table import SolidTable
from anhyst_rigs.rig.measuring import measure_loops
from anhyst_rigs.study.bearing.on_board import build_firmware, count_differences
from anhyst_rigs.study.bearing.responses import compare_steps
from anhyst_rigs.study.prepared_benches import PreparedBearing
from tests.refusals import refused
from tests.study import bearings
from tests.study.test_solid_stage import solid_magnet

METHODS: tuple[MethodName, ...] = ("full", "at-rest", "single-valued")
STEP = 50e-6
SOLID = SolidTable(depth_m=10e-3, conductivity_S_per_m=2e6, path_m=0.15)


@cache
def solid() -> BodyRig:
    """Return the example with solid iron in most of its magnetic path."""
    return change_rig(
        bearings.example(),
        {
            "magnet.solid": SOLID,
            "measurement.fast_A_per_s": [45.0, 450.0, 1350.0],
            "force_sensor.bandwidth_Hz": 20e3,
        },
    )


@cache
def known() -> IdentifiedMagnet:
    """Model identified from loops of the plant's simulated sensors."""
    return identify_magnet(measure_loops(solid()), solid().settings.loops)


def block_of(setup: BearingSetup) -> Block:
    parameters = setup.compensator.parameters
    assert isinstance(parameters, HysteresisInverse)
    assert isinstance(parameters.block, Block)
    return parameters.block


def steps(setup: BearingSetup) -> Scenario:
    return plan_steps(setup.rig, setup.controller, bearings.GAP, [STEP])


@pytest.mark.slow
def test_solid_iron_needs_layers_for_a_quiet_standstill(tmp_path: Path) -> None:
    table = bearings.controller().settings
    setups = [make_setup(solid(), table, known(), method, "fixed") for method in METHODS]
    cells = compare_steps(setups, [bearings.GAP], [STEP], [solid().static_load], [1, 2], jobs=1)
    full, still, single = cells
    assert full.lost == still.lost == 0
    assert single.lost == 2
    for figure in ("overshoot_percent", "standstill_rms_m", "force_error_rms_N"):
        assert full.interval(figure).mean < still.interval(figure).mean / 2.0

    setup, firmware = build_firmware(solid(), bearings.controller(), known(), "library", tmp_path)
    with closing(BearingBench(setup, firmware)) as running:
        assert count_differences(SimulatedLoop(setup).run(steps(setup)), running.run(steps(setup))) == 0
    manifest = json.loads((tmp_path / "c" / "manifest.json").read_text())
    block, thin = (block_of(one) for one in (setup, bearings.single()))
    assert manifest["controller"]["state_bytes"] == controller_bytes(1, block)
    deeper = state_bytes(block) - state_bytes(thin)
    assert controller_bytes(1, block) - controller_bytes(1, thin) == deeper > 0
    assert "rate" in {
        load["name"] for load in json.loads((tmp_path / "c" / "budget.json").read_text())["parts"]
    }


def test_a_board_accepts_only_as_many_layers_as_it_has_memories() -> None:
    thin = bearings.knowledge().model
    setup = make_setup(solid(), bearings.controller().settings, solid_magnet(), "full", "fixed")
    board = PreparedBearing(setup, solid_magnet().model, Path())
    layers = solid_magnet().model.layers
    assert layers is not None
    fewer, more = (replace(solid_magnet().model, layers=replace(layers, count=count)) for count in (2, 4))

    def layers_of(running: Model, model: Model) -> int:
        block = replace(board, model=running).compile(model).block
        assert isinstance(block, Block)
        return block.integer("SOLID_LAYERS")

    assert layers_of(solid_magnet().model, fewer) == 2
    assert layers_of(thin, solid_magnet().model) == 0
    with refused("rate-not-measured model"):
        layers_of(solid_magnet().model, thin)
    with refused("too-many-layers model"):
        layers_of(solid_magnet().model, more)
