"""Values for the parameters of a bench, checked before any of them is put in force."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from anhyst.rig.bench.protocol import Parameter
from anhyst.support.errors import InputError


def check_values(values: Mapping[str, float], parameters: Sequence[Parameter]) -> None:
    """Refuse values that a bench cannot take."""
    known = {one.name: one for one in parameters}
    for name, value in values.items():
        if name not in known:
            raise InputError(
                f"{name}: is no parameter of this bench; it has {', '.join(known)}",
                code="unknown-parameter",
                key=name,
            )
        one = known[name]
        if not one.low <= value <= one.high:
            raise InputError(
                f"{name}: is {value:g} {one.unit}".rstrip()
                + f"; choose a value from {one.low:g} to {one.high:g}",
                code="out-of-range",
                key=name,
            )
