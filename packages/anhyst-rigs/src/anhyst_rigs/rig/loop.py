"""A plant and its controller in lock-step: what happens tick by tick goes in, a recording comes out."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from anhyst._core import LoopController, Plant, PlantLoop
from anhyst.compensate.force_controller import ForceController
from anhyst.support.kinds import MethodName
from anhyst.support.numeric import FloatArray
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.plant import current_controllers, make_plant
from anhyst_rigs.rig.recording import Recording, column_name

DROP_SAMPLE_BIT = 256
"""Command bit of a dropped sample; see ``plant/include/anhyst_plant/loop.h`` for all bits."""
SHORT_CIRCUIT_BIT = 512
"""Command bit of a short circuit."""
FIRST_FAILURE_BIT = 16
"""Position of the command bit of the first magnet or head; a set bit makes it fail."""
HEAD_FAULT_BITS = {"missing": 1024, "frozen": 2048, "jumps": 4096}
"""Bits of the ways in which heads fail instead of amplifiers."""


@dataclass(frozen=True, slots=True)
class ReferenceStep:
    """A step of the reference within a scenario."""

    begin: int  # ticks: of the step, and of the end of its hold
    end: int
    before: float  # reference, m of gap
    after: float

    @property
    def height(self) -> float:
        """Size of the step, m."""
        return abs(self.after - self.before)


def _empty_array() -> FloatArray:
    return np.zeros(0)


@dataclass(frozen=True)
class Scenario:
    """What happens at each of n ticks, a row each; what is left out is nothing at all of them.

    Targets, what is injected and fed and the frame have a column each free coordinate, or are flat
    where there is one.
    """

    target: FloatArray  # wanted position, m: of a bearing the gap
    # force commanded to the load drive, N; shape (n,)
    load: FloatArray = field(default_factory=_empty_array)
    # added to the position that the controller sees, m
    inject: FloatArray = field(default_factory=_empty_array)
    feed: FloatArray = field(default_factory=_empty_array)  # force that the controller is given, N
    # :class:`Command`, :data:`DROP`; shape (n,)
    command: NDArray[np.uint32] = field(default_factory=lambda: np.zeros(0, dtype=np.uint32))
    # where it is at n + 1 ticks, m; empty: it stands still
    frame: FloatArray = field(default_factory=_empty_array)
    steps: tuple[ReferenceStep, ...] = ()  # steps of the reference in it
    lift_end_tick: int = (
        0  # tick from which on the armature should levitate; 0 if nothing lifts it here
    )

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
        """How long it is."""
        return len(self.target)

    def slice_ticks(self, begin: int, end: int) -> Scenario:
        """Return what happens from one tick up to another; nothing is lifted or stepped in it."""
        each = ("target", "load", "inject", "feed", "command")
        ticks = {name: getattr(self, name)[begin:end] for name in each}
        return Scenario(**ticks, frame=self.frame[begin : end + 1])


class ClosedLoop:
    """A plant and its controller, from power on; scenarios follow each other.

    Before each amplifier stands a current loop, which does nothing where it takes a current.
    """

    def __init__(
        self,
        plant: Plant,
        controller: LoopController,
        current_loops: Sequence[dict[str, float]],
        recorded: Sequence[str] | None = None,
    ) -> None:
        self._loop = PlantLoop(plant, controller, current_loops)
        self._signals = [column_name(*signal) for signal in self._loop.signals]
        self._recorded = recorded  # columns; all where it is None

    def run(self, scenario: Scenario) -> Recording:
        """Go on with a scenario; shorter where a number ceased to be finite or nobody answered."""
        target, load, inject, feed = (
            np.ascontiguousarray(one, dtype=np.float64).ravel()
            for one in (scenario.target, scenario.load, scenario.inject, scenario.feed)
        )
        frame = np.ascontiguousarray(scenario.frame).ravel() if len(scenario.frame) else None
        rows = self._loop.run(target, load, inject, feed, scenario.command, frame)
        run = Recording.from_table(rows, self._signals)
        return run if self._recorded is None else run.select_columns(self._recorded)


@dataclass(frozen=True)
class Setup(ABC):
    """All that a run of a body between magnets needs; goes to other processes."""

    recorded_columns: ClassVar[Sequence[str] | None] = (
        None  # columns of a recording; all where it is None
    )

    rig: BodyRig  # the plant
    compensator: ForceController  # from force to current, as fitted; never run itself
    # of every magnet, where they are not all the same
    own_compensators: tuple[ForceController, ...] = field(default=(), kw_only=True)

    @property
    def method(self) -> MethodName:
        """What its compensator is."""
        return self.compensator.method

    @property
    def compensators(self) -> tuple[ForceController, ...]:
        """The compensator of every magnet, as fitted."""
        return self.own_compensators or (self.compensator,) * len(self.rig.settings.body_magnets)

    def make_compensators(self) -> list[ForceController]:
        """Return a force controller for every magnet, demagnetised."""
        return [compensator.reset_copy() for compensator in self.compensators]

    def make_plant(self, seed: int) -> Plant:
        """Return the plant, at rest, its iron demagnetised."""
        return make_plant(self.rig, seed)

    @abstractmethod
    def make_controller(self, drives: Sequence[ForceController] = ()) -> LoopController:
        """Return the controller, just switched on.

        The drives, one a magnet, may remember something; demagnetised ones if left out.
        """


class SimulatedLoop(ClosedLoop):
    """The plant, or another one, and the controller of a setup."""

    def __init__(
        self,
        setup: Setup,
        seed: int = 0,
        is_magnetised_first: bool = False,
        plant: Plant | None = None,
    ) -> None:
        rig, plant = setup.rig, plant or setup.make_plant(seed)
        if is_magnetised_first:
            for magnet in range(len(rig.settings.body_magnets)):
                for current in (rig.settings.amplifier.current_high_A, 0.0):
                    plant.hold(current, magnet)
        super().__init__(
            plant, setup.make_controller(), current_controllers(rig), setup.recorded_columns
        )
