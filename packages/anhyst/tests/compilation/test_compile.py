"""Test the way from a model file to a folder of C that compiles, runs and has the stated accuracy."""

from __future__ import annotations

import hashlib
import json
import re
import subprocess
from dataclasses import replace
from functools import cache
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from anhyst.cli.app import main
from anhyst.compensate.force_controller import make_twin
from anhyst.compensate.measure import compare_with_demand, run_with_losses
from anhyst.compensate.plan import CompileRequest, round_full_scale
from anhyst.compilation.output import Compiled, compile_model
from anhyst.model.actuator import Model
from anhyst.model.schema import FitFigures, ValidRange
from anhyst.model.writer import write_model
from anhyst.support.atomic import core_folder
from anhyst.support.block_layout import BODY_WORDS
from anhyst.support.errors import NegativeResult
from tests.actuators import GAPS, magnet, ring
from tests.core.test_c_core import tool
from tests.firmware.build import tool as avr_gcc
from tests.page import Page
from tests.refusals import refused, says
from tests.repository import ROOT

WARNINGS = ("-std=c99", "-O2", "-Wall", "-Wextra", "-Wconversion", "-Wpedantic", "-Wshadow", "-Werror")
CASES = tuple(product(("full", "simplified"), ("q15", "q31", "f32")))
QUICK = {("full", "q15"), ("simplified", "q31"), ("full", "f32")}
"""Every kind and every format once; the other combinations belong to a slow sweep."""


def measured(model: Model, low: float = 0.0, high: float = 2.0) -> Model:
    """Add a valid range to a model, as identification does."""
    gap = GAPS[0] if model.nodes else None
    ends = model.predict([high, low, high], gap, history="demagnetised").output
    over = (GAPS[0], GAPS[-1]) if model.nodes else None
    valid = ValidRange((low, high), (float(ends.min()), float(ends.max())), over)
    fit = FitFigures(float(ends.max()), 0.001 * ends.max(), 0.002 * ends.max(), 0.01 * ends.max())
    return replace(model, valid=valid, fit=fit)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("compile")
    write_model(measured(magnet(play=105.0)), place / "magnet.toml")
    return place


@pytest.fixture(
    scope="module",
    params=[pytest.param(case, marks=[pytest.mark.slow] * (case not in QUICK)) for case in CASES],
    ids="-".join,
)
def compiled(folder: Path, request: pytest.FixtureRequest) -> Compiled:
    kind, io = request.param
    return compile_model(folder / "magnet.toml", folder / f"{kind}-{io}", CompileRequest(kind, io, 1e4))


@cache
def full(folder: Path) -> Compiled:
    """Return the compensator that most tests use."""
    return compile_model(folder / "magnet.toml", folder / "out", CompileRequest("full", "q15", 1e4))


def sources_of(folder: Path) -> list[str]:
    """Return the C files of a folder, except the example that needs a board."""
    return sorted(str(file) for file in folder.rglob("*.c") if file.parent.name != "example")


