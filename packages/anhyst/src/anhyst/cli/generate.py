"""Make a command from a verb: options and help from the signature and the docstring of a function.

A verb is a module in a folder of verbs (:mod:`anhyst.support.verbs`) with a function of the same name.
The module may also say how the command presents the result; `Verb` lists the names.
"""

from __future__ import annotations

import inspect
import re
import sys
from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack, redirect_stdout, suppress
from dataclasses import asdict, dataclass
from functools import cache, cached_property
from importlib import import_module
from pathlib import Path
from types import ModuleType, NoneType
from typing import Annotated, Any, Literal, get_args, get_origin

import typer

from anhyst.cli.docstring import Described, Docstring, read_docstring, with_options
from anhyst.cli.reading import read_options
from anhyst.cli.shared import (
    AsJson,
    Part,
    Verbose,
    of_its_kind,
    progress_bar,
    show,
    show_with,
    warn,
)
from anhyst.support import verbs
from anhyst.support.atomic import json_text
from anhyst.support.errors import InputError, Interrupted

Given = Mapping[str, Any]
"""The arguments of a verb, as the command line gives them to its function."""

_READING = inspect.signature(read_options).parameters
_CALLED_BACK = frozenset({"progress", "started"})
"""Parameters that the command itself supplies."""
_AS_READ = "as of `read_loops`"
"""Type field of a parameter whose text is that of the options of reading."""


@dataclass(frozen=True)
class Verb:
    """A module of a verb: its function, and what it says about the command.

    ``PLACE``: rank in the help, and the panel. ``PROGRESS``: title of the progress bar. ``preview``:
    what is shown before the work. ``show``: what a terminal shows of the result, and ``warnings``
    what it says on standard error. ``as_json``: the result for JSON. ``refuse`` raises the negative
    end of a command whose result is shown. ``stopped``: what Ctrl-C leaves behind. ``show_started``:
    what is shown when a verb that runs until Ctrl-C has begun.
    """

    name: str
    module: ModuleType

    @property
    def command(self) -> str:
        """The verb as the command line spells it."""
        return self.name.replace("_", "-")

    @property
    def function(self) -> Callable[..., Any]:
        """What does the work."""
        found: Callable[..., Any] = getattr(self.module, self.name)
        return found

    @property
    def place(self) -> tuple[int, str]:
        """Rank and panel in the help."""
        place: tuple[int, str] = getattr(self.module, "PLACE", (99, "More"))
        return place

    def told(self, name: str, default: Callable[..., Any]) -> Callable[..., Any]:
        """Return what the module says about the command, or what holds for most verbs."""
        found: Callable[..., Any] = getattr(self.module, name, default)
        return found

    @cached_property
    def parameters(self) -> dict[str, inspect.Parameter]:
        """Those of the function that the command line has."""
        own = dict(inspect.signature(self.function).parameters)
        described = self.described.parameters.items()
        hidden = {name for name, one in described if "only in Python" in one.kind}
        if own.pop("reading", None) is not None and "**reading" not in hidden:
            own |= _READING
        return {name: one for name, one in own.items() if name not in hidden | _CALLED_BACK}

    @cached_property
    def described(self) -> Docstring:
        """What the docstring of the function says."""
        return read_docstring(self.function)

    @cached_property
    def is_endless(self) -> bool:
        """Whether it runs until Ctrl-C, and has no result to print as JSON."""
        return hasattr(self.module, "show_started")


def read_verbs() -> list[Verb]:
    """Return every verb, in the order of the help; warn of one of another package that cannot be used."""
    found = []
    for fault in verbs.faults():
        warn(f"left out: {fault}")
    own = verbs.modules(of_project=True)
    for name, place in verbs.modules().items():
        try:
            with redirect_stdout(sys.stderr):  # standard output is for results
                verb = Verb(name, import_module(place))
            if list(map(type, verb.place)) != [int, str]:
                raise TypeError("PLACE must be a rank and the name of a panel")
            inspect.Signature(_options(verb))
            found.append(verb)
        except (Exception, SystemExit) as error:
            if name in own:
                raise
            warn(f"left out: the verb {name} of {place}: {error}; update its package")
    return sorted(found, key=lambda verb: (verb.place, verb.name))


def add_command(app: typer.Typer, verb: Verb) -> None:
    """Add a verb to the command line."""

    def run(**options: Any) -> None:
        _run(verb, options)

    run.__signature__ = inspect.Signature(_options(verb))  # type: ignore[attr-defined]
    run.__annotations__ = {one.name: one.annotation for one in _options(verb)}
    about = [with_options(verb.described.about, _flags(verb))]
    about += [f"Example: {example}" for example in verb.described.examples]
    app.command(
        verb.command, help="\n\n".join(about), no_args_is_help=True, rich_help_panel=verb.place[1]
    )(run)


def add_absent(app: typer.Typer, name: str, package: str) -> None:
    """Let a verb of a package that is not installed say so, whatever follows it."""
    command = name.replace("_", "-")

    def refuse() -> None:
        raise InputError(
            f"{command} is in the package {package}: pip install {package}", code="not-installed"
        )

    takes_all = {"ignore_unknown_options": True, "allow_extra_args": True, "help_option_names": []}
    app.command(command, hidden=True, context_settings=takes_all)(refuse)


def _flags(verb: Verb) -> dict[str, str]:
    """Return the option of each parameter."""
    described = verb.described.parameters
    return {
        name: (name in described and described[name].flag)
        or f"--{name.strip('_').replace('_', '-')}"
        for name in verb.parameters
    }


