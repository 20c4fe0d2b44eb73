"""The kinds of files and folders, and the commands that accept each kind.

All commands use this module to check their first argument and to name the right command in errors.
"""

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
"""Value of the key ``format`` in every rig file; the key ``control.kind`` names the kind of rig."""


@dataclass(frozen=True, eq=False)
class FileKind:
    """A kind of file or folder that a command can get as an argument."""

    word: str  # value of control.kind (rig files) or format (other files)
    title: str  # singular with article, for messages
    plural: str  # plural, for messages
    verbs: tuple[str, ...] = ()  # commands that accept a file of this kind as their first argument
    # by command: reason why this command cannot use the file, if it helps the user
    reasons: Mapping[str, str] = field(default_factory=dict)
    use: str = ""  # use of the file, if no command accepts it as its first argument
    # by command: options that this kind supports and some others do not
    options: Mapping[str, tuple[str, ...]] = field(default_factory=dict)

    @property
    def format(self) -> str:
        """Value of the key ``format`` in a file of this kind."""
        return self.word

    @property
    def usage(self) -> str:
        """A sentence that names the commands that accept a file of this kind, or its other use."""
        if self.use or not self.verbs:
            return self.use or "no verb takes it"
        return f"anhyst {_join_words(self.verbs, 'and')} take{'s' if len(self.verbs) == 1 else ''} it"

    def has_option(self, verb: str, option: str) -> bool:
        """Whether this kind supports an option of a command that only some kinds support."""
        return option in self.options.get(verb, ())

    def refuse_options(self, verb: str, given_options: Mapping[str, object]) -> None:
        """Raise an error if an option is given (not None) that this kind does not support."""
        unsupported_options = [
            name
            for name, value in given_options.items()
            if value is not None and not self.has_option(verb, name)
        ]
        if unsupported_options:
            raise InputError(
                f"{self.title} has no {' or '.join(unsupported_options)}; leave it out",
                code="option-not-for-this",
                key=unsupported_options[0],
            )


MODEL_FILE = FileKind(
    "anhyst-model", "a model", "models", ("predict", "invert", "report", "diff", "compile", "watch", "export")
)
CONTROLLER_FILE = FileKind(
    "anhyst-controller",
    "a controller file",
    "controller files",
    use="anhyst simulate, tune, compile and live take it with --controller",
)
CALIBRATION_FILE = FileKind(
    "anhyst-calibration", "a calibration", "calibrations", use="a rig file names it as control.calibration"
)
COMPILED_FOLDER = FileKind("compiled folder", "a compiled folder", "compiled folders", ("verify", "live"))
PACKAGE_FOLDER = FileKind(
    "package",
    "a package of an ecosystem",
    "packages of ecosystems",
    use="compile again without --package for it",
)
FIRMWARE_FILE = FileKind("firmware", "the description of a firmware", "A2L and ELF files", ("live",))
MEASUREMENT_FILE = FileKind(
    "measurement",
    "a measurement",
    "measurements",
    ("inspect", "convert", "identify", "fleet", "init", "force-control"),
)
CONTROLLER_PORT = FileKind("port", "the port of a controller", "ports of controllers", ("xcp",))
UNSUPPORTED_RIG_FILE = FileKind(RIG_FORMAT, "a rig file", "rig files")
"""Any rig file, if no package with a kind of rig is installed."""
UNKNOWN_FILE = FileKind("", "a file of unknown kind", "files of unknown kind")
"""A file that does not state its kind or cannot be read."""


Capability = TypeVar("Capability")


def require_capability(kind: FileKind, protocol: type[Capability]) -> Capability:
    """Return a kind of rig typed as a protocol; raise an error if it lacks a method of it."""
    for method in (name for name in vars(protocol) if not name.startswith("_")):
        reason = "it is not a function"
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


RIG_VERBS = (*("simulate", "tune", "excite", "calibrate", "live", "export", "compile", "force-control"),)
"""Commands that a kind of rig can support."""


def _find_fault(record: object, word: str) -> str:
    """Return the reason why the record of a kind of rig cannot be used; empty if it can be used."""
    if not isinstance(record, FileKind) or record.format != RIG_FORMAT:
        return "and its record is not a kind of rig"
    if record.word != word:
        return "and its record has another word"
    if not isinstance(record.title, str) or not isinstance(record.plural, str):
        return "and its title or its plural is not a text"
    if not isinstance(record.verbs, tuple) or not {*record.verbs} <= {*RIG_VERBS}:
        return f"and its verbs are not a tuple of {', '.join(RIG_VERBS)}"
    tables = (record.reasons, record.options)
    return (
        ""
        if all(isinstance(table, Mapping) for table in tables)
        else "and its reasons or its options are not a table"
    )


_RIG_KINDS: Registry[FileKind] = Registry("anhyst.kinds", {}, _find_fault)


def rig_kinds() -> Mapping[str, FileKind]:
    """Return the kinds of rigs by their words, in the order in which messages list the kinds.

    They are the entry points ``anhyst.kinds`` of all installed packages. Each one is an
    ``anhyst_rigs.kinds.rig_kind.RigKind``. The name of the entry point is the word that identifies
    the kind in files and messages.
    """
    kinds = sorted(_RIG_KINDS.values(), key=lambda kind: kind.plural)
    return {kind.word: kind for kind in kinds}


