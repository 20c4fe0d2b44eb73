"""Test a compiled solid core: layers in every format, and a warning if they are omitted."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path

import pytest

from anhyst.compensate.plan import CompileRequest
from anhyst.compilation.output import Compiled, compile_model
from anhyst.compilation.toolchain import MEMORIES_HEADER, Build, compile_c
from anhyst.support.atomic import core_folder
from anhyst.support.errors import NegativeResult
from anhyst.verification.verify import verify
from tests.compensate.test_solid import LAYERS, RATE, TOP, magnet
from tests.compilation.test_compile import compiles_alone_on_16_bits, sources_of


@pytest.fixture(scope="module", params=["f32", "q31", "q15"])
def compiled(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Compiled:
    folder = tmp_path_factory.mktemp("solid")
    magnet(LAYERS["three and sheets"]).save(folder / "magnet.toml")
    asked = CompileRequest("full", request.param, RATE)
    return compile_model(folder / "magnet.toml", folder / "out", asked)


def test_the_budget_states_the_error_of_fast_demands(compiled: Compiled) -> None:
    rate = compiled.budget.find_part("rate")
    assert rate is not None
    assert rate.worst is not None
    assert rate.worst < 3e-3 * TOP
    parts = json.loads((compiled.out / "budget.json").read_text())["parts"]
    assert "rate" in {part["name"] for part in parts}
    assert compiled.left_out == ()


def test_only_the_room_for_memories_differs_from_the_core(compiled: Compiled) -> None:
    for name in compiled.files:
        if name.startswith(("include/", "src/")):
            same = (compiled.out / name).read_bytes() == (core_folder() / name).read_bytes()
            assert same == (name != MEMORIES_HEADER), name


def test_every_file_compiles_alone_on_16_bits(compiled: Compiled) -> None:
    compiles_alone_on_16_bits(compiled.out)


def test_the_example_compiles_without_a_warning(compiled: Compiled, tmp_path: Path) -> None:
    sources = tuple(map(Path, sources_of(compiled.out)))
    build = Build(sources, (compiled.out, compiled.out / "include"), flags=("-Wpedantic",))
    assert compile_c(["cc"], build, tmp_path / "program", "host") == 0


@pytest.mark.slow
def test_the_simplified_law_is_quasi_static_and_reports_it(tmp_path: Path) -> None:
    magnet(LAYERS["two"]).save(tmp_path / "magnet.toml")
    request = CompileRequest("simplified", "q15", RATE)
    found = compile_model(tmp_path / "magnet.toml", tmp_path / "out", request)
    assert len(found.left_out) == 1
    assert "--kind full" in found.left_out[0]
    assert found.budget.find_part("rate") is None


def test_a_controller_without_room_for_layers_refuses_their_block(tmp_path: Path) -> None:
    folder = magnet(LAYERS["two"]).save(tmp_path / "magnet.toml")
    request = CompileRequest("full", "q31", RATE)
    compile_model(folder, tmp_path / "out", request)
    sources = tuple(map(Path, sources_of(tmp_path / "out")))
    for memories in (2, 3, 1):
        folders = tmp_path / "out", tmp_path / "out" / "include"
        build = Build(sources, folders, {"ANHYST_MEMORIES": str(memories)})
        program = tmp_path / f"with_{memories}"
        if memories == 1:
            with pytest.raises(NegativeResult, match="ANHYST_MEMORIES"):
                compile_c(["cc"], build, program, "host")
            return
        compile_c(["cc"], build, program, "host")
        with (tmp_path / "out" / "vectors.csv").open() as vectors:
            completed = subprocess.run([program], stdin=vectors, capture_output=True, check=False)
        assert completed.returncode == 0


@pytest.mark.slow
def test_the_cortex_m4_agrees_with_the_host(compiled: Compiled) -> None:
    found = verify(compiled.out, on="cortex-m4", host_steps=2000, target_steps=500)
    assert found.passed
