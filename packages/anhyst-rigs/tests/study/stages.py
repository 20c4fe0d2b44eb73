"""The bundled stage with short set-points and with the magnets of the bundled bearing."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from typing import Any

from anhyst.support.kinds import MethodName
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.drift import Drift
from anhyst_rigs.rig.recording import Recording
from anhyst_rigs.rig.stage.file import read_stage
from anhyst_rigs.rig.stage.fitted import make_stage
from anhyst_rigs.rig.stage.loop import Feedforward, StageSetup, track
from anhyst_rigs.rig.stage.setpoint import SetPoint, scan_motion
from anhyst_rigs.rig.tables import FrameTable
from anhyst_rigs.study.tracking.simulate import TrackingStudy, explore_stage
from tests.repository import ROOT
from tests.study import bearings

EXAMPLE = ROOT / "examples" / "stage"
SHORT_SCAN = {
    "speed_m_per_s": 0.25,
    "cruise_s": 0.03,
    "train_m_per_s2": [22.0, 12.0],
    "test_m_per_s2": [22.0, 10.0, 18.0],
}

WRONG_DRIFT = Drift(
    magnets=(
        Drift(pinning=0.12, gap_offset=0.5e-6, first_scale=0.007, flux_gain=0.006),
        Drift(pinning=0.12, gap_offset=-0.5e-6, first_scale=-0.005, flux_gain=0.006),
    ),
    eddy=40e-6,
)
"""Drift of a plant with an error in every quantity."""


def stage(substeps: int = 8, stray_m: float | None = None, **control: Any) -> BodyRig:
    """Return the example with changed sub-steps, stray field, or keys of [control]."""
    rig = read_stage(EXAMPLE / "rig.toml")
    file = rig.settings
    update: dict[str, Any] = {
        "timing": file.timing.model_copy(update={"substeps": substeps}),
        "control": file.control.model_copy(update=control),
        "noise_seeds": 2,
    }
    if stray_m is not None:
        update["frame"] = FrameTable(stray_m=stray_m)
    short_file = file.with_table_replaced(file.scan, file.scan.model_copy(update=SHORT_SCAN))
    return replace(rig, settings=short_file.model_copy(update=update))


def setup(method: MethodName, substeps: int = 8, **changes: Any) -> StageSetup:
    return make_stage(stage(substeps, **changes), bearings.knowledge(), method)


def evaluation_set_point(rig: BodyRig) -> SetPoint:
    """Set-point that is not used for tuning."""
    return scan_motion(rig.settings.scan, rig.settings.scan.test_m_per_s2)


@cache
def study() -> TrackingStudy:
    """The compensator and its baselines."""
    return explore_stage(stage(), bearings.knowledge(), ("single-valued", "play", "full"))


def training() -> SetPoint:
    """Set-point for the estimation of parameters."""
    scan = stage().settings.scan
    return scan_motion(scan, scan.train_m_per_s2)


@cache
def recorded(drift: Drift = WRONG_DRIFT) -> Recording:
    """Return the motion of a plant with the identified compensator."""
    return track(replace(setup("full"), drift=drift), training(), Feedforward(), 1)
