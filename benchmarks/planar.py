"""Measure the errors of a planar stage of six axes on ten magnets for each compensation method.

Plant, layout, irons and gain search were fixed before the first result; they are defined in
examples/planar and below. The baselines are the constant ratio, the best single-valued curve, the
map with one play, and the measured flux. The fused method combines the law and the measured flux.
Each method has its own gains from the same search.
"""

from __future__ import annotations

import tomllib
from functools import partial

import numpy as np

from anhyst.support.jobs import map_ordered
from anhyst.support.kinds import MethodName
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.case_table import LossCase
from anhyst_rigs.rig.fitting import IdentifiedMagnet
from anhyst_rigs.rig.measuring import measure_loops
from anhyst_rigs.rig.stage.file import read_stage
from anhyst_rigs.rig.stage.fitted import identify_stage_magnet, make_stage
from anhyst_rigs.rig.stage.loop import Feedforward, track
from anhyst_rigs.rig.stage.setpoint import scan_motion
from anhyst_rigs.study.tracking.gains import find_gains
from anhyst_rigs.study.tracking.measures import LossFlights, cross_talk, measure
from anhyst_rigs.study.tracking.simulate import COMPARED_METHODS, TrackingStudy, explore_stage
from rows import ROOT, Row
from tests.study.test_losses import laid
from tracking import with_iron

RIG = ROOT / "examples" / "planar" / "rig.toml"
IRONS = ROOT / "examples" / "irons" / "irons.toml"
IRON_NAMES = ("preisach-usual", "preisach-hard", "duhem-usual")
"""Irons that are not laws of the package; the first is that of the example."""
METRICS = (
    ("x, peak", "peak_m", 1e9, "nm", 0.15),
    ("x, moving average", "average_m", 1e9, "nm", 0.15),
    ("x, settling to 50 nm", "settling_50_s", 1e3, "ms", 0.3),
    ("z, peak", "z_m", 1e9, "nm", 0.3),
    ("ry, peak", "ry_rad", 1e9, "nrad", 0.3),
    ("rz, peak", "rz_rad", 1e9, "nrad", None),
)
"""Label, name, factor and unit of each metric; target as a fraction of the best curve's value."""
FAST_HZ, FAST_TARGET_M = 300.0, 2e-9
"""High crossover, Hz, and target of `full` there: moving average of the error in the cruise, m."""


def make_iron_rows(iron: str, study: TrackingStudy) -> list[Row]:
    """Return the rows of one iron."""
    result_rows = []
    for title, name, factor, unit, target_ratio in METRICS:
        means = {variant: results.interval(name).mean for variant, results in study.variants.items()}
        mean_ratio = means["full"] / means["single-valued"]
        means_text = ", ".join(f"{variant} {factor * mean:.3g}" for variant, mean in means.items())
        aim = "reported" if target_ratio is None else f"<= {target_ratio:g} times single-valued"
        text = f"{mean_ratio:.3g}; {means_text} {unit}"
        result_rows.append(
            Row(f"planar, {iron}: {title}", aim, text, target_ratio is None or mean_ratio <= target_ratio)
        )
    return result_rows


def measure_at_300_hz(
    rig: BodyRig, magnet: IdentifiedMagnet, method: MethodName
) -> tuple[float, float, float]:
    """Return the means over the seeds: moving average and peak along x, m; largest ry, rad."""
    setup, scan = make_stage(rig, magnet, method), rig.settings.scan
    gains = find_gains(setup, scan_motion(scan, scan.train_m_per_s2))
    motion, plant_metrics = scan_motion(scan, scan.test_m_per_s2), []
    for seed in range(1, rig.settings.noise_seeds + 1):
        run = track(setup, motion, gains, seed)
        measures = measure(run, motion, scan.slit_s)
        plant_metrics.append((measures.average_m, measures.peak_m, cross_talk(run, motion, ["ry"])["ry_rad"]))
    average, peak, largest_ry = np.mean(plant_metrics, axis=0).tolist()
    return average, peak, largest_ry


def make_fast_row(iron: str, rig: BodyRig, magnet: IdentifiedMagnet) -> Row:
    """Return the row of one iron at the high crossover."""
    metrics_by_method = dict(
        zip(
            COMPARED_METHODS,
            map_ordered(partial(measure_at_300_hz, rig, magnet), COMPARED_METHODS),
            strict=True,
        )
    )
    text = "; ".join(
        f"{name} {1e9 * average:.3g} nm, peak {1e9 * peak:.3g} nm, ry {1e9 * largest_ry:.3g} nrad"
        for name, (average, peak, largest_ry) in metrics_by_method.items()
    )
    title = f"planar at {FAST_HZ:g} Hz, {iron}: x, moving average"
    return Row(title, f"<= {1e9 * FAST_TARGET_M:g} nm", text, metrics_by_method["full"][0] <= FAST_TARGET_M)


def make_loss_rows() -> list[Row]:
    """Return the results for each layout after the loss of each of its magnets."""
    result_rows = []
    for name, movable in (("8", 0), ("10", 0), ("12", 8), ("14", 14)):
        for peaks in ((22.0, 10.0, 18.0), (10.0, 8.0)):
            if name == "8" and peaks[0] > 10.0:
                continue  # two magnets along x are too weak for this motion
            case = LossCase(kind="loss", circuit="open")
            flights = LossFlights(laid(name, peaks), Feedforward(), case).run_all()
            survived_count = sum(flight.outcome in ("flies on", "brakes") for flight in flights)
            text = "; ".join(" ".join(flight.table_cells()) for flight in flights)
            title = f"planar, {name} magnets, {peaks[0]:g} m/s2: survived losses"
            result_rows.append(
                Row(title, f"{movable}", f"{survived_count}; {text}", survived_count == movable)
            )
    return result_rows


def make_head_rows() -> list[Row]:
    """Return the results of lift-off and landing with ten magnets after a fault of each head."""
    result_rows = []
    for heads in (6, 7):
        case = LossCase(
            kind="loss", circuit="open", magnets=["m0"], heads=["missing", "frozen", "jumps"], lift=True
        )
        flights = LossFlights(laid("10", (22.0, 10.0, 18.0), heads), Feedforward(), case).run_all()[1:]
        landed_count = sum(flight.outcome == "lands" for flight in flights)
        text = "; ".join(" ".join(flight.table_cells()) for flight in flights)
        expected_count = sum(flight.spare for flight in flights[:-1])
        row = Row(
            f"planar, {heads} heads: landings",
            f"{expected_count}",
            f"{landed_count}; {text}",
            landed_count == expected_count,
        )
        result_rows.append(row)
    return result_rows


def rows() -> list[Row]:
    """Return all rows about the planar stage."""
    families = tomllib.loads(IRONS.read_text(encoding="utf-8"))
    result_rows = []
    for name in IRON_NAMES:
        rig = with_iron(read_stage(RIG), families[name])
        magnet = identify_stage_magnet(rig, measure_loops(rig))
        result_rows += make_iron_rows(name, explore_stage(rig, magnet))
        fast = with_iron(read_stage(RIG), families[name], FAST_HZ)
        result_rows.append(make_fast_row(name, fast, magnet))
    return result_rows + make_loss_rows() + make_head_rows()
