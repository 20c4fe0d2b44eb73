"""Build the test program for a target, run it, and find the first difference from the host.

The program executes the initialisation, the golden vectors and random steps. The program hashes all
inputs and outputs. If two hashes differ, both programs run again with more checkpoints, until a
window of records contains the first difference.
"""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal, Protocol

import numpy as np

from anhyst.compilation import toolchain
from anhyst.verification.bundle import IO_BITS, PLAY_KIND, Bundle, GoldenVectors
from anhyst.verification.elf import Image
from anhyst.verification.protocol import (
    CHECKPOINT_COUNT,
    RANDOM,
    STACK,
    START,
    VECTORS,
    WINDOW_RECORDS,
    RecordLayout,
    Reply,
    Request,
    Words,
    make_stage_record,
)

HARNESS_FOLDER = Path(__file__).resolve().parent / "harness"
PORT_WITHOUT_RUNTIME = "msp430"
"""Port for the compiler that has no run-time library."""

FREESTANDING_HEADERS = "freestanding"
"""Folder of the headers that a C library would provide."""

Subject = Literal["compensator", "controller", "stage"]

SEPARATE_SECTIONS_FLAGS = ("-ffunction-sections", "-fdata-sections")
NO_FUSED_PRODUCTS_FLAG = "-ffp-contract=off"
"""Flag that rounds each product and each sum. Without this flag, two targets cannot have the same
bits."""

NO_MATH_ERRNO_FLAG = "-fno-math-errno"
"""Flag that makes a square root one instruction, if the processor has one. The code does not use
``errno``."""


class HarnessProgram(Protocol):
    """Linked test program that answers requests, starting from reset."""

    def run(self, requests: Sequence[Request]) -> list[Reply]:
        """Reset the program once, and then answer all requests in their order."""


@dataclass(frozen=True, slots=True)
class Variant:
    """One build of the C code for one target."""

    target: str  # target, and name of the build: ``gcc -O2``, ``portable``
    name: str
    program: HarnessProgram  # linked test program
    unit: str  # unit of the program's clock: ``instructions``, ``cycles``, or empty
    processor: str  # processor and compiler, for the report
    compiler: str
    warnings: int  # number of compiler warnings in bundle and harness
    image: Image | None = None  # linked program, if sizes can be read from it


@dataclass(frozen=True, slots=True)
class BuildFolder:
    """Folder with copies of all files that are compiled."""

    bundle: Bundle  # compiled folder that is verified
    folder: Path  # temporary folder: C files in ``c``, programs next to it
    subject: Subject = "compensator"  # part of the bundle that is tested

    @classmethod
    def create(cls, bundle: Bundle, folder: Path, subject: Subject = "compensator") -> BuildFolder:
        """Copy the C files of the bundle and the harness into a temporary folder."""
        sources = folder / "c"
        sources.mkdir(parents=True)
        bundle.copy_sources(sources)
        for source in HARNESS_FOLDER.iterdir():
            target_folder = sources / FREESTANDING_HEADERS if source.name == "math.h" else sources
            target_folder.mkdir(exist_ok=True)
            shutil.copyfile(source, target_folder / source.name)
        header = toolchain.ACTUATOR_HEADER
        texts = toolchain.core_files(toolchain.PIDD2_SOURCES) | {header: toolchain.read_core(header)}
        for name, text in texts.items():
            path = sources / name
            if not path.exists():
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text(text, encoding="utf-8", newline="\n")
        return cls(bundle, folder, subject)

    def make_build(self, port: str, *flags: str) -> toolchain.Build:
        """Return the build for a port of the harness, such as ``cortex_m``."""
        target = self.folder / "c"
        ports = [port, "freestanding"] if port == PORT_WITHOUT_RUNTIME else [port]
        sources = [name for name in self.bundle.c_files if name.endswith(".c")]
        if self.subject == "compensator":
            sources = [name for name in sources if name != f"{self.bundle.name}_controller.c"]
        free = [target / FREESTANDING_HEADERS] if port == "cortex_m" else []
        names = [
            "harness.c",
            f"run_{self.subject}.c",
            *(f"{name}.c" for name in ports),
            *sorted({*sources, *PIDD2_SOURCE_PATHS}),
        ]
        return toolchain.Build(
            tuple(target / name for name in names),
            (target, target / "include", target / "port", *free),
            self._macro_definitions(),
            (*SEPARATE_SECTIONS_FLAGS, NO_FUSED_PRODUCTS_FLAG, NO_MATH_ERRNO_FLAG, *flags),
            ("-lm",) if port == "host" and self.subject == "stage" else (),
        )

    @property
    def stage_record(self) -> RecordLayout | None:
        """Record layout of a stage; None without a stage."""
        stage = self.bundle.stage
        return make_stage_record(stage["free"], stage["heads"], stage["magnets"]) if stage else None

    def _macro_definitions(self) -> dict[str, str]:
        """Return the macros of the harness."""
        name = self.bundle.name
        if self.stage_record is not None:
            return {
                "STAGE_HEADER": f'"{name}_controller.h"',
                "STAGE(part)": f"{name}_controller##part",
                "COUNT(part)": f"{name.upper()}_CONTROLLER_##part",
                "HARNESS_RECORD_WORDS": str(self.stage_record.word_count),
                **({} if self.bundle.io == "f32" else {"STAGE_CODES": "1"}),
            }
        play = {"HARNESS_PLAY": "1"} if self.bundle.kind == PLAY_KIND else {}
        return {"HARNESS_IO": IO_BITS[self.bundle.io], **play, **toolchain.actuator_defines(name)}


