"""Present the settings of a controller as parameters of a bench, in SI units."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple, Protocol

from anhyst.support.errors import InputError
from anhyst.support.xcp_map import HEARTBEAT_MS
from anhyst_rigs.link.client import RequestRefusedError
from anhyst_rigs.link.frames import SETTINGS, Setting
from anhyst_rigs.link.virtual_boards import Q30, Q31
from anhyst_rigs.rig.bench.protocol import Parameter
from anhyst_rigs.rig.file import RigFile

_GAIN_SETTINGS = {
    Setting.GAIN_P: ("N/m", "K_p of the position controller"),
    Setting.GAIN_I: ("N/(m s)", "K_i of the position controller"),
    Setting.GAIN_D: ("N s/m", "K_d of the position controller"),
    Setting.GAIN_DD: ("N s^2/m", "K_dd of the position controller"),
}
"""Gains that the firmware scales relative to their compiled values; a compiled zero stays zero."""


MAX_PLANT_NUMBER = 999
"""Largest number by which a random plant can be selected."""


class SettingsLine(Protocol):
    """A line that reads and writes settings."""

    def read_setting(self, setting: Setting) -> int:
        """Return the code of a setting."""

    def write_setting(self, setting: Setting, value: int) -> int:
        """Write the code of a setting for the next tick; return the new code of the controller."""


class SettingSpec(NamedTuple):
    """Range, unit and code of a setting."""

    name: str  # name as in :class:`anhyst_rigs.rig.bench.protocol.Parameter`
    setting: Setting  # number of the setting in the protocol
    unit: str
    low: float
    high: float
    # value of one code in SI units; if it is 1, the value must be an integer
    value_per_code: float
    doc: str

    def encode(self, value: float) -> int:
        """Return the code of a value."""
        if self.value_per_code == 1.0 and value != round(value):
            text = f"{self.name}: is {value:g}; choose {self.low:g} or {self.high:g}"
            raise InputError(text, code="out-of-range", key=self.name)
        limits = SETTINGS[self.setting]
        return min(max(round(value / self.value_per_code), limits.low), limits.high)


class ControllerSettings:
    """Settings of a controller that are read and written over a line."""

    def __init__(self, line: SettingsLine, setting_specs: Sequence[SettingSpec]) -> None:
        self._line = line
        self._specs = tuple(setting_specs)
        self._codes = {spec.setting: line.read_setting(spec.setting) for spec in self._specs}

    def parameters(self) -> tuple[Parameter, ...]:
        """Return all settings with their present values."""
        return tuple(
            Parameter(
                spec.name,
                spec.unit,
                spec.low,
                spec.high,
                spec.doc,
                self._codes[spec.setting] * spec.value_per_code,
            )
            for spec in self._specs
        )

    def write(self, values: Mapping[str, float], is_running: bool) -> None:
        """Write several settings, or none if one is refused; unknown names are ignored."""
        new_codes = {spec: spec.encode(values[spec.name]) for spec in self._specs if spec.name in values}
        changed_codes = {
            spec.setting: code for spec, code in new_codes.items() if code != self._codes[spec.setting]
        }
        for setting in changed_codes:
            if is_running and not SETTINGS[setting].while_running:
                raise InputError(
                    f"{setting.name.lower()}: cannot change while the controller runs; stop it first",
                    code="wrong-state",
                    key=setting.name.lower(),
                )
        old_codes = {setting: self._codes[setting] for setting in changed_codes}
        try:
            self._send_settings(changed_codes)
        except RequestRefusedError:
            self._send_settings(old_codes)
            raise

    def _send_settings(self, setting_codes: Mapping[Setting, int]) -> None:
        for setting, code in setting_codes.items():
            self._codes[setting] = self._line.write_setting(setting, code)
        if not _GAIN_SETTINGS.keys().isdisjoint(setting_codes):
            self._line.write_setting(Setting.GAINS, 1)  # A 1 activates the written gains.


_COMPENSATION_DOC = "1: the compensator; 0: the constant ratio"
_COMPENSATION_SETTING = SettingSpec(
    "compensation", Setting.COMPENSATION, "", 0.0, 1.0, 1.0, _COMPENSATION_DOC
)


def force_settings(
    demand_full_scale: float, current_full_scale: float, rate: float
) -> tuple[SettingSpec, ...]:
    """Return the settings of a force controller from its full scales, N and A, and its rate, Hz."""
    max_slew, current_per_force = demand_full_scale * rate, current_full_scale / demand_full_scale
    slew_doc, ratio_doc = "largest slope of the demand", "constant ratio of current to force"
    follow_doc = "current that updates the hysteresis state: 0: driven; 1: measured"
    return (
        SettingSpec(
            "demand_slew", Setting.DEMAND_SLEW, "N/s", max_slew / Q31, max_slew, max_slew / Q31, slew_doc
        ),
        _COMPENSATION_SETTING,
        SettingSpec(
            "ratio", Setting.RATIO, "A/N", 0.0, 2.0 * current_per_force, current_per_force / Q30, ratio_doc
        ),
        SettingSpec("follow", Setting.FOLLOW, "", 0.0, 1.0, 1.0, follow_doc),
    )


def position_settings(gains: Sequence[float]) -> tuple[SettingSpec, ...]:
    """Return the settings of a position controller."""
    settings = [_COMPENSATION_SETTING]
    for (setting, (unit, doc)), gain in zip(_GAIN_SETTINGS.items(), gains, strict=True):
        if gain == 0.0:
            continue
        value_per_code, limits = gain / Q30, SETTINGS[setting]
        low, high = sorted((value_per_code * limits.low, value_per_code * limits.high))
        settings.append(SettingSpec(setting.name.lower(), setting, unit, low, high, value_per_code, doc))
    return tuple(settings)


_EXPECTED_TO_NOMINAL_TIME = 2.0
"""Ratio of the lag and the sweep time that a controller expects to the nominal values."""
_MAX_DELAY_TICKS = 2.0
"""Largest number of ticks between a driven current and the sample that measures it."""


def set_expected_amplifier(line: SettingsLine, file: RigFile, slew: float, full_scale: float) -> None:
    """Raise the lag and the sweep time that a controller expects to those of the amplifier.

    The current changes by up to `slew`, A/s. Its full scale in the controller is `full_scale`, A.
    """
    rate, amplifier = file.timing.rate_Hz, file.amplifier
    lag = (1.0 / amplifier.bandwidth_Hz + 1.0 / file.current_sensor.bandwidth_Hz) / math.tau
    time_constants = {
        Setting.CURRENT_LAG_TICKS: lag + amplifier.delay_s + _MAX_DELAY_TICKS / rate,
        Setting.CURRENT_SWEEP_TICKS: full_scale / slew,
    }
    for setting, seconds in time_constants.items():
        ticks = math.ceil(min(_EXPECTED_TO_NOMINAL_TIME * seconds, 1e-3 * HEARTBEAT_MS) * rate)
        if ticks > line.read_setting(setting):
            line.write_setting(setting, min(ticks, int(1e-3 * HEARTBEAT_MS * rate)))


def heartbeat_setting(rate: float) -> SettingSpec:
    """Return the setting of the time for which a controller waits for a heartbeat, s."""
    low_s, high_s = SETTINGS[Setting.HEARTBEAT_TICKS].low / rate, 1e-3 * HEARTBEAT_MS
    doc = "time without a heartbeat after which the controller enters its safe state"
    return SettingSpec("heartbeat", Setting.HEARTBEAT_TICKS, "s", low_s, high_s, 1.0 / rate, doc)


def check_values(
    values: Mapping[str, float], parameters: Sequence[Parameter], integer_names: Sequence[str] = ()
) -> None:
    """Raise an InputError for an unknown name, a value out of range, or a non-integer."""
    parameters_by_name = {parameter.name: parameter for parameter in parameters}
    for name, value in values.items():
        if name not in parameters_by_name:
            text = f"{name}: is not a parameter of this bench; it has {', '.join(parameters_by_name)}"
            raise InputError(text, code="unknown-parameter", key=name)
        parameter = parameters_by_name[name]
        if not parameter.low <= value <= parameter.high:
            raise InputError(
                f"{name}: is {value:g} {parameter.unit}".rstrip()
                + f"; choose a value from {parameter.low:g} to {parameter.high:g}",
                code="out-of-range",
                key=name,
            )
        if name in integer_names and value % 1.0:
            text = f"{name}: is {value:g}; choose a whole number"
            raise InputError(text, code="out-of-range", key=name)


def stage_parameters(
    values: Mapping[str, float], methods: tuple[str, str], crossover: float
) -> tuple[Parameter, ...]:
    """Return the parameters of a running stage; the methods are without and with compensation."""
    baseline_method, compensated_method = methods
    specs = (
        (
            "compensation",
            "",
            0.0,
            1.0,
            f"1: {compensated_method}; 0: {baseline_method}; each with its own gains",
        ),
        ("gain_acceleration", "", 0.0, 2.0, "feedforward gain of mass times acceleration"),
        ("gain_jerk", "s", -1e-3, 1e-3, "feedforward gain of the jerk"),
        ("gain_snap", "s2", -1e-6, 1e-6, "feedforward gain of the snap"),
        ("crossover", "Hz", 0.25 * crossover, 1.5 * crossover, "crossover of the position loop"),
        ("motion", "", 0.1, 1.0, "accelerations relative to the rig file"),
        ("plant", "", 0.0, float(MAX_PLANT_NUMBER), "0: rig file; n: n-th plant of [spread]"),
    )
    return tuple(Parameter(name, unit, low, high, doc, values[name]) for name, unit, low, high, doc in specs)
