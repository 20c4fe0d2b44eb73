"""Calibrate a stage or a bearing while it runs on a bench.

The calibrators read the rows of the bench in a separate thread. They estimate the parameters after
each cycle of a stage's set-point, or after each second of a bearing. They activate the corrections
between two ticks. If errors grow, they restore earlier corrections and stop.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

from anhyst.model.actuator import Model
from anhyst.support.block_words import GENERATION_INDEX, set_generation
from anhyst.support.errors import InputError
from anhyst.support.kinds import MethodName
from anhyst.support.numeric import FloatArray, rms
from anhyst_rigs.rig.bearing.loop import BearingSetup
from anhyst_rigs.rig.bench.bearing import BearingBench
from anhyst_rigs.rig.bench.protocol import Bench, Signal, Subscription
from anhyst_rigs.rig.bench.stage import MAX_CYCLES, StageBench, StageCycle
from anhyst_rigs.rig.calibration import ParameterName
from anhyst_rigs.rig.fitting import IdentifiedMagnet, calibrate_magnet
from anhyst_rigs.rig.recording import column_name, peak_deviation
from anhyst_rigs.rig.stage.loop import StageSetup
from anhyst_rigs.study.tracking.bodies import BearingLaw, StageLaw
from anhyst_rigs.study.tracking.estimator import FORGETTING_TIME_S, ParameterEstimator
from anhyst_rigs.study.tracking.measures import slit_statistics
from anhyst_rigs.study.tracking.motion import Motion, MotionLaw, refuse_slow_amplifier

MAX_SHOWN_CYCLES = 500
"""Number of cycles that a page can show."""
PICKUP_TIME_S = 0.1
"""Time that the magnets need to take up the weight of a body, s. The rows in this time are stored,
because they determine the hysteresis state afterwards."""
MAX_BUFFER_S = 20.0
"""Length of the row buffer, s. It contains a cycle and the earlier rows that determine the
hysteresis state. After a longer rest, one cycle is skipped."""
MAX_ERROR_GROWTH = 1.5
"""Largest ratio of the error to its smallest value for two consecutive cycles. If both cycles
exceed this ratio, earlier corrections are restored."""
_BEARING_COLUMNS = ("reference_m", "gap_read_m", "command_A", "load_N", "demand_N", "state", "phase")
MIN_COMPARISONS = 50
"""Smallest number of comparisons in a window that updates the estimate."""
MIN_SWAP_CHANGE = 0.1
"""Smallest change of a parameter for which the block is replaced, in prior standard deviations."""


Corrections = Mapping[ParameterName, float]
"""Parameter values that correct a method; empty if there are no corrections."""
RunOnBench = Callable[[Callable[[], None]], None]
"""Function that runs another function in the bench's thread, between two ticks."""


class CycleResult(NamedTuple):
    """Errors of a cycle (for a bearing, of a window), and the estimate after it."""

    tick: int  # last tick of the cycle
    lap: int
    method: MethodName
    # for a stage: largest moving average of the error over the slit during the scan, m
    average: float
    peak: float  # largest error
    learning: bool  # whether the estimate was updated
    refused: int  # number of cycles of this method that were rejected
    # by parameter: estimate, posterior sigma, applied value, prior sigma
    values: Mapping[str, tuple[float, float, float, float]]


class _CorrectionHistory:
    """Corrections of a method that were active before, and those with the smallest error."""

    def __init__(self) -> None:
        self._entries: deque[tuple[StageSetup, Corrections]] = deque(maxlen=MAX_CYCLES)
        self._settings_and_loads: tuple[object, ...] = ()
        # error of the last cycle, and smallest error that two consecutive cycles did not exceed, m
        self._last_average = self._best_average = math.inf
        self._best_corrections: Corrections = {}

    def add_setup(self, setup: StageSetup, corrections: Corrections) -> None:
        """Store the corrections of a setup that becomes active."""
        self._entries.append((setup, {name: value for name, value in corrections.items() if value}))

    def corrections_of(self, cycle: StageCycle) -> Corrections | None:
        """Return the corrections during a cycle; None if they are no longer stored."""
        return next((values for setup, values in self._entries if setup is cycle.setup), None)

    def find_better_corrections(
        self, cycle: StageCycle, corrections: Corrections, average: float
    ) -> tuple[Corrections, float] | None:
        """Return better corrections and their error, m, if the last two cycles were worse, or None."""
        # If the plant, the load or the gains have changed, earlier errors cannot be compared.
        if cycle.settings_and_loads != self._settings_and_loads:
            self._settings_and_loads = cycle.settings_and_loads
            self._last_average = math.inf
            self._best_average = math.inf
        last_two_errors, self._last_average = (self._last_average, average), average
        if max(last_two_errors) < self._best_average:
            self._best_average, self._best_corrections = max(last_two_errors), corrections
        has_grown = (
            math.isfinite(last_two_errors[0]) and min(last_two_errors) > MAX_ERROR_GROWTH * self._best_average
        )
        return (
            (self._best_corrections, self._best_average)
            if has_grown and self._best_corrections != corrections
            else None
        )


