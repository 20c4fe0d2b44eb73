"""Convert the controller of a stage to fixed-point words, with a full scale for each quantity.

The input is a controller in SI units: pose of the heads, PID filters, masses, and the layout of the
magnets (drives). ``core/include/anhyst/control/axes_fixed.h`` and ``wrench_fixed.h`` run the
result. Full scales are powers of two, except for the full scales of the force controllers.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from anhyst._core import FixedAxes, FixedForceController, ForceController, ForceControllerF32
from anhyst.support.errors import InputError, wrong_key
from anhyst.support.numeric import FloatArray, to_q31

_ROW_BITS = 27
_MAX_ROW_SHIFT = 58
_PID_BITS = 29
_MAX_PID_SHIFT = 29
_MIN_PID_NUMBER = 512  # a smaller number would be rounded by more than 0.1 %
_Q31 = 2.0**31
_Q30 = 2.0**30
FULL_SCALE_MARGIN = 2.0
"""Factor between a full scale and the largest plausible or producible value."""

_CORE_SCALES = ("wrench", "head", "current", "gap_low", "gap_high")
Words = dict[str, NDArray[Any]]
CoreForceController = ForceController | ForceControllerF32 | FixedForceController
"""Force controller of the core. A fixed-point stage accepts only fixed-point controllers."""


class DriveLayout(NamedTuple):
    """Lines of action of the drives, and the limits of their forces; SI."""

    unit_wrench: FloatArray  # wrench of 1 N of each drive; one row per drive
    opponents: Sequence[int]  # index of the opposing drive; its own index if there is none
    drop_weights: Sequence[float]  # relative weight with which a coordinate may be given up
    allocation: int
    idle_force: float  # idle force of both drives of a pair, N
    force_min: float  # smallest force of a drive without an opponent, N
    force_max: float  # largest force of each drive, N


@dataclass(frozen=True)
class FixedScales:
    """Full scale of each quantity, SI."""

    head: float  # reading of a head, m
    pose: FloatArray  # coordinates of the pose, m or rad
    acceleration: FloatArray  # acceleration of each coordinate, m/s^2 or rad/s^2
    wrench: FloatArray  # force or torque of each coordinate, N or N m
    force: float  # force of a drive, N
    current: float  # current of a drive, A
    gap_low: float  # gap with the lowest code, m
    gap_high: float  # gap with the highest code, m

    def as_dict(self) -> dict[str, float | list[float]]:
        """Return all full scales, for JSON."""
        return {key: np.asarray(value).tolist() for key, value in vars(self).items()}

    def gaps(self, gap: FloatArray) -> FloatArray:
        """Return the codes of gaps."""
        span = self.gap_high - self.gap_low
        return encode_signals(np.clip(gap - self.gap_low, 0.0, span), span)


@dataclass(frozen=True)
class FixedController:
    """Controller of a stage in fixed point, with the names of the core."""

    words: Words  # tables; `..._shift` contains the shifts of the rows of a table
    integers: dict[str, int]
    scales: FixedScales
    head_rows: FloatArray  # matrix from a pose to the head readings; one row per head

    def make_core(self, magnets: Sequence[CoreForceController], flux: float) -> FixedAxes:
        """Return the core's stage controller; `flux`: full-scale flux density, T."""
        scales = {key: value for key, value in self.scales.as_dict().items() if key in _CORE_SCALES}
        full_scale = scales | {"at": self.head_rows.ravel().tolist(), "flux": flux}
        return FixedAxes(list(magnets), self.words, self.integers, full_scale)


def encode_signals(value: FloatArray, full_scale: float | FloatArray) -> FloatArray:
    """Return the nearest codes of signals; NaN becomes the lowest number."""
    saturated = np.clip(np.floor(value / full_scale * _Q31 + 0.5), 1.0 - _Q31, _Q31 - 1.0)
    return np.where(np.isnan(saturated), -_Q31, saturated)


def make_fixed_allocation(
    drives: DriveLayout, wrench: FloatArray, force: float
) -> tuple[Words, dict[str, int]]:
    """Return words and integers of the allocation of a wrench, for full scales of wrench and force."""
    opponents = np.array(drives.opponents)
    is_first_of_pair = opponents >= np.arange(len(opponents))
    size = np.sqrt((drives.unit_wrench**2).sum(axis=0))
    normalised = np.where(is_first_of_pair[:, None], drives.unit_wrench / size, 0.0).T
    identity = np.diag(is_first_of_pair.astype(float))
    words: Words = {"against": opponents[:, None].astype(float)}
    for name, diagonal_weights in (("whole", 0.0 * size), ("yields", np.array(drives.drop_weights))):
        allocation = np.linalg.solve(normalised @ normalised.T + np.diag(diagonal_weights), normalised).T
        words |= _scale_rows(name, (allocation / size) * wrench / (8.0 * force))
        words[f"{name}_apart"] = np.clip(np.round((identity - allocation @ normalised) * _Q30), -_Q30, _Q30)
    return _as_core_integers(words), {
        "axes": len(size),
        "drives": len(opponents),
        "allocation": int(drives.allocation),
        "idle": to_q31(drives.idle_force / force),
        "least": max(to_q31(drives.force_min / force), 2 - int(_Q31)),
        "most": to_q31(min(drives.force_max / force, 1.0)),
    }


