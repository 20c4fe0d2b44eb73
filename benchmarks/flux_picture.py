"""Draw docs/img/flux.png: measured flux linkage, and the force that follows from it.

    python benchmarks/flux_picture.py [FILE.png]

The magnet is the first of ``flux_magnets``: two irons in series, with leakage between them.
"""

from __future__ import annotations

import sys
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from anhyst.identification import IdentifyResult, identify
from anhyst.model.flux_map import as_gaps
from anhyst.support.result import schedule_colours
from flux_magnets import draw_magnet, gap_zero_of, records, tests

SEED = 0
PICTURE = Path(__file__).resolve().parents[1] / "docs" / "img" / "flux.png"


def draw(path: Path) -> None:
    """Write the picture."""
    loops = records(draw_magnet(SEED), SEED)
    result = identify(loops)
    flux = result.model.flux
    assert flux is not None
    figure = Figure(figsize=(10.0, 4.2), layout="constrained")
    flux_axes, force_axes = figure.subplots(1, 2)
    colours = schedule_colours(loops.schedule_values)
    for loop, force in zip(flux.corrected_loops(loops).loops, result.fitted, strict=True):
        colour = colours[float(as_gaps(loop)[0])]
        flux_axes.plot(loop.input[::8], 1e3 * loop.output[::8], ".", ms=3.0, color="0.65")
        modelled = flux.flux_linkage(force, as_gaps(loop))
        label = f"{1e3 * as_gaps(loop)[0]:.2f} mm"
        flux_axes.plot(loop.input, 1e3 * modelled, color=colour, lw=0.9, label=label)
    flux_axes.set(xlabel="current, A", ylabel="flux linkage, mWb", title="measured (dots) and model (lines)")
    flux_axes.legend(title="gap")
    _draw_force(force_axes, result)
    figure.savefig(path, dpi=110)


def _draw_force(axes: Axes, result: IdentifyResult) -> None:
    """Draw the true and the modelled force at gaps that were not measured."""
    model = result.model
    assert model.flux is not None
    assert model.fit is not None
    margin = (model.flux.worst_uncertainty or 0.0) * model.fit.largest_output
    drives = [
        drive for drive in tests(draw_magnet(SEED), gap_zero_of(SEED)) if drive.name.startswith("loops")
    ]
    colours = schedule_colours([float(drive.gap[0]) for drive in drives])
    for drive in drives:
        gap = float(drive.gap[0])
        force = model.predict(drive.current, drive.gap, history=list(drive.conditioning)).output
        rising = slice(0, int(drive.current.argmax()) + 1)
        band = (force - margin)[rising], (force + margin)[rising]
        axes.fill_between(drive.current[rising], *band, color=colours[gap], alpha=0.25, lw=0.0)
        axes.plot(drive.current, force, color=colours[gap], lw=0.9, label=f"{1e3 * gap:.2f} mm")
        axes.plot(drive.current, drive.force, color="0.2", lw=0.9, ls=(0, (4, 3)))
    axes.set(xlabel="current, A", ylabel="force, N", title="derived force (lines) and true force (dashed)")
    axes.legend(title="gap, not measured")


if __name__ == "__main__":
    draw(Path(sys.argv[1]) if len(sys.argv) > 1 else PICTURE)
