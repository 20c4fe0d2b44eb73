"""Set up the least-squares problem of play cells with lag and creep for displacement loops.

If the lag and the centre of the cell curves are given, the output is linear in the cell weights,
the creep amplitudes and the offset. :class:`CellProblem` computes the columns of this problem, and
:class:`System` solves it with nonnegative weights. Samples before the drive first reaches its
largest distance from its initial value are excluded, because they depend on an uncertain history.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from anhyst.data import Loop, Loops
from anhyst.data.estimates import estimate_noise
from anhyst.data.path import History, correlation, move_plays
from anhyst.data.speeds import cycle_rate
from anhyst.identification.cell_basis import SMOOTHNESS, CellBasis, make_common_basis, make_grid_basis
from anhyst.model.actuator import Model
from anhyst.model.dynamics import Dynamics
from anhyst.support.errors import InputError, NoUsableStartError
from anhyst.support.numeric import FloatArray
from anhyst.support.units import MU_0

CENTRE_POSITIONS = (-2.0, -1.0, -0.5, 0.0, 0.3, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0)
"""Tried centres of the curves: distance from the lowest input, divided by the input range."""

LAG_SAMPLES = (0.0, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0)  # tried lags, in samples

MAX_LAG_SAMPLES_AT_ONE_RATE = 1.0
"""Largest tried lag if all loops have about the same cycle rate. A lag and a wider loop are then
barely separable."""

# ratio of the fastest to the slowest cycle rate above which lag and loop width are separable
MIN_RATE_RATIO = 3.0
CREEP_TIME_SHARES = (1 / 200, 1 / 10, 2.0)  # creep time constants, relative to the longest record
MIN_SAMPLES_PER_TIME_CONSTANT = 3.0  # smallest tried time constant of the creep, in samples

STRAIGHT_SLOPE_SHARE = 0.02
"""Slope of a fixed linear term of every model, relative to the mean slope. A cell with the widest
curve represents any further linear output. All cells together then exceed every output."""

OUTLIER_RATIO = 10.0
"""Multiple of the median deviation above which a sample is an outlier, such as a spike or the
start-up of the amplifier."""

FAR_END_SHARE = 0.98  # fraction of the largest distance from the first input value
MAX_UNKNOWN_SHARE = 0.3  # maximum fraction of a record that is excluded as an initial curve
MAX_OUTLIER_SHARE = 0.02  # maximum fraction of samples that are excluded as outliers
MAX_SAMPLES = 20_000  # maximum number of fitted samples

MAX_NOISE_RATIO = 1.1
"""Ratio of rms residual to noise up to which noise explains the residual and no grid is tried."""

MAX_FOLDS = 5
"""Maximum number of folds that are withheld in turn: loops, or blocks if there are few loops."""

BLOCKS_PER_FOLD = 20
"""Blocks of a record that are withheld together. With fewer blocks, whole branches would be
withheld. A grid would have to extrapolate, and its error would say nothing about other records."""

MIN_LOOPS_TO_WITHHOLD = 3  # minimum number of loops for which whole loops are withheld, not blocks
MAX_CENTRE_SHARE = 0.1
"""Largest mid-range input, in input ranges, for which an even grid is tried."""

LAW = "play-cells"


@dataclass(frozen=True)
class Trial:
    """Nonlinear parameters of the least-squares problem, and the solution for these parameters."""

    lag: float  # lag, s
    centre: float  # centre of the curves (``in_0``)
    creep_times: tuple[float, ...] = ()  # time constants of the creep, s
    smoothness: float = SMOOTHNESS
    weights: FloatArray | None = None
    rms: float = np.inf


@dataclass(frozen=True, eq=False)
class System:
    """A linear least-squares problem with nonnegative weights."""

    basis: CellBasis
    matrix: FloatArray  # columns of cell weights, creep weights, and positive and negative offset
    target: FloatArray
    fold_numbers: NDArray[np.intp]  # number of the fold in which each row is withheld; -1: never

    @cached_property
    def solved_columns(self) -> NDArray[np.bool_]:
        """Whether each column is solved for."""
        curve_count = self.basis.thresholds.size * self.basis.widths.size
        is_solved = np.ones(self.matrix.shape[1], dtype=np.bool_)
        is_solved[:curve_count] = self.basis.solved_columns(self.matrix[:, :curve_count])
        return is_solved

    @cached_property
    def roughness(self) -> FloatArray:
        """Quadratic form of the sum of squared second differences of the weights."""
        differences = self.basis.second_differences(self.solved_columns)
        return np.asarray(differences.T @ differences)

    def solve(self, attempt: Trial, output_range: float) -> Trial:
        """Return a trial with its solved weights and rms residual."""
        matrix = self.matrix[:, self.solved_columns]
        weights = self._solve_weights(matrix.T @ matrix, matrix.T @ self.target, attempt.smoothness)
        residual = self.matrix @ weights - self.target
        return replace(attempt, weights=weights, rms=float(np.linalg.norm(residual)) * output_range)

    def withheld_errors(self, smoothness_values: Sequence[float]) -> list[float]:
        """Return, for each smoothness, the rms error at the folds, which are withheld in turn."""
        matrix = self.matrix[:, self.solved_columns]
        normal, rhs = matrix.T @ matrix, matrix.T @ self.target
        square_sums = np.zeros(len(smoothness_values))
        for fold in range(self.fold_numbers.max() + 1):
            is_withheld = self.fold_numbers == fold
            withheld_matrix, target = matrix[is_withheld], self.target[is_withheld]
            remaining_system = (
                normal - withheld_matrix.T @ withheld_matrix,
                rhs - withheld_matrix.T @ target,
            )
            for index, smoothness in enumerate(smoothness_values):
                weights = self._solve_weights(*remaining_system, smoothness)[self.solved_columns]
                square_sums[index] += float(np.sum((withheld_matrix @ weights - target) ** 2))
        return [float(rms) for rms in np.sqrt(square_sums)]

    def _solve_weights(self, normal: FloatArray, rhs: FloatArray, smoothness: float) -> FloatArray:
        from scipy.optimize import nnls

        column_norms = np.sqrt(np.abs(np.diag(normal)))
        normal = normal + smoothness**2 * column_norms[:, None] * self.roughness * column_norms
        normal += 1e-12 * np.trace(normal) * np.eye(normal.shape[0])
        factor = np.linalg.cholesky(normal)
        weights = np.zeros(self.solved_columns.size)
        weights[self.solved_columns], _ = nnls(factor.T, np.linalg.solve(factor, rhs), maxiter=10000)
        return weights


class CellProblem:
    """Measured loops, and the matrix columns of their least-squares problem."""

    def __init__(self, loopset: Loops) -> None:
        self.loopset = loopset
        self.solve_count = 0
        self.lowest_input = min(float(loop.input.min()) for loop in loopset.loops)
        self.input_range = max(float(loop.input.max()) for loop in loopset.loops) - self.lowest_input
        self.output_range = max(float(np.ptp(loop.output)) for loop in loopset.loops)
        if any(correlation(loop.input, loop.output) < -0.5 for loop in loopset.loops):
            name, drive = loopset.output.words, loopset.input.words
            raise InputError(
                f"the {name} falls as the {drive} rises; flip the sign of one of the columns",
                code="output-falls",
            )
        self.straight_slope = STRAIGHT_SLOPE_SHARE * self.output_range / self.input_range
        self.basis = make_common_basis(self.input_range)
        # tried centres of the curves, in units of the input
        self.centres = [self.lowest_input + position * self.input_range for position in CENTRE_POSITIONS]
        self._plays: dict[tuple[float, float], list[tuple[FloatArray, FloatArray]]] = {}
        self._columns: tuple[tuple[float, float], list[FloatArray]] | None = None
        self.known_masks = [_mask_known_samples(loop) for loop in loopset.loops]
        self.fitted_masks = self.known_masks

    def make_grid_problems(self) -> list[CellProblem]:
        """Return the same problem with curves on a grid that begins at the lowest input.

        If the input range is almost symmetrical about zero, a problem with an even grid is added.
        """
        centre = self.lowest_input + 0.5 * self.input_range
        problems = []
        for is_even in (True, False) if abs(centre) <= MAX_CENTRE_SHARE * self.input_range else (False,):
            problem = copy(self)
            problem.basis = make_grid_basis(self.input_range, is_even=is_even)
            problem.centres = [centre if is_even else self.lowest_input]
            problem._plays, problem._columns = {}, None
            problems.append(problem)
        return problems

    def include_initial_curves(self) -> CellProblem:
        """Return the same problem, with initial curves that begin at the centre of the curves.

        They are used if the input never left the centre before. The curves of a grid can fit them.
        """
        problem, masks = copy(self), []
        for loop, mask in zip(self.loopset.loops, self.fitted_masks, strict=True):
            input_before = np.append(_input_before(loop.history, loop.input), loop.input[0])
            starts_at_centre = (
                np.max(np.abs(input_before - self.centres[0])) <= (1.0 - FAR_END_SHARE) * self.input_range
            )
            masks.append(np.ones_like(mask) if starts_at_centre else mask)
        problem.fitted_masks = masks
        return problem

    def exceeds_noise(self, attempt: Trial) -> bool:
        """Whether the residual of a fit exceeds the sensor noise."""
        noises = [estimate_noise(loop.output) for loop in self.loopset.loops]
        return attempt.rms > MAX_NOISE_RATIO * float(np.sqrt(np.mean(np.square(noises))))

    def remove_outliers(self) -> None:
        """Exclude a few samples that deviate strongly from the best fit without a lag."""
        solutions = [self.solve(Trial(0.0, centre)) for centre in self.centres]
        best_trial = min(solutions, key=lambda attempt: attempt.rms)
        assert best_trial.weights is not None
        offset = float(best_trial.weights[-2] - best_trial.weights[-1])
        deviations = [
            np.abs(loop.output - output - offset)
            for loop, (output, _) in zip(self.loopset.loops, self.outputs(best_trial), strict=True)
        ]
        median = float(np.median(np.concatenate(deviations)))
        masks = [
            mask & (deviation <= OUTLIER_RATIO * median)
            for mask, deviation in zip(self.fitted_masks, deviations, strict=True)
        ]
        count_before, count_after = (
            np.concatenate(mask_list).sum() for mask_list in (self.fitted_masks, masks)
        )
        if count_before - count_after <= MAX_OUTLIER_SHARE * count_before:
            self.fitted_masks = masks

    @cached_property
    def clocks(self) -> list[FloatArray]:
        """Times of the samples of each loop, s; empty if any loop has no time."""
        clocks = [loop.time for loop in self.loopset.loops if loop.time is not None]
        return clocks if len(clocks) == len(self.loopset) else []

    @cached_property
    def sample_time(self) -> float:
        """Smallest median time between samples, s; 0 if any loop has no time."""
        return float(min((np.median(np.diff(clock)) for clock in self.clocks), default=0.0))

    @property
    def cycle_rates(self) -> list[float]:
        """Cycle rate of each loop, Hz."""
        return [cycle_rate(loop.input, loop.time) for loop in self.loopset.loops]

    @property
    def lags(self) -> list[float]:
        """Lags that are tried, s."""
        if not self.sample_time:
            return [0.0]
        has_one_rate = max(self.cycle_rates) < MIN_RATE_RATIO * min(self.cycle_rates)
        return [
            lag * self.sample_time
            for lag in LAG_SAMPLES
            if not has_one_rate or lag <= MAX_LAG_SAMPLES_AT_ONE_RATE
        ]

    @cached_property
    def creep_times(self) -> tuple[float, ...]:
        """Time constants of the creep, s."""
        if not self.sample_time:
            return ()
        longest_time = max(float(clock[-1] - clock[0]) for clock in self.clocks)
        time_constants = (time_ratio * longest_time for time_ratio in CREEP_TIME_SHARES)
        return tuple(t for t in time_constants if t >= MIN_SAMPLES_PER_TIME_CONSTANT * self.sample_time)

    def play_positions(self, lag: float, centre: float) -> list[tuple[FloatArray, FloatArray]]:
        """Return the play positions in each loop and before it, relative to the curve centre."""
        if (lag, centre) not in self._plays:
            self._plays |= {(lag, tried_centre): [] for tried_centre in self.centres}
            centres, thresholds = np.array(self.centres)[:, None], self.basis.thresholds
            for loop in self.loopset.loops:
                inputs = loop.input
                if lag and loop.time is not None:
                    inputs = Dynamics(lag).delay_record(inputs, loop.time)
                # All cells start at the centre of the curves.
                input_path = _input_before(loop.history, inputs) - centres
                input_path = np.concatenate([np.zeros_like(centres), input_path], axis=1)
                start = np.zeros((centres.size, thresholds.size))
                rest_positions = move_plays(input_path, thresholds, start)[-1]
                positions = move_plays(inputs - centres, thresholds, rest_positions)
                for index, initial_centre in enumerate(self.centres):
                    self._plays[lag, initial_centre].append((positions[:, index], rest_positions[index]))
        return self._plays[lag, centre]

    def outputs(self, attempt: Trial) -> list[tuple[FloatArray, float]]:
        """Return the output of a trial in each loop and before it, without creep and offset."""
        assert attempt.weights is not None
        outputs, plays = [], self.play_positions(attempt.lag, attempt.centre)
        for columns, (fields, rest_positions) in zip(self.columns(attempt), plays, strict=True):
            weights = attempt.weights[: columns.shape[1]]
            rest_output = (
                self.basis.columns(rest_positions[None])[0] @ weights
                + self.straight_slope * rest_positions[0]
            )
            outputs.append((columns @ weights + self.straight_slope * fields[:, 0], float(rest_output)))
        return outputs

    def columns(self, attempt: Trial) -> list[FloatArray]:
        """Return the output of each curve with weight 1 in each loop; the last result is cached."""
        key = attempt.lag, attempt.centre
        if self._columns is None or self._columns[0] != key:
            self._columns = (key, [self.basis.columns(fields) for fields, _ in self.play_positions(*key)])
        return self._columns[1]

    def solve(self, attempt: Trial, creeping: Sequence[FloatArray] = ()) -> Trial:
        """Solve for the weights of a trial; creep follows the output of previous weights."""
        self.solve_count += 1
        if attempt.creep_times and not creeping:
            creeping = self.creep_responses(attempt, attempt.creep_times)
        return self.make_system(attempt, creeping).solve(attempt, self.output_range)

    def deviation(
        self, attempt: Trial, creeping: Sequence[FloatArray], masks: list[NDArray[np.bool_]]
    ) -> float:
        """Return the rms deviation of a solved trial at masked samples, relative to the range."""
        assert attempt.weights is not None
        system = self.make_system(attempt, creeping, masks)
        return float(np.linalg.norm(system.matrix @ attempt.weights - system.target))

    def make_system(
        self,
        attempt: Trial,
        creep_responses: Sequence[FloatArray] = (),
        masks: list[NDArray[np.bool_]] | None = None,
    ) -> System:
        """Return the least-squares problem of a trial, given the creep responses in each loop."""
        rows, targets, folds = [], [], []
        plays, columns = self.play_positions(attempt.lag, attempt.centre), self.columns(attempt)
        for index, loop in enumerate(self.loopset.loops):
            weight = 1.0 / (self.output_range * np.sqrt(loop.n * len(self.loopset)))
            unit_column = np.ones((loop.n, 1))
            creep_columns = [creep_responses[index]] if creep_responses else []
            mask = (self.fitted_masks if masks is None else masks)[index]
            rows.append(weight * np.hstack([columns[index], *creep_columns, unit_column, -unit_column])[mask])
            straight_part = self.straight_slope * plays[index][0][:, 0]
            targets.append(weight * (loop.output - straight_part)[mask])
            folds.append(self.fold_numbers[index][mask])
        return System(self.basis, *map(np.concatenate, (rows, targets, folds)))

    @cached_property
    def fold_numbers(self) -> list[NDArray[np.intp]]:
        """Fold in which each sample is withheld; -1 for samples that are never withheld.

        The ends of a record and the largest loops are never withheld, because a fit without them
        would have to extrapolate, and all candidates would be equally bad. Initial curves are never
        withheld.
        """
        loops = self.loopset.loops
        if len(loops) < MIN_LOOPS_TO_WITHHOLD:
            blocks = [np.arange(loop.n) * MAX_FOLDS * BLOCKS_PER_FOLD // loop.n for loop in loops]
            end_blocks = 0, MAX_FOLDS * BLOCKS_PER_FOLD - 1
            folds = [np.where(np.isin(block, end_blocks), -1, block % MAX_FOLDS) for block in blocks]
        else:
            is_largest = [float(np.ptp(loop.input)) >= FAR_END_SHARE * self.input_range for loop in loops]
            is_never_withheld = [not all(is_largest) and largest for largest in is_largest]
            loop_folds = [
                -1 if is_never else index % MAX_FOLDS for index, is_never in enumerate(is_never_withheld)
            ]
            folds = [np.full(loop.n, fold) for loop, fold in zip(loops, loop_folds, strict=True)]
        return [np.where(mask, fold, -1) for mask, fold in zip(self.known_masks, folds, strict=True)]

    def creep_responses(self, attempt: Trial, creep_times: tuple[float, ...]) -> list[FloatArray]:
        """Return the slow responses to the output of a trial, one column per time constant."""
        responses = []
        for loop, (output, rest_output) in zip(self.loopset.loops, self.outputs(attempt), strict=True):
            assert loop.time is not None
            columns = []
            for time_constant in creep_times:
                dynamics, start = Dynamics(0.0, (time_constant,), (1.0,)), np.array([rest_output])
                if loop.history.kind == "settled":
                    start = dynamics.settled_creep(output, loop.time, is_flux_known=True)
                columns.append(dynamics.apply_creep(output, loop.time, start, is_flux_known=True)[0] - output)
            responses.append(np.stack(columns, axis=1))
        return responses

    def make_model(self, attempt: Trial) -> Model:
        """Return the model of a solved trial."""
        assert attempt.weights is not None
        cell_weight_count = self.basis.thresholds.size * self.basis.widths.size
        slope, weights = self.straight_slope, attempt.weights[:cell_weight_count] / self.straight_slope
        if not weights.any():
            raise NoUsableStartError
        creep_weights = attempt.weights[cell_weight_count:-2]
        creep_terms = [
            (t, float(w)) for t, w in zip(attempt.creep_times, creep_weights, strict=True) if w > 1e-4
        ]
        return Model(
            name="model",
            input=self.loopset.input,
            output=self.loopset.output,
            parameters={
                "alpha": 0.0,
                "c_H": 1.0,
                "c_out": slope / MU_0,
                "in_0": attempt.centre,
                "out_0": float(attempt.weights[-2] - attempt.weights[-1]),
            },
            law=LAW,
            cells=self.basis.make_cells(weights),
            dynamics=Dynamics(
                attempt.lag,
                tuple(t for t, _ in creep_terms),
                tuple(w for _, w in creep_terms),
                max(self.cycle_rates),
            ),
        )


def thin_loops(loopset: Loops) -> Loops:
    """Reduce long records to every n-th sample."""
    sample_step = 1 + sum(loop.n for loop in loopset.loops) // MAX_SAMPLES
    if sample_step == 1:
        return loopset
    samples = slice(None, None, sample_step)
    return loopset.with_loops(
        replace(
            loop,
            input=loop.input[samples],
            output=loop.output[samples],
            time=None if loop.time is None else loop.time[samples],
        )
        for loop in loopset.loops
    )


def _mask_known_samples(loop: Loop) -> NDArray[np.bool_]:
    """Return a mask of the samples that do not depend on the initial state.

    These samples begin when the input first reaches FAR_END_SHARE of its largest distance from its
    first value.
    """
    mask = np.ones(loop.n, dtype=np.bool_)
    if loop.history.kind == "settled":
        return mask
    distance = np.abs(loop.input - loop.input[0])
    first_far_row = int(np.argmax(distance >= FAR_END_SHARE * distance.max()))
    if first_far_row <= MAX_UNKNOWN_SHARE * loop.n:
        mask[:first_far_row] = False
    return mask


def _input_before(history: History, drive: FloatArray) -> FloatArray:
    """Return the input that moved the cells before a loop began."""
    points = np.array(history.turning_points)
    return np.concatenate([points, drive]) if history.kind == "settled" else points
