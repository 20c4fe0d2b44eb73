"""Process the magnets of a fleet one by one: find, identify, compile and verify them.

By default, all magnets get the hysteresis law and the gap map that most of the first magnets
select. Each result is stored with a hash of its inputs, so that an interrupted run can continue.
"""

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
from anhyst.compensate.force_controller import SignalFormat
from anhyst.compensate.plan import CompileRequest
from anhyst.compilation.output import compile_model
from anhyst.data.formats import FORMATS
from anhyst.data.input_files import list_input_files
from anhyst.data.reading import read_loops
from anhyst.data.verdict import largest_output
from anhyst.identification import identify
from anhyst.identification.run import IdentifyResult, require_complete
from anhyst.model.actuator import read_model
from anhyst.support import running_version
from anhyst.support.atomic import PathLike, json_text, read_error, write_json
from anhyst.support.errors import InputError, NegativeResult
from anhyst.support.jobs import map_ordered
from anhyst.support.numeric import rms
from anhyst.verification.verify import verify


@dataclass(frozen=True)
class Member:
    """A magnet of a fleet."""

    name: str  # name of the magnet's file without extension, or of its folder
    source: Path  # file of loops, or folder of such files

    def digest(self) -> str:
        """Return the SHA-256 of all files of the magnet."""
        digest = hashlib.sha256()
        for path in list_input_files(self.source):
            digest.update(path.name.encode())
            try:
                digest.update(path.read_bytes())
            except OSError as error:
                raise read_error(path, error) from None
        return digest.hexdigest()


def find_members(folder: PathLike) -> list[Member]:
    """Return the magnets of a folder in the order of their names.

    Each file of loops is a magnet, and so is each folder of such files.
    """
    root = Path(folder)
    if not root.is_dir():
        raise InputError(
            f"{root}: is not a folder; give one with a file or folder for each magnet", code="no-such-folder"
        )
    members = [
        Member(path.stem if path.is_file() else path.name, path)
        for path in sorted(root.iterdir())
        if (path.is_file() and path.suffix.lower() in FORMATS) or _contains_loops(path)
    ]
    if not members:
        raise InputError(
            f"{root}: contains no {', '.join(FORMATS)} file and no folder of them", code="no-files"
        )
    names: set[str] = set()
    for member in members:
        if member.name in names:
            raise InputError(
                f"{member.source}: two magnets are called '{member.name}'; rename one", code="name-twice"
            )
        names.add(member.name)
    return members


def _contains_loops(path: Path) -> bool:
    return path.is_dir() and any(file.suffix.lower() in FORMATS for file in path.iterdir())


RESULT_FILE = "result.json"
MODEL_FILE = "model.toml"
CONTROLLER_FOLDER = "controller"
_VERIFICATION_STEPS = 20_000


@dataclass(frozen=True)
class FleetSettings:
    """Settings that apply to all magnets."""

    rate: float  # tick rate of the controllers, Hz
    kind: BlockKind = "full"  # kind of the compensators
    io: SignalFormat = "q31"
    # the same for all magnets; ``auto``: the one that most of the first magnets select
    law: str = "auto"
    gap_map: str = "auto"
    on: str = "host"  # targets of the verification
    # largest rms force error of a good magnet, per cent of its largest force
    tolerance: float = 1.0
    seed: int = 1  # seed of the search
    # history before every loop; None: from sidecars, or proposed for each record
    history: str | None = None


@dataclass(frozen=True)
class FleetTask:
    """A magnet, and the settings for its evaluation."""

    member: Member
    settings: FleetSettings
    out: Path  # folder in which the magnet gets its own folder
    # law and gap map for the identification; a pilot uses those of the user, such as ``auto``
    search: tuple[str, str]
    identification: IdentifyResult | None = None  # result of the identification, if it is known

    @property
    def folder(self) -> Path:
        """Folder of the magnet's results."""
        return self.out / self.member.name


