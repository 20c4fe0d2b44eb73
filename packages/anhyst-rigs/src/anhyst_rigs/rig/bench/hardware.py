"""The bench of a controller on a board, or of any firmware that keeps its own time; lost, it is looked for."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst.support.states import Command, Fault, State
from anhyst_rigs.link.frames import Body
from anhyst_rigs.link.xcp import XcpMaster
from anhyst_rigs.rig.bench.contact import (
    Contact,
    OtherFirmware,
    Reach,
    block_in_force,
    open_contact,
)
from anhyst_rigs.rig.bench.force import check_demand
from anhyst_rigs.rig.bench.protocol import BEARING_COMMANDS, FORCE_COMMANDS, Bench, Parameter
from anhyst_rigs.rig.bench.settings import check_values

_BEAT_S = 0.02
"""Between two signs of life to a controller, s; it waits for 0.1 s."""
PATIENCE_S = 600.0
"""How long a controller that was lost is looked for, s."""
_FAST, _SLOW, _SPARE_S = 1.01, 0.9, 1.0
"""A clock that went on has counted as many ticks as passed here, within these shares and so many
seconds; one that began anew has not."""
_ROUND = 1 << 32
"""Ticks after which a controller's count begins again."""


class HardwareBench(Bench):
    """A controller that runs by itself, seen and operated over a line.

    It keeps time. The controller's operator is whoever
    calls :meth:`advance`: without it there is no sign of life, and the controller goes to its safe
    state by itself. One that is lost is looked for, and no row comes meanwhile; when it is back,
    nothing is commanded or set: its settings are read anew.
    """

    keeps_time = True
    tick = 0

    def __init__(
        self, reach: Reach, manifest: Mapping[str, Any], patience: float = PATIENCE_S
    ) -> None:
        self.rate = float(manifest["rate_Hz"])
        self._reach, self._manifest, self._patience = reach, manifest, patience
        self._search: Search | None = None
        self._news: list[str] = []
        self._beaten = 0.0
        self._stretch = max(1, int(_BEAT_S * self.rate))
        contact = open_contact(reach, manifest)
        self.every = contact.line.every
        self.signals = contact.columns.signals
        self._force = contact.line.body is Body.FORCE
        self.commands = FORCE_COMMANDS if self._force else BEARING_COMMANDS
        self.tick = int(contact.rows[0, 0]) - self.every
        self._first: NDArray[np.int64] = contact.rows
        self._take_up(contact, 0)

    def advance(self, ticks: int) -> FloatArray:
        """Wait until some ticks have passed, and return all that came since; none while lost."""
        if self._search is not None:
            found = self._search.wait(ticks / self.rate)
            if found is None:
                return self._columns.values(np.empty((0, 1 + len(self._sources)), dtype=np.int64))
            self._return(found)
        parts, end = [self._counted(self._first)], self.tick + ticks
        self._first = self._first[:0]
        try:
            while self.tick < end:
                now = time.monotonic()
                if now - self._beaten > _BEAT_S:
                    self._line.beat()
                    self._beaten = now
                until = max(self.tick + self.every, min(end, self.tick + self._stretch))
                parts.append(self._counted(self._line.take(until - self._offset)))
        except InputError as error:
            self._lose(error)
        codes = np.concatenate(parts)
        if len(codes):
            self._state = State(int(codes[-1, 1 + self._sources.index("state")]))
        return self._columns.values(codes)

    def _counted(self, codes: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return rows with ticks as the bench counts them, behind those that came before."""
        codes = codes + np.eye(1, codes.shape[1], dtype=np.int64) * self._offset
        codes = codes[codes[:, 0] > self.tick]
        if len(codes):
            self.tick, self._seen = int(codes[-1, 0]), time.monotonic()
        return codes

    def _take_up(self, contact: Contact, offset: int) -> None:
        """Go on with a contact; `offset` leads from its ticks to those of the bench."""
        self._contact, self._line, self._offset = contact, contact.line, offset
        self._columns, self._settings = contact.columns, contact.settings
        self._sources = contact.line.signals
        self._first = contact.rows
        self._block, self._state = contact.block, contact.state
        self._seen = contact.at
        self.aim = contact.columns.aim(contact.goal)

    def _lose(self, error: InputError) -> None:
        """Look for a controller that does not answer any more."""
        before = self._contact
        self.lost = str(error)
        self._news.append(
            f"lost: {error}; it is looked for, for {self._patience / 60.0:g} min at most"
        )
        self._search = Search(
            lambda: open_contact(self._reach, self._manifest, before),
            before.line.close,
            self._patience,
        )

    def _return(self, found: Contact) -> None:
        """Go on with a controller that was lost, and say how it is."""
        newest = int(found.rows[-1, 0])
        away = found.at - self._seen
        ahead = (newest - (self.tick - self._offset)) % _ROUND
        counted = ahead / self.rate
        goes_on = _SLOW * away - _SPARE_S <= counted <= _FAST * away + _SPARE_S
        passed = ahead if goes_on else max(1, round(away * self.rate))
        ticks = "its ticks went on" if goes_on else f"it began anew and is at its tick {newest}"
        parts = [f"back after {away:.1f} s, {_standing(found)}", ticks]
        if found.block != self._block:
            parts.append("another parameter block is in force than before")
        before = {one.name: one.value for one in self.parameters()}
        self._search, self.lost = None, ""
        self._take_up(found, self.tick + passed - newest)
        parts += [
            f"{one.name} is {one.value:g} and was {before[one.name]:g}"
            for one in self.parameters()
            if one.value != before[one.name]
        ]
        self._news.append("; ".join(parts))

    def news(self) -> Sequence[str]:
        """Return what happened to the controller since this was last asked."""
        news, self._news = self._news, []
        return news

    def _reached(self) -> XcpMaster:
        if self._search is not None:
            raise InputError(
                f"{self.lost}; it is looked for, wait until it is back", code="port-gone"
            )
        return self._line

    def command(self, command: Command) -> None:
        """Give a command."""
        self._state = self._reached().command(command)

    def demand(self, value: float) -> None:
        """Demand a force, N, or a gap, m."""
        line = self._reached()
        if self._force:
            check_demand(self.aim, value, self._state)
        line.aim(self._columns.code(value))

    def load(self, force: float) -> None:
        """Refuse: nothing of the load is known here."""
        del force
        raise InputError(
            "load: the bench of a board has no load drive", code="no-load-drive", key="load"
        )

    def parameters(self) -> tuple[Parameter, ...]:
        """Return the settings of the controller."""
        return self._settings.parameters()

    def apply(self, values: Mapping[str, float]) -> int:
        """Write settings one after the other; returns the first tick with all of them in force."""
        self._reached()
        check_values(values, self.parameters())
        self._settings.write(values, self._state is State.RUN)
        return self._next_tick()

    def read_block(self) -> list[int]:
        """Return the parameter block in force."""
        return self._reached().read_block()

    def swap_block(self, words: Sequence[int]) -> int:
        """Put another parameter block in force; returns the first tick that uses it for certain."""
        line = self._reached()
        line.swap_block(words)
        self._block = block_in_force(line)
        return self._next_tick()

    def _next_tick(self) -> int:
        passed = (self._line.clock() + self._offset - self.tick) % _ROUND
        return self.tick + passed + 1

    def close(self) -> None:
        """Hang up; a controller that drives current goes to its safe state by itself."""
        if self._search is not None:
            self._search.close()
        else:
            self._line.close()


def _standing(found: Contact) -> str:
    """Return the state of a controller in words."""
    state = f"in the state {found.state.name.lower()}"
    if found.fault is Fault.NONE:
        return state
    return f"{state} ({found.fault.name.lower().replace('_', ' ')})"


_FIRST_S, _GROWTH, _LONGEST_S = 0.1, 1.5, 2.0
"""Pauses between two tries: the first, by how much each is longer, and the longest."""
_GO_S = 1.0
"""How long whoever ends a search waits for a try that is under way, s."""


class Search:
    """Tries to get into contact again, with growing pauses, until a time is over."""

    def __init__(
        self, look: Callable[[], Contact], before: Callable[[], None], patience: float
    ) -> None:
        self._look = look
        self._before = before
        self._end = time.monotonic() + patience
        self._found: Contact | None = None
        self._given_up: InputError | None = None
        self._cancelled, self._over = threading.Event(), threading.Event()
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._run, name="search", daemon=True)
        self._thread.start()

    def wait(self, seconds: float) -> Contact | None:
        """Return the contact, or None where there is none after so long."""
        self._over.wait(seconds)
        if self._given_up is not None:
            raise self._given_up
        return self._found

    def close(self) -> None:
        """End it; a line that it opened, or opens meanwhile, is closed."""
        with self._lock:
            self._cancelled.set()
            found, self._found = self._found, None
        if found is not None:
            found.line.close()
        self._thread.join(_GO_S)

    def _run(self) -> None:
        self._before()
        pause = _FIRST_S
        while not self._cancelled.wait(pause):
            pause = min(_GROWTH * pause, _LONGEST_S)
            try:
                found = self._look()
            except OtherFirmware as other:
                self._given_up = other
            except InputError as error:
                if time.monotonic() > self._end:
                    self._given_up = error
            else:
                self._leave(found)
            if self._found is not None or self._given_up is not None:
                self._over.set()
                return

    def _leave(self, found: Contact) -> None:
        """Hand a contact over, unless nobody wants it any more."""
        with self._lock:
            wanted = not self._cancelled.is_set()
            if wanted:
                self._found = found
        if not wanted:
            found.line.close()
