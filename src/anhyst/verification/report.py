"""A verification as tables, and as two files beside what was verified."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from anhyst.support.atomic import atomic_writer
from anhyst.verification.estimate import CLOCK_HZ, PRICES, Estimate
from anhyst.verification.result import TargetResult, Verification

JSON_FILE = "verify.json"
TEXT_FILE = "verify.md"


@dataclass(frozen=True, slots=True)
class Rows:
    """A table: headings, and cells as text."""

    title: str
    headings: tuple[str, ...]
    cells: tuple[tuple[str, ...], ...]


def write_report(verification: Verification, folder: Path) -> None:
    """Write ``verify.json`` and ``verify.md`` into a folder, each whole or not at all."""
    with atomic_writer(folder / JSON_FILE) as stream:
        json.dump(verification.as_dict(), stream, indent=2, allow_nan=False)
        stream.write("\n")
    with atomic_writer(folder / TEXT_FILE) as stream:
        stream.write(_markdown(verification))


def tables(verification: Verification) -> list[Rows]:
    """Return what was found as tables for a person."""
    results = verification.results
    rows = [_equality(results)]
    if any(result.costs for result in results):
        rows.append(_costs(results))
    if any(result.sizes for result in results):
        rows.append(_memory(results))
    if verification.estimates:
        rows.append(_estimates(verification.estimates))
    if verification.missing:
        rows.append(_missing(verification))
    return rows


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
    for rows in tables(verification):
        lines += [f"## {rows.title[:1].upper()}{rows.title[1:]}", "", _line(rows.headings)]
        lines += [_line(["---"] * len(rows.headings)), *map(_line, rows.cells), ""]
    return "\n".join(lines)


def _line(cells: Sequence[str]) -> str:
    return f"| {' | '.join(cells)} |"
