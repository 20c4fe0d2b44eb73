"""Write an output folder with its manifest, and calculate the memory of a compensator."""

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
from anhyst.compensate.output_drift import HOLD_TIME_S
from anhyst.compensate.plan import Decision, Plan
from anhyst.compilation.controller import ControllerPlan, controller_entry
from anhyst.compilation.toolchain import read_core
from anhyst.model.actuator import Model
from anhyst.support.atomic import (
    PathLike,
    atomic_folder,
    check_folder_writable,
    json_text,
    to_bytes,
    write_files,
)
from anhyst.support.block_layout import BODY_WORDS
from anhyst.support.block_words import Scales, SignalUnits
from anhyst.support.errors import InputError
from anhyst.support.result import Result

MAX_CELLS = 12
"""``ANHYST_CELLS``: maximum number of play cells of a compensator."""


def state_bytes(block: Block) -> int:
    """Return the size of the state of a compensator, bytes."""
    suffix = "" if block.is_fixed else "_x"
    sizes = _state_sizes()
    further_memories = sizes[f"anhyst_deeper{suffix}"] * (block.memory_count - 1)
    return sizes[f"anhyst_compensator{suffix}"] + further_memories


def controller_bytes(magnets: int, block: Block) -> int:
    """Return the size of the state of a position controller and its force controllers, bytes."""
    headers = (
        *("control/supervisor.h", "control/levitation.h", "numeric/factor.h", "control/pidd2.h"),
        *("compensator/compensator.h", "compensator/force_controller.h"),
    )
    generic_headers = ("compensator/generic/force_controller.h", "control/generic/position.h")
    sizes = _structure_sizes(
        *(read_core(f"include/anhyst/{name}") for name in headers),
        *(_as_q31_header(read_core(f"include/anhyst/{name}")) for name in generic_headers),
        MAGNETS=POSITION_MAGNETS,
        CELLS=MAX_CELLS,
    )
    further_memories = sizes["anhyst_deeper"] * (block.memory_count - 1)
    return sizes["anhyst_position_q31"] + magnets * (sizes["anhyst_force_controller_q31"] + further_memories)


def _as_q31_header(text: str) -> str:
    """Return the structures of a generic header in fixed point."""
    return re.sub(r"\b(anhyst_\w+)_x\b", r"\1_q31", text).replace("ANHYST_REAL", "int32_t")


@cache
def _state_sizes() -> dict[str, int]:
    """Return the sizes of structures in fixed point, and in single precision by names with ``_x``."""
    headers = "compensator.h", "generic/compensator.h"
    texts = [read_core(f"include/anhyst/compensator/{name}") for name in headers]
    return _structure_sizes(*texts, CELLS=MAX_CELLS)


