"""Find the points at which minor loops of a record close, and measure the misclosure there."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from anhyst.data.loops import Loop
from anhyst.data.path import find_turning_points
from anhyst.support.numeric import FloatArray

_WINDOW_HALF_WIDTH_TO_RANGE = 0.08
"""Half-width of the window about a closing point, as a fraction of the input's range."""
_RETURN_TOLERANCE = 0.02
"""Tolerance with which an input must return to its reversal point, as a fraction of its range."""
_MIN_SAMPLES = 4
"""Smallest number of samples of each branch in this window."""


@dataclass(frozen=True, slots=True)
class LoopClosing:
    """A point at which the input returns to an earlier reversal point and closes a minor loop.

    Iron with return-point memory then continues as if the minor loop had not occurred.
    """

    closing_input: float  # input at the closing point
    earlier_samples: slice  # samples of the branch that ends or begins at the reversal point
    later_samples: slice  # samples of the branch that later passes this point, or restarts there
    after_side: float  # 1 or -1: side of the point on which later samples count; 0: both sides

    def output_step(self, loop: Loop, output: FloatArray) -> float:
        """Return the misclosure of a noise-free output: after minus before the minor loop."""
        outputs = []
        for rows in (self.earlier_samples, self.later_samples):
            order = np.argsort(loop.input[rows])
            outputs.append(float(np.interp(self.closing_input, loop.input[rows][order], output[rows][order])))
        return outputs[1] - outputs[0]

    def measure_output_step(self, loop: Loop, model_output: FloatArray) -> tuple[float, float] | None:
        """Return the measured misclosure and its standard error; None if there are too few samples.

        The estimate uses the residuals of a model that follows the loop. These residuals are
        assumed to depend linearly on the input within the window.
        """
        window, distances, residuals = _WINDOW_HALF_WIDTH_TO_RANGE * float(np.ptp(loop.input)), [], []
        for rows, side_indicator in ((self.earlier_samples, 0.0), (self.later_samples, self.after_side)):
            distance = (loop.input[rows] - self.closing_input) / window
            is_near = (np.abs(distance) <= 1.0) & (side_indicator * distance >= 0.0)
            if np.count_nonzero(is_near) < _MIN_SAMPLES:
                return None
            distances.append(distance[is_near])
            residuals.append((loop.output - model_output)[rows][is_near])
        is_after = np.repeat([0.0, 1.0], [samples.size for samples in distances])
        relative_input = np.concatenate(distances)
        terms = np.column_stack([np.ones_like(relative_input), relative_input, is_after])
        coefficients, squared_sum, _, _ = np.linalg.lstsq(terms, np.concatenate(residuals))
        if squared_sum.size == 0:
            return None
        variance = (
            float(squared_sum[0]) / (relative_input.size - 3) * float(np.linalg.inv(terms.T @ terms)[2, 2])
        )
        return float(coefficients[2]) + self.output_step(loop, model_output), math.sqrt(variance)


def find_loop_closings(loop: Loop) -> Iterator[LoopClosing]:
    """Yield all points at which minor loops of a record close."""
    drive, input_range = loop.input, float(np.ptp(loop.input))
    turning_points = find_turning_points(drive, _RETURN_TOLERANCE / 2.0 * input_range)
    branches = [
        slice(begin, end_input + 1) for begin, end_input in itertools.pairwise(turning_points.tolist())
    ]
    open_reversals: list[int] = []
    for number, end in enumerate(drive[turning_points[1:]].tolist(), start=1):
        direction = math.copysign(1.0, end - drive[turning_points[number - 1]])
        while len(open_reversals) > 1:
            opening_number = open_reversals[-2]
            opening_input = float(drive[turning_points[opening_number]])
            overshoot = direction * (end - opening_input) / input_range
            if overshoot < -_RETURN_TOLERANCE:
                break
            # If it is False, the input reverses again at the same point.
            has_passed = int(overshoot > _RETURN_TOLERANCE)
            if number - has_passed < len(branches):
                yield LoopClosing(
                    opening_input,
                    branches[opening_number - has_passed],
                    branches[number - has_passed],
                    has_passed * direction,
                )
            del open_reversals[-2:]
            if not has_passed:
                break
        open_reversals.append(number)
