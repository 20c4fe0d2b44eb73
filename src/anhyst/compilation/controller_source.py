"""The constants of a position controller as C: every number with its meaning and unit."""

from __future__ import annotations

from collections.abc import Iterator

from anhyst.compilation.controller import ControllerPlan
from anhyst.compilation.parameters import table_source

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


def _lined_up(rows: Rows) -> list[str]:
    """Put the comments into one column."""
    lines = [(f"    {line}", doc) for line, doc in rows]
    end = max(len(line) for line, doc in lines if doc)
    return [f"{line:<{end}} /* {doc} */" if doc else line for line, doc in lines]


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
        "limits_rows": _lined_up(_limits(plan)),
        "settings_rows": _lined_up(_settings(plan, name)),
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
