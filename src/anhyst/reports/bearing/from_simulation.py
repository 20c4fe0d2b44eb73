"""From what ``simulate`` found, or its map of what compensation gains, to what a report is about."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from anhyst.compensate.force_controller import MethodName
from anhyst.control.controller_file import ControllerFile
from anhyst.data.speeds import slow_loops
from anhyst.reports.bearing.look import interval_text, ordered
from anhyst.reports.bearing.over_frequency import Response
from anhyst.reports.bearing.over_runs import BenefitCell
from anhyst.reports.bearing.over_time import StepPanel, identified_loop, nearest_loops
from anhyst.reports.bearing.subject import (
    FigureTable,
    Intervals,
    SimulationSubject,
    Tracking,
    grouped,
)
from anhyst.reports.bearing.tables import OVERSHOOT
from anhyst.rig.bearing.loop import Setup, SimulatedLoop, lost_at
from anhyst.rig.body import BodyRig
from anhyst.rig.distance import PlantCheck
from anhyst.rig.file import RigFile
from anhyst.rig.loop import ReferenceStep, Scenario
from anhyst.rig.recording import Recording
from anhyst.study.bearing import experiments
from anhyst.study.bearing.benefit import MEASURES, Benefit, Comparison, MapCell, Measure
from anhyst.study.bearing.operating import has_constants
from anhyst.study.bearing.simulate import Simulation
from anhyst.study.engine.verdict import Interval, no_mean
from anhyst.support.page.blocks import Note, PageTable, table
from anhyst.support.page.numbers import NBSP, NOT_KNOWN, number

_SHOWN = 0.03  # of a step, s
_COLUMNS = ("ratio", "single-valued", "full")  # whose forces are shown, beside the controller's own
_FREQUENCIES = 400


def subject_of(simulation: Simulation, command: str) -> SimulationSubject:
    """Gather what the report of a simulation shows; trajectories and loads are run once more."""
    rig, tried = simulation.rig, simulation.rig.settings
    steps = grouped(simulation.cells)
    up = [step for step in simulation.scenario.steps if step.after < step.before]
    here = {step.height: step for step in steps if step.gap == tried.gap_m}
    whole = simulation.scenario.ticks
    shown = {name: run for name, run in simulation.shown.items() if len(run) == whole}
    panels = tuple(
        StepPanel(
            step,
            shown,
            next(
                found.of(OVERSHOOT)
                for height, found in here.items()
                if np.isclose(height, step.height)
            ),
        )
        for step in up
    )
    still = experiments.standing(simulation.setups[simulation.own])
    chosen = {name: run for name, run in shown.items() if name in (*_COLUMNS, simulation.own)}
    linear_gain, linear_sensitivity = _linear(simulation)
    single = len(rig.magnets) == 1
    loops, current = slow_loops(simulation.knowledge.loops), rig.settings.measurement.current_max_A
    return SimulationSubject(
        rig=rig,
        controller=simulation.controller.settings,
        seeds=tried.noise_seeds,
        panels=panels,
        steps=steps,
        forces=_part(chosen, rig.dt, up[-1]),
        run=_part(chosen, rig.dt, up[-1]) if single else {},
        measured=tuple(nearest_loops(loops, tried.gap_m)) if single else (),
        identified=identified_loop(simulation.knowledge.model.at_rest, tried.gap_m, 0.0, current)
        if single
        else None,
        tracked=tuple(one for one in _tracked(simulation.setups, tried) if one.recordings),
        standstill=_seen(simulation.setups, *still),
        sensitivity={
            name: Response(one.frequency, one.ratio) for name, one in simulation.sensitivity.items()
        },
        linear_sensitivity=linear_sensitivity,
        loop_gain=linear_gain,
        margins={
            name: simulation.loops[name].margins
            for name, setup in simulation.setups.items()
            if has_constants(setup)
        },
        tables=_tables(simulation.figures),
        blocks={"standstill": (_cycles(simulation.figures["standstill"]),)},
        files={
            path.name: hashlib.sha256(path.read_bytes()).hexdigest()
            for path in (rig.path, simulation.controller.path, *rig.measured.files)
        },
        command=command,
        notes=plant_notes(simulation.plant),
    )


def plant_notes(plant: PlantCheck) -> tuple[Note, ...]:
    """Say how far the plant is from its loops, and what that takes from the results."""
    known = Note("info", "The plant", f"{'; '.join(plant.lines)}.")
    return (known, *(Note("warn", "The plant", f"{text}.") for text in plant.warnings))


def _part(
    runs: Mapping[MethodName, Recording], tick: float, step: ReferenceStep
) -> Mapping[MethodName, Recording]:
    """Cut out what happens around a step."""
    first, last = step.begin - round(0.1 * _SHOWN / tick), step.begin + round(_SHOWN / tick)
    return {name: run.part(first, min(last, step.end)) for name, run in runs.items()}


def _linear(
    simulation: Simulation,
) -> tuple[dict[MethodName, Response], dict[MethodName, Response]]:
    """Return linearised loop gain and sensitivity: own variant, as if of static slopes; the paper's."""
    frequency = np.geomspace(5.0, 0.4 * simulation.rig.settings.timing.rate_Hz, _FREQUENCIES)
    gains: dict[MethodName, Response] = {}
    sensitivities: dict[MethodName, Response] = {}
    for name in ("ratio", simulation.own):
        loop = simulation.loops[name]
        known = "" if has_constants(simulation.setups[name]) else "as if it knew the static slopes"
        note = known if loop.stable else f"{known}, unstable".removeprefix(", ")
        gains[name] = Response(frequency, loop.response(frequency), note)
        sensitivities[name] = Response(frequency, loop.sensitivity(frequency), note)
    return gains, sensitivities


