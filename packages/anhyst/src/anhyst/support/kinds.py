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
        return (
            f"anhyst {_join_words(self.verbs, 'and')} take{'s' if len(self.verbs) == 1 else ''} it"
        )

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


MODEL_FILE = FileKind(
    "anhyst-model",
    "a model",
    "models",
    ("predict", "invert", "report", "diff", "compile", "watch", "export"),
)
CONTROLLER_FILE = FileKind(
    "anhyst-controller",
    "a controller file",
    "controller files",
    use="anhyst simulate, tune, compile and live take it with --controller",
)
CALIBRATION_FILE = FileKind(
    "anhyst-calibration",
    "a calibration",
    "calibrations",
    use="a rig file names it as control.calibration",
)
COMPILED_FOLDER = FileKind(
    "compiled folder", "a compiled folder", "compiled folders", ("verify", "live")
)
PACKAGE_FOLDER = FileKind(
    "package",
    "a package of an ecosystem",
    "packages of ecosystems",
    use="compile again without --package for it",
)
MEASUREMENT_FILE = FileKind(
    "measurement",
    "a measurement",
    "measurements",
    ("inspect", "convert", "identify", "fleet", "init", "force-control"),
)
CONTROLLER_PORT = FileKind("port", "the port of a controller", "ports of controllers", ("xcp",))
UNSUPPORTED_RIG_FILE = FileKind(RIG_FORMAT, "a rig file", "rig files")
"""Any rig file, where no package with a kind of rig is installed."""
UNKNOWN_FILE = FileKind("", "a file of unknown kind", "files of unknown kind")
"""What says nothing of itself or cannot be read."""


Capability = TypeVar("Capability")


def require_capability(kind: FileKind, protocol: type[Capability]) -> Capability:
    """Return the record of a kind of rig typed as a protocol; refuse one that lacks a method of it."""
    for method in (name for name in vars(protocol) if not name.startswith("_")):
        reason = "it is no function"
        try:
            if callable(getattr(kind, method)):
                continue
        except (Exception, SystemExit) as error:
            reason = str(error)
        raise InputError(
            f"control.kind: '{method}' of the kind '{kind.word}' cannot be used ({reason}); ask the "
            "author of the package that adds it",
            code="not-installed",
            key="control.kind",
        )
    return cast(Capability, kind)


RIG_VERBS = (
    *("simulate", "tune", "excite", "calibrate", "live", "export", "compile", "force-control"),
)
"""Verbs that a kind of rig can have."""


def _find_fault(record: object, word: str) -> str:
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
    return (
        "" if all(isinstance(table, Mapping) for table in tables) else "and a table of it is none"
    )


_RIG_KINDS: Registry[FileKind] = Registry("anhyst.kinds", {}, _find_fault)


def rig_kinds() -> Mapping[str, FileKind]:
    """Return the kinds of rigs by their words, in the order in which messages list them.

    They are the entry points ``anhyst.kinds`` of all installed packages; each is an
    ``anhyst_rigs.kinds.rig_kind.RigKind``, and its entry point has the name of its word.
    """
    kinds = sorted(_RIG_KINDS.values(), key=lambda kind: kind.plural)
    return {kind.word: kind for kind in kinds}


def explain_unusable(word: object) -> str:
    """Say why no record of that word can be used, if a package adds one; empty otherwise."""
    return _RIG_KINDS.explain_unusable(word)


def accepted_kinds(verb: str) -> tuple[FileKind, ...]:
    """Return what the first argument of a verb may be."""
    all_kinds = (
        MODEL_FILE,
        *rig_kinds().values(),
        MEASUREMENT_FILE,
        COMPILED_FOLDER,
        CONTROLLER_PORT,
    )
    return tuple(kind for kind in all_kinds if verb in kind.verbs)


MEASUREMENT_SUFFIXES = frozenset(
    {".csv", ".tsv", ".asc", ".lvm", ".mat", ".mf4", ".mdf", ".tdms", ".h5", ".hdf5", ".parquet"}
    | {".xlsx", ".xlsm"}
)
"""Endings of files that hold nothing else; ``.txt`` and ``.dat`` may be anything."""


def content_kind(content: Mapping[str, object]) -> FileKind:
    """Return the kind of a TOML file from its contents."""
    file_format, control = content.get("format"), content.get("control")
    if file_format == RIG_FORMAT:
        if not _RIG_KINDS:
            return UNSUPPORTED_RIG_FILE
        word = control.get("kind") if isinstance(control, dict) else None
        return rig_kinds().get(word, UNKNOWN_FILE) if isinstance(word, str) else UNKNOWN_FILE
    return next(
        (
            kind
            for kind in (MODEL_FILE, CONTROLLER_FILE, CALIBRATION_FILE)
            if kind.word == file_format
        ),
        UNKNOWN_FILE,
    )


def file_kind(path: PathLike) -> FileKind:
    """Return what a file or a folder is; unknown where it says nothing or cannot be read.

    Whoever reads it then says what is wrong with it.
    """
    file = Path(path)
    if file.is_dir():
        return _folder_kind(file / "manifest.json")
    if not file.is_file():  # a port must not be read from
        return UNKNOWN_FILE
    if file.suffix.lower() in MEASUREMENT_SUFFIXES:
        return MEASUREMENT_FILE
    try:
        return content_kind(tomllib.loads(file.read_text(encoding="utf-8")))
    except (OSError, ValueError, RecursionError):
        return UNKNOWN_FILE


def _folder_kind(manifest: Path) -> FileKind:
    """Return what a folder is by its manifest; a package has its files in other places."""
    if not manifest.is_file():
        return UNKNOWN_FILE
    try:
        content = json.loads(manifest.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return COMPILED_FOLDER
    return PACKAGE_FOLDER if isinstance(content, dict) and "package" in content else COMPILED_FOLDER


def require_kind(
    path: PathLike,
    accepted: Collection[FileKind],
    verb: str = "",
    known_kind: FileKind | None = None,
) -> FileKind:
    """Return what a file is, or refuse one of another kind and name the verbs that take it.

    ``kind_in_file`` is what it is, where that is known already.
    """
    kind = file_kind(path) if known_kind is None else known_kind
    if kind is UNSUPPORTED_RIG_FILE:
        raise InputError(
            f"{path}: this is a rig file; the package anhyst-rigs is for rigs: pip install anhyst-rigs",
            code="not-installed",
        )
    if kind in accepted or kind is UNKNOWN_FILE:
        return kind
    if verb:
        names = _join_words([other.plural for other in accepted], "and")
        reason = f": {kind.reasons[verb]}" if verb in kind.reasons else ""
        requirement = f"{verb} is for {names}{reason}"
    else:
        requirement = f"{_join_words([one.title for one in accepted], 'or')} is needed"
    raise InputError(
        f"{path}: this is {kind.title}; {requirement}; {kind.usage}", code="wrong-kind"
    )


def _join_words(words: Sequence[str], conjunction: str) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} {conjunction} {words[-1]}"


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
FLUX_PROBE_METHODS: tuple[MethodName, ...] = ("flux", "fused")
"""Those that need a flux probe."""


NumberFormat = Literal["f64", "f32", "fixed"]
"""In which a force controller counts: double, single, or 32-bit fixed point."""
