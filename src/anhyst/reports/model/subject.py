"""What one report is about: a model, what is known of it, and the scales its numbers are in."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

from anhyst.model.acceptance import Acceptance, DriveCheck, GapCheck
from anhyst.model.actuator import Model
from anhyst.model.fit_record import FitFigures
from anhyst.reports.model.evidence import Evidence
from anhyst.support.page.numbers import Scale, name_of, scale_for


@dataclass(frozen=True, eq=False)
class ModelSubject:
    """A model under report."""

    model: Model  # the model
    fit: FitFigures | None  # those that belong to its parameters
    # outcome of the acceptance test over the gap; None where it does not apply
    check: GapCheck | None
    evidence: Evidence | None  # none where the measurements could not be read
    absent: str = ""  # why they could not; empty if they could
    warnings: tuple[str, ...] = ()  # what a reader has to know before anything else
    # outcome of the acceptance test over the drive; None where it does not apply
    over_drive: DriveCheck | None = None
    _pictures: Iterator[int] = field(default_factory=lambda: iter(range(1, 1000)))

    @property
    def acceptance(self) -> Acceptance:
        """Outcome of the acceptance test, over the gap and over the drive."""
        return Acceptance(self.check, self.over_drive)

    def next_prefix(self) -> str:
        """Give an identifier that no other figure of the page has."""
        return f"f{next(self._pictures)}"

    @property
    def over(self) -> str:
        """Name of the scheduling variable in a sentence."""
        return name_of(self.model.schedule) if self.model.schedule else ""

    @property
    def answer(self) -> str:
        """Name of the output in a sentence."""
        return name_of(self.model.output)

    @property
    def drive(self) -> str:
        """Name of the input in a sentence."""
        return name_of(self.model.input)

    @property
    def deviation(self) -> Scale:
        """Scale of deviations of the output: that of their mean."""
        return scale_for(self.model.output, [self.fit.mean_abs] if self.fit else [])

    @property
    def input_scale(self) -> Scale:
        """Scale of the input: that of its valid range."""
        return scale_for(self.model.input, self.model.valid.input if self.model.valid else [])

    @property
    def output_scale(self) -> Scale:
        """Scale of the output: that of its valid range."""
        return scale_for(self.model.output, self.model.valid.output if self.model.valid else [])

    @property
    def schedule_scale(self) -> Scale:
        """Scale of the scheduling variable: that of its nodes."""
        schedule = self.model.schedule
        return scale_for(schedule, self.model.nodes) if schedule else Scale(1.0, "")
