"""Which law and gap map all magnets of a fleet get: what most of the first ones choose."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from anhyst.identification.result import IdentifyResult
from anhyst.study.fleet.judge import FleetSettings, FleetTask, identified
from anhyst.study.fleet.members import Member
from anhyst.support.atomic import atomic_writer
from anhyst.support.errors import InputError
from anhyst.support.jobs import all_of
from anhyst.support.json_text import json_text
from anhyst.support.version import running_version

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

    def task(self, member: Member, asked: FleetSettings, out: Path) -> FleetTask:
        """Return what is to be done with a magnet, given what was asked for in the first place."""
        search = asked if member.name in self.pilots else self.settings
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
    if (known := _known(members, settings, out / CHOICE)) is not None:
        return known
    found: dict[str, IdentifyResult] = {}
    asked: list[Member] = []
    while len(found) < PILOTS and len(asked) < len(members):
        following = members[len(asked) : len(asked) + PILOTS - len(found)]
        asked += following
        tasks = [
            FleetTask(one, settings, out, (settings.law, settings.gap_map)) for one in following
        ]
        results = all_of(_choice_of, tasks, jobs=jobs)
        found |= {m.name: r for m, r in zip(following, results, strict=True) if r is not None}
    if not found:
        return FleetChoice(settings)
    chosen = {name: (one.model.law, one.model.gap_map) for name, one in found.items()}
    most = Counter(chosen.values()).most_common(1)[0][0]
    pilots = tuple(name for name, own in chosen.items() if own == most)
    law, gap_map = most[0], "auto" if most[1] == "none" else most[1]
    kept = {
        "made_from": _made_from(asked, settings),
        "law": law,
        "gap_map": gap_map,
        "pilots": list(pilots),
    }
    with atomic_writer(out / CHOICE) as stream:
        stream.write(json_text(kept))
    return FleetChoice(
        replace(settings, law=law, gap_map=gap_map), pilots, {name: found[name] for name in pilots}
    )


def _choice_of(task: FleetTask) -> IdentifyResult | None:
    """Let a magnet choose; what is wrong with one that cannot is said when it is judged."""
    try:
        return identified(task)
    except Exception:
        return None


def _made_from(asked: Sequence[Member], settings: FleetSettings) -> dict[str, Any]:
    """Return all that a decision rests on."""
    return {
        "version": running_version(),
        "wanted": [settings.law, settings.gap_map, settings.seed, settings.history],
        "sha256": {one.name: _digest(one) for one in asked},
    }


def _digest(member: Member) -> str:
    """Return the hash of a magnet's files, nothing where they cannot be read."""
    try:
        return member.digest()
    except InputError:
        return ""


def _known(members: Sequence[Member], settings: FleetSettings, path: Path) -> FleetChoice | None:
    """Return a decision that was made of the same magnets with the same settings."""
    try:
        kept = json.loads(path.read_text(encoding="utf-8"))
        asked = members[: len(kept["made_from"]["sha256"])]
        if kept["made_from"] != _made_from(asked, settings):
            return None
        chosen = replace(settings, law=str(kept["law"]), gap_map=str(kept["gap_map"]))
        return FleetChoice(chosen, tuple(kept["pilots"]))
    except (OSError, ValueError, KeyError, TypeError):
        return None
