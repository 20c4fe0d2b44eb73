"""Write data and read them back unchanged, for any names, units and numbers."""

from __future__ import annotations

import itertools
import tempfile
from pathlib import Path

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from anhyst.data import History, Loop, Loops, read_columns, write_csv
from anhyst.data.formats.channels import SCPI_MARKS, Texts
from anhyst.data.output_map import OUTPUT_MAPS
from anhyst.data.path import MAX_MEASURED_VALUE, find_turning_points
from anhyst.data.reading import read_loops
from anhyst.support.units import DRIVE_QUANTITIES, QUANTITIES, QUANTITY_DIMENSIONS, UNITS, parse_header

# Larger values are not measurements, and two values mark samples without a measurement.
FINITE = st.floats(-MAX_MEASURED_VALUE, MAX_MEASURED_VALUE).filter(lambda value: abs(value) not in SCPI_MARKS)
DIMENSION = dict(QUANTITY_DIMENSIONS)


@st.composite
def known_headers(draw: st.DrawFn) -> tuple[str, str, str]:
    """Draw the name of a quantity, one of its units, and a header with both."""
    quantity = QUANTITIES[draw(st.sampled_from(sorted(QUANTITIES)))]
    dimension = DIMENSION.get(quantity.name, quantity.name)
    fitting = sorted(unit.symbol for unit in UNITS.values() if unit.dimension == dimension)
    unit = draw(st.sampled_from(fitting))
    form = draw(st.sampled_from(["{q}_{p}", "{q} [{u}]", "{q} ({u})", "{q}[{u}]", "{q}_{u}"]))
    return quantity.name, unit, form.format(q=quantity.symbol, u=unit, p=unit.replace("/", "_per_"))


@given(known_headers())
def test_every_spelling_of_a_header_is_understood(drawn: tuple[str, str, str]) -> None:
    name, unit, text = drawn
    header = parse_header(text)
    assert header.problem is None
    assert header.quantity == QUANTITIES[name]
    assert header.unit == UNITS[unit]


@given(st.text(max_size=30))
def test_any_text_is_a_header_or_a_problem(text: str) -> None:
    header = parse_header(text)
    assert header.problem is None or "\n" not in header.problem


@given(st.sampled_from(sorted(QUANTITIES)))
def test_an_si_header_gives_its_quantity(name: str) -> None:
    header = parse_header(QUANTITIES[name].column)
    assert header.quantity == QUANTITIES[name]
    assert header.unit is not None
    assert header.unit.value_to_si(1.0) == 1.0


@given(st.sampled_from(sorted(UNITS)), st.integers(-(10**9), 10**9))
def test_conversion_to_si_and_back_is_exact_to_rounding(symbol: str, thousandths: int) -> None:
    unit = UNITS[symbol]
    value = thousandths / 1000.0
    back = (unit.value_to_si(value) - unit.offset) / unit.scale
    assert abs(back - value) <= 4e-16 * (abs(value) + 2.0 * abs(unit.offset))


@given(
    hnp.arrays(np.float64, st.tuples(st.integers(1, 40), st.just(3)), elements=FINITE),
    st.sampled_from([",", ";", "\t"]),
)
def test_numbers_survive_a_file_bit_by_bit(values: np.ndarray, sign: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "table.csv"
        write_csv(path, {"I_A": values[:, 0], "F_N": values[:, 1], "x_m": values[:, 2]})
        path.write_text(path.read_text().replace(",", sign))
        table = read_columns(path)
        for place, name in enumerate(("current", "force", "displacement")):
            assert np.array_equal(table.require(name, ""), values[:, place])


LABELS = st.text(st.characters(codec="utf-8", exclude_categories=("C", "Z")), min_size=1, max_size=8)


@given(st.lists(LABELS, min_size=1, max_size=20))
def test_labels_survive_a_file(labels: list[str]) -> None:
    order = {label: code for code, label in enumerate(dict.fromkeys(labels))}
    column = Texts(tuple(order), np.array([order[label] for label in labels], np.int32))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "table.csv"
        write_csv(path, {"I_A": np.arange(float(len(labels))), "loop": column})
        read = read_columns(path).columns[1]
        assert isinstance(read, Texts)
        assert read.as_list() == labels


@settings(max_examples=50)
@given(
    st.sampled_from(DRIVE_QUANTITIES),
    st.sampled_from(list(OUTPUT_MAPS)),
    st.integers(3, 60),
    st.integers(0, 2**31),
)
def test_loops_survive_a_file(drive: str, answer: str, samples: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    loops = [
        Loop(label, rng.normal(size=samples), rng.normal(size=samples),
             schedule=np.full(samples, gap),
             time=np.sort(rng.uniform(size=samples)), history=History("settled"))
        for gap in (3e-4, 1.0 / 3.0) for label in ("a", "b c")
    ]  # fmt: skip
    before = Loops(tuple(loops), QUANTITIES[drive], QUANTITIES[answer], QUANTITIES["gap"])
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "loops.csv"
        before.save(path)
        after = read_loops(path, history="settled")
    key = [(loop.label, loop.schedule_value) for loop in after.loops]
    assert sorted(key) == sorted((loop.label, loop.schedule_value) for loop in before.loops)
    for loop in before.loops:
        twin = after.loops[key.index((loop.label, loop.schedule_value))]
        for name in ("input", "output", "schedule", "time"):
            assert np.array_equal(getattr(twin, name), getattr(loop, name))


@given(hnp.arrays(np.float64, st.integers(1, 50), elements=st.floats(-100, 100)), st.floats(0, 50))
def test_the_signal_is_monotone_between_turning_points(values: np.ndarray, limit: float) -> None:
    turns = find_turning_points(values, limit)
    assert turns[0] == 0
    assert turns[-1] == values.size - 1 or values.size == 1
    assert np.all(np.diff(turns) > 0)
    for start, stop in itertools.pairwise(turns):
        part = values[start : stop + 1]
        if part[-1] < part[0]:
            part = -part
        back = np.max(np.maximum.accumulate(part) - part)
        assert back <= limit
    inner = np.sign(np.diff(values[turns]))[:-1]
    assert np.all(inner[:-1] * inner[1:] < 0)


@given(st.lists(st.floats(-1e6, 1e6), min_size=1, max_size=8))
def test_history_text_is_read_back_exactly(points: list[float]) -> None:
    history = History("conditioned", tuple(points))
    assert History.parse(str(history)) == history
