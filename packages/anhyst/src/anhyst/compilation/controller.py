"""Convert a controller file to the constants of a position controller in C.

`CheckedController` is a controller file that fits the requested compilation. `ControllerPlan`
contains the controller in fixed point. The other functions write limits, settings and gains as
lines of C with the physical values.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from anhyst._core import FixedForceController, FixedPosition
from anhyst.compensate.block import Block
from anhyst.compensate.current_map import CurrentMap, fit_uncompensated_map
from anhyst.compensate.methods import restrict_model
from anhyst.compensate.plan import CompileRequest, Plan
from anhyst.compilation.parameters import align_comments, table_initialiser
from anhyst.control.controller_file import ControllerFile, ControllerTable, error_at_key, read_controller
from anhyst.control.position import PositionControl, Settings
from anhyst.model.actuator import Model
from anhyst.support.atomic import PathLike
from anhyst.support.block_words import Scales
from anhyst.support.errors import InputError
from anhyst.support.toml_file import FileFault, faults_error

MAX_CURRENT_RATIO = 1.01
"""Largest current of a controller, relative to the largest measured current. The excess allows for
noise."""


@dataclass(frozen=True)
class CheckedController:
    """Controller file that fits the requested compilation."""

    file: ControllerFile  # the file and its content

    @property
    def table(self) -> ControllerTable:
        """Content of the file."""
        return self.file.settings

    @property
    def magnets(self) -> int:
        """Number of magnets: 1, or 2 that pull in opposite directions."""
        return 1 if self.table.pair is None else 2

    @property
    def sha256(self) -> str:
        """SHA-256 of the file."""
        return hashlib.sha256(self.file.path.read_bytes()).hexdigest()

    def restrict_model(self, model: Model) -> Model:
        """Return the model with the range of this controller as its valid range."""
        table = self.table
        covered_gaps = None if model.valid is None else model.valid.schedule
        gap_limits = table.limits.gap_low_m, table.limits.gap_high_m
        gaps = gap_limits if covered_gaps is None else table.working_gaps(table.pair, covered_gaps)
        force_max = table.force_max(table.pair)
        return restrict_model(model, (0.0, table.limits.current_high_A), (0.0, force_max), gaps)

    def check_current(self, model: Model) -> None:
        """Raise an error if the currents exceed the measured range of the model."""
        highest_current = self.table.limits.current_high_A
        if model.valid is not None and highest_current > MAX_CURRENT_RATIO * model.valid.input[1]:
            measured_max = model.valid.input[1]
            text = f"the model is valid up to {measured_max:g} A; lower it, or measure at higher currents"
            raise faults_error(
                self.file.path, [FileFault(("limits", "current_high_A"), text, code="beyond-model")]
            )

    def make_controller_plan(self, plan: Plan) -> ControllerPlan:
        """Return the position controller for the compensator of a plan."""
        table = self.table
        assert isinstance(plan.block, Block)
        with error_at_key(self.file):
            control = table.position_control(plan.block.scales, table.current_converter(), table.pair)
            control.gains("fixed")
            settings = control.settings("fixed")
        block = plan.block.scales
        scales = Scales(block.demand, settings["current_full"], block.gap_low, block.gap_high)
        return ControllerPlan(self, control, plan.block, settings, fit_uncompensated_map(plan.model, scales))


@dataclass(frozen=True)
class ControllerPlan:
    """Position controller in fixed point."""

    source: CheckedController  # controller file
    control: PositionControl  # controller in SI units
    block: Block  # block of the compensator
    settings: Settings  # settings of the core, by name
    uncompensated: CurrentMap  # map that is used while the compensation is off

    @property
    def magnets(self) -> int:
        """Number of compensators."""
        return self.source.magnets

    @property
    def gains(self) -> NDArray[np.int32]:
        """Gains as words, in the order of the core."""
        return np.asarray(self.control.gains("fixed"), dtype=np.int32)

    def new_position_controller(self) -> FixedPosition:
        """Return the core's controller in its initial state, with demagnetised compensators."""
        compensators = [
            FixedForceController.compensator(self.block.kind, self.block.words) for _ in range(self.magnets)
        ]
        return FixedPosition(self.gains, compensators, dict(self.settings))


def read_checked_controller(
    path: PathLike, request: CompileRequest, model_path: PathLike
) -> CheckedController:
    """Read a controller file, and check that it fits the requested compilation."""
    file = read_controller(path)
    faults = [*_find_option_faults(file.settings, request), *_find_model_faults(file, model_path)]
    if faults:
        raise faults_error(file.path, faults)
    _check_format(file.settings, request)
    return CheckedController(file)


