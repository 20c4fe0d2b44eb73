"""Test the plausibility of a model: the force rises as the gap closes and as the current rises.

The first test is that of the paper (II.C), at any fixed current. The second test applies at any
fixed gap, from the demagnetised state and from remanence.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from anhyst.data.output_map import output_map
from anhyst.model.model_data import ModelData
from anhyst.model.predict import run_record, slow_times
from anhyst.support.errors import InputError, NegativeResult
from anhyst.support.numeric import FloatArray

GAPS_PER_INTERVAL = 20
DRIVES_PER_BRANCH = 100

MAX_OUTPUT_FALL = 1e-4
"""Largest fall of the output, relative to the largest output, that is ignored. It is a tenth of the
resolution of the best force sensors, and far above rounding errors."""

MAX_SENSOR_OFFSET = 0.02
"""Largest plausible offset of a sensor, relative to the range. The sensor can cause
a difference of offsets between gaps up to this size. A larger one is a fault of the model."""


@dataclass(frozen=True, eq=False)
class GapCheck:
    """Result of the acceptance test over the gap."""

    gaps: FloatArray  # dense grid of gaps, ascending, m; shape (g,)
    # steady-state cycle, ascending then descending branch, in units of the input, as read by the
    # sensor of the gap with the largest offset; shape (n,)
    drive: FloatArray
    # output over this cycle at each gap, with the sensor offset; NaN if the model could not be
    # computed; shape (g, n)
    output: FloatArray
    # offset of the output minus the smallest offset of all gaps, which is subtracted before the
    # test, up to :data:`MAX_SENSOR_OFFSET`; shape (g,)
    offset: FloatArray
    fall: float  # largest fall of the output towards a smaller gap, relative to the largest output
    gap: float  # gap with the largest fall, m
    at_drive: float  # drive at the largest fall, in units of the input
    branch: str  # ``"rising"`` or ``"falling"``
    # 1 if the output must rise; -1 if it is negative and must rise in magnitude
    sign: float = 1.0
    failure: str = ""  # reason why a gap could not be computed; empty if all could

    @property
    def failing(self) -> tuple[float, ...]:
        """Gaps where the output falls or could not be computed, m."""
        relative_falls = _falls_as_gap_closes(self.sign * self.output, self.sign * self.offset)
        has_fallen = np.fmax.reduce(relative_falls, axis=1, initial=0.0) > MAX_OUTPUT_FALL
        return tuple(self.gaps[has_fallen | np.isnan(self.output).any(axis=1)].tolist())

    @property
    def passed(self) -> bool:
        """Whether the output rises everywhere as the gap closes."""
        return not self.failure and self.fall <= MAX_OUTPUT_FALL

    def text(self, unit: str) -> str:
        """Return the result as a sentence; ``unit`` is the unit of the drive."""
        gap_text = f"{1e3 * self.gap:.4g} mm"
        if self.failure:
            return f"the model cannot be computed at a gap of {gap_text}: {self.failure}"
        if self.passed:
            gap_range_text = f"{1e3 * self.gaps[0]:.4g} to {1e3 * self.gaps[-1]:.4g} mm"
            return f"at every drive the output rises as the gap closes ({gap_range_text}, both branches)"
        return (
            f"the output falls as the gap closes: by {100 * self.fall:.2g} % of the largest output, at "
            f"{gap_text} and {self.at_drive:.4g} {unit} on the {self.branch} branch; "
            "no electromagnet with a simple gap does that; do not use the model there"
        )


@dataclass(frozen=True, slots=True)
class DriveCheck:
    """Result of the acceptance test over the drive."""

    # largest fall of the output as the drive rises from rest, relative to the largest output
    fall: float
    at_drive: float  # drive at the largest fall, in units of the input
    where: str  # gap and initial state, in words
    failure: str = ""  # reason why the output could not be computed; empty if it could

    @property
    def passed(self) -> bool:
        """Whether the output never falls as the drive rises."""
        return not self.failure and self.fall <= MAX_OUTPUT_FALL

    def text(self, unit: str) -> str:
        """Return the result as a sentence; ``unit`` is the unit of the drive."""
        if self.failure:
            return f"the model cannot be computed {self.where}: {self.failure}"
        if self.passed:
            return "the output never falls as the drive rises from rest"
        return (
            f"the output falls as the drive rises: by {100 * self.fall:.2g} % of the largest output, at "
            f"{self.at_drive:.4g} {unit} {self.where}; no electromagnet does that; do not use the "
            "model there"
        )


def check_over_drive(model: ModelData) -> DriveCheck | None:
    """Test that the force never falls as the drive rises from rest, at any fixed gap.

    The test starts from the demagnetised state and from remanence after the largest drive. It uses
    100 drives up to the largest measured drive, at each node and half-way between nodes. Rest is
    the sensor reading at zero drive, but at most :data:`MAX_SENSOR_OFFSET` of the largest drive.
    """
    if not output_map(model.output).is_even or model.valid is None:
        return None
    largest_drive = _largest_drive(model)
    rest_drive = _rest_drive(model, MAX_SENSOR_OFFSET)
    ascending_drive = np.linspace(rest_drive, largest_drive, DRIVES_PER_BRANCH)
    start_by_history = {
        "demagnetised": "from the demagnetised state",
        f"conditioned:{rest_drive!r},{largest_drive!r},{rest_drive!r}": "from remanence",
    }
    worst_check = DriveCheck(0.0, rest_drive, "")
    largest_output = max(map(abs, model.valid.output))
    gaps: list[float | None] = [None]
    if model.needs_schedule:
        nodes = np.array(model.nodes)
        gaps = [*np.sort([*nodes, *(0.5 * (nodes[1:] + nodes[:-1]))]).tolist()]
    for gap in gaps:
        for history, start_text in start_by_history.items():
            start_description = start_text
            if gap is not None and model.schedule is not None:
                start_description = f"at {model.schedule.show(gap)} {start_text}"
            try:
                time = slow_times(ascending_drive.size)
                output = run_record(model, "drive", ascending_drive, gap, time, history).output
            except (InputError, NegativeResult) as error:
                return DriveCheck(np.inf, rest_drive, start_description, str(error))
            output_falls = np.maximum.accumulate(output) - output
            row = int(np.argmax(output_falls))
            largest_fall = float(output_falls[row]) / max(largest_output, np.finfo(np.float64).tiny)
            if largest_fall > worst_check.fall:
                worst_check = DriveCheck(largest_fall, float(ascending_drive[row]), start_description)
    return worst_check


@dataclass(frozen=True, slots=True)
class Acceptance:
    """Results of the tests over gap and drive; None if a test does not apply."""

    over_gap: GapCheck | None
    over_drive: DriveCheck | None

    def _applicable_checks(self) -> list[GapCheck | DriveCheck]:
        return [check for check in (self.over_gap, self.over_drive) if check is not None]

    @property
    def passed(self) -> bool | None:
        """Whether all applicable tests have passed; None if none applies."""
        checks = self._applicable_checks()
        return all(check.passed for check in checks) if checks else None

    def text(self, unit: str) -> str:
        """Return the failed tests, otherwise the passed ones; ``unit`` is the unit of the drive."""
        checks = self._applicable_checks()
        failed_checks = [check for check in checks if not check.passed]
        return "; ".join(check.text(unit) for check in failed_checks or checks)


def check_acceptance(model: ModelData) -> Acceptance:
    """Run the acceptance tests over gap and drive."""
    return Acceptance(check_over_gap(model), check_over_drive(model))


def check_over_gap(model: ModelData, at: Callable[[float], ModelData] | None = None) -> GapCheck | None:
    """Test that the output rises as the gap closes, at any fixed drive.

    The steady-state cycle between rest and the largest measured drive is computed on a dense grid
    of gaps between all nodes, with 100 drives on each branch. Rest is the offset of the input: a
    smaller drive would demagnetise the iron, most at the smallest gap. Differences of the sensor
    offsets between gaps are removed first, up to :data:`MAX_SENSOR_OFFSET`.
    """
    if model.schedule is None or model.schedule.name != "gap" or not model.varying:
        return None
    if len(model.nodes) < 2 or model.valid is None or model.output.name == "thrust":
        return None  # a thrust has no closing gap
    nodes = np.array(model.nodes)
    fractions = np.arange(GAPS_PER_INTERVAL) / GAPS_PER_INTERVAL
    gaps = np.append((nodes[:-1, None] + np.diff(nodes)[:, None] * fractions).ravel(), nodes[-1])
    ascending_drive = np.linspace(_rest_drive(model), _largest_drive(model), DRIVES_PER_BRANCH)
    drive = np.concatenate([ascending_drive, ascending_drive[-2::-1]])
    # the output must rise in magnitude
    sign = -1.0 if not output_map(model.output).is_even and ascending_drive[-1] < 0.0 else 1.0
    output = np.full((gaps.size, drive.size), np.nan)
    offset = np.zeros(gaps.size)
    failures: list[tuple[float, str]] = []
    for index, gap in enumerate(gaps.tolist()):
        try:
            model_at_gap, schedule = (model, gap) if at is None else (at(gap), None)
            offset[index] = model_at_gap.interpolate_parameter("out_0", gap)[0] - np.min(
                model.parameters["out_0"]
            )
            largest_drive = _largest_drive(model)
            ratios = np.atleast_1d(model.parameters["in_0"]) / largest_drive
            ratio = model_at_gap.interpolate_parameter("in_0", gap)[0] / largest_drive
            applied_drive = drive - largest_drive * float(
                np.clip(ratios.max() - ratio, 0.0, MAX_SENSOR_OFFSET)
            )
            time = slow_times(drive.size)
            output[index] = run_record(model_at_gap, "drive", applied_drive, schedule, time, "settled").output
        except (InputError, NegativeResult) as error:
            failures.append((gap, str(error)))
    if failures:
        gap, failure = failures[0]
        return GapCheck(gaps, drive, output, offset, np.inf, gap, 0.0, "rising", sign, failure)
    relative_fall = _falls_as_gap_closes(sign * output, sign * offset)
    gap_index, sample = np.unravel_index(int(np.argmax(relative_fall)), relative_fall.shape)
    worst_point = (float(relative_fall[gap_index, sample]), float(gaps[gap_index]), float(drive[sample]))
    branch = "rising" if sample < DRIVES_PER_BRANCH else "falling"
    return GapCheck(gaps, drive, output, offset, *worst_point, branch, sign)


_NEGATIVE_END_RATIO = 1.05
"""Factor by which the negative end must be further from zero to be the largest drive."""


def _largest_drive(model: ModelData) -> float:
    """Return the end of the valid input range that is further from zero magnetisation.

    This is zero drive or, with a bias, the offset of the input. If both ends are about equally far,
    the positive end is returned, so that sensor noise does not decide.
    """
    low, high = model.valid_range.input
    offset = float(np.mean(model.parameters["in_0"]))
    return low if abs(low - offset) > _NEGATIVE_END_RATIO * abs(high - offset) else high


def _rest_drive(model: ModelData, max_share: float = 0.5) -> float:
    """Return the largest input offset of all nodes, from 0 to `max_share` of the largest drive."""
    largest_drive = _largest_drive(model)
    offset_ratios = np.atleast_1d(model.parameters["in_0"]) / largest_drive
    return largest_drive * float(np.clip(offset_ratios.max(), 0.0, max_share))


def _falls_as_gap_closes(output: FloatArray, offset: FloatArray) -> FloatArray:
    """Return the fall of the output below that of any wider gap, relative to the largest output."""
    smallest_output = np.finfo(np.float64).tiny
    largest_output = float(np.fmax.reduce(np.abs(output), axis=None, initial=smallest_output))
    max_offset = MAX_SENSOR_OFFSET * largest_output
    closing_order = (output - np.clip(offset, -max_offset, max_offset)[:, None])[::-1]
    running_maximum = np.fmax.accumulate(closing_order, axis=0)
    return (running_maximum - closing_order)[::-1] / largest_output
