"""A harness that runs as a process: requests in, boxes out."""

from __future__ import annotations

import subprocess
from collections.abc import Sequence
from dataclasses import dataclass

from anhyst.support.errors import NegativeResult
from anhyst.verification.protocol import BOX_BYTES, Reply, Request

TIME_LIMIT = 1800.0


@dataclass(frozen=True, slots=True)
class ProcessProgram:
    """A command that answers requests."""

    name: str  # target and build, for messages
    command: tuple[str, ...]  # what to run

    def run(self, requests: Sequence[Request]) -> list[Reply]:
        """Answer one request after the other, from reset."""
        said = b"".join(request.pack() + request.pack_rows() for request in requests)
        try:
            done = subprocess.run(
                self.command, input=said, capture_output=True, timeout=TIME_LIMIT, check=False
            )
        except subprocess.TimeoutExpired:
            raise NegativeResult(
                f"target {self.name}: did not end within {TIME_LIMIT:.0f} s",
                code="time-limit",
                key=self.name,
            ) from None
        if done.returncode or len(done.stdout) != len(requests) * BOX_BYTES:
            raise NegativeResult(
                f"target {self.name}: {_reason(done.stderr, done.returncode)}",
                code="target-failed",
                key=self.name,
            )
        boxes = range(0, len(done.stdout), BOX_BYTES)
        return [Reply.unpack(done.stdout[at : at + BOX_BYTES]) for at in boxes]


def _reason(stderr: bytes, code: int) -> str:
    lines = [line.strip() for line in stderr.decode(errors="replace").splitlines()]
    for line in lines:
        if "runtime error" in line or "ERROR" in line:
            return line
    said = next((line for line in reversed(lines) if line), "no reason given")
    return f"the program ended with {code}: {said}"