class BenchCalibrator:
    """Base class that calibrates each method of a bench from motions that this method controlled.

    A separate thread executes :meth:`run`. It changes the bench only through ``run_on_bench``.
    """

    unit = "m"
    """Unit of the errors in the cycle results."""

    def __init__(self, bench: Bench, is_on: bool = False) -> None:
        self.is_on = is_on
        # receives the reason if the calibration stops or pauses without an order
        self.report: Callable[[str], None] = lambda _: None
        self.laps: deque[CycleResult] = deque(maxlen=MAX_SHOWN_CYCLES)
        self._clock = bench
        self._estimators: dict[MethodName, ParameterEstimator] = {}
        self._uncorrected_error: dict[MethodName, float] = {}  # error without corrections
        self._buffer: deque[FloatArray] = deque()
        self._stop_reason = ""
        self._start_tick = 0  # first tick whose rows may be used

    def switch(self, is_on: bool) -> None:
        """Switch the calibration on or off; corrections that are applied remain."""
        if is_on and (refusal := self._refusal):
            raise refusal
        self.is_on, self._start_tick, self._stop_reason = is_on, self._clock.tick, ""

    def revert(self) -> int:
        """Delete all estimates, and return the tick. The bench's thread must call this method."""
        # This comes first, so that pending updates find either the new tick or no estimator.
        self._start_tick = self._clock.tick
        self._estimators, self._stop_reason = {}, ""
        return self._start_tick

    def status(self) -> Mapping[str, Any]:
        """Return what a page shows in addition to the cycle results."""
        estimators = dict(self._estimators)
        return {
            "on": self.is_on,
            "refused": str(self._refusal or ""),
            "trouble": self._stop_reason,
            "said": {method: estimator.calibration.summary for method, estimator in estimators.items()},
            "before": dict(self._uncorrected_error),
        }

    def run(self, subscription: Subscription, run_on_bench: RunOnBench) -> None:
        """Process rows until the subscription ends."""
        with suppress(InputError):  # The bench is closed.
            while (rows := subscription.get()) is not None:
                self.process_rows(rows, run_on_bench)

    def process_rows(self, rows: FloatArray, run_on_bench: RunOnBench) -> None:
        """Store rows, and update the estimate from each cycle that ends in these rows."""
        if self._buffer and rows[0, 0] != self._buffer[-1][-1, 0] + 1:
            self._buffer.clear()  # Rows are missing.
        self._buffer.append(rows)
        self._process(rows, run_on_bench)

    def _process(self, rows: FloatArray, run_on_bench: RunOnBench) -> None:
        """Update the estimate from each cycle or window that ends in these rows."""
        raise NotImplementedError  # pragma: no cover

    def _stop(self, reason: str) -> None:
        """Stop the calibration, and report the reason."""
        self._stop_reason, self.is_on = f"calibration stopped: {reason}", False
        self.report(self._stop_reason)

    def _record_cycle(self, cycle: CycleResult, estimator: ParameterEstimator | None) -> None:
        """Store the data of a cycle that a page shows."""
        if estimator is not None:
            values = {
                parameter.name: (
                    parameter.value,
                    parameter.sigma,
                    estimator.applied_values[parameter.name],
                    parameter.prior,
                )
                for parameter in estimator.calibration.parameter
                if parameter.name in estimator.identified
            }
            cycle = cycle._replace(refused=estimator.rejected_count, values=values)
        self.laps.append(cycle)

    @property
    def _refusal(self) -> InputError | None:
        """The reason why nothing can be calibrated, or None."""
        raise NotImplementedError  # pragma: no cover


