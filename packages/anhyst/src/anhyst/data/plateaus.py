"""Find the plateaus of a noisy scheduling variable, such as a gap that is set and kept constant.

A moving average shows where the value is constant. Samples near the mean of a stretch belong
to it, and samples between two stretches belong to no loop. A gap that changes during the loops has
no plateaus.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from anhyst.data.estimates import MAD_TO_SIGMA
from anhyst.data.path import find_runs, reversal_count
from anhyst.support.numeric import FloatArray
from anhyst.support.units import QUANTITIES, Quantity

_MIN_RUN_SAMPLES = 6
"""Minimum length of runs of equal values that count as exact and need no search."""
_WINDOW_SHARE = 0.01
"""Width of the moving average, as a fraction of the record."""
_MAX_WINDOW_SAMPLES = 301
_MIN_WINDOW_SAMPLES = 5
_MAX_DRIFT = 0.005
"""Maximum change of the moving average within a plateau, relative to the median; noise is added."""
_MAX_DISTANCE_SIGMAS = 6.0
"""Maximum distance of a sample from its plateau, in standard deviations."""
_MAX_LOST_SHARE = 0.1
"""If a larger fraction of a record lies between plateaus, the input must be constant there."""
_MIN_INPUT_SHARE = 0.3
"""Minimum range of the input during a plateau, as a fraction of its range in the record."""
_MIN_REVERSAL_SHARE = 0.1


@dataclass(frozen=True, slots=True)
class Plateaus:
    """Rows of the plateaus, and the value of the plateau at each row."""

    rows: NDArray[np.intp]
    values: FloatArray
    note: str


@dataclass(frozen=True, slots=True)
class _Plateau:
    """A stretch of constant value: its rows, mean and standard deviation."""

    rows: slice
    mean: float
    sigma: float


def find_plateaus(values: FloatArray, drive: FloatArray, quantity: Quantity) -> Plateaus | None:
    """Return the plateaus of a noisy scheduling variable; ``None`` if it is exact or changes."""
    run_bounds = np.concatenate(([0], np.flatnonzero(np.diff(values)) + 1, [values.size]))
    is_exact = run_bounds.size == 2 or int(np.diff(run_bounds).min()) >= _MIN_RUN_SAMPLES
    if values.size < 4 * _MIN_WINDOW_SAMPLES or is_exact:
        return None
    long_runs = np.flatnonzero(np.diff(run_bounds) >= _MIN_RUN_SAMPLES)
    runs = [slice(int(run_bounds[index]), int(run_bounds[index + 1])) for index in long_runs]
    exact_plateaus = [
        _Plateau(rows, float(values[rows.start]), 0.0) for rows in runs if has_loop(drive, rows)
    ]
    plateaus = exact_plateaus if len(exact_plateaus) > 1 else _search_plateaus(values)
    if not plateaus or not all(has_loop(drive, plateau.rows) for plateau in plateaus):
        return None
    levels = _plateau_values(plateaus)
    if len(set(levels)) == 1 and quantity != QUANTITIES["gap"]:
        return None  # one temperature with noise contains no information
    plateau_of_row = _assign_rows(values, plateaus)
    if all(plateau.sigma == 0.0 for plateau in plateaus) and not _are_only_ramps(values, plateau_of_row):
        return None
    rows = np.flatnonzero(plateau_of_row >= 0)
    if rows.size < (1.0 - _MAX_LOST_SHARE) * values.size:
        # If the input is constant wherever the gap changes, no loop is cut, however many rows are
        # lost.
        span = float(np.ptp(drive))
        if any(
            np.ptp(drive[moving_rows]) > _MIN_REVERSAL_SHARE * span
            for moving_rows in find_runs(plateau_of_row < 0)
        ):
            return None
    return Plateaus(
        rows,
        np.array(levels)[plateau_of_row[rows]],
        _plateau_note(plateaus, levels, values.size - rows.size, quantity),
    )


def _are_only_ramps(values: FloatArray, plateau_of_row: NDArray[np.intp]) -> bool:
    """Whether all rows outside the plateaus are ramps between two values, and not outliers."""
    for rows in find_runs(plateau_of_row < 0):
        if rows.start == 0 or rows.stop == values.size:
            return False
        lower_value, upper_value = sorted((values[rows.start - 1], values[rows.stop]))
        values_between = values[rows]
        if (
            lower_value == upper_value
            or values_between.min() < lower_value
            or values_between.max() > upper_value
        ):
            return False
    return True


def _search_plateaus(values: FloatArray) -> list[_Plateau]:
    """Return the stretches with a constant moving average; empty if one of them drifts."""
    from scipy.ndimage import uniform_filter1d  # slow to load, and needed for noisy gaps only

    width = int(np.clip(_WINDOW_SHARE * values.size, _MIN_WINDOW_SAMPLES, _MAX_WINDOW_SAMPLES))
    steps = np.abs(np.diff(values))
    noise = MAD_TO_SIGMA * float(np.median(steps)) / math.sqrt(2.0)
    noise = max(noise, float(np.mean(steps)) / 2.0)
    smooth_values = uniform_filter1d(values, width, mode="nearest")
    max_change = _MAX_DRIFT * float(np.median(np.abs(values))) + _MAX_DISTANCE_SIGMAS * noise / math.sqrt(
        width
    )
    later_average = np.concatenate((smooth_values[width:], np.full(width, smooth_values[-1])))
    is_still = np.abs(later_average - smooth_values) <= max_change
    is_still[width:] &= is_still[:-width].copy()
    plateaus = []
    for rows in find_runs(is_still):
        if rows.stop - rows.start < 2 * width:
            continue
        plateau_values = values[rows]
        mean, sigma = float(np.mean(plateau_values)), float(np.std(plateau_values))
        drift_range = float(np.ptp(smooth_values[rows]))
        if drift_range > 2.0 * max_change:
            return []
        plateaus.append(_Plateau(rows, mean, sigma))
    return plateaus


def has_loop(drive: FloatArray, rows: slice | NDArray[np.intp]) -> bool:
    """Whether rows contain a loop: the input covers much of its range and reverses."""
    inputs, span = drive[rows], float(np.ptp(drive))
    is_wide = float(np.ptp(inputs)) >= _MIN_INPUT_SHARE * span
    return is_wide and reversal_count(inputs, _MIN_REVERSAL_SHARE * span) > 0


def _plateau_values(plateaus: list[_Plateau]) -> list[float]:
    """Return the value of each plateau, rounded well below the scatter; equal if plateaus agree."""
    levels: list[float] = []
    for plateau in plateaus:
        decimals = max(0, 1 - math.floor(math.log10(plateau.sigma))) if plateau.sigma > 0.0 else 12
        # At contact the gap is 0, even if the sensor has an offset.
        equal_levels = [level for level in (*levels, 0.0) if abs(level - plateau.mean) <= plateau.sigma]
        levels.append(equal_levels[0] if equal_levels else round(plateau.mean, decimals))
    return levels


def _assign_rows(values: FloatArray, plateaus: list[_Plateau]) -> NDArray[np.intp]:
    """Return the index of the plateau of each row, -1 for rows between two plateaus."""
    plateau_of_row = np.full(values.size, -1, np.intp)
    bounds = [0, *(plateau.rows.stop for plateau in plateaus[:-1]), values.size]
    for index, plateau in enumerate(plateaus):
        # A row between two plateaus may belong to either.
        start = bounds[index] if index == 0 else plateaus[index - 1].rows.stop
        stop = values.size if index + 1 == len(plateaus) else plateaus[index + 1].rows.start
        rows = slice(start, stop)
        distance = np.abs(values[rows] - plateau.mean)
        is_near = distance <= _MAX_DISTANCE_SIGMAS * plateau.sigma
        for neighbour_index in (index - 1, index + 1):
            if 0 <= neighbour_index < len(plateaus):
                is_near &= distance <= np.abs(values[rows] - plateaus[neighbour_index].mean)
        plateau_of_row[rows][is_near] = index
        plateau_of_row[plateau.rows] = index
    return plateau_of_row


def _plateau_note(plateaus: list[_Plateau], levels: list[float], lost_count: int, quantity: Quantity) -> str:
    scatter = max(plateau.sigma for plateau in plateaus)
    texts = (quantity.show(level).removeprefix(quantity.words) for level in levels)
    value_texts = list(dict.fromkeys(texts))
    scatter_text = f"{scatter * 1e6:.2g} µm" if quantity.unit == "m" else f"{scatter:.2g} {quantity.unit}"
    count_text = f"{len(value_texts)} plateaus" if len(value_texts) > 1 else "one plateau"
    text = f"{quantity.words} has {count_text}:{','.join(value_texts)}"
    text += f" (scatter {scatter_text})" if scatter != 0.0 else ""
    return text + (f"; {lost_count} samples between them left out" if lost_count else "")
