"""The controller of a stage as C: what is asked for, who compiles it, and what comes out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, Protocol

import numpy as np

from anhyst.compensate.force_controller import Io
from anhyst.compilation.manifest import CompiledFolder
from anhyst.support.atomic import PathLike
from anhyst.support.jobs import Progress
from anhyst.support.numeric import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

StageKind = Literal["full", "simplified", "play", "single-valued"]


@dataclass(frozen=True, repr=False)
class CompiledStage(CompiledFolder):
    """What came out.

    Parameters
    ----------
    out : Path
        The folder.
    manifest : dict
        What stands in ``manifest.json``, without the hashes of the files.
    files : tuple of str
        Names of the files.
    vectors : dict of str to array
        The flight: what the controller was given and answered, a number a tick.
    """

    vectors: dict[str, FloatArray]

    def facts(self) -> dict[str, str]:
        """Return where it is and what it is."""
        manifest, stage = self.manifest, self.manifest["stage"]
        about = f"{len(stage['free'])} coordinates, {stage['magnets']} magnets"
        return {
            "folder": str(self.out),
            "kind": manifest["kind"],
            "signals": manifest["io"],
            "force to current": stage["force_to_current"],
            "rate": f"{manifest['rate_Hz']:g} Hz",
            "stage": f"{about}, {stage['heads']} heads",
        }

    def to_columns(self) -> dict[str, Any]:
        """Return the flight."""
        return dict(self.vectors)

    def draw(self, ax: Axes) -> None:
        """Draw the currents of the flight."""
        time = np.arange(len(self.vectors["flags"])) / self.manifest["rate_Hz"]
        for number in range(1, self.manifest["stage"]["magnets"] + 1):
            ax.plot(time, self.vectors[f"current_{number}"], lw=1.0, label=f"magnet {number}")
        ax.set_xlabel("time [s]")
        ax.set_ylabel("current [A]" if self.manifest["io"] == "f32" else "current [code]")


@dataclass(frozen=True)
class StageRequest:
    """How the controller of a stage is compiled."""

    kind: StageKind
    io: Io
    rate: float | None  # ticks a second that are expected; the rig file says how many there are
    name: str | None  # of the C functions; that of the rig if left out


class HasController(Protocol):
    """A kind of rig whose controller can be compiled from the rig file."""

    def compile_controller(
        self, rig: PathLike, out: PathLike, request: StageRequest, progress: Progress | None
    ) -> CompiledStage:
        """Compile the controller to a folder of C."""
