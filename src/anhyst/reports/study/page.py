"""What the pages of all studies share: their tables by metric, where they come from, the file."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

from matplotlib.figure import Figure

from anhyst.compensate.methods import METHODS
from anhyst.reports.study.look import interval_text, ordered
from anhyst.study.engine.table import CaseFigures, Cases, Metric
from anhyst.study.engine.verdict import Interval
from anhyst.support.atomic import PathLike, atomic_writer
from anhyst.support.figures import svg_text
from anhyst.support.kinds import MethodName
from anhyst.support.page import (
    NBSP,
    Cell,
    Headline,
    Items,
    PageTable,
    Picture,
    Section,
    Tile,
    number,
    render_page,
    table,
)
from anhyst.support.version import running_version

REPORT = "report.html"
"""The page, beside what a study writes."""
_REMARKS: Mapping[MethodName, str] = {
    "ratio": "the paper's case without compensation; nothing cancels the negative stiffness",
    "secant": "the same, read as a line through the origin",
    "linearised": "cancels the negative stiffness at the operating point: standard practice",
    "single-valued": "the honest baseline of hysteresis: all that a curve without memory can do",
    "play": "the least that knows hysteresis: width of the loops and one state, no law of iron",
    "simplified": "inverse of the simplified law",
    "at-rest": "the same as full, but for iron that answers late: taken as if it did not",
    "full": "inverse of the identified law, its state advanced with what was applied",
    "flux": "needs a Hall probe in the gap, and measures instead of modelling",
    "fused": "full, corrected by a Hall probe in the gap",
}


class Printed(NamedTuple):
    """What a terminal shows of a study, beside losses and verdict."""

    tables: Sequence[PageTable]
    lines: Sequence[str]


def page_text(
    kind: str,
    head: Headline,
    sections: Sequence[Section | None],
    source: str = "a simulation",
) -> str:
    """Return the page of a study; sections with nothing in them are left out."""
    kept = [section for section in sections if section is not None and section.blocks]
    return render_page(head, kept, running_version(), kind=kind, source=source)


def write_page(path: PathLike, text: str) -> None:
    """Write a page: one HTML file that needs nothing else."""
    with atomic_writer(path) as stream:
        stream.write(text)


def origin(files: Mapping[str, str], command: str = "", seed: int | None = None) -> Section:
    """Return the section that says of which files a page is, with their SHA-256, and how it is made."""
    rows: list[list[str | Cell]] = [
        [name, Cell(f"{digest[:16]}…", code=True)] for name, digest in files.items()
    ]
    again = [] if seed is None else [f"Seed {seed}; the same seed gives the same figures."]
    again += [f"Made by: {command}"] if command else []
    blocks = [table("Files", ["file", "SHA-256"], rows, texts=2)] if rows else []
    items = [Items("How to make it again", tuple(again))] if again else []
    return Section("origin", "Origin", (*blocks, *items))


def hashes(files: Sequence[Path]) -> dict[str, str]:
    """Return the SHA-256 of files by name."""
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in files}


def picture(figure: Figure, key: str, alt: str, caption: str) -> Picture:
    """Return a figure with what it shows in words, and its caption."""
    return Picture(svg_text(figure, key), alt, caption)


def tile(metric: Metric, mine: float, other: float, name: str) -> Tile:
    """Return one large figure, beside that of what it is compared with."""
    texts = [f"{number(metric.factor * one, 2)}{NBSP}{metric.unit}" for one in (mine, other)]
    return Tile(texts[0], metric.title, f"{name}: {texts[1]}")


def method_table(
    title: str,
    metrics: Sequence[Metric],
    methods: Mapping[str, Callable[[str], Interval | None]],
    caption: str = "",
) -> PageTable:
    """Return a table of one case: a row a method, which gives its figures by key, a column a metric."""

    def cell(of: Callable[[str], Interval | None], metric: Metric) -> str:
        return interval_text(of(metric.key), factor=metric.factor).replace(" ", NBSP)

    rows = [[name, *(cell(of, metric) for metric in metrics)] for name, of in methods.items()]
    return table(title, ["variant", *(metric.head for metric in metrics)], rows, caption)


def case_table(
    metric: Metric,
    cases: Cases,
    caption: str = "",
    remark: Callable[[CaseFigures], str] | None = None,
) -> PageTable:
    """Return a table of one metric: a row a case, a column a method."""
    methods = ordered(name for row in cases.values() for name in row)

    def cell(case: str, name: MethodName) -> str:
        """Write a figure and its remark, between which alone a line may end."""
        if name not in cases[case]:
            return interval_text(None)
        figures = cases[case][name]
        text = interval_text(figures.of(metric.key), factor=metric.factor)
        parts = (text, "" if remark is None else remark(figures))
        return " ".join(part.replace(" ", NBSP) for part in parts if part)

    rows = [[case, *(cell(case, name) for name in methods)] for case in cases]
    counts = [one.of(metric.key).count for row in cases.values() for one in row.values()]
    ends = " to ".join(str(end) for end in sorted({min(counts), max(counts)}))
    interval = f"Mean and 95 % confidence interval over {ends} noise seeds."
    return table(metric.head, ["", *methods], rows, f"{caption} {interval}".strip())


def legend_table(methods: Sequence[MethodName]) -> PageTable:
    """Say what the variants are."""
    rows: list[list[str | Cell]] = [
        [Cell(name, code=True), METHODS[name].title, _REMARKS[name]] for name in methods
    ]
    return table(
        "Variants",
        ["name", "from wanted force to current", "remark"],
        rows,
        "All are fitted to the same measured loops, except flux, which has a static series of its "
        "probe.",
        texts=3,
    )
