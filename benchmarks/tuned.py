"""The bearing with every variant tuned for itself, and drifted plants: figures and times.

``python benchmarks/tuned.py`` prints the table of docs/results-bearing.md; it takes a quarter of an hour.
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

from anhyst.compensate.interface import MethodName
from anhyst.study.bearing.plants import bearing_plants
from anhyst.study.engine.monte_carlo import monte_carlo
from anhyst.study.tuning.aims import Aims
from anhyst.study.tuning.search import FoundGains, GainSearch
from anhyst.study.tuning.trial import default_conditions
from bearing import IRONS, Iron, make_iron, read
from rows import Row, Stopwatch

AIMS = Aims()
SETTLING_S = 6e-3
PLANTS = 1000
COMPARED: tuple[MethodName, ...] = (
    "ratio",
    "linearised",
    "single-valued",
    "flux",
    "simplified",
    "full",
)


def tune(iron: Iron, variant: MethodName) -> FoundGains:
    """Tune one variant over 3 gaps, 4 heights and 2 loads."""
    return GainSearch(iron.setups[variant], default_conditions(iron.rig), AIMS).run()


def rows() -> list[Row]:
    """Tuned figures of ``full`` with every iron, and the times."""
    rig, controller = read()
    found = []
    longest, took, seconds = 0.0, "", 0.0
    for fraction in IRONS:
        iron = make_iron(rig, controller, fraction)
        watch = Stopwatch()
        best = tune(iron, "full")
        if watch.wall > longest:
            longest, took, seconds = watch.wall, str(watch), watch.processor
        reached = best.figures
        found.append(
            Row(
                f"bearing, full tuned for itself, iron {iron.title}",
                "overshoot <= 2 % at every height, settling <= 6 ms, peak sensitivity <= 3",
                f"{reached.overshoot_percent:.2f} %, {1e3 * reached.settling_time_s:.2f} ms, "
                f"{reached.peak_sensitivity:.2f}; worst of 3 gaps, 2 loads, 4 heights",
                not AIMS.misses(reached) and reached.settling_time_s <= SETTLING_S,
            )
        )
    found.append(Row("tuning one variant", "<= 60 s wall", took, longest <= 60.0, seconds))
    watch = Stopwatch()
    with tempfile.TemporaryDirectory() as folder:
        monte_carlo(
            bearing_plants(rig, controller, ("full",)), Path(folder) / "plants.jsonl", PLANTS
        )
    found.append(
        Row(
            f"Monte Carlo of {PLANTS} drifted plants",
            "<= 180 s wall",
            str(watch),
            watch.wall <= 180.0,
            watch.processor,
        )
    )
    return found


def main() -> None:
    """Print the table of all variants, each tuned for itself."""
    rig, controller = read()
    print("| iron | variant | overshoot | settling | peak sensitivity | standstill | aims |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for fraction in IRONS:
        iron = make_iron(rig, controller, fraction)
        for variant in COMPARED:
            watch = Stopwatch()
            best = tune(iron, variant)
            reached = best.figures
            met = "missed" if AIMS.misses(reached) else "met"
            print(
                f"| {iron.title} | `{variant}` | {reached.overshoot_percent:.2f} % | "
                f"{1e3 * reached.settling_time_s:.2f} ms | {reached.peak_sensitivity:.2f} | "
                f"{1e9 * reached.standstill_rms_m:.0f} nm | {met} |",
                flush=True,
            )
            print(f"{iron.title} {variant}: {watch}", file=sys.stderr)


if __name__ == "__main__":
    main()
