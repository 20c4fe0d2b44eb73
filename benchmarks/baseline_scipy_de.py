"""Fit a Jiles-Atherton model with SciPy's differential evolution, as a baseline without anhyst.

The baseline is the program that an experienced engineer would write in an afternoon to fit
``ferrite_mnzn/mnzn_hp_ferrite_4loops``. The forward model is ``dM/dH = chi/(1 - alpha*chi)`` with
``chi = max(0, sg*(M_an - M))/k + c*dM_an/dx`` (the law ``effective-field``). Compiled RK4 code
integrates two cycles to reach the steady state, and compares the third cycle with the data. The
optimiser runs with its recommended settings. ``python benchmarks/baseline_scipy_de.py [--seeds N]``
prints a table.

The baseline is optimised for speed:

- one ``exp`` for the Langevin function and its slope, and fast floating-point arithmetic
- the smallest number of RK4 steps for which the integration error does not affect the fit (the
  table repeats the best fit with 16 times as many steps)
- logarithms for scale parameters, no redundant parameter, and bounds estimated from the loops

The validity limits of the law are penalties of the optimiser.
"""

from __future__ import annotations

import argparse
import math
import os
import statistics
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.optimize import differential_evolution

from anhyst.support.numeric import FloatArray

Array = FloatArray
MU_0 = 4e-7 * math.pi
FILE = Path("ferrite_mnzn") / "mnzn_hp_ferrite_4loops.csv"
SUBSTEPS = 1
RISE = 32  # steps of the initial magnetisation curve: a quarter of a cycle
WARM_UP_CYCLES = 2
FAILED = 1e3  # T^2, cost of a parameter set whose curve has no finite slope

# M_s, a, k, c and alpha without redundancy; logarithms of the scale parameters k, a and M_s.
PARAMETER_BOUNDS: Mapping[str, tuple[float, float]] = {
    "log10 kappa = k/a": (-2.0, 1.0),
    "c": (0.0, 1.0),
    "alpha*M_s/a": (0.0, 3.0),  # at c = 3, the anhysteretic curve becomes vertical
    "log10 a [A/m]": (0.0, 2.0),  # the loops reach 80 A/m
    "log10 mu0*M_s [T]": (-0.7, 0.3),  # the largest B is 0.39 T
}


def _langevin(z: float) -> tuple[float, float]:
    """Return the Langevin function and its slope."""
    if abs(z) < 0.05:
        t = z * z
        return z * (1 / 3 - t * (1 / 45 - t * 2 / 945)), 1 / 3 - t * (1 / 15 - t * 2 / 189)
    e = math.exp(-2.0 * abs(z))
    coth = math.copysign((1.0 + e) / (1.0 - e), z)
    inverse = 1.0 / z
    return coth - inverse, 1.0 - coth * coth + inverse * inverse


_langevin_compiled: Callable[[float], tuple[float, float]] = njit(inline="always", fastmath=True)(_langevin)


def _slope(h: float, m: float, sign: float, kappa: float, c: float, w: float) -> float:
    """Return ``dm/dh`` for ``M_s = a = 1``; negative if the slope is not finite."""
    an, an_slope = _langevin_compiled(h + w * m)
    chi = max(0.0, sign * (an - m)) / kappa + c * an_slope
    remaining = 1.0 - w * chi
    return chi / remaining if remaining > 1e-9 else -1.0


_slope_compiled: Callable[..., float] = njit(inline="always", fastmath=True)(_slope)


def _misfit(
    parameters: Array, h_data: Array, b_data: Array, starts: NDArray[np.int64], substeps: int
) -> float:
    """Return the sum of squared errors of B over all loops, T^2; every loop starts at a peak."""
    kappa, c, w = 10.0 ** parameters[0], parameters[1], parameters[2]
    a, saturation = 10.0 ** parameters[3], 10.0 ** parameters[4]
    total = 0.0
    for loop in range(starts.size - 1):
        first_sample, last = starts[loop], starts[loop + 1]
        m = 0.0
        h = 0.0
        for i in range(first_sample - RISE, first_sample + (WARM_UP_CYCLES + 1) * (last - first_sample)):
            if i < first_sample:  # the initial curve, from the demagnetised state to the peak
                sample, target = first_sample, h_data[first_sample] / a * (i - first_sample + RISE + 1) / RISE
            else:
                sample = first_sample + (i - first_sample) % (last - first_sample)
                target = h_data[sample] / a
            step = (target - h) / substeps
            sign = 1.0 if step > 0.0 else -1.0
            for _ in range(substeps):
                k1 = _slope_compiled(h, m, sign, kappa, c, w)
                k2 = _slope_compiled(h + step / 2, m + step / 2 * k1, sign, kappa, c, w)
                k3 = _slope_compiled(h + step / 2, m + step / 2 * k2, sign, kappa, c, w)
                k4 = _slope_compiled(h + step, m + step * k3, sign, kappa, c, w)
                if min(k1, k2, k3, k4) < 0.0:
                    return FAILED
                m += step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
                h += step
            h = target
            if i >= first_sample + WARM_UP_CYCLES * (last - first_sample):
                error = MU_0 * h_data[sample] + saturation * m - b_data[sample]
                total += error * error
    return total if total < FAILED else FAILED


