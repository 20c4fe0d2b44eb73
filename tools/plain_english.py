"""Count sentences and names that are hard to read, and compare the counts with a record.

``make house`` runs this module. It reads docstrings, comments, messages, Markdown and identifiers.
Each rule is a pattern that plain English rarely needs, such as *what is left* or *of which*. About
20 % of the hits are false, so a text that reads well still shows about 10 %. The counts guide a
writer. They do not prove that a text is clear: only a reader can. The record beside this file
(``plain_english.json``) limits each folder, and ``tests/house`` fails if a folder exceeds its limit.
"""

from __future__ import annotations

import argparse
import ast
import io
import json
import random
import re
import subprocess
import sys
import tokenize
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
RECORD = ROOT / "tools" / "plain_english.json"
SKIPPED_FOLDERS = {"third_party", "fmi", "truths", "uplot", "kept_models"}
LOWEST_LIMITS = {"sentences": 15, "names": 2}
"""Lowest limits in the record, percent: a clear text still has false hits."""
MAX_WORDS = 30
"""Maximum number of words in a sentence."""
MIN_WORDS = 3
"""Minimum number of words in a checked sentence."""
MIN_MESSAGE_WORDS = 5
"""Minimum number of words in a string literal that counts as a message."""

_PREPOSITION = "of|by|from|in|at|to|with|on|beside|behind|before|beyond|under|over|after|for"
_SEEK = "looked|asked|waited|spoken|sought|gone|come|said|taken over|added|left"
_LACKS = "is|are|was|were|be|has|have|had|needs?|makes?|gives?|takes?|does|shows?|knows?"
_PRONOUN_PHRASES = (
    "its own|of its own|of their own|of theirs|of it|of them|of these|of those|of one|of each|"
    "of all|of others|of any|of itself|by itself"
)
_ADVERBS = (
    "anew|afresh|hardly|thereby|therein|thereof|hence|whence|hither|likewise|beforehand|"
    "afterwards|nowhere|wherever|whoever|mostly"
)
_FRONT = "along|within|beyond|below|above|between|across|under|over|without|with|at|in|on|by|from|for|to"
_FINITE = "is|are|was|were|has|have|goes|stands|lies|comes|does|do|may|can|must|will"

