"""The keys of a model file: names with their units, table by table.

Apart from the schema, whose validation takes longer to import than a model to write.
"""

from __future__ import annotations

from anhyst.data.output_map import output_map
from anhyst.laws.law import Law
from anhyst.support.units import Quantity

FORMAT = "anhyst-model"
VERSION = 1

Names = dict[str, tuple[str, str]]
"""For each field of a table whose key carries a unit: the key without and with it."""


def column(name: str, unit: str) -> str:
    """Return a key with its unit, such as ``k_A_per_m``."""
    return Quantity("", name, unit).column


def parameter_names(law: Law | None, drive: Quantity, answer: Quantity) -> Names:
    """Return the keys of ``[parameters]`` for a law, if it is known, an input and an output."""
    power = output_map(answer).power
    turns = {"A": "c_H_per_m", "A/m": "c_H"}.get(drive.unit, f"c_H_A_per_m_{drive.unit}")
    ratio = column(f"c_{answer.symbol}", answer.unit) + f"_per_T{power if power > 1 else ''}"
    return {
        **{
            spec.name: (spec.name, column(spec.name, spec.unit) if spec.unit != "1" else spec.name)
            for spec in (law.parameters if law else ())
        },
        "rho": ("rho", "rho"),
        "c_H": ("c_H", turns),
        "gamma": ("gamma", "gamma_A_s_per_m_T"),
        "c_out": (f"c_{answer.symbol}", "c_B" if answer.unit == "T" else ratio),
        "in_0": (f"{drive.symbol}_0", column(f"{drive.symbol}_0", drive.unit)),
        "out_0": (f"{answer.symbol}_0", column(f"{answer.symbol}_0", answer.unit)),
    }


def section_names(
    law: Law | None, drive: Quantity, answer: Quantity, schedule: Quantity | None
) -> dict[tuple[str, ...], Names]:
    """Return the keys that carry units, table by table (``[[fit.loop]]`` as ``fit, loop``)."""
    deviations = {
        name: (name, column(name, answer.unit))
        for name in ("largest_output", "mean_abs", "rms", "worst")
    }
    ranges = {"input": (drive.symbol, drive.column), "output": (answer.symbol, answer.column)}
    nodes: Names = {}
    if schedule is not None:
        ranges["schedule"] = (schedule.symbol, schedule.column)
        nodes["nodes"] = ("nodes", column("nodes", schedule.unit))
    at = {"schedule": ranges["schedule"]} if schedule is not None else {}
    return {
        ("schedule",): nodes,
        ("parameters",): parameter_names(law, drive, answer),
        ("cells",): {
            name: (name, column(name, "A/m")) for name in ("thresholds", "widths", "weights")
        },
        ("dynamics",): {
            "lag": ("lag", "lag_s"),
            "creep_times": ("creep_times", "creep_times_s"),
            "fastest": ("fastest", "fastest_Hz"),
        },
        ("valid",): ranges,
        ("fit",): deviations,
        ("fit", "loop"): deviations | at,
    }


def meant(key: str, names: Names) -> str | None:
    """Return the field that a key without its unit, or with another one, stands for, if any."""
    for field, (bare, full) in names.items():
        if key == full:
            continue
        if key in {field, bare} or (bare != full and key.startswith(f"{bare}_")):
            return field
    return None
