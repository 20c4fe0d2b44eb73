"""From the gauge-free form to physical parameters, and what had to be fixed to get there.

Outputs do not change along the redundancies of docs/theory.md, so values along them are
chosen, and the choice is reported:

- field and flux density measured: nothing is left to choose;
- otherwise ``M_s`` is set to 1e6 A/m where no measured quantity sets it;
- reluctance and circuit map: ``alpha = 0``, or, where ``rho`` or its straight continuation to the
  closed gap would come out negative, that place is made the zero of ``rho`` and alpha takes the
  difference.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from anhyst.data.output_map import OutputMap, output_map
from anhyst.identification.response import Local, ResponseForm
from anhyst.identification.space import IN_SERIES, WRITTEN
from anhyst.model.gap_map import Curve
from anhyst.support.units import MU_0, Quantity

SATURATION = 1e6
"""M_s where the data do not determine it, A/m."""

AIR_CORE = 1e-3
"""h where the data do not determine it: a/(M_s*(1 - alpha))."""

_ROUNDING = 1e-12
"""What rho keeps at the closed gap, so that rounding cannot make it negative there."""

Parameter = float | tuple[float, ...]


def form_of(input_quantity: Quantity, output_quantity: Quantity, law: str) -> ResponseForm:
    """Choose the form of the equations for what was measured."""
    answer = output_map(output_quantity)
    return ResponseForm(
        power=answer.power,
        law=law,
        permeability=MU_0 if answer.absolute and input_quantity.name == "field" else 0.0,
        h=AIR_CORE,
    )


def physical(
    form: ResponseForm,
    sets: Sequence[Local],
    gap_map: str,
    input_quantity: Quantity,
    output_quantity: Quantity,
    gaps: Sequence[float] = (),
) -> dict[str, Parameter]:
    """Physical parameters for gauge-free ones, for :class:`anhyst.model.actuator.Model`."""
    gap_map = WRITTEN.get(gap_map, gap_map)
    answer = output_map(output_quantity)
    table = [_at_one_gap(form, local, gap_map, input_quantity.name, answer) for local in sets]
    if gap_map in IN_SERIES:
        _lift_reluctance(form, table, gaps, answer.power)
    for row in table:
        row.update(form.kernel.dead_band(row, form.dead_band))
    vary = {
        "none": set(),
        "scaling": {"c_H"},
        "reluctance": {"rho"},
        "circuit": {"rho", "c_out", "in_0", "out_0"},
        "free": set(table[0]) - ({"c_H"} if input_quantity.name == "field" else set()),
    }[gap_map]
    if len(sets) == 1:
        vary = set()
    same = {name for name in ("in_0", "out_0") if len({row[name] for row in table}) == 1}
    return {
        name: tuple(row[name] for row in table) if name in vary - same else table[0][name]
        for name in table[0]
    }


def _lift_reluctance(
    form: ResponseForm, table: list[dict[str, float]], gaps: Sequence[float], power: int
) -> None:
    """Move along the redundancy between alpha and rho until no reluctance is negative."""
    rho = np.array([row["rho"] for row in table])
    least = float(rho.min())
    if len(gaps) > 1:
        closed = float(Curve("rho", np.asarray(gaps, dtype=np.float64), rho)(np.zeros(1))[0])
        least = min(least, closed) - _ROUNDING
    p = min(1.0 + least, 1.0)
    for row in table:
        row["rho"] = max((1.0 + row["rho"]) / p - 1.0, 0.0)
        form.kernel.shrink_field(row, p)
        row["c_out"] /= p**power


def _at_one_gap(
    form: ResponseForm, local: Local, gap_map: str, input_name: str, answer: OutputMap
) -> dict[str, float]:
    h, omega = local.h, local.omega
    if gap_map in IN_SERIES:
        alpha, rho = 0.0, h * omega / (1.0 - h * omega)
    else:
        alpha, rho = 0.0 - h * omega / (1.0 - h * omega), 0.0
    unscaled = local.scale / (1.0 + rho)  # input for one unit of effective field without the gap
    if input_name == "field" and gap_map != "scaling":
        a = unscaled
        saturation = a / (h * (1.0 - alpha))
    elif answer.absolute and gap_map != "circuit":
        saturation = local.gain / (MU_0 * (1.0 - alpha))
        a = h * saturation * (1.0 - alpha)
    else:
        saturation = SATURATION
        a = h * saturation * (1.0 - alpha)
    c_out = local.gain / (MU_0 * saturation * (1.0 - alpha)) ** answer.power
    if abs(c_out - 1.0) < 1e-12:
        c_out = 1.0  # flux density measured: but for rounding it is one by construction
    return {
        **form.kernel.iron(saturation, a, local.law, alpha),
        "rho": rho,
        "c_H": a / unscaled,
        "c_out": c_out,
        "in_0": local.in_0,
        "out_0": local.out_0,
    }
