"""Read files with any content: reading succeeds or gives an error about the content."""

from __future__ import annotations

import re
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from anhyst.data import read_columns
from anhyst.data.clean import STEPS, clean
from anhyst.data.inspection import inspect
from anhyst.data.reading import read_loops
from anhyst.data.sidecar import FileDescription
from anhyst.model.actuator import Model, read_model
from anhyst.model.schema import FitFigures, LoopFit, Provenance, Uncertainty, ValidRange
from anhyst.model.writer import model_text
from anhyst.support.errors import InputError
from anhyst.support.units import QUANTITIES

RISE = np.linspace(0.0, 2.0, 12)
LAG = np.concatenate([np.maximum(RISE - 0.1, 0.0), np.minimum(RISE + 0.1, 1.9)[-2::-1]])
ROWS = [
    f"{0.1 * place + gap:.1f},{drive:g},{lag**2 / gap:.4f},{gap:g},a"
    for gap in (3.0, 5.0)
    for place, (drive, lag) in enumerate(zip(np.concatenate([RISE, RISE[-2::-1]]), LAG, strict=True))
]
TABLE = "\n".join(["# rig 3", "t_s,I_A,F_N,gap_mm,loop", *ROWS]) + "\n"
SIDECAR = """
loop = "loop"
schedule = "gap"
history = { a = "conditioned:0,2,0" }
file_name = "{loop}"
[columns]
F_N = "force"
[constants]
T_C = 20
[select]
loop = ["a", 1]
"""

SCRAPS = [
    "", " ", "\t", ",", ";", "\n", "\r", "\r\n", "#", '"', "'", "[", "]", "=", "-", "+", ".", "e",
    "0", "1", "NaN", "inf", "-1", "1e400", "1e308", "-1e-320", "0x1A", "1_0", "1,5", "9" * 400,
    "abc", "I_A", "H_A_per_m", "F [mN]", "gap", "µm", "x\0y", "\ufeff", "ü€\U0001f600", "٣", "١",
    "\x1b[31m", "\u2028", "true", "{}", "[]", '""', '"""', "1979-05-27", "nan", "\\u0000",
]  # fmt: skip


NUMBERS = [0.0, -0.0, 1.0, 2.0, 3.0, -1.0, 0.5, 1e-3, 1e15, 1e160, 1.7e308, -1.7e308, 5e-324]
ENCODINGS = [*["utf-8"] * 6, "utf-8-sig", "latin-1", "utf-16", "utf-16-be"]


@st.composite
def damaged(draw: st.DrawFn, text: str) -> bytes:
    """Cut, repeat, replace and move parts of a valid text; sometimes use another encoding."""
    tokens = re.findall(r"[^\s,;=\[\]]+|.", text, re.DOTALL)
    for _ in range(draw(st.integers(1, 6))):
        place = draw(st.integers(0, max(0, len(tokens) - 1)))
        match draw(st.integers(0, 4)):
            case 0:
                tokens[place : place + 1] = [draw(st.sampled_from(SCRAPS))]
            case 1:
                tokens.insert(place, draw(st.sampled_from(SCRAPS)))
            case 2:
                del tokens[place : place + draw(st.integers(1, 60))]
            case 3:
                other = draw(st.integers(0, max(0, len(tokens) - 1)))
                tokens.insert(place, tokens[other] if tokens else "")
            case 4:
                tokens = tokens[:place] + tokens[place : place + 40] * 2 + tokens[place + 40 :]
    encoding = draw(st.sampled_from(["utf-8"] * 6 + ["utf-8-sig", "latin-1", "utf-16", "utf-16-be"]))
    data = "".join(tokens).encode(encoding, "replace")
    if draw(st.integers(0, 9)) == 0:
        cut = draw(st.integers(0, len(data)))
        data = data[:cut] + draw(st.binary(max_size=20)) + data[cut:]
    return data


