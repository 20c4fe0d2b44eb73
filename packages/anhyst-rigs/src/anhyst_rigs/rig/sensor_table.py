"""Define ``[[sensor]]`` of a rig file: the measured quantity, the range, the noise and the errors.

Low pass, delay, noise and converter act on every reading in this order.
"""

# ruff: noqa: N815 - keys of the file carry units

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, Tag, model_validator

from anhyst._core import Sensor
from anhyst.compensate.coil_flux import CoilSensor
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray, first_order_share
from anhyst.support.toml_file import (
    BRANCH_PREFIX,
    Bits,
    NotNegative,
    Number,
    Positive,
    Table,
    check_order,
    discriminate_by,
)
from anhyst_rigs.rig.magnet_table import DirectionVector, PositionVector

GainError = Annotated[float, Field(gt=-0.5, lt=0.5)]


class DigitisedSensorTable(Table):
    """A sensor whose converter is simulated by the plant."""

    adc_bits: Bits | None = None

    def plant_parameters(self, seconds: float) -> dict[str, float]:
        """Return the fields of ``anhyst_plant_sensor`` for a time step, s.

        A key in the rig file is the name of the field with its unit.
        """
        fields = {key.rpartition("_")[0]: value for key, value in self if isinstance(value, float)}
        if (limit := fields.pop("range", None)) is not None:
            fields |= {"low": -limit, "high": limit}
        if "step" not in fields:
            assert self.adc_bits is not None
            fields["step"] = (fields["high"] - fields["low"]) / ((1 << self.adc_bits) - 1)
        low_pass, delay = 2.0 * math.pi * fields.pop("bandwidth"), fields.pop("delay", 0.0)
        fields["gain"] = 1.0 + fields.get("gain", 0.0)
        return {
            "offset": 0.0,
            **fields,
            "share": first_order_share(low_pass * seconds),
            "delay": round(delay / seconds),
        }


GAP_SENSOR_DEFAULTS: Mapping[str, Mapping[str, float]] = {
    "encoder": {"step_m": 50e-9, "noise_m": 5e-9, "bandwidth_Hz": 20e3, "delay_s": 0.0},
    "capacitive": {"step_m": 1e-9, "noise_m": 5e-9, "bandwidth_Hz": 5e3, "delay_s": 0.0},
    "laser": {"step_m": 1.25e-9, "noise_m": 1e-9, "bandwidth_Hz": 50e3, "delay_s": 12.5e-6},
    "lvdt": {"adc_bits": 16, "noise_m": 50e-9, "bandwidth_Hz": 500.0, "delay_s": 0.0},
}
"""Default values for each kind of gap sensor."""
_RESOLUTION_KEYS = {"step_m", "adc_bits"}


class GapSensorTable(DigitisedSensorTable):
    """``of = "gap"``: a gap sensor, whose kind gives the defaults of omitted keys."""

    of: Literal["gap"]
    kind: Literal["encoder", "capacitive", "laser", "lvdt"]
    low_m: NotNegative
    high_m: Positive
    step_m: Positive | None = None
    noise_m: NotNegative = 0.0
    bandwidth_Hz: Positive = math.inf
    delay_s: NotNegative = 0.0
    gain_error: GainError = 0.0
    offset_m: Number = 0.0

    @model_validator(mode="after")
    def _apply_defaults(self) -> Self:
        check_order("low_m", self.low_m, "high_m", self.high_m)
        if self.step_m is not None and self.adc_bits is not None:
            raise InputError("step_m and adc_bits both give the resolution; keep one", code="both-given")
        missing_keys = {*GAP_SENSOR_DEFAULTS[self.kind]} - self.model_fields_set
        if self.step_m is not None or self.adc_bits is not None:
            missing_keys -= _RESOLUTION_KEYS
        # Set without validation, because the defaults do not count as keys of the file.
        self.__dict__.update({key: GAP_SENSOR_DEFAULTS[self.kind][key] for key in missing_keys})
        return self

    @property
    def resolution(self) -> float:
        """Resolution, m."""
        return self.plant_parameters(1.0)["step"]


class CurrentSensorTable(DigitisedSensorTable):
    """``of = "current"``: shunts of all coils, which the controller reads."""

    of: Literal["current"]
    low_A: Number
    high_A: Number
    adc_bits: Bits
    noise_A: NotNegative
    bandwidth_Hz: Positive = math.inf
    gain_error: GainError = 0.0
    offset_A: Number = 0.0  # reading at zero current; the amplifier uses this reading too

    @model_validator(mode="after")
    def _check_limit_order(self) -> Self:
        check_order("low_A", self.low_A, "high_A", self.high_A)
        return self


