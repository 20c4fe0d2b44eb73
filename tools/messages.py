"""Gather how every error of the package is worded into tests/messages.toml; ``make messages``.

A call that names a code, ``InputError(text, code="no-such-file")``, is an error or what one is made
of. Its text is taken from the source with holes where values go: ``{path}: no such file``.
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
GOLDEN = ROOT / "tests" / "messages.toml"
HEAD = """\
# What the errors of the package say, by their codes; {holes} are filled in when they are raised.
# Made from the sources by make messages.
"""
ERRORS = {"InputError", "NegativeResult", "FileFault", "Advice", "Problem"}
TEXT_SECOND = {"FileFault", "Problem", "add", "wrong_key"}
"""Calls whose text follows a key."""
HOLE = "{...}"
MOST = 3
"""Wordings of a part of a text; where there are more, it is a hole."""
DEEPEST = 4
"""Variables and functions that are followed from one to the next."""

Function = ast.FunctionDef | ast.AsyncFunctionDef


@dataclass(frozen=True)
class Site:
    """A call that says what is wrong.

    Parameters
    ----------
    place : str
        File and line.
    code : str
        Empty where it passes on that of another error.
    named : bool
        Whether it gives a code at all.
    wordings : tuple of str
    """

    place: str
    code: str
    named: bool
    wordings: tuple[str, ...]


class Module:
    """A source file.

    Parameters
    ----------
    path : Path
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.tree = ast.parse(path.read_text(encoding="utf-8"))
        self.parents = {
            child: node for node in ast.walk(self.tree) for child in ast.iter_child_nodes(node)
        }

    def _within(self, node: ast.AST) -> Iterator[ast.AST]:
        while (node := self.parents.get(node, self.tree)) is not self.tree:
            yield node

    def assigned(self, use: ast.expr, name: str) -> list[list[ast.expr]]:
        """Return what a variable may hold where it is used: each a text and what is added to it.

        These are the assignments before, back to the last one that no branch avoids.
        """
        around = list(self._within(use))
        function = next((node for node in around if isinstance(node, Function)), None)
        found: list[list[ast.expr]] = []
        added: list[ast.AugAssign] = []
        for one in sorted(_before(function, use), key=lambda node: -node.lineno):
            match one:
                case ast.AugAssign(target=ast.Name(id=target)) if target == name:
                    added.insert(0, one)
                case (
                    ast.Assign(targets=[ast.Name(id=target)], value=value)
                    | ast.NamedExpr(target=ast.Name(id=target), value=value)
                ) if target == name:
                    found.append([value, *(more.value for more in added)])
                    if isinstance(one, ast.NamedExpr) or self.parents[one] in around:
                        break
                    added = [more for more in added if self.parents[more] != self.parents[one]]
                case ast.Assign(targets=[ast.Tuple(elts=elements)]) if name in {
                    getattr(element, "id", "") for element in elements
                }:
                    break
        return found

    @cached_property
    def functions(self) -> Mapping[str, Function]:
        """Functions and methods by name; a name that is given twice is left out."""
        found: dict[str, list[Function]] = defaultdict(list)
        for node in ast.walk(self.tree):
            if isinstance(node, Function):
                found[node.name].append(node)
        return {name: nodes[0] for name, nodes in found.items() if len(nodes) == 1}

    @cached_property
    def constants(self) -> Mapping[str, ast.expr]:
        """Texts that a module names."""
        return {
            target.id: node.value
            for node in self.tree.body
            if isinstance(node, ast.Assign)
            for target in node.targets
            if isinstance(target, ast.Name) and _is_text(node.value)
        }


