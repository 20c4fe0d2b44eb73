"""Exchange requests and replies with the test program of a target.

Host and target share a block of memory, the mailbox. The host writes a request into the mailbox,
lets the target run, and reads the reply. The numbers of this module are the same as in
``harness/harness.h``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from anhyst.support.errors import NegativeResult

Words = NDArray[np.uint32]

CHECKPOINT_COUNT = 64
WINDOW_RECORDS = 48

START = 0  # modes of a request
RANDOM = 1
VECTORS = 2
STACK = 3
AS_SOLVED = 0  # the solved current is applied
AS_GIVEN = 1  # the given current is applied
ON_GRID = 2  # the solved current is applied, rounded to the grid of a converter

RECORD_WORDS = 18


@dataclass(frozen=True, slots=True)
class RecordLayout:
    """Names of the words of a record, and of the timed sections; as in ``harness/harness.h``."""

    record: tuple[str, ...]  # names of all words: RECORD_WORDS names, or more for a stage
    inputs: tuple[str, ...]  # names of the inputs
    sections: tuple[str, ...]  # names of the timed sections; empty if a section is not used
    # number of clock starts per count of a section, if it is not 1
    clock_calls: Mapping[str, int]
    start_contents: str  # part of the initialisation that is compared by its hash

    @property
    def word_count(self) -> int:
        """Length of a record in words."""
        return len(self.record)

    @property
    def input_positions(self) -> list[int]:
        """Positions of the inputs in a record."""
        return [self.record.index(name) for name in self.inputs]


COMPENSATOR_RECORD = RecordLayout(
    record=(
        "demand", "gap", "how", "current", "flags", "flux", "applied", "applied gap", "output",
        "applied flux", "memory a", "memory b", "memory c", "memory d", "memory e",
        "pidd2", "pidd2 integral", "pidd2 velocity",
    ),
    inputs=("demand", "gap", "how", "applied", "applied gap"),
    sections=(
        "clock", "solve", "commit, solved", "commit, rounded", "commit, limited", "commit, other",
        "pidd2", "tick, rounded", "tick",
    ),
    # A tick has four parts: solve and commit of PIDD2 and of the compensator.
    clock_calls={"tick, rounded": 4, "tick": 4, "pidd2": 2},
    start_contents="conditioning sequence",
)  # fmt: skip

_CONTROLLER_INPUTS = ("position", "target", "load", "measured current 1", "measured current 2", "event")

CONTROLLER_RECORD = RecordLayout(
    record=(
        *_CONTROLLER_INPUTS,
        *("current 1", "current 2", "reference", "demand", "state", "flags", "fault"),
        *("integral", "velocity", "memory a", "memory b", "memory c"),
    ),
    inputs=_CONTROLLER_INPUTS,
    sections=("clock", "tick, controls", "tick, ramps", "tick, rests", *[""] * 4, "tick"),
    clock_calls={},
    start_contents="limits",
)


def make_stage_record(free: Sequence[str], heads: int, magnets: int) -> RecordLayout:
    """Return the record layout of a stage."""
    inputs = (
        *(f"head {n}" for n in range(1, heads + 1)),
        *(f"forward {axis}" for axis in free),
        *(f"gap {n}" for n in range(1, magnets + 1)),
        *(f"read {n}" for n in range(1, magnets + 1)),
        "command",
    )
    outputs = (
        *(f"current {n}" for n in range(1, magnets + 1)),
        *(f"demand {axis}" for axis in free),
        "flags",
        "lost",
        "state",
    )
    parts = ("clock", "tick, no limit", "tick, at a limit", *[""] * 5, "tick")
    return RecordLayout((*inputs, *outputs), inputs, parts, {}, "sizes")


_REQUEST_WORDS = 6
_REPLY_WORDS = 8
_SECTION_WORDS = 6
SECTION_COUNT = 9
_SECTIONS_AT = _REQUEST_WORDS + _REPLY_WORDS
_CHECKPOINTS_AT = _SECTIONS_AT + _SECTION_WORDS * SECTION_COUNT
_WINDOW_AT = _CHECKPOINTS_AT + CHECKPOINT_COUNT
BOX_WORDS = _WINDOW_AT + WINDOW_RECORDS * RECORD_WORDS
BOX_BYTES = 4 * BOX_WORDS


@dataclass(frozen=True, slots=True)
class Request:
    """Request to a target."""

    mode: int  # START, RANDOM, VECTORS or STACK
    steps: int = 0  # number of steps; at most WINDOW_RECORDS for VECTORS
    seed: int = 1  # seed of the generator, for START; not 0
    # first step before which the hash is stored; then it is stored after every stride
    first_checkpoint_step: int = 0
    checkpoint_stride: int = 1
    first_window_step: int = 0  # first of WINDOW_RECORDS steps whose records are stored
    rows: Words | None = None  # inputs, for VECTORS; shape (steps, n)
    input_positions: Sequence[int] = ()  # positions of the inputs in a record, n of them
    record_words: int = RECORD_WORDS  # length of a record

    @property
    def box_bytes(self) -> int:
        """Size of the mailbox in bytes."""
        return 4 * (_WINDOW_AT + WINDOW_RECORDS * self.record_words)

    def pack(self) -> bytes:
        """Return the request as the target reads it: the words at the start of the mailbox."""
        head_words = [self.mode, self.seed, self.steps]
        head_words += [self.first_checkpoint_step, self.checkpoint_stride, self.first_window_step]
        return np.array(head_words, dtype="<u4").tobytes()

    def pack_rows(self) -> bytes:
        """Return the inputs as the target reads them: the words from WINDOW_OFFSET on."""
        window = np.zeros((WINDOW_RECORDS, self.record_words), dtype="<u4")
        if self.rows is not None:
            window[: len(self.rows), list(self.input_positions)] = self.rows
        return window.tobytes()


REQUEST_BYTES = 4 * _REQUEST_WORDS
WINDOW_OFFSET = 4 * _WINDOW_AT


@dataclass(frozen=True, slots=True)
class CycleSection:
    """Instructions or cycles of one part of a step, including those of the clock itself."""

    count: int
    minimum: int
    maximum: int
    maximum_step: int
    total: int


@dataclass(frozen=True, slots=True)
class Reply:
    """Content of the mailbox after a request."""

    status: int
    state_bytes: int
    control_bytes: int
    words: int
    stack_bytes: int
    step: int
    hash: int
    sections: tuple[CycleSection, ...]
    checkpoints: Words
    window: Words

    @classmethod
    def unpack(cls, box: bytes) -> Reply:
        """Read a mailbox."""
        words = np.frombuffer(box, dtype="<u4")
        if words[_REQUEST_WORDS] != len(words):
            raise ValueError("the target has a different layout of the box")
        _, status, *numbers = (int(word) for word in words[_REQUEST_WORDS:_SECTIONS_AT])
        table = words[_SECTIONS_AT:_CHECKPOINTS_AT].reshape(SECTION_COUNT, _SECTION_WORDS)
        sections = tuple(
            CycleSection(count, least_cost, most_cost, most_at, low + (high << 32))
            for count, least_cost, most_cost, most_at, low, high in table.tolist()
        )
        window = words[_WINDOW_AT:].reshape(WINDOW_RECORDS, -1)
        status = status - (1 << 32) if status >> 31 else status
        state, control, block, stack, step, hash_value = numbers
        hashes = words[_CHECKPOINTS_AT:_WINDOW_AT]
        return cls(status, state, control, block, stack, step, hash_value, sections, hashes, window)


def target_failed_error(target: str, reason: str) -> NegativeResult:
    """Return the exception for a target without an answer."""
    return NegativeResult(f"target {target}: {reason}", code="target-failed", key=target)


def time_limit_error(target: str, limit: float) -> NegativeResult:
    """Return the exception for a target that exceeded a time limit, s."""
    return NegativeResult(f"target {target}: did not end within {limit:.0f} s", code="time-limit", key=target)
