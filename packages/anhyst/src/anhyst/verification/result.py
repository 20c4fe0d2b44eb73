"""What a verification found, as tables, and as two files beside what was verified."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from anhyst.compilation.toolchain import Missing
from anhyst.support.atomic import atomic_writer
from anhyst.support.result import Result, columns_of
from anhyst.verification.compare import Difference
from anhyst.verification.elf import CLOCK_HZ, PRICES, Estimate, ProgramSizes

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, slots=True)
class Cost:
    """What one part of a step takes on a target, in the target's unit."""

    # ``solve``; ``commit, solved`` with the solved current, ``commit, rounded`` with that on a
    # converter's grid, ``commit, limited`` with a limit instead of it, ``commit, other`` with
    # another current; ``pidd2``; ``tick, rounded`` and ``tick``, all of a step
    part: str
    least: int  # over all steps
    mean: float  # over all steps
    most: int
    most_at: int  # step with the most, from 0


@dataclass(frozen=True, slots=True)
class TargetResult:
    """One build on one target."""

    target: str  # where, and what sets this build apart
    build: str
    processor: str  # what it ran on and what made it
    compiler: str
    steps: int  # random steps and golden vectors compared
    vectors: int
    warnings: int = 0  # the compiler's
    # of the costs: ``instructions``, ``cycles``, or nothing where they are not counted
    unit: str = ""
    costs: tuple[Cost, ...] = ()  # by part of a step
    sizes: ProgramSizes | None = None  # of code and constants; None on the host
    state_bytes: int = 0  # mutable state of one compensator and of one PIDD2
    control_bytes: int = 0
    # deepest painted stack below a call of solve or commit, bytes
    stack_measured: int | None = None
    stack_static: int | None = None  # deepest path through the machine code from there, bytes
    difference: Difference | None = None  # the first one
    failure: str = ""  # why there is no comparison: it does not compile, a sanitizer stopped it
    seconds: float = 0.0  # build and run

    @property
    def passed(self) -> bool:
        """Whether every bit was the same."""
        return self.difference is None and not self.failure

    @property
    def label(self) -> str:
        """Target and build in one."""
        return f"{self.target} ({self.build})"

    def verdict(self) -> str:
        """Report in one line what came out."""
        if self.failure:
            return self.failure
        if self.difference is not None:
            return f"target {self.label}: {self.difference.text()}"
        return "identical"

    def cost(self, part: str) -> Cost | None:
        """Return the costs of one part, if it was counted."""
        return next((cost for cost in self.costs if cost.part == part), None)


