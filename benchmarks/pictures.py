"""Draw the pictures in docs/img that show results of the bundled examples.

    python benchmarks/pictures.py [NAME ...]

The names are loops, force-control, piezo-stage and tracking. All four take two to five minutes on two cores.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path

from anhyst.data import read_loops
from anhyst.identification import identify
from anhyst.reports.figures import figure_loops
from anhyst.support.figures import write_png
from anhyst_rigs.reports.force import figure_constant_gap
from anhyst_rigs.reports.piezo import figure_tracking
from anhyst_rigs.reports.tracking import figure_scan
from anhyst_rigs.rig.piezo import read_piezo_rig
from anhyst_rigs.rig.stage.file import read_stage
from anhyst_rigs.rig.stage.setpoint import scan_motion
from anhyst_rigs.study.force_control import force_control
from anhyst_rigs.study.piezo import simulate_tracking
from anhyst_rigs.study.tracking.simulate import explore_stage
from rows import ROOT

EXAMPLES = ROOT / "examples"


def draw_loops(path: Path) -> None:
    """Draw the measured and the modelled loops of the electromagnet."""
    loops = read_loops(EXAMPLES / "electromagnet" / "loops.csv")
    write_png(figure_loops(loops, identify(loops).fitted), path)


def draw_force_control(path: Path) -> None:
    """Draw the forces and the errors at the end of the stroke of the solenoid."""
    with tempfile.TemporaryDirectory() as folder:
        result = force_control(EXAMPLES / "solenoid" / "rig.toml", Path(folder) / "out")
    outcomes = [outcome for outcome in result.outcomes if outcome.trial.trial_stage == "end"]
    write_png(figure_constant_gap(result.rig, outcomes), path)


def draw_piezo_stage(path: Path) -> None:
    """Draw the deviations of the piezo stage from its triangle."""
    write_png(figure_tracking(simulate_tracking(read_piezo_rig(EXAMPLES / "piezo" / "rig.toml"))), path)


def draw_tracking(path: Path) -> None:
    """Draw the last scan of the stage."""
    study = explore_stage(read_stage(EXAMPLES / "stage" / "rig.toml"))
    scan = study.rig.settings.scan
    kept = {name: variant for name, variant in study.variants.items() if variant.recording.loss is None}
    write_png(figure_scan(kept, scan_motion(scan, scan.test_m_per_s2), scan.slit_s), path)


PICTURES: Mapping[str, Callable[[Path], None]] = {
    "loops": draw_loops,
    "force-control": draw_force_control,
    "piezo-stage": draw_piezo_stage,
    "tracking": draw_tracking,
}

if __name__ == "__main__":
    for name in sys.argv[1:] or PICTURES:
        PICTURES[name](ROOT / "docs" / "img" / f"{name}.png")