PIDD2_SOURCE_PATHS = tuple(f"{toolchain.SOURCE_FOLDER}/{name}" for name in toolchain.PIDD2_SOURCES)


STACK_STEPS = 500
PART_TITLES = {
    "start": "start",
    "vectors": "golden vector",
    "random": "random step",
    "firmware": "tick",
    "status": "answer to demand",
}


@dataclass(frozen=True, slots=True)
class Difference:
    """First difference between a target and the host."""

    # ``start``, ``vectors`` (golden vectors), ``random`` (random steps), ``firmware`` (ticks of a
    # whole firmware) or ``status`` (its answers)
    part: str
    step: int  # index of the step within the part, from 0
    quantity: str  # first quantity of the step that differs
    expected: int  # value of the host or of the golden vectors, and value of the target
    found: int

    def text(self) -> str:
        """Return the difference in one line."""
        return f"{PART_TITLES[self.part]} {self.step}: {self.quantity} is {self.found}, not {self.expected}"


@dataclass(frozen=True, slots=True)
class Answers:
    """All results of a program."""

    start: Reply  # replies after initialisation, golden vectors and random steps
    golden: Reply
    random: Reply
    vectors: Words  # results for the golden vectors; shape (rows, words of a record)
    stack: int  # largest stack of a call of solve or commit, bytes; 0 if it is not measured


def run_program(program: HarnessProgram, vectors: GoldenVectors, steps: int, seed: int) -> Answers:
    """Run the golden vectors, random steps, and the steps that measure the stack."""
    rows, input_positions, words = vectors.inputs, vectors.layout.input_positions, vectors.layout.word_count
    batches = [rows[row : row + WINDOW_RECORDS] for row in range(0, len(rows), WINDOW_RECORDS)]
    start = Request(START, seed=seed, record_words=words)
    golden_vectors = [
        Request(VECTORS, steps=len(batch), rows=batch, input_positions=input_positions, record_words=words)
        for batch in batches
    ]
    random = Request(RANDOM, steps=steps, checkpoint_stride=_checkpoint_stride(steps), record_words=words)
    stack = Request(STACK, steps=min(steps, STACK_STEPS), record_words=words)
    replies = program.run([start, *golden_vectors, start, random, stack])
    answers = [reply.window[: len(batch)] for reply, batch in zip(replies[1:-3], batches, strict=True)]
    golden_answers = np.concatenate([np.zeros((0, words), dtype=np.uint32), *answers])
    return Answers(replies[0], replies[-4], replies[-2], golden_answers, replies[-1].stack_bytes)


