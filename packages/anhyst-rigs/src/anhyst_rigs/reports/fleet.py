"""Write the page of a fleet of magnets: good magnets, outliers, and the scatter of the parameters."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from anhyst.support.atomic import PathLike
from anhyst.support.figures import FALLING_COLOUR, RISING_COLOUR
from anhyst.support.page import (
    Block,
    Headline,
    Items,
    Note,
    PageTable,
    Picture,
    Section,
    Text,
    Tile,
    make_table,
)
from anhyst_rigs.reports.study.page import page_text, picture, write_page
from anhyst_rigs.study.fleet import Fleet
from anhyst_rigs.study.fleet_spread import FleetSpread

_MAX_ROWS = 200


def write_fleet_report(path: PathLike, fleet: Fleet) -> None:
    """Write the report of a fleet as a self-contained HTML file."""
    sections = [_scatter_section(fleet), _magnet_section(fleet)]
    write_page(path, page_text("Fleet of magnets", _headline(fleet), sections, "their loops"))


def _headline(fleet: Fleet) -> Headline:
    count, good_count, good_shared_count = len(fleet.results), sum(fleet.is_good), sum(fleet.is_good_shared)
    notes = [Note("warn", "Doubtful", f"{text}.") for text in fleet.warnings]
    if fleet.failed:
        notes.append(Note("bad", "Not evaluated", f"{', '.join(fleet.failed)}: see below."))
    if fleet.outliers:
        notes.append(
            Note(
                "warn", "Outliers", f"{', '.join(fleet.outliers)}: their parameters are far from the others."
            )
        )
    if good_count == good_shared_count == 0:
        text = f"No magnet is within the tolerance of {fleet.settings.tolerance:g} %."
        verdict = Note("bad", "No magnet is good", text)
    elif good_shared_count >= good_count:
        text = f"As many magnets keep the tolerance with the model of '{fleet.typical}' as with their own."
        verdict = Note("good", "One model is enough", text)
    else:
        text = f"{good_count} keep the tolerance with their own model, {good_shared_count} with one for all."
        verdict = Note("info", "Individual models help", text)
    return Headline(
        title="Fleet of magnets",
        description=f"{count} magnets, law {fleet.settings.law}, gap map {fleet.settings.gap_map}; "
        f"controllers of {fleet.settings.rate:g} ticks a second in {fleet.settings.io}.",
        basis=f"A good magnet: its verified controller is at most "
        f"{fleet.settings.tolerance:g} % of the largest output in error, rms of all its loops.",
        verdict=verdict,
        notes=tuple(notes),
        tiles=(
            Tile(f"{good_count} of {count}", "good", "each with its own controller"),
            Tile(f"{good_shared_count} of {count}", "good", f"all with the model of '{fleet.typical}'"),
            Tile(str(len(fleet.outliers)), "outliers", "by their parameters"),
        ),
        picture=_error_picture(fleet),
        comparison=None,
        validity="",
    )


def _error_picture(fleet: Fleet) -> Picture:
    figure = Figure(figsize=(7.2, 3.6), layout="constrained")
    fleet.plot(figure.add_subplot())
    return picture(
        figure,
        "errors",
        "Error of each magnet, with its own controller and with one model for all.",
        "Error on the loops of each magnet, with its own compiled controller and with the model of "
        f"the most typical one, '{fleet.typical}'.",
    )


def _scatter_section(fleet: Fleet) -> Section:
    spread = fleet.spread
    if spread is None:
        text = "There are too few magnets, or they have different laws or gaps. No scatter is stated."
        return Section("scatter", "Scatter of the parameters", (Text(text),))
    figure = Figure(figsize=(7.2, 0.35 * len(fleet.quantities) + 1.2), layout="constrained")
    ax = figure.add_subplot()
    columns = fleet.to_columns()
    values = np.array([columns[name] for name in fleet.quantities]).T
    scale = np.where(spread.mean != 0.0, np.abs(spread.mean), 1.0)
    for index in range(len(fleet.quantities)):
        percent_deviation = 100.0 * (values[:, index] - spread.mean[index]) / scale[index]
        is_outlier = spread.outlier
        ax.plot(
            percent_deviation[~is_outlier],
            np.full((~is_outlier).sum(), index),
            "|",
            ms=9,
            color=RISING_COLOUR,
        )
        ax.plot(
            percent_deviation[is_outlier], np.full(is_outlier.sum(), index), "x", ms=6, color=FALLING_COLOUR
        )
    ax.set_yticks(range(len(fleet.quantities)), fleet.quantities, fontsize="small")
    ax.set_xlabel("deviation from the mean [%]")
    ax.set_xscale("symlog", linthresh=10.0)
    ax.grid(visible=True, alpha=0.25, lw=0.6)
    blocks: tuple[Block, ...] = (
        Text("Mean and scatter of the magnets, without the uncertainty of each fit and without outliers."),
        picture(figure, "scatter", "Fitted quantities of all magnets.", "Crosses: outliers."),
        scatter_table(fleet, spread),
    )
    return Section("scatter", "Scatter of the parameters", blocks)


def scatter_table(fleet: Fleet, spread: FleetSpread) -> PageTable:
    """Return a table with the mean and the scatter of each quantity."""
    rows = [
        (name, f"{mean:.4g}", f"{scatter:.2g}", f"{100.0 * scatter / abs(mean):.2g}" if mean else "")
        for name, mean, scatter in zip(fleet.quantities, spread.mean, spread.scatter, strict=True)
    ]
    table_header = ("quantity", "mean", "scatter", "%")
    return make_table("Mean and scatter over the fleet", table_header, rows)


def _magnet_section(fleet: Fleet) -> Section:
    columns = fleet.to_columns()
    rows = [
        (name, "yes" if is_good else "no", f"{own_error:.2f}", f"{shared_error:.2f}", f"{distance:.1f}")
        for name, is_good, own_error, shared_error, distance in zip(
            *(columns[key] for key in ("magnet", "good", "own_percent", "shared_percent", "distance")),
            strict=True,
        )
    ]
    rows.sort(key=lambda row: -float(row[2]))
    table_header = ("magnet", "good", "own, %", "shared, %", "distance")
    caption = (
        "The magnets with the largest errors come first. Rms errors in % of the largest output; "
        "distance from the mean in standard deviations."
    )
    blocks: list[Block] = [make_table("Magnets", table_header, rows[:_MAX_ROWS], caption, texts=2)]
    if len(rows) > _MAX_ROWS:
        blocks.append(Text(f"The other {len(rows) - _MAX_ROWS} are in fleet.csv."))
    if fleet.failed:
        reasons = tuple(f"{name}: {reason}" for name, reason in fleet.failed.items())
        blocks.append(Items("Not evaluated", reasons))
    return Section("magnets", "Magnets", tuple(blocks))
