"""The floating-point core, joined: its sources are written once for both precisions."""

from __future__ import annotations

import re

from anhyst.compile.block import Kind
from anhyst.compile.core import WIDTH, Joined, bare, read_core, section

HEADERS = (
    "include/anhyst/flags.h",
    "include/anhyst/status.h",
    "include/anhyst/compensator_real.h",
    "include/anhyst/generic/compensator.h",
)
SOURCES = ("lookup.h", "{kind}.h", "compensator.h")

_NAME = re.compile(r"ANHYST_NAME\((\w+)\)")
_LITERAL = re.compile(r"\bR\(([-+.\deE]+)\)")
_KERNEL = re.compile(r"^extern const anhyst_kernel_f32 anhyst_kernel_(\w+)_f32;\n", re.M)
_TYPE = re.compile(r"(static |inline |const )*\w+( \*)?")
_ELSEWHERE = re.compile(r" Declarations are in generic/compensator\.h\.")


def join_single(kind: Kind) -> Joined:
    """Join what a kind of compensator needs of the core in single precision.

    The macros that stand for the precision are written out.

    Parameters
    ----------
    kind : str
        ``"full"`` or ``"simplified"``.

    Returns
    -------
    Joined
    """
    header = [section(name, _single(name)) for name in HEADERS]
    header[-1] = _KERNEL.sub(lambda m: m[0] if m[1] == kind else "", header[-1])
    header.insert(2, '#ifdef __cplusplus\nextern "C" {\n#endif\n')
    names = [f"src/generic/{name.format(kind=kind)}" for name in SOURCES]
    source = [section(name, _single(name)) for name in names]
    return Joined("\n".join(header), "\n".join(source), ("stdint.h",))


def _single(name: str) -> str:
    """Return the text of a file with single precision put in."""
    text = _NAME.sub(r"\1_f32", _ELSEWHERE.sub("", bare(read_core(name))))
    text = text.replace("ANHYST_REAL", "float").replace("ANHYST_EPS", "1.1920929e-7f")
    return tidy(_LITERAL.sub(r"\1f", text))


def tidy(text: str) -> str:
    """Close up lines that were broken for the longer names of the macros, and align comments."""
    lines: list[str] = []
    held: list[str] = []
    comment = False
    for line in text.split("\n"):
        comment = comment or line.lstrip().startswith("/*")
        if comment:
            comment = "*/" not in line
            lines.append(line)
            continue
        held.append(line)
        if not _goes_on(held):
            lines += _closed(held)
            held = []
    return "\n".join(_aligned(lines + held))


def _goes_on(held: list[str]) -> bool:
    """Whether a bracket is still open, an operator waits, or a return type stands alone."""
    code = "".join(re.sub(r"/\*.*?\*/", "", line) for line in held).rstrip()
    waiting = code.endswith(("=", "+", "-", "||", "&&"))
    return waiting or code.count("(") > code.count(")") or bool(_TYPE.fullmatch(code))


def _closed(held: list[str]) -> list[str]:
    """Return a statement or signature on one line, or its arguments below each other."""
    joined = re.sub(r"\( ", "(", " ".join([held[0], *(line.strip() for line in held[1:])]))
    if len(joined) <= WIDTH:
        return [joined]
    if "=" in joined or " return " in joined or " if " in joined:
        return held
    head, _, arguments = joined.rpartition("(")
    rows = [f"{head}("]
    for argument in re.split(r"(?<=,) ", arguments):
        blank = "" if rows[-1].endswith("(") else " "
        if len(rows[-1]) + len(blank) + len(argument) > WIDTH:
            rows.append(" " * (len(head) + 1))
            blank = ""
        rows[-1] += blank + argument
    return rows


def _aligned(lines: list[str]) -> list[str]:
    """Put the comments behind neighbouring lines of a structure below each other."""
    result: list[str] = []
    block: list[tuple[str, str]] = []
    for line in [*lines, ""]:
        match = re.fullmatch(r"(  \S[^/]*;) +(/\*.*)", line)
        if match:
            block.append((match[1], match[2]))
            continue
        end = max((len(code) for code, _ in block), default=0)
        result += [f"{code:<{end}} {said}" for code, said in block]
        block = []
        result.append(line)
    return result[:-1]