def _seen(
    setups: Mapping[MethodName, Setup], scenario: Scenario, begin: int
) -> Mapping[MethodName, Recording]:
    """Run a scenario under every variant, and keep what follows a tick; lost runs are left out."""
    shown = {}
    for name, setup in setups.items():
        recording = SimulatedLoop(setup).run(scenario)
        lost = lost_at(setup.rig, recording, scenario.lifted)
        if lost is None and len(recording) == scenario.ticks:
            shown[name] = recording.part(begin, len(recording))
    return shown


def _tracked(setups: Mapping[MethodName, Setup], tried: RigFile) -> Iterator[Tracking]:
    """Run trajectories and load steps for the eye."""
    setup = next(iter(setups.values()))
    for shape in tried.trajectories:
        seen = _seen(setups, *experiments.following(setup, shape))
        size = f"{1e6 * shape.amplitude_m:g}{NBSP}µm"
        yield Tracking(f"{shape.kind} of {size} at {shape.frequency_Hz:g}{NBSP}Hz", seen)
    for force in tried.load_steps_N:
        scenario, begin = experiments.loaded(setup, force)
        ticks = round(0.1 / setup.rig.dt)
        seen = {name: run.part(0, ticks) for name, run in _seen(setups, scenario, begin).items()}
        yield Tracking(f"load step of {force:g}{NBSP}N", seen)


_FIGURES: Mapping[str, tuple[str, str, float]] = {
    "rms_m": ("Position at a standstill, rms", "nm", 1e9),
    "mean_error_m": ("Mean error at a standstill", "nm", 1e9),
    "tracking_rms_m": ("Deviation from the trajectory, rms", "nm", 1e9),
    "tracking_peak_m": ("Deviation from the trajectory, largest", "nm", 1e9),
    "force_error_rms_N": ("Force error on the trajectory, rms", "N", 1.0),
    "peak_m": ("Deviation after a load step, largest", "µm", 1e6),
    "excess_peak_m": ("Deviation that the event makes, largest", "µm", 1e6),
    "excess_s": ("Time until the event no longer shows", "ms", 1e3),
    "recovery_s": ("Time until the error stays within 1 µm", "ms", 1e3),
}
"""Title, unit as shown and factor to it."""

_CAPTIONS = {
    "force_error_rms_N": "True less wanted force of the same tick: it holds the tick of delay and "
    "the lag of the amplifier, which no compensation takes away."
}


def _tables(figures: Mapping[str, Any]) -> dict[str, tuple[FigureTable, ...]]:
    """Return the tables of experiments beside steps."""
    follow = {
        f"{trajectory['kind']} of {1e6 * trajectory['amplitude_m']:g}{NBSP}µm at {trajectory['frequency_Hz']:g}"
        f"{NBSP}Hz": trajectory["variants"]
        for trajectory in figures["trajectories"]
    }
    loads = {
        f"load step of {trajectory['force_N']:g}{NBSP}N": trajectory["variants"]
        for trajectory in figures["load_steps"]
    }
    excess = dict(figures["events"])
    recovery = {**loads, "overload": excess.pop("overload")}
    return {
        "standstill": _comparisons(
            {"hanging still": figures["standstill"]}, "rms_m", "mean_error_m"
        ),
        "tracking": (
            *_comparisons(follow, "tracking_rms_m", "tracking_peak_m", "force_error_rms_N"),
            *_comparisons(loads, "peak_m"),
            *_comparisons(recovery, "recovery_s"),
            *_comparisons(excess, "excess_peak_m", "excess_s"),
        ),
    }


