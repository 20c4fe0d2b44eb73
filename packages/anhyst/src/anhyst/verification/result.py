"""Show the result of a verification as tables, and write them as two files into the folder."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from anhyst.compilation.toolchain import MissingTool
from anhyst.support.atomic import atomic_writer
from anhyst.support.result import Result, rows_to_columns
from anhyst.verification.compare import Difference
from anhyst.verification.elf import CLOCK_HZ, PRICES, Estimate, ProgramSizes

if TYPE_CHECKING:
    from matplotlib.axes import Axes


@dataclass(frozen=True, slots=True)
class Cost:
    """Cost of one part of a step on a target, in the target's unit."""

    # ``solve``; ``commit, solved`` with the solved current; ``commit, rounded`` with the current on
    # a converter's grid; ``commit, limited`` with a limit instead; ``commit, other`` with another
    # current; ``pidd2``; ``tick, rounded`` and ``tick``: a whole step
    part: str
    least: int  # minimum over all steps
    mean: float  # mean over all steps
    most: int
    most_at: int  # step of the maximum, from 0


@dataclass(frozen=True, slots=True)
class TargetResult:
    """Result of one build on one target."""

    target: str  # target, and name of the build
    build: str
    processor: str  # processor and compiler
    compiler: str
    steps: int  # number of compared random steps and golden vectors
    vectors: int
    warnings: int = 0  # number of compiler warnings
    # unit of the costs: ``instructions``, ``cycles``, or empty if they are not counted
    unit: str = ""
    costs: tuple[Cost, ...] = ()  # cost of each part of a step
    sizes: ProgramSizes | None = None  # sizes of code and constants; None on the host
    state_bytes: int = 0  # size of the state of one compensator and of one PIDD2
    control_bytes: int = 0
    # largest painted stack of a call of solve or commit, bytes
    stack_measured: int | None = None
    stack_static: int | None = None  # upper bound from the machine code
    difference: Difference | None = None  # first difference
    failure: str = ""  # reason why no comparison was possible, such as a compiler error
    seconds: float = 0.0  # time of build and run

    @property
    def passed(self) -> bool:
        """Whether all bits are the same."""
        return self.difference is None and not self.failure

    @property
    def label(self) -> str:
        """Target and build."""
        return f"{self.target} ({self.build})"

    def verdict(self) -> str:
        """Return the result in one line."""
        if self.failure:
            return self.failure
        if self.difference is not None:
            return f"target {self.label}: {self.difference.text()}"
        return "identical"

    def cost(self, part: str) -> Cost | None:
        """Return the cost of one part, or None if it was not counted."""
        return next((cost for cost in self.costs if cost.part == part), None)


@dataclass(frozen=True, slots=True, repr=False)
class Verification(Result):
    """Result of a verification on all requested targets.

    Parameters
    ----------
    folder : str
        The compiled folder.
    kind, io : str
        Kind of the compensator, and format of its signals.
    rate : float or None
        Sample rate for which the folder was compiled, Hz.
    seed : int
        Seed of the random steps.
    results : tuple of TargetResult
        One for each build.
    estimates : tuple of Estimate
        Estimates for a 16-bit digital signal controller, by part of the step.
    not_run : tuple of str
        Requested targets that did not run, because their tools are missing.
    missing : tuple of MissingTool
        Missing tools, also those without which a target ran with fewer builds.
    """

    folder: str
    kind: str
    io: str
    rate: float | None
    seed: int
    results: tuple[TargetResult, ...]
    estimates: tuple[Estimate, ...]
    not_run: tuple[str, ...] = ()
    missing: tuple[MissingTool, ...] = ()

    @property
    def passed(self) -> bool:
        """Whether all bits are the same on all targets that ran."""
        return all(result.passed for result in self.results)

    def first_failure(self) -> str:
        """Return the verdict of the first build that differs, or an empty text."""
        return next((result.verdict() for result in self.results if not result.passed), "")

    def as_dict(self) -> dict[str, Any]:
        """Return all data in simple types, for JSON."""
        return {"format": 1, "passed": self.passed, **asdict(self)}

    def write_report(self, folder: Path) -> None:
        """Write ``verify.json`` and ``verify.md`` into a folder; an error leaves no partial file."""
        with atomic_writer(folder / JSON_FILE) as stream:
            json.dump(self.as_dict(), stream, indent=2, allow_nan=False)
            stream.write("\n")
        with atomic_writer(folder / TEXT_FILE) as stream:
            stream.write(_markdown_report(self))

    def tables(self) -> list[VerificationTable]:
        """Return the results as tables for people."""
        results = ((result,) for result in self.results)
        rows = [_make_table("bit for bit the same as on the host", _EQUALITY_COLUMNS, results)]
        costs = [(result, cost) for result in self.results for cost in result.costs]
        sizes = [(result, result.sizes) for result in self.results if result.sizes is not None]
        missing_tools = [(tool, tool.target in self.not_run) for tool in self.missing]
        if costs:
            rows.append(_make_table("time of a step", _COST_COLUMNS, costs))
        if sizes:
            rows.append(_make_table("memory, bytes", _MEMORY_COLUMNS, sizes))
        if self.estimates:
            rows.append(_estimate_table(self.estimates))
        if missing_tools:
            rows.append(_make_table("missing tools", _MISSING_COLUMNS, missing_tools))
        return rows

    def facts(self) -> dict[str, str]:
        """Return whether all bits are the same on each target, and the cost of a tick."""
        facts = {"passed": "yes" if self.passed else "no"}
        for result in self.results:
            cost = result.cost("tick")
            price = f", a tick takes {cost.mean:.0f} to {cost.most} {result.unit}" if cost else ""
            facts[result.label] = result.verdict() + price
        return facts | ({"not run": ", ".join(self.not_run)} if self.not_run else {})

    def to_columns(self) -> dict[str, Any]:
        """Return the cost of each part of a step on each target, in the target's unit."""
        names = ("target", "build", "passed", "unit")
        return rows_to_columns(
            [
                {name: getattr(result, name) for name in names} | asdict(cost)
                for result in self.results
                for cost in result.costs
            ]
        )

    def draw(self, ax: Axes) -> None:
        """Draw mean and maximum cost of a tick on each target that counts it."""
        costs = [(run, cost) for run in self.results if (cost := run.cost("tick")) is not None]
        bar_positions = range(len(costs))
        ax.barh(bar_positions, [cost.most for _, cost in costs], color="0.85", label="largest")
        ax.barh(bar_positions, [cost.mean for _, cost in costs], height=0.5, label="mean")
        ax.set_yticks(bar_positions, [f"{run.label}, {run.unit}" for run, _ in costs])
        ax.set_xlabel("cost of a tick")


