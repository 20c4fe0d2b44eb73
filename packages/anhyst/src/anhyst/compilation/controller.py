"""The position controller of an output folder, and its constants as C, with meaning and unit."""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from anhyst._core import FixedForceController, FixedPosition
from anhyst.compensate.block import Block
from anhyst.compensate.current_map import CurrentMap, plain_map
from anhyst.compensate.methods import bearing_model
from anhyst.compensate.plan import CompileRequest, Plan
from anhyst.compilation.parameters import lined_up, table_source
from anhyst.control.controller_file import (
    ControllerFile,
    ControllerTable,
    error_at_key,
    read_controller,
)
from anhyst.control.position import PositionControl, Settings
from anhyst.model.actuator import Model
from anhyst.support.atomic import PathLike
from anhyst.support.block_words import Scales
from anhyst.support.errors import InputError
from anhyst.support.toml_file import FileFault, faults_error

BEYOND = 1.01
"""Largest current of a controller, by the largest that was measured; as much for noise."""


@dataclass(frozen=True)
class Controller:
    """A controller file, read and found to fit what is asked for."""

    file: ControllerFile  # where it stands, and what it says

    @property
    def table(self) -> ControllerTable:
        """What the file says."""
        return self.file.settings

    @property
    def magnets(self) -> int:
        """One, or two that pull against each other."""
        return 1 if self.table.pair is None else 2

    @property
    def sha256(self) -> str:
        """Of the file."""
        return hashlib.sha256(self.file.path.read_bytes()).hexdigest()

    def narrowed(self, model: Model) -> Model:
        """Return the model for forces, currents and gaps of this controller alone."""
        table = self.table
        seen = None if model.valid is None else model.valid.schedule
        limits = table.limits.gap_low_m, table.limits.gap_high_m
        gaps = limits if seen is None else table.working_gaps(table.pair, seen)
        force_max = table.force_max(table.pair)
        return bearing_model(model, (0.0, table.limits.current_high_A), (0.0, force_max), gaps)

    def check_current(self, model: Model) -> None:
        """Refuse currents that the model was never seen at."""
        highest = self.table.limits.current_high_A
        if model.valid is not None and highest > BEYOND * model.valid.input[1]:
            seen = model.valid.input[1]
            text = f"the model was seen up to {seen:g} A; lower it, or measure further"
            raise faults_error(
                self.file.path, [FileFault(("limits", "current_high_A"), text, code="beyond-model")]
            )

    def around(self, plan: Plan) -> ControllerPlan:
        """Return the controller around the compensator of a plan."""
        table = self.table
        assert isinstance(plan.block, Block)
        with error_at_key(self.file):
            control = table.position_control(
                plan.block.scales, table.converter_of_currents(), table.pair
            )
            control.gains("fixed")
            settings = control.settings("fixed")
        block = plan.block.scales
        scales = Scales(block.demand, settings["current_full"], block.gap_low, block.gap_high)
        return ControllerPlan(self, control, plan.block, settings, plain_map(plan.model, scales))


@dataclass(frozen=True)
class ControllerPlan:
    """A position controller in fixed point."""

    source: Controller  # what it was made from
    control: PositionControl  # in SI units
    block: Block  # of the compensator
    settings: Settings  # as the core takes them, by name
    plain: CurrentMap  # drives while the compensation is switched off

    @property
    def magnets(self) -> int:
        """How many compensators it has."""
        return self.source.magnets

    @property
    def gains(self) -> NDArray[np.int32]:
        """Words of the gains, as the core takes them."""
        return np.asarray(self.control.gains("fixed"), dtype=np.int32)

    def start(self) -> FixedPosition:
        """Return the very controller, just switched on, with compensators that remember nothing."""
        compensators = [
            FixedForceController.compensator(self.block.kind, self.block.words)
            for _ in range(self.magnets)
        ]
        return FixedPosition(self.gains, compensators, dict(self.settings))


def read_fitting(path: PathLike, request: CompileRequest, model_path: PathLike) -> Controller:
    """Read a controller file for a folder."""
    file = read_controller(path)
    faults = [*_faults(file.settings, request), *_model_faults(file, model_path)]
    if faults:
        raise faults_error(file.path, faults)
    _check_format(file.settings, request)
    return Controller(file)


def _faults(table: ControllerTable, request: CompileRequest) -> list[FileFault]:
    chosen = table.compensation
    faults: list[FileFault] = []
    if table.rate_Hz != request.rate:
        text = f"is {table.rate_Hz:g} Hz here and {request.rate:g} Hz in --rate; make them equal"
        faults.append(FileFault(("rate_Hz",), text, code="option-differs"))
    if chosen.variant not in ("full", "simplified"):  # the others exist to be compared with
        text = f'"{chosen.variant}" is for comparison in simulations; write "full" or "simplified"'
        faults.append(FileFault(("compensation", "variant"), text, code="not-compilable"))
    elif chosen.variant != request.kind:
        text = f'is "{chosen.variant}" here and {request.kind} in --kind; make them equal'
        faults.append(FileFault(("compensation", "variant"), text, code="option-differs"))
    if chosen.format != "fixed":
        text = f'"{chosen.format}" is for simulations; write "fixed", which goes with --io q31'
        faults.append(FileFault(("compensation", "format"), text, code="not-compilable"))
    if table.pair is None and table.limits.force_low_N < 0.0:
        text = "a single magnet cannot push; raise it to 0, or describe the second in [pair]"
        faults.append(FileFault(("limits", "force_low_N"), text, code="cannot-push"))
    return faults


