"""How a net force is shared out to drives, by the numbers of ``control/allocation_kinds.h``."""

from __future__ import annotations

from enum import IntEnum


class Allocation(IntEnum):
    """See ``core/include/anhyst/control/allocation.h``."""

    SINGLE = 1
    BY_HALVES = 2  # class A
    CLASS_AB = 3
