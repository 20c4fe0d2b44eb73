"""The box through which the host and a target talk; numbers as in ``harness/harness.h``."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Words = NDArray[np.uint32]

CHECKPOINTS = 64
WINDOW = 48

START, RANDOM, VECTORS, STACK = range(4)
AS_SOLVED, AS_GIVEN = range(2)

RECORD = (
    "demand",
    "gap",
    "how",
    "current",
    "flags",
    "flux",
    "applied",
    "applied gap",
    "output",
    "applied flux",
    "memory a",
    "memory b",
    "memory c",
    "memory d",
    "memory e",
    "pidd2",
    "pidd2 integral",
    "pidd2 velocity",
)
INPUTS = ("demand", "gap", "how", "applied", "applied gap")
INPUT_PLACES = [RECORD.index(name) for name in INPUTS]
SECTIONS = ("clock", "solve", "commit, solved", "commit, other", "pidd2", "tick")

_REQUEST = 6
_REPLY = 8
_SECTION_WORDS = 6
_SECTIONS_AT = _REQUEST + _REPLY
_CHECKPOINTS_AT = _SECTIONS_AT + _SECTION_WORDS * len(SECTIONS)
_WINDOW_AT = _CHECKPOINTS_AT + CHECKPOINTS
BOX_WORDS = _WINDOW_AT + WINDOW * len(RECORD)
BOX_BYTES = 4 * BOX_WORDS


@dataclass(frozen=True, slots=True)
class Request:
    """What a target is to do next.

    Parameters
    ----------
    mode : int
        START, RANDOM, VECTORS or STACK.
    steps : int
        How many; at most WINDOW for VECTORS.
    seed : int
        Of the generator, for START; not 0.
    checkpoint_first, checkpoint_stride : int
        The hash is kept before this step and every so many steps after it, CHECKPOINTS times.
    window_first : int
        Records are kept from this step on, WINDOW of them.
    rows : array of uint32, shape (steps, len(INPUTS)), or None
        Inputs, for VECTORS.
    """

    mode: int
    steps: int = 0
    seed: int = 1
    checkpoint_first: int = 0
    checkpoint_stride: int = 1
    window_first: int = 0
    rows: Words | None = None

    def pack(self) -> bytes:
        """Lay the request out as the target reads it: the words from the start of the box."""
        head = (
            self.mode,
            self.seed,
            self.steps,
            self.checkpoint_first,
            self.checkpoint_stride,
            self.window_first,
        )
        return np.array(head, dtype="<u4").tobytes()

    def pack_rows(self) -> bytes:
        """Lay the inputs out as the target reads them: the words from WINDOW_OFFSET on."""
        window = np.zeros((WINDOW, len(RECORD)), dtype="<u4")
        if self.rows is not None:
            window[: len(self.rows), INPUT_PLACES] = self.rows
        return window.tobytes()


REQUEST_BYTES = 4 * _REQUEST
WINDOW_OFFSET = 4 * _WINDOW_AT


@dataclass(frozen=True, slots=True)
class Section:
    """Instructions or cycles of one part of the step, those of the clock itself included."""

    count: int
    least: int
    most: int
    most_at: int
    total: int


@dataclass(frozen=True, slots=True)
class Reply:
    """What a target found in the box after it was done."""

    status: int
    state_bytes: int
    control_bytes: int
    words: int
    stack_bytes: int
    step: int
    hash: int
    sections: tuple[Section, ...]
    checkpoints: Words
    window: Words

    @classmethod
    def unpack(cls, box: bytes) -> Reply:
        """Read a box.

        Raises
        ------
        ValueError
            The target lays the box out otherwise.
        """
        words = np.frombuffer(box, dtype="<u4")
        if len(words) != BOX_WORDS or words[_REQUEST] != BOX_WORDS:
            raise ValueError("the target lays the box out otherwise")
        _, status, *numbers = (int(word) for word in words[_REQUEST:_SECTIONS_AT])
        table = words[_SECTIONS_AT:_CHECKPOINTS_AT].reshape(len(SECTIONS), _SECTION_WORDS)
        sections = tuple(
            Section(count, least, most, most_at, low + (high << 32))
            for count, least, most, most_at, low, high in table.tolist()
        )
        state, control, block, stack, step, folded = numbers
        return cls(
            status - (1 << 32) if status >> 31 else status,
            state,
            control,
            block,
            stack,
            step,
            folded,
            sections,
            checkpoints=words[_CHECKPOINTS_AT:_WINDOW_AT],
            window=words[_WINDOW_AT:].reshape(WINDOW, len(RECORD)),
        )
