"""Compare the compiled position controller with the simulated one, bit for bit."""

from __future__ import annotations

import json
import math
import re
import shutil
import subprocess
from pathlib import Path
from typing import Literal

import numpy as np
import pytest

from anhyst.cli.app import main
from anhyst.compensate.plan import CompileRequest
from anhyst.compilation.output import Compiled, compile_model
from anhyst.compilation.vectors import LEVITATION_COLUMNS, LEVITATION_INPUT_COUNT
from anhyst.control.controller_file import read_controller
from anhyst.data.reading import read_loops
from anhyst.model.actuator import read_model
from anhyst.support.states import Command, Flag, Phase, State
from anhyst_rigs.rig.bearing.loop import BearingSetup, make_setup
from anhyst_rigs.rig.bearing.scenario import ScenarioBuilder
from anhyst_rigs.rig.body import BodyRig, read_bearing
from anhyst_rigs.rig.fitting import IdentifiedMagnet
from anhyst_rigs.rig.loop import DROP_SAMPLE_BIT, Scenario, SimulatedLoop
from anhyst_rigs.rig.recording import Recording
from tests.compilation.packaged import undrawn  # noqa: F401 - a fixture
from tests.compilation.test_compile import compiles_alone_on_16_bits, sources_of
from tests.core.test_c_core import tool
from tests.refusals import says
from tests.repository import ROOT
from tests.study import bearings
from tests.truths import path_of

