"""Improve the model of a running bench: measure loops, identify, compile and swap.

Long computations run in a separate process while the bench continues. They report their progress
and can be cancelled.
"""

from __future__ import annotations

import os
import signal
import tempfile
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from multiprocessing import get_context
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from anhyst.support.block_words import GENERATION_INDEX, set_generation
from anhyst.support.errors import InputError, NegativeResult
from anhyst.support.jobs import Progress
from anhyst_rigs.study.excite.on_board import DrivenBoard
from anhyst_rigs.study.improve import (
    LOOPS_FILE,
    MODEL_FILE,
    ModelWithLoops,
    compile_block,
    excitation_limits,
    identify_model,
    make_model_with_loops,
    measure_loops,
    read_identified_model,
    tighten_limits,
)
from anhyst_rigs.study.prepared_benches import Improvable, PreparedBoard
from anhyst_rigs.study.response.measurement import ResponseSeat

WorkFunction = Callable[..., Mapping[str, Any]]
"""Function of a module, called with a :data:`anhyst.support.jobs.Progress` and its arguments."""

EndFunction = Callable[[Mapping[str, Any] | str], None]
"""Function that is called with the result, or with the reason why there is none."""

_PROCESS_NICENESS = 10
"""Niceness of the separate process, which gives the bench priority."""


class ProcessJob:
    """A computation in a separate process."""

    def __init__(self, work: WorkFunction, *work_arguments: Any, on_end: EndFunction) -> None:
        self.completed_fraction = 0.0
        self._on_end = on_end
        self._cancelled = False
        context = get_context("spawn")
        self._receiver, self._sender = context.Pipe(duplex=False)
        self._process = context.Process(
            target=_run_in_process, args=(self._sender, work, work_arguments), name="job", daemon=True
        )
        self._started = threading.Event()
        self._thread = threading.Thread(target=self._receive_progress, name="job", daemon=True)
        self._thread.start()

    def cancel(self) -> None:
        """Kill the process; there is no result."""
        self._cancelled = True
        self._started.wait()
        self._process.kill()
        self._thread.join()

    def _receive_progress(self) -> None:
        self._process.start()  # The start takes some time; the caller does not wait for it.
        self._sender.close()
        self._started.set()
        outcome: Mapping[str, Any] | str = "the work ended without a result; see the terminal"
        try:
            while True:
                message = self._receiver.recv()
                if isinstance(message, float):
                    self.completed_fraction = message
                else:
                    outcome = message
        except EOFError:
            self._process.join()
        self._receiver.close()
        if not self._cancelled:
            self._on_end(outcome)


