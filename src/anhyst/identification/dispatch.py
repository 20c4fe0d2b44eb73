"""The instruction set that the global stage runs on: the best one, or that of an environment."""

from __future__ import annotations

import os

from anhyst._core import batch_levels
from anhyst.support.errors import InputError

VARIABLE = "ANHYST_DISPATCH"
"""Environment variable that forces a level."""


def batch_level() -> str:
    """Level of the batch: the processor's best unless the environment names one."""
    levels = batch_levels()
    wanted = os.environ.get(VARIABLE)
    if wanted is None:
        return levels[-1]
    if wanted not in levels:
        raise InputError(
            f"{VARIABLE}: there is no level {wanted!r} on this processor; set one of "
            f"{', '.join(levels)}, or unset it for the best",
            code="unknown-level",
            key=VARIABLE,
        )
    return wanted
