"""Base class of all results: a short text, a data frame, a plot and a file."""

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
    """Base class of what commands return and accept.

    A subclass defines `facts`, the main values; `to_columns`, its table; `draw`; and `as_dict` or
    its own `save`.
    """

    __slots__ = ()

    @abstractmethod
    def facts(self) -> Mapping[str, str]:
        """Return the main values as texts with units."""

    @abstractmethod
    def to_columns(self) -> Mapping[str, Any]:
        """Return the table of this result: columns of equal length, with units in their names."""

    @abstractmethod
    def draw(self, ax: Axes) -> None:
        """Draw on axes, with units in the labels. `plot` adds the legend and the style."""

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
        """Return the content of :meth:`save`: plain numbers and names."""
        return {name: np.asarray(values).tolist() for name, values in self.to_columns().items()}

    def save(self, path: PathLike) -> Path:
        """Write this result as JSON, completely or not at all.

        Raises
        ------
        InputError
            The file cannot be written.
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
                "pandas is not installed: pip install 'anhyst[pandas]'", code="not-installed", key="pandas"
            ) from error
        columns = self.to_columns()
        return pd.DataFrame({name: np.asarray(values) for name, values in columns.items()})

    def __repr__(self) -> str:
        facts_text = ", ".join(f"{name}: {text}" for name, text in self.facts().items())
        return f"<{type(self).__name__} {facts_text}>"

    def _repr_html_(self) -> str:
        """Return the main values as an HTML table for a notebook."""
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
    """Return an HTML table for a notebook."""
    lines = [("th", head), *(("td", row) for row in rows)]
    table_rows = "".join(
        f"<tr>{''.join(f'<{tag}>{html.escape(cell)}</{tag}>' for cell in cells)}</tr>" for tag, cells in lines
    )
    return f"<table>{table_rows}</table>"


def style_axes(ax: Axes) -> None:
    """Add a grid to the axes and remove the top and right spines."""
    ax.grid(visible=True, alpha=0.25, lw=0.6)
    ax.spines[["top", "right"]].set_visible(False)


def range_text(low: float, high: float, unit: str) -> str:
    """Return a range as text, such as ``0 to 5 A``."""
    return f"{low:.4g} to {high:.4g} {unit}"


def rows_to_columns(rows: Sequence[Mapping[str, Any]]) -> dict[str, list[Any]]:
    """Convert rows with equal keys to columns."""
    return {name: [row[name] for row in rows] for name in rows[0]} if rows else {}


MAX_LINE_POINTS = 20_000
"""Maximum number of points per line in a plot."""


ScheduleColours = dict[float | None, tuple[float, float, float, float]]


def schedule_colours(values: Sequence[float], *, has_moving: bool = False) -> ScheduleColours:
    """Return a colour for each scheduling value, dark to light; None is for moving values."""
    from matplotlib import colormaps

    groups: list[float | None] = [*values, *([None] if has_moving else [])]
    map_positions = np.linspace(0.0, 0.85, max(len(groups), 2))
    colours = [tuple(colour) for colour in colormaps["viridis"](map_positions).tolist()]
    return dict(zip(groups, colours, strict=False))


def group_label(schedule: Quantity | None, value: float | None) -> str | None:
    """Return the legend text of the loops at a scheduling value; None if nothing is scheduled."""
    if schedule is None:
        return None
    return f"{schedule.name} moving" if value is None else schedule.show(value)


def length_scale(output: Quantity) -> tuple[float, str]:
    """Return the factor and the axis text of an output: displacements in µm, others in SI."""
    if output.unit == "m":
        return 1e6, output.label.replace("[m]", "[µm]")
    return 1.0, output.label


def thinning_slice(sample_count: int) -> slice:
    """Return the slice that thins samples for drawing."""
    return slice(None, None, 1 + sample_count // MAX_LINE_POINTS)