misfit: Callable[..., float] = njit(fastmath=True)(_misfit)


def load_loops(folder: Path | None = None) -> tuple[Array, Array, NDArray[np.int64]]:
    """Read field (A/m), flux density (T) and the index of the first sample of each loop."""
    if folder is None:
        data_folder = Path(__file__).resolve().parents[2] / "shared" / "data"
        folder = Path(os.environ.get("ANHYST_DATA", data_folder))
    loop, field, flux_density = np.loadtxt(folder / FILE, delimiter=",", skiprows=1).T
    starts = np.append(np.flatnonzero(np.diff(loop, prepend=-1.0)), loop.size)
    return field, flux_density, starts.astype(np.int64)


def run(
    seed: int,
    maxiter: int = 1000,
    bounds: Mapping[str, tuple[float, float]] = PARAMETER_BOUNDS,
    substeps: int = SUBSTEPS,
    folder: Path | None = None,
) -> dict[str, Any]:
    """Run one fit on one thread; the compilation time is not counted.

    Returns
    -------
    dict
        ``sum_of_squares`` (T^2), ``rms_percent`` (of the largest B), ``cpu_seconds``,
        ``evaluations``, ``parameters`` (in the order of `PARAMETER_BOUNDS`), ``history``: a list of
        ``(cpu_seconds, sum_of_squares)``, one entry for each new best.
    """
    field, flux_density, starts = load_loops(folder)
    misfit(np.array([0.0, 0.5, 1.0, 1.0, 0.0]), field, flux_density, starts, substeps)  # compile
    history: list[tuple[float, float]] = []
    lowest_error = math.inf
    evaluations = 0

    def objective(parameters: Array) -> float:
        nonlocal lowest_error, evaluations
        evaluations += 1
        error = misfit(parameters, field, flux_density, starts, substeps)
        if error < lowest_error:
            lowest_error = error
            history.append((time.process_time() - start_time, error))
        return error

    start_time = time.process_time()
    optimum = differential_evolution(
        objective,
        list(bounds.values()),
        strategy="best1bin",
        popsize=15,
        polish=True,
        maxiter=maxiter,
        rng=seed,
    )
    seconds = time.process_time() - start_time
    return {
        "sum_of_squares": float(optimum.fun),
        "rms_percent": 100 * math.sqrt(optimum.fun / field.size) / float(np.abs(flux_density).max()),
        "cpu_seconds": seconds,
        "evaluations": evaluations,
        "parameters": dict(zip(bounds, map(float, optimum.x), strict=True)),
        "history": history,
    }


def seconds_to_reach(result: Mapping[str, Any], sum_of_squares: float) -> float:
    """Return the processor time until a run reached a sum of squares, s; infinite if it did not."""
    times = (seconds for seconds, error in result["history"] if error <= sum_of_squares)
    return float(next(times, math.inf))


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seeds", type=int, default=10)
    field, flux_density, starts = load_loops()
    print("sums of squares in T^2, processor time in s\n")
    print("seed  best fit  16 x steps      rms  to 0.0227  to best + 0.1 %  whole run  evaluations")
    reach_seconds = []
    for seed in range(parser.parse_args().seeds):
        result = run(seed)
        lowest_sum = result["sum_of_squares"]
        reach_seconds.append([seconds_to_reach(result, error) for error in (0.0227, 1.001 * lowest_sum)])
        parameters = np.array([*result["parameters"].values()])
        fine_error = misfit(parameters, field, flux_density, starts, 16 * SUBSTEPS)
        print(
            f"{seed:4d}  {lowest_sum:.6f}    {fine_error:.6f}  {result['rms_percent']:.3f} %"
            f"  {reach_seconds[-1][0]:9.3f}  {reach_seconds[-1][1]:15.3f}"
            f"  {result['cpu_seconds']:9.3f}  {result['evaluations']:11d}"
        )
    median = [statistics.median(seed_seconds) for seed_seconds in zip(*reach_seconds, strict=True)]
    print(f"\nmedian: {median[0]:.3f} s to 0.0227 T^2, {median[1]:.3f} s to 0.1 % above the best fit")


if __name__ == "__main__":
    main()
