"""Test that ``simulate`` rejects an invalid rig, controller or output path and writes nothing."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from anhyst.model.actuator import Model, read_model
from anhyst.model.writer import write_model
from anhyst.support.units import QUANTITIES
from tests.refusals import says
from tests.repository import ROOT

from .command import contents, quick, refused
from .records import model

EXAMPLE = ROOT / "examples" / "bearing"
RUN = ("simulate", "rig.toml", "--out", "out/run.csv")
OUTSIDE = "m, outside the travel of 0.00035 to 0.00055 m; lower it or move the stops"
LAW = 'kind = "law"\nmodel = "model.toml"\nflux_table = "flux.csv"'


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("rig.toml", "controller.toml", "loops.csv", "loops.toml"):
        shutil.copy(EXAMPLE / name, tmp_path)
    (tmp_path / "out").mkdir()
    return tmp_path


def change(path: Path, old: str, new: str) -> int:
    """Replace a piece of text and return the line number of the new text."""
    text = path.read_text()
    assert text.count(old) >= 1, old
    path.write_text(text.replace(old, new, 1))
    return text[: text.index(old)].count("\n") + new[: len(new) - len(new.lstrip())].count("\n") + 1


@pytest.mark.first(5)
@pytest.mark.parametrize(
    ("old", "new", "key", "message"),
    [
        pytest.param(
            "gap_m = 0.45e-3",
            "gap_m = 0.56e-3",
            "magnet[1].gap_m",
            "outside-travel magnet[1].gap_m: 0.00056 m; 0.00035; 0.00055 m",
            id="reference outside the travel",
        ),
        pytest.param(
            "also_gaps_m = [0.42e-3,",
            "also_gaps_m = [0.34e-3,",
            "case[1].also_gaps_m[1]",
            "outside-travel: 0.00034 m; 0.00035; 0.00055 m",
            id="another gap outside",
        ),
        pytest.param(
            "heights_m = [10e-6,",
            "heights_m = [300e-6,",
            "case[1].heights_m[1]",
            "outside-travel case[1].heights_m[1]: 0.00045 m; 0.0003; 0.0006 m; 0.00035; 0.00055 m",
            id="step outside",
        ),
        pytest.param(
            "amplitude_m = 20e-6",
            "amplitude_m = 200e-6",
            "case[3].amplitude_m",
            "outside-travel case[3].amplitude_m: 0.00025; 0.00065 m; 0.00035; 0.00055 m",
            id="trajectory outside",
        ),
        pytest.param(
            "force_N = 150.0",
            "force_N = 350.0",
            "load.force_N",
            "load-too-large load.force_N: 350 N; 298 N",
            id="load that no current carries",
        ),
        pytest.param(
            "forces_N = [20.0]",
            "forces_N = [160.0]",
            "case[2].forces_N[1]",
            "load-too-large case[2].forces_N[1]: 150 N; 310 N; 298 N",
            id="load step that no current carries",
        ),
        pytest.param(
            "force_N = 150.0",
            "force_N = 0.0",
            "load.force_N",
            "out-of-range load.force_N: 0.00045 m; 298 N",
            id="no load",
        ),
        pytest.param(
            "bandwidth_Hz = 2500.0",
            "bandwidth = 2500.0",
            "amplifier[1].bandwidth",
            "unit-missing amplifier[1].bandwidth: bandwidth_Hz",
            id="unit left out",
        ),
        pytest.param(
            "mass_kg = 2.0",
            "mass = 2.0",
            "body[1].mass",
            "unit-missing: mass_kg",
            id="unit of the mass left out",
        ),
        pytest.param(
            "substeps = 4", "sub_steps = 4", "timing.sub_steps", "extra-forbidden: substeps", id="unknown key"
        ),
        pytest.param("[spread]", "[spred]", "spred", "extra-forbidden spred: spread", id="unknown table"),
        pytest.param(
            "force_N = 150.0", "force_N = nan", "load.force_N", "finite-number load.force_N", id="no number"
        ),
        pytest.param("delay_ticks = 1.0", "delay_ticks = 1.1", "timing", "delay-not-whole: 1.1", id="delay"),
        pytest.param(
            "force_N = 150.0",
            "force_N = 1.0",
            "load.force_N",
            "out-of-range load.force_N: 0.187365 A; 0..4.5 A",
            id="weak load",
        ),
        pytest.param(
            "force_N = 150.0",
            "force_N = 245.0",
            "load.force_N",
            "load-too-large load.force_N: 245 N; 0.00055 m; 241 N",
            id="load that is not lifted",
        ),
        pytest.param(
            "hold_s = 0.06",
            "hold_s = 0.0003",
            "case[1].hold_s",
            "too-short case[1].hold_s: 20000 s; 0.0004 s",
            id="short hold",
        ),
        pytest.param(
            "frequency_Hz = 1.0",
            "frequency_Hz = 2000.0",
            "case[3].frequency_Hz",
            "out-of-range case[3].frequency_Hz: 2000 Hz",
            id="fast trajectory",
        ),
        pytest.param(
            "frequency_Hz = 1.0",
            "frequency_Hz = 0.01",
            "case[3].frequency_Hz",
            "out-of-range case[3].frequency_Hz: 100 s",
            id="slow trajectory",
        ),
        pytest.param("seed = 11 ", "seed = 2147483648 ", "seed", "less-than seed: 2147483648", id="seed"),
        pytest.param(
            "range_T = 2.0",
            "range_T = 1.4",
            "sensor[4].range_T",
            "range-too-narrow sensor[4].range_T: 1.416 T; 0.00035 m",
            id="probe",
        ),
        pytest.param(
            'kind = "levitation"',
            'kind = "levitation"\nbias_N = 80.0',
            "control.bias_N",
            "pair-only control.bias_N",
            id="pair without its second magnet",
        ),
    ],
)
def test_a_key_of_the_rig_that_will_not_do(folder: Path, old: str, new: str, key: str, message: str) -> None:
    line = change(folder / "rig.toml", old, new)
    refusal = refused(*RUN, cwd=folder)
    line += new.count("\n")
    assert refusal.startswith(f"rig.toml:{line}") or key == "timing"
    assert f": {key}: " in refusal
    assert says(refusal, message)


@pytest.mark.first(3)
@pytest.mark.parametrize(
    ("old", "new", "key", "message"),
    [
        pytest.param(
            "rate_Hz = 20000.0",
            "rate_Hz = 10000.0",
            "rate_Hz",
            "differs-from-rig rate_Hz: 10000 Hz; 20000 Hz; rig.toml",
            id="another rate",
        ),
        pytest.param(
            "cutoff_Hz",
            "cutoff",
            "filter.cutoff",
            "extra-forbidden filter.cutoff: cutoff_Hz",
            id="unit left out",
        ),
        pytest.param(
            "mass_kg", "mass", "design.mass", "unit-missing: mass_kg", id="unit of the mass left out"
        ),
        pytest.param(
            "[lift_off]", "[liftoff]", "liftoff", "extra-forbidden liftoff: lift_off", id="unknown table"
        ),
        pytest.param(
            '"full"',
            '"ful"',
            "compensation.variant",
            "literal-error compensation.variant: 'ratio'; 'full'; 'ful'",
            id="unknown variant",
        ),
        pytest.param(
            "current_high_A = 4.5",
            "current_high_A = 6.0",
            "limits.current_high_A",
            "beyond-amplifier limits.current_high_A: rig.toml; 4.5 A",
            id="current",
        ),
        pytest.param(
            "force_high_N = 300.0",
            "force_high_N = 140.0",
            "limits.force_high_N",
            "load-not-lifted limits.force_high_N: 140 N; rig.toml; 150 N",
            id="force",
        ),
        pytest.param(
            "step_m = 20e-6",
            "step_m = 40e-9",
            "limits.step_m",
            "step-too-fine limits.step_m: rig.toml; 5e-08 m",
            id="step",
        ),
        pytest.param(
            "force_rate_N_per_s = 1000.0",
            "force_rate_N_per_s = 1.0",
            "lift_off.force_rate_N_per_s",
            "too-slow lift_off.force_rate_N_per_s: 300.2 s",
            id="slow lift",
        ),
        pytest.param(
            "gap_high_m = 0.57e-3",
            "gap_high_m = 0.5e-3",
            "limits.gap_high_m",
            "gaps-not-covered limits.gap_high_m: rig.toml; 0.00055 m",
            id="gap",
        ),
    ],
)
def test_a_key_of_the_controller_that_will_not_do(
    folder: Path, old: str, new: str, key: str, message: str
) -> None:
    line = change(folder / "controller.toml", old, new)
    refusal = refused(*RUN, cwd=folder)
    assert refusal.startswith(f"controller.toml:{line}: {key}: ")
    assert says(refusal, message)


def test_a_sample_rate_that_is_too_slow_for_the_plant(folder: Path) -> None:
    line = change(folder / "rig.toml", "rate_Hz = 20000.0", "rate_Hz = 1500.0")
    change(folder / "controller.toml", "rate_Hz = 20000.0", "rate_Hz = 1500.0")
    for key in ("cutoff_Hz", "cutoff_2_Hz"):
        change(folder / "controller.toml", f"{key} = 2000.0", f"{key} = 500.0")
    assert says(
        refused(*RUN, cwd=folder), f"rate-too-low: rig.toml:{line}: timing.rate_Hz: 1500; 87.92; 1759"
    )


def test_measured_flux_without_a_probe(folder: Path) -> None:
    rig = folder / "rig.toml"
    text = rig.read_text()
    rig.write_text(
        text[: text.index("[[sensor]]", text.index('of = "force"'))] + text[text.index("[load]") :]
    )
    line = change(folder / "controller.toml", '"full"', '"flux"')
    assert says(
        refused(*RUN, cwd=folder), f"no-hall-probe: controller.toml:{line}; compensation.variant; rig.toml"
    )


def table(
    skip: tuple[int, int] | None = None,
    zero: tuple[int, int] | None = None,
    most: float = 4.5,
    least: float = 0.3e-3,
) -> str:
    """A flux table of four currents and three gaps, optionally with a fault."""
    rows = ["I_A,gap_m,psi_Wb"]
    for i, j in ((i, j) for i in range(4) for j in range(3)):
        current, gap = most * i / 3.0, least + (0.6e-3 - least) * j / 2.0
        psi = 0.0 if (i, j) == zero else 9e-6 * current / gap
        rows += [] if (i, j) == skip else [f"{current},{gap},{psi}"]
    return "\n".join(rows) + "\n"


@pytest.mark.parametrize(
    ("text", "message"),
    [
        pytest.param(table(skip=(2, 1)), "grid-has-holes: 0.45 mm", id="hole"),
        pytest.param(table(zero=(2, 1)), "not-monotone: line 9; 0.45 mm", id="not monotone"),
        pytest.param(table(most=3.0), "currents-not-covered I_A: 4.5 A", id="too few currents"),
        pytest.param(
            table(least=0.4e-3),
            "gaps-not-covered gap_m: 0.0004; 0.0006 m; 0.00035; 0.00055 m",
            id="too few gaps",
        ),
        pytest.param("I_A,gap_m\n0,1e-3\n", "column-missing", id="no flux"),
        pytest.param(None, "no-such-file", id="missing"),
    ],
)
def test_a_flux_table_that_will_not_do(folder: Path, text: str | None, message: str) -> None:
    change(folder / "rig.toml", 'kind = "electromagnet"', LAW)
    if text is not None:
        (folder / "flux.csv").write_text(text)
    refusal = refused(*RUN, cwd=folder)
    assert refusal.startswith("flux.csv: ")
    assert says(refusal, message)


def write_spoilt(folder: Path, spoil: Callable[[Model], Model]) -> None:
    """Write a valid model of a magnet after it was changed."""
    path = folder / "model.toml"
    path.write_text(model())
    write_model(spoil(read_model(path)), path)


def piezo(model: Model) -> Model:
    return replace(model, input=QUANTITIES["voltage"], output=QUANTITIES["displacement"])


def of_1986(model: Model) -> Model:
    return replace(model, law="jiles-atherton-1986")


@pytest.mark.parametrize(
    ("spoil", "message"),
    [pytest.param(of_1986, "no-fixed-point-form: 'jiles-atherton-1986'", id="law of 1986")],
)
def test_a_model_that_cannot_be_compiled(folder: Path, spoil: Callable[[Model], Model], message: str) -> None:
    write_spoilt(folder, spoil)
    change(folder / "controller.toml", '"full"', '"full"\nmodel = "model.toml"')
    refusal = refused(*RUN, cwd=folder)
    assert refusal.startswith("model.toml: ")
    assert says(refusal, message)


@pytest.mark.parametrize("variant", ["full", "single-valued"])
def test_a_model_of_another_device(folder: Path, variant: str) -> None:
    write_spoilt(folder, piezo)
    change(folder / "controller.toml", '"full"', f'"{variant}"\nmodel = "model.toml"')
    assert says(refused(*RUN, cwd=folder), "not-current-to-force: model.toml; loops.csv")


def test_a_model_of_another_device_makes_no_force(folder: Path) -> None:
    write_spoilt(folder, piezo)
    (folder / "flux.csv").write_text(table())
    change(folder / "rig.toml", 'kind = "electromagnet"', LAW)
    assert says(refused(*RUN, cwd=folder), "not-current-to-force: model.toml")


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
    message = refused(*RUN, cwd=folder)
    assert says(message, "columns-missing: loops.csv")
    rows = text.splitlines(keepends=True)
    loops.write_text("".join(row for row in rows if ",0.00035," not in row and ",0.00042," not in row))
    message = refused(*RUN, cwd=folder)
    assert says(message, "gaps-not-covered: loops.csv; 0.00048; 0.00055 m; rig.toml; 0.00045 m")


@pytest.mark.parametrize("name", ["loops.csv", "controller.toml", "rig.toml"])
def test_a_missing_file_is_refused(folder: Path, name: str) -> None:
    (folder / name).unlink()
    place = "rig.toml:16: loops.files: " if name == "loops.csv" else ""
    assert says(refused(*RUN, cwd=folder), f"no-such-file: {place}{name}")


def test_a_missing_named_file_is_refused(folder: Path) -> None:
    message = refused(*RUN, "--controller", "other.toml", cwd=folder)
    assert says(message, "no-such-file: other.toml")
    change(folder / "controller.toml", 'variant = "full"', 'variant = "full"\nmodel = "m.toml"')
    assert says(refused(*RUN, cwd=folder), "no-such-file: m.toml")


def test_files_of_another_kind(folder: Path) -> None:
    message = refused("simulate", "controller.toml", "--out", "out/run.csv", cwd=folder)
    assert says(message, "wrong-kind: controller.toml: this is a controller file; simulate")
    message = refused(*RUN, "--controller", "rig.toml", cwd=folder)
    assert says(message, "wrong-kind: rig.toml: this is a bearing; controller file")
    message = refused("simulate", "loops.csv", "--out", "out/run.csv", cwd=folder)
    assert says(message, "wrong-kind: loops.csv: this is a measurement; simulate")


@pytest.mark.parametrize(
    ("out", "message"),
    [
        pytest.param("out/run.txt", "wrong-ending: out/run.txt", id="another ending"),
        pytest.param("out/run", "wrong-ending", id="no ending"),
        pytest.param("none/run.csv", "cannot-be-written: none/run.csv", id="no folder"),
        pytest.param("loops.csv", "writes-over-input: loops.csv", id="what is read"),
    ],
)
def test_a_place_that_will_not_do(folder: Path, out: str, message: str) -> None:
    assert says(refused("simulate", "rig.toml", "--out", out, cwd=folder), message)


@pytest.mark.parametrize("name", ["run.csv", "figures.json", "report.html"])
def test_a_folder_at_the_path_of_an_output_is_refused(folder: Path, name: str) -> None:
    (folder / "out" / name).mkdir()
    message = refused(*RUN, cwd=folder)
    assert says(message, f"cannot-be-written: out/{name}")


def test_gains_that_do_not_hold_the_armature_are_a_negative_result(folder: Path) -> None:
    """Exit code 1 and one line with the time; only the recording is written."""
    (folder / "model.toml").write_text(model())
    change(folder / "controller.toml", 'variant = "full"', 'variant = "single-valued"\nmodel = "model.toml"')
    change(folder / "controller.toml", "damping = 1.0", "damping = 0.02")
    before = contents(folder)
    result = quick(*RUN, cwd=folder)
    assert result.returncode == 1, result
    assert result.stdout == ""
    (line,) = result.stderr.splitlines()
    assert line.startswith("anhyst: levitation was lost at ") or line.startswith("anhyst: ")
    assert "the gains do not stabilise this bearing; the recording is kept in out/run.csv" in line
    assert set(contents(folder)) - set(before) == {"out/run.csv"}
    assert contents(folder)["out/run.csv"]


def test_nothing_shows_progress_in_a_pipe(folder: Path) -> None:
    change(folder / "rig.toml", "force_N = 150.0", "force_N = 350.0")
    result = quick(*RUN, cwd=folder)
    assert result.returncode == 2
    assert len(result.stderr.splitlines()) == 1
    assert "Traceback" not in result.stderr
