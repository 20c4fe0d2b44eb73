"""Measure force from loops of flux linkage on virtual magnets that are no law of anhyst.

    python benchmarks/flux.py 0 20 2      # even seeds below 20: may be inspected
    python benchmarks/flux.py 1 40 2      # odd seeds below 40: for the final test

The magnets, their records and their tests are those of ``flux_magnets``. Errors are relative to the
largest force of the tests of a magnet. The gap sensor in use has the zero error of the measurement,
except for the method "exact gap".
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from anhyst.data.path import History
from anhyst.identification import identify
from anhyst.support.numeric import FloatArray
from flux_baselines import ForceLaw, co_energy_laws, linear_inductance_law
from flux_magnets import UnseenDrive, draw_magnet, force_records, gap_zero_of, records, tests
from rows import Row, Stopwatch

MAGNET_COUNT = 10
"""Number of magnets of each half in the table of all benchmarks."""


@dataclass(frozen=True)
class Errors:
    """Errors of a method on a magnet, % of the largest force of the tests."""

    mean_at_rest: float
    worst_at_rest: float
    mean_moving: float
    worst_moving: float
    mean_of_gap: float
    """Mean error at rest, % of the largest force at the same gap."""


Prediction = Callable[[UnseenDrive], FloatArray]
"""Function of a drive to force, N."""


def judge(predict: Prediction, drives: Sequence[UnseenDrive]) -> Errors:
    """Compare the predicted with the true force."""
    largest = max(float(drive.force.max()) for drive in drives)
    errors = [100.0 * np.abs(predict(drive) - drive.force) for drive in drives]
    at_rest, moving = (
        np.concatenate([error for error, drive in zip(errors, drives, strict=True) if drive.moves == moves])
        for moves in (False, True)
    )
    means_of_gaps = [
        float(error.mean() / drive.force.max())
        for error, drive in zip(errors, drives, strict=True)
        if not drive.moves
    ]
    return Errors(
        float(at_rest.mean()) / largest,
        float(at_rest.max()) / largest,
        float(moving.mean()) / largest,
        float(moving.max()) / largest,
        float(np.mean(means_of_gaps)),
    )


def by_law(law: ForceLaw) -> Prediction:
    """Return the prediction of a law without history."""
    return lambda drive: law(drive.current, drive.gap)


def measure_magnet(seed: int) -> dict[str, Errors]:
    """Return the errors of each method on one magnet."""
    magnet = draw_magnet(seed)
    drives = tests(magnet, gap_zero_of(seed))
    loops = records(magnet, seed)
    table_errors = [judge(by_law(law), drives) for law in co_energy_laws(loops).values()]
    force_model = identify(force_records(magnet, seed)).model

    def predict_from_force(drive: UnseenDrive) -> FloatArray:
        return force_model.predict(drive.current, drive.gap, history=History.of(drive.conditioning)).output

    return {
        "force loops": judge(predict_from_force, drives),
        "single-valued table": min(table_errors, key=lambda errors: errors.mean_at_rest),
        "linear inductance": judge(by_law(linear_inductance_law(loops)), drives),
    }


def summarise(errors: Sequence[Errors]) -> str:
    """Return the median and the largest error of several magnets, at rest and moving."""
    means, worsts, moving_means, moving_worsts, gap_means = (
        np.array([getattr(magnet_errors, name) for magnet_errors in errors])
        for name in Errors.__dataclass_fields__
    )
    return (
        f"median {np.median(means):.2f}/{np.median(worsts):.1f}, worst magnet {means.max():.2f}/"
        f"{worsts.max():.1f}; moving {np.median(moving_means):.2f}/{np.median(moving_worsts):.1f}, "
        f"{moving_means.max():.2f}/{moving_worsts.max():.1f}; of each gap's largest "
        f"{np.median(gap_means):.2f}, {gap_means.max():.2f}"
    )


def rows() -> list[Row]:
    """Return a row for each method and half."""
    result_rows = []
    watch = Stopwatch()
    for half, name in enumerate(("even seeds", "odd seeds")):
        errors = [measure_magnet(seed) for seed in range(half, 2 * MAGNET_COUNT, 2)]
        result_rows += [
            Row(f"force from flux linkage, {method}, {name}: mean/worst error, % of F_max", "stated",
                summarise([magnet_errors[method] for magnet_errors in errors]), None)
            for method in errors[0]
        ]  # fmt: skip
    time = Row("force from flux linkage: computing time", "minutes", str(watch), None, watch.processor)
    return [*result_rows, time]


def main(first: int, end: int, step: int = 1) -> None:
    """Print the errors of each magnet and their summary."""
    errors = {}
    for seed in range(first, end, step):
        errors[seed] = measure_magnet(seed)
        figures = ", ".join(
            f"{method} {error.mean_at_rest:.2f}/{error.worst_at_rest:.1f} "
            f"({error.mean_moving:.2f}/{error.worst_moving:.1f}; {error.mean_of_gap:.2f})"
            for method, error in errors[seed].items()
        )
        print(f"{seed} {draw_magnet(seed).family}: {figures}", flush=True)
    for method in errors[first]:
        print(f"{method}: {summarise([magnet_errors[method] for magnet_errors in errors.values()])}")


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
