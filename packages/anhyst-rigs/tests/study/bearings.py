"""Variants of the bundled bearing for all tests; slow results are cached."""

from __future__ import annotations

import shutil
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from anhyst.control.controller_file import ControllerFile, ControllerTable, read_controller, write_controller
from anhyst.support.kinds import MethodName, NumberFormat
from anhyst_rigs.rig.bearing.loop import BearingSetup, make_setup
from anhyst_rigs.rig.bearing.scenario import ScenarioBuilder
from anhyst_rigs.rig.body import BodyRig, read_bearing
from anhyst_rigs.rig.case_table import LoadCase
from anhyst_rigs.rig.drift import Drift, change_iron, change_rig, drifted_file
from anhyst_rigs.rig.fitting import IdentifiedMagnet
from anhyst_rigs.rig.loop import Scenario, SimulatedLoop
from anhyst_rigs.rig.magnet_table import OPENS_GAP, LikeTable
from anhyst_rigs.rig.measuring import measure_loops
from anhyst_rigs.rig.recording import HOVER_CODE, Recording
from anhyst_rigs.rig.sensor_table import FluxSensorTable, GapSensorTable
from anhyst_rigs.study.bearing.on_board import build_firmware
from tests.once import made_once
from tests.repository import ROOT
from tests.truths import truth

EXAMPLE = ROOT / "examples" / "bearing"
FORMATS: tuple[NumberFormat, ...] = ("f64", "f32", "fixed")
GAP = 0.45e-3
TOTAL = 2.0 * GAP
"""Sum of both gaps of the pair, m. The pair is symmetrical at `GAP`."""


@cache
def example() -> BodyRig:
    return read_bearing(EXAMPLE / "rig.toml")


@cache
def controller() -> ControllerFile:
    return read_controller(EXAMPLE / "controller.toml")


@cache
def knowledge(fraction: float = 0.15) -> IdentifiedMagnet:
    """Loops and model of the example with a given reversible fraction."""
    model = truth({0.15: "bearing", 0.3: "bearing-reversible"}[fraction])
    return IdentifiedMagnet(measure_loops(change_iron(example(), fraction)), model)


@cache
def single(
    variant: MethodName = "full", number_format: NumberFormat = "fixed", fraction: float = 0.15
) -> BearingSetup:
    """One magnet that pulls against the load."""
    rig = change_iron(example(), fraction)
    return make_setup(rig, controller().settings, knowledge(fraction), variant, number_format)


def copy_known(folder: Path) -> Path:
    """Copy the example with its identified model; return the rig file."""
    for name in ("rig.toml", "controller.toml", "loops.csv", "loops.toml"):
        shutil.copy(EXAMPLE / name, folder)
    truth("bearing").save(folder / "model.toml")
    file, variant = folder / "controller.toml", 'variant = "full"'
    text = file.read_text(encoding="utf-8")
    assert text.count(variant) == 1
    file.write_text(text.replace(variant, f'{variant}\nmodel = "model.toml"'), encoding="utf-8")
    return folder / "rig.toml"


def firmware(factory: pytest.TempPathFactory, board: str = "library") -> Path:
    """Firmware of the example for a board, built once for all tests."""

    def make(folder: Path) -> None:
        build_firmware(example(), controller(), knowledge(), board, folder)

    return made_once(factory, f"bearing-{board}", make) / "firmware"


@cache
def pair_rig() -> BodyRig:
    rig = change_rig(example(), {"control.bias_N": 75.0, "load.force_N": 0.0})
    file = rig.settings
    second = LikeTable(name="opposite", like="magnet", direction=OPENS_GAP, gap_m=TOTAL - GAP)
    cases = [case for case in file.cases if not isinstance(case, LoadCase)]
    update = {"magnets": [*file.magnets, second], "cases": cases}
    return replace(rig, settings=file.model_copy(update=update))


def pair_text(text: str, bias: float, second_gap: float = GAP) -> str:
    """The example's rig file with a second magnet."""
    second = f'name = "opposite"\nlike = "magnet"\ndirection = [1.0, 0.0, 0.0]\ngap_m = {second_gap}'
    for before, new in (
        ("[[amplifier]]", f"[[magnet]]\n{second}\n\n[[amplifier]]"),
        ('kind = "levitation"', f'kind = "levitation"\nbias_N = {bias}'),
    ):
        assert text.count(before) == 1
        text = text.replace(before, new)
    return text


def without_probe(rig: BodyRig) -> BodyRig:
    """The same rig without the Hall probe."""
    sensors = [sensor for sensor in rig.settings.sensors if not isinstance(sensor, FluxSensorTable)]
    return replace(rig, settings=rig.settings.model_copy(update={"sensors": sensors}))


def pair_controller() -> ControllerTable:
    table = controller().settings
    limits = table.limits.model_copy(update={"force_low_N": -150.0, "force_high_N": 150.0})
    return table.model_copy(update={"limits": limits})


def pair_file(path: Path, applied: str = "reference") -> ControllerFile:
    """Write the controller of the pair as a file that describes the magnets as the rig does."""
    own, rig = pair_controller(), pair_rig().settings
    compensation = own.compensation.model_copy(update={"applied": applied})
    table = type(own).model_validate(
        own.model_dump(exclude_none=True)
        | {
            "pair": {"bias_force_N": rig.bias_N, "gap_total_m": rig.gap_total_m},
            "compensation": compensation.model_dump(exclude_none=True),
        }
    )
    write_controller(path, table, "a pair")
    return ControllerFile(path, table)


@cache
def pair(variant: MethodName = "full", number_format: NumberFormat = "fixed") -> BearingSetup:
    """Two opposing magnets without an external load."""
    return make_setup(pair_rig(), pair_controller(), knowledge(), variant, number_format)


def with_rig(setup: BearingSetup, changes: dict[str, Any]) -> BearingSetup:
    """The same controller with a changed plant."""
    return BearingSetup(change_rig(setup.rig, changes), setup.compensator, setup.controller)


def sensor(kind: str, **given: float) -> GapSensorTable:
    """A position sensor with the range of the example's sensor."""
    own = example().settings.gap_sensor
    return GapSensorTable.model_validate(
        {"of": "gap", "kind": kind, "low_m": own.low_m, "high_m": own.high_m, **given}
    )


def lifted(setup: BearingSetup, gap: float = GAP) -> ScenarioBuilder:
    """A script that lifts off and then waits until the body hovers."""
    return ScenarioBuilder(setup.rig, gap).lift_off(setup.controller)


def run(setup: BearingSetup, scenario: Scenario, seed: int = 0) -> Recording:
    return SimulatedLoop(setup, seed).run(scenario)


def run_plant(setup: BearingSetup, script: ScenarioBuilder, seed: int = 0) -> Recording:
    return SimulatedLoop(setup, seed).run(script.build())


def hovers_from(recording: Recording) -> int | None:
    """Return the first tick in the hover state, or None."""
    hovering = recording["state"] == HOVER_CODE
    return int(np.argmax(hovering)) if hovering.any() else None


def drifted(rig: BodyRig, drift: Drift) -> BodyRig:
    """Return a rig with a drifted plant; an identified law does not change."""
    return replace(rig, settings=drifted_file(rig.settings, drift))
