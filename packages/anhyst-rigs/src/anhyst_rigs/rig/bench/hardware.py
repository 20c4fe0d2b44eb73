"""Connect a bench to a controller on a board, or to other firmware with its own clock.

The bench reads and commands the controller over a line. If the controller stops responding, the
bench searches for it and reconnects.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Generic, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst.support.states import Command, Fault, State
from anhyst_rigs.link.frames import Body
from anhyst_rigs.link.xcp import XcpLine, XcpMaster
from anhyst_rigs.rig.bench.contact import (
    ControllerContact,
    OpenLineFunction,
    OtherFirmware,
    active_block_checksum,
    open_contact,
)
from anhyst_rigs.rig.bench.force import check_demand
from anhyst_rigs.rig.bench.protocol import BEARING_COMMANDS, FORCE_COMMANDS, Bench, Parameter
from anhyst_rigs.rig.bench.settings import check_values

_HEARTBEAT_PERIOD_S = 0.02
"""Time between two heartbeats, s. A controller waits 0.1 s for the next heartbeat."""
SEARCH_TIME_S = 600.0
"""Longest search for a controller that stopped responding, s."""
_MAX_TICK_TIME_TO_ELAPSED = 1.01
_MIN_TICK_TIME_TO_ELAPSED = 0.9
_TICK_TIME_MARGIN_S = 1.0
"""Margin of the test whether a controller has continued to count ticks, s.

