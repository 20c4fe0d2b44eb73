"""One magnet of a fleet: identified, compiled, verified; its result stands in a file."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from anhyst.compensate.block import Kind as BlockKind
from anhyst.compensate.plan import CompileRequest
from anhyst.compensate.twin import Io
from anhyst.compilation.output import compile_model
from anhyst.data.reading import read_loops
from anhyst.identification import identify
from anhyst.identification.result import IdentifyResult, whole_search
from anhyst.model.actuator import Model
from anhyst.model.file import read_model
from anhyst.study.fleet.members import Member
from anhyst.support.atomic import atomic_writer
from anhyst.support.errors import InputError, NegativeResult
from anhyst.support.json_text import json_text
from anhyst.support.version import running_version
from anhyst.verification.verify import verify

RESULT, MODEL, CONTROLLER = "result.json", "model.toml", "controller"
_VERIFIED_STEPS = 20_000


@dataclass(frozen=True)
class FleetSettings:
    """What is done with every magnet."""

    rate: float  # ticks a second of the controllers, Hz
    kind: BlockKind = "full"  # of the compensators
    io: Io = "q31"
    # the same for all, so that parameters compare; ``auto``: what most of the first magnets choose
    law: str = "auto"
    gap_map: str = "auto"
    on: str = "host"  # targets that the C is verified on
    # largest rms deviation of the force of a good magnet, per cent of its largest
    tolerance: float = 1.0
    seed: int = 1  # of the search
    # what happened before every loop; None: as sidecars say, or as each record proposes
    history: str | None = None


@dataclass(frozen=True)
class FleetTask:
    """A magnet and what to do with it."""

    member: Member
    settings: FleetSettings
    out: Path  # results go to a folder of the magnet's name in it
    # law and gap map to ask identification for: those of the settings, or ``auto`` for one whose
    # own choice they are
    search: tuple[str, str]
    found: IdentifyResult | None = None  # what that gives, where it is known already

    @property
    def folder(self) -> Path:
        """Where its results are."""
        return self.out / self.member.name


def judge(task: FleetTask) -> dict[str, Any]:
    """Identify, compile and verify one magnet; what is done already is not done again.

    Whatever goes wrong with one magnet stands in its result and stops no other.
    """
    settings = asdict(task.settings)
    settings.pop("tolerance")  # has no say in the figures
    made_from: dict[str, Any] = {"version": running_version(), "settings": settings}
    try:
        made_from["sha256"] = task.member.digest()
        if (known := _known(task.folder / RESULT, made_from)) is not None:
            return known
        found = _judged(task)
    except (InputError, NegativeResult) as error:
        found = {"error": str(error)}
    except Exception as fault:
        found = {"error": f"a fault of anhyst: {type(fault).__name__}: {fault}"}
    result = {"name": task.member.name, **found, "made_from": made_from}
    task.folder.mkdir(parents=True, exist_ok=True)
    with atomic_writer(task.folder / RESULT) as stream:
        stream.write(json_text(result))
    return dict(json.loads(json_text(result)))


def _known(path: Path, made_from: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return a result that was made of the same files with the same settings."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    same = isinstance(content, dict) and content.get("made_from") == made_from
    return content if same else None


def identified(task: FleetTask) -> IdentifyResult:
    """Identify the model of one magnet."""
    loops = read_loops(task.member.source, history=task.settings.history)
    law, gap_map = task.search
    return whole_search(identify(loops, law=law, gap_map=gap_map, seed=task.settings.seed))


def _judged(task: FleetTask) -> dict[str, Any]:
    wanted = task.settings
    found = task.found or identified(task)
    loops = found.loops
    model, folder = found.model, task.folder
    folder.mkdir(parents=True, exist_ok=True)
    model_file = model.save(folder / MODEL)
    request = CompileRequest(wanted.kind, wanted.io, wanted.rate)
    compiled = compile_model(model_file, folder / CONTROLLER, request)
    verified = verify(folder / CONTROLLER, wanted.on, _VERIFIED_STEPS, _VERIFIED_STEPS)
    fit, unsure = model.fit, model.uncertainty
    assert fit is not None
    assert unsure is not None
    budget = compiled.budget
    return {
        "law": model.law,
        "gap_map": model.gap_map,
        "largest_output": fit.largest_output,
        "fit_rms": fit.rms / fit.largest_output,
        "fit_worst": fit.worst / fit.largest_output,
        "compiled_rms": (budget.compiled.rms or 0.0) / budget.largest,
        "verified": verified.passed,
        "passed_acceptance": found.acceptance.passed,
        "quantities": list(unsure.names),
        "values": list(unsure.values),
        "std": list(unsure.std),
        "correlation": [list(row) for row in unsure.correlation],
        "histories": [loop.history.kind for loop in loops.loops],
        "warnings": list(found.warnings),
    }


@dataclass(frozen=True)
class SharedTask:
    """A magnet that is to be run with the model of another one."""

    member: Member
    model: Path
    history: str | None


def share(task: SharedTask) -> float:
    """Return the rms deviation of another magnet's model on this one's loops, parts of the largest.

    Not a number where that model cannot be computed on these loops.
    """
    loops = read_loops(task.member.source, history=task.history)
    model: Model = read_model(task.model)
    try:
        errors = np.concatenate(
            [
                model(loop.input, loop.schedule, loop.time, loop.history) - loop.output
                for loop in loops.loops
            ]
        )
    except (InputError, NegativeResult):
        return float("nan")
    largest = max(float(np.abs(loop.output).max()) for loop in loops.loops)
    return float(np.sqrt(np.mean(errors**2))) / largest
