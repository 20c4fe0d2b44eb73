"""Compare the fits of identification with the best known fits on 200 random measurements.

``make bench WHAT=search`` prints the rows of both halves. Draws with an even number may be
inspected; they are stored one by one in ``build/search.json``. Of the odd draws, only summaries are
shown.

    python benchmarks/search.py --every 5       every fifth draw of the even half, in a few minutes
    python benchmarks/search.py --every 1       the even half
    python benchmarks/search.py --reveal        both halves; the odd draws are stored too

``drawn.toml`` defines the random measurements; ``known_best.json`` has the best known fits, which
``known.py`` finds.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import warnings
from collections.abc import Callable, Mapping, Sequence
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from anhyst.data import Loops
from anhyst.data.verdict import largest_output
from anhyst.identification import identify
from anhyst.model.actuator import Model
from anhyst.model.schema import CHOSEN
from anhyst.support.errors import InputError, NegativeResult
from anhyst.support.numeric import FloatArray
from drawn import DRAW_COUNT, Draw, Test, draw
from drawn_families import FAMILIES
from rows import ROOT, Row, Stopwatch

KNOWN_FILE = ROOT / "benchmarks" / "known_best.json"
RESULTS_FILE = ROOT / "build" / "search.json"
KINDS = ("same", "unseen", "moving", "small", "other")

MAX_RATIO = 1.1
"""Largest ratio of the deviation to that of the best known fit with at most as many parameters."""

MIN_DEVIATION = 1e-4
"""Deviation relative to the largest output that is too small for any sensor."""

REQUIRED_STAGE = 1
"""Stage of ``known.py`` that must be complete before the best fit of a draw counts as known."""

TARGET_COVERAGE = 0.9
"""Target for the fraction of intervals that contain the true value."""

DrawResult = dict[str, Any]


def loops_rms(model: Model, loops: Loops) -> float:
    """Return the rms deviation from equally weighted loops, relative to the largest output."""
    residuals = [
        model.predict(loop.input, loop.schedule, loop.time, loop.history).output - loop.output
        for loop in loops.loops
    ]
    return float(
        np.sqrt(np.mean([np.mean(residuals * residuals) for residuals in residuals]))
    ) / largest_output(loops)


def deviation(model: Model, test: Test) -> FloatArray:
    """Return the deviation of a model from a test record; infinite if the model has no solution."""
    try:
        output = model.predict(test.input, test.schedule, history=test.history).output
    except (InputError, NegativeResult):
        return np.full(1, np.inf)
    return np.asarray((output - test.output)[test.evaluated_mask])


def measure(draw_to_measure: Draw) -> DrawResult:
    """Identify a draw with default settings; return the errors of its model on all test records."""
    loops, drive = draw_to_measure.loops, draw_to_measure.true_parameters["drive"]
    draw_result: DrawResult = {
        "number": draw_to_measure.number,
        "family": draw_to_measure.family,
        "start": drive["start"],
        "output": loops.output.name,
        "gaps": len(loops.schedule_values),
        "loops": len(loops),
        "noise": 0.0
        if draw_to_measure.true_parameters["sensors"]["noiseless"]
        else draw_to_measure.true_parameters["sensors"]["noise"],
    }
    watch = Stopwatch()
    try:
        model = identify(loops).model
    except (InputError, NegativeResult) as error:
        return draw_result | {"refused": str(error), "seconds": watch.processor}
    draw_result["seconds"] = watch.processor
    assert model.fit is not None
    assert model.uncertainty is not None
    chosen = [candidate.law for candidate in model.fit.candidates if candidate.note == CHOSEN]
    draw_result |= {
        "law": chosen[0] if chosen else model.law,
        "map": model.gap_map,
        "numbers": len(model.uncertainty.names),
        "rms": loops_rms(model, loops),
    }
    span = largest_output(loops)
    for kind in KINDS:
        residuals = [deviation(model, test) / span for test in draw_to_measure.tests if test.kind == kind]
        if residuals:
            all_tests = np.concatenate(residuals)
            draw_result[kind] = {
                "mean": float(np.mean(np.abs(all_tests))),
                "worst": float(np.max(np.abs(all_tests))),
                "rms": float(np.sqrt(np.mean(all_tests * all_tests))),
            }
    if cross_validation := model.fit.cross_validation:
        draw_result["promised"] = list(cross_validation.interval)
    return draw_result


def best_known_rms(known_draw: Mapping[str, Any], max_parameters: int) -> float | None:
    """Return the deviation of the best known usable fit with at most `numbers` parameters."""
    fits = known_draw["fits"].values() if known_draw["through"] >= REQUIRED_STAGE else ()
    usable_rms = [fit["rms"] for fit in fits if fit and fit["usable"] and fit["numbers"] <= max_parameters]
    return 0.01 * min(usable_rms) if usable_rms else None


def add_known_ratios(draw_results: Sequence[DrawResult]) -> list[DrawResult]:
    """Add the ratios of each deviation to that of the best known fits, if these are known.

    The first ratio is to the fits with at most as many parameters, the second to all fits.
    """
    known_fits = json.loads(KNOWN_FILE.read_text(encoding="utf-8")) if KNOWN_FILE.exists() else {"draws": {}}
    extended_results = []
    for draw_result in draw_results:
        known_draw = known_fits["draws"].get(str(draw_result["number"]))
        ratios = {}
        for name, max_parameters in (("ratio", draw_result.get("numbers", 0)), ("ratio_of_all", sys.maxsize)):
            best_rms = (
                best_known_rms(known_draw, max_parameters) if known_draw and "rms" in draw_result else None
            )
            if best_rms is not None:
                ratios[name] = max(draw_result["rms"], MIN_DEVIATION) / max(best_rms, MIN_DEVIATION)
        extended_results.append(draw_result | ratios)
    return extended_results


def _text_by_family(
    draw_results: Sequence[DrawResult], metric_text: Callable[[Sequence[DrawResult]], str]
) -> str:
    """Return a metric of all draws and of each family, as text."""
    groups = {
        name: [draw_result for draw_result in draw_results if draw_result["family"] == name]
        for name in FAMILIES
    }
    texts = [f"{name} {metric_text(group)}" for name, group in groups.items() if group]
    return "; ".join([f"all {metric_text(draw_results)}", *texts])


def _median(values: Sequence[float], scale: float = 1.0, digits: int = 3) -> str:
    return f"{scale * float(np.median(values)):.{digits}g}" if values else "-"


def _all_fits_ratio_text(draw_results: Sequence[DrawResult]) -> str:
    ratios = [draw_result["ratio_of_all"] for draw_result in draw_results if "ratio_of_all" in draw_result]
    return f"{_median(ratios)}, worst {max(ratios):.3g}" if ratios else "-"


def _near_best_text(draw_results: Sequence[DrawResult]) -> str:
    ratios = [draw_result["ratio"] for draw_result in draw_results if "ratio" in draw_result]
    if not ratios:
        return "-"
    near_fraction = float(np.mean([ratio <= MAX_RATIO for ratio in ratios]))
    return f"{100.0 * near_fraction:.0f} % of {len(ratios)}, worst {max(ratios):.3g}"


def _error_text(kind: str) -> Callable[[Sequence[DrawResult]], str]:
    def metric_text(draw_results: Sequence[DrawResult]) -> str:
        kind_errors = [draw_result[kind] for draw_result in draw_results if kind in draw_result]
        mean_errors, worst_errors = (
            [draw_result[name] for draw_result in kind_errors] for name in ("mean", "worst")
        )
        return f"{_median(mean_errors, 100.0)}/{_median(worst_errors, 100.0)} %"

    return metric_text


def _moving_ratio_text(draw_results: Sequence[DrawResult]) -> str:
    return _median([draw_result["moving"]["mean"] / draw_result["unseen"]["mean"] for draw_result in draw_results
                    if "moving" in draw_result])  # fmt: skip


def _single_loop_ratio_text(draw_results: Sequence[DrawResult]) -> str:
    rms_ratios = [draw_result["other"]["rms"] / max(draw_result["rms"], MIN_DEVIATION) for draw_result in draw_results
            if draw_result["loops"] == 1 and "other" in draw_result]  # fmt: skip
    return f"{_median(rms_ratios)}, worst {max(rms_ratios):.3g} ({len(rms_ratios)})" if rms_ratios else "-"


def _coverage_text(kind: str) -> Callable[[Sequence[DrawResult]], str]:
    def metric_text(draw_results: Sequence[DrawResult]) -> str:
        predicted_results = [
            draw_result for draw_result in draw_results if "promised" in draw_result and kind in draw_result
        ]
        is_inside = [
            draw_result["promised"][0] <= draw_result[kind]["mean"] <= draw_result["promised"][1]
            for draw_result in predicted_results
        ]
        return (
            f"{100.0 * float(np.mean(is_inside)):.0f} % of {len(predicted_results)}"
            if predicted_results
            else "-"
        )

    return metric_text


def _time_text(draw_results: Sequence[DrawResult]) -> str:
    seconds = [draw_result["seconds"] for draw_result in draw_results]
    return f"{_median(seconds)}/{max(seconds):.3g} s"


def _true_fraction(draw_results: Sequence[DrawResult], condition: Callable[[DrawResult], bool]) -> float:
    return float(np.mean([condition(draw_result) for draw_result in draw_results])) if draw_results else 1.0


def make_half_rows(half_name: str, draw_results: Sequence[DrawResult]) -> list[Row]:
    """Return the rows of some draws."""
    draw_results = add_known_ratios(draw_results)
    compared_results = [draw_result for draw_result in draw_results if "ratio" in draw_result]
    refused_results = [draw_result for draw_result in draw_results if "refused" in draw_result]
    predicted_results = [
        draw_result for draw_result in draw_results if "promised" in draw_result and "same" in draw_result
    ]

    def contains_error(draw_result: DrawResult) -> bool:
        low, high = draw_result["promised"]
        return bool(low <= draw_result["same"]["mean"] <= high)

    table: list[tuple[str, str, Callable[[Sequence[DrawResult]], str], bool | None]] = [
        (
            f"fit within {MAX_RATIO:g} times the best known with at most as many parameters",
            "all",
            _near_best_text,
            _true_fraction(compared_results, lambda one: bool(one["ratio"] <= MAX_RATIO)) == 1.0
            if compared_results
            else None,
        ),
        (
            "ratio of fit to best known with any number of parameters: median",
            "reported",
            _all_fits_ratio_text,
            None,
        ),
        ("unseen gaps, random reversals: mean/worst", "reported", _error_text("unseen"), None),
        ("ratio of errors, moving gap / fixed gaps: mean", "reported", _moving_ratio_text, None),
        ("cycles of 10 % about a bias: mean/worst", "reported", _error_text("small"), None),
        (
            "one loop only: ratio of rms on other records to that of the fit",
            "reported",
            _single_loop_ratio_text,
            None,
        ),
        (
            "predicted interval contains the true error, loops as measured",
            f">= {100.0 * TARGET_COVERAGE:.0f} %",
            _coverage_text("same"),
            _true_fraction(predicted_results, contains_error) >= TARGET_COVERAGE
            if predicted_results
            else None,
        ),
        (
            "predicted interval contains the error with random reversals",
            "reported",
            _coverage_text("unseen"),
            None,
        ),
    ]
    rows = [
        Row(f"search, {half_name}: {title}", target, _text_by_family(draw_results, metric_text), is_met)
        for title, target, metric_text, is_met in table
    ]
    total_seconds = sum(draw_result["seconds"] for draw_result in draw_results)
    return [
        *rows,
        Row(f"search, {half_name}: refused", "0", f"{len(refused_results)} of {len(draw_results)}",
            not refused_results),
        Row(f"search, {half_name}: processor time of identify, median/worst", "reported",
            _text_by_family(draw_results, _time_text), None, total_seconds),
    ]  # fmt: skip


def run_draws(numbers: Sequence[int], is_stored: bool) -> list[DrawResult]:
    """Run some draws; draws that may be inspected are written to a file after each one."""
    draw_results: list[DrawResult] = []
    for run_count, number in enumerate(numbers, start=1):
        result = measure(draw(number))
        draw_results.append(result)
        print(f"search: {run_count} of {len(numbers)}", file=sys.stderr, flush=True)
        if is_stored:
            RESULTS_FILE.parent.mkdir(exist_ok=True)
            text = json.dumps(add_known_ratios(draw_results), indent=1)
            RESULTS_FILE.write_text(text + "\n", encoding="utf-8")
    return draw_results


def rows() -> list[Row]:
    """Return all rows of both halves."""
    even, odd = (run_draws(range(first, DRAW_COUNT, 2), first == 0) for first in (0, 1))
    return [*make_half_rows("even half", even), *make_half_rows("unseen half", odd)]


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the rows of a part of the even half, or of both halves."""
    parser = argparse.ArgumentParser(description="Compare the search with the best known fits.")
    parser.add_argument("--every", type=int, help="use every N-th draw of the even half")
    parser.add_argument("--reveal", action="store_true", help="store the draws of the odd half too")
    options = parser.parse_args(arguments)
    warnings.simplefilter("ignore")
    if options.every:
        numbers = range(0, DRAW_COUNT, 2 * options.every)
        result_rows = make_half_rows("even half", run_draws(numbers, True))
    elif options.reveal:
        all_results = run_draws(range(DRAW_COUNT), True)
        halves = {"even half": all_results[::2], "odd half": all_results[1::2]}
        result_rows = [
            row for half, half_results in halves.items() for row in make_half_rows(half, half_results)
        ]
    else:
        result_rows = rows()
    for row in result_rows:
        print(f"{row.what}: {row.measured} ({row.reach}; met: {row.met})", flush=True)


if __name__ == "__main__":
    main()