def _find_option_faults(table: ControllerTable, request: CompileRequest) -> list[FileFault]:
    compensation = table.compensation
    faults: list[FileFault] = []
    if table.rate_Hz != request.rate:
        text = f"is {table.rate_Hz:g} Hz here and {request.rate:g} Hz in --rate; make them equal"
        faults.append(FileFault(("rate_Hz",), text, code="option-differs"))
    if compensation.variant not in ("full", "simplified"):  # other variants: only in simulations
        text = f'"{compensation.variant}" is for comparison in simulations; write "full" or "simplified"'
        faults.append(FileFault(("compensation", "variant"), text, code="not-compilable"))
    elif compensation.variant != request.kind:
        text = f'is "{compensation.variant}" here and {request.kind} in --kind; make them equal'
        faults.append(FileFault(("compensation", "variant"), text, code="option-differs"))
    if compensation.format != "fixed":
        text = f'"{compensation.format}" is for simulations; write "fixed", the format of --io q31'
        faults.append(FileFault(("compensation", "format"), text, code="not-compilable"))
    if table.pair is None and table.limits.force_low_N < 0.0:
        text = "a single magnet cannot push; raise it to 0, or describe the second magnet in [pair]"
        faults.append(FileFault(("limits", "force_low_N"), text, code="cannot-push"))
    return faults


def _find_model_faults(file: ControllerFile, model_path: PathLike) -> list[FileFault]:
    """Return a fault if the controller file names another model than the compiled one."""
    if file.model is None:
        return []
    try:
        is_same = file.model.read_bytes() == Path(model_path).read_bytes()
    except OSError as error:
        text = f"{error.filename}: {error.strerror}; name the model file that is compiled"
    else:
        text = "" if is_same else f"is not {model_path}; compile the model that is named here"
    return [FileFault(("compensation", "model"), text, code="model-differs")] if text else []


