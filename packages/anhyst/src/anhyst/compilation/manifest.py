"""An output folder and its manifest: what every tool has to know of it, and the memory that it takes."""

from __future__ import annotations

import hashlib
import json
import os
import re
from collections.abc import Iterable, Iterator, Mapping
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
from anhyst.compilation.toolchain import read_core
from anhyst.model.actuator import Model
from anhyst.support.atomic import PathLike, as_bytes, json_text, whole_folder, write_files
from anhyst.support.block_layout import BODY
from anhyst.support.block_words import Names, Scales
from anhyst.support.errors import InputError
from anhyst.support.result import Result

CELLS = 12
"""``ANHYST_CELLS``: plays of the law of cells that a compensator has room for."""


def state_bytes(block: Block) -> int:
    """Return the size of everything that changes."""
    suffix = "" if block.is_fixed else "_x"
    sizes = _state_sizes()
    deeper = sizes[f"anhyst_deeper{suffix}"] * (block.memories - 1)
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
    deeper = sizes["anhyst_deeper"] * (block.memories - 1)
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
    plan: Plan,
    budget: Budget,
    choices: Iterable[Decision],
    sha256: str,
    version: str,
    controller: ControllerPlan | None = None,
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
        "memory": {"parameters_bytes": block.size, "state_bytes": state_bytes(block)},
        "parameters": list(_words(plan, block)),
        "controller": None if controller is None else _controller(controller),
        "conditioning": _conditioning(plan),
        "accuracy": _accuracy(budget),
        "plan": {choice.name: f"{choice.value}: {choice.reason}" for choice in choices},
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
        text = f"{out}: holds files that anhyst compile has not written; name another folder"
        raise InputError(text, code="folder-holds-other-files")
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
