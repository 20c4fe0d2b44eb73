"""What a motion is judged by: servo error, moving average and deviation, settling, force error."""

# ruff: noqa: N815 - names carry units

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

from anhyst.rig.file import RigFile
from anhyst.rig.recording import Recording, moving, peak, rms, settled_from
from anhyst.rig.stage.file import error_columns, scan_direction, unit_of
from anhyst.rig.stage.setpoint import SetPoint
from anhyst.study.table import Metric
from anhyst.support.numeric import FloatArray

BANDS_M = (50e-9, 10e-9)
"""Into which the settling is measured."""
EXPOSE_AFTER_S = 5e-3
"""After the end of the acceleration, from where on the moving average is judged."""


PEAK = Metric("peak_m", "peak", "nm", 1e9)
AVERAGE = Metric("average_m", "moving average", "nm", 1e9)
SETTLING = Metric("settling_50_s", "settling to 50 nm", "ms", 1e3)
METRICS = (
    PEAK,
    AVERAGE,
    Metric("deviation_m", "deviation over the slit", "nm", 1e9),
    SETTLING,
    Metric("settling_10_s", "settling to 10 nm", "ms", 1e3),
    Metric("force_peak_N", "force error, largest", "N"),
    Metric("force_rms_N", "force error, rms", "N"),
)
"""By which a motion is judged, in the order of every table."""


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


def cross_metrics(file: RigFile) -> list[Metric]:
    """Return the figures of :func:`cross_talk`."""
    units = {axis: unit_of(axis) for axis in still_axes(file)}
    return [Metric(f"{axis}_{u}", f"{axis}, largest", f"n{u}", 1e9) for axis, u in units.items()]


def still_axes(file: RigFile) -> list[str]:
    """Return the coordinates that the set-point does not move; none of a body of one coordinate."""
    if not file.several:
        return []
    parts = zip(file.body.free, scan_direction(file).tolist(), strict=True)
    return [axis for axis, part in parts if part == 0.0]


def cross_talk(run: Recording, motion: SetPoint, still: Sequence[str]) -> dict[str, float]:
    """Return the largest error of each coordinate that stands still, by axis and unit, m or rad.

    The first scan is left out.
    """
    names = [f"{axis}_{unit_of(axis)}" for axis in still]
    if run.loss is not None:
        return dict.fromkeys(names, math.inf)
    since = round(motion.pulses[1][0] / run.dt)
    columns = zip(names, error_columns(still), strict=True)
    return {name: peak(run[column][since:]) for name, column in columns}


def cruises(motion: SetPoint, dt: float) -> list[slice]:
    """Return the ticks of each cruise, that after the first acceleration left out."""
    pulses = motion.pulses
    ends = [begin for begin, _, _ in pulses[1:]] + [motion.duration]
    whole = [
        slice(round((begin + length) / dt), round(end / dt))
        for (begin, length, _), end in zip(pulses, ends, strict=True)
    ]
    return whole[1:]


def settling(run: Recording, motion: SetPoint, band: float) -> list[float]:
    """Return for each scan how long it takes until the error stays within a band, s."""
    error, dt = run["error_m"], run.dt
    return [dt * settled_from(error[cruise], band) for cruise in cruises(motion, dt)]


def exposures(
    error: FloatArray, motion: SetPoint, slit: float, dt: float
) -> list[tuple[FloatArray, FloatArray]]:
    """Return the moving average and deviation of an error over a slit, s, in each cruise."""
    late, ticks = round(EXPOSE_AFTER_S / dt), round(slit / dt)
    return [
        moving(error[cruise.start + late : cruise.stop], ticks) for cruise in cruises(motion, dt)
    ]


def measure(run: Recording, motion: SetPoint, slit: float) -> Measures:
    """Judge a run with a slit of so many seconds."""
    if run.loss is not None:
        return LOST
    windows = exposures(run["error_m"], motion, slit, run.dt)
    since = round(motion.pulses[1][0] / run.dt)
    error, force = run["error_m"][since:], run["force_error_N"][since:]
    return Measures(
        peak_m=peak(error),
        rms_m=rms(error),
        average_m=max(peak(mean) for mean, _ in windows),
        deviation_m=max(float(deviation.max()) for _, deviation in windows),
        settling_50_s=float(np.mean(settling(run, motion, BANDS_M[0]))),
        settling_10_s=float(np.mean(settling(run, motion, BANDS_M[1]))),
        force_peak_N=peak(force),
        force_rms_N=rms(force),
    )
