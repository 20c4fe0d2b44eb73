"""What every result can do: tell of itself, become a data frame, be drawn and be saved."""

from __future__ import annotations

import html
from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from anhyst.support.atomic import PathLike, write_json
from anhyst.support.errors import InputError
from anhyst.support.units import Quantity

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.axes import Axes


class Result(ABC):
    """Base of what verbs give and take.

    A class says four things of itself: `facts`, the few figures one wants to see; `to_columns`,
    its table; `draw`; and `as_dict` or a `save` of its own.
    """

    __slots__ = ()

    @abstractmethod
    def facts(self) -> Mapping[str, str]:
        """Return the figures one wants to see first, in words with units."""

    @abstractmethod
    def to_columns(self) -> Mapping[str, Any]:
        """Return the table of this result: columns of one length, units in their names."""

    @abstractmethod
    def draw(self, ax: Axes) -> None:
        """Draw on axes, with labels that carry units; legend and look are given by `plot`."""

    def plot(self, ax: Axes | None = None) -> Axes:
        """Draw this result.

        Parameters
        ----------
        ax : Axes, optional
            Where to draw; if left out, axes of a new figure of pyplot, which ``plt.show()`` and
            notebooks show.

        Returns
        -------
        Axes
        """
        if ax is None:
            import matplotlib.pyplot as plt

            ax = plt.subplots(layout="constrained")[1]
        self.draw(ax)
        if ax.get_legend_handles_labels()[1]:
            ax.legend(frameon=False, fontsize="small")
        style_axes(ax)
        return ax

    def as_dict(self) -> Mapping[str, Any]:
        """Return what :meth:`save` writes, plain numbers and names."""
        return {name: np.asarray(values).tolist() for name, values in self.to_columns().items()}

    def save(self, path: PathLike) -> Path:
        """Write this result as JSON, whole or not at all.

        Raises
        ------
        InputError
            The place cannot be written.
        """
        write_json(path, self.as_dict())
        return Path(path)

    def to_dataframe(self) -> pd.DataFrame:
        """Return the table of this result as a data frame of pandas.

        Raises
        ------
        InputError
            If pandas is not installed.
        """
        try:
            import pandas as pd
        except ImportError as error:
            raise InputError(
                "pandas is not installed: pip install 'anhyst[pandas]'",
                code="not-installed",
                key="pandas",
            ) from error
        columns = self.to_columns()
        return pd.DataFrame({name: np.asarray(values) for name, values in columns.items()})

    def __repr__(self) -> str:
        listed = ", ".join(f"{name}: {text}" for name, text in self.facts().items())
        return f"<{type(self).__name__} {listed}>"

    def _repr_html_(self) -> str:
        """Return the same for a notebook."""
        rows = "".join(
            f"<tr><th style='text-align:left'>{html.escape(name)}</th>"
            f"<td style='text-align:left'>{html.escape(text)}</td></tr>"
            for name, text in self.facts().items()
        )
        name = html.escape(type(self).__name__)
        return f"<table><caption style='text-align:left'><b>{name}</b></caption>{rows}</table>"


MAX_ROWS = 10
"""Maximum number of rows of a table in a notebook."""


def html_table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table for a notebook."""
    lines = [("th", head), *(("td", row) for row in rows)]
    body = "".join(
        f"<tr>{''.join(f'<{tag}>{html.escape(cell)}</{tag}>' for cell in cells)}</tr>"
        for tag, cells in lines
    )
    return f"<table>{body}</table>"


def style_axes(ax: Axes) -> None:
    """Add a grid to the axes and remove the top and right spines."""
    ax.grid(visible=True, alpha=0.25, lw=0.6)
    ax.spines[["top", "right"]].set_visible(False)


def range_text(low: float, high: float, unit: str) -> str:
    """Return a range in words, such as ``0 to 5 A``."""
    return f"{low:.4g} to {high:.4g} {unit}"


def rows_to_columns(rows: Sequence[Mapping[str, Any]]) -> dict[str, list[Any]]:
    """Turn rows of the same names into columns."""
    return {name: [row[name] for row in rows] for name in rows[0]} if rows else {}


MAX_LINE_POINTS = 20_000
"""Lines are drawn with at most about this many points."""


ScheduleColours = dict[float | None, tuple[float, float, float, float]]


def schedule_colours(values: Sequence[float], *, has_moving: bool = False) -> ScheduleColours:
    """Colour of each scheduling value, dark to light; ``None`` stands for moving ones."""
    from matplotlib import colormaps

    groups: list[float | None] = [*values, *([None] if has_moving else [])]
    positions = np.linspace(0.0, 0.85, max(len(groups), 2))
    colours = [tuple(colour) for colour in colormaps["viridis"](positions).tolist()]
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


def thinning_slice(sample_count: int) -> slice:
    """Return which of ``n`` samples are drawn."""
    return slice(None, None, 1 + sample_count // MAX_LINE_POINTS)