BEARING = ROOT / "examples" / "bearing"
RATE = 20e3
WARNINGS = "-std=c99 -O2 -Wall -Wextra -Wconversion -Wpedantic -Wshadow -Wdouble-promotion -Werror"
PAIR = ("gap_total_m = 0.9e-3", "bias_force_N = 100.0")


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Copy the bundled bearing with its identified model."""
    folder = tmp_path_factory.mktemp("bearing")
    for name in ("rig.toml", "controller.toml", "loops.csv", "loops.toml"):
        (folder / name).write_bytes((BEARING / name).read_bytes())
    shutil.copy(path_of("bearing"), folder / "model.toml")
    return folder


@pytest.fixture(scope="module")
def compiled(place: Path) -> Compiled:
    """Compile the bundled controller."""
    request = CompileRequest("full", "q31", RATE, name="bearing")
    return compile_model(place / "model.toml", place / "out", request, place / "controller.toml")


def built(folder: Path, compiler: str, program: Path) -> str:
    sources = sources_of(folder)
    options = [*WARNINGS.split(), f"-I{folder / 'include'}"]
    command = [tool(compiler), *options, *sources, "-o", str(program)]
    completed = subprocess.run(command, capture_output=True, text=True, check=False)
    assert completed.returncode == 0, completed.stderr
    return str(program)


def played(program: str, rows: str) -> str:
    """Run the example on rows of inputs; return its output."""
    completed = subprocess.run([program], input=rows, capture_output=True, text=True, check=False)
    assert completed.returncode in {0, 1}, completed.stderr
    return completed.stdout


def changed(place: Path, name: str, *pairs: tuple[str, str]) -> Path:
    """Write a controller file with replaced texts; return its path."""
    text = (place / "controller.toml").read_text()
    for old, new in pairs:
        assert text.count(old) == 1, old
        text = text.replace(old, new)
    (place / name).write_text(text)
    return place / name


@pytest.mark.slow
@pytest.mark.parametrize("compiler", ["cc", "clang"])
def test_the_c_compiles_without_warnings_and_gives_the_golden_outputs(
    compiled: Compiled, compiler: str, tmp_path: Path
) -> None:
    program = built(compiled.out, compiler, tmp_path / "example")
    vectors = (compiled.out / "controller.csv").read_text()
    rows = len(vectors.splitlines()) - 1
    assert played(program, vectors) == f"{rows} rows, 0 differ\n"
    for column in ("drive_1", "reference", "demand", "state", "flags"):
        lines = vectors.splitlines()
        cells = lines[700].split(",")
        cells[LEVITATION_COLUMNS.index(column)] = str(int(cells[LEVITATION_COLUMNS.index(column)]) ^ 1)
        lines[700] = ",".join(cells)
        assert played(program, "\n".join(lines)) == f"{rows} rows, 1 differ\n"


def test_every_file_compiles_alone_on_16_bits(compiled: Compiled) -> None:
    compiles_alone_on_16_bits(compiled.out)


@pytest.mark.slow
def test_generated_files_break_only_the_listed_misra_rules(compiled: Compiled) -> None:
    sources = sorted(compiled.out.glob("bearing_*.c"))
    options = ["--addon=misra", "--enable=style", "--quiet", "--std=c99", "-D__STDC__=1"]
    place = [f"-I{compiled.out / 'include'}", f"-I{compiled.out}", "--template={file} {id}"]
    command = [tool("cppcheck"), *options, *place, *map(str, sources)]
    completed = subprocess.run(command, capture_output=True, text=True, check=True)
    own = [line for line in completed.stderr.splitlines() if "/bearing_" in line]
    found = set(re.findall(r"misra-c2012-([\d.]+)", "\n".join(own)))
    assert found
    assert found <= {"2.5", "7.3", "8.7", "12.1", "15.5"}


def test_the_golden_run_lifts_steps_drops_a_sample_and_lands(compiled: Compiled) -> None:
    table = np.loadtxt(compiled.out / "controller.csv", delimiter=",", skiprows=1, dtype=np.int64)
    column = {name: table[:, i] for i, name in enumerate(LEVITATION_COLUMNS)}
    run = [16 * State.RUN + phase for phase in (1, 2, 3, 4, 5)]
    ready = 16 * State.READY + Phase.REST
    places = [0, *np.flatnonzero(np.diff(column["state"])) + 1]
    order = [int(column["state"][at]) for at in places]
    assert order == [16 * State.SELFTEST, 16 * State.IDLE, ready, *run, ready]
    hovering = column["state"] == 16 * State.RUN + Phase.HOVER
    assert np.unique(column["target"][hovering]).size == 2
    implausible = (column["flags"] & Flag.SAMPLE_IMPLAUSIBLE) > 0
    assert implausible.sum() == 2
    assert (column["dropped"] > 0).sum() == 1
    assert hovering[implausible].all()
    settled = np.flatnonzero(hovering)[-1]
    signal = compiled.manifest["controller"]["signals"]["position"]
    error = (column["position"] - column["target"])[settled] / 2.0**31 * signal["scale"]
    assert abs(error) < 1e-6


def test_currents_are_words_of_the_converter(compiled: Compiled) -> None:
    """Codes are exactly on the 16-bit grid of 0 to 4.5 A; amperes up to rounding of the scale."""
    table = np.loadtxt(compiled.out / "controller.csv", delimiter=",", skiprows=1, dtype=np.int64)
    current = compiled.manifest["controller"]["signals"]["current"]
    driven = table[:, LEVITATION_COLUMNS.index("drive_1")]
    assert (driven % current["step_codes"] == 0).all()
    amperes = driven / 2.0**31 * current["scale"]
    words = amperes / (4.5 / 65535.0)
    np.testing.assert_allclose(words, np.rint(words), atol=1e-6)
    assert amperes.min() >= 0.0
    assert amperes.max() <= 4.5


def pair_rig(place: Path) -> BodyRig:
    """Return the bundled bearing with a second magnet and less load."""
    text = (place / "rig.toml").read_text()
    text = bearings.pair_text(text, 100.0).replace("force_N = 150.0", "force_N = 60.0")
    (place / "pair.toml").write_text(text)
    return read_bearing(place / "pair.toml")


def eventful(setup: BearingSetup) -> Scenario:
    """Lift off, step, lose samples, land."""
    gap = setup.rig.settings.gap_m
    script = ScenarioBuilder(setup.rig, gap).lift_off(setup.controller)
    script.step(gap - 20e-6, 0.02).step(gap + 30e-6, 0.02)
    script.command(DROP_SAMPLE_BIT, 2).hold(0.01)
    script.command(Command.LAND)
    return script.hold(0.35).build()


def as_rows(recording: Recording, scenario: Scenario, compiled: Compiled) -> str:
    """Write inputs and outputs of a simulated controller as rows of ``controller.csv``."""
    signals = compiled.manifest["controller"]["signals"]
    middle = signals["position"]["zero_gap"]

    def code(value: float, name: str) -> int:
        scale: float = signals[name]["scale"]
        return math.floor(value / scale * 2.0**31 + 0.5)

    def position(gap: float) -> int:
        return 0 if math.isnan(gap) else code(middle - gap, "position")

    lines = [",".join(LEVITATION_COLUMNS)]
    for i, row in enumerate(recording.table):
        at = dict(zip(recording.columns, row.tolist(), strict=True))
        cells = [position(at["gap_read_m"]), position(float(scenario.target[i])), 0]
        # The port passes a measured current as q30: every second code.
        cells += [2 * code(at["current_read_A"] / 2.0, "current"), 0]
        cells.append(int(math.isnan(at["gap_read_m"])))
        cells.append(int(scenario.command[i]) & 0xFF)
        cells += [code(at["command_A"], "current"), code(at["command_2_A"], "current")]
        cells += [position(at["reference_m"]), code(at["demand_N"], "demand")]
        cells += [int(at["state"]), int(at["flags"])]
        lines.append(",".join(map(str, cells)))
    return "\n".join(lines) + "\n"


CASES: dict[str, tuple[Literal["full", "simplified"], list[tuple[str, str]]]] = {
    "full": ("full", []),
    "simplified, measured": (
        "simplified",
        [('variant = "full"', 'variant = "simplified"'), ('"reference"', '"measured"')],
    ),
    "full, a pair": (
        "full",
        [
            ("[safety]", "\n".join(["[pair]", *PAIR, "[safety]"])),
            ("force_low_N = 0.0", "force_low_N = -200.0"),
            ("force_high_N = 300.0", "force_high_N = 200.0"),
        ],
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    "case", [pytest.param(one, marks=[pytest.mark.campaign] * (one == "full")) for one in CASES]
)
def test_the_compiled_controller_replays_the_simulation_bit_for_bit(
    place: Path, case: str, tmp_path: Path
) -> None:
    """The C code of the folder gives the recorded outputs of the simulated loop bit for bit."""
    kind, changes = CASES[case]
    path = changed(place, "case.toml", *changes)
    rig = pair_rig(place) if "pair" in case else read_bearing(place / "rig.toml")
    model = read_model(place / "model.toml")
    known = IdentifiedMagnet(read_loops(place / "loops.csv"), model)
    setup = make_setup(rig, read_controller(path).settings, known, kind, "fixed")
    scenario = eventful(setup)
    recording = SimulatedLoop(setup, seed=3).run(scenario)
    flown = {int(state) for state in recording["state"]}
    assert {16 * State.RUN + phase for phase in (1, 2, 3, 4, 5)} <= flown
    assert recording["state"][-1] == 16 * State.READY
    assert np.isnan(recording["gap_read_m"]).sum() == 2

    request = CompileRequest(kind, "q31", RATE)
    compiled = compile_model(place / "model.toml", tmp_path / "out", request, path)
    program = built(compiled.out, "cc", tmp_path / "example")
    rows = as_rows(recording, scenario, compiled)
    assert played(program, rows) == f"{scenario.ticks} rows, 0 differ\n"


@pytest.mark.slow
def test_same_inputs_give_the_same_bytes(place: Path, compiled: Compiled, tmp_path: Path) -> None:
    request = CompileRequest("full", "q31", RATE, name="bearing")
    again = compile_model(place / "model.toml", tmp_path / "again", request, place / "controller.toml")
    assert again.files == compiled.files
    for name in again.files:
        assert (again.out / name).read_bytes() == (compiled.out / name).read_bytes()


def test_the_manifest_gives_the_scales_of_all_codes(compiled: Compiled) -> None:
    manifest = json.loads((compiled.out / "manifest.json").read_text())
    assert {"bearing_controller.c", "bearing_controller.h", "controller.csv"} <= set(manifest["files"])
    controller = manifest["controller"]
    header = (compiled.out / "bearing_controller.h").read_text()
    for name, value in (
        ("GAP_MIDDLE_M", controller["signals"]["position"]["zero_gap"]),
        ("FULL_SCALE_POSITION_M", controller["signals"]["position"]["scale"]),
        ("FULL_SCALE_CURRENT_A", controller["signals"]["current"]["scale"]),
        ("FULL_SCALE_DEMAND_N", controller["signals"]["demand"]["scale"]),
        ("CURRENT_STEP", controller["signals"]["current"]["step_codes"]),
    ):
        found = re.search(rf"#define BEARING_CONTROLLER_{name} (\S+)", header)
        assert found
        assert float(found[1]) == value
    assert controller["signals"]["position"]["zero_gap"] == pytest.approx(0.45e-3)
    assert LEVITATION_COLUMNS.index("drive_1") == LEVITATION_INPUT_COUNT


def test_fragments_for_make_and_cmake_name_its_source(compiled: Compiled, tmp_path: Path) -> None:
    (tmp_path / "Makefile").write_text(
        f"include {compiled.out}/anhyst.mk\nall:\n"
        f"\tcc $(ANHYST_CPPFLAGS) $(ANHYST_SOURCES) {compiled.out}/main.c -o example\n"
    )
    subprocess.run([tool("make")], cwd=tmp_path, check=True, capture_output=True)
    vectors = (compiled.out / "controller.csv").read_text()
    assert " 0 differ" in played(str(tmp_path / "example"), vectors)
    cmake = (compiled.out / "anhyst.cmake").read_text()
    assert '"${CMAKE_CURRENT_LIST_DIR}/bearing_controller.c")\n' in cmake


def test_every_setting_of_the_core_is_given(compiled: Compiled) -> None:
    """In C, an omitted member of an initialiser silently becomes zero."""
    headers = sorted((compiled.out / "include").rglob("*.h"))
    header = "\n".join(path.read_text() for path in headers)
    header = re.sub(r"\b(anhyst_\w+)_x\b", r"\1_q31", header)
    source = (compiled.out / "bearing_controller.c").read_text()
    for structure in (
        "anhyst_levitation_limits",
        "anhyst_levitation_settings",
        "anhyst_pidd2_gains_q31",
        "anhyst_position_limits_q31",
        "anhyst_position_settings_q31",
    ):
        body = re.search(rf"typedef struct {{([^}}]*)}} {structure};", header)
        assert body
        plain = re.sub(r"/\*.*?\*/", "", body[1], flags=re.S)
        members = set(re.findall(r"(\w+);", plain)) - {"reserved"}
        assert len(members) >= 5
        missing = {name for name in members if f".{name} = " not in source}
        assert not missing, structure


def test_the_guide_reports_both_widths(compiled: Compiled) -> None:
    guide = (compiled.out / "DROP_IN.md").read_text()
    assert "a 16-bit converter" in guide
    assert "a signed 32-bit integer" in guide
    assert "{" not in guide.split("## The position controller")[1].split("```c")[0]


@pytest.mark.slow
def test_rate_and_converter_come_from_the_file(place: Path, tmp_path: Path) -> None:
    converter = "[converter]\nlow_A = -0.5\nhigh_A = 5.5\nbits = 12\n[safety]"
    path = changed(place, "converter.toml", ("[safety]", converter))
    out = tmp_path / "out"
    given = [str(place / "model.toml"), "--controller", str(path), "--io", "q31"]
    assert main(["compile", *given, "--accuracy", "2", "--out", str(out)]) == 0
    controller = json.loads((out / "manifest.json").read_text())["controller"]
    current = controller["signals"]["current"]
    step = current["step_codes"] / 2.0**31 * current["scale"]
    assert step == pytest.approx(6.0 / 4095.0, rel=1e-12)
    assert controller["rate_Hz"] == RATE
    # The lowest current of the converter that is not below the limit of 0 A.
    first = math.ceil(0.5 / step)
    assert current["low"] == pytest.approx(first * step - 0.5, abs=1e-9)
    assert f"FIRST_WORD {first}\n" in next(out.glob("*_controller.h")).read_text()


@pytest.mark.first(3)
@pytest.mark.parametrize(
    ("changes", "options", "message"),
    [
        ([], ["--io", "q15"], "format-too-coarse --io: 4.6 nm"),
        ([], ["--io", "f32"], "option-not-for-this --io"),
        ([], ["--io", "q31", "--rate", "1e4"], "option-differs rate_Hz: :7:; 20000 Hz; 10000 Hz"),
        ([], ["--io", "q31", "--kind", "simplified"], "option-differs compensation.variant: :29:"),
        (
            [('variant = "full"', 'variant = "single-valued"')],
            ["--io", "q31"],
            "not-compilable compensation.variant: :29:",
        ),
        (
            [('variant = "full"', 'variant = "at-rest"')],
            ["--io", "q31"],
            "not-compilable compensation.variant: :29:",
        ),
        (
            [('format = "fixed"', 'format = "f64"')],
            ["--io", "q31"],
            "not-compilable compensation.format: :30:",
        ),
        ([("force_low_N = 0.0", "force_low_N = -1.0")], ["--io", "q31"], "cannot-push limits.force_low_N"),
        (
            [('format = "fixed"', 'format = "fixed"\nmodel = "controller.toml"')],
            ["--io", "q31"],
            "model-differs compensation.model: :31:; model.toml",
        ),
        (
            [('format = "fixed"', 'format = "fixed"\nmodel = "none.toml"')],
            ["--io", "q31"],
            "model-differs compensation.model: :31:; none.toml",
        ),
        (
            [("current_high_A = 4.5", "current_high_A = 4.6")],
            ["--io", "q31"],
            "beyond-model limits.current_high_A: :23:; 4.50",
        ),
        (
            [("gap_high_m = 0.57e-3", "gap_high_m = 2.57e-3")],
            ["--io", "q31"],
            "range-too-narrow limits.gap_high_m: :25:",
        ),
        (
            [("current_low_A = 0.0", "current_low_A = 0.5")],
            ["--io", "q31"],
            "zero-outside-range limits.current_low_A: :22:; 0.5 A",
        ),
        (
            [("max_missing_samples = 3", "max_missing_samples = 100000")],
            ["--io", "q31"],
            "less-than-equal safety.max_missing_samples: 65535",
        ),
        (
            [("bandwidth_Hz = 120.0", "bandwidth_Hz = 1e6")],
            ["--io", "q31"],
            "too-large-for-fixed-point design.bandwidth_Hz: :12:",
        ),
        (
            [("step_m = 20e-6", "step_m = 1e-12")],
            ["--io", "q31"],
            "step-too-fine limits.step_m: :26:; 1e-12 m; 1e-09 m",
        ),
    ],
)
def test_unsuitable_options_are_reported_in_one_line(
    place: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    changes: list[tuple[str, str]],
    options: list[str],
    message: str,
) -> None:
    path = changed(place, "wrong.toml", *changes)
    out = tmp_path / "out"
    given = ["compile", str(place / "model.toml"), "--controller", str(path), *options]
    assert main([*given, "--out", str(out)]) == 2
    text = capsys.readouterr().err
    assert text.count("\n") == 1
    assert says(text, message), text
    assert not out.exists()


def test_a_rate_is_needed_without_a_controller(
    place: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = str(tmp_path / "out")
    assert main(["compile", str(place / "model.toml"), "--out", out]) == 2
    assert says(capsys.readouterr().err, "missing --rate")
