"""Entry point of the command line: the verbs, and how they end."""

from __future__ import annotations

import errno
import io
import os
import sys
import warnings
from collections.abc import Callable, Sequence
from functools import cache
from typing import Annotated, Any, cast

import typer

from anhyst.cli.generate import add_absent, add_command, read_verbs
from anhyst.cli.printing import printer, start_printing
from anhyst.cli.shared import one_line, say_error, warn
from anhyst.support import verbs
from anhyst.support.errors import CreepWarning, InputError, Interrupted, NegativeResult
from anhyst.support.registry import PARTS, package_at_fault
from anhyst.support.wording import command_line

BAD_INPUT = 2
NEGATIVE = 1
FAULT = 70
INTERRUPTED = 130

# Typer carries the library it is built on under a private name that has changed.
_Refusal = cast(
    "type[typer.BadParameter]",
    next(kind for kind in typer.BadParameter.__mro__ if kind.__name__ == "ClickException"),
)

app = typer.Typer(
    name="anhyst",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="markdown",
    context_settings={"help_option_names": ["-h", "--help"]},
)
for _verb in read_verbs():
    add_command(app, _verb)
for _name in (name for names in PARTS.values() for name in names):
    if _package := verbs.package_with(_name):
        add_absent(app, _name, _package)


def _print_version(asked_for: bool) -> None:
    if asked_for:
        from anhyst.support import running_version

        print(f"anhyst {running_version()}")
        raise typer.Exit


@app.callback()
def _anhyst(
    _version: Annotated[
        bool,
        typer.Option(
            "--version", help="Print the version.", callback=_print_version, is_eager=True
        ),
    ] = False,
) -> None:
    """Identify actuators with hysteresis from measured loops, and compensate them.

    Measurements are CSV files with units in their headers (I_A, F_N, gap_mm), or recordings (MAT,
    MDF, TDMS, HDF5, Parquet, Excel). Models are TOML files. Exit codes: 0 for success, 1 for a
    negative result, 2 for bad input, 70 for a fault of anhyst itself, 130 after Ctrl-C. NO_COLOR is
    respected.
    """


@cache
def command_of(commands: typer.Typer) -> Callable[..., Any]:
    """Return what runs the verbs: their options take a while to gather."""
    return typer.main.get_command(commands)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    kept = ""
    start_printing()
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="replace")  # code pages of Windows lack some signs
    try:
        with command_line():
            code = _run(arguments)
    except (KeyboardInterrupt, typer.Abort):
        code = INTERRUPTED
    except BrokenPipeError:
        # Nobody reads any more; keep the interpreter from complaining when it flushes.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return NEGATIVE
    except Interrupted as stop:
        code, kept = INTERRUPTED, f": {one_line(str(stop))}"
    except Exception as fault:
        if "ANHYST_TRACE" in os.environ:
            raise
        of = f"the package {whose}" if (whose := package_at_fault(fault)) else "anhyst"
        say_error(
            f"{type(fault).__name__}: {fault}; this is a fault of {of}, not of your input: run "
            "again with ANHYST_TRACE=1 and report what it prints"
        )
        return FAULT
    if code == INTERRUPTED:
        print(f"anhyst: interrupted{kept}", file=sys.stderr)
        # Python remembers an interrupt that went through an exec (as dataclasses use while they
        # are imported) and would kill itself by it in the end; another exec makes it forget.
        exec("")
    return code


def _run(arguments: Sequence[str] | None) -> int:
    """Run a verb; what is wrong with its input becomes one line."""
    try:
        with warnings.catch_warnings():
            # Verbs say themselves what a user has to know; lines of libraries are for developers.
            warnings.simplefilter("ignore")
            warnings.simplefilter("always", CreepWarning)
            warnings.showwarning = lambda text, *_: warn(str(text))
            try:
                run = command_of(app)
                return int(run(args=arguments, prog_name="anhyst", standalone_mode=False) or 0)
            finally:
                printer.finish()
    except NegativeResult as error:
        print(f"anhyst: {one_line(str(error))}", file=sys.stderr)
        return NEGATIVE
    except InputError as error:
        text = str(error)
    except _Refusal as error:
        if not (message := error.format_message()):
            return BAD_INPUT  # the help has been shown
        message = message.replace("Value error, ", "")
        stop = "" if message.endswith((".", "?")) else "."
        text = f"{message}{stop} See 'anhyst --help'."
    except MemoryError:
        text = "not enough memory for this; thin the data or cut the file into parts"
    except BrokenPipeError:
        raise
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        advice = "; make room" if error.errno == errno.ENOSPC else ""
        text = f"{where}{error.strerror or error}{advice}"
    say_error(text)
    return BAD_INPUT


if __name__ == "__main__":
    sys.exit(main())
