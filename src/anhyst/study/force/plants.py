"""Actuators that have drifted, their force controlled open loop by what was made for the nominal one.

The compensators run as they are compiled, without firmware and link: those change no bit.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from anhyst.compensate.force_controller import ForceController
from anhyst.compensate.interface import MethodName
from anhyst.compensate.methods import make_compensator
from anhyst.compensate.sources import Operating, Sources
from anhyst.model.actuator import Model
from anhyst.rig.bearing.drift import Drift, drifted_file
from anhyst.rig.force.bench import ActuatorBench, read_gaps, run_open_loop
from anhyst.rig.force.file import Rig
from anhyst.rig.force.modelling import find_model, loops_of_rig
from anhyst.rig.force.session import triangle
from anhyst.rig.from_loops import complete_rig
from anhyst.rig.recording import peak, rms
from anhyst.study.engine.monte_carlo import PlantFigure, Plants
from anhyst.study.force.trials import ForceTrial, plan_trials

COMPARED: tuple[MethodName, ...] = ("ratio", "single-valued", "full")


def force_plants(given: Rig, model: Model | None = None) -> Plants:
    """Return what plants of a force rig are run with: at every position, and moving."""
    loops = loops_of_rig(given)
    rig = complete_rig(given, loops)
    model, settings = model or find_model(rig, loops), rig.settings
    gaps = sorted(gap for gap in loops.by_schedule() if gap is not None)
    force_max = settings.force.force_max_N
    operating = Operating(
        gap=0.5 * (gaps[0] + gaps[-1]),
        force=0.5 * force_max,
        rate=settings.timing.rate_Hz,
        gap_range=(gaps[0], gaps[-1]),
        force_max=force_max,
        current_max=settings.amplifier.current_high_A,
    )
    sources = Sources(operating, loops, model)
    cases = tuple(trial.name for trial in _trials(rig)), "trial"
    files = [*rig.measured.files]
    if settings.solenoid is not None:
        files.append(rig.path.parent / settings.solenoid.file)
    return Plants(
        file=settings,
        work=ForceWork(rig, {name: make_compensator(name, sources, "fixed") for name in COMPARED}),
        methods=COMPARED,
        own="full",
        figures=(
            PlantFigure("rms_N", "force error, rms", "N", 1.0, *cases),
            PlantFigure("worst_N", "force error, worst", "N", 1.0, *cases),
        ),
        read=tuple(files),
        depends={},
        seed=settings.seed,
    )


def _trials(rig: Rig) -> list[ForceTrial]:
    force_max, rate = rig.settings.force.force_max_N, rig.settings.timing.rate_Hz
    demands = [triangle(shape, force_max, rate) for shape in rig.settings.force_triangles]
    return [trial for trial in plan_trials(rig, demands) if trial.stage != "end"]


@dataclass(frozen=True)
class ForceWork:
    """A rig and what was made for it."""

    rig: Rig
    compensators: Mapping[MethodName, ForceController]

    def run(self, method: MethodName, drift: Drift, noise: int) -> dict[str, Any]:
        """Control the force of a plant in every trial, from demagnetised."""
        plant = drifted_rig(self.rig, drift)
        found: dict[str, list[float]] = {"rms_N": [], "worst_N": []}
        for trial in _trials(self.rig):
            gap, seed = trial.gap(self.rig), [noise, trial.number]
            known = read_gaps(self.rig, gap, seed) + drift.gap_offset
            asked = self.compensators[method].fresh().run(trial.demand.force, known)
            bench = ActuatorBench(plant, gap, seed, unknown_past=False)
            force = run_open_loop(bench, (1.0 + drift.first_scale) * asked)["force_N"]
            error = (force - trial.demand.force)[trial.demand.lead_in :]
            found["rms_N"].append(rms(error))
            found["worst_N"].append(peak(error))
        return found


def drifted_rig(rig: Rig, drift: Drift) -> Rig:
    """Return a rig whose iron has drifted, in its own file or in that of its solenoid."""
    file = rig.solenoid_file
    if file is None:
        return replace(rig, settings=drifted_file(rig.settings, drift))
    iron = file.iron
    keys = iron.drifted(drift.pinning, drift.reversible, drift.saturation)
    return replace(
        rig, solenoid_file=file.model_copy(update={"iron": iron.model_copy(update=keys)})
    )
