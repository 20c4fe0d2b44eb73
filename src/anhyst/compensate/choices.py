"""The choices of a plan in words."""

from __future__ import annotations

from anhyst.compensate.plan import Decision, Plan

STEPS = {"q15": 2.0**-15, "q31": 2.0**-31}


def explain(plan: Plan) -> list[Decision]:
    """Say what was chosen and why, one entry a choice."""
    choices = [
        *_signals(plan),
        _axis(plan, "gap_segments", "tables over the gap", "straight lines between the gaps"),
    ]
    if plan.block.kind == "cells":
        return [*choices, *_rows(plan), _knee(plan), _start(plan)]
    if plan.block.kind == "full":
        choices += [
            _axis(plan, "curve_segments", "anhysteretic curve and branch", "these tables"),
            _axis(plan, "inverse_segments", "inverse of the anhysteretic", "this table"),
        ]
    else:
        choices += _closed_form(plan)
    return [*choices, _iterations(plan), _knee(plan), _start(plan)]


def _rows(plan: Plan) -> list[Decision]:
    tried, cells = dict(plan.found.tried["cells"]), plan.sizes.cells
    reason = f"so many thresholds cost {_percent(plan, tried[cells])}"
    if cells - 1 in tried:
        reason += f"; {cells - 1} would cost {_percent(plan, tried[cells - 1])}"
    return [
        Decision("play cells with a threshold", f"{cells}", reason),
        _axis(plan, "curve_segments", "row for each number of moving cells", "these tables"),
    ]


def _signals(plan: Plan) -> list[Decision]:
    model, scales, io = plan.model, plan.block.scales, plan.request.io
    if io == "f32":
        reason = "24 bits of mantissa: nothing has to be scaled"
        return [Decision("signals", "single precision, SI units", reason)]
    step = STEPS[io]
    rows = [
        ("demand", scales.demand, plan.largest, model.output.unit),
        (
            "current",
            scales.current,
            max(abs(end) for end in plan.block.limits.current),
            model.input.unit,
        ),
    ]
    choices = [
        Decision(
            f"full scale of the {name}",
            f"{scale:g} {unit}",
            f"the next round value above {largest:.4g} {unit}; a step of {io} is "
            f"{scale * step:.3g} {unit}, and 32 bits are carried inside",
        )
        for name, scale, largest, unit in rows
    ]
    if model.needs_schedule and model.schedule is not None:
        low, high = 1e3 * scales.gap_low, 1e3 * scales.gap_high
        text = f"{low:g} to {high:g} mm" if model.schedule.unit == "m" else (
            f"{scales.gap_low:g} to {scales.gap_high:g} {model.schedule.unit}"
        )  # fmt: skip
        choices.append(
            Decision(
                f"range of the {model.schedule.name}",
                text,
                "the measured range, so that no code is spent on places the model does not know",
            )
        )
    return choices


def _axis(plan: Plan, axis: str, name: str, what: str) -> Decision:
    chosen = getattr(plan.sizes, axis)
    tried = dict(plan.found.tried[axis])
    if axis == "gap_segments" and not plan.model.needs_schedule:
        return Decision(name, "constant", "nothing runs over the gap")
    reason = f"{what} cost {_percent(plan, tried[chosen])}"
    if chosen - 1 in tried:
        reason += f"; with {2 ** (chosen - 1)} it would be {_percent(plan, tried[chosen - 1])}"
    return Decision(name, f"{2**chosen} segment{'s' if chosen else ''}", reason)


def _closed_form(plan: Plan) -> list[Decision]:
    law, tried = plan.builder.law, plan.found.tried
    sizes = plan.sizes
    choices = [
        Decision(
            "simplified law",
            f"rate {law.rate:.4g}, nu {law.nu:.4g}",
            f"fitted in {plan.model.output.name.replace('_', ' ')} to what the model does over "
            f"its range; worst {_percent(plan, law.worst)} over settled triangles",
        )
    ]
    if plan.block.kind == "simplified":
        cost = max(dict(tried["octaves"])[sizes.octaves], 0.0)
        fine = max(dict(tried["octave_segments"])[sizes.octave_segments], 0.0)
        choices.append(
            Decision(
                "closed form",
                f"{sizes.octaves} octaves of {2**sizes.octave_segments} segments",
                f"so few octaves cost {_percent(plan, cost)}, so few segments "
                f"{_percent(plan, fine)}: the curve is sharp at its start and flat far out",
            )
        )
    return choices


def _iterations(plan: Plan) -> Decision:
    what = "a solve" if plan.block.kind == "full" else "a commit that differs from the solve"
    return Decision(
        "iterations",
        f"{plan.sizes.iterations} in {what}",
        "one more than the fewest that are as good as many, full-range jumps and lost currents "
        "included; at most so many, since a search ends where its tangents lead to the target",
    )


def _knee(plan: Plan) -> Decision:
    k = plan.sizes.root_knee
    if plan.model.power != 2:
        return Decision("root", "none", "the output is proportional to the flux")
    below = plan.block.scales.demand * 4.0**-k
    unit = plan.model.output.unit
    return Decision(
        "root near zero",
        f"straight below {below:.3g} {unit}",
        f"the root's infinite slope would turn the last bit of a demand into a jump of current; "
        f"costs at most {_percent(plan, below / 4.0)} there",
    )


def _start(plan: Plan) -> Decision:
    start = plan.start
    cycles = start.conditioning.cycles
    return Decision(
        "start-up",
        f"{cycles} triangle{'s' * (cycles > 1)} of current in {start.seconds:g} s",
        "whatever the iron remembers at first, afterwards at most "
        f"{_percent(plan, start.remaining)} of it are left",
    )


def _percent(plan: Plan, value: float) -> str:
    return f"{100.0 * value / plan.largest:.2g} %"
