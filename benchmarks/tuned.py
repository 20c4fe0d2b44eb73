"""Tune every variant of the bearing separately, and run the tuned gains on drifted plants.

``python benchmarks/tuned.py`` prints the table of docs/results-bearing.md in about 15 minutes.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from anhyst.support.kinds import MethodName
from anhyst_rigs.study.engine.monte_carlo import monte_carlo
from anhyst_rigs.study.plants import bearing_plants
from anhyst_rigs.study.tuning.aims import Aims, BearingFigures
from anhyst_rigs.study.tuning.bearing import BearingLoop, default_conditions
from anhyst_rigs.study.tuning.search import GainSearch
from bearing import IRONS, Iron, make_iron, read_example
from rows import Row, Stopwatch

AIMS = Aims()
SETTLING_S = 6e-3
PLANTS = 1000
COMPARED: tuple[MethodName, ...] = ("ratio", "linearised", "single-valued", "flux", "simplified", "full")


def tune(iron: Iron, variant: MethodName) -> BearingFigures:
    """Tune one variant for 3 gaps, 4 step heights and 2 loads."""
    loop = BearingLoop(iron.setups[variant], default_conditions(iron.rig))
    tuned_metrics = GainSearch(loop, AIMS).run().figures
    assert isinstance(tuned_metrics, BearingFigures)
    return tuned_metrics


def rows() -> list[Row]:
    """Return the metrics of ``full`` after tuning for each iron, and the computing times."""
    rig, controller = read_example()
    result_rows = []
    longest_wall, time_text, seconds = 0.0, "", 0.0
    for fraction in IRONS:
        iron = make_iron(rig, controller, fraction)
        watch = Stopwatch()
        tuned_metrics = tune(iron, "full")
        if watch.wall > longest_wall:
            longest_wall, time_text, seconds = watch.wall, str(watch), watch.processor
        result_rows.append(
            Row(
                f"bearing, full tuned separately, iron {iron.title}",
                "overshoot <= 2 % at every height, settling <= 6 ms, peak sensitivity <= 3",
                f"{tuned_metrics.overshoot_percent:.2f} %, {1e3 * tuned_metrics.settling_time_s:.2f} ms, "
                f"{tuned_metrics.peak_sensitivity:.2f}; worst of 3 gaps, 2 loads, 4 heights",
                not AIMS.missed_by(tuned_metrics) and tuned_metrics.settling_time_s <= SETTLING_S,
            )
        )
    result_rows.append(Row("tuning one variant", "<= 60 s wall", time_text, longest_wall <= 60.0, seconds))
    watch = Stopwatch()
    with tempfile.TemporaryDirectory() as folder:
        monte_carlo(bearing_plants(rig, controller, ("full",)), Path(folder) / "plants.jsonl", PLANTS)
    result_rows.append(
        Row(
            f"Monte Carlo of {PLANTS} drifted plants",
            "<= 180 s wall",
            str(watch),
            watch.wall <= 180.0,
            watch.processor,
        )
    )
    return result_rows


def main() -> None:
    """Print the table of all variants, each tuned separately."""
    rig, controller = read_example()
    print("| iron | variant | overshoot | settling | peak sensitivity | standstill | aims |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for fraction in IRONS:
        iron = make_iron(rig, controller, fraction)
        for variant in COMPARED:
            watch = Stopwatch()
            metrics = tune(iron, variant)
            aims_text = "missed" if AIMS.missed_by(metrics) else "met"
            print(
                f"| {iron.title} | `{variant}` | {metrics.overshoot_percent:.2f} % | "
                f"{1e3 * metrics.settling_time_s:.2f} ms | {metrics.peak_sensitivity:.2f} | "
                f"{1e9 * metrics.standstill_rms_m:.0f} nm | {aims_text} |",
                flush=True,
            )
            print(f"{iron.title} {variant}: {watch}", file=sys.stderr)


if __name__ == "__main__":
    main()
