"""Execute the orders that a browser page sends, between two chunks of ticks."""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst.support.states import Command
from anhyst_rigs.dashboard.derived import DerivedSignal
from anhyst_rigs.dashboard.generator import Chirp, PeriodicWave, Wave, read_wave_table
from anhyst_rigs.dashboard.improver import Improver
from anhyst_rigs.dashboard.recording import RecordingSpan
from anhyst_rigs.dashboard.session import LiveSession, disturbs_measurement, read_finite_number
from anhyst_rigs.dashboard.sets import FILE_SUFFIX, changed_values
from anhyst_rigs.rig.bench.protocol import DemandRange, Parameter, Signal

_MAX_QUEUED_CHUNKS = 1000
"""Maximum number of chunks that wait for a measurement; its delays never need as many."""

_CHUNK_TIMEOUT_S = 0.1
"""Longest wait for a chunk, s. Then the measurement checks whether the controller is lost."""


class SessionSeat:
    """Access of a measurement to the bench of a session (an `OperatorSeat`).

    All calls to the bench are executed between two chunks.
    """

    def __init__(self, session: LiveSession) -> None:
        self._session = session
        self._cancelled = threading.Event()
        self._rows = session.pacer.subscribe("measuring", max_chunks=_MAX_QUEUED_CHUNKS)
        self.rate: float = session.bench.rate
        self.ticks_per_row: int = session.bench.ticks_per_row
        self.demand_range: DemandRange = session.bench.demand_range
        self.signals: tuple[Signal, ...] = session.bench.signals
        self.injection_port = session.bench.injection_port

    @property
    def loss_reason(self) -> str:
        """Why the controller is lost; empty while it responds."""
        return self._session.bench.loss_reason

    def advance(self, ticks: int) -> FloatArray:
        """Return the next rows, usually as many as requested; none if the controller is lost."""
        row_blocks = [np.empty((0, 1 + len(self.signals)))]
        while sum(map(len, row_blocks)) * self.ticks_per_row < ticks:
            if self._cancelled.is_set():
                self._cancelled.clear()
                raise InputError("cancelled", code="cancelled")
            try:
                chunk = self._rows.get(_CHUNK_TIMEOUT_S)
            except TimeoutError:
                break
            if chunk is None:
                raise InputError(self._session.end_reason or "the bench is closed", code="bench-closed")
            row_blocks.append(chunk)
        return np.concatenate(row_blocks)

    def command(self, command: Command) -> None:
        """Send a command."""

        def act() -> None:
            self._session.bench.command(command)
            self._session.log_change("measuring", command.name.lower())

        self._session.run_between_chunks(act)

    def demand(self, value: float) -> None:
        """Set the demanded force, N."""
        self._session.run_between_chunks(lambda: self._session.bench.demand(value))

    def inject(self, signal: FloatArray) -> int:
        """Add a signal to the position reading; return its first tick."""
        return self._session.run_between_chunks(lambda: self._session.bench.inject(signal))

    def parameters(self) -> tuple[Parameter, ...]:
        """Return the settings with their active values."""
        return self._session.parameters

    def apply(self, values: Mapping[str, float]) -> int:
        """Write settings."""
        return self._session.run_between_chunks(lambda: self._session.apply_parameters(values))

    def cancel(self) -> None:
        """Make the next access raise an error, so that the measurement stops the controller."""
        self._cancelled.set()

    def close(self) -> None:
        """End the access, so that the operator can use the controller again."""
        self._rows.close()


Fields = Mapping[str, Any]
_StepAction = Callable[[LiveSession, Improver, str, Fields], Fields]


def perform_improvement_step(session: LiveSession, client_name: str, fields: Fields) -> Fields:
    """Execute the step that the field ``step`` of a message names."""
    step = str(fields.get("step"))
    action = _STEP_ACTIONS.get(step)
    if action is None:
        raise InputError(f"improve: no step '{step[:40]}'", code="unknown-step", key="improve")
    if session.improver is None:
        raise InputError(
            "improve: this bench was not opened from a rig file", code="no-rig-file", key="improve"
        )
    return action(session, session.improver, client_name, fields)


