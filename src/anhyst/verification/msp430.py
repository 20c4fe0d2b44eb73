"""MSP430: compiled by ziglang, run by mspdebug's simulator."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from anhyst.support.errors import NegativeResult
from anhyst.verification.elf import Image
from anhyst.verification.protocol import BOX_BYTES, VECTORS, WINDOW_OFFSET, Reply, Request

TIME_LIMIT = 1800.0
DUMP_LINE = re.compile(r"^\s+[0-9a-f]{5}: ((?:[0-9a-f]{2} ){1,16})\s*\|")
A_LINE = 16


@dataclass(frozen=True, slots=True)
class Msp430Program:
    """A linked harness for mspdebug."""

    name: str  # target, for messages
    simulator: str  # path of mspdebug
    path: Path  # the program
    image: Image  # the same, read

    def run(self, requests: Sequence[Request]) -> list[Reply]:
        """Answer one request after the other, from reset."""
        script = self.path.with_suffix(".script")
        script.write_text("\n".join(self._script(requests)) + "\n", encoding="ascii")
        command = [self.simulator, "-q", "sim", f"read {script.name}"]
        try:
            done = subprocess.run(
                command,
                cwd=self.path.parent,
                capture_output=True,
                text=True,
                errors="replace",
                timeout=TIME_LIMIT,
                check=False,
            )
        except subprocess.TimeoutExpired:
            raise NegativeResult(
                f"target {self.name}: did not end within {TIME_LIMIT:.0f} s",
                code="time-limit",
                key=self.name,
            ) from None
        dump = bytes(
            int(byte, 16)
            for line in done.stdout.splitlines()
            if (found := DUMP_LINE.match(line))
            for byte in found[1].split()
        )
        if done.returncode or len(dump) != len(requests) * BOX_BYTES:
            last = (done.stderr.strip() or done.stdout.strip() or "no reason given").splitlines()
            raise NegativeResult(
                f"target {self.name}: mspdebug ended early: {last[-1]}",
                code="target-failed",
                key=self.name,
            )
        return [Reply.unpack(dump[at : at + BOX_BYTES]) for at in range(0, len(dump), BOX_BYTES)]

    def _script(self, requests: Sequence[Request]) -> list[str]:
        """Return the simulator's commands.

        Memory is written by ``mw`` and read by ``md``: ``load_raw`` and ``save_raw`` reset the
        processor. A ``run`` from a breakpoint stays there, so one ``step`` goes first.
        """
        box = self.image.address("harness_box")
        lines = [
            f"prog {self.path.name}",
            "simio add timer fast",
            "simio add timer slow",
            "simio config slow base 0x180",
            "simio add hwmult multiplier",
            f"setbreak {self.image.address('harness_wait'):#x}",
            "run",
        ]
        for request in requests:
            lines += _write(box, request.pack())
            if request.mode == VECTORS:
                lines += _write(box + WINDOW_OFFSET, request.pack_rows())
            lines += ["step", "run", f"md {box:#x} {BOX_BYTES}"]
        return [*lines, "exit"]


def _write(address: int, content: bytes) -> list[str]:
    return [
        f"mw {address + at:#x} " + " ".join(f"{byte:#04x}" for byte in content[at : at + A_LINE])
        for at in range(0, len(content), A_LINE)
    ]
