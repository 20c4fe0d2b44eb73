"""The bundled stage with short set-points; its magnets are those of the bundled bearing."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

from anhyst.compensate.interface import MethodName
from anhyst.rig.stage.file import StageRig, read_stage
from anhyst.rig.stage.loop import StageSetup
from anhyst.rig.stage.make_setup import make_stage
from anhyst.rig.stage.setpoint import SetPoint, motion_of
from anhyst.study.tracking.simulate import TrackingStudy, explore_stage
from tests.study import bearings

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "stage"
SHORT = {
    "speed_m_per_s": 0.25,
    "cruise_s": 0.03,
    "train_m_per_s2": [22.0, 12.0],
    "test_m_per_s2": [22.0, 10.0, 18.0],
    "noise_seeds": 2,
}


def stage(substeps: int = 8, **changes: Any) -> StageRig:
    rig = read_stage(EXAMPLE / "rig.toml")
    update = {
        "timing": rig.settings.timing.model_copy(update={"substeps": substeps}),
        "tracking": rig.settings.tracking.model_copy(update=SHORT | changes),
    }
    return replace(rig, settings=rig.settings.model_copy(update=update))


def setup(method: MethodName, substeps: int = 8, **changes: Any) -> StageSetup:
    return make_stage(stage(substeps, **changes), bearings.knowledge(), method)


def unseen(rig: StageRig) -> SetPoint:
    """SetPoint on which nothing was tuned."""
    return motion_of(rig.settings.tracking, rig.settings.tracking.test_m_per_s2)


@cache
def study() -> TrackingStudy:
    """The compensator and what it is measured against."""
    return explore_stage(stage(), bearings.knowledge(), ("single-valued", "play", "full"))