def evaluate_magnet(task: FleetTask) -> dict[str, Any]:
    """Identify, compile and verify a magnet, unless its stored result is up to date.

    An error of a magnet is part of its result and does not stop the others.
    """
    settings = asdict(task.settings)
    settings.pop("tolerance")  # does not affect the metrics
    made_from: dict[str, Any] = {"version": running_version(), "settings": settings}
    try:
        made_from["sha256"] = task.member.digest()
        if (stored_result := _load_result(task.folder / RESULT_FILE, made_from)) is not None:
            return stored_result
        outcome = _evaluate_member(task)
    except (InputError, NegativeResult) as error:
        outcome = {"error": str(error)}
    except Exception as fault:
        outcome = {"error": f"internal error of anhyst: {type(fault).__name__}: {fault}"}
    result = {"name": task.member.name, **outcome, "made_from": made_from}
    task.folder.mkdir(parents=True, exist_ok=True)
    write_json(task.folder / RESULT_FILE, result)
    return dict(json.loads(json_text(result)))


def _load_result(path: Path, made_from: Mapping[str, Any]) -> dict[str, Any] | None:
    """Return a stored result of the same files and the same settings, or None."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    is_current = isinstance(content, dict) and content.get("made_from") == made_from
    return content if is_current else None


def identify_member(task: FleetTask) -> IdentifyResult:
    """Identify the model of one magnet."""
    loops = read_loops(task.member.source, history=task.settings.history)
    law, gap_map = task.search
    return require_complete(identify(loops, law=law, gap_map=gap_map, seed=task.settings.seed))


def _evaluate_member(task: FleetTask) -> dict[str, Any]:
    settings = task.settings
    identification = task.identification or identify_member(task)
    loops = identification.loops
    model, folder = identification.model, task.folder
    folder.mkdir(parents=True, exist_ok=True)
    model_file = model.save(folder / MODEL_FILE)
    request = CompileRequest(settings.kind, settings.io, settings.rate)
    compiled = compile_model(model_file, folder / CONTROLLER_FOLDER, request)
    verified = verify(folder / CONTROLLER_FOLDER, settings.on, _VERIFICATION_STEPS, _VERIFICATION_STEPS)
    fit_result, uncertainty = model.fit, model.uncertainty
    assert fit_result is not None
    assert uncertainty is not None
    budget = compiled.budget
    return {
        "law": model.law,
        "gap_map": model.gap_map,
        "largest_output": fit_result.largest_output,
        "fit_rms": fit_result.rms / fit_result.largest_output,
        "fit_worst": fit_result.worst / fit_result.largest_output,
        "compiled_rms": (budget.compiled.rms or 0.0) / budget.reference_output,
        "verified": verified.passed,
        "passed_acceptance": identification.acceptance.passed,
        "quantities": list(uncertainty.names),
        "values": list(uncertainty.values),
        "std": list(uncertainty.std),
        "correlation": [list(matrix_row) for matrix_row in uncertainty.correlation],
        "histories": [loop.history.kind for loop in loops.loops],
        "warnings": list(identification.warnings),
    }


def shared_model_error(file: Path, history: str | None, member: Member) -> float:
    """Return the rms error of another magnet's model on the loops of this magnet.

    The error is relative to the largest output. It is nan if the model cannot predict these loops.
    """
    loops = read_loops(member.source, history=history)
    model = read_model(file)
    try:
        errors = np.concatenate([model.predict_loop(loop) - loop.output for loop in loops.loops])
    except (InputError, NegativeResult):
        return float("nan")
    return rms(errors) / largest_output(loops)


PILOT_COUNT = 3
"""Number of pilots: the first magnets, whose identification selects the law and the gap map."""
CHOICE_FILE = "choice.json"
"""Name of the file with this selection, for a run that is continued."""


@dataclass(frozen=True)
class FleetChoice:
    """The hysteresis law and the gap map of all magnets."""

    settings: FleetSettings  # settings with the law and the gap map of all magnets
    # names of the pilots that selected this law and gap map; they are not identified again
    pilots: tuple[str, ...] = ()
    # identifications of the pilots by name, if this run made them
    identifications: dict[str, IdentifyResult] = field(default_factory=dict)

    def task(self, member: Member, given_settings: FleetSettings, out: Path) -> FleetTask:
        """Return the task of a magnet; a pilot keeps the settings of the user."""
        search_settings = given_settings if member.name in self.pilots else self.settings
        return FleetTask(
            member,
            self.settings,
            out,
            (search_settings.law, search_settings.gap_map),
            self.identifications.get(member.name),
        )


def choose_law(
    members: Sequence[Member], settings: FleetSettings, out: Path, jobs: int | None
) -> FleetChoice:
    """Return the hysteresis law and the gap map that most of the first identifiable magnets select.

    If none can be identified, the settings are unchanged, and each magnet reports its own error.
    """
    if "auto" not in {settings.law, settings.gap_map}:
        return FleetChoice(settings)
    if (stored_choice := _load_choice(members, settings, out / CHOICE_FILE)) is not None:
        return stored_choice
    identifications: dict[str, IdentifyResult] = {}
    tried_members: list[Member] = []
    while len(identifications) < PILOT_COUNT and len(tried_members) < len(members):
        next_members = members[len(tried_members) : len(tried_members) + PILOT_COUNT - len(identifications)]
        tried_members += next_members
        tasks = [
            FleetTask(member, settings, out, (settings.law, settings.gap_map)) for member in next_members
        ]
        results = map_ordered(_identify_pilot, tasks, jobs=jobs)
        identifications |= {m.name: r for m, r in zip(next_members, results, strict=True) if r is not None}
    if not identifications:
        return FleetChoice(settings)
    laws_by_pilot = {
        name: (member.model.law, member.model.gap_map) for name, member in identifications.items()
    }
    common_choice = Counter(laws_by_pilot.values()).most_common(1)[0][0]
    pilots = tuple(name for name, choice in laws_by_pilot.items() if choice == common_choice)
    law, gap_map = common_choice[0], "auto" if common_choice[1] == "none" else common_choice[1]
    content = {
        "made_from": _choice_inputs(tried_members, settings),
        "law": law,
        "gap_map": gap_map,
        "pilots": list(pilots),
    }
    write_json(out / CHOICE_FILE, content)
    return FleetChoice(
        replace(settings, law=law, gap_map=gap_map), pilots, {name: identifications[name] for name in pilots}
    )


def _identify_pilot(task: FleetTask) -> IdentifyResult | None:
    """Identify a magnet; return None on an error, which its evaluation will report."""
    try:
        return identify_member(task)
    except Exception:
        return None


def _choice_inputs(pilot_magnets: Sequence[Member], settings: FleetSettings) -> dict[str, Any]:
    """Return all inputs of a selection. An unreadable file has an empty hash."""
    digests = dict.fromkeys((member.name for member in pilot_magnets), "")
    for member in pilot_magnets:
        with suppress(InputError):
            digests[member.name] = member.digest()
    return {
        "version": running_version(),
        "wanted": [settings.law, settings.gap_map, settings.seed, settings.history],
        "sha256": digests,
    }


def _load_choice(members: Sequence[Member], settings: FleetSettings, path: Path) -> FleetChoice | None:
    """Return a stored selection for the same magnets and settings, or None."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        pilot_magnets = members[: len(content["made_from"]["sha256"])]
        if content["made_from"] != _choice_inputs(pilot_magnets, settings):
            return None
        chosen_settings = replace(settings, law=str(content["law"]), gap_map=str(content["gap_map"]))
        return FleetChoice(chosen_settings, tuple(content["pilots"]))
    except (OSError, ValueError, KeyError, TypeError):
        return None
