"""In which coordinate the errors of a fitted quantity are normal."""

from __future__ import annotations

from anhyst.identification.space import AROUND
from anhyst.laws.law import Kernel
from anhyst.laws.registry import LAWS
from anhyst.study.fleet.spread import Coordinate


def coordinate_of(law: str, quantity: str) -> Coordinate:
    """Return the one that identification moves; of a law that says none, the logarithm."""
    kernel = LAWS[law].kernel
    numbers = (*(kernel.numbers if isinstance(kernel, Kernel) else ()), *AROUND)
    found = {one.meaning: one.coordinate for one in numbers}
    meaning = max((m for m in found if f"{quantity} ".startswith(f"{m} ")), key=len, default="")
    return found.get(meaning, "log")
