"""Test imports between parts, lengths of files, and the references in ARCHITECTURE.md."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.repository import ROOT
from tools import house


def test_imports_follow_the_layers() -> None:
    tool = Path(sys.executable).with_name("lint-imports")
    completed = subprocess.run([tool, "--no-cache"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert completed.returncode == 0, completed.stdout


@pytest.mark.parametrize("folder", ["packages", "core", "tests", "examples", "benchmarks", "tools"])
def test_no_file_is_longer_than_600_lines(folder: str) -> None:
    sources = [
        path
        for path in (ROOT / folder).rglob("*")
        if path.suffix in {".py", ".pyi", ".c", ".h", ".cpp", ".j2", ".js", ".css", ".html"}
        and path.parent.name not in {"uplot", "fmi"}  # third-party files
    ]
    lengths = {path: len(path.read_text(encoding="utf-8").splitlines()) for path in sources}
    assert lengths
    assert {path.name: lines for path, lines in lengths.items() if lines > 600} == {}


def test_every_c_source_is_in_the_one_list() -> None:
    listed_sources = (ROOT / "core" / "core.cmake").read_text(encoding="utf-8")
    missing_sources = [
        path.name for path in (ROOT / "core" / "src").rglob("*.c") if path.name not in listed_sources
    ]
    assert missing_sources == []


def _imported_modules(tree: ast.Module) -> Iterator[str]:
    """Yield the names of modules that a test imports, including names imported from packages."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def test_tests_of_a_package_use_only_it_and_its_dependencies() -> None:
    parts = ["anhyst", "anhyst-rigs", "anhyst-exchange"]
    folders = {part: ROOT / "packages" / part / "tests" for part in parts}
    rank = {part.replace("-", "_"): package_index for package_index, part in enumerate(parts)}
    for at, folder in enumerate(folders.values()):
        for path in folder.rglob("*.py"):
            rank[f"tests.{'.'.join(path.relative_to(folder).with_suffix('').parts)}"] = at
    found = []
    for at, folder in enumerate(folders.values()):
        for path in folder.rglob("*.py"):
            for name in _imported_modules(ast.parse(path.read_text(encoding="utf-8"))):
                module_name = name if name in rank else name.split(".")[0]
                if rank.get(module_name, 0) > at:
                    found.append(f"{path.relative_to(ROOT)}: {name}")
    assert found == []


def test_public_class_names_are_unique() -> None:
    files_by_class: dict[str, list[str]] = defaultdict(list)
    for path in (ROOT / "packages").glob("*/src/**/*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                files_by_class[node.name].append(str(path.relative_to(ROOT)))
    assert files_by_class
    assert {name: files for name, files in files_by_class.items() if len(files) > 1} == {}


def test_the_page_loads_nothing_from_elsewhere() -> None:
    assets = ROOT / "packages" / "anhyst-rigs" / "src" / "anhyst_rigs" / "dashboard" / "assets"
    own_assets = [path for path in assets.iterdir() if path.suffix in {".js", ".css", ".html"}]
    assert own_assets
    assert [path.name for path in own_assets if "//" in _remove_comments(path)] == []
    assert (assets / "uplot" / "LICENSE").is_file()


def _remove_comments(path: Path) -> str:
    """Return a source without comments, and without an address that is built from the page's."""
    lines = path.read_text(encoding="utf-8").splitlines()
    text = "\n".join(line for line in lines if not line.lstrip().startswith("//"))
    return re.sub(r"\s// .*|\$\{scheme\}://\$\{location\.host\}", "", text)


PAGE = house.PAGE.read_text(encoding="utf-8")
_QUOTED = re.compile(r"`([^`\n]+)`")


def _matching_files(name: str) -> list[Path]:
    """Return the files that a name on the page matches; `{a,b}` lists alternatives, `*` is any."""
    prefix, opening_brace, remaining_text = name.partition("{")
    if opening_brace:
        alternatives_text, _, suffix = remaining_text.partition("}")
        alternatives = [
            _matching_files(f"{prefix}{alternative}{suffix}") for alternative in alternatives_text.split(",")
        ]
        return [path for paths in alternatives for path in paths] if all(alternatives) else []
    return [*ROOT.glob(name), *ROOT.glob(f"packages/*/src/{name}")]


def _table_rows(heading: str) -> list[list[str]]:
    """Return the cells of all table rows of a section, without the table heads."""
    section = PAGE.split(f"\n## {heading}\n")[1].split("\n## ")[0]
    tables = re.findall(r"^\| --- .*\n((?:\|.*\n?)+)", section, re.M)
    lines = [line for table in tables for line in table.splitlines()]
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def _is_defined(symbol: str, path: Path) -> bool:
    """Whether a file defines a symbol; if it is not a Python file, whether it contains it."""
    text, name = path.read_text(encoding="utf-8"), re.escape(symbol)
    if path.suffix == ".py":
        return bool(re.search(rf"^((def|class) {name}\b|{name}(: .*)? = )", text, re.M))
    return bool(re.search(rf"\b{name}\b", text))


def _missing_references(cell: str) -> list[str]:
    """Return the files of a cell that do not exist, and symbols that the preceding file lacks."""
    missing_names, path = [], None
    for name in _QUOTED.findall(cell):
        if " " in name:  # a command
            continue
        if "/" in name:
            path = next(iter(_matching_files(name)), None)
            missing_names += [] if path else [name]
        elif path and path.is_file() and not _is_defined(name, path):
            missing_names.append(f"{path.relative_to(ROOT)}: {name}")
    return missing_names


TASKS = _table_rows("Where do I ...?")


@pytest.mark.parametrize("row", TASKS, ids=[row[0] for row in TASKS])
def test_each_task_of_the_page_names_files_and_symbols_that_exist(row: list[str]) -> None:
    _, change, test = row
    assert _missing_references(change) == []
    assert _missing_references(test) == []


def test_a_file_or_symbol_that_does_not_exist_is_found() -> None:
    cell = "`anhyst/laws/law.py` `Law`, `NoLaw`; `core/src/no.c`, `make x`, `core/{core,no}.cmake`"
    assert _missing_references(cell) == [
        "packages/anhyst/src/anhyst/laws/law.py: NoLaw",
        "core/src/no.c",
        "core/{core,no}.cmake",
    ]


def test_every_room_of_the_page_begins_with_a_file_that_exists() -> None:
    rows = _table_rows("Subsystems")
    assert len(rows) > 15
    names = [
        f"*/{_QUOTED.findall(room)[0]}/{file_name}"
        for room, _, files in rows
        for file_name in _QUOTED.findall(files)
    ]
    assert [name for name in names if not _matching_files(name)] == []


def test_every_path_of_the_page_exists() -> None:
    rooms = PAGE.split("\n## Subsystems\n")[1].split("\n## ")[0]
    named_paths = [name for name in _QUOTED.findall(PAGE.replace(rooms, "")) if "/" in name]
    paths = [name for name in named_paths if " " not in name]
    assert len(paths) > 80
    assert [name for name in paths if not _matching_files(name)] == []


def test_the_page_stays_short() -> None:
    text = house.TABLE.sub("", PAGE)
    assert len(text.splitlines()) <= 200
    assert len(text.split()) <= house.BUDGETS["architecture"]
    assert len(TASKS) >= 15
