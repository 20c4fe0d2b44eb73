"""Connect a bench to any XCP slave: its signals and parameters come from a description of its memory."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from anhyst.support.errors import InputError
from anhyst.support.kinds import is_elf
from anhyst.support.numeric import FloatArray
from anhyst.support.states import Command
from anhyst_rigs.link.foreign.a2l import read_a2l
from anhyst_rigs.link.foreign.elf import read_elf
from anhyst_rigs.link.foreign.sampling import DaqSampler, Poller, Sampler, choose_event
from anhyst_rigs.link.foreign.slave import CALIBRATION, GET_STATUS, DaqProperties, Slave
from anhyst_rigs.link.foreign.variables import Description, EventChannel, SlaveVariable
from anhyst_rigs.link.wire import BAUD, SERIAL_FRAMING, TCP_FRAMING, Framing, compute_key
from anhyst_rigs.link.xcp import XcpLine
from anhyst_rigs.rig.bench.hardware import SEARCH_TIME_S, ControllerSearch
from anhyst_rigs.rig.bench.protocol import Bench, Catalogue, DemandRange, Parameter, Signal
from anhyst_rigs.rig.bench.settings import check_values

MAX_SIGNALS = 100
MAX_PARAMETERS = 200
"""Maximum number of signals and of parameters that are chosen at the same time."""
_FIRST_SIGNALS = 16
_FIRST_PARAMETERS = 32
"""Number of signals and of parameters that are chosen when the bench is opened."""
_STATUS_PERIOD_S = 1.0
_OPERATOR_PERIOD_S = 0.02
"""Time between two commands to a controller of anhyst, which waits 0.1 s for its operator, s."""
_MAX_WAIT_S = 0.02
_SILENCE_S = 2.0
"""Time without samples, in addition to five periods, after which a slave counts as lost, s."""
_ANSWER_TIMEOUT_S = 2.0
"""Time limit for an answer, s. A command is then repeated after a synchronisation."""
MAX_PACKET_BYTES = 0xFFFF
_NOTE_PERIOD_S = 10.0
"""Shortest time between two messages about lost samples, s."""
_NO_COMMANDS = "this firmware has no {} that anhyst knows; change one of its parameters"


class ForeignBench(Bench):
    """An XCP slave whose variables are known from an A2L or an ELF file.

    The bench samples only the chosen signals, and offers only the chosen parameters. It has no
    commands and no target. The attribute `catalogue` describes what can be chosen.
    """

    has_own_clock = True
    tick = 0
    commands = ()

    def __init__(
        self, open_slave: Callable[[], Slave], description: Description, search_time: float = SEARCH_TIME_S
    ) -> None:
        self.description, self._open_slave, self._search_time = description, open_slave, search_time
        self._search: ControllerSearch[Slave] | None = None
        self._messages = [text for text in (description.describe_omitted(),) if text]
        self._begin_time = self._last_row_time = self._last_status_time = time.monotonic()
        self._last_note_time = 0.0
        self._event_number: int | None = None
        self._slave = open_slave()
        try:
            self._read_properties()
            self._choose_first()
        except BaseException:
            self._slave.close()
            raise

    def _read_properties(self) -> None:
        """Read what the slave can sample."""
        slave, description = self._slave, self.description
        if description.is_big_endian is not None and description.is_big_endian != (slave.order == ">"):
            self._messages.append(f"{description.source} and the slave state different byte orders")
        self._daq: DaqProperties | None = slave.read_daq_properties()
        self._events: Sequence[EventChannel] = ()
        if self._daq is not None:
            self._events = description.events or slave.read_events(self._daq.event_count)
            self._events = self._events or (EventChannel(0, "event 0", 0.0),)

    def _choose_first(self) -> None:
        """Choose the first signals of the description that can be sampled together."""
        variables = list(self.description.variables.values())
        signals = [self.description.variables[name] for name in self.description.measurements] or variables
        parameters = [one.name for one in variables if one.is_writable and self.description.lists_parameters]
        self._parameters: dict[str, Parameter] = {}
        failure: InputError | None = None
        events: list[EventChannel | None] = [*sorted(self._events, key=lambda one: one.period_s or math.inf)]
        for event in events or [None]:
            sampled = [v.name for v in signals if event is None or not v.events or event.number in v.events]
            for count in (_FIRST_SIGNALS, 4, 1) if sampled else ():
                try:
                    self._start(sampled[:count], None if event is None else event.number)
                except InputError as error:
                    failure = failure or error
                    if error.code == "no-tick":
                        break
                else:
                    self._set_parameters(self._read_parameters(parameters[:_FIRST_PARAMETERS]))
                    return
        raise failure or InputError(f"{self._slave.url}: no signal can be sampled", code="no-tick")

    @property
    def catalogue(self) -> Catalogue:  # type: ignore[override]
        """What can be chosen, and how the chosen signals are sampled."""
        return Catalogue(
            self.description.source,
            len(self.description.variables),
            tuple(event._asdict() for event in self._events),
            self._event_number,
            self._sampler.doc,
            MAX_SIGNALS,
            MAX_PARAMETERS,
        )

    def search(self, text: str, max_count: int) -> list[Mapping[str, object]]:
        """Return descriptions of variables whose names contain all words of a text."""
        return [
            {"name": one.name, "unit": one.unit, "doc": one.doc, "writable": one.is_writable}
            for one in self.description.search(text, max_count)
        ]

    def choose(self, signals: Sequence[str], parameters: Sequence[str], event: int | None) -> None:
        """Sample other signals, and offer other parameters. If that fails, the old choice remains."""
        for kind, names, maximum in (
            ("signals", signals, MAX_SIGNALS),
            ("parameters", parameters, MAX_PARAMETERS),
        ):
            if not (kind == "parameters" or names) or len(names) > maximum or len(set(names)) < len(names):
                text = f"{kind}: choose from {int(kind == 'signals')} to {maximum} different names"
                raise InputError(text, code="out-of-range", key=kind)
        slave = self._connected_slave()
        new_parameters = self._read_parameters(parameters)
        old_names, old_event = [signal.name for signal in self.signals], self._event_number
        self._sampler.stop()
        try:
            self._start(signals, event)
        except InputError:
            self._slave = slave
            self._start(old_names, old_event)
            raise
        self._set_parameters(new_parameters)

    def _start(self, names: Sequence[str], event_number: int | None) -> None:
        """Start to sample some signals; the tick numbers continue from the time since the start."""
        variables = [self.description.find(name) for name in names]
        self._check_sizes(variables)
        sampler: Sampler
        event = None
        if self._daq is None:
            sampler = Poller(self._slave, variables)
        else:
            event = choose_event(self._events, variables, event_number)
            sampler = DaqSampler(self._slave, self._daq, variables, event)
        self._sampler, self._event_number = sampler, None if event is None else event.number
        self.rate, self.ticks_per_row = sampler.rate, sampler.ticks_per_row
        self.signals = tuple(Signal(one.name, one.unit, one.doc) for one in variables)
        first = self.signals[0]  # The page shows its steps; there is no demand.
        self.demand_range = DemandRange(first.name, first.name, first.unit, 0.0, 0.0, 0.0)
        elapsed_ticks = int((time.monotonic() - self._begin_time) * self.rate)
        self._first_tick = self.tick = max(1, elapsed_ticks)
        self._last_row_time = time.monotonic()

    def _check_sizes(self, variables: Sequence[SlaveVariable]) -> None:
        granularity = self._slave.granularity
        for variable in variables:
            if variable.size % granularity:
                raise InputError(
                    f"{variable.name}: has {variable.size} bytes, and the slave addresses {granularity} bytes; "
                    "choose a larger variable",
                    code="xcp-granularity",
                    key=variable.name,
                )

    def advance(self, ticks: int) -> FloatArray:
        """Return the rows of the next ticks; return none if there are none yet, or the slave is lost."""
        empty = np.empty((0, 1 + len(self.signals)))
        if self._search is not None:
            slave = self._search.wait(_MAX_WAIT_S)
            if slave is None:
                return empty
            self._resume(slave)
        del ticks  # A row is passed on as soon as it arrives.
        try:
            self._send_heartbeat()
            rows = self._sampler.read_rows(_MAX_WAIT_S)
            silence_s = time.monotonic() - self._last_row_time
            if not len(rows) and silence_s > _SILENCE_S + 5.0 * self.ticks_per_row / self.rate:
                text = f"{self._slave.url}: no sample arrived for {silence_s:.1f} s; the slave does not run"
                raise InputError(text, code="no-tick")
        except InputError as error:
            self._start_search(error)
            return empty
        if len(rows):
            rows[:, 0] += self._first_tick
            self.tick, self._last_row_time = int(rows[-1, 0]), time.monotonic()
        if time.monotonic() - self._last_note_time > _NOTE_PERIOD_S and (notes := self._sampler.take_notes()):
            self._messages += notes
            self._last_note_time = time.monotonic()
        return rows

    def _send_heartbeat(self) -> None:
        """Send a command at regular times: it shows that both sides are present."""
        period_s = _OPERATOR_PERIOD_S if self.description.has_known_key else _STATUS_PERIOD_S
        if time.monotonic() - self._last_status_time > period_s:
            self._slave.request(bytes((GET_STATUS,)), "get the status")
            self._last_status_time = time.monotonic()

    def _start_search(self, error: InputError) -> None:
        self.loss_reason = str(error)
        self._messages.append(f"lost: {error}; searching for at most {self._search_time / 60.0:g} min")
        self._search = ControllerSearch(self._open_slave, self._slave.line.close, self._search_time)

    def _resume(self, slave: Slave) -> None:
        """Continue with a slave that responds again; nothing is written to it."""
        lost_s = time.monotonic() - self._last_row_time
        self._slave, self._search, self.loss_reason = slave, None, ""
        old_values = {parameter.name: parameter.value for parameter in self._parameters.values()}
        try:
            self._start([signal.name for signal in self.signals], self._event_number)
            self._set_parameters(self._read_parameters(tuple(old_values)))
        except InputError as error:
            self._start_search(error)
            return
        changes = [
            f"{parameter.name} changed from {old_values[parameter.name]:g} to {parameter.value:g}"
            for parameter in self._parameters.values()
            if parameter.value != old_values[parameter.name]
        ]
        self._messages.append("; ".join([f"back after {lost_s:.1f} s", *changes]))

    def take_messages(self) -> Sequence[str]:
        """Return messages about omitted quantities, lost samples and lost connections."""
        messages, self._messages = self._messages, []
        return messages

    def _connected_slave(self) -> Slave:
        if self._search is not None:
            raise InputError(f"{self.loss_reason}; searching for it, wait until it is back", code="port-gone")
        return self._slave

    def command(self, command: Command) -> None:
        """Raise an InputError: the commands of a foreign firmware are not known."""
        name = command.name.lower()
        raise InputError(
            f"{name}: {_NO_COMMANDS.format('command')}, or switch it off", code="unknown-command", key=name
        )

    def demand(self, value: float) -> None:
        """Raise an InputError: the target of a foreign firmware is not known."""
        del value
        raise InputError(f"target: {_NO_COMMANDS.format('target')}", code="unknown-command", key="target")

    def load(self, force: float) -> None:
        """Raise an InputError: this bench has no load drive."""
        del force
        raise InputError("load: the bench of a board has no load drive", code="no-load-drive", key="load")

    def parameters(self) -> tuple[Parameter, ...]:
        """Return the chosen parameters with the values that were last read."""
        return tuple(self._parameters.values())

    def _set_parameters(self, parameters: Sequence[Parameter]) -> None:
        self._parameters = {parameter.name: parameter for parameter in parameters}

    def _read_parameters(self, names: Sequence[str]) -> list[Parameter]:
        variables = [self.description.find(name) for name in names]
        self._check_sizes(variables)
        for variable in variables:
            if not variable.is_writable:
                text = f"{variable.name}: is read-only in {self.description.source}; choose it as a signal"
                raise InputError(text, code="unknown-parameter", key=variable.name)
        return [_parameter(one, one.value_of(self._read(one))) for one in variables]

    def _read(self, variable: SlaveVariable) -> bytes:
        return self._slave.read(variable.address, variable.extension, variable.size, variable.name)

    def apply(self, values: Mapping[str, float]) -> int:
        """Write parameters one after the other, and read each of them again.

        If the slave refuses a value, or keeps another one, the earlier values are written back.
        """
        slave = self._connected_slave()
        check_values(values, self.parameters())
        slave.require_unlocked(CALIBRATION, f"write {', '.join(values)}")
        written: list[tuple[SlaveVariable, bytes]] = []
        try:
            for name, value in values.items():
                variable = self.description.find(name)
                present = self._read(variable)
                wanted = variable.encode(value, present)
                written.append((variable, present))
                slave.write(variable.address, variable.extension, wanted, name)
                self._check_written(variable, wanted)
        except InputError:
            for variable, present in reversed(written[:-1]):
                slave.write(variable.address, variable.extension, present, variable.name)
            self._set_parameters(self._read_parameters(tuple(self._parameters)))
            raise
        self._set_parameters(self._read_parameters(tuple(self._parameters)))
        return self.tick + self.ticks_per_row

    def _check_written(self, variable: SlaveVariable, wanted: bytes) -> None:
        if self.description.has_known_key and variable.name == "command":
            return  # A controller of anhyst executes a command when it is written; it reads as 0.
        found = self._read(variable)
        if variable.value_of(found) != variable.value_of(wanted):
            raise InputError(
                f"{variable.name}: {variable.value_of(wanted):g} was written and the slave holds "
                f"{variable.value_of(found):g}; the slave limits or overwrites this value",
                code="not-kept",
                key=variable.name,
            )

    def close(self) -> None:
        """Stop the sampling and disconnect."""
        if self._search is not None:
            self._search.close()
            return
        self._slave.close()


def _parameter(variable: SlaveVariable, value: float) -> Parameter:
    low, high = variable.limits()
    return Parameter(variable.name, variable.unit, low, high, variable.doc, value)


def open_foreign(path: Path, url: str) -> ForeignBench:
    """Open the bench of an XCP slave whose variables an A2L file or an ELF file describes."""
    description = read_elf(path) if is_elf(path) else read_a2l(path)
    line = description.serial
    is_serial = not url.startswith("socket://")
    framing = SERIAL_FRAMING if is_serial else TCP_FRAMING
    if is_serial and line is not None:
        framing = Framing(line.head, line.checksum_bytes)
    framing = framing._replace(max_packet_bytes=MAX_PACKET_BYTES)
    baud = BAUD if line is None else line.baud
    key = compute_key if description.has_known_key else None

    def open_slave() -> Slave:
        opened = XcpLine(url, _ANSWER_TIMEOUT_S, framing, baud, repeats=True)
        try:
            return Slave(opened, key)
        except BaseException:
            opened.close()
            raise

    return ForeignBench(open_slave, description)
