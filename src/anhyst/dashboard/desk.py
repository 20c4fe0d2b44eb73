"""Who operates: one browser at a time; the others watch, and ask to take over."""

from __future__ import annotations

import time

ASKED_S = 10.0
"""After so long without an answer the desk goes to whoever asked, s."""


class Desk:
    """The one seat from which the bench is operated."""

    def __init__(self) -> None:
        self.operator = 0
        self.asking = 0
        self._asked = 0.0

    def join(self, client: int) -> None:
        """Let a browser come; whoever finds the desk empty sits down."""
        if not self.operator:
            self.operator = client

    def leave(self, client: int) -> None:
        """Let a browser go; whoever asked gets its place."""
        if self.asking == client:
            self.asking = 0
        if self.operator == client:
            self.operator, self.asking = self.asking, 0

    def ask(self, client: int) -> None:
        """Ask to take over; an empty desk is taken at once, and one question waits at a time."""
        if not self.operator:
            self.operator = client
        elif client != self.operator and not self.asking:
            self.asking, self._asked = client, time.monotonic()

    def answer(self, client: int, hand_over: bool) -> None:
        """Let the operator hand over, or stay; nobody else can."""
        if client == self.operator and self.asking:
            self.operator = self.asking if hand_over else self.operator
            self.asking = 0

    def wait(self) -> None:
        """Hand over where the operator has not answered for too long."""
        if self.asking and time.monotonic() - self._asked >= ASKED_S:
            self.operator, self.asking = self.asking, 0
