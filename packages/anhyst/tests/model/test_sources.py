"""Measurements are read for the report in the same way as for the identification."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from anhyst.data.clean import ReadOptions
from anhyst.data.loops import Loops
from anhyst.model.actuator import Model, read_model, read_sources
from anhyst.model.schema import Provenance
from anhyst.model.writer import write_model
from anhyst.support.units import QUANTITIES
from tests.refusals import refused

IRON = {"M_s": 1.3e6, "a": 400.0, "k": 300.0, "c": 0.15, "c_H": 9000.0, "c_out": 60.0}


def measured(folder: Path) -> Path:
    phase = np.linspace(0.0, 2.0 * np.pi, 101)
    current = 1.0 - np.cos(phase)
    force = np.maximum(10.0 * (current - 0.05 * np.sin(phase)) ** 2, 0.0)
    rows = [f"{i:.6f},{f:.6f}" for i, f in zip(current, force, strict=True)]
    path = folder / "loops.csv"
    path.write_text("\n".join(["X,F_N", *rows, rows[-1]]) + "\n")
    return path


def model_of(loops: Loops, options: ReadOptions) -> Model:
    model = Model(
        "m",
        QUANTITIES["current"],
        QUANTITIES["force"],
        IRON,
        provenance=Provenance("0.1.0", 1, loops.sources, {"search": "default"}),
    )
    return model.with_read_options(options)


def same(one: Loops, other: Loops) -> bool:
    return all(
        np.array_equal(a.input, b.input) and np.array_equal(a.output, b.output)
        for a, b in zip(one.loops, other.loops, strict=True)
    )


def test_measurements_come_back_as_they_were_read(tmp_path: Path) -> None:
    options = ReadOptions.from_text(
        columns="X=I_A", constants="gap_mm=0.4", history="settled", clean="dedupe, thin"
    )
    loops = options.read([measured(tmp_path)])
    assert loops.loops[0].n == 101  # without the repeated last row
    assert loops.schedule_values == (0.4e-3,)
    write_model(model_of(loops, options), tmp_path / "model.toml")
    again = read_sources(read_model(tmp_path / "model.toml"))
    assert same(again, loops)
    assert again.loops[0].history == loops.loops[0].history
    assert again.schedule_values == loops.schedule_values


def test_default_options_leave_no_trace() -> None:
    assert ReadOptions().as_settings() == {}
    assert ReadOptions.from_text(clean="none").as_settings() == {"read_clean": "none"}
    reported = ReadOptions.from_text(columns="a=b=I_A,c=", clean="drift", loop="n").as_settings()
    assert reported == {"read_columns": "a=b=I_A,c=", "read_clean": "drift", "read_loop": "n"}
    plain = {name.removeprefix("read_"): str(value) for name, value in reported.items()}
    assert ReadOptions.from_text(**plain).columns == {"a=b": "I_A", "c": ""}


def test_source_files_are_also_found_next_to_the_model(tmp_path: Path) -> None:
    options = ReadOptions.from_text(columns="X=I_A")
    path = measured(tmp_path)
    loops = options.read([path])
    model = model_of(loops, options)
    moved = tmp_path / "elsewhere"
    moved.mkdir()
    path.rename(moved / path.name)
    with refused("no-such-file: loops.csv"):
        read_sources(model)
    assert same(read_sources(model, moved), loops)


def test_files_that_have_changed_are_refused(tmp_path: Path) -> None:
    options = ReadOptions.from_text(columns="X=I_A")
    path = measured(tmp_path)
    model = model_of(options.read([path]), options)
    path.write_text(path.read_text().replace("0.0", "0.1", 1))
    with refused("source-changed"):
        read_sources(model)


def test_a_model_without_sources_is_reported(tmp_path: Path) -> None:
    options = ReadOptions.from_text(columns="X=I_A")
    model = model_of(options.read([measured(tmp_path)]), options)
    with refused("no-provenance provenance"):
        read_sources(replace(model, provenance=Provenance()))
    odd = replace(model.provenance, settings={"read_colour": "red"})
    with refused("extra-forbidden"):
        read_sources(replace(model, provenance=odd))


@pytest.mark.parametrize(
    ("texts", "reason"),
    [
        ({"columns": "I_A"}, "not-name-value columns: 'I_A'"),
        ({"columns": "a=I_A,a=F_N"}, "name-twice a"),
        ({"constants": "=3"}, "not-name-value constants: '=3'"),
    ],
)
def test_texts_of_the_wrong_form_are_refused(texts: dict[str, str], reason: str) -> None:
    with refused(reason):
        ReadOptions.from_text(**texts)
