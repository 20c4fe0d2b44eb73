"""Displacements with loops of any form: never worse than a simple Preisach operator."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from anhyst.compensate.cells import cell_outputs
from anhyst.data import Loop, Loops
from anhyst.data.path import History
from anhyst.identification import IdentifyResult, identify
from anhyst.model.actuator import Model, read_model
from anhyst.support.numeric import FloatArray
from anhyst.support.units import QUANTITIES
from tests.oracles.preisach import Preisach

TOP = 100.0
STROKE = 50e-6
TOLERANCE = 1.1


def reversal_curves(low: float, high: float) -> list[float]:
    """Return reversals of first-order reversal curves."""
    return [low, *(end for back in np.linspace(high, low, 9)[1:] for end in (high, back)), high]


def decaying(low: float, high: float) -> list[float]:
    """Return reversals with an amplitude that decays around the middle."""
    middle, half = 0.5 * (low + high), 0.5 * (high - low)
    return [low, *(middle + sign * half * part for part in np.linspace(1.0, 0.15, 8)
                   for sign in (1.0, -1.0))]  # fmt: skip


def wandering(low: float, high: float) -> list[float]:
    """Return random reversals."""
    return [low, high, *np.random.default_rng(5).uniform(low, high, 18).tolist()]


def path(reversals: list[float], samples: int) -> FloatArray:
    """Return a drive at constant speed between reversals."""
    travel = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(reversals)))])
    return np.interp(np.linspace(0.0, travel[-1], samples), travel, reversals)


@dataclass(frozen=True)
class Actuator:
    """Relays with a density over their switching levels, relative to the range."""

    low: float
    density: Callable[[FloatArray, FloatArray], FloatArray]
    backlash: float = 0.0  # backlash of a tendon before a spring, relative to the range

    def displacement(self, drive: FloatArray) -> FloatArray:
        """Return the displacement from the low end of the range, m."""
        span = TOP - self.low
        if self.backlash:
            place, found = self.low + 0.5 * self.backlash * span, []
            for value in drive.tolist():
                reach = 0.5 * self.backlash * span
                place = min(max(place, value - reach), value + reach)
                found.append(place)
            part = (np.array(found) - self.low) / span
            return np.asarray(STROKE * (np.tanh(2.0 * part - 0.6) + np.tanh(0.6)))
        plane = Preisach(self.low, TOP, 120)
        up, down = ((level - self.low) / span for level in plane.relays)
        weights = self.density(up, down)
        switched = plane.states(drive) @ (weights / weights.sum())
        return np.asarray(0.5 * STROKE * (switched + 0.3 * (drive - self.low) / span))


def clustered(up: FloatArray, down: FloatArray) -> FloatArray:
    """Return similar relays: steep, wide loops that saturate."""
    density: FloatArray = 1.0 / (1.0 + ((up - 0.75) / 0.08) ** 2)
    density /= 1.0 + ((down - 0.35) / 0.08) ** 2
    return density


def uneven(up: FloatArray, down: FloatArray) -> FloatArray:
    """Return relays with loops that are wider at the top."""
    middle, width = (up + down - 1.3) / 0.3, (up - down - 0.2) / 0.12
    density: FloatArray = np.exp(-0.5 * (middle**2 + width**2))
    return density


ACTUATORS = {
    "clustered, both signs": Actuator(-TOP, clustered),
    "uneven, one sign": Actuator(0.0, uneven),
    "tendon": Actuator(0.0, uneven, backlash=0.15),
}


@dataclass(frozen=True)
class Trial:
    """Errors of a fit and of a simple Preisach operator, relative to the stroke."""

    result: IdentifyResult
    loop: Loop
    own: tuple[float, float]  # in the fitted record, and in another one
    plain: tuple[float, float]


def one_loop(drive: FloatArray, output: FloatArray) -> Loop:
    time = np.linspace(0.0, 0.01 * drive.size, drive.size)
    low = float(drive.min())
    return Loop("1", drive, output, None, time, History.parse(f"conditioned:{TOP:g},{low:g}"))


@cache
def trial(name: str, noise: float) -> Trial:
    actuator, rng = ACTUATORS[name], np.random.default_rng(2)
    fitted, other = (path(reversals(actuator.low, TOP), 1500) for reversals in (reversal_curves, wandering))
    if name == "tendon":
        fitted = path(decaying(actuator.low, TOP), 1500)
    measured = actuator.displacement(fitted)
    size = float(np.ptp(measured))
    measured = measured + noise * size * rng.standard_normal(measured.size)
    true = actuator.displacement(other)
    loop = one_loop(fitted, measured)
    loops = Loops((loop,), QUANTITIES["voltage"], QUANTITIES["displacement"], None)
    result = identify(loops)
    plane = Preisach(actuator.low, TOP)
    weights = plane.fitted(fitted, measured)

    def missed(made: FloatArray, wanted: FloatArray) -> float:
        return float(np.sqrt(np.mean((made - wanted) ** 2))) / size

    again = one_loop(other, true)
    predicted = result.model.predict(other, None, again.time, again.history).output
    return Trial(
        result,
        loop,
        (missed(result.fitted[0], measured), missed(predicted, true)),
        (missed(plane.predict(fitted, weights), measured), missed(plane.predict(other, weights), true)),
    )


@pytest.mark.parametrize("noise", [1e-3, 1e-2])
@pytest.mark.parametrize("name", ACTUATORS)
def test_identify_is_not_worse_than_a_preisach_grid(name: str, noise: float) -> None:
    found = trial(name, noise)
    assert found.own[0] <= TOLERANCE * found.plain[0]
    assert found.own[1] <= TOLERANCE * found.plain[1]


@pytest.mark.parametrize("name", ACTUATORS)
def test_identify_halves_the_error_of_a_preisach_grid_on_another_record(name: str) -> None:
    found = trial(name, 1e-3)
    assert found.own[1] <= 0.5 * found.plain[1]


def grid_model() -> Model:
    return trial("clustered, both signs", 1e-3).result.model


def test_candidates_name_the_grid_and_its_withheld_error() -> None:
    fit = grid_model().fit
    assert fit is not None
    few, grid = fit.candidates[-2:]
    assert "grid" in grid.law
    assert grid.note == "chosen"
    assert grid.left_out is not None
    assert few.left_out is not None
    assert grid.left_out < 0.5 * few.left_out


def test_model_file_keeps_the_grid(tmp_path: Path) -> None:
    model = grid_model()
    assert model.cells is not None
    assert model.cells.centres is not None
    model.save(tmp_path / "model.toml")
    assert read_model(tmp_path / "model.toml") == model


def test_inverse_returns_the_drive_of_a_prediction() -> None:
    found = trial("clustered, both signs", 1e-3)
    model, loop = found.result.model, found.loop
    model = replace(model, dynamics=None)
    output = model.predict(loop.input, None, loop.time, loop.history).output
    drive = model.invert(output, time=loop.time, history=loop.history).drive
    np.testing.assert_allclose(drive, loop.input, rtol=0, atol=1e-9 * TOP)


def test_weights_on_the_grid_are_rising_curves() -> None:
    cells = grid_model().cells
    assert cells is not None
    places = np.linspace(0.0, 2.0 * TOP, 200)
    each = cell_outputs(cells, np.broadcast_to(places, (cells.thresholds.size, 200)))
    assert np.diff(each, axis=1).min() >= -1e-12 * cells.saturation
    np.testing.assert_allclose(cell_outputs(cells, -places[None] * np.ones_like(each)), -each)


def test_noise_alone_does_not_call_for_a_grid() -> None:
    """If white noise explains the residual of few curves, no grid is tried."""
    drive = path(decaying(0.0, TOP), 1500)
    rng = np.random.default_rng(4)
    output = STROKE * np.tanh(drive / TOP) + 2e-3 * STROKE * rng.standard_normal(drive.size)
    loop = one_loop(drive, output)
    loops = Loops((loop,), QUANTITIES["voltage"], QUANTITIES["displacement"], None)
    fit = identify(loops).model.fit
    assert fit is not None
    assert not any("grid" in candidate.law for candidate in fit.candidates)
