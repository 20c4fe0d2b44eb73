"""The model beside a bench that runs: held against its rows, measured and identified anew, swapped.

Long work is done in a process of its own, while the bench goes on: progress, an end, cancelling.
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

from anhyst.support.block_words import GENERATION_AT, regenerate
from anhyst.support.errors import InputError, NegativeResult
from anhyst.support.jobs import Progress
from anhyst_rigs.study.excite.on_board import DrivenBoard
from anhyst_rigs.study.improve import (
    LOOPS,
    MODEL,
    KnownModel,
    compile_block,
    identify_model,
    known_model,
    limits_of,
    measure_loops,
    read_known,
    within,
)
from anhyst_rigs.study.prepared import Improvable, PreparedBoard

Work = Callable[..., Mapping[str, Any]]
"""Called with a :data:`anhyst.support.jobs.Progress` and what else was given; of a module."""

Ended = Callable[[Mapping[str, Any] | str], None]
"""Called with the result, or with the reason why there is none."""

_NICE = 10
"""The bench goes before."""


class Job:
    """A piece of work under way."""

    def __init__(self, work: Work, *given: Any, ended: Ended) -> None:
        self.share = 0.0
        self._ended = ended
        self._cancelled = False
        context = get_context("spawn")
        self._news, self._says = context.Pipe(duplex=False)
        self._process = context.Process(
            target=_run, args=(self._says, work, given), name="job", daemon=True
        )
        self._started = threading.Event()
        self._thread = threading.Thread(target=self._listen, name="job", daemon=True)
        self._thread.start()

    def cancel(self) -> None:
        """End it without a result."""
        self._cancelled = True
        self._started.wait()
        self._process.kill()
        self._thread.join()

    def _listen(self) -> None:
        self._process.start()  # takes a while, for which whoever asked does not wait
        self._says.close()
        self._started.set()
        outcome: Mapping[str, Any] | str = "the work ended without a result; see the terminal"
        try:
            while True:
                news = self._news.recv()
                if isinstance(news, float):
                    self.share = news
                else:
                    outcome = news
        except EOFError:
            self._process.join()
        self._news.close()
        if not self._cancelled:
            self._ended(outcome)


def _run(says: Connection, work: Work, given: tuple[Any, ...]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # ctrl-C ends the server, which ends this
    if hasattr(os, "nice"):
        os.nice(_NICE)

    def progress(done: float, total: float) -> None:
        says.send(min(1.0, done / total) if total > 0.0 else 0.0)

    try:
        says.send(dict(work(progress, *given)))
    except (InputError, NegativeResult) as error:
        says.send(str(error))


_GO_S = 5.0
"""For the controller to be stopped and its settings to be put back when the session ends, s."""


class Seat(DrivenBoard, Protocol):
    """A place at the controller that runs."""

    def cancel(self) -> None:
        """Let the next look at it raise, once: who measures then stops the controller."""

    def close(self) -> None:
        """Leave it."""


class BoardJob:
    """A measurement under way."""

    def __init__(
        self,
        work: Callable[[Progress, Seat], Mapping[str, Any]],
        seat: Callable[[], Seat],
        ended: Ended,
    ) -> None:
        self.share = 0.0
        self._work, self._ended = work, ended
        self._seat = seat()
        self._thread = threading.Thread(target=self._run, name="measuring", daemon=True)
        self._thread.start()

    def cancel(self) -> None:
        """Let it end without a result, once the controller is stopped."""
        self._seat.cancel()

    def wait(self) -> None:
        """Wait until it has left the controller; not in the thread of the bench."""
        self._thread.join(_GO_S)

    def _run(self) -> None:
        def progress(done: float, total: float) -> None:
            self.share = done / total

        outcome: Mapping[str, Any] | str
        try:
            outcome = self._work(progress, self._seat)
        except (InputError, NegativeResult) as error:
            outcome = str(error)
        self._seat.close()
        self._ended(outcome)


@runtime_checkable
class BlockHolder(Protocol):
    """A bench beyond :class:`anhyst_rigs.rig.bench.protocol.Bench`: it holds a parameter block."""

    def read_block(self) -> list[int]:
        """Return the parameter block in force."""

    def swap_block(self, words: Sequence[int]) -> int:
        """Download another parameter block and put it in force between two ticks."""


STEPS = ("measure", "identify", "compile", "swap")
"""In this order."""

_NEEDED = {"identify": "measure", "compile": "identify", "swap": "compile", "files": "measure"}
"""What each needs the result of."""

_ORDERS = (*STEPS, "back", "cancel", "files", "watch")
"""Whatever a page may ask for."""


class Improver:
    """What has been measured and found beside a bench, and the one job that may be under way."""

    def __init__(self, prepared: Improvable, bench: BlockHolder) -> None:
        self.known = known_model(prepared.measured, prepared.model)
        self.results: Mapping[str, Mapping[str, Any]] = {}
        self._prepared = prepared
        self._bench = bench
        self._folder = tempfile.TemporaryDirectory(prefix="anhyst-improve-")
        self._job: Job | BoardJob | None = None
        self._step, self._trouble, self._began = "", "", 0.0
        self._words: list[int] = []
        self._in_force: list[int] = []
        self._first = self.known
        self._found: KnownModel | None = None
        self._before: tuple[list[int], KnownModel] | None = None

    @property
    def folder(self) -> Path:
        """Folder of the files that the steps leave."""
        return Path(self._folder.name)

    def limits(self) -> Mapping[str, Any]:
        """Return what a drive will keep to."""
        return limits_of(self._prepared)

    @property
    def drives(self) -> bool:
        """Whether a measurement drives the controller that runs."""
        return isinstance(self._job, BoardJob)

    def measure(self, tighter: Mapping[str, float], seat: Callable[[], Seat]) -> None:
        """Begin to measure loops, with some limits drawn tighter."""
        prepared, folder = self._prepared, self.folder
        within(prepared.specimen(), tighter)
        if not isinstance(prepared, PreparedBoard):
            self._begin("measure", measure_loops, dict(tighter))
            return

        def work(progress: Progress, bench: Seat) -> Mapping[str, Any]:
            return measure_loops(progress, prepared, folder, tighter, bench)

        self._start("measure", lambda ended: BoardJob(work, seat, ended))

    def identify(self) -> None:
        """Begin to identify a model of the loops."""
        self._begin("identify", identify_model, self.known.model)

    def compile(self) -> None:
        """Begin to compile the model for the running board."""
        self._begin("compile", compile_block)

    def swap(self) -> int:
        """Put the new model in force; in the thread of the bench."""
        self._check("swap")
        assert self._found is not None
        tick = self._exchange(self._words, self._found)
        self._leave("swap", {"tick": tick})
        return tick

    def back(self) -> int:
        """Put in force what was before the last swap; in the thread of the bench."""
        self._check("back")
        assert self._before is not None
        return self._exchange(*self._before)

    def to_watch(self) -> KnownModel:
        """Return the model that the rows of the bench can be held against."""
        self._check("watch")
        return self.known

    def cancel(self) -> None:
        """End the job that is under way, without a result; one that drives stops the rig first."""
        if isinstance(self._job, BoardJob):
            self._job.cancel()
            return
        job, self._job = self._job, None
        if job is not None:
            job.cancel()
            self._trouble = f"{self._step}: cancelled"

    def files(self) -> Mapping[str, str]:
        """Return the text of all files that the steps left, by name."""
        names = (LOOPS, str(Path(LOOPS).with_suffix(".toml")), MODEL)
        paths = [self.folder / name for name in names]
        return {path.name: path.read_text("utf-8") for path in paths if path.exists()}

    def status(self) -> Mapping[str, Any]:
        """Return what a page shows while a step is under way."""
        job = self._job
        return {
            "step": self._step if job is not None else "",
            "share": job.share if job is not None else 0.0,
            "seconds": time.monotonic() - self._began if job is not None else 0.0,
            "trouble": self._trouble,
            "refused": {step: str(why) for step in _ORDERS if (why := self._refusal(step))},
        }

    def _refusal(self, step: str) -> InputError | None:
        """Return why a step cannot be done now, or None where it can."""
        needed, code, why = _NEEDED.get(step), "step-missing", ""
        if step == "watch" and not self._prepared.alone:
            code = "force-of-a-pair"
            why = "of a pair only the sum of both forces is known, not one's own"
        elif step in (*STEPS, "back") and self._job is not None:
            code, why = "busy", f"{self._step} is still under way; wait, or cancel it"
        elif step == "cancel" and self._job is None:
            why = "nothing is under way"
        elif step == "back" and self._before is None:
            why = "no model was swapped yet"
        elif needed is not None and needed not in self.results:
            why = f"{needed} comes first"
        return InputError(f"{step}: {why}", code=code, key=step) if why else None

    def _check(self, step: str) -> None:
        if why := self._refusal(step):
            raise why

    def close(self) -> None:
        """End a job and forget the files."""
        job = self._job
        self.cancel()
        if isinstance(job, BoardJob):
            job.wait()
        self._folder.cleanup()

    def look_again(self) -> None:
        """See whether a controller that was lost still has what was swapped in; in its thread."""
        if self._before is None or self._bench.read_block() == self._in_force:
            return
        self.known = self._first
        self._before = None
        self.results = {name: one for name, one in self.results.items() if name != "swap"}

    def _begin(self, step: str, work: Work, *given: Any) -> None:
        self._start(step, lambda ended: Job(work, self._prepared, self.folder, *given, ended=ended))

    def _start(self, step: str, make: Callable[[Ended], Job | BoardJob]) -> None:
        self._check(step)
        self._step, self._trouble, self._began = step, "", time.monotonic()

        def ended(outcome: Mapping[str, Any] | str) -> None:
            if isinstance(outcome, str):
                self._trouble = f"{step}: {outcome}"
            else:
                if step == "identify":
                    self._found = read_known(self.folder)
                self._leave(step, {**outcome, "took_s": time.monotonic() - self._began})
            self._job = None

        self._job = make(ended)

    def _leave(self, step: str, result: Mapping[str, Any]) -> None:
        """Keep what a step left; what came after it before counts no more."""
        shown = {name: value for name, value in result.items() if name != "words"}
        if "words" in result:
            self._words = list(result["words"])
        kept = STEPS[: STEPS.index(step)]
        self.results = {
            **{name: one for name, one in self.results.items() if name in kept},
            step: shown,
        }

    def _exchange(self, words: Sequence[int], known: KnownModel) -> int:
        old = self._bench.read_block()
        self._in_force = regenerate(words, (old[GENERATION_AT] + 1) & 0xFFFF)
        tick = self._bench.swap_block(self._in_force)
        self._before = old, self.known
        self.known = known
        return tick
