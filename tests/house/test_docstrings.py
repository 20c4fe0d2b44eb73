"""Test that only exported names have docstrings with sections."""

from __future__ import annotations

import ast
import inspect
import re
from collections.abc import Iterator
from typing import Any

import anhyst
import anhyst_exchange
import anhyst_rigs
from tests.repository import ROOT

PARTS = (anhyst, anhyst_rigs, anhyst_exchange)
SECTION = re.compile(r"^\s*-{3,}\s*$", re.MULTILINE)
Documented = ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef


def public_names(exported: Any) -> Iterator[tuple[str, str]]:
    """Yield module and qualified name of an export, and of the public members of a class."""
    if not inspect.isclass(exported):
        yield exported.__module__, exported.__qualname__
        return
    for qualified_name in exported.__mro__:
        yield qualified_name.__module__, qualified_name.__qualname__
        for member in vars(qualified_name):
            if not member.startswith("_") or member in {"__call__", "__init__"}:
                yield qualified_name.__module__, f"{qualified_name.__qualname__}.{member}"


def documented_names(tree: ast.AST, prefix: str = "") -> Iterator[tuple[str, Documented]]:
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, Documented):
            yield prefix + node.name, node
            yield from documented_names(node, f"{prefix}{node.name}.")
        else:
            yield from documented_names(node, prefix)


def test_only_exported_names_have_sections() -> None:
    exported = {
        name
        for part in PARTS
        for noun in part.__all__
        if not noun.startswith("_")
        for name in public_names(getattr(part, noun))
    }
    exported.add(("anhyst.cli.reading", "read_options"))  # help texts of options
    found = []
    for path in sorted((ROOT / "packages").glob("*/src/**/*.py")):
        parts = path.relative_to(ROOT / "packages").with_suffix("").parts[2:]
        module = ".".join(part for part in parts if part != "__init__")
        for name, node in documented_names(ast.parse(path.read_text(encoding="utf-8"))):
            if SECTION.search(ast.get_docstring(node) or "") and (module, name) not in exported:
                found.append(f"{module}:{name}")
    assert found == []


def test_every_exported_verb_documents_parameters_and_result() -> None:
    verbs = [getattr(part, name) for part in PARTS for name in part.__all__ if not name.startswith("_")]
    undocumented = [
        verb.__name__
        for verb in verbs
        if inspect.isfunction(verb) and "\nParameters\n---" not in (inspect.getdoc(verb) or "")
    ]
    assert undocumented == []
