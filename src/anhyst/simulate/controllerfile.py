"""The controller file: gains, limits, compensation, lift-off and landing.

Everything is SI and the unit stands in the key. Every key is described in docs/controller-file.md.
"""

# ruff: noqa: N815 - keys of the file carry units

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import BaseModel, Field, model_validator

from anhyst.atomic import PathLike, atomic_writer
from anhyst.control.design import Gains, design
from anhyst.control.pidd2 import Pidd2
from anhyst.errors import InputError
from anhyst.rig.rigfile import NotNegative, Number, Positive, Share
from anhyst.rig.tomlfile import Table, faults_error, read_toml
from anhyst.simulate.rigfile import BearingRig, Fault, step_ends
from anhyst.tomltext import toml_value

Variant = Literal["ratio", "ratio-chord", "linearised", "static", "simplified", "full", "flux"]
Format = Literal["f64", "f32", "fixed"]
Ticks = Annotated[int, Field(ge=0, le=1_000_000)]


class DesignTable(Table):
    """``[design]``: gains by the design rule."""

    mass_kg: Positive
    bandwidth_Hz: Positive
    damping: Positive
    virtual_mass_kg: Number = 0.0

    @model_validator(mode="after")
    def _massive(self) -> Self:
        if not self.mass_kg + self.virtual_mass_kg > 0.0:
            raise ValueError("virtual_mass_kg takes away all of mass_kg; raise it")
        return self


class GainsTable(Table):
    """``[gains]``: gains as they are."""

    K_p_N_per_m: Positive
    K_i_N_per_m_s: NotNegative
    K_d_N_s_per_m: NotNegative
    K_dd_N_s2_per_m: Number = 0.0


class FilterTable(Table):
    """``[filter]``: low-passes of the derivatives."""

    cutoff_Hz: Positive
    cutoff_2_Hz: Positive


class LimitsTable(Table):
    """``[limits]``: what holds whatever the gains are."""

    force_low_N: Number
    force_high_N: Number
    current_low_A: Number
    current_high_A: Number
    gap_low_m: NotNegative
    gap_high_m: Positive
    step_m: Positive

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        for low, high in (
            ("force_low_N", "force_high_N"),
            ("current_low_A", "current_high_A"),
            ("gap_low_m", "gap_high_m"),
        ):
            if not getattr(self, low) < getattr(self, high):
                raise ValueError(f"{low} must be below {high}; correct them")
        return self


class CompensationTable(Table):
    """``[compensation]``: what turns a wanted force into a current."""

    variant: Variant
    format: Format
    model: str | None = None
    applied: Literal["reference", "measured"] = "reference"


class LiftOffTable(Table):
    """``[lift_off]``: from the rest position into the air."""

    force_rate_N_per_s: Positive
    detect_m: Positive
    speed_m_per_s: Positive


class LandingTable(Table):
    """``[landing]``: back to rest."""

    speed_m_per_s: Positive
    force_rate_N_per_s: Positive


class SafetyTable(Table):
    """``[safety]``: what is done without a position."""

    patience_ticks: Ticks
    hold_ticks: Ticks


class ControllerTable(Table):
    """The whole file."""

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

    def law(self) -> Gains:
        """Return the gains, designed or as they stand.

        Raises
        ------
        InputError
            If there are none.
        """
        if self.gains is not None:
            gains = self.gains
            return Gains(
                K_p=gains.K_p_N_per_m,
                K_i=gains.K_i_N_per_m_s,
                K_d=gains.K_d_N_s_per_m,
                K_dd=gains.K_dd_N_s2_per_m,
            )
        rule = self.design
        if rule is None:
            raise InputError("neither [design] nor [gains] is there; add one of the two tables")
        return design(rule.mass_kg, rule.bandwidth_Hz, rule.damping, rule.virtual_mass_kg)

    def pidd2(self) -> Pidd2:
        """Return the position controller that the file describes."""
        gains = self.law()
        return Pidd2(
            rate=self.rate_Hz,
            K_p=gains.K_p,
            K_i=gains.K_i,
            K_d=gains.K_d,
            K_dd=gains.K_dd,
            cutoff=self.filter.cutoff_Hz,
            cutoff_2=self.filter.cutoff_2_Hz,
            weight=self.set_point_weight,
            low=self.limits.force_low_N,
            high=self.limits.force_high_N,
        )


@dataclass(frozen=True, slots=True)
class ControllerFile:
    """A controller as its file describes it.

    Parameters
    ----------
    path : Path
        The file.
    settings : ControllerTable
        What it says.
    """

    path: Path
    settings: ControllerTable

    @property
    def model(self) -> Path | None:
        """Model file of the compensator, if one is named."""
        model = self.settings.compensation.model
        return None if model is None else self.path.parent / model


def read_controller(path: PathLike) -> ControllerFile:
    """Read a controller file.

    Parameters
    ----------
    path : path-like
        ``controller.toml``; other files are named relative to it.

    Returns
    -------
    ControllerFile
        Its keys fit the schema and each other.

    Raises
    ------
    InputError
        The file cannot be read or does not fit; with file, line and key.
    """
    place = Path(path)
    settings = read_toml(place, ControllerTable)
    faults = _own_faults(settings)
    if faults:
        raise faults_error(place, faults)
    return ControllerFile(place, settings)


