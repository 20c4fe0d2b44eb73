"""Read and write the controller file: gains, limits, compensation, lift-off and landing.

All values are SI, with the unit in the key. docs/controller-file.md describes every key.
"""

# ruff: noqa: N815 - keys of the file carry units

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, Field, field_validator, model_validator

from anhyst.control.pidd2 import Gains, Pidd2, design
from anhyst.control.position import Levitation, PositionControl, PositionLimits, ReferenceConverter
from anhyst.support.atomic import PathLike, atomic_writer
from anhyst.support.block_words import Scales
from anhyst.support.errors import InputError
from anhyst.support.kinds import CONTROLLER_FILE, MethodName, NumberFormat
from anhyst.support.toml_file import (
    FileFault,
    NotNegative,
    Number,
    Positive,
    Share,
    Table,
    check_order,
    faults_error,
    read_toml,
)
from anhyst.support.toml_text import KeyPath, toml_value

Ticks = Annotated[int, Field(ge=0, le=65535)]

RELEASE_TIME_S = 0.1
"""Time in which the largest current decreases to zero when no controller is active, s."""

MIN_STEP_M = 1e-9
"""Smallest allowed value of `step_m`, the largest change of the gap per tick, m."""

DEFAULT_CONVERTER_BITS = 16
"""Bits of the converter of the current references, if the file has no [converter]."""


class DesignTable(Table):
    """``[design]``: gains from the design rule."""

    mass_kg: Positive
    bandwidth_Hz: Positive
    damping: Positive
    virtual_mass_kg: Number = 0.0

    @model_validator(mode="after")
    def _check_mass(self) -> Self:
        if not self.mass_kg + self.virtual_mass_kg > 0.0:
            text = "the sum of virtual_mass_kg and mass_kg is not above 0; raise it"
            raise InputError(text, code="virtual-mass-too-negative")
        return self


class GainsTable(Table):
    """``[gains]``: explicit gains."""

    K_p_N_per_m: Positive
    K_i_N_per_m_s: NotNegative
    K_d_N_s_per_m: NotNegative
    K_dd_N_s2_per_m: Number = 0.0


class FilterTable(Table):
    """``[filter]``: low-pass filters of the derivatives."""

    cutoff_Hz: Positive
    cutoff_2_Hz: Positive


class LimitsTable(Table):
    """``[limits]``: limits that do not depend on the gains."""

    force_low_N: Number
    force_high_N: Number
    current_low_A: Number
    current_high_A: Number
    gap_low_m: NotNegative
    gap_high_m: Positive
    step_m: Number

    @field_validator("step_m")
    @classmethod
    def _check_step(cls, step: float) -> float:
        if step < MIN_STEP_M:
            raise InputError(
                f"{step:g} m is below {MIN_STEP_M:g} m, less than the noise of any position sensor, so "
                "that no reading would be plausible; raise it",
                code="step-too-fine",
            )
        return step

    @model_validator(mode="after")
    def _check_order(self) -> Self:
        check_order("force_low_N", self.force_low_N, "force_high_N", self.force_high_N)
        check_order("current_low_A", self.current_low_A, "current_high_A", self.current_high_A)
        check_order("gap_low_m", self.gap_low_m, "gap_high_m", self.gap_high_m)
        return self


class CompensationTable(Table):
    """``[compensation]``: the method from a demanded force to a current."""

    variant: MethodName
    format: NumberFormat
    model: str | None = None
    applied: Literal["reference", "measured"] = "reference"


class ConverterTable(Table):
    """``[converter]``: digital-to-analogue converter of the current references."""

    low_A: Number
    high_A: Number
    bits: Annotated[int, Field(ge=4, le=20)]

    @model_validator(mode="after")
    def _check_order(self) -> Self:
        check_order("low_A", self.low_A, "high_A", self.high_A)
        return self


class PairTable(Table):
    """``[pair]``: a second magnet on the other side of the armature."""

    bias_force_N: Positive
    gap_total_m: Positive


class LiftOffTable(Table):
    """``[lift_off]``: the transition from the rest position to levitation."""

    force_rate_N_per_s: Positive
    detect_m: Positive
    speed_m_per_s: Positive


class LandingTable(Table):
    """``[landing]``: the return to the rest position."""

    speed_m_per_s: Positive
    force_rate_N_per_s: Positive


class SafetyTable(Table):
    """``[safety]``: behaviour without a valid position."""

    max_missing_samples: Ticks
    hold_ticks: Ticks


