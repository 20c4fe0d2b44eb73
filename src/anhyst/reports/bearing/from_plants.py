"""From plants that have drifted to what their report is about."""

from __future__ import annotations

import hashlib
import math

import numpy as np

from anhyst.compensate.interface import MethodName
from anhyst.control.controller_file import ControllerFile
from anhyst.reports.bearing.look import ordered
from anhyst.reports.bearing.over_runs import Spread
from anhyst.reports.bearing.subject import SimulationSubject
from anhyst.rig.bearing.file import BearingRig
from anhyst.study.bearing.drift import Drift
from anhyst.study.bearing.monte_carlo import FIGURES, MonteCarlo
from anhyst.support.page.blocks import Items, Note
from anhyst.support.page.numbers import MINUS, NBSP, number

_SHOWN = {"overshoot_percent": ("overshoot, {} (%)", 1.0), "settling_s": ("settling, {} (ms)", 1e3)}


def subject_of_plants(
    rig: BearingRig, controller: ControllerFile, found: MonteCarlo, command: str
) -> SimulationSubject:
    """Gather what the report of a Monte Carlo shows."""
    own = controller.settings.compensation.variant
    return SimulationSubject(
        rig=rig,
        controller=controller.settings,
        seeds=0,
        drift=tuple(_spreads(found)),
        plants=len(found.drifts),
        blocks={"drift": (_worst(found, own),)},
        notes=tuple(_lost(found)),
        files={
            path.name: hashlib.sha256(path.read_bytes()).hexdigest()
            for path in (rig.path, controller.path, *rig.measured.files)
        },
        command=command,
    )


def _spreads(found: MonteCarlo) -> list[Spread]:
    """Return every figure over the plants: first those of steps, height by height."""
    made = []
    for name in FIGURES[:2]:
        title, factor = _SHOWN[name]
        for place, height in enumerate(found.heights):
            values = {
                variant: factor * np.array(found.values(variant, name, place))
                for variant in found.runs
            }
            made.append(Spread(title.format(f"{1e6 * height:g}{NBSP}µm"), values))
    rest = {
        variant: 1e9 * np.array(found.values(variant, "standstill_rms_m")) for variant in found.runs
    }
    return [*made, Spread("standstill, rms (nm)", rest)]


def _lost(found: MonteCarlo) -> list[Note]:
    fallen = {
        name: sum(run.lost is not None for run in found.runs[name]) for name in ordered(found.runs)
    }
    counts = [f"{name}: {count} of {len(found.drifts)} plants" for name, count in fallen.items()]
    if not any(fallen.values()):
        return [Note("good", "Levitation", f"No plant was lost ({'; '.join(counts)}).")]
    return [Note("bad", "Levitation lost", f"{'; '.join(counts)}.")]


def _worst(found: MonteCarlo, variant: MethodName) -> Items:
    """Say what the worst plants of a variant have in common with nobody else: their drift."""
    rows = []
    for place, height in enumerate(found.heights):
        values = found.values(variant, "overshoot_percent", place)
        worst = int(np.argmax(values))
        much = f"overshoot of {number(values[worst], 2)}{NBSP}%"
        if not math.isfinite(values[worst]):
            much = "levitation lost"
        rows.append(
            f"step of {1e6 * height:g}{NBSP}µm, {much}: plant {worst}, "
            f"{_drift_text(found.drifts[worst])}"
        )
    return Items(f"Worst plants of {variant}", tuple(rows))


def _drift_text(drift: Drift) -> str:
    given = drift.as_dict()
    offset = 1e6 * given.pop("gap_offset_m")
    changes = [
        f"{name.removesuffix('_percent').replace('_', ' ')} {value:+.1f}{NBSP}%"
        for name, value in given.items()
    ]
    return f"{', '.join(changes)}, gap offset {offset:+.2f}{NBSP}µm".replace("-", MINUS)
