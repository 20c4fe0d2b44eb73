"""Plants that are not what was calibrated: what the errors cost every variant."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from anhyst.compensate.interface import MethodName
from anhyst.rig.bearing.make_setup import identify_magnet
from anhyst.rig.stage.calibration import CALIBRATED, KINDS, CalibrationErrors, draw_errors
from anhyst.rig.stage.file import StageRig, read_stage
from anhyst.rig.stage.loop import Feedforward, StageSetup, track
from anhyst.rig.stage.setpoint import motion_of
from anhyst.study.tracking.measures import Measures, measure
from anhyst.study.tracking.simulate import OWN, find_gains, make_variants, refuse_unstable
from anhyst.support.atomic import PathLike, atomic_writer, check_writable
from anhyst.support.errors import InputError
from anhyst.support.jobs import all_of
from anhyst.support.json_text import json_text
from anhyst.support.progress import Progress

_DRAWN = {"gap_zero_m", "current_percent", "pinning_percent", "hall_percent", "eddy_s"}
_STREAM = 5
"""Of the random numbers, apart from those of the noise."""


@dataclass(frozen=True)
class CalibrationStudy:
    """What errors of the calibration cost.

    Parameters
    ----------
    rig : StageRig
    plants : int
        Of each kind of error.
    runs : mapping
        By variant and kind of error; the kind ``"none"`` has one run.
    """

    rig: StageRig
    plants: int
    runs: Mapping[MethodName, Mapping[str, tuple[Measures, ...]]]

    def percentile(self, variant: MethodName, kind: str, name: str, percent: float) -> float:
        """Return what so many per cent of the plants stay below."""
        values = [getattr(one, name) for one in self.runs[variant][kind]]
        return float(np.percentile(values, percent))

    @property
    def figures(self) -> dict[str, Any]:
        """Content of the file."""
        return {
            "format": "anhyst-tracking-calibration",
            "rig": self.rig.settings.name,
            "plants": self.plants,
            "one_sigma": self.rig.settings.spread.model_dump(include=_DRAWN),
            "variants": {
                name: {
                    kind: {
                        measured: {
                            f"percentile_{percent}": self.percentile(name, kind, measured, percent)
                            for percent in (50, 95)
                        }
                        for measured in ("peak_m", "average_m", "settling_50_s")
                    }
                    for kind in kinds
                }
                for name, kinds in self.runs.items()
            },
        }


@dataclass(frozen=True)
class _Job:
    setup: StageSetup
    plants: int


def _drawn(rig: StageRig, plants: int) -> dict[str, list[CalibrationErrors]]:
    """Return the plants: the same for every variant."""
    found = {"none": [CALIBRATED]}
    for kind in KINDS:
        rng = np.random.default_rng([rig.settings.seed, _STREAM])
        found[kind] = [draw_errors(rig.settings.spread, kind, rng) for _ in range(plants)]
    return found


def _try(job: _Job) -> dict[str, tuple[Measures, ...]]:
    """Judge one variant, with the gains of the plant that was calibrated, on all of them."""
    rig = job.setup.rig
    table = rig.settings.scan
    gains: Feedforward = find_gains(job.setup, motion_of(table, table.train_m_per_s2))
    motion = motion_of(table, table.test_m_per_s2)
    return {
        kind: tuple(
            measure(track(replace(job.setup, errors=one), motion, gains, 1), motion, table.slit_s)
            for one in errors
        )
        for kind, errors in _drawn(rig, job.plants).items()
    }


def calibrate_wrongly(
    path: PathLike, out: PathLike, plants: int, progress: Progress | None = None
) -> CalibrationStudy:
    """Read a rig file, try every variant on plants that were calibrated wrongly, write the figures."""
    if Path(out).suffix != ".json":
        raise InputError(
            f"{out}: wrong calibrations are written as .json; name it so", code="wrong-ending"
        )
    check_writable(out)
    rig = read_stage(path)
    made, _ = make_variants(rig, identify_magnet(rig.measured.read(), rig.settings.loops))
    refuse_unstable(made[OWN])
    runs = all_of(_try, [_Job(setup, plants) for setup in made.values()], progress)
    found = CalibrationStudy(rig, plants, dict(zip(made, runs, strict=True)))
    with atomic_writer(out) as stream:
        stream.write(json_text(found.figures))
    return found
