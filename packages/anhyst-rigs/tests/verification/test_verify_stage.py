"""Test the compiled controller of a stage on other processors: equal bits, and measured cost."""

from __future__ import annotations

import hashlib
import json
import shutil
from pathlib import Path

import pytest

from anhyst.verification import verify
from anhyst.verification.bundle import read_bundle
from anhyst.verification.compare import BuildFolder
from anhyst.verification.targets import find_cortex_m_builds
from anhyst_rigs.study.tracking.compiled import write_stage
from tests.compilation.test_compile_stage import single
from tests.refusals import refused
from tests.verification.conftest import sign


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("stage") / "out"
    return write_stage(single(True, "full"), "full", place, "stage").out


@pytest.fixture(scope="module")
def fixed_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("stage") / "out"
    return write_stage(single(True, "full", "fixed"), "full", place, "stage").out


@pytest.fixture(scope="module")
def whole_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("stage") / "out"
    return write_stage(single(True, "full", "fixed", "fixed"), "full", place, "stage").out


@pytest.mark.slow
def test_fixed_point_is_bit_identical_on_a_processor_without_floating_point(
    whole_folder: Path, tmp_path: Path
) -> None:
    found = verify(whole_folder, "cortex-m0plus", target_steps=1000)
    assert found.passed, found.first_failure()
    (one,) = found.results
    assert (one.build, one.vectors, one.warnings) == ("portable", 2000, 0)
    flight = one.cost("tick, in flight")
    assert flight is not None
    assert 10_000 < flight.mean < 80_000
    assert one.stack_measured is not None
    assert one.stack_static is not None
    assert 200 < one.stack_measured <= one.stack_static < 3_000
    workshop = BuildFolder.create(read_bundle(whole_folder), tmp_path, "stage")
    (order,) = find_cortex_m_builds("cortex-m0plus", workshop).builds
    image = order().image
    assert image is not None
    names = {symbol.name for symbol in image.symbols if symbol.kind == "STT_FUNC"}
    floats = ("__aeabi_f", "__aeabi_d", "__aeabi_cf", "__aeabi_cd", "__aeabi_i2f")
    assert "stage_controller_tick" in names
    assert [name for name in names if name.startswith(floats) or name.endswith("sf3")] == []


@pytest.mark.slow
def test_ten_magnets_need_about_as_many_instructions_in_fixed_point_as_in_f32(
    folder: Path, fixed_folder: Path
) -> None:
    (real,) = verify(folder, "cortex-m4", target_steps=2000).results
    found = verify(fixed_folder, "cortex-m4,cortex-m33", target_steps=2000)
    assert found.passed, found.first_failure()
    assert [result.build for result in found.results] == ["hard float, port header", "hard float"]
    before = real.cost("tick, in flight")
    assert before is not None
    for fixed, largest in zip(found.results, (1.0, 1.2), strict=True):  # f32 of the Cortex-M4
        after = fixed.cost("tick, in flight")
        assert after is not None
        assert after.mean < largest * before.mean
        assert after.most < largest * before.most
        assert fixed.stack_measured is not None
        assert fixed.stack_static is not None
        assert 200 < fixed.stack_measured <= fixed.stack_static < 1_200


@pytest.mark.slow
def test_ten_magnets_are_bit_identical_and_their_cost_is_reported(folder: Path) -> None:
    found = verify(folder, "cortex-m7", target_steps=2000)
    assert found.passed, found.first_failure()
    assert [result.build for result in found.results] == ["hard float"]
    one = found.results[0]
    assert (one.steps, one.vectors, one.warnings) == (200, 2000, 0)
    flight, tick = one.cost("tick, in flight"), one.cost("tick")
    assert flight is not None
    assert tick is not None
    assert 10_000 < flight.mean < 60_000
    assert flight.mean < flight.most < 4 * flight.mean
    assert one.sizes is not None
    assert 5_000 < one.sizes.code < 40_000
    assert 1_000 < one.state_bytes < 4_100
    assert one.stack_measured is not None
    assert one.stack_static is not None
    assert 200 < one.stack_measured <= one.stack_static < 2_000


@pytest.mark.slow
@pytest.mark.parametrize("which", ["folder", "fixed_folder"])
def test_no_double_precision_is_linked_on_processors_without_it(
    which: str, request: pytest.FixtureRequest, tmp_path: Path
) -> None:
    bundle = read_bundle(request.getfixturevalue(which))
    workshop = BuildFolder.create(bundle, tmp_path, "stage")
    (order,) = find_cortex_m_builds("cortex-m4", workshop).builds
    image = order().image
    assert image is not None
    names = {symbol.name for symbol in image.symbols if symbol.kind == "STT_FUNC"}
    assert "stage_controller_tick" in names
    doubles = ("__aeabi_d", "__aeabi_f2d", "__aeabi_cd")
    assert [name for name in names if name.startswith(doubles) or name.endswith("df3")] == []


@pytest.mark.slow
def test_a_current_that_differs_is_named_with_its_tick(folder: Path, tmp_path: Path) -> None:
    place = tmp_path / "out"
    place.mkdir()
    bundle = read_bundle(folder)
    bundle.copy_sources(place)
    for name in ("manifest.json", *bundle.manifest["files"]):
        (place / name).parent.mkdir(parents=True, exist_ok=True)
        (place / name).write_bytes((folder / name).read_bytes())
    lines = (place / "vectors.csv").read_text().splitlines()
    cells = lines[8].split(",")
    column = lines[0].split(",").index("current_3")
    cells[column] = str(float(cells[column]) * 1.5)
    lines[8] = ",".join(cells)
    (place / "vectors.csv").write_text("\n".join(lines) + "\n")
    sign(place)
    found = verify(place, "cortex-m4", target_steps=100)
    assert not found.passed
    assert "golden vector 7: current 3" in found.first_failure()


@pytest.mark.parametrize("wrong", [7, {}, {"heads": None}, {"free": []}, {"magnets": 0}, {"magnets": 10**9}])
def test_a_stage_with_malformed_records_is_refused(folder: Path, tmp_path: Path, wrong: object) -> None:
    place = tmp_path / "out"
    shutil.copytree(folder, place)
    manifest = json.loads((place / "manifest.json").read_text())
    manifest["stage"] = {**manifest["stage"], **wrong} if wrong and isinstance(wrong, dict) else wrong
    manifest["files"]["stage_parameters.h"] = hashlib.sha256(b"").hexdigest()
    (place / "stage_parameters.h").touch()
    (place / "manifest.json").write_text(json.dumps(manifest))
    with refused("damaged-manifest stage"):
        read_bundle(place)


@pytest.mark.parametrize("which", ["folder", "whole_folder"])
def test_a_target_on_which_no_stage_runs_is_refused(which: str, request: pytest.FixtureRequest) -> None:
    for name in ("avr", "msp430", "cortex-m3-qemu"):
        with refused("target-not-for-this --on"):
            verify(request.getfixturevalue(which), name)