def _check_format(table: ControllerTable, request: CompileRequest) -> None:
    """Raise an error if the signal format is not suitable for position control."""
    if request.io == "q15":
        limits = table.limits
        step = 1.25 * (limits.gap_high_m - limits.gap_low_m) / 2**16
        speed = step * table.rate_Hz
        raise InputError(
            f"--io: in q15 a gap has steps of {1e9 * step:.2g} nm, and its speed has steps of "
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


_GAIN_COMMENTS = (
    ("proportional", "K_p*Y/U/4"),
    ("integral", "K_i*T*Y/U"),
    ("derivative", "K_d/T*Y/U/4"),
    ("second", "K_dd/T^2*Y/U/4"),
    ("load", "K_l*L/U/8"),
    ("back", "4*fraction of the excess that the integral removes"),
    ("smoothing", "low-pass of the first derivative: minus the fraction per tick"),
    ("smoothing_2", "low-pass of the second derivative"),
)
_MIN_INT32 = -(2**31)

CommentedLines = Iterator[tuple[str, str]]
"""Lines of C, each with a comment; an empty text means no comment."""


def _limit_lines(plan: ControllerPlan) -> CommentedLines:
    limits, tick = plan.control.limits, plan.control.pidd2.tick
    yield ".levitation = {", ""
    yield _member_line(plan, "position_low", "  .low"), f"a gap of {_length_text(limits.gap_high)}"
    yield _member_line(plan, "position_high", "  .high"), f"a gap of {_length_text(limits.gap_low)}"
    yield _member_line(plan, "position_step", "  .step"), f"{_length_text(limits.step)} a tick"
    yield _member_line(plan, "max_missing_samples", "  .max_missing_samples"), "ticks"
    yield _member_line(plan, "hold", "  .hold"), f"ticks: {limits.hold * tick:.6g} s"
    yield _member_line(plan, "selftest", "  .selftest"), "ticks"
    yield "},", ""
    for name in ("current_low", "current_high", "current_step"):
        yield _member_line(plan, name, f".{name}"), f"{_current_setting(plan, name):.6g} A"
    yield (_member_line(plan, "release", ".release"), f"{_current_setting(plan, 'release'):.6g} A a tick")


def _setting_lines(plan: ControllerPlan, name: str) -> CommentedLines:
    levitation, control = plan.control.levitation, plan.control
    yield ".levitation = {", ""
    yield _member_line(plan, "detect", "  .detect"), _length_text(levitation.detect)
    yield _member_line(plan, "rise", "  .rise"), f"{levitation.rise_speed:.6g} m/s"
    yield _member_line(plan, "descend", "  .descend"), f"{levitation.descend_speed:.6g} m/s"
    yield _member_line(plan, "lift", "  .lift"), f"{levitation.lift_rate:.6g} N/s"
    yield _member_line(plan, "set_down", "  .set_down"), f"{levitation.set_down_rate:.6g} N/s"
    yield _member_line(plan, "most", "  .most"), f"{control.pidd2.high:.6g} N"
    yield _member_line(plan, "press", "  .press"), f"{control.final_landing_force:.6g} N"
    yield "},", ""
    yield ".gains = {", ""
    yield from _gain_lines(plan)
    yield "},", ""
    yield ".units = {.gap = {", ""
    for magnet in range(1, 3):
        yield _gap_line(plan, magnet), f"from position to gap, magnet {magnet}"
    yield "}},", ""
    yield _member_line(plan, "bias", ".bias"), f"{control.bias:.6g} N"
    yield _member_line(plan, "measured", ".measured"), "1: the measured currents are committed"
    yield f".plain = &{name}_controller_plain,", "map that is used while the compensation is off"


def _gain_lines(plan: ControllerPlan) -> CommentedLines:
    pidd2, words = plan.control.pidd2, plan.gains.tolist()
    for index, (name, doc) in enumerate(_GAIN_COMMENTS):
        mantissa, shift = words[2 * index : 2 * index + 2]
        yield f"  .{name} = {{{mantissa}, {shift}}},", doc
    unweighted, low, high = words[2 * len(_GAIN_COMMENTS) :]
    yield f"  .unweighted = {unweighted},", f"-(1 - b)*32768, b = {pidd2.weight:.6g}"
    yield f"  .low = {_int_literal(low)},", f"{pidd2.low:.6g} N"
    yield f"  .high = {_int_literal(high)},", f"{pidd2.high:.6g} N"


def _gap_line(plan: ControllerPlan, magnet: int) -> str:
    """Return offset and factor of the gap of a magnet; zeros if the magnet does not exist."""
    if magnet > plan.magnets:
        return "  {0, {0, 0}},"
    names = (f"gap_offset_{magnet}", f"gap_mantissa_{magnet}", f"gap_shift_{magnet}")
    offset, mantissa, shift = (int(plan.settings[name]) for name in names)
    return f"  {{{_int_literal(offset)}, {{{mantissa}, {shift}}}}},"


def _member_line(plan: ControllerPlan, name: str, member: str) -> str:
    return f"{member} = {_int_literal(int(plan.settings[name]))},"


def _int_literal(code: int) -> str:
    """Return a number as a C literal; -2^31 has no literal of its own."""
    return "INT32_MIN" if code == _MIN_INT32 else str(code)


def _length_text(metres: float) -> str:
    return f"{1e3 * metres:.6g} mm" if metres >= 1e-4 else f"{1e6 * metres:.6g} um"


def _current_setting(plan: ControllerPlan, name: str) -> float:
    return plan.settings[name] / 2.0**31 * plan.settings["current_full"]


def controller_template_values(plan: ControllerPlan, name: str) -> dict[str, object]:
    """Return the values for the templates of the controller."""
    control, settings = plan.control, plan.settings
    limits, converter = control.limits, control.converter
    first_step, _ = converter.steps_within(limits.current_low, limits.current_high)
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
        "current_low": f"({_int_literal(int(settings['current_low']))})",
        "current_step": int(settings["current_step"]),
        "current_range": f"{_current_setting(plan, 'current_low'):.6g} A to "
        f"{_current_setting(plan, 'current_high'):.6g} A",
        "step_uA": f"{1e6 * converter.step:.4g}",
        "first_word": round((first_step - converter.low) / converter.step),
        "converter_bits": converter.bits,
        "measured": control.uses_measured_currents,
        "limits_rows": align_comments((f"    {line}", doc) for line, doc in _limit_lines(plan)),
        "settings_rows": align_comments((f"    {line}", doc) for line, doc in _setting_lines(plan, name)),
        "plain_rows": table_initialiser(plan.uncompensated.entry_words()),
        "plain_ratio": f"{plan.uncompensated.constants['k_i_N_per_A']:.6g}",
        "plain_entries": plan.uncompensated.entries.size,
        "plain_segments": [(count - 2).bit_length() for count in plan.uncompensated.entries.shape[::-1]],
    }


def controller_entry(plan: ControllerPlan) -> dict[str, object]:
    """Return the entry of the manifest about the controller."""
    control, settings = plan.control, plan.settings
    pidd2, limits = control.pidd2, control.limits
    return {
        "name": plan.source.table.name,
        "sha256": plan.source.sha256,
        "magnets": plan.magnets,
        "rate_Hz": pidd2.rate,
        "applied": "measured" if control.uses_measured_currents else "reference",
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
                "low": _current_setting(plan, "current_low"),
                "high": _current_setting(plan, "current_high"),
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
