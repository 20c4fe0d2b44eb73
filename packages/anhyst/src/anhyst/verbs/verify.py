"""The command ``verify``: check that compiled C gives the same bits on every target."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from anhyst.cli.printing import TerminalTable
    from anhyst.support.atomic import PathLike
    from anhyst.support.jobs import Progress
    from anhyst.verification.result import Verification

PLACE = 24, "Use a model"
PROGRESS = "verifying"


def verify(
    folder: PathLike,
    on: str | None = None,
    host_steps: int = 1_000_000,
    target_steps: int = 10_000,
    seed: int = 1,
    progress: Progress | None = None,
) -> Verification:
    """Run compiled C on real instruction sets and compare it bit for bit with the host.

    The command runs the golden vectors and random steps: a million on the host, ten thousand on
    each other target. For each target, it counts instructions or cycles per step, code size, memory
    and stack. The results are also written to verify.json and verify.md in the folder. If tools are
    missing, the other targets run, and a table names the packages to install. Exit code 1 if any
    bit differs, 2 if a target of `on` did not run.

    Parameters
    ----------
    folder : path-like, ``DIR``
        A folder written by 'anhyst compile'.
    on : str, ``TARGETS``, optional
        Targets, separated by commas: host, cortex-m0plus, cortex-m3, cortex-m4, cortex-m33,
        cortex-m7, avr, msp430, cortex-m3-qemu (a complete firmware). [default: host,cortex-m4, as
        far as their tools are installed]
    host_steps, target_steps : int, only in Python
        Random steps on the host and on each other target, at least 1.
    seed : int, only in Python
        Seed of the random steps, 1 to 2^32 - 1.
    progress : callable, optional
        Called with the number of builds done and the total.

    Returns
    -------
    Verification
        The results on all targets: see ``passed``, ``not_run`` and ``missing``.

    Raises
    ------
    InputError
        The folder was not written by compile, a target is unknown, no target can run, or a number
        is out of range.

    Examples
    --------
    anhyst verify controller --on host,cortex-m4,avr
    """
    from pathlib import Path

    from anhyst.verification.verify import verify as work

    verification = work(folder, on, host_steps, target_steps, seed, progress)
    verification.write_report(Path(folder))
    return verification


def show(result: Verification, _: Mapping[str, Any]) -> list[TerminalTable]:
    """Return the terminal output: a table of the results on each target, and one of the cost."""
    from anhyst.cli.printing import TerminalTable

    return [
        TerminalTable(result_table.title, result_table.headings, [*map(list, result_table.cells)])
        for result_table in result.tables()
    ]


def refuse(result: Verification, arguments: Mapping[str, Any]) -> None:
    """Raise an error if a bit differs, or if a requested target did not run."""
    from anhyst.support.errors import wrong_key

    require_equal_bits(result, arguments["folder"])
    if arguments["on"] is not None and result.not_run:
        missing_tools = [gap.text() for gap in result.missing if gap.target in result.not_run]
        raise wrong_key(
            "--on", f"not run, because tools are missing: {'; '.join(missing_tools)}", code="tool-missing"
        )


def require_equal_bits(result: Verification, folder: PathLike) -> None:
    """Raise NegativeResult if a bit differs."""
    from anhyst.support.errors import NegativeResult

    if not result.passed:
        raise NegativeResult(f"{folder}: {result.first_failure()}", code="verification-failed")