class ControllerTable(Table):
    """Content of a controller file."""

    format: Literal["anhyst-controller"]
    version: Literal[1]
    name: str
    rate_Hz: Annotated[float, Field(ge=100.0, le=200e3)]
    set_point_weight: Share
    design: DesignTable | None = None
    gains: GainsTable | None = None
    filter: FilterTable
    limits: LimitsTable
    compensation: CompensationTable
    lift_off: LiftOffTable
    landing: LandingTable
    safety: SafetyTable
    converter: ConverterTable | None = None
    pair: PairTable | None = None

    def pidd2_gains(self) -> Gains:
        """Return the gains, designed or as given in the file."""
        if self.gains is not None:
            gains = self.gains
            return Gains(gains.K_p_N_per_m, gains.K_i_N_per_m_s, gains.K_d_N_s_per_m, gains.K_dd_N_s2_per_m)
        rule = self.design
        if rule is None:
            text = "[design] and [gains] are both missing; add one of the two tables"
            raise InputError(text, code="missing", key="design")
        return design(rule.mass_kg, rule.bandwidth_Hz, rule.damping, rule.virtual_mass_kg)

    def pidd2(self) -> Pidd2:
        """Return the position controller that the file describes."""
        return Pidd2(
            rate=self.rate_Hz,
            **asdict(self.pidd2_gains()),
            **self._values_by_name("cutoff", "cutoff_2", "low", "high"),
            weight=self.set_point_weight,
        )

    def _values_by_name(self, *names: str) -> dict[str, Any]:
        """Return the values of the file for some names of :mod:`anhyst.control`."""
        file_keys = {name: _FILE_KEYS[name] for name in names}
        return {name: getattr(getattr(self, table), key) for name, (table, key) in file_keys.items()}

    def current_converter(self) -> ReferenceConverter:
        """Return the converter of the current references; it may be omitted in the file."""
        if (converter := self.converter) is not None:
            return ReferenceConverter(converter.low_A, converter.high_A, converter.bits)
        limits = self.limits
        return ReferenceConverter(limits.current_low_A, limits.current_high_A, DEFAULT_CONVERTER_BITS)

    def force_max(self, pair: PairTable | None) -> float:
        """Return the largest force of one magnet, N."""
        high = self.limits.force_high_N
        return high if pair is None else pair.bias_force_N + 0.5 * high

    def working_gaps(self, pair: PairTable | None, measured: tuple[float, float]) -> tuple[float, float]:
        """Return the gaps of either magnet for which its compensator is made.

        Beyond the measured gaps, a compensator uses the values of the nearest measured gap.
        """
        low, high = self.limits.gap_low_m, self.limits.gap_high_m
        if pair is not None:
            low, high = min(low, pair.gap_total_m - high), max(high, pair.gap_total_m - low)
        return max(low, measured[0]), min(high, measured[1])

    def position_control(
        self,
        scales: Scales,
        converter: ReferenceConverter,
        pair: PairTable | None,
        flux_full_scale: float = 1.0,
    ) -> PositionControl:
        """Return the position controller for compensators with given scales."""
        return PositionControl(
            pidd2=self.pidd2(),
            levitation=Levitation(
                **self._values_by_name("detect", "rise_speed", "descend_speed", "lift_rate", "set_down_rate")
            ),
            limits=PositionLimits(
                **self._values_by_name("gap_low", "gap_high", "step", "current_low", "current_high"),
                release=self.limits.current_high_A / RELEASE_TIME_S,
                max_missing_samples=self.safety.max_missing_samples,
                hold=self.safety.hold_ticks,
            ),
            converter=converter,
            scales=scales,
            bias=0.0 if pair is None else pair.bias_force_N,
            gap_total=None if pair is None else pair.gap_total_m,
            uses_measured_currents=self.compensation.applied == "measured",
            flux_full_scale=flux_full_scale,
        )


@dataclass(frozen=True, slots=True)
class ControllerFile:
    """A controller file with its content."""

    path: Path  # path of the file
    settings: ControllerTable  # content of the file

    @property
    def model(self) -> Path | None:
        """Model file of the compensator, or None if the file names no model."""
        model = self.settings.compensation.model
        return None if model is None else self.path.parent / model


def read_controller(path: PathLike) -> ControllerFile:
    """Read a controller file."""
    file = Path(path)
    settings = read_toml(file, ControllerTable, [CONTROLLER_FILE])
    if faults := _find_faults(settings):
        raise faults_error(file, faults)
    return ControllerFile(file, settings)


