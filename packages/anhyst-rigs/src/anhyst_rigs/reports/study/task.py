"""Define the task of simulating a rig file, and write the files of its study."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from anhyst.data.table import check_recording
from anhyst.support.atomic import PathLike, check_writable
from anhyst.support.errors import InputError, NegativeResult
from anhyst.support.jobs import Progress
from anhyst_rigs.reports.study.page import REPORT_NAME, write_page
from anhyst_rigs.study.engine.monte_carlo import MonteCarlo
from anhyst_rigs.study.engine.table import FIGURES_FILE, StudyResult

MONTE_CARLO_NAME = "montecarlo.json"
"""File name for the metrics of drifted plants, in the folder of their results."""
Result = TypeVar("Result", bound=StudyResult)


@dataclass(frozen=True)
class SimulationTask:
    """A rig file, and the path for the results of its study."""

    rig: PathLike
    controller: PathLike | None
    out: Path
    writes_files: bool
    progress: Progress | None

    @property
    def report_path(self) -> Path:
        """Path of the page, in the folder of the recording."""
        return self.out.parent / REPORT_NAME

    def command(self, option: str = "") -> str:
        """Return the command that repeats the study."""
        controller_option = "" if self.controller is None else f" --controller {self.controller}"
        return f"anhyst simulate {self.rig}{controller_option} --out {self.out}{option}"

    def study(
        self,
        explore: Callable[[], Result],
        render: Callable[[Result, str], str],
        input_files: Sequence[PathLike],
    ) -> Result:
        """Run the study of a rig; on request, write the recording, the figures and the page."""
        if not self.writes_files:
            return explore()
        check_recording(self.out, input_files)
        for path in (self.out.parent / FIGURES_FILE, self.report_path):
            check_writable(path, input_files)
        try:
            result = explore()
            text = render(result, self.command())
        except NegativeResult:
            self.report_path.unlink(missing_ok=True)  # removes a page of another recording
            raise
        result.save(self.out)
        write_page(self.report_path, text)
        return result

    def require_suffix(self, suffix: str, what: str) -> None:
        """Raise an error if the output file has another extension."""
        if self.out.suffix != suffix:
            raise InputError(f"{self.out}: {what} written as {suffix}; name it so", code="wrong-ending")


def files_written(result: StudyResult, out: Path) -> str:
    """Return a text with the names of the written files: recording, figures and page."""
    figures = MONTE_CARLO_NAME if isinstance(result, MonteCarlo) else FIGURES_FILE
    return ", ".join(map(str, (out, out.parent / figures, out.parent / REPORT_NAME)))