def _checkpoint_stride(steps: int) -> int:
    return max(1, -(-steps // CHECKPOINT_COUNT))


def compare_answers(
    programs: tuple[HarnessProgram, HarnessProgram],
    outcomes: tuple[Answers, Answers],
    vectors: GoldenVectors,
    steps: int,
    seed: int,
) -> Difference | None:
    """Return the first difference of a target from the host and from the golden vectors, or None."""
    host, target = outcomes
    for name in ("status", "words", "hash"):
        expected_words, target_words = getattr(host.start, name), getattr(target.start, name)
        if expected_words != target_words:
            quantity = f"hash of the {vectors.layout.start_contents}" if name == "hash" else name
            return Difference("start", 0, quantity, expected_words, target_words)
    if (difference := _compare_with_file(target, vectors)) is not None:
        return difference
    if (mismatch := _find_mismatch(host.vectors, target.vectors)) is not None:
        return _make_difference(vectors.layout, "vectors", 0, mismatch, host.vectors, target.vectors)
    if host.random.hash == target.random.hash:
        return None
    return _locate_difference(vectors.layout, programs, (host.random, target.random), steps, seed)


def _compare_with_file(answers: Answers, vectors: GoldenVectors) -> Difference | None:
    output_positions = [vectors.layout.record.index(name) for name in vectors.outputs]
    answered_outputs = answers.vectors[:, output_positions]
    expected_outputs = np.stack(list(vectors.outputs.values()), axis=1)
    mismatch = _find_mismatch(expected_outputs, answered_outputs)
    if mismatch is None:
        return None
    row, column = mismatch
    name = list(vectors.outputs)[column]
    return Difference(
        "vectors", row, name, _signed(expected_outputs[mismatch]), _signed(answered_outputs[mismatch])
    )


def _locate_difference(
    layout: RecordLayout,
    programs: tuple[HarnessProgram, HarnessProgram],
    replies: tuple[Reply, Reply],
    steps: int,
    seed: int,
) -> Difference:
    """Narrow down the first difference by checkpoints to one window of records."""
    first_step, last_step = 0, steps
    stride = _checkpoint_stride(steps)
    while True:
        checkpoint_steps = list(range(first_step, last_step, stride))
        hashes = (reply.checkpoints[: len(checkpoint_steps)] for reply in replies)
        mismatches = np.flatnonzero(np.not_equal(*hashes))
        mismatch = int(mismatches[0]) if len(mismatches) else len(checkpoint_steps)
        # The hash that is stored before a step covers all earlier steps.
        first_step, last_step = (
            checkpoint_steps[mismatch - 1],
            checkpoint_steps[mismatch] if mismatch < len(checkpoint_steps) else last_step,
        )
        stride = _checkpoint_stride(last_step - first_step)
        # Run both programs up to the last step. Store a hash at the first step and after every
        # stride.
        random = Request(
            RANDOM,
            last_step,
            first_checkpoint_step=first_step,
            checkpoint_stride=stride,
            first_window_step=first_step,
            record_words=layout.word_count,
        )
        requests = [Request(START, seed=seed, record_words=layout.word_count), random]
        host, target = (program.run(requests)[-1] for program in programs)
        replies = host, target
        if last_step - first_step <= WINDOW_RECORDS:
            records = [reply.window[: last_step - first_step] for reply in replies]
            difference = _find_mismatch(*records)
            if difference is None:
                ends = (reply.hash for reply in replies)
                return Difference("random", first_step, "not repeatable: the hash", *ends)
            return _make_difference(layout, "random", first_step, difference, *records)


def _find_mismatch(host: Words, target: Words) -> tuple[int, int] | None:
    mismatches = np.argwhere(host != target)
    return (int(mismatches[0, 0]), int(mismatches[0, 1])) if len(mismatches) else None


def _make_difference(
    layout: RecordLayout, test_part: str, first_step: int, index: tuple[int, int], host: Words, target: Words
) -> Difference:
    row, word = index
    return Difference(
        test_part, first_step + row, layout.record[word], _signed(host[row, word]), _signed(target[row, word])
    )


def _signed(word: int) -> int:
    value = int(word)
    return value - (1 << 32) if value >> 31 else value
