"""Read the verdict from a tool's output. Recorded proofs depend on this file: keep it minimal."""

from __future__ import annotations

import re

PROVED, REFUTED, TIMEOUT, NO_ANSWER = "proved", "refuted", "timeout", "no answer"


def verdict_of(tool: str, output: str) -> str:
    """Return the verdict of a tool; "no answer" unless the output is a clear yes or no."""
    if tool == "esbmc":
        if "VERIFICATION SUCCESSFUL" in output:
            return PROVED
        return REFUTED if "VERIFICATION FAILED" in output else NO_ANSWER
    if tool == "every":
        answers = {"every number": PROVED, "not all": REFUTED}
        return next((v for text, v in answers.items() if text in output), NO_ANSWER)
    goals = re.search(r"Proved goals:\s+(\d+) / (\d+)", output)
    if not goals or "User Error" in output:
        return NO_ANSWER
    return PROVED if goals[1] == goals[2] else REFUTED