def _execute_measure(session: LiveSession, improver: Improver, client_name: str, fields: Fields) -> Fields:
    limits = fields.get("limits", {})
    if not isinstance(limits, dict):
        raise InputError("limits: name none", code="missing", key="limits")
    tighter_limits = {str(name): read_finite_number(limits, name) for name in limits}
    improver.measure(tighter_limits, lambda: SessionSeat(session))
    session.log_change(client_name, "loops are measured")
    return {}


def _run_and_log(start_step: Callable[[Improver], None], text: str) -> _StepAction:
    def act(session: LiveSession, improver: Improver, client_name: str, fields: Fields) -> Fields:
        start_step(improver)
        session.log_change(client_name, text)
        return {}

    return act


def _swap_model_and_log(exchange: Callable[[Improver], int], text: str) -> _StepAction:
    def act(session: LiveSession, improver: Improver, client_name: str, fields: Fields) -> Fields:
        tick = exchange(improver)
        session.log_change(client_name, text)
        session.curves = improver.known_model.curves
        if session.monitored_model is not None:
            # The monitoring restarts with the new model.
            session.monitor(improver.model_to_monitor())
        return {"applied": tick}

    return act


def _execute_files(session: LiveSession, improver: Improver, client_name: str, fields: Fields) -> Fields:
    return {"files": improver.files()}


def _execute_watch(session: LiveSession, improver: Improver, client_name: str, fields: Fields) -> Fields:
    is_on = fields.get("on") is True
    session.monitor(improver.model_to_monitor() if is_on else None)
    session.log_change(
        client_name, "drift is monitored from now on" if is_on else "drift is no longer monitored"
    )
    return {}


_STEP_ACTIONS: Mapping[str, _StepAction] = {
    "measure": _execute_measure,
    "identify": _run_and_log(Improver.identify, "a model is identified"),
    "compile": _run_and_log(Improver.compile, "the model is compiled"),
    "swap": _swap_model_and_log(Improver.swap, "the new model is swapped in"),
    "back": _swap_model_and_log(Improver.swap_back, "the previous model is swapped in"),
    "cancel": _run_and_log(Improver.cancel, "work cancelled"),
    "files": _execute_files,
    "watch": _execute_watch,
}


OrderAction = Callable[[LiveSession, str, Fields], Fields]

_MAX_STAGED_PARAMETERS = 200
"""Largest number of parameters in one message."""


def perform(session: LiveSession, client_name: str, fields: Fields) -> Fields:
    """Execute the order in a message from a page; only the thread of the bench may call this."""
    action = _ORDER_ACTIONS.get(str(fields.get("do")))
    if action is None:
        raise InputError(f"no order '{str(fields.get('do'))[:40]}'", code="unknown-order", key="do")
    order = str(fields.get("name") if fields["do"] == "command" else fields["do"])
    if session.driven_reason and disturbs_measurement(order):
        raise InputError(session.driven_reason, code="busy")
    return {"tick": session.bench.tick, **action(session, client_name, fields)}


def _execute_command(session: LiveSession, client_name: str, fields: Fields) -> Fields:
    name = str(fields.get("name"))
    commands = {command.name.lower(): command for command in session.bench.commands}
    if name not in commands:
        raise InputError(f"this controller has no command '{name[:40]}'", code="unknown-command")
    command = commands[name]
    if command in (Command.STOP, Command.LAND):
        session.generate(None)
        session.meter.cancel()
    session.bench.command(command)
    session.log_change(client_name, name)
    return {}


def _execute_target(session: LiveSession, client_name: str, fields: Fields) -> Fields:
    value = read_finite_number(fields, "value")
    session.bench.demand(value)
    demand = session.bench.demand_range
    name = "offset of the motion" if demand.is_offset else "target"
    session.log_change(client_name, f"{name} {value:g} {demand.unit}")
    return {}


