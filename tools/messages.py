"""Collect the texts of all errors in tests/messages.toml: ``make messages``.

The command reads the sources. Each call with a code, such as ``InputError(text,
code="no-such-file")``, creates an error. Its text is recorded with placeholders for the values:
``{path}: no such file``.
"""

from __future__ import annotations

import ast
import itertools
import json
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
MESSAGES_FILE = ROOT / "tests" / "messages.toml"
FILE_HEADER = """\
# What the errors of the package say, by their codes; {holes} are filled in when they are raised.
# Made from the sources by make messages.
"""
ERROR_CLASSES = {"InputError", "NegativeResult", "FileFault", "Advice", "Problem"}
CALLS_WITH_KEY_FIRST = {"FileFault", "Problem", "add", "wrong_key"}
"""Calls whose second argument is the text; the first one is a key."""
PLACEHOLDER = "{...}"
MAX_WORDINGS_OF_PART = 3
"""Maximum number of wordings of a part of a text; a part with more becomes a placeholder."""
MAX_DEPTH = 4
"""Maximum number of variables and functions that are followed in a chain."""

Function = ast.FunctionDef | ast.AsyncFunctionDef


@dataclass(frozen=True)
class ErrorCall:
    """A call that creates an error.

    Parameters
    ----------
    location : str
        File and line.
    code : str
        Code of the error; empty if the call passes on the code of another error.
    has_code : bool
        Whether the call has an argument for the code.
    wordings : tuple of str
        Possible texts of the error.
    """

    location: str
    code: str
    has_code: bool
    wordings: tuple[str, ...]


