"""Test which arguments the package's functions accept, and how they reject others."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import anhyst
import anhyst_rigs
from anhyst import InputError, Loops, Model
from anhyst.cli.app import main
from anhyst.data.loops import Loop
from anhyst.support.units import QUANTITIES
from anhyst.support.wording import count_text, use_command_line_wording, word_for_python

IRON = {"M_s": 4e5, "a": 30.0, "k": 20.0, "c": 0.2, "c_H": 1.0, "c_out": 1.0}
MODEL = Model("core", QUANTITIES["field"], QUANTITIES["flux_density"], IRON)
FIELD = np.concatenate([np.linspace(-100.0, 100.0, 60), np.linspace(100.0, -100.0, 60)])
ARRAYS = {"H_A_per_m": FIELD, "B_T": MODEL(FIELD, history="settled")}
LOOPS = anhyst.read_loops(ARRAYS)

LOOP_VERBS: dict[str, Callable[[Any], object]] = {
    "identify: loops": anhyst.identify,
    "inspect: loops": anhyst.inspect,
    "read_loops: paths": anhyst.read_loops,
    "clean: loopset": anhyst.clean,
    "watch: recording": lambda value: anhyst.watch(MODEL, value),
    "predict: drive": lambda value: anhyst.predict(MODEL, value),
    "invert: demand": lambda value: anhyst.invert(MODEL, value),
    "init: loops": lambda value: anhyst.init("new", value),
}
MODEL_VERBS: dict[str, Callable[[Any], object]] = {
    "report: model": anhyst.report,
    "predict: model": lambda value: anhyst.predict(value, ARRAYS),
    "invert: model": lambda value: anhyst.invert(value, ARRAYS),
    "compile: model": lambda value: anhyst.compile(value, "new", rate=1e4),
    "watch: model": lambda value: anhyst.watch(value, LOOPS),
    "diff: first": lambda value: anhyst.diff(value, MODEL),
    "diff: second": lambda value: anhyst.diff(MODEL, value),
    "export: model": lambda value: anhyst.export(value, "new.csv", as_="lut"),
    "read_model: path": anhyst.read_model,
}
PATH_VERBS: dict[str, Callable[[Any], object]] = {
    "verify: folder": anhyst.verify,
    "simulate: rig": anhyst.simulate,
    "tune: rig": lambda value: anhyst.tune(value, "new"),
    "force_control: rig": lambda value: anhyst.force_control(value, "new"),
    "excite: rig": lambda value: anhyst.excite(value, "new.csv"),
    "excite_to_calibrate: rig": lambda value: anhyst_rigs.excite_to_calibrate(value, "new.csv"),
    "calibrate: rig": lambda value: anhyst.calibrate(value, "run.csv"),
    "convert: source": lambda value: anhyst.convert(value, "new.csv"),
    "fleet: magnets": lambda value: anhyst.fleet(value, "new"),
    "live: rig": anhyst.live,
    "linearise: rig": anhyst_rigs.linearise,
}
WRONG = [3, 2.5, True, np.zeros(3), object(), [3], b"".join]


def refusal(verb: Callable[[Any], object], value: object) -> str:
    with pytest.raises(InputError) as caught:
        verb(value)
    return str(caught.value)


@pytest.mark.parametrize("argument", [*LOOP_VERBS, *MODEL_VERBS, *PATH_VERBS])
@pytest.mark.parametrize("value", WRONG, ids=lambda value: type(value).__name__)
def test_wrong_type_is_refused_with_the_name_of_the_argument(
    argument: str, value: object, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    verb = (LOOP_VERBS | MODEL_VERBS | PATH_VERBS)[argument]
    message = refusal(verb, value)
    assert message.startswith(f"{argument} must be ")
    assert message.endswith(type(value[0] if isinstance(value, list) else value).__name__) or (
        message.endswith("not list")
    )
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("argument", [*MODEL_VERBS, *PATH_VERBS])
def test_loops_are_refused_by_verbs_of_models_and_rigs(argument: str) -> None:
    assert refusal((MODEL_VERBS | PATH_VERBS)[argument], LOOPS).endswith(", not Loops")


@pytest.mark.parametrize("argument", LOOP_VERBS)
def test_a_model_is_refused_by_verbs_of_loops(argument: str) -> None:
    assert refusal(LOOP_VERBS[argument], MODEL).endswith(", not Model")


@pytest.mark.parametrize("argument", [*LOOP_VERBS, *MODEL_VERBS, *PATH_VERBS])
@pytest.mark.parametrize("value", ["", [], {}], ids=repr)
def test_empty_argument_is_refused_with_its_name(argument: str, value: object) -> None:
    message = refusal((LOOP_VERBS | MODEL_VERBS | PATH_VERBS)[argument], value)
    assert message.startswith(argument) or message.startswith("no loops are given")


COLUMNS = {
    "no rows": {"H_A_per_m": [], "B_T": []},
    "'H_A_per_m' must be an array": {"H_A_per_m": 1.0, "B_T": 2.0},
    "same number of rows": {"H_A_per_m": [0.0, 1.0, 0.0], "B_T": [0.0, 1.0]},
    "contains text": {"H_A_per_m": [object()] * 4, "B_T": [object()] * 4},
    "no measured value": {"H_A_per_m": [0.0, 1.0, np.nan, 0.0], "B_T": [0.0, 1.0, 2.0, 0.0]},
}


@pytest.mark.parametrize("text", COLUMNS)
def test_columns_that_hold_no_loop_are_refused_with_the_reason(text: str) -> None:
    assert text in refusal(anhyst.inspect, COLUMNS[text])


def test_inspect_accepts_a_path_a_folder_a_list_arrays_and_loops_alike(tmp_path: Path) -> None:
    path = LOOPS.save(tmp_path / "loops.csv")
    cleaned_loops = anhyst.clean(LOOPS, "dedupe")
    expected = anhyst.inspect(cleaned_loops).as_dict()["verdict"]
    for source in (path, str(path), tmp_path, [path], ARRAYS, cleaned_loops):
        assert anhyst.inspect(source).as_dict()["verdict"] == expected


def test_identify_reads_a_path_as_the_command_line_does(tmp_path: Path) -> None:
    path = tmp_path / "odd.csv"
    rows = zip(FIELD, ARRAYS["B_T"], strict=True)
    path.write_text("f,out\n" + "".join(f"{h},{b}\n" for h, b in rows))
    columns = {"f": "H_A_per_m", "out": "B_T"}
    model = anhyst.identify(path, columns=columns, law="effective-field", history="settled").model
    model.save(tmp_path / "python.toml")
    text = "f=H_A_per_m,out=B_T"
    options = ["--columns", text, "--law", "effective-field", "--history", "settled"]
    assert main(["identify", str(path), "--out", str(tmp_path / "cli.toml"), *options]) == 0
    assert (tmp_path / "python.toml").read_bytes() == (tmp_path / "cli.toml").read_bytes()


def test_reading_options_are_checked() -> None:
    with pytest.raises(TypeError, match=r"inspect\(\) got an unexpected keyword argument 'colums'"):
        anhyst.inspect(ARRAYS, colums={})
    assert "columns must be a dict" in refusal(lambda x: anhyst.inspect(ARRAYS, columns=x), "I=I_A")
    assert "already" in refusal(lambda x: anhyst.inspect(LOOPS, columns=x), {"I": "I_A"})
    assert "clean must be" in refusal(lambda x: anhyst.identify(ARRAYS, clean=x), 3)
    assert "'drfit' is not known" in refusal(lambda x: anhyst.inspect(ARRAYS, clean=x), "drfit")
    assert "turning points" in refusal(lambda x: anhyst.inspect(ARRAYS, history=x), 3)


def test_history_accepts_turning_points() -> None:
    points = [0.0, 200.0, 0.0]
    text = "conditioned:0,200,0"
    field = np.linspace(0.0, 50.0, 20)
    expected = MODEL(field, history=text)
    assert not np.array_equal(expected, MODEL(field, history="demagnetised"))
    assert np.array_equal(MODEL(field, history=points), expected)
    assert np.array_equal(MODEL.predict(field, history=np.array(points)).output, expected)
    demand = MODEL.inverse(expected, history=points)
    assert np.allclose(demand, field, atol=1e-3)
    stepper = MODEL.stepper(history=points)
    assert stepper.follow(field, np.zeros(20)) == pytest.approx(expected)
    for read_set in (anhyst.read_loops(ARRAYS, history=points), LOOPS.with_history(points)):
        assert str(read_set[0].history) == "conditioned:0.0,200.0,0.0"
    run = anhyst.predict(MODEL, {"H_A_per_m": field}, history=points)
    assert np.array_equal(run.to_columns()["B_T"], expected)


def test_predict_accepts_arrays_and_loops_and_gives_a_data_frame(tmp_path: Path) -> None:
    run = anhyst.predict(MODEL, LOOPS, history="settled")
    assert run.out is None
    assert run.deviation is not None
    assert run.deviation.worst == pytest.approx(0.0, abs=1e-9)
    frame = run.to_dataframe()
    assert list(frame.columns) == ["loop", "H_A_per_m", "B_T", "B_model_T", "valid"]
    file_result = anhyst.predict(MODEL, LOOPS.save(tmp_path / "in.csv"), tmp_path / "out.csv")
    assert (
        run.save(tmp_path / "own.csv").read_text().splitlines()[0]
        == ((tmp_path / "out.csv").read_text().splitlines()[0])
    )
    assert file_result.out == str(tmp_path / "out.csv")
    back = anhyst.invert(MODEL, {"B_T": [0.0, 0.1, 0.2]}, history="demagnetised")
    assert MODEL(back.to_columns()["H_A_per_m"], history="demagnetised") == pytest.approx(
        [0.0, 0.1, 0.2], abs=1e-6
    )


def test_report_accepts_a_model(tmp_path: Path) -> None:
    warnings = anhyst.report(MODEL, tmp_path / "report.html")
    assert "core" in (tmp_path / "report.html").read_text()
    assert any("written from the model" in text for text in warnings)


def loops_of_two() -> Loops:
    wide_loop = Loop("wide", FIELD, ARRAYS["B_T"])
    return Loops((wide_loop, Loop("small", 0.5 * FIELD, ARRAYS["B_T"])), LOOPS.input, LOOPS.output)


def test_loops_iterate_and_index_by_label_and_position() -> None:
    loops = loops_of_two()
    assert len(loops) == 2
    assert loops.labels == ("wide", "small")
    assert [loop.label for loop in loops] == ["wide", "small"]
    assert loops["small"] is loops[1] is loops[-1] is loops.loops[1]
    assert refusal(loops.__getitem__, "big") == "no loop 'big'; there are: 'wide', 'small'"
    with pytest.raises(IndexError):
        loops[2]


def test_loops_of_one_label_at_several_gaps_are_ambiguous() -> None:
    loops_of_gaps = [Loop("1", FIELD, ARRAYS["B_T"], np.full(FIELD.size, gap)) for gap in (3e-4, 4e-4)]
    loops = Loops(tuple(loops_of_gaps), LOOPS.input, LOOPS.output, QUANTITIES["gap"])
    assert "2 loops are called '1'" in refusal(loops.__getitem__, "1")
    assert loops.at(4e-4)["1"] is loops_of_gaps[1]


def test_loops_show_a_row_for_each_loop_in_a_notebook() -> None:
    text = loops_of_two()._repr_html_()
    assert text.count("<tr>") == 4 + 3  # facts, and the head with two loops
    assert "<td>small</td>" in text
    many = Loops(tuple(Loop(f"<{n}>", FIELD, FIELD) for n in range(14)), LOOPS.input, LOOPS.output)
    assert "and 4 more loops" in many._repr_html_()
    assert "&lt;3&gt;" in many._repr_html_()


TEXTS = {
    '--columns "I=I_A,F [kN]=F_N"': 'columns={"I": "I_A", "F [kN]": "F_N"}',
    '--columns "x="': 'columns={"x": ""}',
    """--columns '"a,b"=I_A'""": 'columns={"a,b": "I_A"}',
    '--constants "gap_mm=0.4"': 'constants={"gap_mm": 0.4}',
    "--scale F=9.81": 'scale={"F": 9.81}',
    "--clean drift": 'clean=["drift"]',
    "use --gap-map auto or --law play-cells": 'use gap_map="auto" or law="play-cells"',
    "with --io q31, or give --kind full": 'with io="q31", or give kind="full"',
    "--rate: is missing": "rate: is missing",
    "leave --rig out; add --token": "leave known out; add token",
    "state it with --history, or": "state it with history, or",
    "'anhyst inspect --plot'": "anhyst.inspect(...) and plot",
    "a - b -- c": "a - b -- c",
}


@pytest.mark.parametrize("text", TEXTS)
def test_message_names_arguments_in_python(text: str) -> None:
    assert word_for_python(text) == TEXTS[text]
    assert word_for_python(TEXTS[text]) == TEXTS[text]
    error = InputError(f"file.csv: {text}", code="any")
    assert str(error) == f"file.csv: {TEXTS[text]}"
    assert str(error.with_location("place")) == f"place: file.csv: {TEXTS[text]}"
    with use_command_line_wording():
        assert str(error) == f"file.csv: {text}"


def test_command_line_and_python_name_the_same_remedy(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "odd.csv"
    path.write_text("coil current,force\n" + "".join(f"{n % 7},{n % 5}\n" for n in range(40)))
    assert main(["inspect", str(path)]) == 2
    assert "--columns" in capsys.readouterr().err
    message = refusal(anhyst.inspect, path)
    assert "--" not in message
    assert "columns={" in message


def test_counts_have_the_right_number() -> None:
    assert [count_text(n, "loop") for n in (0, 1, 2)] == ["0 loops", "1 loop", "2 loops"]
    assert count_text(2, "history") == "2 histories"
