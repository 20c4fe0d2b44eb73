"""A recording of one run, watched as if it were running."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from anhyst.data import Loops
from anhyst.data.output_map import is_actuator
from anhyst.data.reading import read_loops
from anhyst.model.actuator import Model
from anhyst.model.file import read_model
from anhyst.study.watch.drift import DriftWatch, Finding
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError


@dataclass(frozen=True)
class Watched:
    """What a recording says about a model; the shift in N, times in s from its begin."""

    finding: Finding
    rate: float  # ticks a second, in which the finding counts

    def __str__(self) -> str:
        return self.finding.text(self.rate)

    def as_dict(self) -> dict[str, Any]:
        """Return it for JSON."""
        drifted = self.finding.drifted
        return {
            "cycles": self.finding.cycles,
            "learning": self.finding.learning,
            "fits": drifted is None and not self.finding.learning,
            "drift": None if drifted is None else drifted.name,
            "shift_N": None if drifted is None else drifted.shift,
            "since_s": None if drifted is None else drifted.since / self.rate,
            "text": str(self),
        }


def watch(
    model: Model | PathLike,
    recording: Loops | PathLike,
    *,
    least: float | None = None,
    run_length: float = 1e5,
) -> Watched:
    """Say whether a model still fits its magnet, or since when it has drifted and by how much.

    Parameters
    ----------
    model : Model or path-like
        The model, or its file.
    recording : Loops or path-like
        One run of force over current and gap, with its times.
    least : float, optional
        Smallest drift worth an alarm, N; a thousandth of the model's largest force if left out.
    run_length : float
        Mean number of cycles to a false alarm.

    Returns
    -------
    Watched

    Raises
    ------
    InputError
        The recording is no single run, or has no time or gap.
    """
    if least is not None and not least > 0.0:
        raise InputError(
            f"--least: {least:g} N is not above 0; correct it", code="not-above-zero", key="--least"
        )
    if not isinstance(model, Model):
        model = read_model(model)
    if not isinstance(recording, Loops):
        recording = read_loops(recording)
    if len(recording) != 1 or not is_actuator(recording):
        raise InputError(
            "a recording is one run with columns t_s, I_A, F_N and gap_m", code="columns-missing"
        )
    (run,) = recording.loops
    if run.time is None or run.schedule is None:
        raise InputError("a recording needs columns t_s and gap_m", code="columns-missing")
    watched = DriftWatch(
        model, float(run.schedule[0]), run.history, run_length=run_length, least=least
    )
    ticks = np.arange(run.n, dtype=np.float64)
    found = watched.take(ticks, run.input, run.schedule, run.output)
    return Watched(found, (run.n - 1) / float(run.time[-1] - run.time[0]))
