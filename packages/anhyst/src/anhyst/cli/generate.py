"""Generate a command from a function: its options and its help come from signature and docstring.

Each command is a module in a folder of commands (:mod:`anhyst.support.verbs`). The module contains
a function with the name of the module. It can also define how the result is presented; `Verb` lists
the names for this.
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

from anhyst.cli.docstring import Docstring, ParameterDoc, read_docstring, use_option_names
from anhyst.cli.reading import read_options
from anhyst.cli.shared import (
    AsJson,
    OutputPart,
    Verbose,
    check_file_kind,
    print_parts,
    print_steps,
    print_warning,
    print_with_warnings,
    progress_bar,
)
from anhyst.support import verbs
from anhyst.support.atomic import json_text
from anhyst.support.errors import InputError, Interrupted

Arguments = Mapping[str, Any]
"""Arguments of a command, as they are passed to its function."""

_READING_PARAMETERS = inspect.signature(read_options).parameters
_CALLBACK_NAMES = frozenset({"progress", "opened", "started"})
"""Parameters that the command line supplies itself."""
_SHARED_TEXT_MARK = "as of `read_loops`"
"""Type field of a parameter that takes its help from the options for reading files."""


@dataclass(frozen=True)
class Verb:
    """A command: its module, its function, and how its result is presented.

    The module can define these names. ``PLACE`` is the rank and the panel in the help, ``PROGRESS``
    the title of the progress bar. ``preview`` returns the output before the work, and ``show`` the
    output of the result. ``warnings`` returns the texts for standard error, ``as_json`` the
    result for ``--json``. ``refuse`` raises an error if the result, which has been shown, is
    negative. ``stopped`` returns the message after Ctrl-C. A command that runs until Ctrl-C defines
    ``show_started``, which returns the output when it has started, and can define ``show_opened``,
    which returns the output before a long start.
    """

    name: str
    module: ModuleType

    @property
    def command(self) -> str:
        """Name on the command line."""
        return self.name.replace("_", "-")

    @property
    def function(self) -> Callable[..., Any]:
        """The function that does the work."""
        function: Callable[..., Any] = getattr(self.module, self.name)
        return function

    @property
    def place(self) -> tuple[int, str]:
        """Rank and panel in the help."""
        place: tuple[int, str] = getattr(self.module, "PLACE", (99, "More"))
        return place

    def module_function(self, name: str, default: Callable[..., Any]) -> Callable[..., Any]:
        """Return a function of the module, or the default if the module does not define it."""
        function: Callable[..., Any] = getattr(self.module, name, default)
        return function

    @cached_property
    def parameters(self) -> dict[str, inspect.Parameter]:
        """Parameters of the function that become options or arguments of the command."""
        parameters = dict(inspect.signature(self.function).parameters)
        docs = self.docstring.parameters.items()
        python_only_names = {name for name, parameter in docs if "only in Python" in parameter.type_text}
        if parameters.pop("reading", None) is not None and "**reading" not in python_only_names:
            parameters |= _READING_PARAMETERS
        return {
            name: value
            for name, value in parameters.items()
            if name not in python_only_names | _CALLBACK_NAMES
        }

    @cached_property
    def docstring(self) -> Docstring:
        """The parsed docstring of the function."""
        return read_docstring(self.function)

    @cached_property
    def is_endless(self) -> bool:
        """Whether the command runs until Ctrl-C. Such a command has no result for ``--json``."""
        return hasattr(self.module, "show_started")


def load_verbs() -> list[Verb]:
    """Return all commands in the order of the help.

    A command of another author's package that cannot be used is left out with a warning.
    """
    usable_verbs = []
    for fault in verbs.faults():
        print_warning(f"left out: {fault}")
    project_verbs = verbs.modules(is_project_only=True)
    for name, module_name in verbs.modules().items():
        try:
            with redirect_stdout(sys.stderr):  # standard output is for results
                verb = Verb(name, import_module(module_name))
            if list(map(type, verb.place)) != [int, str]:
                raise TypeError("PLACE must be a rank and the name of a panel")
            inspect.Signature(_command_parameters(verb))
            usable_verbs.append(verb)
        except (Exception, SystemExit) as error:
            if name in project_verbs:
                raise
            print_warning(f"left out: the verb {name} of {module_name}: {error}; update its package")
    return sorted(usable_verbs, key=lambda verb: (verb.place, verb.name))


def add_command(app: typer.Typer, verb: Verb) -> None:
    """Add a command to the command line."""

    def run(**options: Any) -> None:
        _run_verb(verb, options)

    run.__signature__ = inspect.Signature(_command_parameters(verb))  # type: ignore[attr-defined]
    run.__annotations__ = {option.name: option.annotation for option in _command_parameters(verb)}
    help_texts = [use_option_names(verb.docstring.summary, _option_names(verb))]
    help_texts += [f"Example: {example}" for example in verb.docstring.examples]
    app.command(
        verb.command, help="\n\n".join(help_texts), no_args_is_help=True, rich_help_panel=verb.place[1]
    )(run)


def add_missing_command(app: typer.Typer, name: str, package: str) -> None:
    """Add a hidden command that accepts any arguments and names the package to install."""
    command = name.replace("_", "-")

    def refuse() -> None:
        raise InputError(
            f"{command} is in the package {package}: pip install {package}", code="not-installed"
        )

    settings = {"ignore_unknown_options": True, "allow_extra_args": True, "help_option_names": []}
    app.command(command, hidden=True, context_settings=settings)(refuse)


def _option_names(verb: Verb) -> dict[str, str]:
    """Return the option of each parameter."""
    descriptions = verb.docstring.parameters
    return {
        name: (name in descriptions and descriptions[name].flag) or f"--{name.strip('_').replace('_', '-')}"
        for name in verb.parameters
    }


@cache
def _command_parameters(verb: Verb) -> list[inspect.Parameter]:
    """Return the parameters of a command in the form that typer needs."""
    flags, reading_parameters = _option_names(verb), read_docstring(read_options).parameters
    checked_annotation = ""  # annotation of the arguments whose file kind is checked
    options: list[tuple[str, Any, Any]] = []
    for name, parameter in verb.parameters.items():
        description = verb.docstring.parameters.get(name) or reading_parameters.get(name) or ParameterDoc()
        description = reading_parameters[name] if _SHARED_TEXT_MARK in description.type_text else description
        is_required = "required on the command line" in description.type_text
        is_required = is_required or parameter.default is parameter.empty
        kind = _option_type(parameter, verb.module)
        settings = _typer_settings(description, flags)
        if "argument" in description.type_text or (is_required and name != "out"):
            checked_annotation = checked_annotation or parameter.annotation
            if parameter.annotation == checked_annotation and name != "out":
                settings["callback"] = check_file_kind
            argument_or_option = typer.Argument(**{"metavar": name.upper()} | settings)
        else:
            spellings = (flags[name], *(["-o"] if name == "out" else []))
            argument_or_option = typer.Option(*spellings if parameter.default is not True else (), **settings)
        default = inspect.Parameter.empty if is_required else parameter.default
        default = Path(default) if kind is Path and isinstance(default, str) else default
        kind = kind if default is not None else kind | None
        options.append((name, Annotated[kind, argument_or_option], default))
    if not verb.is_endless:
        options += [("as_json", AsJson, False), ("_verbose", Verbose, False)]
    return [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=kind)
        for name, kind, default in options
    ]


def _typer_settings(description: ParameterDoc, flags: Mapping[str, str]) -> dict[str, Any]:
    """Return the settings of a typer option or argument, except its type."""
    settings = {
        "help": use_option_names(description.text, flags),
        "metavar": description.metavar,
        "min": description.minimum,
        "max": description.maximum,
    }
    return {name: value for name, value in settings.items() if value is not None}


_PATH_TYPES = ((r"\bSequence\[.*PathLike|\bLoopSource\b", list[Path]), (r"\bPath(Like)?\b", Path))
"""Patterns of type annotations that accept a path, and the type of the option for each pattern."""


def _option_type(parameter: inspect.Parameter, module: ModuleType) -> Any:
    """Return the type of a parameter on the command line."""
    text, annotation = (inspect.formatannotation(parameter.annotation).strip("'"), parameter.annotation)
    with suppress(Exception):  # the name can be imported for type checkers only
        annotation = eval(annotation, vars(module)) if isinstance(annotation, str) else annotation
    if NoneType in get_args(annotation):
        annotation = get_args(annotation)[0]
    if get_origin(annotation) is Literal or annotation in (bool, int, float):
        return annotation
    return next((kind for pattern, kind in _PATH_TYPES if re.search(pattern, text)), str)


def _run_verb(verb: Verb, options: dict[str, Any]) -> None:
    """Run a command and print its result."""
    as_json = options.pop("as_json", False)
    options.pop("_verbose", None)
    arguments = _function_arguments(verb, options)
    if not as_json:
        print_parts(*verb.module_function("preview", _no_output)(arguments))
    try:
        result = _call_function(verb, arguments)
    except KeyboardInterrupt:
        if saved_text := "".join(verb.module_function("stopped", _no_output)(arguments)):
            raise Interrupted(saved_text) from None
        raise
    warnings = tuple(verb.module_function("warnings", lambda of: getattr(of, "warnings", ()))(result))
    if as_json:
        for text in warnings:
            print_warning(text)
        print(json_text(verb.module_function("as_json", _result_as_json)(result, arguments)), end="")
    else:
        print_with_warnings(warnings, *verb.module_function("show", _show_result)(result, arguments))
    verb.module_function("refuse", _no_output)(result, arguments)


def _function_arguments(verb: Verb, options: Mapping[str, Any]) -> dict[str, Any]:
    """Convert the options of the command line to the arguments of the function."""
    arguments = dict(options)
    option_texts = {}
    for name, value in options.items():
        if isinstance(value, str) and "Sequence[str]" in str(verb.parameters[name].annotation):
            arguments[name] = value.split(",")
        parameter = verb.docstring.parameters.get(name)
        if name in _READING_PARAMETERS and (parameter is None or _SHARED_TEXT_MARK in parameter.type_text):
            option_texts[name] = value
    parsed_options = asdict(read_options(**option_texts)) if option_texts else {}
    has_reading = "reading" in inspect.signature(verb.function).parameters
    return arguments | {
        name: parsed_options[name] for name, value in option_texts.items() if has_reading or value is not None
    }


def _call_function(verb: Verb, arguments: Mapping[str, Any]) -> Any:
    """Call the function, and show its progress until it ends or reports that it has started."""
    parameters = inspect.signature(verb.function).parameters
    with ExitStack() as exit_stack:
        callbacks: dict[str, Any] = {}
        if "progress" in parameters:
            title = getattr(verb.module, "PROGRESS", verb.command)
            callbacks["progress"] = exit_stack.enter_context(progress_bar(title))
        if "opened" in parameters:
            callbacks["opened"] = lambda *values: print_parts(*verb.module.show_opened(*values))
        if verb.is_endless:
            if not sys.stdout.isatty():
                exit_stack.enter_context(print_steps())

            def started(*values: Any) -> None:
                exit_stack.close()  # removes the progress bar
                print_parts(*verb.module.show_started(*values))

            callbacks["started"] = started
        return verb.function(**arguments, **callbacks)


def _no_output(*_: Any) -> tuple[str, ...]:
    return ()


def _result_as_json(result: Any, _: Arguments) -> Mapping[str, Any]:
    if isinstance(result, Mapping):
        return result
    fields: Mapping[str, Any] = result.as_dict() if hasattr(result, "as_dict") else asdict(result)
    return fields


def _show_result(result: Any, arguments: Arguments) -> Iterable[OutputPart]:
    """Return the terminal output for a module without ``show``: the facts and the output file."""
    fact_lines = result if isinstance(result, Mapping) else getattr(result, "facts", dict)()
    output_line = [f"written: {arguments['out']}"] if arguments.get("out") is not None else []
    return [*(f"{name}: {text}" for name, text in fact_lines.items()), *output_line]
