"""Compare rules for the choice of a law from few loops, if only blocks of samples can be withheld.

    python benchmarks/few_loops.py 0 72

The random records are of six kinds with six families of iron. Each is measured twice: with
different noise or, if there is no noise, with one sample less. All laws that ``identify`` compares
are evaluated on random reversals that were not fitted. The output shows the ratio of the chosen
law's error to the error of the best law, and how often the choice changes with the noise.
"""

from __future__ import annotations

import os
import sys
import warnings
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, replace
from typing import Any
from unittest import mock

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

import drawn
from anhyst.data import Loop, Loops
from anhyst.data.verdict import largest_output
from anhyst.identification import candidates, identify, model_selection
from anhyst.identification.candidates import ModelCandidate
from anhyst.identification.model_building import make_model
from anhyst.support.errors import InputError, NegativeResult
from drawn_families import FAMILIES, SETTINGS, draw_iron, from_ranges
from drawn_irons import compute_responses
from search import deviation

SEED = 20261126

KINDS = ("ring", "one", "one-two", "two", "coarse", "slow")
"""Kinds of records, in this order: a ring; one gap with one loop; one gap with two loops; two gaps
with one loop each; 31 samples per branch after cycles of the whole range; two cycles with 200
samples per branch at two gaps."""

RULES: dict[str, dict[str, Any]] = {
    "two standard errors": {"_CLEAR_SQUARE_RATIO": np.inf},
    "one standard error": {"_CLEAR_SQUARE_RATIO": np.inf, "_CELL_SIGMAS_FOR_BLOCKS": 1.0},
    "least left out": {"_CLEAR_SQUARE_RATIO": np.inf, "_CELL_SIGMAS_FOR_BLOCKS": 0.0},
    "two, or two thirds of both": {"_CLEAR_SQUARE_RATIO": candidates._CLEAR_SQUARE_RATIO},
}


@dataclass(frozen=True)
class MeasurementResult:
    """Results of one measurement: the law that each rule selects, and rms errors of the laws."""

    chosen_laws: dict[str, str]
    rms_errors: dict[str, float]  # rms error on records not fitted, relative to the largest output
    least_rms_error: float  # rms error of the best law


class _ComparisonDone(Exception):  # noqa: N818 # not an error: ends the identification early
    def __init__(self, selection: model_selection.Selection) -> None:
        self.selection = selection


