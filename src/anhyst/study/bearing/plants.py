"""Bearings that have drifted: lift off, step up and down by every height, hold position."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from anhyst.compensate.interface import MethodName
from anhyst.control.controller_file import ControllerFile
from anhyst.rig.bearing.drift import Drift, drifted_bearing, drifted_file
from anhyst.rig.bearing.file import BearingRig
from anhyst.rig.bearing.loop import Setup, SimulatedLoop, lost_at
from anhyst.rig.bearing.make_setup import make_setups
from anhyst.rig.bearing.scenario import Scenario, steps_up_and_down
from anhyst.rig.file import RigFile
from anhyst.rig.recording import Recording
from anhyst.study.bearing.metrics import step_figures
from anhyst.study.bearing.ready import make_ready
from anhyst.study.bearing.responses import position_resolution
from anhyst.study.engine.monte_carlo import PlantFigure, Plants

STANDSTILL_S = 0.25
COMPARED: tuple[MethodName, ...] = ("ratio", "single-valued")
"""Compared with the variant of the controller file: without compensation, and without memory."""


def bearing_plants(
    rig: BearingRig,
    controller: ControllerFile,
    methods: Sequence[MethodName] | None = None,
    seed: int | None = None,
) -> Plants:
    """Return what plants of a bearing are run with; the controller is that of the nominal one."""
    own = controller.settings.compensation.variant
    names = tuple(dict.fromkeys((*COMPARED, own))) if methods is None else tuple(methods)
    ready = make_ready(rig, controller)
    setups = make_setups(ready.rig, controller, ready.knowledge(), names)
    heights = tuple(rig.settings.step.heights_m), "height_m"
    files = [*rig.measured.files, rig.model, rig.flux_table, controller.model]
    return Plants(
        file=ready.rig.settings,
        work=BearingWork(setups),
        methods=names,
        own=own if own in names else names[-1],
        figures=(
            PlantFigure("overshoot_percent", "overshoot", "%", 1.0, *heights),
            PlantFigure("settling_s", "settling", "ms", 1e3, *heights),
            PlantFigure("standstill_rms_m", "standstill, rms", "nm", 1e9),
        ),
        read=tuple(path for path in files if path is not None),
        depends={"controller": controller.settings.model_dump_json()},
        seed=rig.settings.seed if seed is None else seed,
    )


@dataclass(frozen=True)
class BearingWork:
    """Controllers that hold a bearing, by method."""

    setups: Mapping[MethodName, Setup]

    def run(self, method: MethodName, drift: Drift, noise: int) -> dict[str, Any]:
        """Judge one plant; what lost levitation has no figures."""
        setup = self.setups[method]
        rig, tried = setup.rig, setup.rig.settings
        scenario = steps_up_and_down(
            rig, setup.controller, tried.gap_m, tried.step.heights_m, rest=STANDSTILL_S
        )
        loop = SimulatedLoop(setup, bearing=drifted_bearing(rig, drift, noise))
        recording = loop.run(scenario)
        lost = lost_at(rig, recording, scenario.lifted)
        if lost is None and len(recording) < scenario.ticks:
            lost = float(recording["t_s"][-1])
        if lost is not None:
            return {"lost_s": lost}
        return _judge(rig, drifted_file(tried, drift), scenario, recording)


def _judge(
    rig: BearingRig, drifted: RigFile, scenario: Scenario, recording: Recording
) -> dict[str, Any]:
    """Judge what an ideal sensor with this gain and offset reads: an offset alone is no overshoot."""
    sensor = drifted.gap_sensor
    read = (1.0 + sensor.gain_error) * recording["gap_m"] + sensor.offset_m
    time, reference = recording["t_s"], recording["reference_m"]
    heights = drifted.step.heights_m
    overshoot, settling = [0.0] * len(heights), [0.0] * len(heights)
    for number, step in enumerate(scenario.steps):
        rows = slice(step.begin - 1, step.end)
        found = step_figures(time[rows], reference[rows], read[rows], position_resolution(rig))
        place = number // 2
        overshoot[place] = max(overshoot[place], found.overshoot)
        settling[place] = max(settling[place], found.settling_time_in_noise)
    rest = recording["gap_m"][-round(STANDSTILL_S / rig.dt) :]
    return {
        "overshoot_percent": overshoot,
        "settling_s": [one if math.isfinite(one) else None for one in settling],
        "standstill_rms_m": float(np.std(rest)),
    }