RULES = {
    "opens with a preposition": r"^(of|from|by|with|in|at|beyond|up to|under) (which|whom|what)\b"
    r"|^of (?!course)\w",
    "opens with a relative word": r"^(what|where|which|how|whatever|whoever|as) "
    r"(?!if\b|happens\b|about\b)[^?]*$",
    "opens with that": r"^that [^,?]* (is|are|was|holds|follows)\b",
    "opens with a negation": r"^(none|nothing|never|nor|not) ",
    "told": r"\b(is|are|was|be|were) told\b|\btells? [^.,]{0,30}\b(apart|from)\b"
    r"|\btold (apart|from|by)\b",
    "foresee": r"\bforesee(s|n)?\b|\bforesaw\b",
    "stands": r"\b(stand|stands|stood|lies|lie) "
    r"(in|at|on|there|where|beside|behind|for itself|alone)\b",
    "looked for": rf"\b(is|are|was|be|were) ({_SEEK}) (for|at|of|on|to|through|out|over)\b",
    "goes on": r"\b(go|goes|went|going|gone) (on|with|the way|far|by|beyond)\b"
    r"|\bgoes? (?:along|up to)\b",
    "meets": r"\b(meets?|met|missed|misses) (the|by|what|it|those|where|at)\b",
    "taken off": r"\b(is|are|was|were) (taken off|given back|taken in|let in|held by|kept by)\b",
    "says": r"\b(says?|said|say) (so|that it|of|what|how|which|where|nothing)\b",
    "so many": r"\bso (many|much|few|little|often|long)\b(?! (that|as))",
    "as many": r"\bas (many|much|few|far|good|well|little) as\b",
    "at most last": r"[,(] at (most|least)\b|\b(least|most|worst|best) (of|that|one|ones)\b"
    r"|\bthe least\b|\bat most[,.;)]",
    "what is": r"\bwhat (is|was|are|it|they|one|has|had|does|did|may|can|must|remains?|follows"
    r"|comes|belongs|moves|needs)\b",
    "preposition and what": r"\b(of|by|than|from|to|over|under|in|with|for|at|and|or|less|takes?"
    r"|is|beside) what\b",
    "those that": r"\b(those|the ones?|the others|others|one|some|all|any|none) "
    r"(of|that|which|who|whose|in|at|with|it|they|the)\b"
    r"(?<!one of)(?<!some of)(?<!all of)(?<!all the)(?<!one that)|\bthat (of|which|who|whose|in|at|with)\b",
    "bare pronoun": rf"\b({_PRONOUN_PHRASES})\b(?=[ ,.;:)]|$)(?! (loops?|gaps?|samples?))",
    "is no": rf"\b({_LACKS}) no\b(?! (longer|more|less))|\bis none\b|\bthere is none\b",
    "of which": rf"\b({_PREPOSITION}) which\b",
    "anew": rf"\b({_ADVERBS})\b",
    "beside": r"\b(beside|besides|behind|amid|upon|save for|but for|nothing but|all but)\b",
    "alike": r"\b(alike|apart|asunder|aside|away|thence|at once|on its way|on the way|by heart)\b",
    "too last": r"[^,], too\b|\btoo[.;]"
    r"|^.{0,60}\bhowever (well|much|small|long|many|far|smooth)\b",
    "as it was": r"\bas its? (is|was|were|stood|stands|did|does|has)\b"
    r"|\bas (ever|always|before|usual|any other)\b",
    "where as if": r"\bwhere (nothing|none|it|they|one|that|there|no|all|this|two|both|neither"
    r"|anything)\b",
    "from ... on": r"\bfrom .{1,25}\bon\b(?=[,.;:)]|$| )(?<!from on)",
    "lets": r"\b(let|lets) (the|it|them|those|what|so|a|all|one)\b",
    "asked": r"\b(asked|wanted|demanded) (for|of|to|what)?\b(?=[,.;:)]|$)"
    r"|\b(was|were|is|are) (asked|wanted)\b",
    "split relative clause": r"\b(is|are|was|were|does|do|did|has|stands|goes|comes|lies|counts"
    r"|stays|moves|fits?|holds) (that|which|who|whose)\b",
    "verb last": r"\b(that|which|where|what|how) (the |a |an |its |his |these |those )?\w+( \w+)?"
    r"( (has|had|have|was|were|is|are))( (not|never|already|once|once more))?[.;]$",
    "long opening phrase": rf"^({_FRONT}) [^,]{{3,60}} ({_FINITE}) [^,]*$",
    "fragment after a semicolon": r"[;:] (of|by|at|with|beyond|below|above|under|without|otherwise"
    r"|else|from|to|in|none|nothing|not|so) ",
    "two semicolons": r"(?:;[^;]*){2,}|(?:: [^:]*){2,}",
}
_PATTERNS = {rule: re.compile(pattern, re.IGNORECASE) for rule, pattern in RULES.items()}

_VAGUE_WORDS = """
    afresh again alike almost alone anew apart away behind below beside best beyond both dear
    dearer done drawn else enough every far farther farthest few fewer fewest fine firm first free
    fresh further glance going gone good grown grows half hardly heed held here hidden hurry idle
    inner just known large late least left less light likely little long loose lost low many marked
    mass met missed missing more most much named narrow near nearer never nothing now odd off once
    one ones only open other others outer own passed patient plain put quick rather rest same said
    say says scarce seen seldom short shown slow small soon still stuck sure taken takes taught tell
    told tight too tried turned unbelieved unlikely unseen untouched usual wanted wide worth wrong
    what where which who whole twice thrice agree bears bends carry does finds follows gives goes
    keep keeps leave leaves meets moves rises stand stands stay stays teach teaches unsure heavier
    meet be been being so such them these those this that they it something anything everything
    somewhere everywhere nowhere aside
"""
VAGUE_WORDS = frozenset(_VAGUE_WORDS.split())
"""Words that do not make a name clear, however they are combined."""


@dataclass(frozen=True)
class Item:
    """A sentence or a name of the project."""

    file: str
    line: int
    kind: str  # "docstring", "comment", "message", "page" or "name"
    text: str

    @property
    def folder(self) -> str:
        """The folder whose limit applies: a package's subfolder, or the first two folders."""
        path_parts = self.file.split("/")
        depth = {"src": 5, "tests": 4}.get(path_parts[2], 2) if path_parts[0] == "packages" else 2
        return "/".join(path_parts[: min(depth, len(path_parts) - 1)]) or "."

    @property
    def broken_rules(self) -> list[str]:
        """The rules that the item breaks."""
        if self.kind == "name":
            words = [word for word in self.text.strip("_").lower().split("_") if word]
            is_vague = bool(words) and VAGUE_WORDS.issuperset(words)
            starts_badly = words[1:] and words[0] in {"of", "what", "how", "which", "by", "from"}
            return ["vague name"] if is_vague or starts_badly else []
        found = [rule for rule, pattern in _PATTERNS.items() if pattern.search(self.text)]
        return [*found, "long"] if len(self.text.split()) > MAX_WORDS else found