def check_controller(controller: ControllerFile, rig: BearingRig) -> None:
    """Refuse a controller that does not belong to the rig.

    Parameters
    ----------
    controller : ControllerFile
        Named in the error.
    rig : BearingRig
        What it is to control.

    Raises
    ------
    InputError
        Another rate, limits beyond the amplifier, a reference or the rest outside the limits,
        force limits of the wrong arrangement, measured flux without a probe.
    """
    faults = _rig_faults(controller.settings, rig)
    if faults:
        raise faults_error(controller.path, faults)


def _own_faults(settings: ControllerTable) -> list[Fault]:
    faults: list[Fault] = []
    if settings.design is not None and settings.gains is not None:
        faults.append((("gains",), "stands beside [design]; keep one of the two tables"))
    if settings.design is None and settings.gains is None:
        faults.append((("design",), "is missing, and so is [gains]; add one of the two tables"))
    for key in ("cutoff_Hz", "cutoff_2_Hz"):
        cutoff = getattr(settings.filter, key)
        if cutoff >= settings.rate_Hz / 2.0:
            text = f"{cutoff:g} Hz is not below half of rate_Hz, {settings.rate_Hz / 2.0:g} Hz"
            faults.append((("filter", key), f"{text}; lower it"))
    return faults


def _rig_faults(settings: ControllerTable, rig: BearingRig) -> list[Fault]:
    faults: list[Fault] = []
    rate, plant = rig.settings.timing.rate_Hz, rig.settings
    if settings.rate_Hz != rate:
        text = f"is {settings.rate_Hz:g} Hz here and {rate:g} Hz in {rig.path}; make them equal"
        faults.append((("rate_Hz",), text))
    limits, amplifier = settings.limits, plant.amplifier
    if limits.current_low_A < amplifier.current_low_A:
        text = f"the amplifier of {rig.path} begins at {amplifier.current_low_A:g} A; raise it"
        faults.append((("limits", "current_low_A"), text))
    if limits.current_high_A > amplifier.current_high_A:
        text = f"the amplifier of {rig.path} ends at {amplifier.current_high_A:g} A; lower it"
        faults.append((("limits", "current_high_A"), text))
    if plant.magnet.arrangement == "single" and limits.force_low_N < 0.0:
        text = "a single magnet cannot push; raise it to 0 or more"
        faults.append((("limits", "force_low_N"), text))
    if settings.compensation.variant == "flux" and plant.hall_probe is None:
        text = f'"flux" needs the table [hall_probe], {rig.path} has none; add it'
        faults.append((("compensation", "variant"), text))
    lowest, highest = _visited(rig)
    if not limits.gap_low_m < lowest:
        text = f"{rig.path} goes to a gap of {lowest:.5g} m; lower it"
        faults.append((("limits", "gap_low_m"), text))
    if not limits.gap_high_m > highest:
        text = f"{rig.path} rests at a gap of {highest:.5g} m; raise it"
        faults.append((("limits", "gap_high_m"), text))
    return faults


def _visited(rig: BearingRig) -> tuple[float, float]:
    """Return the smallest gap that is referred to, and that of the armature at rest, m."""
    tried = rig.settings.simulate
    gaps = [tried.gap_m, *tried.also_gaps_m]
    lowest = min(step_ends(gap, height)[1] for gap in gaps for height in tried.steps_m)
    for trajectory in tried.trajectories:
        lowest = min(lowest, tried.gap_m - trajectory.amplitude_m)
    return lowest, rig.settings.mechanics.stop_high_m


HEADS = {
    "design": "gains from what moves, how fast and how well damped",
    "gains": "of the position controller",
    "filter": "low-passes of the first and of the second derivative",
    "limits": "hold whatever the gains are",
    "compensation": "what turns a wanted force into a current",
    "lift_off": "ramp of the force until the armature has left its rest, then of the reference",
    "landing": "ramp of the reference to the rest, then of the force to zero",
    "safety": "dropped samples that are bridged; how long the last current is held in a fault",
}


def write_controller(path: PathLike, settings: ControllerTable, note: str) -> None:
    """Write a controller file, whole or not at all, for a person to read and edit.

    Parameters
    ----------
    path : path-like
        Where.
    settings : ControllerTable
        What it is to say.
    note : str
        First comment of the file: where it comes from. Several lines are allowed.

    Raises
    ------
    InputError
        The place cannot be written, or the disk is full.
    """
    text = controller_text(settings, note)
    with atomic_writer(path) as stream:
        stream.write(text)


def controller_text(settings: ControllerTable, note: str) -> str:
    """Return the text of a controller file; the same for the same settings."""
    lines = [f"# {line}".rstrip() for line in note.splitlines()]
    lines.append("# Every key is described in docs/controller-file.md. SI, the unit in the key.")
    tables: list[str] = []
    for key in type(settings).model_fields:
        value = getattr(settings, key)
        if isinstance(value, BaseModel):
            tables += ["", f"[{key}]".ljust(20) + f"# {HEADS[key]}", *_keys(value)]
        elif value is not None:
            lines.append(f"{key} = {toml_value(value)}")
    return "\n".join([*lines, *tables]) + "\n"


def _keys(table: BaseModel) -> list[str]:
    values = ((key, getattr(table, key)) for key in type(table).model_fields)
    return [f"{key} = {toml_value(value)}" for key, value in values if value is not None]
