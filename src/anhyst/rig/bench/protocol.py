"""What every bench is to whoever operates it, virtual or of hardware."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple, Protocol

from anhyst.control.states import Command
from anhyst.support.arrays import FloatArray


class Signal(NamedTuple):
    """A column of what a bench measures.

    Attributes
    ----------
    name : str
        In lower case, without its unit: ``gap``, ``command_2``.
    unit : str
        SI; empty for what is counted or named.
    doc : str
        What it is.
    """

    name: str
    unit: str
    doc: str


class Aim(NamedTuple):
    """What is demanded of a bench.

    Attributes
    ----------
    signal, reference : str
        Signals: what is controlled, and to what.
    unit : str
        m or N.
    low, high : float
        The range of what may be demanded.
    value : float
        With which the bench was opened.
    """

    signal: str
    reference: str
    unit: str
    low: float
    high: float
    value: float


class Parameter(NamedTuple):
    """What may be changed while a bench runs.

    Attributes
    ----------
    name : str
        In lower case: ``load_damping``.
    unit : str
        SI; empty for what is counted or switched.
    low, high : float
        The range of its values, both ends in it.
    doc : str
        What it does.
    value : float
        In force now.
    """

    name: str
    unit: str
    low: float
    high: float
    doc: str
    value: float


class Bench(Protocol):
    """A rig and its controller. One thread at a time.

    Attributes
    ----------
    rate : float
        Ticks a second.
    signals : tuple of Signal
        Columns of what :meth:`advance` returns, after the first, which is the number of the tick.
    tick : int
        Number of the last tick; 0 before the first.
    aim : Aim
        What is demanded.
    load_most : float
        Largest force of the load drive either way, N; 0: there is none.
    keeps_time : bool
        Whether its ticks come by themselves, as those of hardware do: time cannot stand there.
    every : int
        Ticks from one row to the next; more than 1 where a line does not carry every tick.
    process : int
        Of the machine, that answers every tick; 0 where none does.
    lost : str
        Why the controller is out of reach and looked for; empty while it answers.
    """

    @property
    def rate(self) -> float:
        """Ticks a second."""
        ...  # pragma: no cover

    @property
    def signals(self) -> tuple[Signal, ...]:
        """Columns of what is measured, after the number of the tick."""
        ...  # pragma: no cover

    @property
    def tick(self) -> int:
        """Number of the last tick."""
        ...  # pragma: no cover

    @property
    def aim(self) -> Aim:
        """What is demanded."""
        ...  # pragma: no cover

    @property
    def load_most(self) -> float:
        """Largest force of the load drive either way, N; 0: there is none."""
        ...  # pragma: no cover

    @property
    def keeps_time(self) -> bool:
        """Whether its ticks come by themselves."""
        ...  # pragma: no cover

    @property
    def every(self) -> int:
        """Ticks from one row to the next."""
        ...  # pragma: no cover

    @property
    def process(self) -> int:
        """Process that answers every tick, or 0."""
        ...  # pragma: no cover

    @property
    def lost(self) -> str:
        """Why the controller is looked for; empty while it answers."""
        ...  # pragma: no cover

    def advance(self, ticks: int) -> FloatArray:
        """Go on by some ticks.

        Parameters
        ----------
        ticks : int
            At least 1.

        Returns
        -------
        ndarray, shape (n, 1 + len(signals))
            Number of the tick, and all signals at it. Of a virtual bench, which computes them, n is
            `ticks` and none is left out. One that keeps time waits until so many have passed and
            returns all that came since; a tick that never came has no row. While its controller is
            lost it has none at all.

        Raises
        ------
        InputError
            The controller hung up or does not answer, and is not looked for any more.
        """
        ...  # pragma: no cover

    def news(self) -> Sequence[str]:
        """Return what happened to the controller since this was last asked.

        It was lost, or is back: what was demanded, :attr:`aim` and parameters are to be read anew.
        """
        ...  # pragma: no cover

    def command(self, command: Command) -> None:
        """Give a command, which acts from the next tick on.

        Raises
        ------
        Refused
            The controller does not do it, and says why.
        """
        ...  # pragma: no cover

    def commands(self) -> tuple[Command, ...]:
        """Return the commands that this kind of controller has, in any state."""
        ...  # pragma: no cover

    def demand(self, value: float) -> None:
        """Demand a gap, m, of a bearing, or a force, N, of a magnet, from the next tick on.

        Raises
        ------
        InputError
            The controller refuses it, beyond its limits.
        """
        ...  # pragma: no cover

    def load(self, force: float) -> None:
        """Command a force, N, to the load drive, from the next tick on.

        Raises
        ------
        InputError
            The bench has no load drive.
        """
        ...  # pragma: no cover

    def parameters(self) -> tuple[Parameter, ...]:
        """Return all that may be changed, with the values in force."""
        ...  # pragma: no cover

    def apply(self, values: Mapping[str, float]) -> int:
        """Put some parameters in force together, or none of them.

        Parameters
        ----------
        values : mapping of str to float
            By name; others stay.

        Returns
        -------
        int
            Number of the first tick at which all of them are in force.

        Raises
        ------
        InputError
            No such parameter, a value out of its range, or one that may not be changed now.
        """
        ...  # pragma: no cover

    def close(self) -> None:
        """Let go of the rig."""
        ...  # pragma: no cover