def make_fixed_controller(
    rows: Mapping[str, FloatArray], drives: DriveLayout, settings: Mapping[str, float]
) -> FixedController:
    """Return all words of a controller, from its matrices and settings in SI."""
    scales = _choose_full_scales(rows, drives, settings)
    pose, wrench = scales.pose, scales.wrench
    words, numbers = make_fixed_allocation(drives, wrench, scales.force)
    heads = len(rows["at"])
    pose_rows = rows["without"].reshape(heads * len(pose), heads)
    words |= _scale_rows("see", rows["see"] * scales.head / pose[:, None])
    words |= _scale_rows("without", pose_rows * scales.head / np.tile(pose, heads)[:, None])
    words |= _scale_rows("decouple", rows["decouple"] * pose / pose[:, None])
    words |= _scale_rows("weigh", rows["weigh"] * scales.acceleration / wrench[:, None])
    gain = (pose / scales.acceleration).tolist()
    words["pid"] = np.array([_pid_words(*row) for row in zip(rows["pid"].tolist(), gain, strict=True)])
    for name in ("reach", "land", "lift"):
        words[name] = encode_signals(rows[name], pose[:, None])
    if not (words["lift"] > 0.0).all():
        raise _range_error("small", "control.lift_m_per_s")
    ends = ("low", "high", "step")
    low, high, step = (to_q31(settings[f"current_{end}"] / scales.current) for end in ends)
    high = low + (high - low) // step * step  # last current on the converter's grid
    numbers |= {"current_low": low, "current_high": high, "current_step": step}
    numbers |= {"heads": heads, "follow": to_q31(settings["follow"])}
    numbers |= {key: to_q31(settings[key] / scales.current) for key in ("slew", "off")}
    numbers["jump"] = to_q31(settings["jump"] / scales.head)
    integer_keys = ("off_ticks", "spare", "land_ticks", "spare_heads", "doubt", "noisy")
    numbers |= {key: int(settings[key]) for key in integer_keys}
    return FixedController(_as_core_integers(words), numbers, scales, rows["at"])


def make_feedforward_rows(
    mass: FloatArray, weight: FloatArray, scales: FixedScales
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return matrix rows from accelerations to a wrench, their shifts, and codes of the weight."""
    words = _scale_rows("mass", mass * scales.acceleration / scales.wrench[:, None])
    return words["mass"], words["mass_shift"], encode_signals(weight, scales.wrench)


def _choose_full_scales(
    rows: Mapping[str, FloatArray], drives: DriveLayout, settings: Mapping[str, float]
) -> FixedScales:
    """Return the full scales: powers of two, except for those of the force controllers."""
    largest_errors = rows["reach"][:, 0]
    pose = np.maximum(largest_errors, np.abs(rows["decouple"]) @ largest_errors)
    wrench = _round_full_scale(np.abs(drives.unit_wrench).sum(axis=0) * drives.force_max)
    return FixedScales(
        head=float(_round_full_scale((np.abs(rows["at"]) @ largest_errors).max())),
        pose=_round_full_scale(pose),
        acceleration=_round_full_scale(wrench / np.abs(np.diag(rows["weigh"]))),
        wrench=wrench,
        force=settings["demand_full"],
        current=settings["current_full"],
        gap_low=settings["gap_low"],
        gap_high=settings["gap_high"],
    )


def _round_full_scale(maximum: FloatArray) -> FloatArray:
    return np.asarray(2.0 ** np.ceil(np.log2(FULL_SCALE_MARGIN * maximum)))


def _as_core_integers(words: Words) -> Words:
    """Return the words in the integer types of the core."""
    short_names = {name for name in words if name.endswith("_shift") or name == "against"}
    return {key: words[key].astype(np.uint16 if key in short_names else np.int32) for key in words}


def _scale_rows(name: str, values: FloatArray) -> Words:
    """Return the rows of a matrix as integers, each with its own shift."""
    size = np.abs(values).max(axis=1)
    shift = np.floor(_ROW_BITS - np.log2(np.maximum(size, 2.0**-1000)))
    if (shift < 0.0).any():
        raise _range_error("large", name)
    shift = np.minimum(shift, _MAX_ROW_SHIFT)
    return {name: np.round(values * 2.0 ** shift[:, None]), f"{name}_shift": shift[:, None]}


def _pid_words(filter_: Sequence[float], gain: float) -> list[float]:
    """Return the words of a PID filter: partial fractions of an integral and another real pole.

    `gain` converts the filter from SI units to codes.
    """
    b0, b1, b2, a1, pole = filter_
    if abs(1.0 + a1 + pole) > 1e-9 or not -1.0 < pole < 1.0:
        raise ValueError("a PID has a pole at 1 and one within the unit circle")
    c1, c0, decay = b1 - b0 * a1, b2 - b0 * pole, 1.0 - pole
    fractions = [gain * b0, gain * (c1 + c0) / decay, -gain * (c1 * pole + c0) / decay]
    size = max(abs(fractions[0]), abs(fractions[1]), abs(fractions[2]) / min(decay, 1.0))
    shift = min(math.floor(_PID_BITS - math.log2(size)), _MAX_PID_SHIFT)
    numbers = [round(fraction * 2.0**shift) for fraction in fractions]
    if shift < 0:
        raise _range_error("large", "control.crossover_Hz")
    if abs(numbers[1]) < _MIN_PID_NUMBER:
        raise _range_error("small", "control.integral_ratio")
    return [*numbers, min(round(decay * _Q30), _Q31 - 1.0), shift]


def _range_error(fault: str, key: str) -> InputError:
    return wrong_key(
        key,
        f"too {fault} for the full scales of fixed point at this rate; compile with io f32",
        code=f"too-{fault}-for-fixed-point",
    )
