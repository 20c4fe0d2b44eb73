"""What a report of a simulation is about: plain data, parts of which may be absent."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from anhyst.compensate.interface import MethodName
from anhyst.control.controller_file import ControllerTable
from anhyst.reports.bearing.force_current import LoopCurve
from anhyst.reports.bearing.look import ordered
from anhyst.reports.bearing.over_frequency import Response
from anhyst.reports.bearing.over_runs import BenefitCell, Spread, TuningPicture
from anhyst.reports.bearing.over_time import StepPanel
from anhyst.rig.bearing.file import BearingRig
from anhyst.rig.bearing.recording import Recording
from anhyst.study.bearing.linear import Margins
from anhyst.study.bearing.metrics import Interval
from anhyst.study.bearing.responses import StepCell
from anhyst.support.page.blocks import Block, Note
from anhyst.support.page.numbers import NBSP

Intervals = Mapping[MethodName, Interval]
"""A figure of every variant."""


@dataclass(frozen=True)
class Steps:
    """Figures of one step, up and down, under every variant.

    Parameters
    ----------
    gap : float
        Around which it goes, m.
    load : float
        N.
    height : float
        m.
    cells : mapping of str to StepCell
        By variant.
    """

    gap: float
    load: float
    height: float
    cells: Mapping[MethodName, StepCell]

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
    found: dict[tuple[float, float, float], dict[MethodName, StepCell]] = {}
    for cell in cells:
        found.setdefault((cell.gap, cell.load, cell.height), {})[cell.variant] = cell
    return tuple(Steps(*place, mine) for place, mine in found.items())


@dataclass(frozen=True)
class FigureTable:
    """A table of one figure: a row a situation, a column a variant.

    Parameters
    ----------
    title : str
        What it is.
    unit : str
        As shown.
    factor : float
        From SI to that.
    rows : mapping of str to mapping of str to Interval
        By situation, then by variant; SI.
    caption : str, optional
    remarks : mapping of str to mapping of str to str, optional
        What stands beside a figure, in the same order.
    """

    title: str
    unit: str
    factor: float
    rows: Mapping[str, Intervals]
    caption: str = ""
    remarks: Mapping[str, Mapping[MethodName, str]] = field(default_factory=dict)


@dataclass(frozen=True)
class Tracking:
    """One thing that was tried, under every variant: a trajectory, a load step, a recovery.

    Parameters
    ----------
    title : str
        What was tried.
    recordings : mapping of str to Recording
        As long as they are to be shown.
    """

    title: str
    recordings: Mapping[MethodName, Recording]


@dataclass(frozen=True)
class SimulationSubject:
    """All there is to say about a simulation.

    Parameters
    ----------
    rig : BearingRig
        The bearing.
    controller : ControllerTable
        Its controller; the variant it names is the one that others are held against.
    seeds : int
        Noise seeds behind every interval.
    panels : tuple of StepPanel
        Fig. 11.
    steps : tuple of Steps
        The figures of all steps.
    forces : mapping of str to Recording
        In which wanted and true force are shown.
    run : mapping of str to Recording
        Shown over the loops.
    measured : tuple of LoopCurve
        Loops of the nearest gaps.
    identified : LoopCurve or None
        Loop of the model at the gap of the run.
    tracked : tuple of Tracking
        Trajectories, load steps, recoveries.
    standstill : mapping of str to Recording
        At rest in the air.
    sensitivity, linear_sensitivity, loop_gain : mapping of str to Response
        Measured; of the linearised loop; its loop gain.
    margins : mapping of str to Margins
        Of the linearised loop.
    tables : mapping of str to tuple of FigureTable
        More tables, by the key of their section: ``steps``, ``forces``, ``tracking``,
        ``standstill``, ``frequency``, ``drift``, ``benefit``, ``tuning``.
    blocks : mapping of str to tuple of Block
        Whatever else a section is to hold, by the same keys.
    benefit : tuple of BenefitCell
        Over irons.
    drift : tuple of Spread
        Over plants.
    plants : int
        How many.
    tuning : TuningPicture or None
        What tuning found.
    notes : tuple of Note
        What a reader must know first, such as a loop that was unstable.
    files : mapping of str to str
        Where it comes from: names of files and their SHA-256.
    command : str
        What makes it again.
    """

    rig: BearingRig
    controller: ControllerTable
    seeds: int
    panels: tuple[StepPanel, ...] = ()
    steps: tuple[Steps, ...] = ()
    forces: Mapping[MethodName, Recording] = field(default_factory=dict)
    run: Mapping[MethodName, Recording] = field(default_factory=dict)
    measured: tuple[LoopCurve, ...] = ()
    identified: LoopCurve | None = None
    tracked: tuple[Tracking, ...] = ()
    standstill: Mapping[MethodName, Recording] = field(default_factory=dict)
    sensitivity: Mapping[MethodName, Response] = field(default_factory=dict)
    linear_sensitivity: Mapping[MethodName, Response] = field(default_factory=dict)
    loop_gain: Mapping[MethodName, Response] = field(default_factory=dict)
    margins: Mapping[MethodName, Margins] = field(default_factory=dict)
    tables: Mapping[str, tuple[FigureTable, ...]] = field(default_factory=dict)
    blocks: Mapping[str, tuple[Block, ...]] = field(default_factory=dict)
    benefit: tuple[BenefitCell, ...] = ()
    drift: tuple[Spread, ...] = ()
    plants: int = 0
    tuning: TuningPicture | None = None
    notes: tuple[Note, ...] = ()
    files: Mapping[str, str] = field(default_factory=dict)
    command: str = ""

    @property
    def variant(self) -> MethodName:
        """MethodName of the controller, that others are held against."""
        return self.controller.compensation.variant

    @property
    def baselines(self) -> list[MethodName]:
        """The other variants of the steps, in order."""
        found = {name for step in self.steps for name in step.cells}
        return [name for name in ordered(found) if name != self.variant]

    @property
    def variants(self) -> list[MethodName]:
        """All that the page speaks of."""
        shown = (*self.baselines, *self.sensitivity, *self.standstill, *self.forces)
        drifted = (name for one in self.drift for name in one.values)
        baselines = (cell.baseline for cell in self.benefit)
        return ordered({self.variant, *shown, *drifted, *baselines})

    def situation(self, step: Steps) -> str:
        """Say in words what a step was; the load only if there are several."""
        place = f"{1e6 * step.height:g}{NBSP}µm at {1e3 * step.gap:g}{NBSP}mm"
        several = len({one.load for one in self.steps}) > 1
        return f"{place}, {step.load:g}{NBSP}N" if several else place
