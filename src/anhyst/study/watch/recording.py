"""A recording of one run, watched as if it were running."""

from __future__ import annotations

import numpy as np

from anhyst.data import Loops
from anhyst.data.output_map import is_electromagnet
from anhyst.model.actuator import Model
from anhyst.study.watch.drift import DriftWatch, Finding
from anhyst.support.errors import InputError


def watch_recording(
    model: Model, recording: Loops, least: float | None, run_length: float
) -> tuple[Finding, float]:
    """Hold a recording against a model, cycle by cycle.

    Parameters
    ----------
    model : Model
    recording : Loops
        One run of force over current and gap, with its times.
    least : float or None
        Smallest drift worth an alarm, N.
    run_length : float
        Mean number of cycles to a false alarm.

    Returns
    -------
    Finding, float
        What is known at the end, and the ticks a second in which it counts.

    Raises
    ------
    InputError
        The recording is no single run, or has no time or gap.
    """
    if len(recording) != 1 or not is_electromagnet(recording):
        raise InputError(
            "a recording is one run with columns t_s, I_A, F_N and gap_m", code="columns-missing"
        )
    (run,) = recording.loops
    if run.time is None or run.schedule is None:
        raise InputError("a recording needs columns t_s and gap_m", code="columns-missing")
    watch = DriftWatch(
        model, float(run.schedule[0]), run.history, run_length=run_length, least=least
    )
    ticks = np.arange(run.n, dtype=np.float64)
    found = watch.take(ticks, run.input, run.schedule, run.output)
    return found, (run.n - 1) / float(run.time[-1] - run.time[0])
