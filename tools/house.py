"""What the house measures: ``make house`` counts rooms, who imports whom, circles and lines.

A *room* is a folder at the top of the package; a pair is two rooms of which one imports the other.
A *circle* is a group of modules, or of folders, that all lead to each other. Imports inside
functions and for types count; ``anhyst/__init__.py`` does not, since it imports a name when it is
used. The record beside this file (``house.json``) only falls: to raise a number of it is an edit by
hand. ARCHITECTURE.md prints the same numbers.
"""

from __future__ import annotations

import ast
import json
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
SOURCES = ROOT / "src"
RECORD = ROOT / "tools" / "house.json"
PAGE = ROOT / "ARCHITECTURE.md"
TABLE = re.compile(r"(<!-- made by make house -->\n).*?(<!-- end -->\n)", re.DOTALL)

TEXTS = {
    "rooms": "rooms at the top of the package",
    "pairs": "pairs of rooms of which one imports the other",
    "module circles": "circles of modules",
    "folder circles": "circles of folders",
    "files": "files of Python in `src`, at most",
    "lines": "lines of Python in `src`, at most",
    "code": "of these, code (no docstring, comment, import or blank line), at most",
    "kind tests": "tests of the kind of a rig outside of its record",
    "C": "lines of C in `core`, `plant`, `firmware` and the package, at most",
}
STEPS = {"files": 10, "lines": 500, "code": 500, "C": 500}
"""What changes with every commit is recorded rounded up to these."""

Graph = dict[str, set[str]]


def count() -> dict[str, int]:
    """Return every number of the house as it stands."""
    texts = {_module(path): path.read_text("utf-8") for path in SOURCES.rglob("*.py")}
    trees = {name: ast.parse(text) for name, text in texts.items()}
    modules = imports(trees)
    packages = {_module(path) for path in SOURCES.rglob("__init__.py")}
    folders = _merged(modules, lambda name: name if name in packages else name.rpartition(".")[0])
    rooms = _merged(modules, lambda name: name.split(".")[1])
    return {
        "rooms": len(rooms),
        "pairs": sum(map(len, rooms.values())),
        "module circles": len(circles(modules)),
        "folder circles": len(circles(folders)),
        "files": len(texts),
        "lines": sum(len(text.splitlines()) for text in texts.values()),
        "code": sum(_code_lines(text, trees[name]) for name, text in texts.items()),
        "kind tests": sum(map(_kind_tests, trees.values())),
        "C": sum(len(path.read_text("utf-8").splitlines()) for path in _c_sources()),
    }


def imports(trees: Mapping[str, ast.Module]) -> Graph:
    """Return which modules each one imports, wherever the import stands."""
    return {
        name: {one for one in _targets(tree, trees) if one not in {name, "anhyst"}}
        for name, tree in trees.items()
        if name != "anhyst"
    }


def circles(graph: Graph) -> list[set[str]]:
    """Return the groups of names that lead to each other."""
    reached = {name: _reached(graph, name) for name in graph}
    groups = {
        frozenset(other for other in reached[name] if name in reached[other]) for name in graph
    }
    return [set(group) for group in groups if len(group) > 1]


def recorded(numbers: Mapping[str, int]) -> dict[str, int]:
    """Return the numbers as the record and the page give them: rounded up where they flicker."""
    return {
        name: -(-value // STEPS.get(name, 1)) * STEPS.get(name, 1)
        for name, value in numbers.items()
    }


def table(numbers: Mapping[str, int]) -> str:
    """Return the rows of ARCHITECTURE.md."""
    rows = "\n".join(f"| {TEXTS[name]} | {value:,} |" for name, value in recorded(numbers).items())
    return f"| | now |\n| --- | --- |\n{rows}\n"


def main() -> int:
    """Count, print, let the record fall, bring the page up to date; 1 where a number rose."""
    numbers = count()
    limits: dict[str, int] = json.loads(RECORD.read_text("utf-8"))
    now = recorded(numbers)
    for name, value in numbers.items():
        rose = f"   rose: the record is {limits[name]:,}" if now[name] > limits[name] else ""
        print(f"{TEXTS[name].removesuffix(', at most'):76}{value:8,}{rose}")
    limits = {name: min(value, limits[name]) for name, value in now.items()}
    RECORD.write_text(json.dumps(limits, indent=2) + "\n", "utf-8")
    PAGE.write_text(TABLE.sub(rf"\g<1>{table(numbers)}\g<2>", PAGE.read_text("utf-8")), "utf-8")
    return int(limits != now)


def _module(path: Path) -> str:
    parts = path.relative_to(SOURCES).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def _targets(tree: ast.Module, known: Iterable[str]) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in known)
        elif isinstance(node, ast.ImportFrom) and node.module and node.module in known:
            for alias in node.names:
                full = f"{node.module}.{alias.name}"
                yield full if full in known else node.module


def _merged(graph: Graph, of: Callable[[str], str]) -> Graph:
    merged: Graph = {}
    for name, targets in graph.items():
        merged.setdefault(of(name), set()).update({of(one) for one in targets} - {of(name)})
    return merged


def _reached(graph: Graph, start: str) -> set[str]:
    seen, waiting = {start}, [start]
    while waiting:
        fresh = graph.get(waiting.pop(), set()) - seen
        seen |= fresh
        waiting += fresh
    return seen


_OF_ONE_KIND = {
    *("LevitationTable", "TrackingTable", "ForceTable", "DisplacementTable"),
    *("Rig", "PiezoRig", "BearingBench", "StageBench", "ForceBench", "PiezoBench"),
    *("PreparedBearing", "PreparedStage", "PreparedForce", "PreparedPiezo"),
}
"""Classes that belong to one kind of rig."""


_WORDS = {"'levitation'", "'tracking'"}
"""Words of rig files that no other table uses for its kind."""
_KIND = re.compile(r"(control|settings|file)\.kind(\.word)?$")


def _kind_tests(tree: ast.Module) -> int:
    """Return how often a module asks which kind a rig is: by its word, its record or a class."""
    found = 0
    for node in ast.walk(tree):
        if isinstance(node, ast.Compare):
            sides = {ast.unparse(side) for side in (node.left, *node.comparators)}
            found += bool(sides & _WORDS) or any(map(_KIND.search, sides))
        elif isinstance(node, ast.ImportFrom) and (node.module or "").startswith(
            "anhyst_rigs.kinds."
        ):
            found += any(alias.name != "RigKind" for alias in node.names)
        elif isinstance(node, ast.Call) and ast.unparse(node.func) == "isinstance":
            names = {one.id for one in ast.walk(node.args[1]) if isinstance(one, ast.Name)}
            found += bool(names & _OF_ONE_KIND)
    return found


def _code_lines(text: str, tree: ast.Module) -> int:
    """Return how many lines hold code that does something."""
    numbered = enumerate(text.splitlines(), 1)
    lines = {number for number, line in numbered if line.strip()[:1] not in {"", "#"}}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import | ast.ImportFrom) or (
            isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        ):
            lines -= set(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    return len(lines)


def _c_sources() -> list[Path]:
    places = [ROOT / "core", ROOT / "plant", ROOT / "firmware", SOURCES]
    sources = [
        path for place in places for path in place.rglob("*") if path.suffix in {".c", ".h", ".cpp"}
    ]
    return [path for path in sources if path.parent.name != "fmi"]  # the standard's own headers


if __name__ == "__main__":
    sys.exit(main())