def _model_faults(file: ControllerFile, model_path: PathLike) -> list[FileFault]:
    """Refuse another model than the one that the controller file names."""
    if file.model is None:
        return []
    try:
        same = file.model.read_bytes() == Path(model_path).read_bytes()
    except OSError as error:
        text = f"{error.filename}: {error.strerror}; name the model file that is compiled"
    else:
        text = "" if same else f"is not {model_path}; compile the model that is named here"
    return [FileFault(("compensation", "model"), text, code="model-differs")] if text else []


def _check_format(table: ControllerTable, request: CompileRequest) -> None:
    """Refuse what cannot carry a position."""
    if request.io == "q15":
        limits = table.limits
        step = 1.25 * (limits.gap_high_m - limits.gap_low_m) / 2**16
        speed = step * table.rate_Hz
        raise InputError(
            f"--io: in q15 a gap has steps of {1e9 * step:.2g} nm and its speed of "
            f"{1e3 * speed:.2g} mm/s, too coarse to control it; give q31",
            code="format-too-coarse",
            key="--io",
        )
    if request.io != "q31":
        raise InputError(
            f"--io: {request.io} is not for a position controller, which is compiled in fixed "
            "point; give q31",
            code="option-not-for-this",
            key="--io",
        )


_GAINS = (
    ("proportional", "K_p*Y/U/4"),
    ("integral", "K_i*T*Y/U"),
    ("derivative", "K_d/T*Y/U/4"),
    ("second", "K_dd/T^2*Y/U/4"),
    ("load", "K_l*L/U/8"),
    ("back", "4*share that the integral takes back"),
    ("smoothing", "of the first derivative, minus the share of a tick"),
    ("smoothing_2", "of the second"),
)
_LOWEST = -(2**31)

Rows = Iterator[tuple[str, str]]
"""Lines of C, each with a comment or nothing."""


def _limits(plan: ControllerPlan) -> Rows:
    limits, tick = plan.control.limits, plan.control.pidd2.tick
    yield ".levitation = {", ""
    yield _member(plan, "position_low", "  .low"), f"a gap of {_length(limits.gap_high)}"
    yield _member(plan, "position_high", "  .high"), f"a gap of {_length(limits.gap_low)}"
    yield _member(plan, "position_step", "  .step"), f"{_length(limits.step)} a tick"
    yield _member(plan, "max_missing_samples", "  .max_missing_samples"), "ticks"
    yield _member(plan, "hold", "  .hold"), f"ticks: {limits.hold * tick:.6g} s"
    yield _member(plan, "selftest", "  .selftest"), "ticks"
    yield "},", ""
    for name in ("current_low", "current_high", "current_step"):
        yield _member(plan, name, f".{name}"), f"{_current(plan, name):.6g} A"
    yield _member(plan, "release", ".release"), f"{_current(plan, 'release'):.6g} A a tick"


def _settings(plan: ControllerPlan, name: str) -> Rows:
    levitation, control = plan.control.levitation, plan.control
    yield ".levitation = {", ""
    yield _member(plan, "detect", "  .detect"), _length(levitation.detect)
    yield _member(plan, "rise", "  .rise"), f"{levitation.rise_speed:.6g} m/s"
    yield _member(plan, "descend", "  .descend"), f"{levitation.descend_speed:.6g} m/s"
    yield _member(plan, "lift", "  .lift"), f"{levitation.lift_rate:.6g} N/s"
    yield _member(plan, "set_down", "  .set_down"), f"{levitation.set_down_rate:.6g} N/s"
    yield _member(plan, "most", "  .most"), f"{control.pidd2.high:.6g} N"
    yield _member(plan, "press", "  .press"), f"{control.press:.6g} N"
    yield "},", ""
    yield ".gains = {", ""
    yield from _gains(plan)
    yield "},", ""
    yield ".units = {.gap = {", ""
    for magnet in range(1, 3):
        yield _gap_line(plan, magnet), f"from position to gap, magnet {magnet}"
    yield "}},", ""
    yield _member(plan, "bias", ".bias"), f"{control.bias:.6g} N"
    yield _member(plan, "measured", ".measured"), "1: currents as measured count as applied"
    yield f".plain = &{name}_controller_plain,", "drives while nothing is compensated"


