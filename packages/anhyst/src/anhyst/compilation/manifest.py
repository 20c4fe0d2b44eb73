"""An output folder and its manifest: what every tool has to know of it; memory, choices in words."""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

from anhyst._core import POSITION_MAGNETS
from anhyst.compensate.block import Block, DemandLimits
from anhyst.compensate.budget import Budget, percent
from anhyst.compensate.holding import SECONDS
from anhyst.compensate.plan import Decision, Plan
from anhyst.compilation.controller import ControllerPlan, described
from anhyst.compilation.parameters import memories
from anhyst.compilation.toolchain import read_core
from anhyst.model.actuator import Model
from anhyst.support.atomic import PathLike, as_bytes, json_text, whole_folder, write_files
from anhyst.support.block_layout import BODY
from anhyst.support.block_words import Names, Scales
from anhyst.support.errors import InputError
from anhyst.support.result import Result

STEPS = {"q15": 2.0**-15, "q31": 2.0**-31}


def explain(plan: Plan) -> list[Decision]:
    """Say what was chosen and why, one entry a choice."""
    choices = [
        *_signal_choices(plan),
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


def _signal_choices(plan: Plan) -> list[Decision]:
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


CELLS = 12
"""``ANHYST_CELLS``: plays of the law of cells that a compensator has room for."""


def parameters_bytes(block: Block) -> int:
    """Return the size of everything that is constant."""
    return block.size


def state_bytes(block: Block) -> int:
    """Return the size of everything that changes."""
    suffix = "" if block.is_fixed else "_x"
    sizes = _state_sizes()
    deeper = sizes[f"anhyst_deeper{suffix}"] * (memories(block) - 1)
    return sizes[f"anhyst_compensator{suffix}"] + deeper


def controller_bytes(magnets: int, block: Block) -> int:
    """Return the size of everything that changes in a position controller and its force controllers."""
    headers = (
        *("control/supervisor.h", "control/levitation.h", "numeric/factor.h", "control/pidd2.h"),
        *("compensator/compensator.h", "compensator/force_controller.h"),
    )
    generic = ("compensator/generic/force_controller.h", "control/generic/position.h")
    sizes = _structures(
        *(read_core(f"include/anhyst/{name}") for name in headers),
        *(_in_q31(read_core(f"include/anhyst/{name}")) for name in generic),
        MAGNETS=POSITION_MAGNETS,
        CELLS=CELLS,
    )
    deeper = sizes["anhyst_deeper"] * (memories(block) - 1)
    return sizes["anhyst_position_q31"] + magnets * (sizes["anhyst_force_controller_q31"] + deeper)


def _in_q31(text: str) -> str:
    """Return the structures of a generic header as they are in fixed point."""
    return re.sub(r"\b(anhyst_\w+)_x\b", r"\1_q31", text).replace("ANHYST_REAL", "int32_t")


@cache
def _state_sizes() -> dict[str, int]:
    """Return the sizes of structures in fixed point, and in single precision by names in ``_x``."""
    headers = "compensator.h", "generic/compensator.h"
    texts = [read_core(f"include/anhyst/compensator/{name}") for name in headers]
    return _structures(*texts, CELLS=CELLS)


def _structures(*texts: str, **numbers: int) -> dict[str, int]:
    """Size structures and unions, short members at the end, each a multiple of four bytes."""
    sizes = {"int32_t": 4, "uint16_t": 2, "int16_t": 2, "ANHYST_REAL": 4}
    for text in texts:
        plain = re.sub(r"/\*.*?\*/", "", text, flags=re.S)
        sizes |= {name: sizes[same] for same, name in re.findall(r"typedef (\w+) (\w+);", plain)}
        each = re.findall(r"typedef (struct|union) (?:\w+ )?\{([^}]*)\} (\w+);", plain)
        for kind, members, name in each:
            each_size = _members(members, sizes, numbers)
            size = max(each_size) if kind == "union" else sum(each_size)
            sizes[name] = -(-size // 4) * 4
    return sizes


def _members(text: str, sizes: dict[str, int], numbers: dict[str, int]) -> Iterator[int]:
    for kind, pointer, count in re.findall(
        r"(?:const )?(\w+)\s+(\*?)\w+(?:\[(?:ANHYST_(?:POSITION_)?)?(\w+)\])?;", text
    ):
        times = int(count) if count.isdigit() else numbers.get(count, 1)
        yield (4 if pointer else sizes.get(kind, 0)) * times


VERSION = 2


def manifest(
    plan: Plan, budget: Budget, sha256: str, version: str, controller: ControllerPlan | None = None
) -> dict[str, Any]:
    """Return the manifest without the list of files."""
    block, request = plan.block, plan.request
    return {
        "format": VERSION,
        "anhyst": version,
        "name": plan.name,
        "model": {"name": plan.model.name, "sha256": sha256},
        "kind": block.kind,
        "io": request.io,
        "rate_Hz": request.rate,
        "signals": signal_entries(request.io, plan.model, block.scales, block.limits),
        "limits": {"demand": list(block.limits.demand), "current": list(block.limits.current)},
        "memory": {"parameters_bytes": parameters_bytes(block), "state_bytes": state_bytes(block)},
        "parameters": list(_words(plan, block)),
        "controller": None if controller is None else _controller(controller),
        "conditioning": _conditioning(plan),
        "accuracy": _accuracy(budget),
        "plan": {choice.name: f"{choice.value}: {choice.reason}" for choice in explain(plan)},
    }


def _controller(controller: ControllerPlan) -> dict[str, Any]:
    return described(controller) | {
        "state_bytes": controller_bytes(controller.magnets, controller.block)
    }


def _words(plan: Plan, block: Block) -> Iterator[dict[str, Any]]:
    """Describe every word behind the head, as the comments of the C do."""
    names = Names(plan.model.output.unit, plan.model.input.unit)
    for word in BODY[block.kind]:
        unit = block.unit(word, names)
        first, entries = block.tables.get(word.name, (word.at, word.size))
        yield {
            "name": word.name,
            "word": word.at,
            "first": first,
            "entries": entries,
            "format": word.format if block.is_fixed else plan.request.io,
            "low": word.low,
            "high": word.high,
            "scale": unit.scale,
            "unit": unit.name,
            "doc": word.doc,
        }


def _conditioning(plan: Plan) -> dict[str, Any]:
    start = plan.start
    return {
        "cycles": start.conditioning.cycles,
        "ticks": start.conditioning.ramp_ticks,
        "seconds": start.seconds,
        "remaining_percent": 100.0 * start.remaining / plan.largest,
    }


def _accuracy(budget: Budget) -> dict[str, Any]:
    compiled, total = budget.compiled, budget.total
    assert compiled.worst is not None
    assert compiled.rms is not None
    assert total.worst is not None
    assert budget.drift.worst is not None
    return {
        "unit": budget.unit,
        "largest_output": budget.largest,
        "wanted_percent": None if budget.wanted is None else percent(budget, budget.wanted),
        "worst": compiled.worst,
        "worst_percent": percent(budget, compiled.worst),
        "rms_percent": percent(budget, compiled.rms),
        "total_worst_percent": percent(budget, total.worst),
        "drift_percent": percent(budget, budget.drift.worst),
        "drift_seconds": SECONDS,
    }


def signal_entries(io: str, model: Model, scales: Scales, limits: DemandLimits) -> dict[str, Any]:
    """Return what the manifest says of the signals; nothing of a gap where none counts."""
    ends = {
        "demand": (model.output, *limits.demand, scales.demand),
        "current": (model.input, *limits.current, scales.current),
        "gap": (model.schedule, scales.gap_low, scales.gap_high, scales.gap_high),
    }
    return {
        signal: None if quantity is None else {
            "quantity": quantity.name,
            "unit": quantity.unit,
            "low": low,
            "high": high,
            "scale": scale,
            "format": io,
        }
        for signal, (quantity, low, high, scale) in ends.items()
    }  # fmt: skip


MANIFEST = "manifest.json"
FORMAT = "anhyst-compiled"
REPORTS = ("verify.json", "verify.md")
"""What ``anhyst verify`` adds; it goes with the C that it is about."""


@dataclass(frozen=True, repr=False)
class CompiledFolder(Result):
    """A folder that was written, of any kind."""

    out: Path
    manifest: dict[str, Any]
    files: tuple[str, ...]

    def as_dict(self) -> dict[str, Any]:
        """Return manifest and names of the files, for JSON."""
        return {"out": str(self.out), **self.manifest, "files": list(self.files)}


def check_folder(out: PathLike) -> None:
    """Find out before the work whether a folder may be written."""
    target = Path(os.path.realpath(out))
    if target.exists() and not target.is_dir():
        raise InputError(f"{out}: is a file; name a folder", code="is-a-file")
    if target.is_dir() and any(target.iterdir()) and not _is_ours(target):
        raise InputError(
            f"{out}: holds files that anhyst compile has not written; name another folder",
            code="folder-holds-other-files",
        )
    if not target.parent.is_dir():
        raise InputError(f"{target.parent}: no such folder; create it first", code="no-such-folder")
    if not os.access(target.parent, os.W_OK):
        raise InputError(
            f"{target.parent}: cannot be written; name another folder", code="cannot-be-written"
        )


def _is_ours(folder: Path) -> bool:
    """Whether every file there is in the manifest there, or a report on the C that stood there."""
    try:
        manifest = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
        ours = {MANIFEST, *REPORTS, *manifest["files"]}
        files = {path for path in folder.rglob("*") if not path.is_dir()}
        return manifest["product"] == FORMAT and files <= {folder / name for name in ours}
    except (OSError, ValueError, KeyError, TypeError):
        return False


def write_folder(
    out: PathLike, files: Mapping[str, str | bytes], manifest: Mapping[str, object]
) -> None:
    """Write all files of a folder, or none."""
    check_folder(out)
    contents = {name: as_bytes(content) for name, content in files.items()}
    hashes = {name: hashlib.sha256(content).hexdigest() for name, content in contents.items()}
    complete = {"product": FORMAT, **manifest, "files": dict(sorted(hashes.items()))}
    with whole_folder(out, replace=True) as draft:
        write_files(draft, {**files, MANIFEST: json_text(complete)})