def _find_faults(settings: ControllerTable) -> list[FileFault]:
    faults: list[FileFault] = []
    if settings.design is not None and settings.gains is not None:
        text = "is given in addition to [design]; keep one of the two tables"
        faults.append(FileFault(("gains",), text, code="both-given"))
    if settings.design is None and settings.gains is None:
        text = "is missing, and so is [gains]; add one of the two tables"
        faults.append(FileFault(("design",), text, code="missing"))
    for key in ("cutoff_Hz", "cutoff_2_Hz"):
        cutoff = getattr(settings.filter, key)
        if cutoff >= settings.rate_Hz / 2.0:
            text = f"{cutoff:g} Hz is not below half of rate_Hz, {settings.rate_Hz / 2.0:g} Hz"
            faults.append(FileFault(("filter", key), f"{text}; lower it", code="above-half-rate"))
    limits = settings.limits
    if limits.current_low_A > 0.0:
        text = f"{limits.current_low_A:g} A is above 0, but the current is 0 at rest; lower it"
        faults.append(FileFault(("limits", "current_low_A"), text, code="zero-outside-range"))
    for key, unit, quantity in (("force_high_N", "N", "force"), ("current_high_A", "A", "current")):
        value = getattr(limits, key)
        if not value > 0.0:
            text = f"{value:g} {unit} is not above 0, but only a positive {quantity} lifts; raise it"
            faults.append(FileFault(("limits", key), text, code="not-above-zero"))
    return faults


_FILE_KEYS: Mapping[str, tuple[str, str]] = {
    **{name: ("limits", f"{name}_m") for name in ("step", "gap_low", "gap_high")},
    **{name: ("limits", f"{name}_A") for name in ("current_low", "current_high")},
    **{name: ("limits", f"force_{name}_N") for name in ("low", "high")},
    **{name: ("filter", f"{name}_Hz") for name in ("cutoff", "cutoff_2")},
    "detect": ("lift_off", "detect_m"),
    "rise_speed": ("lift_off", "speed_m_per_s"),
    "lift_rate": ("lift_off", "force_rate_N_per_s"),
    "descend_speed": ("landing", "speed_m_per_s"),
    "set_down_rate": ("landing", "force_rate_N_per_s"),
    "bits": ("converter", "bits"),
    "bias": ("pair", "bias_force_N"),
    "proportional": ("gains", "K_p_N_per_m"),
    "integral": ("gains", "K_i_N_per_m_s"),
    "derivative": ("gains", "K_d_N_s_per_m"),
    "second": ("gains", "K_dd_N_s2_per_m"),
    "back": ("gains", "K_i_N_per_m_s"),
}
"""Table and key of the file for each name of :mod:`anhyst.control`."""


@contextmanager
def error_at_key(file: ControllerFile) -> Iterator[None]:
    """Add file, line and key to errors that are raised while a controller is made from a file."""
    try:
        yield
    except InputError as error:
        name, _, text = str(error).partition(": ")
        key: KeyPath = _FILE_KEYS.get(name, ())
        if key[:1] == ("gains",) and file.settings.gains is None:
            key = ("design", "bandwidth_Hz")  # all gains increase with the bandwidth
            text = str(error)
        raise faults_error(
            file.path, [FileFault(key, text if key else str(error), code=error.code)]
        ) from error


TABLE_COMMENTS = {
    "design": "gains from mass, bandwidth and damping",
    "gains": "gains of the position controller",
    "filter": "low-pass filters of the first and of the second derivative",
    "limits": "limits that do not depend on the gains",
    "compensation": "method from a demanded force to a current",
    "lift_off": "force ramp until the armature leaves its rest position, then reference ramp",
    "landing": "reference ramp to the rest position, then force ramp to zero",
    "safety": "number of replaced samples; duration of the last current in a fault",
    "converter": "converter of the current references to the amplifiers",
    "pair": "a second magnet on the other side",
}


def write_controller(path: PathLike, settings: ControllerTable, note: str) -> None:
    """Write a controller file for people to read and edit; an error leaves no partial file."""
    with atomic_writer(path) as stream:
        stream.write(controller_text(settings, note))


def controller_text(settings: ControllerTable, note: str) -> str:
    """Return the text of a controller file; equal settings give the same text."""
    lines = [f"# {line}".rstrip() for line in note.splitlines()]
    lines.append("# Every key is described in docs/controller-file.md. All values are SI.")
    tables: list[str] = []
    for key in type(settings).model_fields:
        value = getattr(settings, key)
        if isinstance(value, BaseModel):
            tables += ["", f"[{key}]".ljust(20) + f"# {TABLE_COMMENTS[key]}", *_key_lines(value)]
        elif value is not None:
            lines.append(f"{key} = {toml_value(value)}")
    return "\n".join([*lines, *tables]) + "\n"


def _key_lines(table: BaseModel) -> list[str]:
    values = ((key, getattr(table, key)) for key in type(table).model_fields)
    return [f"{key} = {toml_value(value)}" for key, value in values if value is not None]
