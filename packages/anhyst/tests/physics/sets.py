"""Provide random parameter sets and drives, equal in every run."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.optimize import brentq

from anhyst.support.numeric import FloatArray
from tests.oracles.effective_field import StepKind
from tests.oracles.iron import Iron, LawName
from tests.oracles.operator import DEMAGNETISED, LawState


class Case(NamedTuple):
    """A parameter set and the amplitude of the field to drive it with, A/m."""

    iron: Iron
    amplitude: float


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def random_cases(
    count: int,
    seed: int,
    *,
    law: LawName = "effective-field",
    step: StepKind = "exact",
    jumping: bool = False,
    play: bool = False,
) -> list[Case]:
    """Return sets of every kind: coupling, width of the loop and drive vary over decades.

    `jumping` sets have ``alpha*A`` above 1, so that the magnetisation jumps under a field.
    """
    rng = np.random.default_rng(seed)
    cases: list[Case] = []
    while len(cases) < count:
        m_s, a = log_uniform(rng, 1e4, 2e6), log_uniform(rng, 1.0, 1e4)
        kappa = log_uniform(rng, 0.1 if law == "jiles-atherton-1986" else 0.05, 5.0)
        c = float(rng.choice([0.0, rng.uniform(0.0, 0.9)], p=[0.1, 0.9]))
        if jumping:
            coupling = rng.uniform(1.05, 6.0)
        else:
            coupling = rng.choice([rng.uniform(-10.0, 0.0), rng.uniform(0.0, 0.95)])
        alpha = 3.0 * a * float(coupling) / m_s
        if alpha >= 1.0 or c * coupling > 0.95:
            continue
        r_d = a * kappa * rng.uniform(0.01, 0.5) if play else 0.0
        iron = Iron(m_s, a, kappa * a, c, alpha, r_d, law, step)
        amplitude = log_uniform(rng, 0.3, 30.0) * (a + max(-alpha, 0.0) * m_s / 3.0)
        # For smaller amplitudes the rounding of B alone exceeds 1e-9 of the amplitude of H.
        if amplitude > m_s / 3e5:
            cases.append(Case(iron, amplitude))
    return cases


def sine(amplitude: float, samples: int, cycles: int = 1) -> FloatArray:
    """Return whole cycles of a sine that starts after zero, with `samples` per cycle."""
    phase = 2.0 * np.pi * np.arange(1, samples * cycles + 1) / samples
    return np.asarray(amplitude * np.sin(phase))


def random_walk(amplitude: float, samples: int, seed: int) -> FloatArray:
    """Return random reversal points in the whole range: many reversals, steps of every size."""
    rng = np.random.default_rng(seed)
    return np.asarray(amplitude * rng.uniform(-1.0, 1.0, samples) * rng.uniform(0, 1, samples))


def wandered(iron: Iron, seed: int) -> LawState:
    """Return a random state inside the major loop."""
    rng = np.random.default_rng(seed)
    state = DEMAGNETISED
    for x in rng.normal(scale=3.0, size=6).tolist():
        state = iron.operator.step(state, x).state
    return state


def virgin_fold(iron: Iron) -> tuple[float, float] | None:
    """Return field/`a` (effective) and field (A/m) of the first jump on the initial curve."""
    law, weight = iron.operator, -iron.alpha * iron.m_s / iron.a
    places = np.linspace(0.01, 10.0, 500).tolist()
    slopes = [1.0 + weight * law.step(DEMAGNETISED, x).slope for x in places]
    for i in range(1, len(places)):
        if slopes[i - 1] > 0.0 > slopes[i]:
            x = float(
                brentq(lambda x: 1.0 + weight * law.step(DEMAGNETISED, x).slope, places[i - 1], places[i])
            )
            return x, iron.a * (x + weight * law.step(DEMAGNETISED, x).m)
    return None