def _execute_load(session: LiveSession, client_name: str, fields: Fields) -> Fields:
    value = read_finite_number(fields, "value")
    session.bench.load(value)
    session.log_change(client_name, f"load {value:g} N")
    return {}


def _execute_generator(session: LiveSession, client_name: str, fields: Fields) -> Fields:
    if fields.get("shape") is None:
        session.generate(None)
        session.log_change(client_name, "generator off")
        return {}
    wave = _read_wave(session, fields)
    session.generate(wave)
    (_, shape), *parameters = wave.as_dict().items()
    units = {"amplitude": f" {session.bench.demand_range.unit}", "rows": "", "lasts": " s"}
    parameter_texts = [f"{name} {value:g}{units.get(name, ' Hz')}" for name, value in parameters]
    session.log_change(client_name, f"generator {', '.join([str(shape), *parameter_texts])}")
    return {}


def _read_wave(session: LiveSession, fields: Fields) -> Wave:
    begin_tick, shape = session.bench.tick + 1, str(fields["shape"])
    if shape == "own CSV":
        return read_wave_table(str(fields.get("text", "")), session.bench.demand_range.unit, begin_tick)
    amplitude = read_finite_number(fields, "amplitude")
    if shape == "chirp":
        start_frequency, end_frequency, duration = (
            read_finite_number(fields, name) for name in ("low", "high", "lasts")
        )
        return Chirp(amplitude, start_frequency, end_frequency, duration, begin_tick)
    return PeriodicWave(shape, amplitude, read_finite_number(fields, "frequency"), begin_tick)


def _execute_apply(session: LiveSession, client_name: str, fields: Fields) -> Fields:
    new_values = fields.get("values")
    if not isinstance(new_values, dict) or not 1 <= len(new_values) <= _MAX_STAGED_PARAMETERS:
        raise InputError("values: names no parameter", code="missing", key="values")
    values = {str(name): read_finite_number(new_values, name) for name in new_values}
    tick = session.apply_parameters(values)
    session.log_change(client_name, ", ".join(f"{name} = {value:g}" for name, value in values.items()))
    return {"applied": tick, "parameters": describe_parameters(session)}


def _execute_pace(session: LiveSession, client_name: str, fields: Fields) -> Fields:
    if session.bench.has_own_clock:
        raise InputError(
            "time: a board runs at its own speed, which cannot be changed",
            code="time-goes-by-itself",
            key="time",
        )
    if "speed" in fields:
        speed = read_finite_number(fields, "speed")
        session.pacer.set_speed(speed)
        session.log_change(client_name, f"speed {speed:g} times real time")
    if fields.get("paused") is True:
        session.pacer.pause()
        session.log_change(client_name, "time paused")
    elif fields.get("paused") is False:
        session.pacer.resume()
        session.log_change(client_name, "time goes on")
    if "steps" in fields:
        steps = read_finite_number(fields, "steps")
        if not 1 <= steps <= session.bench.rate:
            raise InputError(
                f"steps: is not within 1 to {session.bench.rate:g}", code="out-of-range", key="steps"
            )
        session.pacer.step(int(steps))
    return {}


def _execute_record(session: LiveSession, client_name: str, fields: Fields) -> Fields:
    tick, name = session.bench.tick, fields.get("file")
    if name is None:
        session.recorder.stop(tick)
        return {}
    level_crossing = None
    if "signal" in fields:
        level_crossing = session.recorder.make_level_crossing(
            str(fields["signal"]), read_finite_number(fields, "level"), fields.get("rising") is not False
        )
    duration = read_finite_number(fields, "lasts") if fields.get("lasts") is not None else math.inf
    session.record(str(name), RecordingSpan(read_finite_number(fields, "before"), duration, level_crossing))
    session.log_change(client_name, f"record {name}")
    return {}


_MAX_FOUND_VARIABLES = 200
"""Maximum number of variables in the answer to a search."""