class Reader:
    """Reads wordings out of expressions of one module."""

    def __init__(self, module: Module, package: Mapping[str, Module]) -> None:
        self.module = module
        self.package = package

    def wordings(self, node: ast.expr, depth: int = 0) -> list[str]:
        """Return what an expression may say."""
        deeper = depth + 1
        found: list[str] = []
        match node:
            case _ if depth > DEEPEST:
                pass
            case ast.Constant(value=str(text)):
                found = [text.replace("{", "(").replace("}", ")")]
            case ast.JoinedStr(values=values):
                found = _product(self.wordings(value, depth) for value in values)
            case ast.FormattedValue(value=value, format_spec=None, conversion=-1):
                found = self.wordings(value, deeper)
            case ast.FormattedValue(value=value):
                found = [_hole(value)]
            case ast.BinOp(left=left, op=ast.Add(), right=right):
                found = _product((self.wordings(left, depth), self.wordings(right, depth)))
            case ast.IfExp(body=body, orelse=orelse):
                found = [*self.wordings(body, depth), *self.wordings(orelse, depth)]
            case ast.Name(id=name):
                found = self._name(node, name, deeper)
            case ast.Call(func=ast.Attribute(value=value, attr="rstrip" | "removesuffix")):
                found = self.wordings(value, depth)
            case ast.Call(func=ast.Name(id=name) | ast.Attribute(attr=name)):
                found = self._returned(name, deeper)
        return found or [_hole(node)]

    def _name(self, node: ast.expr, name: str, depth: int) -> list[str]:
        """Return what a variable holds, where the function around it assigns only texts."""
        texts: list[str] = []
        for parts in self.module.assigned(node, name):
            if not (_is_text(parts[0]) or isinstance(parts[0], ast.Call)):
                return []
            texts += _product(self.wordings(part, depth) for part in parts)
        if not texts and name in self.module.constants:
            return self.wordings(self.module.constants[name], depth)
        return texts if any(text not in {HOLE, ""} for text in texts) else []

    def _returned(self, name: str, depth: int) -> list[str]:
        """Return what a function of this module, or one of that name elsewhere, returns."""
        module = self.module
        if name not in module.functions:
            if name not in self.package:
                return []
            module = self.package[name]
        reader = Reader(module, self.package)
        returned = [
            node.value
            for node in ast.walk(module.functions[name])
            if isinstance(node, ast.Return) and node.value is not None
        ]
        return [
            text
            for value in returned
            if not (isinstance(value, ast.Constant) and value.value is None)
            for text in reader.wordings(value, depth)
        ]


def sites() -> Iterator[Site]:
    """Find every call of the package that makes an error."""
    modules = [Module(path) for path in sorted((ROOT / "packages").glob("*/src/**/*.py"))]
    owners: dict[str, list[Module]] = defaultdict(list)
    for module in modules:
        for name in module.functions:
            owners[name].append(module)
    package = {name: found[0] for name, found in owners.items() if len(found) == 1}
    for module in modules:
        reader = Reader(module, package)
        for node in ast.walk(module.tree):
            if isinstance(node, ast.Call) and (site := _site(node, module, reader)) is not None:
                yield site


def _site(call: ast.Call, module: Module, reader: Reader) -> Site | None:
    name = getattr(call.func, "id", getattr(call.func, "attr", ""))
    place = f"{module.path.relative_to(ROOT)}:{call.lineno}"
    if name == "PydanticCustomError":
        kind, text = call.args
        assert isinstance(kind, ast.Constant)
        return Site(
            place,
            str(kind.value).replace("_", "-"),
            True,
            tuple(one.replace("Input should", "must", 1) for one in reader.wordings(text)),
        )
    given = next((one.value for one in call.keywords if one.arg == "code"), None)
    code = given.value if isinstance(given, ast.Constant) else None
    if not call.args or (name not in ERRORS and not isinstance(code, str)):
        return None
    at = 1 if name in TEXT_SECOND else 0
    named = given is not None or len(call.args) > at + 1
    texts = reader.wordings(call.args[at])
    if name == "wrong_key":  # it puts the key in front
        texts = _product((reader.wordings(call.args[0]), [": "], texts))
    return Site(place, str(code or ""), named, tuple(filter(None, texts)))


def golden(found: Iterable[Site]) -> str:
    """Return the text of the file."""
    wordings: dict[str, set[str]] = defaultdict(set)
    for site in found:
        if site.code:
            wordings[site.code].update(site.wordings)
    lines = [HEAD]
    for code in sorted(wordings):
        texts = sorted(json.dumps(text, ensure_ascii=False) for text in wordings[code])
        lines.append(f"{code} = [\n" + "".join(f"  {text},\n" for text in texts) + "]\n")
    return "".join(lines)


def _before(function: Function | None, use: ast.expr) -> Iterator[ast.stmt | ast.expr]:
    for node in ast.walk(function) if function is not None else ():
        if (
            isinstance(node, ast.Assign | ast.AugAssign | ast.NamedExpr)
            and node.lineno <= use.lineno
        ):
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


def _hole(node: ast.expr) -> str:
    match node:
        case ast.Name(id=name) | ast.Attribute(attr=name):
            return f"{{{name.strip('_')}}}"
    return HOLE


def _product(parts: Iterable[list[str]]) -> list[str]:
    few = [part if len(part) <= MOST else [HOLE] for part in parts]
    return ["".join(texts) for texts in itertools.product(*few)]


if __name__ == "__main__":
    GOLDEN.write_text(golden(sites()), encoding="utf-8")
