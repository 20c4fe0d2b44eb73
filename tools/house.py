"""Measure the structure of the project: ``make house``.

The command counts subsystems, imports between them, import cycles and lines. A *room* is a folder
at the top of a part (a Python package). Two rooms are a pair if one imports the other. A *cycle* is
a group of modules, or of folders, that import each other directly or indirectly. Imports inside
functions and imports for type checkers count. Imports in the ``__init__.py`` at the top of a part
do not count, because they run only when a name is used. ``house.json`` contains a limit for each
number. The command only lowers these limits. ARCHITECTURE.md prints the numbers next to their
budgets.
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
"""The folder with the sources of each part."""
RECORD = ROOT / "tools" / "house.json"
PAGE = ROOT / "ARCHITECTURE.md"
TABLE = re.compile(r"(<!-- made by make house -->\n).*?(<!-- end -->\n)", re.DOTALL)

DESCRIPTIONS = {
    "rooms": "subsystems at the top of the Python packages",
    "pairs": "pairs of subsystems of which one imports the other",
    "module circles": "import cycles of modules",
    "folder circles": "import cycles of folders",
    "wrong way": "imports from a part into a part that depends on it",
    "kind tests": "tests of a rig's kind outside its record",
    "several": "tests whether a stage has several coordinates (`.several`)",
    "model to C, files": "files that process a model on its way to C",
    "model to C, returns": "number of times that this chain returns to an earlier file",
    "rig to recording, files": "files that process a rig file on its way to a recording",
    "rig to recording, returns": "number of times that this chain returns to an earlier file",
    "files": "Python files in the parts",
    "code": "lines of Python code (without docstrings, comments, imports and blank lines)",
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
"""Targets of the metrics."""
ROUNDING_STEPS = {"files": 10, "code": 500, **dict.fromkeys(PARTS, 100)}
ROUNDING_STEPS |= {"C core": 100, "C rigs": 100, "C parts": 100, "changelog": 100, "architecture": 100}
"""Metrics that change with every commit are recorded as multiples of these steps, rounded up."""

ImportGraph = dict[str, set[str]]


def count_metrics() -> dict[str, int]:
    """Return every metric of the source tree."""
    files = {_module_name(path, source): path for source in PARTS.values() for path in source.rglob("*.py")}
    texts = {name: path.read_text("utf-8") for name, path in files.items()}
    trees = {name: ast.parse(text) for name, text in texts.items()}
    modules = find_imports(trees)
    packages = {name for name, path in files.items() if path.name == "__init__.py"}
    folders = _merge_groups(modules, lambda name: name if name in packages else name.rpartition(".")[0])
    rooms = _merge_groups(modules, lambda name: ".".join(name.split(".")[:2]))
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
                len(texts[name].splitlines()) for name, path in files.items() if path.is_relative_to(source)
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
    """Return the files and the returns of both walks.

    They are measured in a separate process, so that nothing is cached from an earlier run.
    """
    command = [sys.executable, "-m", "tools.walks"]
    completed = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True)
    measured_walks: dict[str, dict[str, int]] = json.loads(completed.stdout)
    return {
        f"{walk_name}, {quantity}": count
        for walk_name, counts_by_quantity in measured_walks.items()
        for quantity, count in counts_by_quantity.items()
    }


def find_imports(trees: Mapping[str, ast.Module], *, include_top_packages: bool = False) -> ImportGraph:
    """Return the modules that each module imports, with or without the top packages."""
    return {
        name: {
            imported_module
            for imported_module in _find_imported_modules(tree, trees)
            if imported_module != name and (include_top_packages or "." in imported_module)
        }
        for name, tree in trees.items()
        if include_top_packages or "." in name
    }


def count_upward_imports(graph: ImportGraph) -> int:
    """Return the number of imports from a part into a part that depends on it."""
    rank = {part.replace("-", "_"): part_index for part_index, part in enumerate(PARTS)}
    return sum(
        rank[target.split(".")[0]] > rank[name.split(".")[0]]
        for name, targets in graph.items()
        for target in targets
    )


def find_cycles(graph: ImportGraph) -> list[set[str]]:
    """Return the groups of names that reach each other in the graph of imports."""
    reachable = {name: _find_reachable(graph, name) for name in graph}
    groups = {
        frozenset(other_name for other_name in reachable[name] if name in reachable[other_name])
        for name in graph
    }
    return [set(group) for group in groups if len(group) > 1]


def round_up(metrics: Mapping[str, int]) -> dict[str, int]:
    """Return the metrics rounded up to the steps of the record and of the page."""
    return {
        name: -(-value // ROUNDING_STEPS.get(name, 1)) * ROUNDING_STEPS.get(name, 1)
        for name, value in metrics.items()
    }


def format_table(metrics: Mapping[str, int]) -> str:
    """Return the table of ARCHITECTURE.md."""
    rows = "\n".join(
        f"| {DESCRIPTIONS[name]} | {value:,} | {f'{BUDGETS[name]:,}' if name in BUDGETS else ''} |"
        for name, value in round_up(metrics).items()
    )
    return f"| | record | budget |\n| --- | --- | --- |\n{rows}\n"


def main() -> int:
    """Print the metrics, lower the limits and update the page; return 1 if a limit is exceeded."""
    metrics = count_metrics()
    limits: dict[str, int] = json.loads(RECORD.read_text("utf-8"))
    rounded_metrics = round_up(metrics)
    for name, value in metrics.items():
        increase = f"   exceeds the limit {limits[name]:,}" if rounded_metrics[name] > limits[name] else ""
        excess = f"   budget {BUDGETS[name]:,}" if value > BUDGETS.get(name, value) else ""
        print(f"{DESCRIPTIONS[name]:78}{value:8,}{excess}{increase}")
    limits = {name: min(value, limits[name]) for name, value in rounded_metrics.items()}
    RECORD.write_text(json.dumps(limits, indent=2) + "\n", "utf-8")
    PAGE.write_text(TABLE.sub(rf"\g<1>{format_table(metrics)}\g<2>", PAGE.read_text("utf-8")), "utf-8")
    return int(limits != rounded_metrics)


def _module_name(path: Path, source: Path) -> str:
    parts = path.relative_to(source).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def _find_imported_modules(tree: ast.Module, project_modules: Iterable[str]) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names if alias.name in project_modules)
        elif isinstance(node, ast.ImportFrom) and node.module and node.module in project_modules:
            for alias in node.names:
                full_name = f"{node.module}.{alias.name}"
                yield full_name if full_name in project_modules else node.module


def _merge_groups(graph: ImportGraph, group_of: Callable[[str], str]) -> ImportGraph:
    merged_graph: ImportGraph = {}
    for name, targets in graph.items():
        merged_graph.setdefault(group_of(name), set()).update(
            {group_of(name_of_member) for name_of_member in targets} - {group_of(name)}
        )
    return merged_graph


def _find_reachable(graph: ImportGraph, start: str) -> set[str]:
    visited_names, pending_names = {start}, [start]
    while pending_names:
        unvisited_names = graph.get(pending_names.pop(), set()) - visited_names
        visited_names |= unvisited_names
        pending_names += unvisited_names
    return visited_names


_CLASSES_OF_ONE_KIND = {
    *("LevitationTable", "TrackingTable", "ForceTable", "DisplacementTable"),
    *("Rig", "PiezoRig", "BearingBench", "StageBench", "ForceBench", "PiezoBench"),
    *("PreparedBearing", "PreparedStage", "PreparedForce", "PreparedPiezo"),
}
"""Classes that belong to a single kind of rig."""


_KIND_WORDS = {"'levitation'", "'tracking'"}
"""Values of `control.kind` that no other table of a rig file uses."""
_KIND_ATTRIBUTE = re.compile(r"(control|settings|file)\.kind(\.word)?$")


def _count_kind_tests(tree: ast.Module) -> int:
    """Return how often a module tests the kind of a rig: its word, its record or its class."""
    count = 0
    for node in ast.walk(tree):
        if isinstance(node, ast.Compare):
            sides = {ast.unparse(side) for side in (node.left, *node.comparators)}
            count += bool(sides & _KIND_WORDS) or any(map(_KIND_ATTRIBUTE.search, sides))
        elif isinstance(node, ast.ImportFrom) and (node.module or "").startswith("anhyst_rigs.kinds."):
            count += any(alias.name != "RigKind" for alias in node.names)
        elif isinstance(node, ast.Call) and ast.unparse(node.func) == "isinstance":
            names = {
                class_node.id for class_node in ast.walk(node.args[1]) if isinstance(class_node, ast.Name)
            }
            count += bool(names & _CLASSES_OF_ONE_KIND)
    return count


def _count_code_lines(text: str, tree: ast.Module) -> int:
    """Return the number of lines that contain executable code."""
    numbered_lines = enumerate(text.splitlines(), 1)
    lines = {number for number, line in numbered_lines if line.strip()[:1] not in {"", "#"}}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import | ast.ImportFrom) or (
            isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
        ):
            lines -= set(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    return len(lines)


def _count_c_lines(*folders: Path) -> int:
    """Return the number of lines of C and C++ in folders, without the headers of the FMI standard."""
    sources = (
        path for folder in folders for path in folder.rglob("*") if path.suffix in {".c", ".h", ".cpp"}
    )
    project_files = (path for path in sources if path.parent.name != "fmi")
    return sum(len(path.read_text("utf-8").splitlines()) for path in project_files)


if __name__ == "__main__":
    sys.exit(main())