def built(place: Path, compiler: str, program: Path) -> str:
    """Compile a folder with all warnings; return the program."""
    sources = sources_of(place)
    completed = subprocess.run(
        [compiler, *WARNINGS, f"-I{place / 'include'}", *sources, "-o", str(program)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert completed.returncode == 0, completed.stderr
    return str(program)


def files_below(folder: Path) -> set[str]:
    """Return the files of a folder by their relative paths."""
    return {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}


@pytest.mark.parametrize("compiler", ["cc", "clang"])
def test_the_c_compiles_without_warnings_and_gives_the_golden_currents(
    compiled: Compiled, compiler: str, tmp_path: Path
) -> None:
    program = built(compiled.out, tool(compiler), tmp_path / "example")
    vectors = (compiled.out / "vectors.csv").read_text()
    completed = subprocess.run([program], input=vectors, capture_output=True, text=True, check=False)
    assert (completed.returncode, completed.stdout) == (0, "1000 rows, 0 differ\n")
    head, first, *rest = vectors.splitlines()
    *given, current = first.split(",")
    wrong = "1.25" if compiled.plan.request.io == "f32" else str(int(current) + 1)
    spoiled = "\n".join([head, ",".join([*given, wrong]), *rest])
    completed = subprocess.run([program], input=spoiled, capture_output=True, text=True, check=False)
    assert completed.returncode == 1
    assert "1 differ" in completed.stdout


def test_the_budget_holds_on_demands_that_were_not_measured(compiled: Compiled) -> None:
    plan = compiled.plan
    ways = plan.builder.output_range.paths(seed=77)
    deviation, _ = compare_with_demand(plan.model, plan.block, plan.request.io, ways)
    assert compiled.budget.compiled.worst is not None
    assert deviation.worst <= 1.3 * compiled.budget.compiled.worst
    assert any("formats and tables" in text for text in compiled.warnings) == (
        plan.request.io == "f32" and plan.block.kind == "full"
    )
    assert compiled.manifest["memory"]["parameters_bytes"] <= 2048
    largest = 152 if plan.block.is_fixed else 176
    assert compiled.manifest["memory"]["state_bytes"] <= largest


@pytest.mark.slow
def test_the_budget_agrees_with_the_model_sample_by_sample(folder: Path) -> None:
    """The budget calculates all forces together; the stepper does it sample by sample."""
    plan = full(folder).plan
    path = plan.builder.output_range.paths(seed=5)[-1]
    assert path.gap is not None
    twin, stepper = make_twin(plan.block, "q15"), plan.model.stepper(path.gap[0], "demagnetised")
    low, high = plan.block.limits.current
    worst = 0.0
    for demand, gap in zip(path.demand[:300].tolist(), path.gap[:300].tolist(), strict=True):
        current = twin.solve(demand, gap)
        twin.commit(current, gap)
        output = stepper.commit(current, gap)
        if low + 0.001 < current < high - 0.001:
            worst = max(worst, abs(output - demand))
    assert 0.0 < worst <= plan.allowance


def test_lost_currents_are_reported_to_the_memory(folder: Path) -> None:
    plan = full(folder).plan
    path = plan.builder.output_range.paths()[1]
    run = run_with_losses(plan.model, plan.block, "q15", path)
    lost = ~run.is_evaluated
    assert lost.sum() == path.demand.size // 4
    low, high = plan.block.limits.current
    free = (run.current > low + 0.001) & (run.current < high - 0.001)
    error = np.abs(run.output - path.demand)
    assert error[run.is_evaluated & free].max() <= plan.allowance
    assert error[lost & free].max() > 20.0 * plan.allowance


@pytest.mark.slow
def test_equal_models_give_equal_bytes(folder: Path, tmp_path: Path) -> None:
    first = full(folder)
    again = compile_model(folder / "magnet.toml", tmp_path / "again", CompileRequest("full", "q15", 1e4))
    assert sorted(again.files) == sorted(first.files)
    for name in first.files:
        assert (again.out / name).read_bytes() == (first.out / name).read_bytes()
    for name in first.files:
        assert not re.search(r"\b20\d\d-\d\d|\d\d:\d\d:\d\d", (first.out / name).read_text())


def test_the_manifest_describes_the_folder(compiled: Compiled) -> None:
    plan = compiled.plan
    manifest = json.loads((compiled.out / "manifest.json").read_text())
    assert manifest["format"] == 2
    assert (manifest["kind"], manifest["io"]) == (plan.block.kind, plan.request.io)
    for name, sha256 in manifest["files"].items():
        assert hashlib.sha256((compiled.out / name).read_bytes()).hexdigest() == sha256
    assert {*manifest["files"], "manifest.json"} == files_below(compiled.out)
    gap = manifest["signals"]["gap"]
    assert (gap["low"], gap["high"], gap["unit"]) == (GAPS[0], GAPS[-1], "m")
    assert manifest["signals"]["demand"]["scale"] > plan.reference_output
    assert manifest["accuracy"]["worst_percent"] > 0.0
    assert manifest["conditioning"]["remaining_percent"] < 0.1
    assert all(manifest["plan"].values())
    words = {word["name"]: word for word in manifest["parameters"]}
    assert set(words) == {word.name for word in BODY_WORDS[plan.block.kind]}
    high, one = words["CURRENT_HIGH"], 32768.0 if plan.block.is_fixed else 1.0
    value = float(plan.block.words[high["first"]]) / one * high["scale"]
    assert value == pytest.approx(plan.block.limits.current[1], abs=2.0**-15 * high["scale"])
    assert (words["GAP_BIAS"]["entries"] - 1).bit_count() == 1


def test_budget_names_every_part(compiled: Compiled) -> None:
    budget = json.loads((compiled.out / "budget.json").read_text())
    parts = {part["name"]: part for part in budget["parts"]}
    law = {"law"} if compiled.plan.block.kind == "simplified" else set()
    named = {"model_fit", "tables", "quantisation", "gap_interpolation", "sample_rate"}
    assert set(parts) == named | law
    known = sum(parts[name]["worst"] for name in ("model_fit", "sample_rate"))
    assert budget["total"]["worst"] == pytest.approx(budget["compiled"]["worst"] + known)
    page = (compiled.out / "budget.html").read_text()
    Page(page).check_answer_first()
    assert page.count("<svg") == 2
    assert "sample rate" in page


@pytest.mark.slow
def test_rounding_costs_less_the_finer_the_format(folder: Path) -> None:
    costs = {}
    for io in ("q15", "q31", "f32"):
        place = folder / f"full-{io}" / "budget.json"
        if not place.is_file():
            compile_model(folder / "magnet.toml", place.parent, CompileRequest("full", io, 1e4))
        parts = json.loads(place.read_text())["parts"]
        costs[io] = next(p["rms"] for p in parts if p["name"] == "quantisation")
    assert costs["f32"] < 0.2 * costs["q31"]
    assert costs["q31"] < costs["q15"]


def compiles_alone_on_16_bits(folder: Path) -> None:
    """Compile each file of a folder by itself where int has 16 bits; warnings are errors.

    A generic header, or the arithmetic of one, is the body of others and no file by itself.
    """
    files = [
        path
        for path in folder.rglob("*.[ch]")
        if path.name != "main.c" and not path.name.endswith("_fixed.h")
    ]
    alone = [path for path in files if "generic" not in path.parts and "port" not in path.parts]
    assert len(alone) > 8
    include = [f"-I{folder / 'include'}", f"-I{folder}", f"-I{folder / 'src'}"]
    for path in alone:
        options = [*WARNINGS, "-mmcu=atmega1284p", "-fsyntax-only", "-x", "c"]
        if path.suffix == ".h":
            options.append("-Wno-pedantic")  # this flag requires a declaration in every file
        completed = subprocess.run(
            [avr_gcc("avr-gcc"), *options, *include, str(path)], capture_output=True, text=True, check=False
        )
        assert (completed.returncode, completed.stderr) == (0, ""), path


def test_every_file_compiles_alone_on_16_bits(compiled: Compiled) -> None:
    compiles_alone_on_16_bits(compiled.out)


def test_the_core_is_shipped_as_it_is(compiled: Compiled) -> None:
    """One copy of the core serves every actuator of a program."""
    kind = compiled.plan.block.kind
    core = {name for name in compiled.files if name.startswith(("include/", "src/", "port/"))}
    for name in core:
        assert (compiled.out / name).read_bytes() == (core_folder() / name).read_bytes(), name
    others = {"full", "simplified", "euler"} - {kind}
    laws = {name for name in core if re.search(r"src/compensator/(full|simplified|euler)\w*\.c", name)}
    assert laws
    assert all(f"src/compensator/{kind}" in name for name in laws)
    assert not any(re.search(rf"src/.*({'|'.join(others)})", name) for name in core)


@pytest.mark.slow
def test_names_of_an_actuator_begin_with_its_name(folder: Path, tmp_path: Path) -> None:
    request = CompileRequest("full", "q31", 1e4, accuracy=2.0, name="left_2")
    out = compile_model(folder / "magnet.toml", tmp_path / "out", request).out
    text = (out / "left_2_parameters.h").read_text() + (out / "left_2_parameters.c").read_text()
    defined = re.findall(r"^#define (\w+)|^(?:extern )?const \w+ (\w+)", text, re.M)
    assert len(defined) > 5
    assert all(name.lower().startswith("left_2_") for pair in defined for name in pair if name)
    assert json.loads((out / "manifest.json").read_text())["name"] == "left_2"


def test_generated_c_is_formatted_as_the_core_is(folder: Path) -> None:
    out = full(folder).out
    for name in ("magnet_parameters.h", "magnet_parameters.c", "main.c", "example/interrupt.c"):
        style = f"--style=file:{ROOT / '.clang-format'}"
        completed = subprocess.run(
            [tool("clang-format"), style, str(out / name)], capture_output=True, text=True, check=False
        )
        text = (out / name).read_text()
        assert completed.stdout == text
        assert [line for line in text.splitlines() if len(line) > 100] == []


@pytest.mark.slow
def test_fragments_for_make_and_cmake_build_the_example(folder: Path, tmp_path: Path) -> None:
    out = full(folder).out
    vectors = (out / "vectors.csv").read_text()
    (tmp_path / "Makefile").write_text(
        f"include {out}/anhyst.mk\n"
        f"example: $(ANHYST_SOURCES) {out}/main.c\n\t$(CC) $(ANHYST_CPPFLAGS) $^ -o $@\n"
    )
    subprocess.run([tool("make"), "-s", "-C", str(tmp_path), "example"], check=True)
    (tmp_path / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.20)\nproject(example LANGUAGES C)\n"
        f"include({out}/anhyst.cmake)\nadd_executable(example {out}/main.c)\n"
        "target_link_libraries(example anhyst)\n"
    )
    build = tmp_path / "build"
    cmake = [tool("cmake"), "-S", str(tmp_path), "-B", str(build)]
    subprocess.run(cmake, check=True, capture_output=True)
    subprocess.run([tool("cmake"), "--build", str(build)], check=True, capture_output=True)
    for program in (tmp_path / "example", build / "example"):
        completed = subprocess.run([program], input=vectors, capture_output=True, text=True, check=True)
        assert "0 differ" in completed.stdout


def test_parameters_in_c_are_the_block(folder: Path) -> None:
    compiled = full(folder)
    text = (compiled.out / "magnet_parameters.c").read_text()
    rows = text[text.index("= {") :]
    words = [int(word) for word in re.findall(r"-?\d+", re.sub(r"/\*.*?\*/", "", rows, flags=re.S))]
    assert words == compiled.plan.block.words.tolist()


@pytest.mark.slow
@pytest.mark.parametrize("io", ["q15", "f32"])
def test_the_size_of_the_state_agrees_with_the_manifest(folder: Path, tmp_path: Path, io: Any) -> None:
    """Pointers have 64 bits here, which adds to the size; the structure is padded to 8 bytes."""
    place, suffix = (folder / "out", "") if io == "q15" else (tmp_path, "_f32")
    if io == "q15":
        manifest = full(folder).manifest
    else:
        place = tmp_path / "out"
        request = CompileRequest("full", "f32", 1e4, accuracy=2.0)
        manifest = compile_model(folder / "magnet.toml", place, request).manifest
    (tmp_path / "size.c").write_text(
        f'#include <stdio.h>\n#include "anhyst/compensator/compensator{suffix}.h"\n'
        f'int main(void) {{ printf("%zu", sizeof(anhyst_compensator{suffix})); }}\n'
    )
    program = tmp_path / "size"
    command = [tool("cc"), "-std=c99", f"-I{place}/include", str(tmp_path / "size.c"), "-o", str(program)]
    subprocess.run(command, check=True)
    message = int(subprocess.run([program], capture_output=True, text=True, check=True).stdout)
    assert message == -(-(manifest["memory"]["state_bytes"] + 4 * 2) // 8) * 8


@pytest.mark.slow
def test_a_ring_without_a_gap_and_of_either_sign_compiles(tmp_path: Path) -> None:
    write_model(measured(ring(), -120.0, 120.0), tmp_path / "ring.toml")
    compiled = compile_model(tmp_path / "ring.toml", tmp_path / "out", CompileRequest("full", "q31", 1e3))
    assert compiled.manifest["signals"]["gap"] is None
    assert compiled.plan.block.limits.demand[0] < 0.0
    assert compiled.budget.compiled.worst is not None
    assert compiled.budget.compiled.worst <= compiled.plan.allowance
    program = built(compiled.out, tool("cc"), tmp_path / "example")
    with (compiled.out / "vectors.csv").open() as vectors:
        assert subprocess.run([program], stdin=vectors, capture_output=True, check=False).returncode == 0


@pytest.mark.slow
def test_less_accuracy_needs_less_memory(folder: Path, tmp_path: Path) -> None:
    rough = compile_model(
        folder / "magnet.toml", tmp_path / "rough", CompileRequest("full", "q15", 1e4, accuracy=2.0)
    )
    fine = full(folder).manifest["memory"]["parameters_bytes"]
    assert rough.manifest["memory"]["parameters_bytes"] < fine
    assert rough.manifest["accuracy"]["worst_percent"] <= 2.0


@pytest.mark.slow
@pytest.mark.parametrize(
    ("request_", "culprit", "advice"),
    [
        (CompileRequest("simplified", "q15", 1e4, 0.5), "straight anhysteretic", "--kind full"),
        pytest.param(
            *(CompileRequest("full", "q31", 1e4, 0.001), "tables", "cannot be larger"), marks=pytest.mark.slow
        ),
    ],
)
def test_unreachable_accuracy_names_its_cause(
    folder: Path, tmp_path: Path, request_: CompileRequest, culprit: str, advice: str
) -> None:
    with refused(f"accuracy-not-reached: {culprit}; {advice}", NegativeResult):
        compile_model(folder / "magnet.toml", tmp_path / "out", request_)
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"law": "jiles-atherton-1986"}, "no-fixed-point-form"),
        ({"valid": None}, "no-valid-range valid"),
        ({"parameters": {"alpha": 0.05}}, "no-fixed-point-form"),
        ({"gap_map": "free", "parameters": {"k": (300.0, 310.0, 320.0)}}, "no-fixed-point-form: 'free'"),
    ],
)
def test_a_model_that_cannot_be_compiled_is_reported_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], change: dict[str, Any], message: str
) -> None:
    model = measured(magnet())
    if "parameters" in change:
        change |= {"parameters": {**model.parameters, **change["parameters"]}}
    path, out = tmp_path / "model.toml", tmp_path / "out"
    write_model(replace(model, **change), path)
    assert main(["compile", str(path), "--rate", "1e4", "--out", str(out)]) == 2
    text = capsys.readouterr().err
    assert text.count("\n") == 1
    assert text.startswith(f"anhyst: error: {path}: ")
    assert says(text, message)
    assert not out.exists()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--rate", "1e9"], "--rate"),
        (["--rate", "1e4", "--accuracy", "0"], "--accuracy"),
        (["--rate", "1e4", "--kind", "square"], "square"),
        (["--rate", "1e4", "--io", "q7"], "q7"),
        (["--rate", "1e4", "--name", "Magnet 2"], "Magnet 2"),
    ],
)
def test_bad_options_exit_with_two(
    folder: Path, capsys: pytest.CaptureFixture[str], arguments: list[str], message: str
) -> None:
    out = folder / "none"
    assert main(["compile", str(folder / "magnet.toml"), "--out", str(out), *arguments]) == 2
    text = capsys.readouterr().err
    assert text.count("\n") == 1
    assert message in text
    assert not out.exists()