def explain_unusable(word: object) -> str:
    """Return the reason why the kind of rig of a word cannot be used; empty if it is unknown."""
    return _RIG_KINDS.explain_unusable(word)


def accepted_kinds(verb: str) -> tuple[FileKind, ...]:
    """Return the kinds that the first argument of a command can have."""
    files = (MODEL_FILE, *rig_kinds().values(), MEASUREMENT_FILE, COMPILED_FOLDER, FIRMWARE_FILE)
    all_kinds = (*files, CONTROLLER_PORT)
    return tuple(kind for kind in all_kinds if verb in kind.verbs)


MEASUREMENT_SUFFIXES = frozenset(
    {".csv", ".tsv", ".asc", ".lvm", ".mat", ".mf4", ".mdf", ".tdms", ".h5", ".hdf5", ".parquet"}
    | {".xlsx", ".xlsm"}
)
"""Suffixes of files that are always measurements; ``.txt`` and ``.dat`` can be anything."""


def content_kind(content: Mapping[str, object]) -> FileKind:
    """Return the kind of a TOML file from its content."""
    file_format, control = content.get("format"), content.get("control")
    if file_format == RIG_FORMAT:
        if not _RIG_KINDS:
            return UNSUPPORTED_RIG_FILE
        word = control.get("kind") if isinstance(control, dict) else None
        return rig_kinds().get(word, UNKNOWN_FILE) if isinstance(word, str) else UNKNOWN_FILE
    return next(
        (kind for kind in (MODEL_FILE, CONTROLLER_FILE, CALIBRATION_FILE) if kind.word == file_format),
        UNKNOWN_FILE,
    )


def file_kind(path: PathLike) -> FileKind:
    """Return the kind of a file or a folder; unknown if it is not stated or cannot be read.

    The function that reads the file later reports the fault.
    """
    file = Path(path)
    if file.is_dir():
        return _folder_kind(file / "manifest.json")
    if not file.is_file():  # such as a serial port, which must not be read
        return UNKNOWN_FILE
    if file.suffix.lower() in MEASUREMENT_SUFFIXES:
        return MEASUREMENT_FILE
    if file.suffix.lower() == ".a2l" or is_elf(file):
        return FIRMWARE_FILE
    try:
        return content_kind(tomllib.loads(file.read_text(encoding="utf-8")))
    except (OSError, ValueError, RecursionError):
        return UNKNOWN_FILE


def is_elf(path: Path) -> bool:
    """Whether a file begins as an ELF file."""
    try:
        with path.open("rb") as stream:
            return stream.read(4) == b"\x7fELF"
    except OSError:
        return False


def _folder_kind(manifest: Path) -> FileKind:
    """Return the kind of a folder from its manifest: compiled C, or a package of an ecosystem."""
    if not manifest.is_file():
        return UNKNOWN_FILE
    try:
        content = json.loads(manifest.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return COMPILED_FOLDER
    return PACKAGE_FOLDER if isinstance(content, dict) and "package" in content else COMPILED_FOLDER


def require_kind(
    path: PathLike, supported_kinds: Collection[FileKind], verb: str = "", known_kind: FileKind | None = None
) -> FileKind:
    """Return the kind of a file, or raise an error that names the commands that accept it.

    ``known_kind`` is the kind of the file, if it is known already.
    """
    kind = file_kind(path) if known_kind is None else known_kind
    if kind is UNSUPPORTED_RIG_FILE:
        raise InputError(
            f"{path}: this is a rig file; the package anhyst-rigs is for rigs: pip install anhyst-rigs",
            code="not-installed",
        )
    if kind in supported_kinds or kind is UNKNOWN_FILE:
        return kind
    if verb:
        names = _join_words([accepted_kind.plural for accepted_kind in supported_kinds], "and")
        reason = f": {kind.reasons[verb]}" if verb in kind.reasons else ""
        requirement = f"{verb} is for {names}{reason}"
    else:
        requirement = (
            f"{_join_words([accepted_kind.title for accepted_kind in supported_kinds], 'or')} is needed"
        )
    raise InputError(f"{path}: this is {kind.title}; {requirement}; {kind.usage}", code="wrong-kind")


def _join_words(words: Sequence[str], conjunction: str) -> str:
    return words[0] if len(words) == 1 else f"{', '.join(words[:-1])} {conjunction} {words[-1]}"


MethodName = Literal[
    "ratio", "secant", "linearised", "single-valued", "play", "simplified", "at-rest", "full", "flux", "fused"
]
"""Method that computes the current for a force (:data:`anhyst.compensate.methods.METHODS`)."""
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
"""Titles of the methods."""
FLUX_PROBE_METHODS: tuple[MethodName, ...] = ("flux", "fused")
"""Methods that need a flux probe."""


NumberFormat = Literal["f64", "f32", "fixed"]
"""Number format of a force controller: double, single, or 32-bit fixed point."""
