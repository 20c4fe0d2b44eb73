"""The section of the report about a force that was derived from the flux linkage."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from anhyst.data.loops import Loops
from anhyst.model.actuator import Model
from anhyst.model.flux_map import FluxMap, as_gaps
from anhyst.reports.figures import figure_loops
from anhyst.reports.subject import Measurements, ModelSubject
from anhyst.support.figures import new_figure, use_report_style
from anhyst.support.numeric import FloatArray
from anhyst.support.page import Block, Items, Section, Text, axis_label, format_percent, quantity_scale
from anhyst.support.result import schedule_colours
from anhyst.support.units import QUANTITIES

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_CURVE_SAMPLES = 200


def section_flux(subject: ModelSubject) -> Section | None:
    """Return the section with the loops of flux linkage, the derived force and what was assumed."""
    model, flux = subject.model, subject.model.flux
    if flux is None:
        return None
    blocks: list[Block] = []
    if flux.mean_uncertainty is not None and flux.worst_uncertainty is not None:
        mean, worst = format_percent(flux.mean_uncertainty), format_percent(flux.worst_uncertainty)
        blocks.append(
            Text(
                f"No force was measured. The force follows from the flux linkage by the energy balance. "
                f"Its error is at most {mean} of the largest force in the mean, and {worst} at worst, for "
                "about nine of ten magnets."
            )
        )
    blocks.append(Items("What the force is based on", flux.assumptions))
    if subject.measurements is not None:
        psi_loops, fitted = _flux_loops(subject.measurements, flux)
        blocks.append(
            subject.picture(
                figure_loops(psi_loops, fitted),
                "Flux linkage over current, one panel for each gap: measured samples as grey points, the "
                "model as blue lines.",
                "Measured flux linkage without drift (points) and that of the model (line).",
            )
        )
    if model.fit is not None:
        blocks.append(
            subject.picture(
                _figure_force(model, flux),
                "Force over current at each measured gap, with a band for the uncertainty of the force.",
                "Force in steady-state loops at each measured gap. The band is the worst uncertainty.",
            )
        )
    return Section("flux", "Force from flux linkage", tuple(blocks))


def _flux_loops(measurements: Measurements, flux: FluxMap) -> tuple[Loops, list[FloatArray | None]]:
    """Return the measured loops and the modelled ones as flux linkage, with the sign of the current."""

    def convert(force: FloatArray, current: FloatArray, gap: FloatArray) -> FloatArray:
        return np.asarray(np.copysign(flux.flux_linkage(force, gap), current))

    loops = measurements.loops
    measured = tuple(
        replace(loop, output=convert(loop.output, loop.input, as_gaps(loop))) for loop in loops.loops
    )
    fitted = [
        None if force is None else convert(force, loop.input, as_gaps(loop))
        for loop, force in zip(loops.loops, measurements.fitted, strict=True)
    ]
    return replace(loops, loops=measured, output=QUANTITIES["flux_linkage"]), fitted


@use_report_style
def _figure_force(model: Model, flux: FluxMap) -> Figure:
    """Draw the steady-state force over the current at each measured gap, with its worst uncertainty."""
    figure = new_figure(3.6)
    axes = figure.subplots()
    assert model.schedule is not None
    assert model.fit is not None
    input_scale = quantity_scale(model.input, model.valid_range.input)
    output_scale = quantity_scale(model.output, model.valid_range.output)
    gaps = sorted({loop.schedule for loop in model.fit.loops if loop.schedule is not None})
    gap_scale = quantity_scale(model.schedule, gaps)
    margin = (flux.worst_uncertainty or 0.0) * model.fit.largest_output
    for gap, colour in schedule_colours(gaps).items():
        current, force = model.settled_loop(gap, _CURVE_SAMPLES)
        x, rising = input_scale.factor * current[:_CURVE_SAMPLES], force[:_CURVE_SAMPLES]
        band = output_scale.factor * (rising - margin), output_scale.factor * (rising + margin)
        axes.fill_between(x, *band, color=colour, alpha=0.25, lw=0.0)
        label = gap_scale.format_with_unit(gap or 0.0, 4, is_short=True)
        y = output_scale.factor * force
        axes.plot(input_scale.factor * current, y, color=colour, lw=1.0, label=label)
    axes.set_xlabel(axis_label(model.input, input_scale))
    axes.set_ylabel(axis_label(model.output, output_scale))
    axes.legend(fontsize=7.5, title=model.schedule.words, title_fontsize=7.5)
    return figure