class Module:
    """The syntax tree of a source file.

    Parameters
    ----------
    path : Path
        The source file.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.tree = ast.parse(path.read_text(encoding="utf-8"))
        self.parents = {child: node for node in ast.walk(self.tree) for child in ast.iter_child_nodes(node)}

    def _enclosing_nodes(self, node: ast.AST) -> Iterator[ast.AST]:
        while (node := self.parents.get(node, self.tree)) is not self.tree:
            yield node

    def find_assignments(self, usage: ast.expr, name: str) -> list[list[ast.expr]]:
        """Return the possible values of a variable at a place: each is a text and its additions.

        The search goes back to the last assignment that no branch avoids.
        """
        enclosing_nodes = list(self._enclosing_nodes(usage))
        function = next((node for node in enclosing_nodes if isinstance(node, Function)), None)
        assignments: list[list[ast.expr]] = []
        additions: list[ast.AugAssign] = []
        for statement in sorted(_find_earlier_assignments(function, usage), key=lambda node: -node.lineno):
            match statement:
                case ast.AugAssign(target=ast.Name(id=target)) if target == name:
                    additions.insert(0, statement)
                case (
                    ast.Assign(targets=[ast.Name(id=target)], value=value)
                    | ast.NamedExpr(target=ast.Name(id=target), value=value)
                ) if target == name:
                    assignments.append([value, *(addition.value for addition in additions)])
                    if isinstance(statement, ast.NamedExpr) or self.parents[statement] in enclosing_nodes:
                        break
                    additions = [more for more in additions if self.parents[more] != self.parents[statement]]
                case ast.Assign(targets=[ast.Tuple(elts=elements)]) if name in {
                    getattr(element, "id", "") for element in elements
                }:
                    break
        return assignments

    @cached_property
    def functions(self) -> Mapping[str, Function]:
        """Functions and methods by name, without names that are defined twice."""
        found: dict[str, list[Function]] = defaultdict(list)
        for node in ast.walk(self.tree):
            if isinstance(node, Function):
                found[node.name].append(node)
        return {name: nodes[0] for name, nodes in found.items() if len(nodes) == 1}

    @cached_property
    def constants(self) -> Mapping[str, ast.expr]:
        """Module constants that are texts."""
        return {
            target.id: node.value
            for node in self.tree.body
            if isinstance(node, ast.Assign)
            for target in node.targets
            if isinstance(target, ast.Name) and _is_text(node.value)
        }


class WordingReader:
    """Finds the possible texts of expressions of one module."""

    def __init__(self, module: Module, modules_by_function: Mapping[str, Module]) -> None:
        self.module = module
        self.package = modules_by_function

    def find_wordings(self, node: ast.expr, depth: int = 0) -> list[str]:
        """Return the possible texts of an expression."""
        next_depth = depth + 1
        found: list[str] = []
        match node:
            case _ if depth > MAX_DEPTH:
                pass
            case ast.Constant(value=str(text)):
                found = [text.replace("{", "(").replace("}", ")")]
            case ast.JoinedStr(values=values):
                found = _combine(self.find_wordings(value, depth) for value in values)
            case ast.FormattedValue(value=value, format_spec=None, conversion=-1):
                found = self.find_wordings(value, next_depth)
            case ast.FormattedValue(value=value):
                found = [_placeholder_of(value)]
            case ast.BinOp(left=left, op=ast.Add(), right=right):
                found = _combine((self.find_wordings(left, depth), self.find_wordings(right, depth)))
            case ast.IfExp(body=body, orelse=orelse):
                found = [*self.find_wordings(body, depth), *self.find_wordings(orelse, depth)]
            case ast.Name(id=name):
                found = self._find_wordings_of_variable(node, name, next_depth)
            case ast.Call(func=ast.Attribute(value=value, attr="rstrip" | "removesuffix")):
                found = self.find_wordings(value, depth)
            case ast.Call(func=ast.Name(id=name) | ast.Attribute(attr=name)):
                found = self._find_returned_wordings(name, next_depth)
        return found or [_placeholder_of(node)]

    def _find_wordings_of_variable(self, node: ast.expr, name: str, depth: int) -> list[str]:
        """Return the possible texts of a variable; none if it is also assigned something else."""
        texts: list[str] = []
        for text_parts in self.module.find_assignments(node, name):
            if not (_is_text(text_parts[0]) or isinstance(text_parts[0], ast.Call)):
                return []
            texts += _combine(self.find_wordings(text_part, depth) for text_part in text_parts)
        if not texts and name in self.module.constants:
            return self.find_wordings(self.module.constants[name], depth)
        return texts if any(text not in {PLACEHOLDER, ""} for text in texts) else []

    def _find_returned_wordings(self, name: str, depth: int) -> list[str]:
        """Return the texts that a function returns.

        The function belongs to this module, or it is the only one of this name in the project.
        """
        module = self.module
        if name not in module.functions:
            if name not in self.package:
                return []
            module = self.package[name]
        reader = WordingReader(module, self.package)
        returned_values = [
            node.value
            for node in ast.walk(module.functions[name])
            if isinstance(node, ast.Return) and node.value is not None
        ]
        return [
            text
            for value in returned_values
            if not (isinstance(value, ast.Constant) and value.value is None)
            for text in reader.find_wordings(value, depth)
        ]


def find_error_calls() -> Iterator[ErrorCall]:
    """Yield every call of the packages that creates an error."""
    modules = [Module(path) for path in sorted((ROOT / "packages").glob("*/src/**/*.py"))]
    defining_modules: dict[str, list[Module]] = defaultdict(list)
    for module in modules:
        for name in module.functions:
            defining_modules[name].append(module)
    modules_by_function = {name: found[0] for name, found in defining_modules.items() if len(found) == 1}
    for module in modules:
        reader = WordingReader(module, modules_by_function)
        for node in ast.walk(module.tree):
            if (
                isinstance(node, ast.Call)
                and (error_call := _read_error_call(node, module, reader)) is not None
            ):
                yield error_call


def _read_error_call(call: ast.Call, module: Module, reader: WordingReader) -> ErrorCall | None:
    name = getattr(call.func, "id", getattr(call.func, "attr", ""))
    location = f"{module.path.relative_to(ROOT)}:{call.lineno}"
    if name == "PydanticCustomError":
        kind, text = call.args
        assert isinstance(kind, ast.Constant)
        return ErrorCall(
            location,
            str(kind.value).replace("_", "-"),
            True,
            tuple(wording.replace("Input should", "must", 1) for wording in reader.find_wordings(text)),
        )
    code_argument = next((keyword.value for keyword in call.keywords if keyword.arg == "code"), None)
    code = code_argument.value if isinstance(code_argument, ast.Constant) else None
    if not call.args or (name not in ERROR_CLASSES and not isinstance(code, str)):
        return None
    text_index = 1 if name in CALLS_WITH_KEY_FIRST else 0
    has_code = code_argument is not None or len(call.args) > text_index + 1
    texts = reader.find_wordings(call.args[text_index])
    if name == "wrong_key":  # it puts the key in front
        texts = _combine((reader.find_wordings(call.args[0]), [": "], texts))
    return ErrorCall(location, str(code or ""), has_code, tuple(filter(None, texts)))


def format_messages(error_calls: Iterable[ErrorCall]) -> str:
    """Return the contents of the messages file."""
    wordings: dict[str, set[str]] = defaultdict(set)
    for error_call in error_calls:
        if error_call.code:
            wordings[error_call.code].update(error_call.wordings)
    lines = [FILE_HEADER]
    for code in sorted(wordings):
        texts = sorted(json.dumps(text, ensure_ascii=False) for text in wordings[code])
        lines.append(f"{code} = [\n" + "".join(f"  {text},\n" for text in texts) + "]\n")
    return "".join(lines)


def _find_earlier_assignments(function: Function | None, usage: ast.expr) -> Iterator[ast.stmt | ast.expr]:
    for node in ast.walk(function) if function is not None else ():
        if isinstance(node, ast.Assign | ast.AugAssign | ast.NamedExpr) and node.lineno <= usage.lineno:
            yield node


def _is_text(node: ast.expr) -> bool:
    match node:
        case ast.Constant(value=str()) | ast.JoinedStr():
            return True
        case ast.BinOp(left=left, op=ast.Add()):
            return _is_text(left)
        case ast.IfExp(body=body, orelse=orelse):
            return _is_text(body) or _is_text(orelse)
    return False


def _placeholder_of(node: ast.expr) -> str:
    match node:
        case ast.Name(id=name) | ast.Attribute(attr=name):
            return f"{{{name.strip('_')}}}"
    return PLACEHOLDER


def _combine(wordings_by_part: Iterable[list[str]]) -> list[str]:
    limited_texts = [
        wordings if len(wordings) <= MAX_WORDINGS_OF_PART else [PLACEHOLDER] for wordings in wordings_by_part
    ]
    return ["".join(texts) for texts in itertools.product(*limited_texts)]


if __name__ == "__main__":
    MESSAGES_FILE.write_text(format_messages(find_error_calls()), encoding="utf-8")
