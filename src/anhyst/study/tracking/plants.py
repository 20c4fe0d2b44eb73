"""Stages that are not what was calibrated: what each error costs every variant, and all of them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

from anhyst.compensate.interface import MethodName
from anhyst.rig.bearing.drift import Drift
from anhyst.rig.bearing.make_setup import IdentifiedMagnet
from anhyst.rig.file import RigFile
from anhyst.rig.stage.file import StageRig, unit_of
from anhyst.rig.stage.loop import Feedforward, StageSetup, identify_stage, track
from anhyst.rig.stage.setpoint import motion_of
from anhyst.rig.tables import SPREADS_OF_BODY, SPREADS_OF_MAGNET
from anhyst.study.engine.monte_carlo import PlantFigure, Plants
from anhyst.study.tracking.learner import at_work
from anhyst.study.tracking.measures import cross_talk, measure, still_axes
from anhyst.study.tracking.simulate import (
    LEARNING,
    OWN,
    check_calibration,
    make_variants,
    refuse_unstable,
    settle,
)
from anhyst.support.jobs import all_of
from anhyst.support.progress import Progress

ERRORS: Mapping[str, tuple[str, ...]] = {
    "none": (),
    "gap zero": ("gap_offset",),
    "current scale": ("first_scale", "second_scale"),
    "pinning": ("pinning",),
    "Hall gain": ("flux_gain",),
    "eddy lag": ("eddy",),
    "all": (
        *("gap_offset", "first_scale", "second_scale"),
        *("pinning", "flux_gain", "eddy", "conductivity", "mass", "cable"),
    ),
}
"""What a plant has drifted in, case by case."""


ERRORS_OF_AXES: Mapping[str, tuple[str, ...]] = {
    **{name: ERRORS[name] for name in ("none", "gap zero")},
    "current scale": ("first_scale",),
    **{name: ERRORS[name] for name in ("pinning", "Hall gain")},
    "centre of mass": tuple(f"place_{axis}" for axis in "xyz"),
    "payload": ("mass",),
    "head positions": ("heads",),
    "all": (*SPREADS_OF_MAGNET, *SPREADS_OF_BODY, "heads"),
}
"""The same of a body of several coordinates, of all its magnets at once."""


def errors_of(file: RigFile) -> Mapping[str, tuple[str, ...]]:
    """Return the cases of a stage: those of all, and of solid iron its own."""
    if file.several:
        return ERRORS_OF_AXES
    return {**ERRORS, "conductivity": ("conductivity",)} if file.magnet.solid else ERRORS


def stage_plants(
    rig: StageRig,
    magnet: IdentifiedMagnet | None = None,
    names: Sequence[MethodName] = (),
    progress: Progress | None = None,
) -> Plants:
    """Return what plants of a stage are run with: variants with the gains of the calibrated one."""
    check_calibration(rig)
    known = magnet or identify_stage(rig)
    made, _ = make_variants(rig, known, names)
    refuse_unstable(made[OWN])
    gains = all_of(partial(_find, known), list(made.values()), progress)
    cases = tuple(errors_of(rig.settings)), "error"
    return Plants(
        file=rig.settings,
        work=StageWork(known, made, dict(zip(made, gains, strict=True))),
        methods=tuple(made),
        own=OWN,
        figures=(
            PlantFigure("average_m", "moving average", "nm", 1e9, *cases),
            PlantFigure("peak_m", "peak", "nm", 1e9, *cases),
            PlantFigure("settling_50_s", "settling to 50 nm", "ms", 1e3, *cases),
            *(
                PlantFigure(f"{axis}_{unit_of(axis)}", f"{axis}, largest", unit, 1e9, *cases)
                for axis, unit in ((one, f"n{unit_of(one)}") for one in still_axes(rig.settings))
            ),
        ),
        read=tuple(rig.measured.files),
        depends={},
        seed=rig.settings.seed,
    )


def _find(magnet: IdentifiedMagnet, setup: StageSetup) -> Feedforward:
    return settle(setup, magnet)[0]


@dataclass(frozen=True)
class StageWork:
    """Variants and their gains."""

    magnet: IdentifiedMagnet
    setups: Mapping[MethodName, StageSetup]
    gains: Mapping[MethodName, Feedforward]

    def run(self, method: MethodName, drift: Drift, noise: int) -> dict[str, Any]:
        """Follow the test set-point with each error alone and with all of them.

        A stage that calibrates itself has worked on the training set-point before.
        """
        setup, gains = self.setups[method], self.gains[method]
        scan = setup.rig.settings.scan
        motion = motion_of(scan, scan.test_m_per_s2)
        found: dict[str, list[float]] = {}
        for names in errors_of(setup.rig.settings).values():
            plant = replace(setup, drift=drift.alone(names))
            learner = at_work(plant, self.magnet, gains, noise + LEARNING)
            run = track(learner.stage(plant.drift) if learner else plant, motion, gains, noise)
            if run.loss is not None:
                return {"lost_s": run.dt * run.loss.tick}
            measures = measure(run, motion, scan.slit_s)
            for key in ("average_m", "peak_m", "settling_50_s"):
                found.setdefault(key, []).append(getattr(measures, key))
            for axis, largest in cross_talk(run, motion, still_axes(setup.rig.settings)).items():
                found.setdefault(f"{axis}_{unit_of(axis)}", []).append(largest)
        return found
