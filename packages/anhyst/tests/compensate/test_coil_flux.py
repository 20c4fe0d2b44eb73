"""Test the estimator that replaces a flux probe by the voltage of a coil, in every format."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest

from anhyst._core import FixedForceController, ForceController, ForceControllerF32
from anhyst.compensate.coil_flux import CoilFlux, CoilSensor
from anhyst.support.errors import InputError
from anhyst.support.kinds import NumberFormat
from anhyst.support.numeric import FloatArray, to_factor, to_q31, to_smoothing_factor

FORMATS: tuple[NumberFormat, ...] = ("f64", "f32", "fixed")
RATE, FORCE, CURRENT, FLUX = 10_000.0, 100.0, 4.0, 0.05
TICK = 1.0 / RATE
GAP = 0.4e-3
GAPS = (0.3e-3, 0.6e-3)
FULL_WANTED = 0.75  # flux of the largest force, relative to the full scale
LIMIT = 3.0  # A
LOOP = (0.0, 0.0, 0.2, 0.4)
"""Gains of the flux loop: without gains, the current stays that of the map."""
SENSE = CoilSensor(20.0, 0.0, 0.0)
WINDING = CoilSensor(20.0, 1.5, 1.5 * TICK)


@dataclass
class Controller:
    """A force controller with an estimator, in SI units."""

    format: NumberFormat
    coil: CoilFlux
    loop: tuple[float, ...] = LOOP

    def __post_init__(self) -> None:
        currents, wanted = np.tile(np.linspace(0.0, 3.6, 9), (2, 1)), np.tile([0.0, FULL_WANTED], (2, 1))
        if self.format == "fixed":
            words = [np.round(32767 * table).astype(np.int16) for table in (currents / CURRENT, wanted)]
            factors = [to_factor("gain", gain * FLUX / CURRENT) for gain in self.loop[:2]]
            factors += [to_factor("back", self.loop[2]), to_smoothing_factor("delay", self.loop[3])]
            codes = words[0], words[1], np.array(factors, dtype=np.int16), 0, to_q31(LIMIT / CURRENT)
            self.native: Any = FixedForceController.flux(*codes)
            self.native.sense(self.coil.codes(FLUX, CURRENT))
        else:
            made = ForceController if self.format == "f64" else ForceControllerF32
            self.native = made.flux(
                currents, FLUX * wanted, np.array(self.loop), 0.0, FORCE, *GAPS, 0.0, LIMIT
            )
            self.native.sense(self.coil.settings(FLUX, CURRENT))

    def tick(self, force: float, voltage: float, applied: float | None = None) -> float:
        """Solve and commit; return the current."""
        if self.format != "fixed":
            current: float = self.native.solve(force, GAP, voltage)
            self.native.commit(current if applied is None else applied, GAP)
            return current
        code = -(2**31) if math.isnan(voltage) else to_q31(voltage / self.coil.full_scale)
        solved = self.native.solve(to_q31(force / FORCE), to_q31((GAP - GAPS[0]) / (GAPS[1] - GAPS[0])), code)
        self.native.commit(solved if applied is None else to_q31(applied / CURRENT), 0)
        return float(solved / 2.0**31 * CURRENT)

    @property
    def estimate(self) -> FloatArray:
        """Flux of the law, estimated flux, offset in Wb per tick, resistance in ohm s."""
        values = np.array(self.native.estimate())
        return values * [FLUX, FLUX, FLUX, FLUX / CURRENT] if self.format == "fixed" else values


def settled(number_format: NumberFormat, gains: tuple[float, ...] = LOOP) -> Controller:
    """Return a controller that has reached 40 N; the voltage is that of the law's flux."""
    controller, last_flux = Controller(number_format, CoilFlux(SENSE, RATE, 0.01), gains), 0.0
    for n in range(600):
        flux = controller.estimate[0]
        controller.tick(40.0 * min(1.0, n / 400.0), (flux - last_flux) / TICK)
        last_flux = flux
    return controller