def measure_twice(number: int) -> list[tuple[Loops, list[drawn.Test]]]:
    """Sample a magnet and measure it twice."""
    rng = np.random.default_rng([SEED, number])
    kind, family = KINDS[number % 6], FAMILIES[number // 6 % 6]
    magnet, drive, sensors = (from_ranges(SETTINGS[name], rng) for name in ("magnet", "drive", "sensors"))
    magnet |= {"ring": kind == "ring", "gaps": 2 if kind in {"two", "slow"} else 1}
    drive |= {"loops": 2 if kind == "one-two" else 1, "ring_loops": 1, "clock": False}
    if kind == "coarse":
        drive |= {"bipolar": False, "samples": 31.0, "start": "conditioned"}
        sensors |= {"noise": 0.1 * sensors["noise"], "bits": 0}
    if kind == "slow":
        drive |= {"bipolar": False, "samples": 200.0, "start": "conditioned"}
        sensors |= {"noise": 3e-4, "bits": 14, "noiseless": False, "offsets": False}
    iron, true = draw_iron(family, rng)
    core, gaps = drawn._size_core(magnet, true)
    ranges = drawn._sample_loop_limits(drive, core.is_ring, magnet["current_A"], rng)
    records = [record for gap in gaps for record in drawn._measured_records(drive, ranges, float(gap), rng)]
    if kind == "slow":
        doubled_paths = [np.concatenate([record.current, record.current[1:]]) for record in records]
        records = [
            replace(record, current=path, gap=np.full(path.size, record.gap[0]))
            for record, path in zip(records, doubled_paths, strict=True)
        ]
    records += drawn._test_records((drive, ranges), gaps, magnet["current_A"], rng)
    parameters = {"iron": true, "magnet": magnet, "drive": drive, "sensors": sensors}
    plan = drawn._Plan(number, family, parameters, core, iron, records)
    responses = compute_responses(plan.jobs())
    return [
        _read_loops(plan, responses, [SEED, number, 1, reading_number], reading_number)
        for reading_number in (0, 1)
    ]


def _read_loops(
    plan: Any, responses: Any, seed: list[int], reading_number: int
) -> tuple[Loops, list[drawn.Test]]:
    """Read a plan with its sensors; without noise, the second reading has one sample less."""
    reading = drawn.apply_sensors(plan, responses, np.random.default_rng(seed))
    if not reading_number or not plan.true_parameters["sensors"]["noiseless"]:
        return reading.loops, list(reading.tests)
    shortened = [_without_sample(loop, loop.n // 3) for loop in reading.loops.loops]
    return reading.loops.with_loops(shortened), list(reading.tests)


def _without_sample(loop: Loop, sample_index: int) -> Loop:
    gap = None if loop.schedule is None else np.delete(loop.schedule, sample_index)
    return replace(
        loop,
        input=np.delete(loop.input, sample_index),
        output=np.delete(loop.output, sample_index),
        schedule=gap,
    )


def measure(loops: Loops, tests: Sequence[drawn.Test]) -> MeasurementResult | None:
    """Compare all laws; None if the first residual is only noise or the identification fails."""
    compare_laws = model_selection.Selection.compare_play_cells

    def stop_after_comparison(selection: model_selection.Selection, base_candidate: ModelCandidate) -> None:
        compare_laws(selection, base_candidate)
        raise _ComparisonDone(selection)

    try:
        with mock.patch.object(model_selection.Selection, "compare_play_cells", stop_after_comparison):
            identify(loops)
    except _ComparisonDone as end:
        return _evaluate_rules(end.selection, tests)
    except (InputError, NegativeResult):
        pass
    return None


def _evaluate_rules(fitted: model_selection.Selection, tests: Sequence[drawn.Test]) -> MeasurementResult:
    rms_errors, comparison, loops = {}, fitted.comparison, fitted.loopset
    for candidate in comparison.contenders:
        model = make_model(comparison.fits[candidate].reduced_fit, loops)
        deviations = [deviation(model, test) for test in tests if test.kind in {"other", "unseen"}]
        rms_errors[candidate] = float(np.sqrt(np.mean(np.concatenate(deviations) ** 2))) / largest_output(
            loops
        )
    chosen = {}
    for name, settings in RULES.items():
        with mock.patch.multiple(candidates, **settings):
            selection = copy(fitted)
            selection.comparison = replace(comparison, contenders=list(comparison.contenders))
            chosen[name] = selection.select()
    return MeasurementResult(
        {
            name: f"{candidate.title('effective-field')}, {candidate.gap_map}"
            for name, candidate in chosen.items()
        },
        {name: rms_errors[candidate] for name, candidate in chosen.items()},
        min(rms_errors.values()),
    )


def main() -> None:
    """Run a range of random draws and print one line for each rule."""
    warnings.simplefilter("ignore")
    first_number, end_number = (int(text) for text in sys.argv[1:3])
    pairs = [[measure(*draw) for draw in measure_twice(number)] for number in range(first_number, end_number)]
    all_results = [measurement for pair in pairs for measurement in pair if measurement]
    complete_pairs = [(first_run, second_run) for first_run, second_run in pairs if first_run and second_run]
    for name in RULES:
        error_ratios = np.array(
            [
                max(measurement.rms_errors[name], 1e-5) / max(measurement.least_rms_error, 1e-5)
                for measurement in all_results
            ]
        )
        rms = 100.0 * np.array([measurement.rms_errors[name] for measurement in all_results])
        change_fraction = np.mean(
            [
                first_run.chosen_laws[name] != second_run.chosen_laws[name]
                for first_run, second_run in complete_pairs
            ]
        )
        print(
            f"{name}: missed {np.median(rms):.3f} %, 90 of 100 {np.quantile(rms, 0.9):.2f}, worst "
            f"{rms.max():.2f}; over the best law {np.exp(np.log(error_ratios).mean()):.3f}, 90 of 100 "
            f"{np.quantile(error_ratios, 0.9):.2f}; another law after another noise {100.0 * change_fraction:.0f} % "
            f"({len(all_results)} measurements of {len(pairs)} draws)"
        )


if __name__ == "__main__":
    main()
