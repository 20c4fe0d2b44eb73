"""The learned models: golden vectors of PyTorch, properties by construction, and their records."""

from __future__ import annotations

import importlib.util
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from zoo.model import Model, Refusal
from zoo.models import _learned as learned
from zoo.models import differentiable_preisach, gru, play_network
from zoo.models._learned import Arrays, LearnedModel, key_of
from zoo.models._signals import Scaling, by_travel, split
from zoo.records import FloatArray, Record
from zoo.task import read_task

STATE_SIZE, FEATURES, STEPS = 3, 2, 40

# States after the first and the last step, and outputs of two samples, as PyTorch computes them.
GRU_GOLDEN = np.array(
    [
        [0.009634578668734961, -0.17188465374459183, 0.10118345142896992],
        [-0.7610526073347876, -0.6226421107525145, -0.24999381552422237],
    ]
)
PLAY_GOLDEN = np.array([2.0636542528411117, -2.437283290687909])
FILTER_GOLDEN = np.array([0.3969385478887777, -0.8931615361071907])


def wave(*shape: int, factor: float = 1.0) -> FloatArray:
    """Return numbers without a pattern, the same on every machine."""
    values: FloatArray = np.sin(factor * (1.0 + np.arange(np.prod(shape))) ** 1.3)
    return values.reshape(shape)


def gru_arrays() -> Arrays:
    return {
        "weight_ih": wave(3 * STATE_SIZE, FEATURES),
        "weight_hh": wave(3 * STATE_SIZE, STATE_SIZE, factor=0.7),
        "bias_ih": wave(3 * STATE_SIZE, factor=0.4),
        "bias_hh": wave(3 * STATE_SIZE, factor=0.3),
        "h0": wave(STATE_SIZE, factor=0.2),
    }


def play_arrays(factor: float = 1.0) -> Arrays:
    return {
        "log_increments": 0.5 * wave(4, factor=factor) - 2.0,
        "rest": 0.3 * wave(1, factor=factor),
        "log_weight": wave(5, 6, factor=0.9 * factor) - 1.0,
        "bias": wave(6, factor=0.8 * factor),
        "log_out": wave(6, factor=0.7 * factor) - 1.0,
        "log_direct": wave(5, factor=0.6 * factor) - 3.0,
        "output": np.array([0.0, 1.0, 0.0]),
    }


def filter_arrays(key: str) -> Arrays:
    return {
        f"log_rate_{key}": np.array([-3.0, -1.0]),
        f"quality_{key}": np.array([0.0, 2.0]),
        f"gain_{key}": np.array([[0.3, 0.2], [0.1, -0.2]]),
    }


def cycle(samples: int = 160) -> FloatArray:
    """Return a closed cycle with a minor loop."""
    turns = np.array([-1.0, 0.9, -0.2, 0.4, -1.0])
    u: FloatArray = np.interp(np.arange(samples) / samples * 4.0, np.arange(5.0), turns)
    return u


def run_play(arrays: Arrays, u: FloatArray, steps: FloatArray | None = None) -> FloatArray:
    result: FloatArray = play_network.run_network(np, arrays, u, steps, [(0, u.size)], np.arange(u.size))
    return result


def test_gru_agrees_with_golden_vector() -> None:
    states = gru.run_gru(gru_arrays(), wave(STEPS, FEATURES, factor=0.9))
    assert np.allclose(states[[0, -1]], GRU_GOLDEN, rtol=0.0, atol=1e-12)


def test_play_network_agrees_with_golden_vector() -> None:
    arrays = play_arrays() | filter_arrays("before") | filter_arrays("behind")
    u = np.tile(cycle(), 2)
    assert np.allclose(run_play(arrays, u)[[30, -1]], PLAY_GOLDEN, rtol=0.0, atol=1e-12)
    assert np.allclose(run_play(arrays, u, np.ones(u.size))[[30, -1]], FILTER_GOLDEN, rtol=0.0, atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_play_network_dissipates_and_rises_with_any_parameters(seed: int) -> None:
    rng = np.random.default_rng(seed)
    turns = rng.uniform(-1.0, 1.0, 9)
    u = np.tile(np.interp(np.arange(900) / 100.0, np.arange(10.0), np.append(turns, turns[0])), 3)
    z = run_play(play_arrays(1.0 + 0.37 * seed), u)
    assert np.all(np.diff(z) * np.sign(np.diff(u)) > 0.0)
    assert np.allclose(z[900:1800], z[1800:], rtol=0.0, atol=1e-12)
    closed_u, closed_z = np.append(u[1800:], u[1800]), np.append(z[1800:], z[1800])
    loss = np.sum((closed_u[1:] + closed_u[:-1]) / 2.0 * np.diff(closed_z))
    assert loss > 0.0


@pytest.mark.parametrize(
    ("factory", "gap"),
    [
        (differentiable_preisach.MODELS["differentiable Preisach"], 1e-9),
        (gru.MODELS["GRU"], 0.02),
        (play_network.MODELS["play network"], 1e-9),
    ],
)
def test_recorded_model_closes_settled_cycles(factory: Any, gap: float) -> None:
    training = read_task("tellinen-magnet").training
    model: Model = factory()
    model.fit(training)
    assert model.recorded_fit_s > 0.0  # type: ignore[attr-defined]
    record = training[0]
    repeated_record = replace(
        record,
        input=np.tile(record.input, 2),
        output=np.full(2 * record.input.size, np.nan),
        schedule=None if record.schedule is None else np.tile(record.schedule, 2),
    )
    first, second = model.predict(repeated_record).reshape(2, -1)
    assert np.max(np.abs(first - second)) <= gap * np.ptp(first)
    assert np.sqrt(np.mean((first - record.output) ** 2)) < 0.05 * np.ptp(record.output)


def test_missing_record_without_torch_is_a_refusal(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(learned, "FOLDER", tmp_path)
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    model: LearnedModel = gru.Gru()
    with pytest.raises(Refusal, match=r'install torch, then .* train --model "GRU"'):
        model.fit([Record("loop", cycle(), cycle())])


def test_key_changes_with_the_training_records() -> None:
    record = Record("loop", cycle(), cycle())
    changed = replace(record, output=record.output + 1e-3 * cycle() ** 2)
    rounded = replace(record, output=record.output * (1.0 + 1e-15))
    assert key_of([record], "1") == key_of([rounded], "1")
    assert len({key_of([record], "1"), key_of([changed], "1"), key_of([record], "2")}) == 3


def test_path_by_travel_keeps_reversals_and_samples() -> None:
    u = np.tile(cycle(), 2)
    travel = by_travel(u, 0.05)
    steps = travel.input
    assert np.max(np.abs(np.diff(steps))) < 0.05 + 1e-12
    assert {-1.0, 0.9} <= set(np.round(steps, 12))
    following = np.minimum(travel.before + 1, steps.size - 1)
    again = steps[travel.before] * (1.0 - travel.fraction) + steps[following] * travel.fraction
    assert np.allclose(again, u, atol=1e-12)


def test_warp_is_inverted_and_withheld_pieces_are_not_trained() -> None:
    u = 300.0 * cycle()
    record = Record("loop", u, np.tanh(u / 30.0))
    scaling = Scaling.of([record])
    scaled = scaling.scale_input(u)
    assert np.allclose(scaling.unwarp(scaling.warp(scaled)), scaled, atol=1e-9)
    training, validation = split(record)
    assert training.sum() == pytest.approx(1.0)
    assert validation.sum() == pytest.approx(1.0)
    assert not np.any((training > 0.0) & (validation > 0.0))
