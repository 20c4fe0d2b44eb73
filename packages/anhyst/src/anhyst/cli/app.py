"""Entry point of the command line: collect the commands, run one, return its exit code."""

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

from anhyst.cli.generate import add_command, add_missing_command, load_verbs
from anhyst.cli.printing import printer, start_printing
from anhyst.cli.shared import fold_to_line, print_error, print_warning
from anhyst.support import verbs
from anhyst.support.errors import InputError, Interrupted, NegativeResult, ReturnPointMemoryWarning
from anhyst.support.registry import PROJECT_PACKAGES, package_at_fault
from anhyst.support.wording import use_command_line_wording

EXIT_BAD_INPUT = 2
EXIT_NEGATIVE = 1
EXIT_FAULT = 70
EXIT_INTERRUPTED = 130

# Typer bundles click under a private name, which has changed between versions.
_ClickError = cast(
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
for _verb in load_verbs():
    add_command(app, _verb)
for _name in (name for names in PROJECT_PACKAGES.values() for name in names):
    if _package := verbs.missing_package(_name):
        add_missing_command(app, _name, _package)


def _print_version(is_requested: bool) -> None:
    if is_requested:
        from anhyst.support import running_version

        print(f"anhyst {running_version()}")
        raise typer.Exit


@app.callback()
def _anhyst(
    _version: Annotated[
        bool, typer.Option("--version", help="Print the version.", callback=_print_version, is_eager=True)
    ] = False,
) -> None:
    """Identify actuators with hysteresis from measured loops, and compensate them.

    Measurements are CSV files with units in their headers (I_A, F_N, gap_mm), or recordings (MAT,
    MDF, TDMS, HDF5, Parquet, Excel). Models are TOML files. Exit codes: 0 for success, 1 for a
    negative result, 2 for bad input, 70 for a fault of anhyst itself, 130 after Ctrl-C. NO_COLOR is
    respected.
    """


@cache
def build_command(commands: typer.Typer) -> Callable[..., Any]:
    """Return the function that runs the commands of a typer application; slow, therefore cached."""
    return typer.main.get_command(commands)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit code."""
    saved_text = ""
    start_printing()
    if isinstance(sys.stdout, io.TextIOWrapper):
        # Windows code pages lack some characters. The reader of a pipe receives each line immediately.
        sys.stdout.reconfigure(errors="replace", line_buffering=True)
    try:
        with use_command_line_wording():
            code = _run_verb(arguments)
    except (KeyboardInterrupt, typer.Abort):
        code = EXIT_INTERRUPTED
    except BrokenPipeError:
        # The reader has closed the pipe. Prevent an error message when the interpreter flushes
        # stdout.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_NEGATIVE
    except Interrupted as stop:
        code, saved_text = EXIT_INTERRUPTED, f": {fold_to_line(str(stop))}"
    except Exception as fault:
        if "ANHYST_TRACE" in os.environ:
            raise
        faulty_package = f"the package {package}" if (package := package_at_fault(fault)) else "anhyst"
        print_error(
            f"{type(fault).__name__}: {fault}; this is a fault of {faulty_package}, not of your input: run "
            "again with ANHYST_TRACE=1 and report what it prints"
        )
        return EXIT_FAULT
    if code == EXIT_INTERRUPTED:
        print(f"anhyst: interrupted{saved_text}", file=sys.stderr)
        # CPython stores an interrupt that passed through exec(), which dataclasses use on import,
        # and would kill itself with it at exit. Another exec() clears the interrupt.
        exec("")
    return code


def _run_verb(arguments: Sequence[str] | None) -> int:
    """Run one command. An error in the input is printed as one line."""
    try:
        with warnings.catch_warnings():
            # Commands report what a user has to know. Warnings of libraries are for developers.
            warnings.simplefilter("ignore")
            warnings.simplefilter("always", ReturnPointMemoryWarning)
            warnings.showwarning = lambda text, *_: print_warning(str(text))
            try:
                run = build_command(app)
                return int(run(args=arguments, prog_name="anhyst", standalone_mode=False) or 0)
            finally:
                printer.finish()
    except NegativeResult as error:
        print(f"anhyst: {fold_to_line(str(error))}", file=sys.stderr)
        return EXIT_NEGATIVE
    except InputError as error:
        text = str(error)
    except _ClickError as error:
        if not (message := error.format_message()):
            return EXIT_BAD_INPUT  # the help was printed, and nothing remains to be done
        message = message.replace("Value error, ", "")
        stop = "" if message.endswith((".", "?")) else "."
        text = f"{message}{stop} See 'anhyst --help'."
    except MemoryError:
        text = "not enough memory for this; thin the data or cut the file into parts"
    except BrokenPipeError:
        raise
    except OSError as error:
        location = f"{error.filename}: " if error.filename else ""
        advice = "; free some space" if error.errno == errno.ENOSPC else ""
        text = f"{location}{error.strerror or error}{advice}"
    print_error(text)
    return EXIT_BAD_INPUT


if __name__ == "__main__":
    sys.exit(main())
