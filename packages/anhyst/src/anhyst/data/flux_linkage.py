"""Integrate the voltage of a coil to the flux linkage."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anhyst.data.estimates import estimate_noise
from anhyst.data.path import find_runs
from anhyst.data.recurrence import compare_states
from anhyst.support.numeric import FloatArray


@dataclass(frozen=True)
class Estimate:
    flux: FloatArray
    theta: FloatArray
    sigma: FloatArray
    flux_sigma: float
    closure: float
    coarse: float
    count: int
    chi2: float


def cumulate(clock, values):
    out = np.empty_like(values)
    out[0] = 0.0
    np.cumsum(0.5 * (values[1:] + values[:-1]) * np.diff(clock), out=out[1:])
    return out


def find_rests(drive: FloatArray) -> list[slice]:
    size = max(4, drive.size // 1000)
    count = drive.size // size
    means = drive[: count * size].reshape(count, size).mean(axis=1)
    span = float(np.ptp(drive))
    tol = 3e-4 * span + 4.0 * estimate_noise(drive) / size**0.5
    runs = find_runs(np.abs(np.diff(means)) <= tol)
    rests = []
    for run in runs:
        if run.stop - run.start < 6 or np.ptp(means[run.start + 2 : run.stop]) > 1.5 * tol+1e-3*span:
            continue
        start, stop = run.start * size, (run.stop + 1) * size
        start += (stop - start) // 4
        rests.append(slice(start, stop - size))
    return rests


def estimate(clock, drive, voltage, sense=False) -> Estimate:
    T = clock[-1] - clock[0]
    clock = clock - clock[0]
    heat = cumulate(clock, drive**2)
    heat /= heat[-1]
    if sense:
        basis = np.array([clock])
    else:
        basis = np.array([cumulate(clock, drive), cumulate(clock, heat * drive), clock])
    y = cumulate(clock, voltage)
    signals = np.concatenate([y[None], basis])
    diffs, count = compare_states(drive, signals)
    step = T / (clock.size - 1)
    su = estimate_noise(voltage)
    lsb = np.diff(np.unique(voltage))
    lsb = float(np.min(lsb)) if lsb.size else 0.0
    bias = lsb / 12**0.5 if su < 0.5 * lsb else 0.0
    rests = find_rests(drive)
    rrows = np.array([signals[:, r.stop - 1] - signals[:, r.start] for r in rests]).reshape(-1, signals.shape[0])
    dur = rrows[:, -1]
    urange = float(np.ptp(voltage))
    period = T / max(1, count / 2 + 1)
    sigma_c = sigma_r = None
    height = None
    for _ in range(3):
        if height is None:
            A = np.concatenate([diffs, rrows])
            w = np.ones(len(A))
        else:
            sc = np.hypot(3e-4 * height, su * (period * step) ** 0.5)
            sr = np.sqrt(su**2 * step * dur + (bias * dur) ** 2 + (1e-4 * height) ** 2)
            A = np.concatenate([diffs, rrows])
            w = np.concatenate([np.full(len(diffs), 1 / sc), 1 / sr])
        X, b = A[:, 1:] * w[:, None], A[:, 0] * w
        if height is not None:
            off = max(0.010, 0.002 * np.max(np.abs(voltage)))
            if sense:
                X = np.concatenate([X, [[1 / off]]]); b = np.append(b, 0)
            else:
                X = np.concatenate([X, [[0, 1 / (0.05 * abs(theta[0])), 0], [0, 0, 1 / off]]])
                b = np.append(b, [0, 0])
        scale = np.linalg.norm(X, axis=0)
        scale[scale == 0] = 1
        theta = np.linalg.lstsq(X / scale, b, rcond=1e-12)[0] / scale
        flux = y - theta @ basis
        height = float(np.ptp(flux))
    r = X @ theta - b
    dof = max(1, count + len(rests) - (1 if sense else 2))
    chi2 = float(r @ r) / dof
    cov = np.linalg.pinv(X.T @ X / np.outer(scale, scale)) / np.outer(scale, scale) * max(1.0, chi2)
    dev = basis - basis.mean(axis=1, keepdims=True)
    C = dev @ dev.T / clock.size
    flux_sigma = float(np.trace(cov @ C)) ** 0.5
    half = cumulate(clock[::2], voltage[::2])
    d = half - y[::2]
    d = d - d.mean()
    top = height / 2 if drive.min() < -0.5 * drive.max() else height
    nd = len(diffs)
    closure = float(np.sqrt(np.sum((diffs @ np.append(1, -theta)) ** 2) / max(1, count)))
    return Estimate(flux, theta, np.sqrt(np.diag(cov)), flux_sigma / top, closure / top, float(np.std(d)) / top, count, chi2)
