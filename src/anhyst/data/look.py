"""What pictures of loops have in common: colours, units of axes, how many points."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from anhyst.support.units import Quantity

if TYPE_CHECKING:
    pass

MOST_POINTS = 20_000
"""Lines are drawn with at most about this many points."""

Shades = dict[float | None, tuple[float, float, float, float]]


def shades(values: Sequence[float], *, moving: bool = False) -> Shades:
    """Colour of each scheduling value, dark to light; ``None`` stands for moving ones."""
    from matplotlib import colormaps

    groups: list[float | None] = [*values, *([None] if moving else [])]
    places = np.linspace(0.0, 0.85, max(len(groups), 2))
    colours = [tuple(colour) for colour in colormaps["viridis"](places).tolist()]
    return dict(zip(groups, colours, strict=False))


def group_label(schedule: Quantity | None, value: float | None) -> str | None:
    """Text of a legend for loops at a scheduling value; None where nothing is scheduled."""
    if schedule is None:
        return None
    return f"{schedule.name} moving" if value is None else schedule.show(value)


def length_scale(output: Quantity) -> tuple[float, str]:
    """Scale and axis text: displacements in micrometres, everything else in SI units."""
    if output.unit == "m":
        return 1e6, output.label.replace("[m]", "[µm]")
    return 1.0, output.label


def few(n: int) -> slice:
    """Return which of ``n`` samples are drawn."""
    return slice(None, None, 1 + n // MOST_POINTS)
