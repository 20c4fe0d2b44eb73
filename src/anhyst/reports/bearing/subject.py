"""What a report of a simulation is about: plain data, parts of which may be absent."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from anhyst.compensate.force_controller import MethodName
from anhyst.control.controller_file import ControllerTable
from anhyst.reports.bearing.look import ordered
from anhyst.reports.bearing.over_frequency import Response
from anhyst.reports.bearing.over_runs import BenefitCell, TuningPicture
from anhyst.reports.bearing.over_time import LoopCurve, StepPanel
from anhyst.rig.body import BodyRig
from anhyst.rig.recording import Recording
from anhyst.study.bearing.linear import Margins
from anhyst.study.bearing.responses import StepCell
from anhyst.study.engine.verdict import Interval
from anhyst.support.page.blocks import Block, Note
from anhyst.support.page.numbers import NBSP

Intervals = Mapping[MethodName, Interval]
"""A figure of every variant."""


@dataclass(frozen=True)
class Steps:
    """Figures of one step, up and down, under every variant."""

    gap: float  # around which it goes, m
    load: float  # N
    height: float  # m
    cells: Mapping[MethodName, StepCell]  # by variant

    def of(self, name: str) -> Intervals:
        """Return a figure of every variant, without a mean where levitation was lost."""
        return {key: cell.of(name) for key, cell in self.cells.items()}

    @property
    def remarks(self) -> Mapping[MethodName, str]:
        """What is to stand beside overshoots that are the noise of a standstill."""
        return {
            key: WITHIN_NOISE
            for key, cell in self.cells.items()
            if not cell.overshoots and not cell.lost
        }


WITHIN_NOISE = "≤ noise"
"""Beside an overshoot that is not certainly more than what the standstill adds to it."""


def grouped(cells: Iterable[StepCell]) -> tuple[Steps, ...]:
    """Put the cells of all variants beside each other."""
    by_step: dict[tuple[float, float, float], dict[MethodName, StepCell]] = {}
    for cell in cells:
        by_step.setdefault((cell.gap, cell.load, cell.height), {})[cell.variant] = cell
    return tuple(Steps(*step, mine) for step, mine in by_step.items())


@dataclass(frozen=True)
class FigureTable:
    """A table of one figure: a row a situation, a column a variant."""

    title: str  # what it is
    unit: str  # as shown
    factor: float  # from SI to that
    rows: Mapping[str, Intervals]  # by situation, then by variant; SI
    caption: str = ""
    # what stands beside a figure, in the same order
    remarks: Mapping[str, Mapping[MethodName, str]] = field(default_factory=dict)


@dataclass(frozen=True)
class Tracking:
    """One thing that was tried, under every variant: a trajectory, a load step, a recovery."""

    title: str  # what was tried
    recordings: Mapping[MethodName, Recording]  # as long as they are to be shown


@dataclass(frozen=True)
class SimulationSubject:
    """All there is to say about a simulation."""

    rig: BodyRig  # the bearing
    # its controller; the variant it names is the one that others are held against
    controller: ControllerTable
    seeds: int  # noise seeds behind every interval
    panels: tuple[StepPanel, ...] = ()  # fig. 11
    steps: tuple[Steps, ...] = ()  # the figures of all steps
    # in which wanted and true force are shown
    forces: Mapping[MethodName, Recording] = field(default_factory=dict)
    run: Mapping[MethodName, Recording] = field(default_factory=dict)  # shown over the loops
    measured: tuple[LoopCurve, ...] = ()  # loops of the nearest gaps
    identified: LoopCurve | None = None  # loop of the model at the gap of the run
    tracked: tuple[Tracking, ...] = ()  # trajectories, load steps, recoveries
    standstill: Mapping[MethodName, Recording] = field(default_factory=dict)  # at rest in the air
    # measured; of the linearised loop; its loop gain
    sensitivity: Mapping[MethodName, Response] = field(default_factory=dict)
    linear_sensitivity: Mapping[MethodName, Response] = field(default_factory=dict)
    loop_gain: Mapping[MethodName, Response] = field(default_factory=dict)
    margins: Mapping[MethodName, Margins] = field(default_factory=dict)  # of the linearised loop
    # more tables, by the key of their section: ``steps``, ``forces``, ``tracking``, ``standstill``,
    # ``frequency``, ``benefit``, ``tuning``
    tables: Mapping[str, tuple[FigureTable, ...]] = field(default_factory=dict)
    # whatever else a section is to hold, by the same keys
    blocks: Mapping[str, tuple[Block, ...]] = field(default_factory=dict)
    benefit: tuple[BenefitCell, ...] = ()  # over irons
    tuning: TuningPicture | None = None  # what tuning found
    notes: tuple[Note, ...] = ()  # what a reader must know first, such as a loop that was unstable
    # where it comes from: names of files and their SHA-256
    files: Mapping[str, str] = field(default_factory=dict)
    command: str = ""  # what makes it again

    @property
    def variant(self) -> MethodName:
        """MethodName of the controller, that others are held against."""
        return self.controller.compensation.variant

    @property
    def baselines(self) -> list[MethodName]:
        """The other variants of the steps, in order."""
        methods = {name for step in self.steps for name in step.cells}
        return [name for name in ordered(methods) if name != self.variant]

    @property
    def variants(self) -> list[MethodName]:
        """All that the page speaks of."""
        shown = (*self.baselines, *self.sensitivity, *self.standstill, *self.forces)
        return ordered({self.variant, *shown, *(cell.baseline for cell in self.benefit)})

    def situation(self, step: Steps) -> str:
        """Say in words what a step was; the load only if there are several."""
        where = f"{1e6 * step.height:g}{NBSP}µm at {1e3 * step.gap:g}{NBSP}mm"
        several = len({one.load for one in self.steps}) > 1
        return f"{where}, {step.load:g}{NBSP}N" if several else where
