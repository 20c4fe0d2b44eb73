"""Run a plant and its controller together, tick by tick, from a scenario to a recording."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from anhyst._core import LoopController, Plant, PlantLoop
from anhyst.compensate.force_controller import ForceController
from anhyst.support.kinds import MethodName
from anhyst.support.numeric import FloatArray
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.parts.coupling import CoupledForces
from anhyst_rigs.rig.plant import coupled_forces, current_controllers, make_plant
from anhyst_rigs.rig.recording import Recording, column_name

DROP_SAMPLE_BIT = 256
"""Command bit that drops a sample; ``plant/include/anhyst_plant/loop.h`` describes all bits."""
SHORT_CIRCUIT_BIT = 512
"""Command bit that makes a failing amplifier short-circuit its winding."""
FIRST_FAILURE_BIT = 16
"""Position of the command bit of the first magnet or head, which fails if the bit is set."""
HEAD_FAULT_BITS = {"missing": 1024, "frozen": 2048, "jumps": 4096}
"""Command bits that select a failure of heads instead of amplifiers."""


@dataclass(frozen=True, slots=True)
class ReferenceStep:
    """A step of the reference in a scenario."""

    begin: int  # ticks at which the step begins and its hold ends
    end: int
    gap_before: float  # reference gap before and after the step, m
    gap_after: float

    @property
    def height(self) -> float:
        """Height of the step, m."""
        return abs(self.gap_after - self.gap_before)


def _empty_array() -> FloatArray:
    return np.zeros(0)


@dataclass(frozen=True)
class Scenario:
    """Inputs of a run, one row per tick; omitted inputs are zero.

    Target, injected signal, feedforward force and frame position have one column per free
    coordinate. For a single coordinate, they are one-dimensional.
    """

    target: FloatArray  # reference position, m; for a bearing, the gap
    # commanded force of the load drive, N; shape (n,)
    load: FloatArray = field(default_factory=_empty_array)
    # signal that is added to the position that the controller reads, m
    inject: FloatArray = field(default_factory=_empty_array)
    feed: FloatArray = field(default_factory=_empty_array)  # feedforward force, N
    # sum of a :class:`Command` and bits such as :data:`DROP_SAMPLE_BIT`; shape (n,)
    command: NDArray[np.uint32] = field(default_factory=lambda: np.zeros(0, dtype=np.uint32))
    # position of the frame at n + 1 ticks, m; empty: at rest
    frame: FloatArray = field(default_factory=_empty_array)
    steps: tuple[ReferenceStep, ...] = ()  # steps of the reference
    lift_end_tick: int = 0  # tick at which the armature should levitate; 0 if there is no lift-off

    def __post_init__(self) -> None:
        n = len(self.target)
        shapes = {"load": n, "inject": self.target.shape, "feed": self.target.shape}
        for name, shape in shapes.items():
            if not len(getattr(self, name)):
                object.__setattr__(self, name, np.zeros(shape))
        if not len(self.command):
            object.__setattr__(self, "command", np.zeros(n, dtype=np.uint32))

    @property
    def ticks(self) -> int:
        """Number of ticks."""
        return len(self.target)

    def slice_ticks(self, begin: int, end: int) -> Scenario:
        """Return the inputs of ticks begin to end (exclusive), without lift-off and step data."""
        fields = ("target", "load", "inject", "feed", "command")
        inputs = {name: getattr(self, name)[begin:end] for name in fields}
        return Scenario(**inputs, frame=self.frame[begin : end + 1])


class ClosedLoop:
    """A plant and its controller from power-on. Each scenario continues after the previous one.

    A digital current controller precedes each amplifier; it is inactive for a current amplifier.
    """

    def __init__(
        self,
        plant: Plant,
        controller: LoopController,
        current_loops: Sequence[dict[str, float]],
        recorded_signals: Sequence[str] | None = None,
        coupling: CoupledForces | None = None,
    ) -> None:
        self._coupling = coupling
        self._coupling_force = 0.0  # change of the net force in the last tick, N
        self._loop = PlantLoop(plant, controller, current_loops)
        self._signals = [column_name(*signal) for signal in self._loop.signals]
        self._recorded = recorded_signals  # recorded columns; None: all

    def run(self, scenario: Scenario) -> Recording:
        """Run a scenario and return its recording.

        The recording ends early if a value is not finite or if the controller does not answer.
        """
        coupling = self._coupling
        rows = self._run_rows(scenario) if coupling is None else self._run_coupled(scenario, coupling)
        run = Recording.from_table(rows, self._signals)
        return run if self._recorded is None else run.select_columns(self._recorded)

    def _run_rows(self, scenario: Scenario) -> FloatArray:
        target, load, inject, feed = (
            np.ascontiguousarray(signal, dtype=np.float64).ravel()
            for signal in (scenario.target, scenario.load, scenario.inject, scenario.feed)
        )
        frame = np.ascontiguousarray(scenario.frame).ravel() if len(scenario.frame) else None
        return self._loop.run(target, load, inject, feed, scenario.command, frame)

    def _run_coupled(self, scenario: Scenario, coupling: CoupledForces) -> FloatArray:
        """Run tick by tick; what both coils change of their forces acts in the next tick as a load."""
        columns = [self._signals.index(name) for name in ("current_A", "current_2_A", "gap_m")]
        rows = []
        for tick in range(scenario.ticks):
            part = scenario.slice_ticks(tick, tick + 1)
            row = self._run_rows(replace(part, load=part.load + self._coupling_force))
            if not len(row):
                break
            rows.append(row[0])
            *currents, gap = row[0, columns].tolist()
            changes = coupling.force_changes(np.array(currents), gap)
            self._coupling_force = float(changes[1] - changes[0])
        return np.array(rows).reshape(-1, len(self._signals))


@dataclass(frozen=True)
class Setup(ABC):
    """All data for a run of a body between magnets; the object can be sent to other processes."""

    recorded_columns: ClassVar[Sequence[str] | None] = None  # columns in a recording; None: all

    rig: BodyRig  # rig of the plant
    # fitted compensators from force to current, which are copied for each run
    compensator: ForceController
    # compensator of each magnet, if they differ
    own_compensators: tuple[ForceController, ...] = field(default=(), kw_only=True)

    @property
    def method(self) -> MethodName:
        """Compensation method."""
        return self.compensator.method

    @property
    def compensators(self) -> tuple[ForceController, ...]:
        """Fitted compensator of each magnet."""
        return self.own_compensators or (self.compensator,) * len(self.rig.settings.body_magnets)

    def make_compensators(self) -> list[ForceController]:
        """Return a demagnetised force controller for every magnet."""
        return [compensator.reset_copy() for compensator in self.compensators]

    def make_plant(self, seed: int) -> Plant:
        """Return the plant at rest, with demagnetised iron."""
        return make_plant(self.rig, seed)

    @abstractmethod
    def make_controller(self, drives: Sequence[ForceController] = ()) -> LoopController:
        """Return the controller in its state after power-on.

        `drives`, one force controller per magnet, may have a history; the default is demagnetised.
        """


class SimulatedLoop(ClosedLoop):
    """The closed loop of a setup with its own plant or with another one."""

    def __init__(
        self, setup: Setup, seed: int = 0, is_magnetised_first: bool = False, plant: Plant | None = None
    ) -> None:
        rig, plant = setup.rig, plant or setup.make_plant(seed)
        if is_magnetised_first:
            for magnet in range(len(rig.settings.body_magnets)):
                for current in (rig.settings.amplifier.current_high_A, 0.0):
                    plant.hold(current, magnet)
        parts, coupling = (plant, setup.make_controller()), coupled_forces(rig)
        super().__init__(*parts, current_controllers(rig), setup.recorded_columns, coupling)