@st.composite
def odd_numbers(draw: st.DrawFn) -> bytes:
    """Draw a well-formed table whose values are few, equal, huge, tiny or random."""
    answer = draw(st.sampled_from(["F_N", "B_mT", "psi_Wb", "x_um"]))
    names = ["I_A", answer, *draw(st.sampled_from([[], ["gap_mm"], ["t_s"], ["T_C", "t_s"]]))]
    some = st.sampled_from(draw(st.lists(st.sampled_from(NUMBERS), min_size=1, max_size=5)))
    value = draw(st.sampled_from([some, st.floats(-1e3, 1e3), st.sampled_from(NUMBERS)]))
    rows = draw(st.lists(st.tuples(*[value] * len(names)), min_size=1, max_size=30))
    if "t_s" in names and draw(st.booleans()):
        rows = [(*row[:-1], float(place)) for place, row in enumerate(rows)]
    lines = (",".join(map(repr, row)) for row in rows)
    return "\n".join([",".join(names), *lines]).encode()


def holds_or_is_refused(name: str, content: bytes, use: Callable[[Path], object]) -> None:
    """Use a file; only an `InputError` with a message of one line is allowed."""
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # overflow from very large values
        path = Path(folder) / name
        path.write_bytes(content)
        try:
            use(path)
        except InputError as refusal:
            message = str(refusal)
        else:
            message = ""
        assert "\n" not in message


def look(path: Path) -> None:
    loops = read_loops(path)
    inspect(clean(loops))


def compute(path: Path) -> None:
    table = read_columns(path)
    for name in set(table.names):
        table.get(name)


def wash(path: Path) -> None:
    clean(read_loops(path), tuple(STEPS))


def describe(path: Path) -> None:
    FileDescription.from_toml(path)


def model_of_everything() -> str:
    """Text of a model file with all possible tables."""
    magnet = Model(
        name="magnet",
        input=QUANTITIES["current"],
        output=QUANTITIES["force"],
        parameters={"M_s": 1.3e6, "a": 400.0, "k": 300.0, "c": 0.15, "c_H": 9000.0, "c_out": 60.0}
        | {"rho": (0.004, 0.008)},
        gap_map="reluctance",
        schedule=QUANTITIES["gap"],
        nodes=(0.3e-3, 0.6e-3),
        valid=ValidRange((0.0, 2.0), (0.0, 500.0), (0.3e-3, 0.6e-3)),
        fit=FitFigures(500.0, 1.0, 1.5, 4.0, (LoopFit("a", 0.3e-3, 40, 500.0, 1.0, 1.5, 4.0),)),
        uncertainty=Uncertainty(("k",), (300.0,), (4.0,), ((1.0,),), ("a sentence",)),
        provenance=Provenance("1.0", 1, (), {"seed": 1}),
    )
    return model_text(magnet)


MODEL = model_of_everything()


@settings(max_examples=200)
@given(st.binary(max_size=400))
def test_any_bytes_are_loops_or_a_refusal(content: bytes) -> None:
    holds_or_is_refused("loops.csv", content, look)


@pytest.mark.slow
@settings(max_examples=300)
@given(damaged(TABLE))
def test_damaged_loops_are_inspected_or_refused(content: bytes) -> None:
    holds_or_is_refused("loops.csv", content, look)


@settings(max_examples=100)
@given(damaged(TABLE))
def test_damaged_loops_are_cleaned_or_refused(content: bytes) -> None:
    holds_or_is_refused("loops.csv", content, wash)


@settings(max_examples=200)
@given(odd_numbers())
@example(b"I_A,F_N\n0.0,0.0\n5e-324,0.0\n0.0,0.0")
def test_unusual_numbers_are_inspected_or_refused(content: bytes) -> None:
    holds_or_is_refused("loops.csv", content, look)


@pytest.mark.slow
@settings(max_examples=200)
@given(odd_numbers())
def test_odd_numbers_are_cleaned_or_refused(content: bytes) -> None:
    holds_or_is_refused("loops.csv", content, wash)


@pytest.mark.slow
@settings(max_examples=200)
@given(damaged(TABLE))
def test_a_damaged_drive_is_read_or_refused(content: bytes) -> None:
    holds_or_is_refused("drive.csv", content, compute)


@pytest.mark.slow
@settings(max_examples=200)
@given(damaged(SIDECAR))
def test_a_damaged_sidecar_is_read_or_refused(content: bytes) -> None:
    holds_or_is_refused("loops.toml", content, describe)


@pytest.mark.slow
@settings(max_examples=300)
@given(damaged(MODEL))
def test_a_damaged_model_is_read_or_refused(content: bytes) -> None:
    holds_or_is_refused("model.toml", content, read_model)