def find_items(root: Path = ROOT) -> list[Item]:
    """Return all sentences and names of the files that git tracks."""
    command = ["git", "-C", str(root), "ls-files", "-z"]
    git_listing = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    found: list[Item] = []
    for file in sorted(filter(None, git_listing.split("\0"))):
        path = root / file
        reader = READERS.get(path.suffix)
        if reader and path.is_file() and not SKIPPED_FOLDERS.intersection(file.split("/")):
            found.extend(reader(file, path.read_text("utf-8")))
    return found


def count_percentages(items: list[Item]) -> dict[str, dict[str, int]]:
    """Return the share of sentences with a hit and of vague names in each folder, percent."""
    totals: Counter[tuple[str, str]] = Counter()
    hits: Counter[tuple[str, str]] = Counter()
    for item in items:
        key = (item.folder, "names" if item.kind == "name" else "sentences")
        totals[key] += 1
        hits[key] += bool(item.broken_rules)
    shares: dict[str, dict[str, int]] = {}
    for (folder, kind), total in sorted(totals.items()):
        shares.setdefault(folder, {})[kind] = -(-100 * hits[folder, kind] // total)
    return shares


def find_exceeded(
    shares: dict[str, dict[str, int]], limits: dict[str, dict[str, int]]
) -> dict[tuple[str, str], int]:
    """Return the shares that exceed their limit, percent, by folder and kind."""
    return {
        (folder, kind): share
        for folder, folder_shares in shares.items()
        for kind, share in folder_shares.items()
        if share > limits.get(folder, LOWEST_LIMITS).get(kind, LOWEST_LIMITS[kind])
    }


def _split_sentences(text: str) -> Iterator[str]:
    """Split a text into sentences; code, links and roles count as one word."""
    text = re.sub(r"``[^`]*``|`[^`]*`|:\w+:`[^`]*`", " X ", text)
    text = re.sub(r"!?\[([^\]]*)\]\([^)]*\)", r"\1", text)
    text = re.sub(r"\s+", " ", text)
    for part in re.split(r"(?<=[.!?])\s+(?=[A-Z\"'(*\[])", text):
        sentence = part.strip(" *_#>|-")
        if len(sentence.split()) >= MIN_WORDS and re.search(r"[a-z]{3}", sentence):
            yield sentence


def _read_python(file: str, source: str) -> Iterator[Item]:
    parts: set[ast.AST] = set()  # docstrings and parts of f-strings, which are not messages
    for node in ast.walk(ast.parse(source)):
        if node in parts:
            continue
        if isinstance(node, ast.Expr | ast.JoinedStr):
            parts.update(ast.iter_child_nodes(node))
        if isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant):
            if isinstance(node.value.value, str):
                prose = re.split(r"\n\s*\w+\n\s*-{3,}", node.value.value)[0]
                for paragraph in re.split(r"\n\s*\n", prose):
                    for sentence in _split_sentences(paragraph):
                        yield Item(file, node.lineno, "docstring", sentence)
        elif isinstance(node, ast.JoinedStr | ast.Constant):
            for sentence in _split_message(node):
                yield Item(file, node.lineno, "message", sentence)
        elif isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            yield Item(file, node.lineno, "name", node.name)
        elif isinstance(node, ast.arg):
            yield Item(file, node.lineno, "name", node.arg)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield Item(file, node.lineno, "name", node.id)
    yield from _read_python_comments(file, source)


def _split_message(node: ast.JoinedStr | ast.Constant) -> Iterator[str]:
    """Split a string literal on one line; each interpolated value counts as one word."""
    text_parts = node.values if isinstance(node, ast.JoinedStr) else [node]
    text = "".join(str(part.value) if isinstance(part, ast.Constant) else "X" for part in text_parts)
    is_text = isinstance(node, ast.JoinedStr) or isinstance(node.value, str)
    if is_text and len(text.split()) >= MIN_MESSAGE_WORDS and "\n" not in text.strip():
        yield from _split_sentences(text)


