"""What the house measures: ``make house`` counts rooms, who imports whom, circles and lines.

A *room* is a folder at the top of a part; a pair is two rooms of which one imports the other. A
*circle* is a group of modules, or of folders, that all lead to each other. Imports inside functions
and for types count; those of ``__init__.py`` at the top of a part do not, since it imports a name
when it is used. The record beside this file (``house.json``) only falls: to raise a number of it is
an edit by hand. ARCHITECTURE.md prints the same numbers beside the budget, which is what they are to
fall to.
"""

from __future__ import annotations

import ast
import json
import re
import subprocess
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path

from tools import environment

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ROOT / "packages"
PARTS = {part: PACKAGES / part / "src" for part in environment.PARTS}
"""The folder that holds the sources of each part."""
RECORD = ROOT / "tools" / "house.json"
PAGE = ROOT / "ARCHITECTURE.md"
TABLE = re.compile(r"(<!-- made by make house -->\n).*?(<!-- end -->\n)", re.DOTALL)

DESCRIPTIONS = {
    "rooms": "rooms at the top of the parts",
    "pairs": "pairs of rooms of which one imports the other",
    "module circles": "circles of modules",
    "folder circles": "circles of folders",
    "wrong way": "imports from a part into one that needs it",
    "kind tests": "tests of the kind of a rig outside of its record",
    "several": "questions whether a stage has several coordinates (`.several`)",
    "model to C, files": "files on the way of a model to C",
    "model to C, returns": "returns to an earlier file on that way",
    "rig to recording, files": "files on the way of a rig file to a recording",
    "rig to recording, returns": "returns to an earlier file on that way",
    "files": "files of Python in the parts",
    "code": "lines of Python that are code (no docstring, comment, import or blank line)",
    **{part: f"lines of Python in `{part}`" for part in PARTS},
    "C core": "lines of C in `core`",
    "C rigs": "lines of C in `plant` and `firmware`",
    "C parts": "lines of C and C++ in the parts",
    "changelog": "words in CHANGELOG.md",
    "architecture": "words in ARCHITECTURE.md",
}
BUDGETS = {
    **{"wrong way": 0, "kind tests": 0, "several": 0},
    **{"model to C, files": 28, "model to C, returns": 50},
    **{"rig to recording, files": 38, "rig to recording, returns": 55},
    **{"anhyst": 36_000, "anhyst-rigs": 33_000, "anhyst-exchange": 2_500},
    **{"C core": 14_000, "C rigs": 10_000, "C parts": 7_500},
    **{"changelog": 600, "architecture": 1_800},
}
"""What the record is to fall to."""
ROUNDING_STEPS = {"files": 10, "code": 500, **dict.fromkeys(PARTS, 100)}
ROUNDING_STEPS |= {
    "C core": 100,
    "C rigs": 100,
    "C parts": 100,
    "changelog": 100,
    "architecture": 100,
}
"""What changes with every commit is recorded rounded up to these."""

Graph = dict[str, set[str]]


def count_metrics() -> dict[str, int]:
    """Return every number of the house as it stands."""
    files = {
        _module_name(path, source): path
        for source in PARTS.values()
        for path in source.rglob("*.py")
    }
    texts = {name: path.read_text("utf-8") for name, path in files.items()}
    trees = {name: ast.parse(text) for name, text in texts.items()}
    modules = find_imports(trees)
    packages = {name for name, path in files.items() if path.name == "__init__.py"}
    folders = _merge(modules, lambda name: name if name in packages else name.rpartition(".")[0])
    rooms = _merge(modules, lambda name: ".".join(name.split(".")[:2]))
    return {
        "rooms": len(rooms),
        "pairs": sum(map(len, rooms.values())),
        "module circles": len(find_cycles(modules)),
        "folder circles": len(find_cycles(folders)),
        "wrong way": count_upward_imports(find_imports(trees, include_top_packages=True)),
        "kind tests": sum(map(_count_kind_tests, trees.values())),
        "several": sum(text.count(".several") for text in texts.values()),
        **measure_walks(),
        "files": len(texts),
        "code": sum(_count_code_lines(text, trees[name]) for name, text in texts.items()),
        **{
            part: sum(
                len(texts[name].splitlines())
                for name, path in files.items()
                if path.is_relative_to(source)
            )
            for part, source in PARTS.items()
        },
        "C core": _count_c_lines(ROOT / "core"),
        "C rigs": _count_c_lines(ROOT / "plant", ROOT / "firmware"),
        "C parts": _count_c_lines(*PARTS.values()),
        "changelog": len((ROOT / "CHANGELOG.md").read_text("utf-8").split()),
        "architecture": len(TABLE.sub("", PAGE.read_text("utf-8")).split()),
    }


