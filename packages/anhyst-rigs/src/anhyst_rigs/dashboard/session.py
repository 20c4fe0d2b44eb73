"""Run a bench in real time for its pages, its recorder and its log.

An order is a message from a page; the order ``command`` sends a command to the controller. The
session also states which orders are possible at present, and why the others are not.
"""

from __future__ import annotations

import math
import threading
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst.support.states import Command
from anhyst_rigs.dashboard.derived import DerivedSignals
from anhyst_rigs.dashboard.generator import DrivenBench, Wave
from anhyst_rigs.dashboard.improver import Improver
from anhyst_rigs.dashboard.recording import RecordingFile, RecordingSpan, TickRecorder
from anhyst_rigs.dashboard.response import ResponseMeter
from anhyst_rigs.dashboard.sets import ParameterSets
from anhyst_rigs.rig.bench.force import demand_refusal
from anhyst_rigs.rig.bench.pace import PacedBench, raised_priority
from anhyst_rigs.rig.bench.protocol import (
    Bench,
    ControllerStatus,
    Subscription,
    controller_status,
    describe_next_step,
    refusal_reason,
)
from anhyst_rigs.study.improve import BenchMonitor, DrawnLoop, ModelWithLoops
from anhyst_rigs.study.tracking.online_calibration import BenchCalibrator

_MOVING_ORDERS = ("target", "generator", "apply")
"""Orders that can move the controlled body, in addition to the commands of the controller."""

_OTHER_ORDERS = ("load", "pace", "record", "improve", "learn", "response", "sets", "derive", "choose")


def disturbs_measurement(order: str) -> bool:
    """Whether an order or command disturbs a running measurement; STOP only ends it."""
    return order != "stop" and (order in _MOVING_ORDERS or order.upper() in Command.__members__)


def refuse_all_orders(bench: Bench, reason: str) -> dict[str, str]:
    """Return a dictionary that refuses all orders and commands, each for the given reason."""
    return dict.fromkeys((*_commands_by_name(bench), *_MOVING_ORDERS, *_OTHER_ORDERS), reason)


def find_refusals(
    bench: Bench, state: ControllerStatus | None, end_reason: str, measured: str
) -> Mapping[str, str]:
    """Return the orders that are not possible now, with the reason for each."""
    if end_reason:
        return refuse_all_orders(bench, end_reason)
    if not bench.commands:
        reason = bench.loss_reason or "anhyst knows no target of this firmware; change one of its parameters"
        return dict.fromkeys(("target", "generator"), reason)
    if bench.loss_reason or state is None:
        return dict.fromkeys(
            (*_commands_by_name(bench), *_MOVING_ORDERS), bench.loss_reason or "no sample has come yet"
        )
    reasons = {name: refusal_reason(command, state) for name, command in _commands_by_name(bench).items()}
    if bench.demand_range.unit == "N":
        reasons |= dict.fromkeys(("target", "generator"), demand_refusal(state.state))
    if measured:
        reasons |= {name: measured for name in (*reasons, *_MOVING_ORDERS) if disturbs_measurement(name)}
    return {name: reason for name, reason in reasons.items() if reason}


def _commands_by_name(bench: Bench) -> dict[str, Command]:
    return {command.name.lower(): command for command in bench.commands}


_MAX_QUEUED_CHUNKS = 10_000
"""Maximum number of chunks that wait for the estimator; its delays never need as many."""

_MAX_LOG_ENTRIES = 500
"""Maximum number of entries in the log."""

Listener = Callable[[FloatArray], None]
_Result = TypeVar("_Result")


class LogEntry(NamedTuple):
    """A change that a browser or the bench has made."""

    tick: int
    who: str
    text: str