def _run_in_process(sender: Connection, work: WorkFunction, arguments: tuple[Any, ...]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Only the server may end this process.
    if hasattr(os, "nice"):
        os.nice(_PROCESS_NICENESS)

    def progress(completed: float, total: float) -> None:
        sender.send(min(1.0, completed / total) if total > 0.0 else 0.0)

    try:
        sender.send(dict(work(progress, *arguments)))
    except (InputError, NegativeResult) as error:
        sender.send(str(error))


_CANCEL_TIMEOUT_S = 5.0
"""Longest time for stopping the controller and restoring its settings at the end of the session, s.
"""


class OperatorSeat(DrivenBoard, ResponseSeat, Protocol):
    """Exclusive access of a measurement to the running controller."""

    def cancel(self) -> None:
        """Make the next access raise an error, so that the measurement stops the controller."""

    def close(self) -> None:
        """End the access, so that the operator can use the controller again."""


class BoardJob:
    """A measurement through the running controller."""

    def __init__(
        self,
        work: Callable[[Progress, OperatorSeat], Mapping[str, Any]],
        seat: Callable[[], OperatorSeat],
        on_end: EndFunction,
    ) -> None:
        self.completed_fraction = 0.0
        self._work, self._on_end = work, on_end
        self._seat = seat()
        self._thread = threading.Thread(target=self._run, name="measuring", daemon=True)
        self._thread.start()

    def cancel(self) -> None:
        """Cancel the measurement: the controller stops, and there is no result."""
        self._seat.cancel()

    def wait(self) -> None:
        """Wait until the measurement has ended; the thread of the bench must not call this."""
        self._thread.join(_CANCEL_TIMEOUT_S)

    def _run(self) -> None:
        def progress(completed: float, total: float) -> None:
            self.completed_fraction = completed / total

        outcome: Mapping[str, Any] | str
        try:
            outcome = self._work(progress, self._seat)
        except (InputError, NegativeResult) as error:
            outcome = str(error)
        self._seat.close()
        self._on_end(outcome)


@runtime_checkable
class BlockHolder(Protocol):
    """A bench with a parameter block, in addition to :class:`anhyst_rigs.rig.bench.protocol.Bench`."""

    def read_block(self) -> list[int]:
        """Return the active parameter block."""

    def swap_block(self, words: Sequence[int]) -> int:
        """Download another parameter block and activate it between two ticks; return the tick."""


IMPROVEMENT_STEPS = ("measure", "identify", "compile", "swap")
"""All steps of an improvement, in their order."""

_REQUIRED_STEP = {"identify": "measure", "compile": "identify", "swap": "compile", "files": "measure"}
"""For each step, the step whose result it requires."""

_STEP_ORDERS = (*IMPROVEMENT_STEPS, "back", "cancel", "files", "watch")
"""All orders that a page can send to the improver."""


class Improver:
    """The results of all steps for a bench, and at most one running job."""

    def __init__(self, prepared_bench: Improvable, bench: BlockHolder) -> None:
        self.known_model = make_model_with_loops(prepared_bench.measured_loops, prepared_bench.model)
        self.results: Mapping[str, Mapping[str, Any]] = {}
        self._prepared = prepared_bench
        self._bench = bench
        self._folder = tempfile.TemporaryDirectory(prefix="anhyst-improve-")
        self._job: ProcessJob | BoardJob | None = None
        self._step, self._error_text, self._start_time = "", "", 0.0
        self._new_block: list[int] = []
        self._active_block: list[int] = []
        self._first_model = self.known_model
        self._new_model: ModelWithLoops | None = None
        self._previous: tuple[list[int], ModelWithLoops] | None = None

    @property
    def folder(self) -> Path:
        """Folder with the files that the steps write."""
        return Path(self._folder.name)

    def limits(self) -> Mapping[str, Any]:
        """Return the limits within which loops are measured."""
        return excitation_limits(self._prepared)

    @property
    def is_driving(self) -> bool:
        """Whether a measurement drives the running controller."""
        return isinstance(self._job, BoardJob)

    def measure(self, tighter_limits: Mapping[str, float], seat: Callable[[], OperatorSeat]) -> None:
        """Start to measure loops; some limits may be tighter."""
        prepared_bench, folder = self._prepared, self.folder
        tighten_limits(prepared_bench.specimen(), tighter_limits)
        if not isinstance(prepared_bench, PreparedBoard):
            self._start_process_job("measure", measure_loops, dict(tighter_limits))
            return

        def work(progress: Progress, bench: OperatorSeat) -> Mapping[str, Any]:
            return measure_loops(progress, prepared_bench, folder, tighter_limits, bench)

        self._start_job("measure", lambda ended: BoardJob(work, seat, ended))

    def identify(self) -> None:
        """Start to identify a model from the measured loops."""
        self._start_process_job("identify", identify_model, self.known_model.model)

    def compile(self) -> None:
        """Start to compile the identified model for the running board."""
        self._start_process_job("compile", compile_block)

    def swap(self) -> int:
        """Activate the new model; return the tick. Only the thread of the bench may call this."""
        self._check_step("swap")
        assert self._new_model is not None
        tick = self._swap_block(self._new_block, self._new_model)
        self._store_result("swap", {"tick": tick})
        return tick

    def swap_back(self) -> int:
        """Activate the model that was replaced. Only the thread of the bench may call this."""
        self._check_step("back")
        assert self._previous is not None
        return self._swap_block(*self._previous)

    def model_to_monitor(self) -> ModelWithLoops:
        """Return the model for a comparison with rows of the bench."""
        self._check_step("watch")
        return self.known_model

    def cancel(self) -> None:
        """Cancel the running job; there is no result. A measurement stops the rig first."""
        if isinstance(self._job, BoardJob):
            self._job.cancel()
            return
        job, self._job = self._job, None
        if job is not None:
            job.cancel()
            self._error_text = f"{self._step}: cancelled"

    def files(self) -> Mapping[str, str]:
        """Return the texts of all files that the steps wrote, by file name."""
        names = (LOOPS_FILE, str(Path(LOOPS_FILE).with_suffix(".toml")), MODEL_FILE)
        paths = [self.folder / name for name in names]
        return {path.name: path.read_text("utf-8") for path in paths if path.exists()}

    def status(self) -> Mapping[str, Any]:
        """Return the state of the running step, which a page shows."""
        job = self._job
        return {
            "step": self._step if job is not None else "",
            "share": job.completed_fraction if job is not None else 0.0,
            "seconds": time.monotonic() - self._start_time if job is not None else 0.0,
            "trouble": self._error_text,
            "refused": {step: str(reason) for step in _STEP_ORDERS if (reason := self._refusal_reason(step))},
        }

    def _refusal_reason(self, step: str) -> InputError | None:
        """Return why a step is not possible now, or None if it is possible."""
        required_step, error_code, reason_text = _REQUIRED_STEP.get(step), "step-missing", ""
        if step == "watch" and not self._prepared.has_single_magnet:
            error_code = "force-of-a-pair"
            reason_text = "for a pair of magnets, only the sum of both forces is known"
        elif step in (*IMPROVEMENT_STEPS, "back") and self._job is not None:
            error_code, reason_text = "busy", f"{self._step} is still running; wait, or cancel it"
        elif step == "cancel" and self._job is None:
            reason_text = "nothing is under way"
        elif step == "back" and self._previous is None:
            reason_text = "no model was swapped yet"
        elif required_step is not None and required_step not in self.results:
            reason_text = f"{required_step} comes first"
        return InputError(f"{step}: {reason_text}", code=error_code, key=step) if reason_text else None

    def _check_step(self, step: str) -> None:
        if reason := self._refusal_reason(step):
            raise reason

    def close(self) -> None:
        """End the job and delete the files."""
        job = self._job
        self.cancel()
        if isinstance(job, BoardJob):
            job.wait()
        self._folder.cleanup()

    def check_after_reconnect(self) -> None:
        """Discard the swap if a reconnected controller has lost the swapped block.

        Only the thread of the bench may call this.
        """
        if self._previous is None or self._bench.read_block() == self._active_block:
            return
        self.known_model = self._first_model
        self._previous = None
        self.results = {name: result for name, result in self.results.items() if name != "swap"}

    def _start_process_job(self, step: str, work: WorkFunction, *work_arguments: Any) -> None:
        self._start_job(
            step, lambda ended: ProcessJob(work, self._prepared, self.folder, *work_arguments, on_end=ended)
        )

    def _start_job(self, step: str, make: Callable[[EndFunction], ProcessJob | BoardJob]) -> None:
        self._check_step(step)
        self._step, self._error_text, self._start_time = step, "", time.monotonic()

        def ended(outcome: Mapping[str, Any] | str) -> None:
            if isinstance(outcome, str):
                self._error_text = f"{step}: {outcome}"
            else:
                if step == "identify":
                    self._new_model = read_identified_model(self.folder)
                self._store_result(step, {**outcome, "took_s": time.monotonic() - self._start_time})
            self._job = None

        self._job = make(ended)

    def _store_result(self, step: str, result: Mapping[str, Any]) -> None:
        """Store the result of a step, and discard the results of all later steps."""
        shown_values = {name: value for name, value in result.items() if name != "words"}
        if "words" in result:
            self._new_block = list(result["words"])
        kept_steps = IMPROVEMENT_STEPS[: IMPROVEMENT_STEPS.index(step)]
        self.results = {
            **{name: old_result for name, old_result in self.results.items() if name in kept_steps},
            step: shown_values,
        }

    def _swap_block(self, block_words: Sequence[int], model: ModelWithLoops) -> int:
        old_block = self._bench.read_block()
        self._active_block = set_generation(block_words, (old_block[GENERATION_INDEX] + 1) & 0xFFFF)
        tick = self._bench.swap_block(self._active_block)
        self._previous = old_block, self.known_model
        self.known_model = model
        return tick