def measure_walks() -> dict[str, int]:
    """Return files and returns of both ways, measured in a process of its own: what is made once counts."""
    command = [sys.executable, "-m", "tools.walks"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    measured: dict[str, dict[str, int]] = json.loads(done.stdout)
    return {f"{way}, {what}": n for way, each in measured.items() for what, n in each.items()}


def find_imports(trees: Mapping[str, ast.Module], *, include_top_packages: bool = False) -> Graph:
    """Return which modules each one imports, wherever the import stands; of the tops if asked for."""
    return {
        name: {
            one
            for one in _find_targets(tree, trees)
            if one != name and (include_top_packages or "." in one)
        }
        for name, tree in trees.items()
        if include_top_packages or "." in name
    }


def count_upward_imports(graph: Graph) -> int:
    """Return how many imports lead from a part into one that needs it."""
    rank = {part.replace("-", "_"): at for at, part in enumerate(PARTS)}
    return sum(
        rank[target.split(".")[0]] > rank[name.split(".")[0]]
        for name, targets in graph.items()
        for target in targets
    )


def find_cycles(graph: Graph) -> list[set[str]]:
    """Return the groups of names that lead to each other."""
    reachable = {name: _find_reachable(graph, name) for name in graph}
    groups = {
        frozenset(other for other in reachable[name] if name in reachable[other]) for name in graph
    }
    return [set(group) for group in groups if len(group) > 1]


def round_up(metrics: Mapping[str, int]) -> dict[str, int]:
    """Return the numbers as the record and the page give them: rounded up where they flicker."""
    return {
        name: -(-value // ROUNDING_STEPS.get(name, 1)) * ROUNDING_STEPS.get(name, 1)
        for name, value in metrics.items()
    }


def format_table(metrics: Mapping[str, int]) -> str:
    """Return the rows of ARCHITECTURE.md."""
    rows = "\n".join(
        f"| {DESCRIPTIONS[name]} | {value:,} | {f'{BUDGETS[name]:,}' if name in BUDGETS else ''} |"
        for name, value in round_up(metrics).items()
    )
    return f"| | record | budget |\n| --- | --- | --- |\n{rows}\n"


def main() -> int:
    """Count, print, let the record fall, bring the page up to date; 1 where a number rose."""
    metrics = count_metrics()
    limits: dict[str, int] = json.loads(RECORD.read_text("utf-8"))
    rounded = round_up(metrics)
    for name, value in metrics.items():
        rise = f"   rose: the record is {limits[name]:,}" if rounded[name] > limits[name] else ""
        excess = f"   budget {BUDGETS[name]:,}" if value > BUDGETS.get(name, value) else ""
        print(f"{DESCRIPTIONS[name]:78}{value:8,}{excess}{rise}")
    limits = {name: min(value, limits[name]) for name, value in rounded.items()}
    RECORD.write_text(json.dumps(limits, indent=2) + "\n", "utf-8")
    PAGE.write_text(
        TABLE.sub(rf"\g<1>{format_table(metrics)}\g<2>", PAGE.read_text("utf-8")), "utf-8"
    )
    return int(limits != rounded)


def _module_name(path: Path, source: Path) -> str:
    parts = path.relative_to(source).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def _find_targets(tree: ast.Module, known: Iterable[str]) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in known)
        elif isinstance(node, ast.ImportFrom) and node.module and node.module in known:
            for alias in node.names:
                full = f"{node.module}.{alias.name}"
                yield full if full in known else node.module


def _merge(graph: Graph, group_of: Callable[[str], str]) -> Graph:
    merged: Graph = {}
    for name, targets in graph.items():
        merged.setdefault(group_of(name), set()).update(
            {group_of(one) for one in targets} - {group_of(name)}
        )
    return merged


def _find_reachable(graph: Graph, start: str) -> set[str]:
    visited, waiting = {start}, [start]
    while waiting:
        unvisited = graph.get(waiting.pop(), set()) - visited
        visited |= unvisited
        waiting += unvisited
    return visited


_CLASSES_OF_ONE_KIND = {
    *("LevitationTable", "TrackingTable", "ForceTable", "DisplacementTable"),
    *("Rig", "PiezoRig", "BearingBench", "StageBench", "ForceBench", "PiezoBench"),
    *("PreparedBearing", "PreparedStage", "PreparedForce", "PreparedPiezo"),
}
"""Classes that belong to one kind of rig."""


_KIND_WORDS = {"'levitation'", "'tracking'"}
"""Words of rig files that no other table uses for its kind."""
_KIND_ATTRIBUTE = re.compile(r"(control|settings|file)\.kind(\.word)?$")


def _count_kind_tests(tree: ast.Module) -> int:
    """Return how often a module asks which kind a rig is: by its word, its record or a class."""
    count = 0
    for node in ast.walk(tree):
        if isinstance(node, ast.Compare):
            sides = {ast.unparse(side) for side in (node.left, *node.comparators)}
            count += bool(sides & _KIND_WORDS) or any(map(_KIND_ATTRIBUTE.search, sides))
        elif isinstance(node, ast.ImportFrom) and (node.module or "").startswith(
            "anhyst_rigs.kinds."
        ):
            count += any(alias.name != "RigKind" for alias in node.names)
        elif isinstance(node, ast.Call) and ast.unparse(node.func) == "isinstance":
            names = {one.id for one in ast.walk(node.args[1]) if isinstance(one, ast.Name)}
            count += bool(names & _CLASSES_OF_ONE_KIND)
    return count


def _count_code_lines(text: str, tree: ast.Module) -> int:
    """Return how many lines hold code that does something."""
    numbered = enumerate(text.splitlines(), 1)
    lines = {number for number, line in numbered if line.strip()[:1] not in {"", "#"}}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import | ast.ImportFrom) or (
            isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        ):
            lines -= set(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    return len(lines)


def _count_c_lines(*places: Path) -> int:
    """Return the lines of C and C++ in folders, without the standard's own headers for FMUs."""
    sources = (
        path for place in places for path in place.rglob("*") if path.suffix in {".c", ".h", ".cpp"}
    )
    project_files = (path for path in sources if path.parent.name != "fmi")
    return sum(len(path.read_text("utf-8").splitlines()) for path in project_files)


if __name__ == "__main__":
    sys.exit(main())
