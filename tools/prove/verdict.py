"""What a tool's output says. Part of what a recorded proof depends on, so nothing else is here."""

from __future__ import annotations

import re

PROVED, REFUTED, TIMEOUT, NO_ANSWER = "proved", "refuted", "timeout", "no answer"


def verdict_of(tool: str, output: str) -> str:
    """Read the tool's answer; anything else than a clear yes or no is reported as it is."""
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