JSON_FILE = "verify.json"
TEXT_FILE = "verify.md"


@dataclass(frozen=True, slots=True)
class VerificationTable:
    """Table of texts: headings and cells."""

    title: str
    headings: tuple[str, ...]
    cells: tuple[tuple[str, ...], ...]


def _make_table(
    title: str, columns: Mapping[str, Callable[..., object]], items: Iterable[Any]
) -> VerificationTable:
    """Return a table with a row for each item; each column has a function; None becomes a dash."""
    texts = ([text(*item) for text in columns.values()] for item in items)
    cells = (tuple("-" if text is None else str(text) for text in row) for row in texts)
    return VerificationTable(title, tuple(columns), tuple(cells))


_MISSING_COLUMNS: Mapping[str, Callable[[MissingTool, bool], object]] = {
    "target": lambda tool, _: tool.target,
    "tool": lambda tool, _: tool.tool,
    "comes with": lambda tool, _: tool.install,
    "outcome": lambda _, is_left_out: "did not run" if is_left_out else "ran without it",
}
_EQUALITY_COLUMNS: Mapping[str, Callable[[TargetResult], object]] = {
    "target": lambda result: result.label,
    "random steps": lambda result: result.steps,
    "golden vectors": lambda result: result.vectors,
    "warnings": lambda result: result.warnings,
    "s": lambda result: f"{result.seconds:.1f}",
    "result": lambda result: result.verdict() if result.passed else "DIFFERS",
}
_COST_COLUMNS: Mapping[str, Callable[[TargetResult, Cost], object]] = {
    "target": lambda result, _: result.label,
    "part of a step": lambda _, cost: cost.part,
    "least": lambda _, cost: cost.least,
    "mean": lambda _, cost: f"{cost.mean:.1f}",
    "most": lambda _, cost: cost.most,
    "most at step": lambda _, cost: cost.most_at,
    "unit": lambda result, _: result.unit,
}
_MEMORY_COLUMNS: Mapping[str, Callable[[TargetResult, ProgramSizes], object]] = {
    "target": lambda result, _: result.label,
    "code": lambda _, sizes: sizes.code,
    "constants": lambda _, sizes: sizes.tables,
    "parameters": lambda _, sizes: sizes.parameters,
    "state": lambda result, _: result.state_bytes,
    "stack, measured": lambda result, _: result.stack_measured,
    "stack, by its code": lambda result, _: result.stack_static,
    "PIDD2: code + state": lambda result, sizes: f"{sizes.control_code} + {result.control_bytes}",
}


def _estimate_table(estimates: Sequence[Estimate]) -> VerificationTable:
    parts = dict.fromkeys(estimate.part for estimate in estimates)
    texts = {(item.part, item.prices): f"{item.cycles} ({item.rate / 1e3:.1f} kHz)" for item in estimates}
    cells = tuple((part, *(texts[part, prices] for prices in PRICES)) for part in parts)
    title = f"a 16-bit DSC of {CLOCK_HZ / 1e6:.0f} MHz, worst case, estimated: cycles (rate)"
    return VerificationTable(title, ("part of a step", *PRICES), cells)


def _markdown_report(verification: Verification) -> str:
    kind, io = verification.kind, verification.io
    verdict = "identical everywhere" if verification.passed else verification.first_failure()
    if verification.not_run:
        verdict += f"; not run because of missing tools: {', '.join(verification.not_run)}"
    lines = ["# Verification", "", f"{kind}, {io}, seed {verification.seed}: {verdict}.", ""]
    for rows in verification.tables():
        lines += [f"## {rows.title[:1].upper()}{rows.title[1:]}", "", _table_row(rows.headings)]
        lines += [_table_row(["---"] * len(rows.headings)), *map(_table_row, rows.cells), ""]
    return "\n".join(lines)


def _table_row(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"