It has continued if the duration of its ticks lies, within this margin, between the elapsed time
times _MIN_TICK_TIME_TO_ELAPSED and times _MAX_TICK_TIME_TO_ELAPSED. Otherwise, it was restarted.
"""
_TICK_MODULUS = 1 << 32
"""Number of ticks after which the tick counter of a controller starts again at 0."""


class HardwareBench(Bench):
    """A controller with its own clock, which is read and commanded over a line.

    The caller of :meth:`advance` is the operator of the controller. Without these calls there is no
    heartbeat, and the controller enters its safe state. While the bench searches for a lost
    controller, :meth:`advance` returns no rows. After reconnecting, the bench only reads the
    settings; it sends neither commands nor settings.
    """

    has_own_clock = True
    tick = 0

    def __init__(
        self, open_line: OpenLineFunction, manifest: Mapping[str, Any], search_time: float = SEARCH_TIME_S
    ) -> None:
        self.rate = float(manifest["rate_Hz"])
        self._open_line, self._manifest, self._search_time = open_line, manifest, search_time
        self._search: ControllerSearch[ControllerContact] | None = None
        self._messages: list[str] = []
        self._last_heartbeat = 0.0
        self._max_wait_ticks = max(1, int(_HEARTBEAT_PERIOD_S * self.rate))
        contact = open_contact(open_line, manifest)
        self.ticks_per_row = contact.line.tick_interval
        self.signals = contact.columns.signals
        self._is_force_controller = contact.line.body is Body.FORCE
        self.commands = FORCE_COMMANDS if self._is_force_controller else BEARING_COMMANDS
        self.tick = int(contact.rows[0, 0]) - self.ticks_per_row
        self._first_rows: NDArray[np.int64] = contact.rows
        self._adopt_contact(contact, 0)

    def advance(self, ticks: int) -> FloatArray:
        """Wait for some ticks and return all new rows; return none while the controller is lost."""
        if self._search is not None:
            contact = self._search.wait(ticks / self.rate)
            if contact is None:
                return self._columns.values(np.empty((0, 1 + len(self._sources)), dtype=np.int64))
            self._resume_rows(contact)
        row_blocks, end_tick = [self._new_rows(self._first_rows)], self.tick + ticks
        self._first_rows = self._first_rows[:0]
        try:
            while self.tick < end_tick:
                present_time = time.monotonic()
                if present_time - self._last_heartbeat > _HEARTBEAT_PERIOD_S:
                    self._line.send_heartbeat()
                    self._last_heartbeat = present_time
                wait_tick = max(
                    self.tick + self.ticks_per_row, min(end_tick, self.tick + self._max_wait_ticks)
                )
                row_blocks.append(self._new_rows(self._line.take_samples(wait_tick - self._offset)))
        except InputError as error:
            self._start_search(error)
        signal_codes = np.concatenate(row_blocks)
        if len(signal_codes):
            self._state = State(int(signal_codes[-1, 1 + self._sources.index("state")]))
        return self._columns.values(signal_codes)

    def _new_rows(self, signal_codes: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the rows after the last one, numbered by the ticks of the bench."""
        signal_codes = signal_codes + np.eye(1, signal_codes.shape[1], dtype=np.int64) * self._offset
        signal_codes = signal_codes[signal_codes[:, 0] > self.tick]
        if len(signal_codes):
            self.tick, self._last_row_time = int(signal_codes[-1, 0]), time.monotonic()
        return signal_codes

    def _adopt_contact(self, contact: ControllerContact, offset: int) -> None:
        """Use a contact; the bench adds `offset` to its tick numbers."""
        self._contact, self._line, self._offset = contact, contact.line, offset
        self._columns, self._settings = contact.columns, contact.settings
        self._sources = contact.line.signals
        self._first_rows = contact.rows
        self._block, self._state = contact.block, contact.state
        self._last_row_time = contact.contact_time
        self.demand_range = contact.columns.demand_range(contact.demand_code)

    def _start_search(self, error: InputError) -> None:
        """Search for a controller that no longer responds."""
        earlier_contact = self._contact
        self.loss_reason = str(error)
        self._messages.append(f"lost: {error}; searching for at most {self._search_time / 60.0:g} min")
        self._search = ControllerSearch(
            lambda: open_contact(self._open_line, self._manifest, earlier_contact),
            earlier_contact.line.close,
            self._search_time,
        )

    def _resume_rows(self, contact: ControllerContact) -> None:
        """Continue with a controller that responds again, and add a message about its state."""
        newest_tick = int(contact.rows[-1, 0])
        lost_time = contact.contact_time - self._last_row_time
        counted_ticks = (newest_tick - (self.tick - self._offset)) % _TICK_MODULUS
        counted_time = counted_ticks / self.rate
        has_continued = (
            _MIN_TICK_TIME_TO_ELAPSED * lost_time - _TICK_TIME_MARGIN_S
            <= counted_time
            <= _MAX_TICK_TIME_TO_ELAPSED * lost_time + _TICK_TIME_MARGIN_S
        )
        passed_ticks = counted_ticks if has_continued else max(1, round(lost_time * self.rate))
        ticks = (
            "its tick counter continued"
            if has_continued
            else f"it was restarted and is at its tick {newest_tick}"
        )
        message_parts = [f"back after {lost_time:.1f} s, {_state_text(contact)}", ticks]
        if contact.block != self._block:
            message_parts.append("the active parameter block has changed")
        old_values = {parameter.name: parameter.value for parameter in self.parameters()}
        self._search, self.loss_reason = None, ""
        self._adopt_contact(contact, self.tick + passed_ticks - newest_tick)
        message_parts += [
            f"{parameter.name} changed from {old_values[parameter.name]:g} to {parameter.value:g}"
            for parameter in self.parameters()
            if parameter.value != old_values[parameter.name]
        ]
        self._messages.append("; ".join(message_parts))

    def take_messages(self) -> Sequence[str]:
        """Return messages about lost and restored connections since the last call."""
        messages, self._messages = self._messages, []
        return messages

    def _connected_line(self) -> XcpMaster:
        if self._search is not None:
            raise InputError(f"{self.loss_reason}; searching for it, wait until it is back", code="port-gone")
        return self._line

    def command(self, command: Command) -> None:
        """Send a command."""
        self._state = self._connected_line().command(command)

    def demand(self, value: float) -> None:
        """Demand a force, N, or a gap, m."""
        line = self._connected_line()
        if self._is_force_controller:
            check_demand(self.demand_range, value, self._state)
        line.write_demand(self._columns.demand_code(value))

    def load(self, force: float) -> None:
        """Raise an InputError: this bench has no load drive."""
        del force
        raise InputError("load: the bench of a board has no load drive", code="no-load-drive", key="load")

    def parameters(self) -> tuple[Parameter, ...]:
        """Return the settings of the controller."""
        return self._settings.parameters()

    def apply(self, values: Mapping[str, float]) -> int:
        """Write settings one after the other; return the first tick at which all are active."""
        self._connected_line()
        check_values(values, self.parameters())
        self._settings.write(values, self._state is State.RUN)
        return self._next_tick()

    def read_block(self) -> list[int]:
        """Return the active parameter block."""
        return self._connected_line().read_block()

    def swap_block(self, block_words: Sequence[int]) -> int:
        """Activate another parameter block; return the first tick that certainly uses it."""
        line = self._connected_line()
        line.swap_block(block_words)
        self._block = active_block_checksum(line)
        return self._next_tick()

    def _next_tick(self) -> int:
        passed_ticks = (self._line.read_clock() + self._offset - self.tick) % _TICK_MODULUS
        return self.tick + passed_ticks + 1

    def close(self) -> None:
        """Close the line. A controller that drives a current then enters its safe state by itself."""
        if self._search is not None:
            self._search.close()
        else:
            self._line.close()