class Oracle:
    """The equations of coil_flux.h, from the flux of the law."""

    def __init__(self, coil: CoilFlux) -> None:
        self.settings = coil.settings(FLUX, CURRENT)
        self.deviation = self.offset = self.current = self.law = 0.0
        self.resistance, self.pull = self.settings[1], self.settings[9]
        self.doubt, self.is_running = 0, False

    def tick(self, law: float, voltage: float, applied: float, is_limited: bool) -> None:
        gain, nominal, spread, most, _, lag, limit, reach, full, pull, learning, large = self.settings
        if not (self.is_running and abs(voltage) < limit):
            self.deviation = 0.0
        else:
            drift = gain * voltage - self.resistance * self.current - self.offset - (law - self.law)
            teaching = self.current if abs(self.current) >= large else 0.0
            self.resistance += learning * self.pull * drift * teaching
            self.resistance = min(max(self.resistance, nominal - spread), nominal + spread)
            self.offset = min(max(self.offset + self.pull * drift, -most), most)
            self.pull = max(self.pull - self.pull**2, pull)
            self.deviation += drift
            if not is_limited:
                self.doubt = self.doubt + 1 if abs(self.deviation) >= reach else 0
                self.deviation *= 1.0 - self.pull * (2.0 * law / full) ** 2 - (self.pull - pull)
                if self.doubt == 32:
                    self.doubt, self.deviation, self.pull = 0, 0.0, 16.0 * pull
        self.law, self.is_running = law, True
        self.current += lag * (applied - self.current)


def drive(length: int, seed: int) -> tuple[FloatArray, FloatArray]:
    """Return forces and voltages of a motion with noise, offset, lost and limited readings."""
    rng = np.random.default_rng(seed)
    force = 45.0 + 35.0 * np.sin(2.0 * np.pi * np.arange(length) / rng.integers(150, 900))
    flux = FLUX * FULL_WANTED * np.sqrt(force / FORCE)
    voltage = np.gradient(flux) / TICK + 0.02 + rng.normal(0.0, 0.002, length)
    voltage[rng.integers(1, length, 3)] = np.nan
    voltage[rng.integers(1, length, 3)] = 20.0
    return force, voltage


@pytest.mark.parametrize("sensor", [SENSE, WINDING])
@pytest.mark.parametrize(("number_format", "bound"), [("f64", 1e-12), ("f32", 3e-5), ("fixed", 2e-6)])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_every_format_agrees_with_the_oracle(
    sensor: CoilSensor, number_format: NumberFormat, bound: float, seed: int
) -> None:
    """The bounds are relative to the full-scale flux, over 6000 ticks."""
    coil = CoilFlux(sensor, RATE, 0.01)
    controller, oracle = Controller(number_format, coil, (0.5, 0.02, 0.2, 0.4)), Oracle(coil)
    is_limited = False
    for force, voltage in zip(*(series.tolist() for series in drive(6000, seed)), strict=True):
        current = controller.tick(force, voltage)
        law, flux, offset, resistance = controller.estimate
        oracle.tick(law, voltage, current, is_limited)
        is_limited = bool(controller.native.flags & 7)
        assert abs(flux - law - oracle.deviation) < bound * FLUX
        assert abs(offset - oracle.offset) < bound * FLUX
        assert abs(resistance - oracle.resistance) < bound * FLUX / CURRENT


@pytest.mark.parametrize("number_format", FORMATS)
def test_the_voltage_gives_the_fast_changes_that_the_law_lacks(number_format: NumberFormat) -> None:
    """The true flux changes by 0.5 % for 20 ms, and the law does not."""
    controller = settled(number_format)
    law, flux, *_ = controller.estimate
    for n in range(200):
        controller.tick(40.0, 0.005 * law * RATE if n == 0 else 0.0)
    assert controller.estimate[1] - flux == pytest.approx(0.005 * law, rel=0.1)


@pytest.mark.parametrize("number_format", FORMATS)
def test_solving_again_integrates_the_voltage_once(number_format: NumberFormat) -> None:
    controller = Controller(number_format, CoilFlux(SENSE, RATE, 0.01))
    arguments = (0.4, 0.4e-3, 1.0) if number_format != "fixed" else (to_q31(0.4), to_q31(0.3), to_q31(0.05))
    controller.tick(40.0, 0.0)
    first = controller.native.solve(*arguments), controller.estimate.tolist()
    assert (controller.native.solve(*arguments), controller.estimate.tolist()) == first


