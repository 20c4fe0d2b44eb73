"""Looking for a controller that was lost, beside the bench."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from anhyst.rig.bench.contact import Contact, OtherFirmware
from anhyst.support.errors import InputError

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