class StageCalibrator(BenchCalibrator):
    """A calibrator that updates from cycles; corrections become active when the body next rests."""

    def __init__(self, magnet: IdentifiedMagnet, bench: StageBench) -> None:
        rig = bench.rig
        super().__init__(bench, rig.settings.tracking.calibrate)
        self._rig, self._magnet, self._bench = rig, magnet, bench
        # without the time, because rows begin with the tick
        self._required_columns = StageLaw(rig, magnet, "full").required_columns[1:]
        self._column_indices = [
            _row_index(bench.signals, name) for name in (*self._required_columns, "error_m", "lap")
        ]
        # indices in the stored rows
        self._command_indices = [
            1 + n for n, name in enumerate(self._required_columns) if name.startswith("command")
        ]
        self._skipped_cycles = 0
        # rows since the current was switched on, while the magnets take up the weight
        self._pickup_rows = np.zeros((0, 1 + len(self._column_indices)))
        self._laws: dict[MethodName, MotionLaw] = {}
        self._histories: dict[MethodName, _CorrectionHistory] = {}

    def revert(self) -> int:
        """Delete all estimates, and activate the setups of the rig file."""
        super().revert()
        self._histories, self._skipped_cycles = {}, 0
        return [self._bench.correct(setup) for setup in self._bench.setups][-1]

    def status(self) -> Mapping[str, Any]:
        """Return what a page shows in addition to the cycle results."""
        return {**super().status(), "left_out": self._skipped_cycles}

    def process_rows(self, rows: FloatArray, run_on_bench: RunOnBench) -> None:
        """Store rows, and update the estimate from each cycle that ends in these rows."""
        super().process_rows(rows[:, [0, *self._column_indices]], run_on_bench)

    def _process(self, rows: FloatArray, run_on_bench: RunOnBench) -> None:
        while len(self._buffer) > 1 and sum(map(len, self._buffer)) > MAX_BUFFER_S * self._bench.rate:
            self._buffer.popleft()
        pickup_tick = max(self._bench.plant_tick, self._bench.lift_tick)
        first_tick = int(rows[0, 0])
        if 0 <= pickup_tick - first_tick < len(rows):
            was_lifted_again = pickup_tick != self._bench.plant_tick
            earlier_rows = self._rows_before_lift(pickup_tick) if was_lifted_again else self._pickup_rows[:0]
            self._pickup_rows = np.concatenate([earlier_rows, rows[pickup_tick - first_tick :]])
            if was_lifted_again:  # The iron now carries the weight on another branch.
                self._estimators = {
                    name: estimator.copy_without_data() for name, estimator in self._estimators.items()
                }
        elif pickup_tick <= first_tick < pickup_tick + PICKUP_TIME_S * self._bench.rate:
            self._pickup_rows = np.concatenate([self._pickup_rows, rows])
        for cycle in tuple(self._bench.cycles):
            if rows[0, 0] <= cycle.last_tick <= rows[-1, 0]:
                self._process_cycle(cycle, run_on_bench)

    def _rows_before_lift(self, tick: int) -> FloatArray:
        """Return the rows before a lift that determine the hysteresis state: first lift to descent."""
        history_begin = max(
            (cycle.history_start for cycle in tuple(self._bench.cycles) if cycle.first_tick < tick), default=0
        )
        rows = np.concatenate(self._buffer)
        rows = rows[(rows[:, 0] >= history_begin) & (rows[:, 0] < tick)]
        has_current = rows[:, self._command_indices].any(axis=1)
        is_earlier = self._pickup_rows[:, 0] < (rows[0, 0] if len(rows) else tick)
        # Only the first row of a rest without current is necessary.
        return np.concatenate([self._pickup_rows[is_earlier], rows[has_current | np.roll(has_current, 1)]])

    def _process_cycle(self, cycle: StageCycle, run_on_bench: RunOnBench) -> None:
        """Update the estimate from a complete cycle, and activate the corrections."""
        table = np.concatenate([rows for rows in self._buffer if rows[-1, 0] >= cycle.history_start])
        first_tick, end_tick = int(table[0, 0]), cycle.last_tick
        error, cycle_numbers = table[: end_tick + 1 - first_tick, -2:].T
        begin_row = cycle.first_tick - first_tick
        if begin_row < 0 or np.any(cycle_numbers[begin_row:] != cycle.number):
            return
        slit, dt = self._rig.settings.scan.slit_s, self._rig.dt
        windows = slit_statistics(error[begin_row:], cycle.motion, slit, dt)
        peak_error = peak_deviation(error[begin_row:])
        average = max((peak_deviation(mean) for mean, _ in windows if mean.size), default=peak_error)
        estimators, is_learning, setup = self._estimators, self.is_on, None
        estimator = estimators.get(cycle.method)
        history = self._histories.setdefault(cycle.method, _CorrectionHistory())
        is_original_setup = any(cycle.setup is setup for setup in self._bench.setups)
        is_uncorrected = is_original_setup and (
            estimator is None or not any(estimator.applied_values.values())
        )
        corrections = {} if is_original_setup else history.corrections_of(cycle)
        better_values = (
            None if corrections is None else history.find_better_corrections(cycle, corrections, average)
        )
        if is_learning and better_values is not None and estimator is not None:
            setup = self._restore_best(estimator, *better_values, average)
        elif is_learning and self._is_superseded(cycle):
            is_learning, self._skipped_cycles = False, self._skipped_cycles + 1
        elif is_learning and cycle.history_start >= first_tick and end_tick > self._start_tick:
            is_earlier = self._pickup_rows[:, 0] < cycle.history_start
            rows = table[cycle.history_start - first_tick : end_tick + 1 - first_tick, 1:]
            rows = np.concatenate([self._pickup_rows[is_earlier, 1:], rows])
            columns = dict(zip(self._required_columns, rows.T, strict=False))
            setup = self._update(estimators, cycle, columns, len(rows) - cycle.tick_count)
        estimator = estimators.get(cycle.method)

        def act() -> None:
            if estimators is not self._estimators:
                return  # The calibration was reverted meanwhile.
            if is_uncorrected:
                self._uncorrected_error[cycle.method] = average
            if setup is not None and estimator is not None:
                self._bench.correct(setup)
                history.add_setup(setup, estimator.applied_values)
            self._record_cycle(
                CycleResult(end_tick, cycle.number, cycle.method, average, peak_error, is_learning, 0, {}),
                estimator,
            )

        run_on_bench(act)

    def _is_superseded(self, cycle: StageCycle) -> bool:
        """Whether a later cycle has already ended, because an update can take longer than a cycle."""
        tick = self._bench.tick
        return any(
            later_cycle.number > cycle.number and later_cycle.last_tick <= tick
            for later_cycle in tuple(self._bench.cycles)
        )

    def _restore_best(
        self,
        estimator: ParameterEstimator,
        best_corrections: Corrections,
        best_average: float,
        average: float,
    ) -> StageSetup:
        """Stop the calibration; return the stage with the corrections that had the smallest error."""
        estimator.applied_values = dict.fromkeys(estimator.applied_values, 0.0) | dict(best_corrections)
        self._stop(
            f"the moving average of {estimator.law.method} grew from {1e9 * best_average:.3g} to "
            f"{1e9 * average:.3g} nm; the corrections with the smallest error are restored"
        )
        return estimator.corrected_stage()

    def _update(
        self,
        estimators: dict[MethodName, ParameterEstimator],
        cycle: StageCycle,
        columns: Mapping[str, FloatArray],
        begin_row: int,
    ) -> StageSetup | None:
        """Update the estimate from a cycle; return a new setup, or None if nothing changes."""
        method = cycle.method
        if method not in self._laws:
            self._laws[method] = StageLaw(self._rig, self._magnet, method)
        estimator = estimators.setdefault(method, ParameterEstimator(self._laws[method], FORGETTING_TIME_S))
        old_values = dict(estimator.applied_values)
        try:
            estimator.update(self._laws[method].make_motion(columns, begin_row))
            estimator.follow_estimate(cycle.motion.duration)
            return None if estimator.applied_values == old_values else estimator.corrected_stage()
        except (InputError, np.linalg.LinAlgError) as error:
            self._stop(str(error))
            return None

    @property
    def _refusal(self) -> InputError | None:
        try:
            refuse_slow_amplifier(self._rig)
        except InputError as error:
            return error
        if self._rig.calibration_path is None:
            return None
        return InputError(
            f"{self._rig.path}: control.calibration: online calibration begins without a file; remove it",
            code="not-both",
            key="control.calibration",
        )


