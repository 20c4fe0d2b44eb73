"""Oscillator of Bouc and Wen with the parameters of the benchmark of Noel and Schoukens (2016).

``m y'' + c y' + k y + z = u`` and ``z' = alpha y' - beta (gamma |y'| |z|^(nu-1) z + delta y' |z|^nu)``
with ``nu = 1``, displacement ``y`` (m) and force ``u`` (N). Their data come from Newmark integration
at 15 kHz. Here, a Runge-Kutta method of the fourth order integrates at the same rate, and every 20th
sample is recorded.
"""

from __future__ import annotations

import math

import numpy as np

from ...records import FloatArray
from .drives import Drive, System, make_ramps

MASS_KG = 2.0
DAMPING = 10.0  # N s/m
STIFFNESS = 5e4  # N/m
ALPHA = 5e4  # N/m
BETA = 1e3  # 1/m
GAMMA = 0.8
DELTA = -1.1

RATE_HZ = 750
STEPS_PER_SAMPLE = 20
BAND_HZ = (5.0, 150.0)
MULTISINE_RMS_N = 50.0
SWEEP_N = 40.0
SWEEP_BAND_HZ = (20.0, 50.0)
SWEEP_SAMPLES = 1800
NOISE_M = 8e-6
"""Noise of the published estimation data, m rms."""

SLOW_STEP_N = 0.1
"""Longest step of the quasi-static integration, N."""
SLOW_FORCE_N = 160.0
SLOW_NOISE_M = 2e-6


def find_rates(state: tuple[float, float, float], force: float) -> tuple[float, float, float]:
    """Return the rates of displacement, velocity and hysteretic force."""
    y, v, z = state
    return (
        v,
        (force - DAMPING * v - STIFFNESS * y - z) / MASS_KG,
        ALPHA * v - BETA * (GAMMA * abs(v) * z + DELTA * v * abs(z)),
    )


def integrate(force: FloatArray, step: float) -> FloatArray:
    """Return the displacement from rest, m; the force is given at every half step."""
    y = v = z = 0.0
    values = force.tolist()
    displacement = np.empty(len(values) // 2)
    half_step = 0.5 * step
    for index in range(displacement.size):
        displacement[index] = y
        start, middle, end = values[2 * index : 2 * index + 3]
        k1 = find_rates((y, v, z), start)
        k2 = find_rates((y + half_step * k1[0], v + half_step * k1[1], z + half_step * k1[2]), middle)
        k3 = find_rates((y + half_step * k2[0], v + half_step * k2[1], z + half_step * k2[2]), middle)
        k4 = find_rates((y + step * k3[0], v + step * k3[1], z + step * k3[2]), end)
        y, v, z = (
            old + step / 6.0 * (a + 2.0 * b + 2.0 * c + d)
            for old, a, b, c, d in zip((y, v, z), k1, k2, k3, k4, strict=True)
        )
    return displacement


def make_multisine(samples: int, seed: int) -> FloatArray:
    """Return one period of a multisine with random phases, N."""
    lines = np.arange(samples // 2 + 1) * RATE_HZ / samples
    is_excited = (lines >= BAND_HZ[0]) & (lines <= BAND_HZ[1])
    phases = 2.0 * np.pi * np.random.default_rng(seed).random(int(is_excited.sum()))
    spectrum = np.zeros(lines.size, complex)
    spectrum[is_excited] = np.exp(1j * phases)
    signal = np.fft.irfft(spectrum)
    return np.asarray(MULTISINE_RMS_N * signal / np.sqrt(np.mean(signal**2)))


def make_sweep() -> FloatArray:
    """Return the linear sine sweep, N; it ends with a complete period."""
    time = np.arange(SWEEP_SAMPLES) / RATE_HZ
    start_rate, end_rate = SWEEP_BAND_HZ
    slope = (end_rate - start_rate) * RATE_HZ / SWEEP_SAMPLES
    return np.asarray(SWEEP_N * np.sin(2.0 * np.pi * time * (start_rate + 0.5 * slope * time)))


def respond_dynamically(drive: Drive) -> FloatArray:
    """Return the displacement from rest, m; the force between samples is band-limited."""
    density = 2 * STEPS_PER_SAMPLE
    spectrum = np.zeros(density * drive.input.size // 2 + 1, complex)
    spectrum[: drive.input.size // 2 + 1] = density * np.fft.rfft(drive.input)
    force = np.fft.irfft(spectrum)
    displacement = integrate(np.append(force, force[0]), 1.0 / (RATE_HZ * STEPS_PER_SAMPLE))
    return displacement[::STEPS_PER_SAMPLE]


def respond_slowly(drive: Drive) -> FloatArray:
    """Return the displacement if inertia and damping are negligible, m.

    The force is the independent variable: ``dy/du = 1/(k + dz/dy)``, and ``dz/dy`` depends on ``z``
    and on the direction.
    """
    y = z = force = 0.0
    displacement = np.empty(drive.input.size)
    for index, target in enumerate(drive.input.tolist()):
        count = math.ceil(abs(target - force) / SLOW_STEP_N)
        direction = 1.0 if target >= force else -1.0
        for _ in range(count):
            step = (target - force) / count
            middle = z + 0.5 * step * _find_share(z, direction)
            change = step * _find_share(middle, direction)
            z += change
            y += (step - change) / STIFFNESS
        displacement[index], force = y, target
    return displacement


def _find_share(z: float, direction: float) -> float:
    """Return the part of a change of the force that the hysteretic force takes."""
    slope = ALPHA - BETA * (GAMMA * direction * z + DELTA * abs(z))
    return slope / (STIFFNESS + slope)


def make_dynamic_system() -> System:
    """Return the driven oscillator."""
    inputs = {
        "multisine": make_multisine(4096, 531),
        "other-multisine": make_multisine(2048, 532),
        "sweep": make_sweep(),
    }
    drives = {name: Drive(force, None, np.arange(force.size) / RATE_HZ) for name, force in inputs.items()}
    return System(respond_dynamically, drives, NOISE_M, 533)


def make_slow_system() -> System:
    """Return the oscillator under a slow force."""
    rng = np.random.default_rng(541)
    points: dict[str, list[float]] = {
        "triangles-full": [0.0, *[1.0, -1.0] * 2, 0.0],
        "triangles-half": [0.0, *[0.5, -0.5] * 2, 0.0],
        "decreasing": [0.0, 1.0, -0.9, 0.75, -0.6, 0.45, -0.3, 0.15, 0.0],
        "positive-loops": [0.0, 1.0, 0.0, 0.7, 0.2, 0.9, -1.0, -0.2, -0.7, 0.0],
        "random-reversals": [0.0, *rng.uniform(-1.0, 1.0, 18).tolist()],
        "inner-cycles": [0.0, 1.0, *[0.35, 0.7] * 4, -1.0, *[-0.3, -0.65] * 4],
        "triangles-other": [0.0, *[-0.8, 0.8] * 3],
    }
    drives = {name: Drive(SLOW_FORCE_N * make_ramps(path, 60)) for name, path in points.items()}
    return System(respond_slowly, drives, SLOW_NOISE_M, 542)