def _structure_sizes(*texts: str, **numbers: int) -> dict[str, int]:
    """Return the sizes of structures and unions, rounded up to 4 bytes.

    Short members must be at the end of a structure.
    """
    sizes = {"int32_t": 4, "uint16_t": 2, "int16_t": 2, "ANHYST_REAL": 4}
    for text in texts:
        code_text = re.sub(r"/\*.*?\*/", "", text, flags=re.S)
        sizes |= {name: sizes[source] for source, name in re.findall(r"typedef (\w+) (\w+);", code_text)}
        definitions = re.findall(r"typedef (struct|union) (?:\w+ )?\{([^}]*)\} (\w+);", code_text)
        for kind, members, name in definitions:
            sizes_of_members = _member_sizes(members, sizes, numbers)
            size = max(sizes_of_members) if kind == "union" else sum(sizes_of_members)
            sizes[name] = -(-size // 4) * 4
    return sizes


def _member_sizes(text: str, sizes: dict[str, int], constants: dict[str, int]) -> Iterator[int]:
    for kind, pointer, length_text in re.findall(
        r"(?:const )?(\w+)\s+(\*?)\w+(?:\[(?:ANHYST_(?:POSITION_)?)?(\w+)\])?;", text
    ):
        array_length = int(length_text) if length_text.isdigit() else constants.get(length_text, 1)
        yield (4 if pointer else sizes.get(kind, 0)) * array_length


MANIFEST_VERSION = 2


def make_manifest(
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
        "format": MANIFEST_VERSION,
        "anhyst": version,
        "name": plan.name,
        "model": {"name": plan.model.name, "sha256": sha256},
        "kind": block.kind,
        "io": request.io,
        "rate_Hz": request.rate,
        "signals": signal_entries(request.io, plan.model, block.scales, block.limits),
        "limits": {"demand": list(block.limits.demand), "current": list(block.limits.current)},
        "memory": {"parameters_bytes": block.size, "state_bytes": state_bytes(block)},
        "parameters": list(_word_entries(plan, block)),
        "controller": None if controller is None else _controller_entry(controller),
        "conditioning": _conditioning_entry(plan),
        "accuracy": _accuracy_entry(budget),
        "plan": {choice.name: f"{choice.value}: {choice.reason}" for choice in choices},
    }


def _controller_entry(controller: ControllerPlan) -> dict[str, Any]:
    return controller_entry(controller) | {
        "state_bytes": controller_bytes(controller.magnets, controller.block)
    }


def _word_entries(plan: Plan, block: Block) -> Iterator[dict[str, Any]]:
    """Yield an entry for each word after the head, as in the comments of the generated C file."""
    names = SignalUnits(plan.model.output.unit, plan.model.input.unit)
    for word in BODY_WORDS[block.kind]:
        unit = block.word_unit(word, names)
        first_index, entries = block.tables.get(word.name, (word.index, word.size))
        yield {
            "name": word.name,
            "word": word.index,
            "first": first_index,
            "entries": entries,
            "format": word.format if block.is_fixed else plan.request.io,
            "low": word.low,
            "high": word.high,
            "scale": unit.scale,
            "unit": unit.name,
            "doc": word.doc,
        }


def _conditioning_entry(plan: Plan) -> dict[str, Any]:
    start = plan.start_up
    return {
        "cycles": start.conditioning.cycles,
        "ticks": start.conditioning.ramp_ticks,
        "seconds": start.seconds,
        "remaining_percent": 100.0 * start.remaining_difference / plan.reference_output,
    }


def _accuracy_entry(budget: Budget) -> dict[str, Any]:
    compiled, total = budget.compiled, budget.total
    assert compiled.worst is not None
    assert compiled.rms is not None
    assert total.worst is not None
    assert budget.drift.worst is not None
    return {
        "unit": budget.unit,
        "largest_output": budget.reference_output,
        "wanted_percent": None if budget.required is None else percent(budget, budget.required),
        "worst": compiled.worst,
        "worst_percent": percent(budget, compiled.worst),
        "rms_percent": percent(budget, compiled.rms),
        "total_worst_percent": percent(budget, total.worst),
        "drift_percent": percent(budget, budget.drift.worst),
        "drift_seconds": HOLD_TIME_S,
    }


def signal_entries(io: str, model: Model, scales: Scales, limits: DemandLimits) -> dict[str, Any]:
    """Return the entries of the signals; None for the gap if the model does not need it."""
    ranges = {
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
        for signal, (quantity, low, high, scale) in ranges.items()
    }  # fmt: skip


MANIFEST_FILE = "manifest.json"
PRODUCT = "anhyst-compiled"
REPORT_FILES = ("verify.json", "verify.md")
"""Reports of ``anhyst verify``; they are replaced together with the C files."""


@dataclass(frozen=True, repr=False)
class CompiledFolder(Result):
    """Folder of C files that was written."""

    out: Path
    manifest: dict[str, Any]
    files: tuple[str, ...]

    def as_dict(self) -> dict[str, Any]:
        """Return manifest and file names, for JSON."""
        return {"out": str(self.out), **self.manifest, "files": list(self.files)}


def check_folder(out: PathLike) -> None:
    """Check that a folder may be written."""
    check_folder_writable(out, replace=True)
    target = Path(os.path.realpath(out))
    if target.is_dir() and any(target.iterdir()) and not _is_compiled_folder(target):
        text = f"{out}: contains files that anhyst compile did not write; name another folder"
        raise InputError(text, code="folder-holds-other-files")
    if not target.parent.is_dir():
        raise InputError(f"{target.parent}: no such folder; create it first", code="no-such-folder")


def _is_compiled_folder(folder: Path) -> bool:
    """Whether all files of a folder are in its manifest, or are reports."""
    try:
        manifest = json.loads((folder / MANIFEST_FILE).read_text(encoding="utf-8"))
        listed_files = {MANIFEST_FILE, *REPORT_FILES, *manifest["files"]}
        files = {path for path in folder.rglob("*") if not path.is_dir()}
        return manifest["product"] == PRODUCT and files <= {folder / name for name in listed_files}
    except (OSError, ValueError, KeyError, TypeError):
        return False


def write_folder(out: PathLike, files: Mapping[str, str | bytes], manifest: Mapping[str, object]) -> None:
    """Write all files of a folder; an error leaves no partial folder."""
    check_folder(out)
    contents = {name: to_bytes(content) for name, content in files.items()}
    hashes = {name: hashlib.sha256(content).hexdigest() for name, content in contents.items()}
    complete_manifest = {"product": PRODUCT, **manifest, "files": dict(sorted(hashes.items()))}
    with atomic_folder(out, replace=True) as draft_folder:
        write_files(draft_folder, {**files, MANIFEST_FILE: json_text(complete_manifest)})