def _gains(plan: ControllerPlan) -> Rows:
    pidd2, words = plan.control.pidd2, plan.gains.tolist()
    for index, (name, doc) in enumerate(_GAINS):
        mantissa, shift = words[2 * index : 2 * index + 2]
        yield f"  .{name} = {{{mantissa}, {shift}}},", doc
    unweighted, low, high = words[2 * len(_GAINS) :]
    yield f"  .unweighted = {unweighted},", f"-(1 - b)*32768, b = {pidd2.weight:.6g}"
    yield f"  .low = {_literal(low)},", f"{pidd2.low:.6g} N"
    yield f"  .high = {_literal(high)},", f"{pidd2.high:.6g} N"


def _gap_line(plan: ControllerPlan, magnet: int) -> str:
    """Return offset and factor of a magnet; zeros for one that is not there."""
    if magnet > plan.magnets:
        return "  {0, {0, 0}},"
    names = (f"gap_offset_{magnet}", f"gap_mantissa_{magnet}", f"gap_shift_{magnet}")
    offset, mantissa, shift = (int(plan.settings[name]) for name in names)
    return f"  {{{_literal(offset)}, {{{mantissa}, {shift}}}}},"


def _member(plan: ControllerPlan, name: str, member: str) -> str:
    return f"{member} = {_literal(int(plan.settings[name]))},"


def _literal(code: int) -> str:
    """Return a number as C takes it: minus 2^31 is none, but the minus of one too large."""
    return "INT32_MIN" if code == _LOWEST else str(code)


def _length(metres: float) -> str:
    return f"{1e3 * metres:.6g} mm" if metres >= 1e-4 else f"{1e6 * metres:.6g} um"


def _current(plan: ControllerPlan, name: str) -> float:
    return plan.settings[name] / 2.0**31 * plan.settings["current_full"]


def controller_values(plan: ControllerPlan, name: str) -> dict[str, object]:
    """Return what the templates of the controller show."""
    control, settings = plan.control, plan.settings
    limits, converter = control.limits, control.converter
    first, _ = converter.within(limits.current_low, limits.current_high)
    return {
        "controller": plan.source.table.name,
        "controller_sha256": plan.source.sha256,
        "magnets": plan.magnets,
        "pair": plan.magnets == 2,
        "rate": f"{control.pidd2.rate:.10g}",
        "gap_middle": control.gap_middle,
        "position_full": control.position_full,
        "current_full": settings["current_full"],
        "demand_full": control.scales.demand,
        "gap_low_mm": f"{1e3 * limits.gap_low:.6g}",
        "gap_high_mm": f"{1e3 * limits.gap_high:.6g}",
        "gap_middle_mm": f"{1e3 * control.gap_middle:.6g}",
        "position_mm": f"{1e3 * control.position_full:.6g}",
        "code_nm": f"{1e9 * control.position_full / 2**31:.2g}",
        "current_low": f"({_literal(int(settings['current_low']))})",
        "current_step": int(settings["current_step"]),
        "current_range": f"{_current(plan, 'current_low'):.6g} A to "
        f"{_current(plan, 'current_high'):.6g} A",
        "step_uA": f"{1e6 * converter.step:.4g}",
        "first_word": round((first - converter.low) / converter.step),
        "converter_bits": converter.bits,
        "measured": control.measured,
        "limits_rows": lined_up((f"    {line}", doc) for line, doc in _limits(plan)),
        "settings_rows": lined_up((f"    {line}", doc) for line, doc in _settings(plan, name)),
        "plain_rows": table_source(plan.plain.words()),
        "plain_ratio": f"{plan.plain.numbers['k_i_N_per_A']:.6g}",
        "plain_entries": plan.plain.entries.size,
        "plain_segments": [(count - 2).bit_length() for count in plan.plain.entries.shape[::-1]],
    }


def described(plan: ControllerPlan) -> dict[str, object]:
    """Return what stands in the manifest about the controller."""
    control, settings = plan.control, plan.settings
    pidd2, limits = control.pidd2, control.limits
    return {
        "name": plan.source.table.name,
        "sha256": plan.source.sha256,
        "magnets": plan.magnets,
        "rate_Hz": pidd2.rate,
        "applied": "measured" if control.measured else "reference",
        "signals": {
            "position": {
                "unit": "m",
                "format": "q31",
                "scale": control.position_full,
                "zero_gap": control.gap_middle,
                "low_gap": limits.gap_low,
                "high_gap": limits.gap_high,
            },
            "current": {
                "unit": "A",
                "format": "q31",
                "scale": settings["current_full"],
                "low": _current(plan, "current_low"),
                "high": _current(plan, "current_high"),
                "step_codes": settings["current_step"],
            },
            "demand": {
                "unit": "N",
                "format": "q31",
                "scale": control.scales.demand,
                "low": pidd2.low,
                "high": pidd2.high,
            },
        },
        "gains": {
            "K_p_N_per_m": pidd2.K_p,
            "K_i_N_per_m_s": pidd2.K_i,
            "K_d_N_s_per_m": pidd2.K_d,
            "K_dd_N_s2_per_m": pidd2.K_dd,
        },
        "settings": dict(settings),
    }