def _read_python_comments(file: str, source: str) -> Iterator[Item]:
    """Yield the sentences of comments; lines that follow each other are one comment."""
    block: list[tuple[int, str]] = []
    directive = re.compile(r"#\s*(type:|noqa|fmt|ruff|!|pragma)")
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type != tokenize.COMMENT or directive.match(token.string):
            continue
        is_trailing = bool(token.line[: token.start[1]].strip())
        if block and (is_trailing or token.start[0] != block[-1][0] + 1):
            yield from _items_of_block(file, block)
            block = []
        block.append((token.start[0] - is_trailing, token.string.lstrip("# ")))
    yield from _items_of_block(file, block)


def _items_of_block(file: str, block: list[tuple[int, str]]) -> Iterator[Item]:
    for sentence in _split_sentences(" ".join(text for _, text in block)):
        yield Item(file, block[0][0], "comment", sentence)


_C_NAME = re.compile(
    r"^#define (\w+)|^\s*(?:static |inline |const |unsigned )*\w+ \*?(\w+)\(.*\)\s*$"
    r"|^\s+(?:const )?\w+_t \*?(\w+)[;=]",
    re.MULTILINE,
)


def _read_c(file: str, source: str) -> Iterator[Item]:
    for comment in re.finditer(r"/\*(?!@)(.*?)\*/|//(?!@)([^\n]*)", source, re.DOTALL):
        line = source.count("\n", 0, comment.start()) + 1
        text = re.sub(r"\n\s*\* ?", "\n", comment.group(1) or comment.group(2) or "")
        for paragraph in re.split(r"\n\s*\n", text):
            for sentence in _split_sentences(paragraph):
                yield Item(file, line, "comment", sentence)
    code = re.sub(r"/\*.*?\*/", lambda match: "\n" * match.group().count("\n"), source, flags=re.DOTALL)
    for match in _C_NAME.finditer(code):
        name = next(group for group in match.groups() if group)
        yield Item(file, code.count("\n", 0, match.start()) + 1, "name", name)


def _read_markdown(file: str, source: str) -> Iterator[Item]:
    ignored_pattern = re.compile(r"```.*?```|<!--.*?-->", re.DOTALL)
    source = ignored_pattern.sub(lambda match: "\n" * match.group().count("\n"), source)
    for number, line in enumerate(source.splitlines(), 1):
        if line.startswith("    "):
            continue
        for cell in line.strip("| ").split(" | ") if line.startswith("|") else [line]:
            for sentence in _split_sentences(re.sub(r"^(\s*[-*]|\s*\d+\.|#+)\s+", "", cell)):
                yield Item(file, number, "page", sentence)


READERS = {".py": _read_python, **dict.fromkeys((".c", ".h", ".cpp"), _read_c), ".md": _read_markdown}


def main() -> int:
    """Print the shares, or a random sample; lower the record; return 1 if a limit is exceeded."""
    parser = argparse.ArgumentParser(prog="python -m tools.plain_english")
    parser.add_argument("folder", nargs="?", default="", help="only files that begin with this")
    parser.add_argument("--sample", type=int, metavar="N", help="print N sentences and N names")
    parser.add_argument("--seed", type=int, default=1, help="seed of the sample")
    options = parser.parse_args()
    items = [item for item in find_items() if item.file.startswith(options.folder)]
    if options.sample:
        _print_sample(items, options.sample, random.Random(options.seed))
        return 0
    limits: dict[str, dict[str, int]] = json.loads(RECORD.read_text("utf-8"))
    shares = count_percentages(items)
    is_exceeded = bool(find_exceeded(shares, limits))
    print(f"{'folder':50}{'sentences with a hit':>22}{'vague names':>14}")
    for folder, folder_shares in shares.items():
        folder_limits = limits.get(folder, LOWEST_LIMITS)
        cells = (
            f"{folder_shares[kind]} %" if kind in folder_shares else "" for kind in ("sentences", "names")
        )
        print("{:50}{:>22}{:>14}".format(folder, *cells))
        limits[folder] = {
            kind: max(LOWEST_LIMITS[kind], min(share, folder_limits.get(kind, LOWEST_LIMITS[kind])))
            for kind, share in folder_shares.items()
        }
    if not options.folder:
        limits = {folder: limits[folder] for folder in shares}
        RECORD.write_text(json.dumps(limits, indent=2, sort_keys=True) + "\n", "utf-8")
    return int(is_exceeded)


def _print_sample(items: list[Item], size: int, generator: random.Random) -> None:
    names = list({item.text: item for item in items if item.kind == "name"}.values())
    for population in ([item for item in items if item.kind != "name"], names):
        for item in generator.sample(population, min(size, len(population))):
            print(f"{item.file}:{item.line}: {item.text}")


if __name__ == "__main__":
    sys.exit(main())
