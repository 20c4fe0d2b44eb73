"""The magnets of a fleet one by one: found, a law chosen for all, identified, compiled, verified."""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from anhyst.compensate.block import Kind as BlockKind
from anhyst.compensate.force_controller import Io
from anhyst.compensate.plan import CompileRequest
from anhyst.compilation.output import compile_model
from anhyst.data.formats import FORMATS
from anhyst.data.reading import files_read, read_loops
from anhyst.data.verdict import largest_output
from anhyst.identification import identify
from anhyst.identification.run import IdentifyResult, whole_search
from anhyst.model.actuator import read_model
from anhyst.support import running_version
from anhyst.support.atomic import PathLike, json_text, read_error, write_json
from anhyst.support.errors import InputError, NegativeResult
from anhyst.support.jobs import all_of
from anhyst.support.numeric import rms
from anhyst.verification.verify import verify


@dataclass(frozen=True)
class Member:
    """One magnet of a fleet."""

    name: str  # of its file without the ending, or of its folder
    source: Path  # A file of loops, or a folder of them

    def digest(self) -> str:
        """Return the SHA-256 of all that is read of it."""
        whole = hashlib.sha256()
        for path in files_read(self.source):
            whole.update(path.name.encode())
            try:
                whole.update(path.read_bytes())
            except OSError as error:
                raise read_error(path, error) from None
        return whole.hexdigest()


def find_members(folder: PathLike) -> list[Member]:
    """Return the magnets of a folder, by name: every file of loops, and every folder of them."""
    root = Path(folder)
    if not root.is_dir():
        raise InputError(
            f"{root}: is no folder; name one that holds a file or folder a magnet",
            code="no-such-folder",
        )
    members = [
        Member(path.stem if path.is_file() else path.name, path)
        for path in sorted(root.iterdir())
        if (path.is_file() and path.suffix.lower() in FORMATS) or _holds_loops(path)
    ]
    if not members:
        raise InputError(
            f"{root}: holds no {', '.join(FORMATS)} file and no folder of them", code="no-files"
        )
    names: set[str] = set()
    for member in members:
        if member.name in names:
            raise InputError(
                f"{member.source}: two magnets are called '{member.name}'; rename one",
                code="name-twice",
            )
        names.add(member.name)
    return members


def _holds_loops(path: Path) -> bool:
    return path.is_dir() and any(file.suffix.lower() in FORMATS for file in path.iterdir())


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
        outcome = _judged(task)
    except (InputError, NegativeResult) as error:
        outcome = {"error": str(error)}
    except Exception as fault:
        outcome = {"error": f"a fault of anhyst: {type(fault).__name__}: {fault}"}
    result = {"name": task.member.name, **outcome, "made_from": made_from}
    task.folder.mkdir(parents=True, exist_ok=True)
    write_json(task.folder / RESULT, result)
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
    settings = task.settings
    found = task.found or identified(task)
    loops = found.loops
    model, folder = found.model, task.folder
    folder.mkdir(parents=True, exist_ok=True)
    model_file = model.save(folder / MODEL)
    request = CompileRequest(settings.kind, settings.io, settings.rate)
    compiled = compile_model(model_file, folder / CONTROLLER, request)
    verified = verify(folder / CONTROLLER, settings.on, _VERIFIED_STEPS, _VERIFIED_STEPS)
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


def share(file: Path, history: str | None, member: Member) -> float:
    """Return the rms deviation of another magnet's model on this one's loops, parts of the largest.

    Not a number where that model cannot be computed on these loops.
    """
    loops = read_loops(member.source, history=history)
    model = read_model(file)
    try:
        errors = np.concatenate([model.on(loop) - loop.output for loop in loops.loops])
    except (InputError, NegativeResult):
        return float("nan")
    return rms(errors) / largest_output(loops)


PILOTS = 3
"""Magnets that decide together."""
CHOICE = "choice.json"
"""Keeps the decision: a run that goes on does not make it again."""


@dataclass(frozen=True)
class FleetChoice:
    """What was decided."""

    settings: FleetSettings  # with the law and the gap map that all get
    # names of those that chose just these: nothing else is to be fitted to them
    pilots: tuple[str, ...] = ()
    # their identifications by name, where they were made just now
    found: dict[str, IdentifyResult] = field(default_factory=dict)

    def task(self, member: Member, given_settings: FleetSettings, out: Path) -> FleetTask:
        """Return what is to be done with a magnet, given what was asked for in the first place."""
        search = given_settings if member.name in self.pilots else self.settings
        return FleetTask(
            member, self.settings, out, (search.law, search.gap_map), self.found.get(member.name)
        )


def decide(
    members: Sequence[Member], settings: FleetSettings, out: Path, jobs: int | None
) -> FleetChoice:
    """Find the law and gap map that most of the first magnets choose that can be identified.

    Where none can, settings stay, and each magnet says by itself what is wrong with it.
    """
    if "auto" not in {settings.law, settings.gap_map}:
        return FleetChoice(settings)
    if (known := _known_choice(members, settings, out / CHOICE)) is not None:
        return known
    identifications: dict[str, IdentifyResult] = {}
    asked: list[Member] = []
    while len(identifications) < PILOTS and len(asked) < len(members):
        following = members[len(asked) : len(asked) + PILOTS - len(identifications)]
        asked += following
        tasks = [
            FleetTask(member, settings, out, (settings.law, settings.gap_map))
            for member in following
        ]
        results = all_of(_choice_of, tasks, jobs=jobs)
        identifications |= {
            m.name: r for m, r in zip(following, results, strict=True) if r is not None
        }
    if not identifications:
        return FleetChoice(settings)
    chosen = {
        name: (member.model.law, member.model.gap_map) for name, member in identifications.items()
    }
    most = Counter(chosen.values()).most_common(1)[0][0]
    pilots = tuple(name for name, own in chosen.items() if own == most)
    law, gap_map = most[0], "auto" if most[1] == "none" else most[1]
    kept = {
        "made_from": _made_from(asked, settings),
        "law": law,
        "gap_map": gap_map,
        "pilots": list(pilots),
    }
    write_json(out / CHOICE, kept)
    return FleetChoice(
        replace(settings, law=law, gap_map=gap_map),
        pilots,
        {name: identifications[name] for name in pilots},
    )


def _choice_of(task: FleetTask) -> IdentifyResult | None:
    """Let a magnet choose; what is wrong with one that cannot is said when it is judged."""
    try:
        return identified(task)
    except Exception:
        return None


def _made_from(pilots: Sequence[Member], settings: FleetSettings) -> dict[str, Any]:
    """Return all that a decision rests on; files that cannot be read have no hash."""
    digests = dict.fromkeys((member.name for member in pilots), "")
    for member in pilots:
        with suppress(InputError):
            digests[member.name] = member.digest()
    return {
        "version": running_version(),
        "wanted": [settings.law, settings.gap_map, settings.seed, settings.history],
        "sha256": digests,
    }


def _known_choice(
    members: Sequence[Member], settings: FleetSettings, path: Path
) -> FleetChoice | None:
    """Return a decision that was made of the same magnets with the same settings."""
    try:
        kept = json.loads(path.read_text(encoding="utf-8"))
        pilots = members[: len(kept["made_from"]["sha256"])]
        if kept["made_from"] != _made_from(pilots, settings):
            return None
        chosen = replace(settings, law=str(kept["law"]), gap_map=str(kept["gap_map"]))
        return FleetChoice(chosen, tuple(kept["pilots"]))
    except (OSError, ValueError, KeyError, TypeError):
        return None