class ForceSensorTable(DigitisedSensorTable):
    """``of = "force"``: a sensor for measuring loops; position controllers do not read it."""

    of: Literal["force"]
    low_N: Number
    high_N: Number
    adc_bits: Bits
    noise_N: NotNegative
    bandwidth_Hz: Positive

    @model_validator(mode="after")
    def _check_limit_order(self) -> Self:
        check_order("low_N", self.low_N, "high_N", self.high_N)
        return self


class FluxSensorTable(DigitisedSensorTable):
    """``of = "flux"``: Hall probes that measure the flux density in the gaps."""

    of: Literal["flux"]
    range_T: Positive
    adc_bits: Bits
    noise_T: NotNegative
    bandwidth_Hz: Positive
    gain_error: GainError = 0.0


class VoltageSensorTable(DigitisedSensorTable):
    """``of = "voltage"``: mean voltage of the winding or a sense coil in each sample, from which flux follows."""

    of: Literal["voltage"]
    range_V: Positive
    adc_bits: Bits
    noise_V: NotNegative
    offset_V: Number = 0.0
    gain_error: GainError = 0.0
    turns: Positive | None = None  # turns of a sense coil; None: the winding itself
    # relative error of the winding's resistance in the controller
    resistance_error: GainError = 0.0

    def plant_parameters(self, seconds: float) -> dict[str, float]:
        """Return the fields of ``anhyst_plant_sensor``; the mean of a tick needs no low-pass."""
        step = 2.0 * self.range_V / ((1 << self.adc_bits) - 1)
        limits = {"low": -self.range_V, "high": self.range_V, "step": step}
        errors = {"gain": 1.0 + self.gain_error, "offset": self.offset_V, "noise": self.noise_V}
        return limits | errors | {"share": 1.0, "delay": 0}

    def for_controller(self, resistance: float, current_delay: float) -> CoilSensor:
        """Return the sensor of the estimator, for the winding's resistance, ohm."""
        known_resistance = 0.0 if self.turns is not None else (1.0 + self.resistance_error) * resistance
        return CoilSensor(self.range_V, known_resistance, current_delay)


class PositionSensorTable(Table):
    """``of = "position"``: a sensor for the body's position in space, such as an interferometer."""

    of: Literal["position"]
    noise_m: NotNegative
    step_m: NotNegative = 0.0
    # only for stages: measured point of the body, and direction in which the reading increases
    position_m: PositionVector | None = None
    direction: DirectionVector | None = None
    # whether the head is fixed to the ground, so that its beam moves over the body
    stands: bool = False
    dead_path_m: NotNegative = 0.0  # length of this beam at the start of a motion
    # change of the refractive index of the air since the head was zeroed
    refraction_ppm: Number = 0.0

    @property
    def beam_gain_error(self) -> float:
        """Error of the reading divided by the length of the beam."""
        return 1e-6 * self.refraction_ppm

    @model_validator(mode="after")
    def _check_beam_keys(self) -> Self:
        if not self.stands and (self.dead_path_m or self.refraction_ppm):
            raise InputError(
                "dead_path_m and refraction_ppm are only for a beam from the ground; add "
                "stands = true, or remove them",
                code="missing",
            )
        return self


SensorEntry = Annotated[
    Annotated[GapSensorTable, Tag(f"{BRANCH_PREFIX}gap")]
    | Annotated[CurrentSensorTable, Tag(f"{BRANCH_PREFIX}current")]
    | Annotated[ForceSensorTable, Tag(f"{BRANCH_PREFIX}force")]
    | Annotated[FluxSensorTable, Tag(f"{BRANCH_PREFIX}flux")]
    | Annotated[VoltageSensorTable, Tag(f"{BRANCH_PREFIX}voltage")]
    | Annotated[PositionSensorTable, Tag(f"{BRANCH_PREFIX}position")],
    discriminate_by("of", "gap", "current", "force", "flux", "voltage", "position"),
]


class NoisySensor:
    """A sensor with noise from a seed, which is read sample by sample."""

    def __init__(self, parameters: Mapping[str, float], seed: list[int]) -> None:
        self._sensor, self._sigma = Sensor(parameters), parameters["noise"]
        self._rng = np.random.default_rng(seed)

    def noise(self, count: int) -> FloatArray:
        """Return the noise of the next samples, for callers that simulate the sensor themselves."""
        noise: FloatArray = self._sigma * self._rng.standard_normal(count)
        return noise

    def read(self, values: FloatArray) -> FloatArray:
        """Return the readings for the next samples of a quantity, shape (n,)."""
        return self._sensor.run(np.ascontiguousarray(values), self.noise(values.size))


Sensors = Mapping[str, NoisySensor]
"""Sensors by their quantity: ``current``, ``force`` and optionally ``gap`` and ``voltage``."""