@pytest.mark.parametrize("number_format", FORMATS)
def test_ten_minutes_at_rest_do_not_drift(number_format: NumberFormat) -> None:
    """An offset of 5 mV, noise of 1 mV, and a third of the largest flux; 1 kHz."""
    controller = Controller(number_format, CoilFlux(SENSE, 1000.0, 0.01))
    noise = np.random.default_rng(4).normal(5e-3, 1e-3, 600_000)
    deviations = []
    for n, voltage in enumerate(noise.tolist()):
        controller.tick(20.0, voltage)
        if n >= 60_000 and n % 500 == 0:
            law, flux, offset, _ = controller.estimate
            deviations.append(flux - law)
            assert offset * 1000.0 == pytest.approx(5e-3, abs=3e-4)
    assert max(map(abs, deviations)) < 5e-3 * FLUX
    assert abs(np.mean(deviations[-100:])) < 1e-3 * FLUX


@pytest.mark.parametrize("number_format", FORMATS)
@pytest.mark.parametrize("error", [-0.2, 0.2])
def test_the_resistance_of_a_winding_is_learned(number_format: NumberFormat, error: float) -> None:
    """The controller's resistance is wrong by 20 %; the current swings between 0.3 and 2.9 A."""
    coil = CoilFlux(CoilSensor(20.0, (1.0 + error) * 1.5, 0.0), RATE, 0.01)
    controller, current, last_flux = Controller(number_format, coil), 0.0, 0.0
    for n in range(60_000):
        force = 45.0 - 35.0 * math.cos(2.0 * math.pi * n / 1500.0)
        flux = controller.estimate[0]
        controller.tick(force, 1.5 * current + (flux - last_flux) / TICK)
        last_flux, current = flux, 3.6 * force / FORCE
    assert controller.estimate[3] * RATE == pytest.approx(1.5, rel=0.02)


@pytest.mark.parametrize("number_format", FORMATS)
def test_a_missing_voltage_gives_the_flux_of_the_law(number_format: NumberFormat) -> None:
    controller = Controller(number_format, CoilFlux(SENSE, RATE, 0.01))
    for voltage in (0.0, 0.5, 0.5, math.nan):
        controller.tick(40.0, voltage)
    law, flux, *_ = controller.estimate
    assert flux == law


@pytest.mark.parametrize("number_format", FORMATS)
def test_a_saturation_only_integrates_the_voltage(number_format: NumberFormat) -> None:
    """While the current is limited, the law demands more flux than there is, and does not pull."""
    controller = settled(number_format, (0.0, 0.0, 0.0, 0.4))
    held = controller.estimate[1]
    for _ in range(500):
        controller.tick(99.0, 0.0)
    assert controller.native.flags & 2
    assert controller.estimate[1] == pytest.approx(held, rel=2e-2)
    for _ in range(500):
        controller.tick(40.0, 0.0)
    assert controller.estimate[1] == pytest.approx(held, rel=2e-2)


def test_only_a_controller_with_a_flux_loop_accepts_a_coil() -> None:
    coil = CoilFlux(SENSE, RATE, 0.01)
    single_valued = ForceController.map(np.tile([0.0, 3.0], (2, 1)), 0.0, FORCE, *GAPS, 0.0, LIMIT)
    with pytest.raises(ValueError, match="not valid"):
        single_valued.sense(coil.settings(FLUX, CURRENT))


@pytest.mark.parametrize("index", range(12))
def test_a_setting_that_is_no_number_is_rejected(index: int) -> None:
    controller = Controller("f64", CoilFlux(WINDING, RATE, 0.01))
    settings = controller.coil.settings(FLUX, CURRENT)
    settings[index] = math.nan
    with pytest.raises(ValueError, match="not valid"):
        controller.native.sense(settings)


def test_a_rate_too_low_for_the_voltage_is_rejected() -> None:
    coil = CoilFlux(CoilSensor(500.0, 0.0, 0.0), 1000.0, 0.01)
    with pytest.raises(InputError, match="raise the rate"):
        coil.codes(FLUX, CURRENT)
