"""What ``simulate`` says to a rig, a controller or a place that will not do; nothing is written."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from anhyst.model.actuator import Model
from anhyst.model.file import read_model
from anhyst.model.writer import write_model
from anhyst.support.units import QUANTITIES

from .command import anhyst, contents, quick, refused
from .records import model

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "bearing"
RUN = ("simulate", "rig.toml", "--out", "out/run.csv")
OUTSIDE = "m, outside the travel of 0.00035 to 0.00055 m; lower it or move the stops"
LAW = '[magnet.model]\nfile = "model.toml"\nflux_table = "flux.csv"\n\n[amplifier]'


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("rig.toml", "controller.toml", "loops.csv", "loops.toml"):
        shutil.copy(EXAMPLE / name, tmp_path)
    (tmp_path / "out").mkdir()
    return tmp_path


def change(path: Path, old: str, new: str) -> int:
    """Change a piece of text and return the line of what is new."""
    text = path.read_text()
    assert text.count(old) >= 1, old
    path.write_text(text.replace(old, new, 1))
    return text[: text.index(old)].count("\n") + new[: len(new) - len(new.lstrip())].count("\n") + 1


@pytest.mark.parametrize(
    ("old", "new", "key", "said"),
    [
        pytest.param("gap_m = 0.45e-3", "gap_m = 0.56e-3", "simulate.gap_m",
                     f"the reference is at 0.00056 {OUTSIDE}; wrong as well: ",
                     id="reference outside the travel"),
        pytest.param("also_gaps_m = [0.42e-3,", "also_gaps_m = [0.34e-3,",
                     "simulate.also_gaps_m[1]", f"the reference is at 0.00034 {OUTSIDE}",
                     id="another gap outside"),
        pytest.param("steps_m = [10e-6,", "steps_m = [300e-6,", "simulate.steps_m[1]",
                     f"the step around 0.00045 m is at 0.0003 to 0.0006 {OUTSIDE}",
                     id="step outside"),
        pytest.param("trajectories = [{ kind = \"triangle\", amplitude_m = 20e-6",
                     "trajectories = [{ kind = \"triangle\", amplitude_m = 200e-6",
                     "simulate.trajectories[1].amplitude_m",
                     f"the reference is at 0.00025 to 0.00065 {OUTSIDE}", id="trajectory outside"),
        pytest.param("force_N = 150.0", "force_N = 350.0", "load.force_N", "no current can carry "
                     "350 N, the magnet reaches 298 N; lower it or raise current_high_A",
                     id="load that no current carries"),
        pytest.param("load_steps_N = [20.0]", "load_steps_N = [160.0]", "simulate.load_steps_N[1]",
                     "150 N and this step are 310 N, the magnet reaches 298 N; lower it",
                     id="load step that no current carries"),
        pytest.param("force_N = 150.0", "force_N = 0.0", "load.force_N", "0 N is not within what "
                     "the magnet pulls at 0.00045 m, 0 to 298 N; correct it", id="no load"),
        pytest.param("bandwidth_Hz = 2500.0", "bandwidth = 2500.0", "amplifier.bandwidth",
                     "lacks its unit; write bandwidth_Hz", id="unit left out"),
        pytest.param("mass_kg = 2.0", "mass = 2.0", "mechanics.mass", "lacks its unit; write "
                     "mass_kg", id="unit of the mass left out"),
        pytest.param("substeps = 4", "sub_steps = 4", "timing.sub_steps",
                     "is unknown; did you mean substeps?", id="unknown key"),
        pytest.param("[hall_probe]", "[hal_probe]", "hal_probe",
                     "is unknown; did you mean hall_probe?", id="unknown table"),
        pytest.param("force_N = 150.0", "force_N = nan", "load.force_N",
                     "must be a finite number, is nan", id="no number"),
        pytest.param("delay_ticks = 1.0", "delay_ticks = 1.1", "timing", "delay_ticks of 1.1 is no "
                     "whole number of sub-steps of 1/4 tick; correct one of them", id="delay"),
        pytest.param("force_N = 150.0", "force_N = 1.0", "load.force_N", "at 1 N the current of "
                     "0.187365 A is not well within 0..4.5 A; raise or lower it", id="weak load"),
        pytest.param("force_N = 150.0", "force_N = 245.0", "load.force_N", "no current lifts 245 N "
                     "off the rest at 0.00055 m, the magnet reaches 241 N there; lower it, lower "
                     "stop_high_m or raise current_high_A", id="load that is not lifted"),
        pytest.param("hold_s = 0.06", "hold_s = 0.0003", "simulate.hold_s", "holds a step for 6 "
                     "ticks of 1/20000 s; 8 at least, 0.0004 s", id="short hold"),
        pytest.param("frequency_Hz = 1.0", "frequency_Hz = 2000.0",
                     "simulate.trajectories[1].frequency_Hz", "2000 Hz is not below a tenth of "
                     "rate_Hz, 2000 Hz; lower it", id="fast trajectory"),
        pytest.param("frequency_Hz = 1.0", "frequency_Hz = 0.01",
                     "simulate.trajectories[1].frequency_Hz", "a period of 100 s is longer than "
                     "60 s; raise it", id="slow trajectory"),
        pytest.param("seed = 11 ", "seed = 2147483648 ", "seed", "must be less than 2147483648",
                     id="seed"),
        pytest.param("range_T = 2.0", "range_T = 1.4", "hall_probe.range_T", "the largest current "
                     "makes 1.416 T at a gap of 0.00035 m; raise it", id="probe"),
        pytest.param('arrangement = "single"', 'arrangement = "pair"', "magnet",
                     "a pair needs gap_total_m; add it", id="pair without its gap"),
    ],
)  # fmt: skip
def test_a_key_of_the_rig_that_will_not_do(
    folder: Path, old: str, new: str, key: str, said: str
) -> None:
    line = change(folder / "rig.toml", old, new)
    refusal = refused(*RUN, cwd=folder)
    place = "" if key in ("timing", "magnet") else f":{line}"
    assert refusal.startswith(f"rig.toml{place}") or key in ("timing", "magnet")
    assert f": {key}: {said}" in refusal


@pytest.mark.parametrize(
    ("old", "new", "key", "said"),
    [
        pytest.param("rate_Hz = 20000.0", "rate_Hz = 10000.0", "rate_Hz", "is 10000 Hz here and "
                     "20000 Hz in rig.toml; make them equal", id="another rate"),
        pytest.param("cutoff_Hz", "cutoff", "filter.cutoff", "is unknown; did you mean cutoff_Hz?",
                     id="unit left out"),
        pytest.param("mass_kg", "mass", "design.mass", "lacks its unit; write mass_kg",
                     id="unit of the mass left out"),
        pytest.param("[lift_off]", "[liftoff]", "liftoff", "is unknown; did you mean lift_off?",
                     id="unknown table"),
        pytest.param('"full"', '"ful"', "compensation.variant", "must be 'ratio', 'secant', "
                     "'linearised', 'single-valued', 'play', 'simplified', 'full' or 'flux', is "
                     "'ful'",
                     id="unknown variant"),
        pytest.param("current_high_A = 4.5", "current_high_A = 6.0", "limits.current_high_A",
                     "the amplifier of rig.toml ends at 4.5 A; lower it", id="current"),
        pytest.param("force_high_N = 300.0", "force_high_N = 140.0", "limits.force_high_N",
                     "140 N do not lift the load of rig.toml, 150 N; raise it", id="force"),
        pytest.param("step_m = 20e-6", "step_m = 40e-9", "limits.step_m", "the position sensor of "
                     "rig.toml has steps of 5e-08 m; raise it", id="step"),
        pytest.param("force_rate_N_per_s = 1000.0", "force_rate_N_per_s = 1.0",
                     "lift_off.force_rate_N_per_s",
                     "lifting off takes 300.2 s, at most 60 s are simulated; raise it",
                     id="slow lift"),
        pytest.param("gap_high_m = 0.57e-3", "gap_high_m = 0.5e-3", "limits.gap_high_m",
                     "rig.toml rests at a gap of 0.00055 m; raise it", id="gap"),
    ],
)  # fmt: skip
def test_a_key_of_the_controller_that_will_not_do(
    folder: Path, old: str, new: str, key: str, said: str
) -> None:
    line = change(folder / "controller.toml", old, new)
    assert refused(*RUN, cwd=folder).startswith(f"controller.toml:{line}: {key}: {said}")


def test_a_sample_rate_that_is_too_slow_for_the_plant(folder: Path) -> None:
    line = change(folder / "rig.toml", "rate_Hz = 20000.0", "rate_Hz = 1500.0")
    change(folder / "controller.toml", "rate_Hz = 20000.0", "rate_Hz = 1500.0")
    for key in ("cutoff_Hz", "cutoff_2_Hz"):
        change(folder / "controller.toml", f"{key} = 2000.0", f"{key} = 500.0")
    assert refused(*RUN, cwd=folder) == (
        f"rig.toml:{line}: timing.rate_Hz: 1500 Hz is too slow for a plant whose unstable pole "
        "lies at 87.92 Hz; use at least 20 times that, 1759 Hz"
    )


def test_measured_flux_without_a_probe(folder: Path) -> None:
    rig = folder / "rig.toml"
    text = rig.read_text()
    rig.write_text(text[: text.index("[hall_probe]")] + text[text.index("[measurement]") :])
    line = change(folder / "controller.toml", '"full"', '"flux"')
    assert refused(*RUN, cwd=folder) == (
        f'controller.toml:{line}: compensation.variant: "flux" needs the table [hall_probe], '
        "rig.toml has none; add it"
    )


def table(skip: tuple[int, int] | None = None, zero: tuple[int, int] | None = None,
          most: float = 4.5, least: float = 0.3e-3) -> str:  # fmt: skip
    """A flux table of four currents and three gaps, perhaps with a fault."""
    rows = ["I_A,gap_m,psi_Wb"]
    for i, j in ((i, j) for i in range(4) for j in range(3)):
        current, gap = most * i / 3.0, least + (0.6e-3 - least) * j / 2.0
        psi = 0.0 if (i, j) == zero else 9e-6 * current / gap
        rows += [] if (i, j) == skip else [f"{current},{gap},{psi}"]
    return "\n".join(rows) + "\n"


@pytest.mark.parametrize(
    ("text", "said"),
    [
        pytest.param(table(skip=(2, 1)), "has a hole at 0.45 mm, 3 A; 3 gaps and 4 currents must "
                     "make a full grid, add what is missing", id="hole"),
        pytest.param(table(zero=(2, 1)), "line 9: psi does not rise with the current at 0.45 mm, "
                     "3 A; correct this point", id="not monotone"),
        pytest.param(table(most=3.0), "I_A ends at 3 A and the amplifier at 4.5 A; add currents",
                     id="too few currents"),
        pytest.param(table(least=0.4e-3), "gap_m runs from 0.0004 to 0.0006 m and must hold the "
                     "travel, 0.00035 to 0.00055 m; add gaps", id="too few gaps"),
        pytest.param("I_A,gap_m\n0,1e-3\n", "has no column of flux linkage", id="no flux"),
        pytest.param(None, "no such file; check the path", id="missing"),
    ],
)  # fmt: skip
def test_a_flux_table_that_will_not_do(folder: Path, text: str | None, said: str) -> None:
    change(folder / "rig.toml", 'force = "cells"', 'force = "model"')
    change(folder / "rig.toml", "[amplifier]", LAW)
    if text is not None:
        (folder / "flux.csv").write_text(text)
    assert refused(*RUN, cwd=folder).startswith(f"flux.csv: {said}")


def write_spoilt(folder: Path, spoil: Callable[[Model], Model]) -> None:
    """Write a good model of a magnet after something was done to it."""
    path = folder / "model.toml"
    path.write_text(model())
    write_model(spoil(read_model(path)), path)


def piezo(model: Model) -> Model:
    return replace(model, input=QUANTITIES["voltage"], output=QUANTITIES["displacement"])


def with_eddy_currents(model: Model) -> Model:
    return replace(model, parameters={**model.parameters, "gamma": 1.0})


def of_1986(model: Model) -> Model:
    return replace(model, law="jiles-atherton-1986")


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        pytest.param(with_eddy_currents, "gamma: eddy currents cannot be compiled; identify with "
                     "gamma = 0", id="eddy currents"),
        pytest.param(of_1986, "law 'jiles-atherton-1986' cannot be compiled: its step has no "
                     "closed form; identify with --law effective-field or --law play-cells or "
                     "--law play-cells-langevin", id="law of 1986"),
    ],
)  # fmt: skip
def test_a_model_that_cannot_be_compiled(
    folder: Path, spoil: Callable[[Model], Model], said: str
) -> None:
    write_spoilt(folder, spoil)
    change(folder / "controller.toml", '"full"', '"full"\nmodel = "model.toml"')
    assert refused(*RUN, cwd=folder) == f"model.toml: {said}"


@pytest.mark.parametrize("variant", ["full", "single-valued"])
def test_a_model_of_another_device(folder: Path, variant: str) -> None:
    write_spoilt(folder, piezo)
    change(folder / "controller.toml", '"full"', f'"{variant}"\nmodel = "model.toml"')
    assert refused(*RUN, cwd=folder) == (
        "model.toml: a bearing needs a model of force over current and gap; identify one from "
        "loops.csv"
    )


def test_a_model_of_another_device_makes_no_force(folder: Path) -> None:
    write_spoilt(folder, piezo)
    (folder / "flux.csv").write_text(table())
    change(folder / "rig.toml", 'force = "cells"', 'force = "model"')
    change(folder / "rig.toml", "[amplifier]", LAW)
    assert refused(*RUN, cwd=folder) == (
        "model.toml: a bearing needs a model of force over current whose gap may move; identify "
        "one from loops at several gaps"
    )


def without(text: str, name: str) -> str:
    """Return a table without one of its columns."""
    remarks = [row for row in text.splitlines() if row.startswith("#")]
    rows = [row.split(",") for row in text.splitlines() if not row.startswith("#")]
    place = rows[0].index(name)
    return "\n".join([*remarks, *(",".join(row[:place] + row[place + 1 :]) for row in rows)]) + "\n"


def test_loops_without_gap_or_around_another_one(folder: Path) -> None:
    loops = folder / "loops.csv"
    text = loops.read_text()
    loops.write_text(without(text, "gap_m"))
    said = refused(*RUN, cwd=folder)
    assert said == "loops.csv: a rig needs columns I_A, F_N and gap_m"
    rows = text.splitlines(keepends=True)
    loops.write_text(
        "".join(row for row in rows if ",0.00035," not in row and ",0.00042," not in row)
    )
    said = refused(*RUN, cwd=folder)
    assert said == (
        "loops.csv: loops at gaps of 0.00048 to 0.00055 m, rig.toml works at 0.00045 m; measure "
        "loops around it"
    )


@pytest.mark.parametrize("name", ["loops.csv", "controller.toml", "rig.toml"])
def test_a_file_that_is_not_there(folder: Path, name: str) -> None:
    (folder / name).unlink()
    said = f"{name}: no such file; check the path"
    if name == "loops.csv":
        said = f"rig.toml:8: loops: {name}: no such file or folder; check the path"
    assert refused(*RUN, cwd=folder) == said


def test_a_named_file_that_is_not_there(folder: Path) -> None:
    said = refused(*RUN, "--controller", "other.toml", cwd=folder)
    assert said == "other.toml: no such file; check the path"
    change(folder / "controller.toml", 'variant = "full"', 'variant = "full"\nmodel = "m.toml"')
    assert refused(*RUN, cwd=folder) == "m.toml: no such file; check the path"


def test_files_of_another_kind(folder: Path) -> None:
    said = refused("simulate", "controller.toml", "--out", "out/run.csv", cwd=folder)
    assert said.startswith("controller.toml: this is a controller file; simulate is for bearings")
    said = refused(*RUN, "--controller", "rig.toml", cwd=folder)
    assert said.startswith("rig.toml: this is a bearing; a controller file is needed")
    said = refused("simulate", "loops.csv", "--out", "out/run.csv", cwd=folder)
    assert said.startswith("loops.csv: this is a measurement; simulate is for bearings")


@pytest.mark.parametrize(
    ("out", "said"),
    [
        pytest.param("out/run.txt", "out/run.txt: is written as .csv, .mat, .mf4, .tdms, .h5, "
                     ".hdf5, .parquet; name it so", id="another ending"),
        pytest.param("out/run", "out/run: is written as .csv, .mat, .mf4, .tdms, .h5, .hdf5, "
                     ".parquet; name it so", id="no ending"),
        pytest.param("none/run.csv", "none/run.csv: cannot be written: No such file or directory; "
                     "create the folder first", id="no folder"),
        pytest.param("loops.csv", "loops.csv: is read by this command; write to another file",
                     id="what is read"),
    ],
)  # fmt: skip
def test_a_place_that_will_not_do(folder: Path, out: str, said: str) -> None:
    assert refused("simulate", "rig.toml", "--out", out, cwd=folder) == said


@pytest.mark.parametrize("name", ["run.csv", "figures.json", "report.html"])
def test_a_folder_where_a_file_is_to_be(folder: Path, name: str) -> None:
    (folder / "out" / name).mkdir()
    said = refused(*RUN, cwd=folder)
    assert said == f"out/{name}: cannot be written: Is a directory; name a file in it"


def test_gains_that_do_not_hold_the_armature_are_a_negative_result(folder: Path) -> None:
    """Exit code 1, the time in one line, the recording kept and nothing else written."""
    (folder / "model.toml").write_text(model())
    change(
        folder / "controller.toml",
        'variant = "full"',
        'variant = "single-valued"\nmodel = "model.toml"',
    )
    change(folder / "controller.toml", "damping = 1.0", "damping = 0.02")
    before = contents(folder)
    result = quick(*RUN, cwd=folder)
    assert result.returncode == 1, result
    assert result.stdout == ""
    (line,) = result.stderr.splitlines()
    assert line.startswith("anhyst: levitation was lost at ") or line.startswith("anhyst: ")
    assert "the gains do not hold this bearing; the recording is kept in out/run.csv" in line
    assert set(contents(folder)) - set(before) == {"out/run.csv"}
    assert contents(folder)["out/run.csv"]


def test_nothing_shows_progress_in_a_pipe(folder: Path) -> None:
    change(folder / "rig.toml", "force_N = 150.0", "force_N = 350.0")
    result = anhyst(*RUN, cwd=folder)
    assert result.returncode == 2
    assert len(result.stderr.splitlines()) == 1
    assert "Traceback" not in result.stderr