def _find_variables(session: LiveSession, client_name: str, fields: Fields) -> Fields:
    return {"found": session.bench.search(str(fields.get("text", ""))[:200], _MAX_FOUND_VARIABLES)}


def _execute_choose(session: LiveSession, client_name: str, fields: Fields) -> Fields:
    """Choose the signals and the parameters of a bench that offers more than it shows."""
    names = {key: fields.get(key) for key in ("signals", "parameters")}
    for key, value in names.items():
        if not isinstance(value, list) or not all(isinstance(name, str) for name in value):
            raise InputError(f"{key}: names none", code="missing", key=key)
    event = None if fields.get("event") is None else int(read_finite_number(fields, "event"))
    session.choose(names["signals"], names["parameters"], event)  # type: ignore[arg-type]
    session.log_change(client_name, f"chose {len(session.bench.signals)} signals")
    return {}


def _execute_learn(session: LiveSession, client_name: str, fields: Fields) -> Fields:
    """Start or stop the calibration from the motion, or discard the estimates."""
    learner = session.learner
    if learner is None:
        raise InputError(
            "learn: a stage or a bearing alone learns from its motion", code="not-for-this-kind", key="learn"
        )
    if fields.get("revert") is True:
        applied = learner.revert()
        session.log_change(client_name, "the estimates are deleted")
        return {"applied": applied}
    learner.switch(fields.get("on") is True)
    session.log_change(client_name, "learns from its motion" if learner.is_on else "learns no more")
    return {}


def _execute_response(session: LiveSession, client_name: str, fields: Fields) -> Fields:
    """Measure the frequency response, or cancel the measurement."""
    if fields.get("cancel") is True:
        session.meter.cancel()
        session.log_change(client_name, "measurement of the frequency response cancelled")
        return {}
    if reason := session.response_refusal:
        raise InputError(f"response: {reason}", code="not-held", key="response")
    motion = read_finite_number(fields, "motion")
    session.generate(None)
    session.meter.measure(motion, lambda: SessionSeat(session))
    session.log_change(client_name, f"frequency response with a motion up to {1e6 * motion:g} um")
    return {}


def _execute_derive(session: LiveSession, client_name: str, fields: Fields) -> Fields:
    """Define a derived signal, or delete it if its expression is missing."""
    name, expression = str(fields.get("name")), fields.get("expression")
    if expression is None:
        session.derived.delete(name)
        session.log_change(client_name, f"derived signal {name} deleted")
    else:
        session.derived.define(DerivedSignal(name, str(fields.get("unit") or ""), str(expression)))
        session.log_change(client_name, f"derived signal {name} = {expression}")
    return {}


def _save_set(session: LiveSession, client_name: str, fields: Fields) -> Fields:
    name = str(fields.get("name"))
    session.sets.save(name, session.parameters)
    session.log_change(client_name, f"saved the active values as {name}")
    return {"file": f"{name}{FILE_SUFFIX}"}


def _read_set(session: LiveSession, client_name: str, fields: Fields) -> Fields:
    saved_values = session.sets.read(str(fields.get("name")))
    return {"parameters": saved_values, "differing": changed_values(session.parameters, saved_values)}


ORDERS_BESIDE_BENCH: Mapping[str, OrderAction] = {
    "save set": _save_set,
    "read set": _read_set,
    "find": _find_variables,
}
"""Orders that do not access the controller. The bench does not wait for them."""

_ORDER_ACTIONS: Mapping[str, OrderAction] = {
    "command": _execute_command,
    "target": _execute_target,
    "load": _execute_load,
    "generator": _execute_generator,
    "apply": _execute_apply,
    "pace": _execute_pace,
    "record": _execute_record,
    "choose": _execute_choose,
    "improve": perform_improvement_step,
    "learn": _execute_learn,
    "response": _execute_response,
    "derive": _execute_derive,
}


def describe_parameters(session: LiveSession) -> list[dict[str, Any]]:
    """Return the descriptions of the parameters for a page, with the first known value of each."""
    return [{**one._asdict(), "first": session.first_values[one.name]} for one in session.parameters]
