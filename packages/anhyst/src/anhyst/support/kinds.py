"""What kind of file this is, and which verbs take it: asked in one place by all of them."""

from __future__ import annotations

import json
import tomllib
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, TypeVar, cast

from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError
from anhyst.support.registry import Registry

RIG_FORMAT = "anhyst-rig"
"""What the key ``format`` of every rig file says; ``control.kind`` says which kind of rig it is."""


@dataclass(frozen=True, eq=False)
class FileKind:
    """One kind of file or folder that a verb can be given."""

    word: str  # of a rig file its control.kind, of another file its format
    title: str  # one of the kind, as messages call it
    plural: str  # several
    verbs: tuple[str, ...] = ()  # that take one as their first argument
    # why another verb has no use for it, where there is more to say than that
    reasons: Mapping[str, str] = field(default_factory=dict)
    use: str = ""  # what it is used for, where no verb takes it as its first argument
    # by verb: the options that only some kinds take, and that this kind does
    options: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    @property
    def format(self) -> str:
        """What the key ``format`` of such a file says."""
        return self.word

    @property
    def usage(self) -> str:
        """Say which verbs take such a file, or what else it is used for."""
        if self.use or not self.verbs:
            return self.use or "no verb takes it"
        return f"anhyst {_listed(self.verbs, 'and')} take{'s' if len(self.verbs) == 1 else ''} it"

    def has_option(self, verb: str, option: str) -> bool:
        """Whether an option of a verb that only some kinds take is for this one."""
        return option in self.options.get(verb, ())

    def refuse_options(self, verb: str, given: Mapping[str, object]) -> None:
        """Refuse options of a verb that are given (not None) and that this kind does not take."""
        refused = [
            name
            for name, value in given.items()
            if value is not None and not self.has_option(verb, name)
        ]
        if refused:
            raise InputError(
                f"{self.title} has no {' or '.join(refused)}; leave it out",
                code="option-not-for-this",
                key=refused[0],
            )


MODEL = FileKind(
    "anhyst-model",
    "a model",
    "models",
    ("predict", "invert", "report", "diff", "compile", "watch", "export"),
)
CONTROLLER = FileKind(
    "anhyst-controller",
    "a controller file",
    "controller files",
    use="anhyst simulate, tune, compile and live take it with --controller",
)
CALIBRATION = FileKind(
    "anhyst-calibration",
    "a calibration",
    "calibrations",
    use="a rig file names it as control.calibration",
)
COMPILED = FileKind("compiled folder", "a compiled folder", "compiled folders", ("verify", "live"))
PACKAGE = FileKind(
    "package",
    "a package of an ecosystem",
    "packages of ecosystems",
    use="compile again without --package for it",
)
MEASUREMENT = FileKind(
    "measurement",
    "a measurement",
    "measurements",
    ("inspect", "convert", "identify", "fleet", "init", "force-control"),
)
PORT = FileKind("port", "the port of a controller", "ports of controllers", ("xcp",))
RIG_OF_NO_KIND = FileKind(RIG_FORMAT, "a rig file", "rig files")
"""Any rig file, where no package with a kind of rig is installed."""
UNKNOWN = FileKind("", "a file of unknown kind", "files of unknown kind")
"""What says nothing of itself or cannot be read."""


Needed = TypeVar("Needed")


def capability(kind: FileKind, needed: type[Needed]) -> Needed:
    """Return the record of a kind of rig typed as a protocol; refuse one that lacks a method of it."""
    for method in (name for name in vars(needed) if not name.startswith("_")):
        why = "it is no function"
        try:
            if callable(getattr(kind, method)):
                continue
        except (Exception, SystemExit) as error:
            why = str(error)
        raise InputError(
            f"control.kind: '{method}' of the kind '{kind.word}' cannot be used ({why}); ask the "
            "author of the package that adds it",
            code="not-installed",
            key="control.kind",
        )
    return cast(Needed, kind)


RIG_VERBS = (
    *("simulate", "tune", "excite", "calibrate", "live", "export", "compile", "force-control"),
)
"""Verbs that a kind of rig can have."""


def _fault_of(record: object, word: str) -> str:
    """Say what keeps a record from being used; empty where nothing does."""
    if not isinstance(record, FileKind) or record.format != RIG_FORMAT:
        return "and its record is no kind of rig"
    if record.word != word:
        return "and its record has another word"
    if not isinstance(record.title, str) or not isinstance(record.plural, str):
        return "and title or plural are no texts"
    if not isinstance(record.verbs, tuple) or not {*record.verbs} <= {*RIG_VERBS}:
        return f"and its verbs are no tuple of {', '.join(RIG_VERBS)}"
    tables = (record.reasons, record.options)
    return "" if all(isinstance(one, Mapping) for one in tables) else "and a table of it is none"


_RIG_KINDS: Registry[FileKind] = Registry("anhyst.kinds", {}, _fault_of)


