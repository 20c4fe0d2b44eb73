"""Compare calibration methods on a planar stage with errors in its ten magnets and its body.

A calibration estimates these errors from recordings of the stage's own motion. The methods are the
compensators ``full``, ``play``, ``flux``, ``fused`` and ``single-valued``. The plants are those of
``anhyst simulate examples/planar/rig.toml --monte-carlo``. All errors act at the same time:
currents, gap zeros, loop widths and flux-probe gains of every magnet, mass, centre of mass and head
positions. All settings were fixed before the first result. Each plant follows the training
set-point, is calibrated on all recordings so far, and follows it again. All metrics are evaluated
on the test set-point. Each method is calibrated on its own recordings, by the same code. The same
search finds the gains of each method.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from anhyst.support.jobs import map_ordered
from anhyst.support.kinds import MethodName
from anhyst.support.numeric import FloatArray
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.drift import change_rig, sample_plant
from anhyst_rigs.rig.recording import Recording
from anhyst_rigs.rig.stage.file import read_stage
from anhyst_rigs.rig.stage.fitted import identify_stage_magnet
from anhyst_rigs.rig.stage.loop import Feedforward, StageSetup, track
from anhyst_rigs.rig.stage.setpoint import scan_motion
from anhyst_rigs.study.tracking.bodies import StageLaw
from anhyst_rigs.study.tracking.estimator import ParameterEstimator, calibrate_from_motions
from anhyst_rigs.study.tracking.excitation import fly_legs, select_legs
from anhyst_rigs.study.tracking.measures import cross_talk, measure, stationary_axes
from calibration_trials import SCANS, Bench, make_bench, training_motion
from planar import RIG
from rows import Row

METHODS: tuple[MethodName, ...] = ("full", "play", "flux", "fused", "single-valued")
PLANTS, BASELINE_PLANTS = 12, 4
METRIC_NAMES = ("average", "peak", "settling", "z", "ry", "rz")
METRIC_UNITS = ("nm", "nm", "ms", "nm", "nrad", "nrad")


@dataclass(frozen=True)
class PlantResult:
    """The result of one plant with one method."""

    metrics: FloatArray  # before and after each number of scans, one column for each metric
    is_applied: bool
    model_fits: bool


def calibrate_plant(bench_and_plant: tuple[Bench, int]) -> PlantResult:
    """Calibrate one plant."""
    bench, plant = bench_and_plant
    rig, law = bench.rig, StageLaw(bench.rig, bench.magnet, bench.method)
    drift, noise = sample_plant(rig.settings, rig.settings.seed, plant)
    motion = scan_motion(rig.settings.scan, rig.settings.scan.test_m_per_s2)
    setup, gains = StageSetup(rig, law.compensator(0.0), drift=drift), bench.gains

    def test_errors() -> list[float]:
        run = track(setup, motion, gains, noise)
        cross_talk_errors = cross_talk(run, motion, stationary_axes(rig.settings))
        tracking_measures = measure(run, motion, rig.settings.scan.slit_s)
        scaled_metrics = [
            tracking_measures.average_m,
            tracking_measures.peak_m,
            1e-6 * tracking_measures.settling_50_s,
        ]
        return [
            1e9 * value
            for value in (
                *scaled_metrics,
                cross_talk_errors["z_m"],
                cross_talk_errors["ry_rad"],
                cross_talk_errors["rz_rad"],
            )
        ]

    metrics, learner = [test_errors()], ParameterEstimator(law)
    for scan in range(1, max(SCANS) + 1):
        learner.update(law.make_motion(track(setup, training_motion(rig), gains, noise + scan).columns))
        setup = law.corrected_stage(learner.calibration, drift)
        gains = bench.calibrated_gains if learner.identified else gains
        if scan in SCANS:
            metrics.append(test_errors())
    return PlantResult(np.array(metrics), learner.calibration.is_applied, learner.calibration.fits)


DIRECTIONS = {"x": None, "y": [11.0, 6.0, 9.0]}
"""Directions of the test set-points; accelerations, m/s2, if not those of the rig file."""
TEST_METRIC_TITLES = ("x, average, nm", "y, average, nm", "rz, nrad")


def turn_set_points(rig: BodyRig, direction_name: str) -> BodyRig:
    """Return the stage with its set-points in another direction."""
    peaks = DIRECTIONS[direction_name] or rig.settings.scan.test_m_per_s2
    direction = [float(axis == direction_name) for axis in "xyz"]
    return change_rig(rig, {"scan.direction": direction, "scan.test_m_per_s2": peaks})


def measure_both_directions(bench_and_plant: tuple[Bench, int]) -> list[list[float]]:
    """Return the errors along x and y before calibration and after each of two calibrations.

    One uses a scan along x, the other the move of ``anhyst excite --calibrate``.
    """
    bench, plant = bench_and_plant
    law = StageLaw(bench.rig, bench.magnet, bench.method)
    drift, noise = sample_plant(bench.rig.settings, bench.rig.settings.seed, plant)
    nominal = StageSetup(bench.rig, law.compensator(0.0))
    unknown_errors = replace(nominal, drift=drift)

    def direction_errors(setup: StageSetup) -> list[float]:
        averages, rz_errors = [], []
        for direction_name in DIRECTIONS:
            turned_rig = turn_set_points(bench.rig, direction_name)
            motion = scan_motion(turned_rig.settings.scan, turned_rig.settings.scan.test_m_per_s2)
            run = track(replace(setup, rig=turned_rig), motion, Feedforward(), noise)
            averages.append(1e9 * measure(run, motion, turned_rig.settings.scan.slit_s).average_m)
            rz_errors.append(1e9 * cross_talk(run, motion, ["rz"])["rz_rad"])
        return [*averages, rz_errors[0]]

    def errors_after_calibration(run: Recording) -> list[float]:
        return direction_errors(
            law.corrected_stage(calibrate_from_motions(law, [law.make_motion(run.columns)]), drift)
        )

    move_legs = select_legs(ParameterEstimator(law), nominal)
    training_run = track(unknown_errors, training_motion(bench.rig), Feedforward(), noise + 1)
    return [
        direction_errors(unknown_errors),
        errors_after_calibration(training_run),
        errors_after_calibration(fly_legs(unknown_errors, move_legs, noise + 1)),
    ]


def make_method_rows(method: str, results: Sequence[PlantResult]) -> list[Row]:
    """Return the rows of one method: 50th and 95th percentiles over the plants."""
    all_metrics = np.array([result.metrics for result in results])
    medians, percentiles_95 = np.percentile(all_metrics, [50.0, 95.0], axis=0)
    count = (
        f"applied {sum(result.is_applied for result in results)}, "
        f"fits {sum(result.model_fits for result in results)}"
    )
    result_rows = []
    for metric_index, (name, unit) in enumerate(zip(METRIC_NAMES, METRIC_UNITS, strict=True)):
        pairs = zip(medians[:, metric_index], percentiles_95[:, metric_index], strict=True)
        text = " -> ".join(f"{median:.3g} / {percentile_95:.3g}" for median, percentile_95 in pairs)
        target, is_met = "reported", None
        if method == "full" and name == "average":
            target, is_met = "<= 60 nm (95 %)", bool(percentiles_95[-1, metric_index] <= 60.0)
        if name == "rz":
            ratios = all_metrics[:, -1, metric_index] / all_metrics[:, 0, metric_index]
            text += f"; ratio after / before {np.median(ratios):.2g}, worst {ratios.max():.2g}"
            if method == "full":
                target, is_met = "ratio <= 0.15 (50 %)", bool(np.median(ratios) <= 0.15)
        title = f"balancing, {method}: {name}, {unit}, before -> after 1, 2, 4 scans"
        result_rows.append(Row(title, target, f"{text} ({count} of {len(results)})", is_met))
    return result_rows


def make_target_rows() -> list[Row]:
    """Return the rows of moving average and Rz: `full` on all plants, baselines on some."""
    rig = read_stage(RIG)
    magnet = identify_stage_magnet(rig)
    benches = map_ordered(make_bench, [("planar", rig, magnet, method) for method in METHODS])
    plants = [PLANTS if bench.method == METHODS[0] else BASELINE_PLANTS for bench in benches]
    bench_plant_pairs = [
        (bench, plant) for bench, n in zip(benches, plants, strict=True) for plant in range(n)
    ]
    results = map_ordered(calibrate_plant, bench_plant_pairs)
    return [
        row
        for row_bench in benches
        for row in make_method_rows(
            row_bench.method,
            [
                result
                for result, (bench, _) in zip(results, bench_plant_pairs, strict=True)
                if bench is row_bench
            ],
        )
        if any(f": {name}," in row.what for name in ("average", "rz"))
    ]


def rows() -> list[Row]:
    """Return all rows about balancing."""
    rig = read_stage(RIG)
    magnet = identify_stage_magnet(rig)
    benches = map_ordered(make_bench, [("planar", rig, magnet, method) for method in METHODS])
    errors = np.array(map_ordered(measure_both_directions, [(benches[0], plant) for plant in range(PLANTS)]))
    medians, percentiles_95 = np.percentile(errors, [50.0, 95.0], axis=0)
    text = "; ".join(
        f"{name} "
        + " -> ".join(
            f"{median:.3g} / {percentile_95:.3g}"
            for median, percentile_95 in zip(medians[:, index], percentiles_95[:, index], strict=True)
        )
        for index, name in enumerate(TEST_METRIC_TITLES)
    )
    title = "balancing, full, feedforward of the mass only: before -> after a scan in x -> after the move"
    directions_row = Row(title, "reported", text, None)
    plant_results = map_ordered(
        calibrate_plant, [(bench, plant) for bench in benches for plant in range(PLANTS)]
    )
    return [directions_row] + [
        row
        for index, bench in enumerate(benches)
        for row in make_method_rows(bench.method, plant_results[index * PLANTS : (index + 1) * PLANTS])
    ]