class LiveSession:
    """A session that runs a bench until it is closed.

    Methods that access the bench must be called within :meth:`run_between_chunks`.
    """

    def __init__(
        self,
        bench: Bench,
        recording: RecordingFile | None = None,
        folder: Path | None = None,
        improver: Improver | None = None,
        curves: Sequence[DrawnLoop] = (),
        learner: BenchCalibrator | None = None,
    ) -> None:
        self.learner = learner
        self.bench = DrivenBench(
            bench, lambda reason: self.log_change("bench", f"generator off: {reason}"), self._log_event
        )
        self.curves = tuple(curves)
        self.improver = improver
        self.meter = ResponseMeter(bench.injection_port)
        self.monitored_model: BenchMonitor | None = None
        self._stop_monitoring: Callable[[], None] = lambda: None
        self.log: deque[LogEntry] = deque(maxlen=_MAX_LOG_ENTRIES)
        self.log_entry_count = 0
        self.first_values: dict[str, float] = {}  # first known value of each parameter by name
        self._read_parameters()
        self.last_applied_tick = 0
        self._closed = False
        self._listeners: tuple[Listener, ...] = ()
        folder = folder or Path.cwd()
        self.sets = ParameterSets(folder, self.parameters)
        self._make_recorder(folder)
        if recording is not None:
            self.recorder.start_in_file(recording, RecordingSpan(), 0)
            self._note_parameters()
        self.pacer = PacedBench(self.bench, is_paused=True)
        self._threads: list[threading.Thread] = []
        self._pass_rows_on()
        if learner is not None:
            learner.report = partial(self.log_change, "learning")
            learn = partial(learner.run, run_on_bench=self.run_between_chunks)
            self._threads.append(
                _start_thread("learner", learn, self.pacer.subscribe("learner", _MAX_QUEUED_CHUNKS))
            )

    def _make_recorder(self, folder: Path) -> None:
        """Prepare the derived signals and the recorder for the present signals of the bench."""
        signals, rate = self.bench.signals, self.bench.rate
        self.derived = DerivedSignals(signals, rate)
        self.recorder = TickRecorder(signals, rate, folder, self._log_recorder, self.derived)

    def _pass_rows_on(self) -> None:
        """Pass the rows of the chosen signals to the pages and to the recorder from now on."""
        self.signals = self.bench.signals  # another object after each choice
        self._values: dict[str, float] = {}
        self._missing_ticks, self._last_tick = 0, 0
        self._subscriptions = [
            self.pacer.subscribe("pages"),
            self.pacer.subscribe("the recording", needs_every_tick=True),
        ]
        self._threads += [
            _start_thread("pages", self._pass_rows_to_listeners, self._subscriptions[0]),
            _start_thread("recorder", self.recorder.run, self._subscriptions[1]),
        ]

    def choose(self, signals: Sequence[str], parameters: Sequence[str], event: int | None) -> None:
        """Choose other signals and parameters of the bench. All listeners must subscribe again."""
        if self.recorder.status() is not None:
            raise InputError(
                "choose: a recording of the present signals runs; stop it first", code="busy", key="choose"
            )
        try:
            self.bench.choose(signals, parameters, event)
        finally:
            for subscription in self._subscriptions:
                subscription.close()
            for thread in self._threads:
                thread.join()
            self._threads, self._listeners = [], ()
            self._make_recorder(self.recorder.folder)
            self._read_parameters()
            self.sets.list_names(self.parameters)
            self._pass_rows_on()

    def start(self) -> None:
        """Start the bench's time."""
        self.pacer.resume()

    def close(self) -> None:
        """End the bench, the recording and the running job. A further call has no effect."""
        if self._closed:
            return
        self._closed = True
        if self.improver is not None:
            self.improver.close()
        self.meter.cancel(wait=True)
        self.pacer.close()
        for thread in self._threads:
            thread.join()
        self.bench.close()

    @property
    def driven_reason(self) -> str:
        """Why the controller must not be moved; empty unless a measurement drives it."""
        driven = self.meter.is_driving or (self.improver is not None and self.improver.is_driving)
        return "a measurement drives the controller; wait, cancel it, or stop" if driven else ""

    @property
    def response_refusal(self) -> str:
        """Why the frequency response cannot be measured now; empty if it can."""
        return self.driven_reason or self.meter.refusal_reason(self._values)

    @property
    def end_reason(self) -> str:
        """Why the bench or the recording has ended; empty while both run."""
        return str(self.pacer.error or self.recorder.error_text)

    def subscribe(self, listener: Listener) -> Callable[[], None]:
        """Pass every row to a listener, which must not block; return a function that ends this."""
        self._listeners = (*self._listeners, listener)

        def leave() -> None:
            self._listeners = tuple(one for one in self._listeners if one is not listener)

        return leave

    def run_between_chunks(self, act: Callable[[], _Result]) -> _Result:
        """Call a function between two chunks of ticks, and return its result."""
        return self.pacer.execute(lambda _: act())

    def log_change(self, actor: str, text: str) -> None:
        """Write a change into the log and into the recording."""
        self.log.append(LogEntry(self.bench.tick, actor, text))
        self.log_entry_count += 1
        self.recorder.note(self.bench.tick, f"{actor}: {text}")

    def record(self, name: str, recording_span: RecordingSpan) -> None:
        """Start a recording that includes active parameters and changes in its pretrigger time."""
        tick = self.bench.tick
        self.recorder.start(name, recording_span, tick)
        self._note_parameters()
        for entry in tuple(self.log):
            if entry.tick >= tick - recording_span.pretrigger_s * self.bench.rate:
                self.recorder.note(entry.tick, f"{entry.who}: {entry.text}")

    def stop(self, actor: str) -> None:
        """Stop the rig, even if the bench is paused. The order is logged even if it is refused."""
        self.log_change(actor, "emergency stop")
        try:
            self.bench.command(Command.STOP)
        finally:
            self.generate(None)
            self.meter.cancel()
            self.pacer.resume()

    def generate(self, generator: Wave | None) -> None:
        """Add a generator to the target, or stop it and return to the plain target."""
        self.bench.generate(generator)

    def monitor(self, model: ModelWithLoops | None) -> None:
        """Compare all further rows with a model; None ends the comparison."""
        monitored_model = None
        if model is not None:
            monitored_model = BenchMonitor(model.model, self.bench.signals, self.bench.rate)
        self._stop_monitoring()
        self.monitored_model = monitored_model
        if monitored_model is not None:
            self._stop_monitoring = self.subscribe(monitored_model.add_rows)

    def apply_parameters(self, values: Mapping[str, float]) -> int:
        """Set parameters, all at the same tick; return the first tick that uses them."""
        tick = self.last_applied_tick = self.bench.apply(values)
        self._read_parameters()
        return tick

    def _read_parameters(self) -> None:
        """Read the active parameters. Labels of steps on all pages are relative to the first values."""
        self.parameters = self.bench.parameters()
        self.first_values = {one.name: one.value for one in self.parameters} | self.first_values

    def status(self) -> Mapping[str, Any]:
        """Return the state that a page shows in addition to the signals."""
        pacing, generator = self.pacer.pacing(), self.bench.generator
        knows_state = bool(self._values) and bool(self.bench.commands)
        controller_state = controller_status(self._values) if knows_state else None
        refusals = find_refusals(self.bench, controller_state, self.end_reason, self.driven_reason)
        if reason := self.response_refusal:
            refusals = {"response": reason, **refusals}
        return {
            "tick": pacing.tick,
            "speed": pacing.speed,
            "paused": pacing.is_paused,
            "factor": pacing.measured_speed,
            "lateness": pacing.max_lateness,
            "slips": pacing.slip_count,
            "missing": self._missing_ticks,
            "waits_for": pacing.awaited_recorder,
            "target": self.bench.target,
            "load": self.bench.load_N,
            "state": int(self._values.get("state", 0)) if self.bench.commands else None,
            "fault": int(self._values.get("fault", 0)) if self.bench.commands else 0,
            "refused": refusals,
            "next": self._next_step(controller_state),
            "generator": None if generator is None else generator.as_dict(),
            "recording": self.recorder.status(),
            "sets": self.sets.names,
            "lost": self.bench.loss_reason,
            "ended": self.end_reason,
            "improve": None if self.improver is None else self.improver.status(),
            "response": self.meter.status(),
            "learn": None if self.learner is None else self.learner.status(),
            "watch": None if self.monitored_model is None else self.monitored_model.status(),
        }

    def _next_step(self, controller_state: ControllerStatus | None) -> str:
        """Return the next action that leads to a running rig; empty while the rig runs."""
        if self.end_reason:
            return "start anhyst live again"
        if controller_state is None or self.bench.loss_reason or self.driven_reason:
            return ""
        return describe_next_step(self.bench.commands, controller_state)

    def _note_parameters(self) -> None:
        active_values = ", ".join(
            f"{parameter.name} = {parameter.value!r} {parameter.unit}".rstrip()
            for parameter in self.parameters
        )
        self.recorder.note(self.bench.tick, f"in force: {active_values or 'no parameters'}")

    def _log_recorder(self, text: str) -> None:
        """Log a message of the recorder."""
        self.log.append(LogEntry(self.bench.tick, "recorder", text))
        self.log_entry_count += 1

    def _log_event(self, text: str) -> None:
        """Log an event of the controller, and read its active parameters again."""
        self.log_change("controller", text)
        self._read_parameters()
        if self.improver is not None and not self.bench.loss_reason:
            with suppress(InputError):  # If the controller is lost again, another event repeats this.
                self.improver.check_after_reconnect()
                self.curves = self.improver.known_model.curves

    def _pass_rows_to_listeners(self, subscription: Subscription) -> None:
        while (rows := subscription.get()) is not None:
            extended_rows = self.derived.extend(rows)
            for listener in self._listeners:
                listener(extended_rows)
            if self._last_tick:
                passed_ticks = int(rows[-1, 0]) - self._last_tick
                self._missing_ticks += passed_ticks // self.bench.ticks_per_row - len(rows)
            self._last_tick = int(rows[-1, 0])
            self._values = dict(
                zip([signal.name for signal in self.signals], rows[-1, 1:].tolist(), strict=True)
            )


def _start_thread(
    name: str, work: Callable[[Subscription], None], subscription: Subscription
) -> threading.Thread:
    def run() -> None:
        with raised_priority():
            work(subscription)

    thread = threading.Thread(target=run, name=name, daemon=True)
    thread.start()
    return thread


def read_finite_number(fields: Mapping[str, Any], key: str) -> float:
    """Return a finite number from a message."""
    value = fields.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError(f"{key}: is no number", code="not-a-number", key=key)
    return float(value)
