"""The verb ``simulate``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from anhyst.cli.console import print_json, progress_bar, show, table
from anhyst.cli.options import AsJson

if TYPE_CHECKING:
    from anhyst.simulate.simulate import Simulation


REPORT = "report.html"


def simulate(
    rig: Annotated[Path, typer.Argument(metavar="RIG", help="Rig file of a bearing.")],
    out: Annotated[
        Path,
        typer.Option("--out", "-o", metavar="FILE", help="Recording to write, '.csv' or '.mat'."),
    ],
    controller: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Controller file; 'controller.toml' beside the rig file if left out.",
        ),
    ] = None,
    as_json: AsJson = False,
) -> None:
    """Simulate a magnetic bearing with and without compensation of its hysteresis.

    The controller's own C runs in the loop, in its number format, against a magnet with hysteresis,
    with delay, converters and noise. Beside the recording, figures.json and report.html are
    written: step responses, standstill, loads, what goes wrong, sensitivity, for every kind of
    compensation behind the same gains.

    Example: anhyst simulate examples/bearing/rig.toml --out run/run.csv
    """
    from anhyst.atomic import check_writable
    from anhyst.simulate.report import write_simulation_report
    from anhyst.simulate.report.from_simulation import subject_of
    from anhyst.simulate.simulate import simulate as run

    check_writable(out.parent / REPORT)
    with progress_bar("simulate") as progress:
        found = run(rig, out, controller, progress)
    chosen = "" if controller is None else f" --controller {controller}"
    command = f"anhyst simulate {rig}{chosen} --out {out}"
    write_simulation_report(out.parent / REPORT, subject_of(found, command))
    if as_json:
        print_json(found.figures)
    else:
        _show(found, out)


def _show(found: Simulation, out: Path) -> None:
    heights = list(dict.fromkeys(cell.height for cell in found.cells))
    gap = found.rig.settings.simulate.gap_m
    rows = table(
        f"overshoot of steps at {1e3 * gap:g} mm, %",
        ["", *(f"{1e6 * height:g} um" for height in heights), "settling, ms", "standstill, nm"],
    )
    for name in found.setups:
        mine = [cell for cell in found.cells if cell.variant == name and cell.gap == gap]
        if any(not cell.figures for cell in mine):
            rows.add_row(name, *["lost"] * (len(heights) + 2))
            continue
        overshoot = [cell.figures["overshoot_percent"] for cell in mine]
        last = mine[-1].figures
        rows.add_row(
            f"{name} *" if name == found.own else name,
            *(f"{one.mean:.2f} ± {one.half_width:.2f}" for one in overshoot),
            f"{1e3 * last['settling_in_noise_s'].mean:.2f}",
            f"{1e9 * last['standstill_rms_m'].mean:.0f}",
        )
    iron = found.at.slopes
    label = f"{iron.label} iron: just after a reversal {100.0 * iron.share:.0f} % of the static N/A"
    show(
        rows,
        f"* of the controller file; mean of {found.rig.settings.simulate.noise_seeds} noise seeds "
        "with its 95 % interval; settling and standstill at the highest step",
        f"{label}; unstable pole {found.at.point.pole_at_current:.0f} Hz",
        f"written: {out}, {out.parent / 'figures.json'}, {out.parent / REPORT}",
    )