PAUSE_TEXT = "learning pauses, because the compensation is off; switch it on to continue"
"""Message of a bearing that learns while its compensation is off."""
WINDOW_S = 1.0
"""Length of the window that is processed at a time for a bearing, s."""
TAIL_S = 0.1
"""Time before a window in which all rows are kept, s."""
THINNING_BLOCK_ROWS = 20
"""Number of older rows that are reduced to the two with extreme current-to-gap ratios."""
MAX_HISTORY_ROWS = 100_000
"""Number of thinned rows above which they are thinned again."""


class BearingCalibrator(BenchCalibrator):
    """A calibrator that updates from each second with a moving reference, and replaces the block.

    The firmware changes the current gradually to the current of the new block. The reported errors
    are force errors. For comparison, the error without corrections is computed for each second.
    """

    unit = "N"

    def __init__(
        self,
        setup: BearingSetup,
        magnet: IdentifiedMagnet,
        compile_block: Callable[[Model], Sequence[int]],
        bench: BearingBench,
    ) -> None:
        super().__init__(bench)
        self._setup, self._bench, self._method = setup, bench, setup.method
        self._magnet = magnet
        # function that compiles a model to a block for the board
        self._compile_block = compile_block
        self._column_indices = {name: _row_index(bench.signals, name) for name in _BEARING_COLUMNS}
        self._law: BearingLaw | None = None
        self._history_rows = np.zeros((0, 1 + len(bench.signals)))
        self._initial_block = self._written_block = bench.read_block()
        self._corrections: Corrections = {}
        self._is_waiting = False  # whether it waits until the armature rests without current
        self._was_worse = False  # whether the last window was worse than without corrections
        self._uncompensated_tick = -1  # last tick at which the compensation was off
        self._is_compensated = True

    def revert(self) -> int:
        """Delete all estimates, and activate the initial block."""
        super().revert()
        return self._swap_block(self._initial_block, {})

    def status(self) -> Mapping[str, Any]:
        """Return what a page shows in addition to the cycle results."""
        wait_text = ""
        if self.is_on and not self._is_compensated:
            wait_text = PAUSE_TEXT
        elif self._is_waiting:
            wait_text = "rows are missing, so the hysteresis state is unknown; land and lift again"
        status = super().status()
        return {**status, "trouble": status["trouble"] or wait_text}

    def _monitor_compensation(self, tick: int) -> None:
        """Note whether the compensation is off at a tick, because the force error then has another cause."""
        was_compensated = self._is_compensated
        self._is_compensated = any(
            parameter.value for parameter in self._bench.parameters() if parameter.name == "compensation"
        )
        if not self._is_compensated:
            self._uncompensated_tick = tick
        if self.is_on and self._is_compensated != was_compensated:
            self.report("learning continues" if self._is_compensated else PAUSE_TEXT)

    def _process(self, rows: FloatArray, run_on_bench: RunOnBench) -> None:
        self._monitor_compensation(int(rows[-1, 0]))
        if len(self._buffer) == 1:  # first rows, or rows are missing: wait until no current flows
            self._history_rows = self._history_rows[:0]
            self._is_waiting = bool(rows[0, self._column_indices["command_A"]] > 0.0)
            if self._is_waiting:
                self._buffer.clear()
                return
        if sum(map(len, self._buffer)) < (WINDOW_S + TAIL_S) * self._bench.rate:
            return
        table = np.concatenate(self._buffer)
        self._process_window(table, run_on_bench)
        tail_rows = round(TAIL_S * self._bench.rate)
        old_rows = _thin_rows(table[:-tail_rows], self._column_indices)
        self._history_rows = np.concatenate([self._history_rows, old_rows])
        if len(self._history_rows) > MAX_HISTORY_ROWS:
            self._history_rows = _thin_rows(self._history_rows, self._column_indices)
        self._buffer = deque([table[-tail_rows:]])

    def _process_window(self, table: FloatArray, run_on_bench: RunOnBench) -> None:
        """Update the estimate from one window, and activate the corrections."""
        if self._refusal is not None:
            return
        if table[0, 0] <= self._uncompensated_tick:
            self._was_worse = False
            return
        setup = self._setup
        law = self._law = self._law or BearingLaw(setup.rig, setup.controller, self._magnet, self._method)
        rows = np.concatenate([self._history_rows, table])
        columns = {name: rows[:, column_index] for name, column_index in self._column_indices.items()}
        begin_row = len(self._history_rows) + round(TAIL_S * self._bench.rate)
        motion = law.make_motion(columns, begin_row)
        indices = motion.compared_indices
        if indices.size < MIN_COMPARISONS:
            return
        force_error = (motion.measured_force - motion.filter_force(columns["demand_N"], motion.delay_ticks))[
            indices
        ]
        zeros = dict.fromkeys(law.names, 0.0)
        uncorrected_rms_N = rms((motion.measured_force - law.net_force(motion, zeros))[indices])
        end, estimators, is_learning = int(table[-1, 0]), self._estimators, self.is_on
        is_worse = any(self._corrections.values())
        is_worse = is_worse and rms(force_error) > MAX_ERROR_GROWTH * max(
            uncorrected_rms_N, law.max_residual_ratio * motion.force_rms
        )
        should_revert, self._was_worse = is_worse and self._was_worse, is_worse
        update = None
        if is_learning and not should_revert and end - len(table) >= self._start_tick:
            update = self._update(estimators, law, motion)

        def act() -> None:
            if estimators is not self._estimators:
                return  # The calibration was reverted meanwhile.
            self._uncorrected_error[self._method] = uncorrected_rms_N
            if should_revert:
                self.revert()
                self._stop(
                    f"the force error is {rms(force_error):.3g} N, without corrections "
                    f"{uncorrected_rms_N:.3g} N; the corrections were removed"
                )
            elif update is not None:
                self._swap_block(*update)
            cycle = CycleResult(
                end, 0, self._method, rms(force_error), peak_deviation(force_error), is_learning, 0, {}
            )
            self._record_cycle(cycle, self._estimators.get(self._method))

        run_on_bench(act)

    def _update(
        self, estimators: dict[MethodName, ParameterEstimator], law: BearingLaw, motion: Motion
    ) -> tuple[Sequence[int], Corrections] | None:
        """Update the estimate from a window; return a new block with its corrections, or None."""
        estimator = estimators.setdefault(self._method, ParameterEstimator(law, FORGETTING_TIME_S))
        try:
            estimator.update(motion)
            estimator.follow_estimate(WINDOW_S)
            corrections = dict(estimator.applied_values)
            if all(
                abs(value - self._corrections.get(name, 0.0)) <= MIN_SWAP_CHANGE * estimator.prior_sigma[name]
                for name, value in corrections.items()
            ):
                return None
            gap_zero = corrections["gap_zero_m"]
            gap_margin = 2.0 * abs(gap_zero)  # The board does not change its range of gaps.
            magnet = calibrate_magnet(
                self._magnet, corrections["scale_1"], gap_zero, corrections["width"], gap_margin
            )
            return self._compile_block(magnet.model), corrections
        except (InputError, np.linalg.LinAlgError) as error:
            self._stop(str(error))
            return None

    def _swap_block(self, block_words: Sequence[int], corrections: Corrections) -> int:
        """Activate a block in the bench's thread, unless somebody else has changed the model."""
        current_block = self._bench.read_block()
        if set_generation(current_block, 0) != set_generation(self._written_block, 0):
            self._stop("another model is in force")
            return self._bench.tick
        self._written_block = set_generation(block_words, (current_block[GENERATION_INDEX] + 1) & 0xFFFF)
        self._corrections = corrections
        return self._bench.swap_block(self._written_block)

    @property
    def _refusal(self) -> InputError | None:
        rig, reason = self._setup.rig, ""
        if rig.calibration_path is not None:
            reason = "control.calibration: online calibration begins without a file; remove it"
        elif len(rig.settings.body_magnets) > 1:
            reason = "both magnets of a pair share one block; calibrate from a recording"
        elif self._method != "full":
            reason = f"'{self._method}' cannot be calibrated online; choose 'full'"
        return InputError(f"{rig.path}: {reason}", code="not-learnt-here") if reason else None


def _thin_rows(rows: FloatArray, columns: Mapping[str, int]) -> FloatArray:
    """Reduce each block of rows to two: with the smallest and the largest ratio of current to gap."""
    blocks = len(rows) // THINNING_BLOCK_ROWS
    row_count = blocks * THINNING_BLOCK_ROWS
    drive = rows[:row_count, columns["command_A"]] / rows[:row_count, columns["gap_read_m"]]
    drive = drive.reshape(blocks, THINNING_BLOCK_ROWS)
    extreme_rows = np.column_stack([drive.argmin(axis=1), drive.argmax(axis=1)])
    selected_rows = np.unique(extreme_rows + THINNING_BLOCK_ROWS * np.arange(blocks)[:, None])
    return np.concatenate([rows[selected_rows], rows[row_count:]])


def _row_index(signals: Sequence[Signal], column_title: str) -> int:
    """Return the index of a recording's column in the rows of a bench."""
    return 1 + [column_name(signal.name, signal.unit) for signal in signals].index(column_title)
