"""One line about what a fit leaves: how much of it is no noise, of what shape, and what to do."""

from __future__ import annotations

from collections.abc import Sequence

from anhyst.data import Loops
from anhyst.data.verdict import largest_output
from anhyst.model.actuator import Model
from anhyst.model.left_over import LeftOver, left_over
from anhyst.model.residual_shapes import Residual, Shape
from anhyst.support.arrays import FloatArray

_ALSO = 0.2
"""Share of what is no noise from which a second shape is named."""


def left_of(loopset: Loops, fitted: Sequence[FloatArray]) -> LeftOver:
    """Judge what a model leaves of loops."""
    places = {value: place for place, value in enumerate(loopset.schedule_values)}
    records = [
        Residual(
            loop.input,
            loop.output,
            output - loop.output,
            places.get(loop.schedule_value, 0) if loop.schedule_value is not None else 0,
            loop.history.kind == "settled",
        )
        for loop, output in zip(loopset.loops, fitted, strict=True)
    ]
    return left_over(records, largest_output(loopset))


def told(left: LeftOver, loopset: Loops, model: Model) -> str:
    """Say what is left and what to do about it."""
    if left.done:
        return (
            f"what is left ({100.0 * left.rms:.2g} % of the largest output) is noise, or too little "
            "for a sensor to see: the fit is done"
        )
    text = (
        f"{100.0 * left.beyond:.2g} % of the largest output is left that is not noise "
        f"({100.0 * left.noise:.2g} %): "
    )
    if not left.shapes:
        return text + (
            "smooth along the record, but of no shape that repeats: details finer than the law has, "
            "or a sensor that lags; inspect the record"
        )
    main, share = left.shapes[0]
    text += f"{100.0 * share:.0f} % of its square " if share < 1.0 - _ALSO else ""
    text += _WHAT[main].format(drive=loopset.input.name, at=_at(loopset), first=left.first)
    if len(left.shapes) > 1 and left.shapes[1][1] >= _ALSO:
        second, share = left.shapes[1]
        text += f" ({100.0 * share:.0f} %: {_SHORT[second].format(at=_at(loopset))})"
    return f"{text}: {_advice(main, loopset, model)}"


def _at(loopset: Loops) -> str:
    return loopset.schedule.name if loopset.schedule is not None else "gap"


_WHAT: dict[Shape, str] = {
    "input": "a smooth function of the {drive}, alike on rising and falling branches",
    "direction": "of opposite sign on rising and falling branches",
    "gap": "differs from {at} to {at}",
    "amplitude": "differs between inner and outer loops",
    "start": "in the first {first} samples of a record",
    "drift": "runs steadily with time",
}
_SHORT: dict[Shape, str] = {
    "input": "a smooth function of the input",
    "direction": "of opposite sign on rising and falling branches",
    "gap": "from {at} to {at}",
    "amplitude": "inner against outer loops",
    "start": "at the start of records",
    "drift": "with time",
}


def _advice(shape: Shape, loopset: Loops, model: Model) -> str:
    asked = model.provenance.settings.get("law_wanted", "auto") != "auto"
    other = "; try --law auto" if asked else ", nor can any that was compared"
    if shape == "gap":
        at = _at(loopset)
        way = f"measure another {at}"
        way += " or try --gap-map circuit" if model.gap_map not in {"circuit", "free"} else ""
        return f"the gap map '{model.gap_map}' cannot follow; {way}"
    return {
        "input": f"the law's curve cannot follow, as in saturation{other}",
        "direction": f"the width of the loops is not that of the law{other}",
        "amplitude": f"the law cannot follow all sizes of loops{other}",
        "start": "they do not begin as their history says; check --history",
        "drift": "a sensor drifts; let it warm up, or remove the drift (--clean)",
    }[shape]
