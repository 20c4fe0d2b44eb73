"""What holds the parts together: who may import whom, and no file that grew too long."""

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


def test_imports_go_one_way() -> None:
    tool = Path(sys.executable).with_name("lint-imports")
    done = subprocess.run(
        [tool, "--no-cache"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout


@pytest.mark.parametrize("folder", ["packages", "core", "tests", "examples", "benchmarks", "tools"])
def test_no_file_is_longer_than_600_lines(folder: str) -> None:
    sources = [
        path
        for path in (ROOT / folder).rglob("*")
        if path.suffix in {".py", ".pyi", ".c", ".h", ".cpp", ".j2", ".js", ".css", ".html"}
        and path.parent.name not in {"uplot", "fmi"}  # taken over as they are
    ]
    lengths = {path: len(path.read_text(encoding="utf-8").splitlines()) for path in sources}
    assert lengths
    assert {path.name: lines for path, lines in lengths.items() if lines > 600} == {}


def test_every_c_source_is_in_the_one_list() -> None:
    listed = (ROOT / "core" / "core.cmake").read_text(encoding="utf-8")
    missing = [
        path.name for path in (ROOT / "core" / "src").rglob("*.c") if path.name not in listed
    ]
    assert missing == []


def _tests_imported(tree: ast.Module) -> Iterator[str]:
    """Give the names of modules that a test imports, those inside of packages included."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


def test_tests_of_a_part_use_only_that_part_and_those_it_needs() -> None:
    parts = ["anhyst", "anhyst-rigs", "anhyst-exchange"]
    folders = {part: ROOT / "packages" / part / "tests" for part in parts}
    rank = {part.replace("-", "_"): at for at, part in enumerate(parts)}
    for at, folder in enumerate(folders.values()):
        for path in folder.rglob("*.py"):
            rank[f"tests.{'.'.join(path.relative_to(folder).with_suffix('').parts)}"] = at
    found = []
    for at, folder in enumerate(folders.values()):
        for path in folder.rglob("*.py"):
            for name in _tests_imported(ast.parse(path.read_text(encoding="utf-8"))):
                known = name if name in rank else name.split(".")[0]
                if rank.get(known, 0) > at:
                    found.append(f"{path.relative_to(ROOT)}: {name}")
    assert found == []


def test_no_public_class_name_stands_in_two_modules() -> None:
    places: dict[str, list[str]] = defaultdict(list)
    for path in (ROOT / "packages").glob("*/src/**/*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                places[node.name].append(str(path.relative_to(ROOT)))
    assert places
    assert {name: found for name, found in places.items() if len(found) > 1} == {}


def test_the_page_loads_nothing_from_elsewhere() -> None:
    assets = ROOT / "packages" / "anhyst-rigs" / "src" / "anhyst_rigs" / "dashboard" / "assets"
    own = [path for path in assets.iterdir() if path.suffix in {".js", ".css", ".html"}]
    assert own
    assert [path.name for path in own if "//" in _without_comments(path)] == []
    assert (assets / "uplot" / "LICENSE").is_file()


def _without_comments(path: Path) -> str:
    """Return a source without its comments, and without the address made of the page's own."""
    lines = path.read_text(encoding="utf-8").splitlines()
    text = "\n".join(line for line in lines if not line.lstrip().startswith("//"))
    return re.sub(r"\s// .*|\$\{scheme\}://\$\{location\.host\}", "", text)