@dataclass(frozen=True, slots=True, repr=False)
class Verification(Result):
    """A bundle on all targets that were asked for.

    Parameters
    ----------
    folder : str
        The bundle.
    kind, io : str
        Of the compensator and its signals.
    rate : float or None
        Ticks a second it was made for, Hz.
    seed : int
        Of the random steps.
    results : tuple of TargetResult
        One for each build.
    estimates : tuple of Estimate
        For a 16-bit digital signal controller, by part of the step.
    not_run : tuple of str
        Targets that were asked for and could not run: their tools are missing.
    missing : tuple of Missing
        Tools that are missing, those without which a target ran with fewer builds included.
    """

    folder: str
    kind: str
    io: str
    rate: float | None
    seed: int
    results: tuple[TargetResult, ...]
    estimates: tuple[Estimate, ...]
    not_run: tuple[str, ...] = ()
    missing: tuple[Missing, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether every bit was the same wherever it ran."""
        return all(result.passed for result in self.results)

    def first_failure(self) -> str:
        """Return the verdict of the first build that differs, or nothing."""
        return next((result.verdict() for result in self.results if not result.passed), "")

    def as_dict(self) -> dict[str, Any]:
        """Return everything as plain data, for JSON."""
        return {"format": 1, "passed": self.passed, **asdict(self)}

    def write_report(self, folder: Path) -> None:
        """Write ``verify.json`` and ``verify.md`` into a folder, each whole or not at all."""
        with atomic_writer(folder / JSON_FILE) as stream:
            json.dump(self.as_dict(), stream, indent=2, allow_nan=False)
            stream.write("\n")
        with atomic_writer(folder / TEXT_FILE) as stream:
            stream.write(_markdown(self))

    def tables(self) -> list[Rows]:
        """Return what was found as tables for a person."""
        results = self.results
        rows = [_equality(results)]
        if any(result.costs for result in results):
            rows.append(_costs(results))
        if any(result.sizes for result in results):
            rows.append(_memory(results))
        if self.estimates:
            rows.append(_estimates(self.estimates))
        if self.missing:
            rows.append(_missing(self))
        return rows

    def facts(self) -> dict[str, str]:
        """Return where every bit was the same, and what a tick costs there."""
        facts = {"passed": "yes" if self.passed else "no"}
        for result in self.results:
            cost = result.cost("tick")
            price = f", a tick takes {cost.mean:.0f} to {cost.most} {result.unit}" if cost else ""
            facts[result.label] = result.verdict() + price
        return facts | ({"not run": ", ".join(self.not_run)} if self.not_run else {})

    def to_columns(self) -> dict[str, Any]:
        """Return the cost of each part of a step on each target, in the target's unit."""
        return columns_of(
            [
                {
                    "target": result.target,
                    "build": result.build,
                    "passed": result.passed,
                    "unit": result.unit,
                    **asdict(cost),
                }
                for result in self.results
                for cost in result.costs
            ]
        )

    def draw(self, ax: Axes) -> None:
        """Draw mean and largest cost of a tick on each target that counts it."""
        costs = [(run, cost) for run in self.results if (cost := run.cost("tick")) is not None]
        places = range(len(costs))
        ax.barh(places, [cost.most for _, cost in costs], color="0.85", label="largest")
        ax.barh(places, [cost.mean for _, cost in costs], height=0.5, label="mean")
        ax.set_yticks(places, [f"{run.label}, {run.unit}" for run, _ in costs])
        ax.set_xlabel("cost of a tick")


JSON_FILE = "verify.json"
TEXT_FILE = "verify.md"


@dataclass(frozen=True, slots=True)
class Rows:
    """A table: headings, and cells as text."""

    title: str
    headings: tuple[str, ...]
    cells: tuple[tuple[str, ...], ...]


def _missing(verification: Verification) -> Rows:
    cells = tuple(
        (
            lack.target,
            lack.tool,
            lack.install,
            "did not run" if lack.target in verification.not_run else "ran without it",
        )
        for lack in verification.missing
    )
    return Rows("missing tools", ("target", "tool", "comes with", "outcome"), cells)


def _equality(results: Sequence[TargetResult]) -> Rows:
    return Rows(
        "bit for bit the same as on the host",
        ("target", "random steps", "golden vectors", "warnings", "s", "result"),
        tuple(
            (
                result.label,
                f"{result.steps}",
                f"{result.vectors}",
                f"{result.warnings}",
                f"{result.seconds:.1f}",
                result.verdict() if result.passed else "DIFFERS",
            )
            for result in results
        ),
    )


def _costs(results: Sequence[TargetResult]) -> Rows:
    cells = [
        (
            result.label,
            cost.part,
            f"{cost.least}",
            f"{cost.mean:.1f}",
            f"{cost.most}",
            f"{cost.most_at}",
            result.unit,
        )
        for result in results
        for cost in result.costs
    ]
    headings = ("target", "part of a step", "least", "mean", "most", "most at step", "unit")
    return Rows("time of a step", headings, tuple(cells))


def _memory(results: Sequence[TargetResult]) -> Rows:
    cells = []
    for result in results:
        if result.sizes is not None:
            sizes = result.sizes
            cells.append(
                (
                    result.label,
                    f"{sizes.code}",
                    f"{sizes.tables}",
                    f"{sizes.parameters}",
                    f"{result.state_bytes}",
                    _or_dash(result.stack_measured),
                    _or_dash(result.stack_static),
                    f"{sizes.control_code} + {result.control_bytes}",
                )
            )
    headings = (
        "target",
        "code",
        "constants",
        "parameters",
        "state",
        "stack, measured",
        "stack, by its code",
        "PIDD2: code + state",
    )
    return Rows("memory, bytes", headings, tuple(cells))


def _or_dash(number: int | None) -> str:
    return "-" if number is None else f"{number}"


def _estimates(estimates: Sequence[Estimate]) -> Rows:
    parts = tuple(dict.fromkeys(estimate.part for estimate in estimates))
    by_place = {(estimate.part, estimate.prices): estimate for estimate in estimates}
    cells = tuple(
        (
            part,
            *(
                f"{by_place[part, name].cycles} ({by_place[part, name].rate / 1e3:.1f} kHz)"
                for name in PRICES
            ),
        )
        for part in parts
    )
    title = f"a 16-bit DSC of {CLOCK_HZ / 1e6:.0f} MHz, worst case, estimated: cycles (rate)"
    return Rows(title, ("part of a step", *PRICES), cells)


def _markdown(verification: Verification) -> str:
    kind, io = verification.kind, verification.io
    verdict = "identical everywhere" if verification.passed else verification.first_failure()
    if verification.not_run:
        verdict += f"; not run for want of tools: {', '.join(verification.not_run)}"
    lines = ["# Verification", "", f"{kind}, {io}, seed {verification.seed}: {verdict}.", ""]
    for rows in verification.tables():
        lines += [f"## {rows.title[:1].upper()}{rows.title[1:]}", "", _line(rows.headings)]
        lines += [_line(["---"] * len(rows.headings)), *map(_line, rows.cells), ""]
    return "\n".join(lines)


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"
