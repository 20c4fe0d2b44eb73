"""What a motion is judged by: servo error, moving average and deviation, settling, force error."""

# ruff: noqa: N815 - names carry units

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

import numpy as np

from anhyst.rig.stage.loop import TrackedRun
from anhyst.support.arrays import FloatArray

BANDS_M = (50e-9, 10e-9)
"""Into which the settling is measured."""
EXPOSE_AFTER_S = 5e-3
"""After the end of the acceleration, from where on the moving average is judged."""


@dataclass(frozen=True)
class Measures:
    """Figures of one run; the first scan, into which the iron comes demagnetised, is left out."""

    peak_m: float  # largest error
    rms_m: float  # of the error
    # largest moving average and standard deviation over the slit, in windows that begin 5 ms or
    # more after the acceleration and end with the cruise
    average_m: float
    deviation_m: float
    # from the end of the acceleration until the error stays within 50 and 10 nm, mean of the scans;
    # a scan that never does counts with the whole cruise
    settling_50_s: float
    settling_10_s: float
    force_peak_N: float  # force less what was demanded a delay earlier
    force_rms_N: float

    @property
    def lost(self) -> bool:
        """Whether the loop was lost in the run."""
        return math.isinf(self.peak_m)

    def as_dict(self) -> dict[str, float]:
        """Return them by name."""
        return asdict(self)


LOST = Measures(*[float("inf")] * 8)
"""Of a run in which the loop was lost."""


def cruises(run: TrackedRun) -> list[slice]:
    """Return the ticks of each cruise, that after the first acceleration left out."""
    pulses = run.motion.pulses
    ends = [begin for begin, _, _ in pulses[1:]] + [run.motion.duration]
    whole = [
        slice(round((begin + length) / run.dt), round(end / run.dt))
        for (begin, length, _), end in zip(pulses, ends, strict=True)
    ]
    return whole[1:]


def judged_from(run: TrackedRun) -> int:
    """Return the tick from which on a run counts."""
    return round(run.motion.pulses[1][0] / run.dt)


def moving(error: FloatArray, ticks: int) -> tuple[FloatArray, FloatArray]:
    """Return mean and standard deviation over every window of so many ticks."""
    sums = np.cumsum(np.concatenate([[0.0], error]))
    squares = np.cumsum(np.concatenate([[0.0], error**2]))
    mean = (sums[ticks:] - sums[:-ticks]) / ticks
    square = (squares[ticks:] - squares[:-ticks]) / ticks
    return mean, np.sqrt(np.maximum(square - mean**2, 0.0))


def settling(run: TrackedRun, band: float) -> list[float]:
    """Return for each scan how long it takes until the error stays within a band, s."""
    found = []
    for cruise in cruises(run):
        outside = np.flatnonzero(np.abs(run.error[cruise]) > band)
        found.append(run.dt * (int(outside[-1]) + 1) if outside.size else 0.0)
    return found


def measure(run: TrackedRun, slit: float) -> Measures:
    """Judge a run with a slit of so many seconds."""
    if run.loss is not None:
        return LOST
    late, ticks = round(EXPOSE_AFTER_S / run.dt), round(slit / run.dt)
    windows = [
        moving(run.error[cruise.start + late : cruise.stop], ticks) for cruise in cruises(run)
    ]
    since = judged_from(run)
    error, force = run.error[since:], run.force_error[since:]
    return Measures(
        peak_m=float(np.abs(error).max()),
        rms_m=float(np.sqrt(np.mean(error**2))),
        average_m=max(float(np.abs(mean).max()) for mean, _ in windows),
        deviation_m=max(float(deviation.max()) for _, deviation in windows),
        settling_50_s=float(np.mean(settling(run, BANDS_M[0]))),
        settling_10_s=float(np.mean(settling(run, BANDS_M[1]))),
        force_peak_N=float(np.abs(force).max()),
        force_rms_N=float(np.sqrt(np.mean(force**2))),
    )
