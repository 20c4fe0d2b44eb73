"""Measure force from loops of flux linkage on virtual magnets that are no law of anhyst.

    python benchmarks/flux.py 0 20 2             # even seeds below 20: may be inspected
    python benchmarks/flux.py 1 40 2 "no reading" "one reading"     # odd seeds: for the final test

The magnets, their records and their tests are those of ``flux_magnets``. Errors are relative to the
largest force of the tests of a magnet. The gap sensor in use has the zero error of the measurement,
except for the method "exact gap".
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass, replace
from functools import cached_property

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from anhyst.data.loops import Loops
from anhyst.data.path import History
from anhyst.identification import identify
from anhyst.identification.flux_force import ForceCalibration, read_calibration
from anhyst.model.actuator import Model
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from flux_baselines import ForceLaw, co_energy_laws, linear_inductance_law
from flux_magnets import UnseenDrive, draw_magnet, force_records, gap_zero_of, records, run_conditioned, tests
from flux_rig import voltage_records
from rows import Row, Stopwatch

MAGNET_COUNT = 10
"""Number of magnets of each half in the table of all benchmarks."""
READING_ERROR = 0.003
"""Relative error of the single force reading."""


@dataclass(frozen=True)
class Errors:
    """Errors of a method on a magnet, % of the largest force of the tests."""

    mean_at_rest: float
    worst_at_rest: float
    mean_moving: float
    worst_moving: float
    mean_of_gap: float
    """Mean error at rest, % of the largest force at the same gap."""
    stated_mean: float = np.nan
    stated_worst: float = np.nan
    """Uncertainty that the model states, % of its largest force; nan if it states none."""


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


class Case:
    """A virtual magnet with its measurements and tests."""

    def __init__(self, seed: int) -> None:
        self.seed, self.magnet = seed, draw_magnet(seed)
        self.drives = tests(self.magnet, gap_zero_of(seed))

    @cached_property
    def loops(self) -> Loops:
        """Loops of the flux linkage."""
        return records(self.magnet, self.seed)

    @cached_property
    def without_reading(self) -> Model:
        """Model from the flux linkage alone."""
        return identify(self.loops).model

    def by_law(self, law: ForceLaw) -> Errors:
        """Return the errors of a law without history."""
        return judge(lambda drive: law(drive.current, drive.gap), self.drives)

    def by_model(self, model: Model, drives: Sequence[UnseenDrive] | None = None) -> Errors:
        """Return the errors of a model of the force."""

        def predict(drive: UnseenDrive) -> FloatArray:
            return model.predict(drive.current, drive.gap, history=History.of(drive.conditioning)).output

        errors = judge(predict, drives or self.drives)
        if model.flux is None or model.flux.mean_uncertainty is None:
            return errors
        assert model.flux.worst_uncertainty is not None
        mean, worst = model.flux.mean_uncertainty, model.flux.worst_uncertainty
        return replace(errors, stated_mean=100.0 * mean, stated_worst=100.0 * worst)

    def reading(self) -> ForceCalibration | None:
        """Return one force reading at the smallest gap and the largest current."""
        gap, largest = self.magnet.gap_range[0], self.magnet.current_max
        rng = np.random.default_rng([20261135, self.seed])
        force = run_conditioned(self.magnet, largest * np.linspace(0.0, 1.0, 50), gap)[1][-1]
        table = {
            "I_A": [largest],
            "gap_m": [gap + gap_zero_of(self.seed)],
            "F_N": [force * (1.0 + READING_ERROR * rng.standard_normal())],
        }
        return read_calibration(table, None, None)

    def pole(self) -> ForceCalibration | None:
        """Return pole area and turns."""
        return read_calibration(None, self.magnet.single_gap_area, float(self.magnet.turns))


def _single_valued(case: Case) -> Errors:
    """Return the errors of the interpolation over the gap that is best for the tests."""
    errors = [case.by_law(law) for law in co_energy_laws(case.loops).values()]
    return min(errors, key=lambda error: error.mean_at_rest)


def _at_true_psi(case: Case) -> Errors:
    flux = case.without_reading.flux
    assert flux is not None
    return judge(lambda drive: flux.force(drive.psi, drive.gap), case.drives)


METHODS: dict[str, Callable[[Case], Errors]] = {
    "no reading": lambda case: case.by_model(case.without_reading),
    "one reading": lambda case: case.by_model(identify(case.loops, calibration=case.reading()).model),
    "pole area": lambda case: case.by_model(identify(case.loops, calibration=case.pole()).model),
    "voltage": lambda case: case.by_model(identify(voltage_records(case.magnet, case.seed)).model),
    "unknown zero": lambda case: case.by_model(
        identify(records(case.magnet, case.seed, zero="unknown")).model
    ),
    "exact gap": lambda case: case.by_model(case.without_reading, tests(case.magnet)),
    "true psi": _at_true_psi,
    "force loops": lambda case: case.by_model(identify(force_records(case.magnet, case.seed)).model),
    "single-valued table": _single_valued,
    "linear inductance": lambda case: case.by_law(linear_inductance_law(case.loops)),
}
"""Methods by name. The pole area of a cone says little; "true psi" is the map from psi to force."""


def measure(name: str, case: Case) -> Errors | None:
    """Return the errors of a method, or None if anhyst refuses the records."""
    try:
        return METHODS[name](case)
    except InputError as error:
        print(f"    refused: {error}", file=sys.stderr)
        return None


def summarise(found: Sequence[Errors | None]) -> str:
    """Return the median and the largest error of several magnets, and the coverage, if any is stated."""
    errors = [error for error in found if error is not None]
    if not errors:
        return f"{len(found)} refused"
    means, worsts, moving_means, moving_worsts, gap_means, stated_means, stated_worsts = np.array(
        [astuple(magnet_errors) for magnet_errors in errors]
    ).T
    text = (
        f"median {np.median(means):.2f}/{np.median(worsts):.1f}, worst magnet {means.max():.2f}/"
        f"{worsts.max():.1f}; moving {np.median(moving_means):.2f}/{np.median(moving_worsts):.1f}, "
        f"{moving_means.max():.2f}/{moving_worsts.max():.1f}; of each gap's largest "
        f"{np.median(gap_means):.2f}, {gap_means.max():.2f}"
    )
    if np.isfinite(stated_means).all():
        covered = 100.0 * np.mean(means <= stated_means), 100.0 * np.mean(worsts <= stated_worsts)
        text += f"; stated uncertainty covers the mean {covered[0]:.0f} %, the worst {covered[1]:.0f} %"
    return text + (f"; {len(found) - len(errors)} refused" if len(found) > len(errors) else "")


def rows() -> list[Row]:
    """Return a row for each method and half."""
    result_rows = []
    watch = Stopwatch()
    for half, name in enumerate(("even seeds", "odd seeds")):
        cases = [Case(seed) for seed in range(half, 2 * MAGNET_COUNT, 2)]
        result_rows += [
            Row(f"force from flux linkage, {method}, {name}: mean/worst error, % of F_max", "stated",
                summarise([measure(method, case) for case in cases]), None)
            for method in METHODS
        ]  # fmt: skip
    time = Row("force from flux linkage: computing time", "minutes", str(watch), None, watch.processor)
    return [*result_rows, time]


def main(numbers: Sequence[int], names: Sequence[str]) -> None:
    """Print the errors of each magnet and their summary."""
    errors: dict[str, list[Errors | None]] = {name: [] for name in names or METHODS}
    for seed in range(*numbers):
        case = Case(seed)
        print(f"{seed} {case.magnet.family}", flush=True)
        for name, found in errors.items():
            found.append(error := measure(name, case))
            if error is None:
                continue
            print(
                f"    {name}: {error.mean_at_rest:.2f}/{error.worst_at_rest:.1f}, moving "
                f"{error.mean_moving:.2f}/{error.worst_moving:.1f}, of each gap {error.mean_of_gap:.2f}, "
                f"stated {error.stated_mean:.2f}/{error.stated_worst:.1f}",
                flush=True,
            )
    for name, found in errors.items():
        print(f"{name}: {summarise(found)}")


if __name__ == "__main__":
    main([int(number) for number in sys.argv[1:4]], sys.argv[4:])