def _state_text(contact: ControllerContact) -> str:
    """Return the state of a controller in words."""
    state = f"in the state {contact.state.name.lower()}"
    if contact.fault is Fault.NONE:
        return state
    return f"{state} ({contact.fault.name.lower().replace('_', ' ')})"


_FIRST_PAUSE_S = 0.1
_PAUSE_GROWTH = 1.5
_MAX_PAUSE_S = 2.0
"""Longest pause between two attempts; the pauses grow by the factor _PAUSE_GROWTH up to this."""
_JOIN_TIME_S = 1.0
"""Time for which :meth:`ControllerSearch.close` waits for an attempt in progress, s."""


class HasLine(Protocol):
    """A contact with a controller over a line."""

    @property
    def line(self) -> XcpMaster | XcpLine:
        """The line, which can be closed."""


_Contact = TypeVar("_Contact", bound=HasLine)


class ControllerSearch(Generic[_Contact]):
    """Search for a controller in a thread for a limited time, with growing pauses in between."""

    def __init__(
        self, find_contact: Callable[[], _Contact], close_line: Callable[[], None], search_time: float
    ) -> None:
        self._find_contact = find_contact
        self._close_line = close_line
        self._end = time.monotonic() + search_time
        self._found: _Contact | None = None
        self._failure: InputError | None = None
        self._cancelled, self._finished = threading.Event(), threading.Event()
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._run, name="search", daemon=True)
        self._thread.start()

    def wait(self, seconds: float) -> _Contact | None:
        """Wait for at most a time, s; return the contact, or None if the search has found none."""
        self._finished.wait(seconds)
        if self._failure is not None:
            raise self._failure
        return self._found

    def close(self) -> None:
        """End the search, and close every line that the search has opened or is opening."""
        with self._lock:
            self._cancelled.set()
            contact, self._found = self._found, None
        if contact is not None:
            contact.line.close()
        self._thread.join(_JOIN_TIME_S)

    def _run(self) -> None:
        self._close_line()
        pause = _FIRST_PAUSE_S
        while not self._cancelled.wait(pause):
            pause = min(_PAUSE_GROWTH * pause, _MAX_PAUSE_S)
            try:
                contact = self._find_contact()
            except OtherFirmware as other:
                self._failure = other
            except InputError as error:
                if time.monotonic() > self._end:
                    self._failure = error
            else:
                self._store_contact(contact)
            if self._found is not None or self._failure is not None:
                self._finished.set()
                return

    def _store_contact(self, contact: _Contact) -> None:
        """Store the contact, or close its line if the search was cancelled."""
        with self._lock:
            is_wanted = not self._cancelled.is_set()
            if is_wanted:
                self._found = contact
        if not is_wanted:
            contact.line.close()
