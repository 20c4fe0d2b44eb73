"""Define request and result of compiling the controller of a stage."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, Protocol

import numpy as np

from anhyst.compensate.force_controller import SignalFormat
from anhyst.compilation.manifest import CompiledFolder
from anhyst.support.atomic import PathLike
from anhyst.support.jobs import Progress
from anhyst.support.numeric import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes

StageKind = Literal["full", "simplified", "play", "single-valued"]


@dataclass(frozen=True, repr=False)
class CompiledStage(CompiledFolder):
    """Result of compiling the controller of a stage.

    Parameters
    ----------
    out : Path
        The folder.
    manifest : dict
        Content of ``manifest.json``, without the hashes of the files.
    files : tuple of str
        Names of the files.
    vectors : dict of str to array
        Golden vectors of a simulated motion: inputs and outputs of the controller, one number per tick.
    """

    vectors: dict[str, FloatArray]

    def facts(self) -> dict[str, str]:
        """Return folder, kind, formats and size of the stage."""
        manifest, stage = self.manifest, self.manifest["stage"]
        stage_text = f"{len(stage['free'])} coordinates, {stage['magnets']} magnets"
        return {
            "folder": str(self.out),
            "kind": manifest["kind"],
            "signals": manifest["io"],
            "force to current": stage["force_to_current"],
            "rate": f"{manifest['rate_Hz']:g} Hz",
            "stage": f"{stage_text}, {stage['heads']} heads",
        }

    def to_columns(self) -> dict[str, Any]:
        """Return the golden vectors of the simulated motion."""
        return dict(self.vectors)

    def draw(self, ax: Axes) -> None:
        """Draw the currents of the simulated motion."""
        time = np.arange(len(self.vectors["flags"])) / self.manifest["rate_Hz"]
        for number in range(1, self.manifest["stage"]["magnets"] + 1):
            ax.plot(time, self.vectors[f"current_{number}"], lw=1.0, label=f"magnet {number}")
        ax.set_xlabel("time [s]")
        ax.set_ylabel("current [A]" if self.manifest["io"] == "f32" else "current [code]")


@dataclass(frozen=True)
class StageRequest:
    """Options for compiling the controller of a stage."""

    kind: StageKind
    io: SignalFormat
    rate: float | None  # expected sample rate, Hz; it must be that of the rig file
    name: str | None  # name of the C functions; None: name of the rig


class HasController(Protocol):
    """Kind of rig whose controller can be compiled from the rig file."""

    def compile_controller(
        self, rig: PathLike, out: PathLike, request: StageRequest, progress: Progress | None
    ) -> CompiledStage:
        """Compile the controller to a folder of C."""