def _comparisons(rows: Mapping[str, Any], *names: str) -> tuple[FigureTable, ...]:
    if not rows:
        return ()
    return tuple(
        FigureTable(
            *_FIGURES[name],
            {title: _intervals(intervals, name) for title, intervals in rows.items()},
            _CAPTIONS.get(name, ""),
        )
        for name in names
    )


def _intervals(cells: Mapping[MethodName, Any], name: str) -> Intervals:
    return {
        variant: Interval(**cell[name]) if name in cell else no_mean(cell["lost"], cell["runs"])
        for variant, cell in cells.items()
    }


def _cycles(cells: Mapping[MethodName, Any]) -> PageTable:
    """Report under which variants the armature never came to rest, and in how many runs."""
    return table(
        "Limit cycles at a standstill",
        ("variant", "runs with one", "amplitude (nm)", "period (ms)"),
        [[name, *_cycle_row(cells[name])] for name in ordered(cells)],
        "Amplitude and period: medians of the runs that have a cycle.",
    )


def _cycle_row(figures: Mapping[str, Any]) -> tuple[str, str, str]:
    if figures["lost"]:
        return interval_text(no_mean(figures["lost"], figures["runs"])), NOT_KNOWN, NOT_KNOWN
    count = f"{figures['limit_cycles']} of {figures['runs']}"
    if not figures["limit_cycles"]:
        return count, NOT_KNOWN, NOT_KNOWN
    return (
        count,
        number(1e9 * figures["limit_cycle_m"], 3),
        number(1e3 * figures["limit_cycle_s"], 3),
    )


STRONGEST = "the strongest baseline"
_TITLES: dict[Measure, str] = {
    "overshoot_percent": "overshoot",
    "settling_in_noise_s": "settling time",
}


def subject_of_benefit(
    rig: BodyRig, controller: ControllerFile, benefit_map: Benefit, command: str
) -> SimulationSubject:
    """Gather what the report of the map shows."""
    settings = controller.settings
    compensation = settings.compensation.model_copy(update={"variant": "full"})
    return SimulationSubject(
        rig=rig,
        controller=settings.model_copy(update={"compensation": compensation}),
        seeds=benefit_map.seeds,
        benefit=tuple(_cells(benefit_map)),
        blocks={"benefit": (_irons(benefit_map),)},
        notes=(
            Note(
                "info",
                "What is compared",
                f"Every iron is measured and identified again, all variants are fitted to the same "
                f"loops and run with the same gains, {benefit_map.seeds} noise seeds each. “{STRONGEST}” "
                "is, cell by cell, the best of ratio, linearised and single-valued, which know no "
                "hysteresis: chance favours it a little. flux, where there is a Hall probe, stands "
                "beside them: it needs no model, as it measures the flux density.",
            ),
        ),
        files={
            path.name: hashlib.sha256(path.read_bytes()).hexdigest()
            for path in (rig.path, controller.path)
        },
        command=command,
    )


def _cells(benefit_map: Benefit) -> list[BenefitCell]:
    return [
        _cell(benefit_map, cell, measure, against, comparison)
        for measure in MEASURES
        for cell in benefit_map.cells
        for against, comparisons in (
            ("ratio", cell.ratio),
            (STRONGEST, cell.strongest),
            ("flux", cell.flux),
        )
        if comparisons
        for comparison in (comparisons[measure],)
    ]


def _cell(
    benefit_map: Benefit, cell: MapCell, measure: Measure, against: str, comparison: Comparison
) -> BenefitCell:
    quotient = comparison.quotient
    return BenefitCell(
        measure=_TITLES[measure],
        against=against,
        baseline=comparison.baseline or "",
        loop_width=benefit_map.row_width(cell.iron.scale),
        reversible=cell.iron.reversible_fraction,
        pathological=cell.iron.label == "pathological",
        height=cell.height,
        ratio=math.nan if quotient is None else quotient.value,
        outcome=comparison.outcome,
    )


def _irons(benefit_map: Benefit) -> PageTable:
    """Describe every iron by what loops show of it."""
    rows = [
        [
            number(iron.scale, short=True),
            NOT_KNOWN
            if iron.reversible_fraction is None
            else number(iron.reversible_fraction, short=True),
            f"{number(100.0 * iron.loop_width)}{NBSP}%",
            NOT_KNOWN if iron.after_reversal is None else number(iron.after_reversal, 2),
            number(iron.after_reversal_true, 2),
            iron.label,
        ]
        for iron in dict.fromkeys(cell.iron for cell in benefit_map.cells)
    ]
    return table(
        "Irons",
        (
            "pinning, times",
            "reversible fraction",
            "loop width",
            "slope after reversal, from loops",
            "true",
            "label",
        ),
        rows,
        "Loop width: of the largest current. Slope just after a reversal over the static slope: "
        "below a quarter an iron is pathological.",
        texts=0,
    )