@pytest.mark.slow
def test_compile_replaces_only_folders_that_it_wrote(folder: Path, tmp_path: Path) -> None:
    model, request = folder / "magnet.toml", CompileRequest("full", "q15", 1e4, accuracy=2.0)
    out = tmp_path / "out"
    out.mkdir()
    (out / "notes.txt").write_text("mine")
    with refused("folder-holds-other-files"):
        compile_model(model, out, request)
    assert [p.name for p in out.iterdir()] == ["notes.txt"]
    (out / "notes.txt").unlink()
    compile_model(model, out, request)
    first = (out / "manifest.json").read_text()
    compile_model(model, out, replace(request, io="q31"))
    assert (out / "manifest.json").read_text() != first
    assert [p.name for p in tmp_path.iterdir()] == ["out"]
    with refused("is-a-file"):
        compile_model(model, out / "main.c", request)
    with refused("no-such-folder"):
        compile_model(model, tmp_path / "no" / "out", request)


@pytest.mark.slow
def test_json_output_agrees_with_the_manifest(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["--rate", "1e4", "--accuracy", "2", "--json", "--out", str(tmp_path / "out")]
    assert main(["compile", str(folder / "magnet.toml"), *arguments]) == 0
    message = json.loads(capsys.readouterr().out)
    written = json.loads((tmp_path / "out" / "manifest.json").read_text())
    assert message["accuracy"] == written["accuracy"]
    assert set(message["files"]) == files_below(tmp_path / "out")


@pytest.mark.parametrize(
    ("largest", "scale"), [(291.5, 300.0), (3.01, 4.0), (0.1, 0.12), (1.0, 1.2), (9.9, 10.0)]
)
def test_full_scale_is_the_next_round_value(largest: float, scale: float) -> None:
    assert round_full_scale(largest) == scale