@cache
def _options(verb: Verb) -> list[inspect.Parameter]:
    """Return the parameters of the command as typer takes them."""
    flags, shared = _flags(verb), read_docstring(read_options).parameters
    checked = ""  # annotation of the arguments whose kind of file is checked
    options: list[tuple[str, Any, Any]] = []
    for name, parameter in verb.parameters.items():
        described = verb.described.parameters.get(name) or shared.get(name) or Described()
        described = shared[name] if _AS_READ in described.kind else described
        is_required = "required on the command line" in described.kind
        is_required = is_required or parameter.default is parameter.empty
        kind = _type_of(parameter, verb.module)
        settings = _settings(described, flags)
        if "argument" in described.kind or (is_required and name != "out"):
            checked = checked or parameter.annotation
            if parameter.annotation == checked and name != "out":
                settings["callback"] = of_its_kind
            info = typer.Argument(**{"metavar": name.upper()} | settings)
        else:
            spelled = (flags[name], *(["-o"] if name == "out" else []))
            info = typer.Option(*spelled if parameter.default is not True else (), **settings)
        default = inspect.Parameter.empty if is_required else parameter.default
        default = Path(default) if kind is Path and isinstance(default, str) else default
        kind = kind if default is not None else kind | None
        options.append((name, Annotated[kind, info], default))
    if not verb.is_endless:
        options += [("as_json", AsJson, False), ("_verbose", Verbose, False)]
    return [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=kind)
        for name, kind, default in options
    ]


def _settings(described: Described, flags: Mapping[str, str]) -> dict[str, Any]:
    """Return what typer is told of a parameter, besides its type."""
    found = {
        "help": with_options(described.text, flags),
        "metavar": described.metavar,
        "min": described.low,
        "max": described.high,
    }
    return {name: value for name, value in found.items() if value is not None}


_TYPES = (
    (r"\bSequence\[.*PathLike|\bLoopSource\b", list[Path]),
    (r"\bPath(Like)?\b", Path),
)
"""Type on the command line for the annotation of a parameter that is not of a plain type."""


def _type_of(parameter: inspect.Parameter, module: ModuleType) -> Any:
    """Return the type of a parameter on the command line."""
    text, hint = inspect.formatannotation(parameter.annotation).strip("'"), parameter.annotation
    with suppress(Exception):  # names that only type checkers import
        hint = eval(hint, vars(module)) if isinstance(hint, str) else hint
    if NoneType in get_args(hint):
        hint = get_args(hint)[0]
    if get_origin(hint) is Literal or hint in (bool, int, float):
        return hint
    return next((kind for pattern, kind in _TYPES if re.search(pattern, text)), str)


def _run(verb: Verb, options: dict[str, Any]) -> None:
    """Run a verb and print its result."""
    as_json = options.pop("as_json", False)
    options.pop("_verbose", None)
    given = _given(verb, options)
    if not as_json:
        show(*verb.told("preview", _nothing)(given))
    try:
        result = _call(verb, given)
    except KeyboardInterrupt:
        if kept := "".join(verb.told("stopped", _nothing)(given)):
            raise Interrupted(kept) from None
        raise
    warnings = tuple(verb.told("warnings", lambda of: getattr(of, "warnings", ()))(result))
    if as_json:
        for text in warnings:
            warn(text)
        print(json_text(verb.told("as_json", _as_json)(result, given)), end="")
    else:
        show_with(warnings, *verb.told("show", _show)(result, given))
    verb.told("refuse", _nothing)(result, given)


def _given(verb: Verb, options: Mapping[str, Any]) -> dict[str, Any]:
    """Return the arguments of the function from the options of the command line."""
    given = dict(options)
    texts = {}
    for name, value in options.items():
        if isinstance(value, str) and "Sequence[str]" in str(verb.parameters[name].annotation):
            given[name] = value.split(",")
        own = verb.described.parameters.get(name)
        if name in _READING and (own is None or _AS_READ in own.kind):
            texts[name] = value
    read = asdict(read_options(**texts)) if texts else {}
    takes_all = "reading" in inspect.signature(verb.function).parameters
    return given | {
        name: read[name] for name, value in texts.items() if takes_all or value is not None
    }


def _call(verb: Verb, given: Mapping[str, Any]) -> Any:
    """Call the function, with a bar until it ends or has started."""
    takes = inspect.signature(verb.function).parameters
    with ExitStack() as opening:
        calls: dict[str, Any] = {}
        if "progress" in takes:
            title = getattr(verb.module, "PROGRESS", verb.command)
            calls["progress"] = opening.enter_context(progress_bar(title))
        if verb.is_endless:

            def started(*values: Any) -> None:
                opening.close()  # ends the bar
                show(*verb.module.show_started(*values))

            calls["started"] = started
        return verb.function(**given, **calls)


def _nothing(*_: Any) -> tuple[str, ...]:
    return ()


def _as_json(result: Any, _: Given) -> Mapping[str, Any]:
    if isinstance(result, Mapping):
        return result
    found: Mapping[str, Any] = result.as_dict() if hasattr(result, "as_dict") else asdict(result)
    return found


def _show(result: Any, given: Given) -> Iterable[Part]:
    """Show the figures that a result names first, and what was written."""
    facts = result if isinstance(result, Mapping) else getattr(result, "facts", dict)()
    written = [f"written: {given['out']}"] if given.get("out") is not None else []
    return [*(f"{name}: {text}" for name, text in facts.items()), *written]
