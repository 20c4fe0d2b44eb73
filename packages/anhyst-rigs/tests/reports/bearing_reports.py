"""Synthetic simulation results with all possible contents of a report, for its tests."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import cache

import numpy as np
from matplotlib.figure import Figure

from anhyst.control.controller_file import ControllerTable, read_controller
from anhyst.support.kinds import MethodName
from anhyst.support.page import Note
from anhyst_rigs.reports.bearing.figures import LoopCurve, Response, StepPanel
from anhyst_rigs.reports.bearing.subject import SimulationSubject, Tracking
from anhyst_rigs.reports.tuning import GainsPoint, figure_pareto
from anhyst_rigs.rig.body import BodyRig, read_bearing
from anhyst_rigs.rig.loop import ReferenceStep
from anhyst_rigs.rig.recording import COLUMNS, Recording
from anhyst_rigs.study.bearing.experiments import ExperimentFigures, Experiments
from anhyst_rigs.study.bearing.linear import Margins
from anhyst_rigs.study.bearing.responses import StepCell, group_by_step
from anhyst_rigs.study.benefit import STEP_METRICS, Benefit, IronFigures, MapCell, MethodComparison
from anhyst_rigs.study.engine.table import Interval, MeanRatio
from anhyst_rigs.study.tuning.aims import GAIN_METRICS
from tests.repository import ROOT

EXAMPLE = ROOT / "examples" / "bearing"
SHOWN: tuple[MethodName, ...] = ("ratio", "single-valued", "full")
RATE, BEGIN, HEIGHT, GAP = 20e3, 200, 10e-6, 0.45e-3
# Overshoot in % of the height at 10 and 50 um: mean, half-width of the interval.
OVERSHOOT: Mapping[MethodName, tuple[tuple[float, float], ...]] = {
    "ratio": ((30.25, 0.4), (24.75, 0.3)),
    "single-valued": ((10.0, 0.3), (7.125, 0.3)),
    "full": ((12.1, 0.25), (7.25, 0.25)),
}
NOISE = 0.5


@cache
def rig() -> BodyRig:
    """The bundled bearing."""
    return read_bearing(EXAMPLE / "rig.toml")


@cache
def controller() -> ControllerTable:
    """The bundled controller."""
    return read_controller(EXAMPLE / "controller.toml").settings


def response(overshoot: float, seed: int) -> Recording:
    """A record with one step of 10 um up that overshoots, with noise."""
    table = np.zeros((800, len(COLUMNS)))
    time = np.arange(800) / RATE
    since = np.maximum(time - BEGIN / RATE, 0.0)
    decay = -math.log(overshoot / 100.0) * 250.0 / math.pi
    way = 1.0 - np.exp(-decay * since) * (np.cos(250.0 * since) + decay / 250.0 * np.sin(250.0 * since))
    noise = 5e-9 * np.random.default_rng(seed).standard_normal(800)
    values = {
        "t_s": 3.0 + time,
        "reference_m": GAP + HEIGHT / 2 - HEIGHT * (np.arange(800) >= BEGIN),
        "gap_m": GAP + HEIGHT / 2 - HEIGHT * way + noise,
        "demand_N": 150.0 + 20.0 * np.exp(-400.0 * since) * (since > 0.0),
        "force_N": 150.0 + 18.0 * np.exp(-300.0 * since) * (since > 0.0),
        "current_A": 2.8 + 0.3 * np.exp(-300.0 * since) * (since > 0.0),
    }
    for name, column in values.items():
        table[:, COLUMNS.index(name)] = column
    return Recording.from_table(table)


def cells() -> list[StepCell]:
    return [
        StepCell(
            variant=name,
            gap=GAP,
            height=height,
            load=150.0,
            figures={
                "overshoot_percent": Interval(*OVERSHOOT[name][place], 20),
                "noise_percent": Interval(NOISE, 0.05, 20),
                "settling_in_noise_s": Interval(6.25e-3, 0.1e-3, 20),
                "steady_error_m": Interval(1e-9, 2e-9, 20),
                "standstill_rms_m": Interval(5e-9, 1e-10, 20),
            },
            lost=0,
            runs=20,
        )
        for place, height in enumerate((10e-6, 50e-6))
        for name in SHOWN
    ]


def lag(corner: float, gain: float) -> Response:
    frequency = np.geomspace(5.0, 5e3, 60)
    return Response(frequency, np.asarray(gain / (1.0 + 1j * frequency / corner), np.complex128))


@cache
def runs() -> dict[MethodName, Recording]:
    """A step with every variant in the figure."""
    return {name: response(OVERSHOOT[name][0][0], place) for place, name in enumerate(SHOWN)}


def tried(lost: int, rest: Interval | None) -> ExperimentFigures:
    return ExperimentFigures(
        figures={} if rest is None else {"rms_m": rest, "mean_error_m": rest},
        lost=lost,
        runs=20,
        cycles=None if lost else (),
    )


def tuning() -> Figure:
    """Results of a tuning for the figure of its candidates."""
    chosen = GainsPoint("full", 5.5e-3, 2.125, meets_other_aims=True)
    others = (
        GainsPoint("full", 4e-3, 3.5, meets_other_aims=True),
        GainsPoint("full", math.inf, 1.2, meets_other_aims=False),
    )
    return figure_pareto([chosen, *others], {"full": chosen}, GAIN_METRICS["settling_time_s"], (6e-3, 3.0))


def gains() -> Benefit:
    """A benefit map of two irons and two heights with low and high ratios."""
    irons = (
        IronFigures(1.0, 0.05, 0.02, None, 0.1, "pathological"),
        IronFigures(2.0, 0.15, 0.05, None, 0.5, "regular"),
    )
    cells = tuple(
        MapCell(
            iron=iron,
            case=height,
            figures={},
            standstill_rms={},
            strongest=compared("single-valued", 0.9 + more, certain=False),
            ratio=compared("ratio", 0.3 + more, certain=True),
            flux={},
        )
        for iron, more in zip(irons, (0.0, 0.08), strict=True)
        for height in (10e-6, 50e-6)
    )
    return Benefit("rig", 20, cells)


def compared(baseline: MethodName, ratio: float, *, certain: bool) -> dict[str, MethodComparison]:
    gain = certain or ratio < 0.95
    difference = Interval(1.0, 0.1 if gain else 2.0, 20)
    one = MethodComparison(baseline, MeanRatio(ratio, 0.5 * ratio, 2.0 * ratio), difference)
    return dict.fromkeys([metric.key for metric in STEP_METRICS], one)


@cache
def subject() -> SimulationSubject:
    """A report subject with all possible contents."""
    step = ReferenceStep(BEGIN, 800, GAP + HEIGHT / 2, GAP - HEIGHT / 2)
    overshoot = {name: Interval(*OVERSHOOT[name][0], 20) for name in SHOWN}
    current = np.concatenate([np.linspace(0.0, 4.0, 40), np.linspace(4.0, 0.0, 40)])
    margins = Margins(True, 0.31, 3.7, 41.5, 1.2e-4, 392.0, 1.82, 650.0)
    return SimulationSubject(
        rig=rig(),
        controller=controller(),
        seeds=20,
        panels=(StepPanel(step, runs(), overshoot, shown_s=0.03),),
        steps=group_by_step(cells()),
        forces=runs(),
        run=runs(),
        measured_loops=(LoopCurve(0.42e-3, current, 20.0 * current**2),),
        identified=LoopCurve(GAP, current, 18.0 * current**2),
        tracked=(Tracking("triangle of 20 µm", runs()),),
        standstill_runs={name: run.slice_ticks(0, BEGIN) for name, run in runs().items()},
        sensitivity={name: lag(800.0, gain) for name, gain in zip(SHOWN, (4.4, 2.0, 1.5), strict=True)},
        linear_sensitivity={"full": lag(700.0, 1.5)},
        loop_gain={"full": lag(90.0, 40.0)},
        margins={"full": margins},
        experiments=Experiments(
            {"full": tried(0, Interval(14.25e-9, 5e-10, 20)), "ratio": tried(3, None)}, (), (), {}
        ),
        notes=(Note("warn", "Note", "noise <b>was</b> added"),),
        files={"rig.toml": "ab" * 32},
        command="anhyst simulate rig.toml --out run.csv",
    )
