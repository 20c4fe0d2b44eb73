"""The model file is exact, complete, editable, and checked strictly on reading."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from anhyst.data.loops import Source
from anhyst.data.path import History
from anhyst.model.actuator import Model, read_model
from anhyst.model.parameters import Parameter
from anhyst.model.schema import (
    CHOSEN,
    CandidateFit,
    CrossValidation,
    FitFigures,
    LoopFit,
    Provenance,
    ReductionStep,
    Uncertainty,
    ValidRange,
)
from anhyst.model.writer import model_text, write_model
from anhyst.support.errors import InputError
from anhyst.support.toml_file import TomlFileError
from anhyst.support.units import QUANTITIES, Quantity
from tests.refusals import refused

IRON: dict[str, Parameter] = {"M_s": 1.3e6, "a": 400.0, "k": 300.0, "c": 0.1, "c_H": 9e3}
COMPLETE = Model(
    name='solenoid "B"',
    input=QUANTITIES["current"],
    output=QUANTITIES["force"],
    parameters=IRON | {"rho": (0.004, 0.0055, 0.008), "c_out": 60.0, "in_0": 0.01, "out_0": 0.3},
    gap_map="reluctance",
    schedule=QUANTITIES["gap"],
    nodes=(0.3e-3, 0.4e-3, 0.6e-3),
    history=History("conditioned", (0.0, 2.0, 0.0)),
    valid=ValidRange((0.0, 2.0), (0.0, 80.0), (0.3e-3, 0.6e-3), 12.5),
    fit=FitFigures(
        largest_output=80.0,
        mean_abs=0.1,
        rms=0.15,
        worst=0.6,
        loops=(LoopFit("major", 0.3e-3, 200, 80.0, 0.1, 0.15, 0.6),),
        left_out={"scaling": 0.0036, "reluctance": 0.0018},
        monotone=True,
        cross_validation=CrossValidation(0.0018, (0.0009, 0.0042), (0.0012, 0.0024), "block"),
        candidates=(CandidateFit("effective-field", "reluctance", 7, 0.0019, 0.0018, CHOSEN),),
        not_noise=0.0007,
        left_over="the rest is noise",
    ),
    uncertainty=Uncertainty(
        names=("k", "alpha"),
        values=(300.0, 0.0),
        std=(1.5, float("inf")),
        correlation=((1.0, -0.2), (-0.2, 1.0)),
        statements=("alpha cannot be reported from the offset of rho.",),
    ),
    reduction=(
        ReductionStep("k", 0.0017, 0.0018, {"k": 0.0018, "a": 0.0021}),
        ReductionStep("a", 0.0018, 0.002),
    ),
    provenance=Provenance(
        version="0.1.0",
        seed=1,
        sources=(Source("loops/gap 0.3.csv", "ab" * 32, {"U": "I_A"}), Source("b.csv", "cd", {})),
        settings={"search": "default", "resume": False, "weights": 1.5, "rounds": 3},
    ),
)

FIELD = replace(
    COMPLETE,
    input=QUANTITIES["field"],
    output=QUANTITIES["flux_density"],
    schedule=QUANTITIES["temperature"],
    gap_map="free",
    parameters=IRON | {"M_s": (1e6, 9e5, 8e5), "c_out": 1.0},
    nodes=(-15.0, 0.0, 15.0),
    history=History("settled"),
)
PIEZO = Model("stack", QUANTITIES["voltage"], QUANTITIES["displacement"], IRON | {"c_out": 1e-5})


@pytest.mark.parametrize("model", [COMPLETE, FIELD, PIEZO])
def test_a_model_reads_back_as_it_was_written(model: Model, tmp_path: Path) -> None:
    write_model(model, tmp_path / "model.toml")
    again = read_model(tmp_path / "model.toml")
    assert again == model
    assert model_text(again) == model_text(model)


POSITIVE = st.floats(1e-6, 1e12)
ANY = st.floats(-1e12, 1e12)
LISTS = st.lists(st.floats(0.0, 1e12), min_size=3, max_size=3)


@pytest.mark.slow
@given(
    m_s=POSITIVE,
    a=st.floats(1.0, 1e6),
    ratio=st.floats(1.1e-3, 9e2),
    c=st.floats(0.0, 1.0),
    rho=LISTS,
    offsets=st.lists(ANY, min_size=3, max_size=3),
    points=st.lists(ANY, min_size=1, max_size=5),
    name=st.text(st.characters(exclude_categories=["Cs"])),
    deviation=POSITIVE,
)
def test_every_bit_and_every_character_comes_back(
    tmp_path_factory: pytest.TempPathFactory,
    m_s: float,
    a: float,
    ratio: float,
    c: float,
    rho: list[float],
    offsets: list[float],
    points: list[float],
    name: str,
    deviation: float,
) -> None:
    path = tmp_path_factory.mktemp("round") / "model.toml"
    model = replace(
        COMPLETE,
        name=name,
        parameters=IRON
        | {"M_s": m_s, "a": a, "k": a * ratio, "c": c, "rho": tuple(rho)}
        | {"c_out": m_s, "out_0": tuple(offsets), "in_0": offsets[0]},
        history=History("conditioned", tuple(points)),
        fit=FitFigures(80.0, deviation, 2 * deviation, 3 * deviation, left_out={name: deviation}),
    )
    write_model(model, path)
    assert read_model(path) == model


def test_the_file_reports_units_and_nothing_about_the_time() -> None:
    text = model_text(COMPLETE)
    for key in ("k_A_per_m", "c_H_per_m", "c_F_N_per_T2", "I_0_A", "F_0_N", "nodes_m", "worst_N"):
        assert f"\n{key} = " in text
    for key in ("c_H", "c_B", "H_0_A_per_m", "B_0_T", "nodes_C"):
        assert f"\n{key} = " in model_text(FIELD)
    for key in ("c_H_A_per_m_V", "c_x_m_per_T", "u_0_V", "x_0_m"):
        assert f"\n{key} = " in model_text(PIEZO)
    assert not re.search(r"20\d\d-\d\d", text)
    assert max(map(len, text.splitlines())) < 110


def edited(tmp_path: Path, pattern: str, replacement: str) -> Path:
    text, count = re.subn(pattern, replacement, model_text(COMPLETE), flags=re.MULTILINE)
    assert count, pattern
    path = tmp_path / "model.toml"
    path.write_text(text)
    return path


def line_of(path: Path, beginning: str) -> int:
    rows = path.read_text().splitlines()
    return next(i for i, row in enumerate(rows, 1) if row.startswith(beginning))


@pytest.mark.parametrize(
    ("pattern", "replacement", "line", "message"),
    [
        ("^format.*", 'format = "other"', "format", "wrong-format format"),
        ("^version = 1", "version = 2", "version", "wrong-version version"),
        ("^version = 1", 'version = "1"', "version", "wrong-version version: '1'"),
        ("^k_A_per_m.*", "k_A_per_m = 0.0", "k_A", "out-of-range parameters.k_A_per_m"),
        ("^k_A_per_m.*", "k_A_per_m = -3", "k_A", "out-of-range parameters.k_A_per_m"),
        ("^k_A_per_m.*", "k_A_per_m = 1e9", r"[parameters]", "parameters-out-of-range parameters"),
        ("^c = .*", "c = 1.2", "c = ", "out-of-range parameters.c: 1.2"),
        ("^c_H_per_m.*", "c_H_per_m = 0", "c_H", "out-of-range parameters.c_H_per_m"),
        ("^alpha.*", "alpha = 1.0", "alpha", "out-of-range parameters.alpha"),
        ("^rho.*", "rho = [1.0, 2.0]", "rho", "length-differs parameters.rho"),
        ("^rho.*", "rho = []", "rho", "not-a-number parameters.rho"),
        ("^rho.*", "rho = [1, inf, 2]", "rho", "not-a-number parameters.rho"),
        ("^a_A_per_m.*", "a_A_per_m = true", "a_A", "not-a-number parameters.a_A_per_m"),
        ("^a_A_per_m.*", "a_A_per_m = [1,2,3]", "a_A", "may-not-vary parameters.a_A_per_m"),
        ("^nodes_m.*", "nodes_m = [1,3,2]", "nodes", "not-ascending schedule.nodes_m"),
        ("^k_A_per_m", "k", "k", "unit-missing parameters.k: k_A_per_m"),
        ("^k_A_per_m", "k_kA_per_m", "k_kA", "unit-missing parameters.k_kA_per_m: k_A_per_m"),
        ("^c_F_N_per_T2", "c_out", "c_out", "unit-missing parameters.c_out: c_F_N_per_T2"),
        ("^I_0_A", "I_0", "I_0", "unit-missing parameters.I_0: I_0_A"),
        ("^nodes_m", "nodes", "nodes", "unit-missing schedule.nodes: nodes_m"),
        (r"^gap_m = \[", "gap = [", "gap = ", "unit-missing valid.gap: gap_m"),
        ("^worst_N", "worst_mN", "worst_mN", "unit-missing fit.worst_mN: worst_N"),
        ("^k_A_per_m", "zzz", "zzz", "extra-forbidden parameters.zzz"),
        ("^alpha", "alhpa", "alhpa", "extra-forbidden parameters.alhpa: alpha"),
        ("^gap_map", "gap_mop", "gap_mop", "extra-forbidden gap_mop: gap_map"),
        ("^a_A_per_m.*\n", "", "[parameters]", "missing parameters.a_A_per_m"),
        ("^unit = .A.", 'unit = "mA"', "unit", "unit-not-si input.unit: 'mA'"),
        ('^unit = "A"\n', "", "[input]", "missing input.unit"),
        ("^quantity = .gap.", "quantity = 3", "quantity = 3", "string-type schedule.quantity"),
        ("^law.*", 'law = "preisach"', "law", "unknown-choice law: 'effective-field'"),
        ("^gap_map.*", 'gap_map = "x"', "gap_map", "literal-error gap_map: 'none'; 'scaling'"),
        ("^history.*", 'history = "warm"', "history", "unknown-history history: 'warm'"),
        ("^I_A = .*", "I_A = [2, 0]", "I_A", "range-reversed valid.I_A"),
        ("^I_A = .*", "I_A = [2]", "I_A", "too-short valid.I_A"),
        ("^I_rate_A_per_s = .*", "I_rate_A_per_s = 0.0", "I_rate", "greater-than valid.I_rate_A_per_s"),
        ("^I_rate_A_per_s = .*", "I_rate = 12.5", "I_rate = ", "unit-missing valid.I_rate"),
        ("^std = .*", "std = [1]", "std", "length-differs uncertainty.std"),
        ("^samples.*", "samples = 1.5", "samples", "int-type fit.loop[1].samples"),
        ("^samples", "sample", "sample", "extra-forbidden fit.loop[1].sample"),
        ("^interval.*", "interval = [1]", "interval", "too-short fit.cross_validation.interval"),
        ("^names = .*", "names = 3", "names", "list-type uncertainty.names"),
        ("^rms_N = .*", "rms_N = nan", "rms_N", "finite-number fit.rms_N"),
    ],
)
def test_a_wrong_key_is_named_with_its_line(
    tmp_path: Path, pattern: str, replacement: str, line: str, message: str
) -> None:
    path = edited(tmp_path, pattern, replacement)
    with refused(message) as caught:
        read_model(path)
    text = str(caught.value)
    assert text.startswith(f"{path}:{line_of(path, line)}: "), text
    assert "\n" not in text


def test_everything_wrong_is_reported_at_once(tmp_path: Path) -> None:
    path = edited(tmp_path, "^(k_A_per_m|a_A_per_m|M_s_A_per_m|c_H_per_m) = .*", r"\1 = -1")
    with pytest.raises(TomlFileError) as caught:
        read_model(path)
    keys = [problem.key for problem in caught.value.problems]
    assert keys == [f"parameters.{key}" for key in ("M_s_A_per_m", "a_A_per_m", "k_A_per_m", "c_H_per_m")]
    lines = [problem.line for problem in caught.value.problems]
    assert lines == sorted(line for line in lines if line)
    assert f"also wrong: parameters.a_A_per_m (line {lines[1]})" in str(caught.value)


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (b"name = \n", "damaged-toml: :1:"),
        (b'name = "x\n', "damaged-toml: :1:"),
        (b"a = 1\na = 2\n", "damaged-toml: :2:"),
        (b"\xff\xfe\x00\x01", "not-utf8"),
        (b"", "wrong-format format: anhyst-model"),
        (b"I_A,F_N\n0,1\n", "damaged-toml: :1:"),
    ],
)
def test_a_damaged_file_is_reported_in_one_line(tmp_path: Path, damage: bytes, message: str) -> None:
    path = tmp_path / "model.toml"
    path.write_bytes(damage)
    with refused(message) as caught:
        read_model(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


@pytest.mark.slow
@given(st.data())
def test_a_file_cut_anywhere_is_never_a_traceback(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    text = model_text(COMPLETE)
    start = data.draw(st.integers(0, len(text)))
    stop = data.draw(st.integers(start, min(start + 80, len(text))))
    path = tmp_path_factory.mktemp("cut") / "model.toml"
    path.write_text(text[:start] + text[stop:])
    try:
        read_model(path)
    except InputError as error:
        text = str(error)
    else:
        return  # the cut is in a comment or an optional table
    assert text.startswith(str(path))


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with refused("no-such-file"):
        read_model(tmp_path / "none.toml")


def test_comments_and_order_are_free(tmp_path: Path) -> None:
    path = edited(tmp_path, r"^\[parameters\]", "[parameters]  # mine\n# and a note\n")
    assert read_model(path) == COMPLETE


def test_a_user_defined_quantity_can_be_the_schedule(tmp_path: Path) -> None:
    load = Quantity("load", "load", "Pa")
    model = replace(COMPLETE, schedule=load)
    write_model(model, tmp_path / "model.toml")
    assert "nodes_Pa" in model_text(model)
    assert read_model(tmp_path / "model.toml") == model