def rig_kinds() -> Mapping[str, FileKind]:
    """Return the kinds of rigs by their words, in the order in which messages list them.

    They are the entry points ``anhyst.kinds`` of all installed packages; each is an
    ``anhyst_rigs.kinds.rig_kind.RigKind``, and its entry point has the name of its word.
    """
    kinds = sorted(_RIG_KINDS.values(), key=lambda kind: kind.plural)
    return {kind.word: kind for kind in kinds}


def why_unusable(word: object) -> str:
    """Say why no record of that word can be used, if a package adds one; empty otherwise."""
    return _RIG_KINDS.why_unusable(word)


def kinds_for(verb: str) -> tuple[FileKind, ...]:
    """Return what the first argument of a verb may be."""
    every = (MODEL, *rig_kinds().values(), MEASUREMENT, COMPILED, PORT)
    return tuple(kind for kind in every if verb in kind.verbs)


MEASUREMENTS = frozenset(
    {".csv", ".tsv", ".asc", ".lvm", ".mat", ".mf4", ".mdf", ".tdms", ".h5", ".hdf5", ".parquet"}
    | {".xlsx", ".xlsm"}
)
"""Endings of files that hold nothing else; ``.txt`` and ``.dat`` may be anything."""


def kind_in(content: Mapping[str, object]) -> FileKind:
    """Return the kind of a TOML file from its contents."""
    text, control = content.get("format"), content.get("control")
    if text == RIG_FORMAT:
        if not _RIG_KINDS:
            return RIG_OF_NO_KIND
        word = control.get("kind") if isinstance(control, dict) else None
        return rig_kinds().get(word, UNKNOWN) if isinstance(word, str) else UNKNOWN
    return next((kind for kind in (MODEL, CONTROLLER, CALIBRATION) if kind.word == text), UNKNOWN)


def kind_of(path: PathLike) -> FileKind:
    """Return what a file or a folder is; unknown where it says nothing or cannot be read.

    Whoever reads it then says what is wrong with it.
    """
    file = Path(path)
    if file.is_dir():
        return _kind_of_folder(file / "manifest.json")
    if not file.is_file():  # a port must not be read from
        return UNKNOWN
    if file.suffix.lower() in MEASUREMENTS:
        return MEASUREMENT
    try:
        return kind_in(tomllib.loads(file.read_text(encoding="utf-8")))
    except (OSError, ValueError, RecursionError):
        return UNKNOWN


def _kind_of_folder(manifest: Path) -> FileKind:
    """Return what a folder is by its manifest; a package has its files in other places."""
    if not manifest.is_file():
        return UNKNOWN
    try:
        content = json.loads(manifest.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return COMPILED
    return PACKAGE if isinstance(content, dict) and "package" in content else COMPILED


def refuse_other(
    path: PathLike,
    taken: Collection[FileKind],
    verb: str = "",
    kind_in_file: FileKind | None = None,
) -> FileKind:
    """Return what a file is, or refuse one of another kind and name the verbs that take it.

    ``kind_in_file`` is what it is, where that is known already.
    """
    kind = kind_of(path) if kind_in_file is None else kind_in_file
    if kind is RIG_OF_NO_KIND:
        raise InputError(
            f"{path}: this is a rig file; the package anhyst-rigs is for rigs: pip install anhyst-rigs",
            code="not-installed",
        )
    if kind in taken or kind is UNKNOWN:
        return kind
    if verb:
        names = _listed([one.plural for one in taken], "and")
        reason = f": {kind.reasons[verb]}" if verb in kind.reasons else ""
        needed = f"{verb} is for {names}{reason}"
    else:
        needed = f"{_listed([one.title for one in taken], 'or')} is needed"
    raise InputError(f"{path}: this is {kind.title}; {needed}; {kind.usage}", code="wrong-kind")


def _listed(words: Sequence[str], last: str) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} {last} {words[-1]}"


MethodName = Literal[
    "ratio",
    "secant",
    "linearised",
    "single-valued",
    "play",
    "simplified",
    "at-rest",
    "full",
    "flux",
    "fused",
]
"""How a force controller finds its current; a row of :data:`anhyst.compensate.methods.METHODS`."""
METHOD_TITLES: Mapping[MethodName, str] = {
    "ratio": "constant force-current ratio",
    "secant": "force in proportion to current",
    "linearised": "two constants, k_i and k_s",
    "single-valued": "best current without memory",
    "play": "map with one play",
    "simplified": "simplified hysteresis compensator",
    "at-rest": "full hysteresis compensator, at rest",
    "full": "full hysteresis compensator",
    "flux": "measured flux density",
    "fused": "full, and measured flux density",
}
"""Every method in words."""
PROBED: tuple[MethodName, ...] = ("flux", "fused")
"""Those that need a flux probe."""


NumberFormat = Literal["f64", "f32", "fixed"]
"""In which a force controller counts: double, single, or 32-bit fixed point."""
