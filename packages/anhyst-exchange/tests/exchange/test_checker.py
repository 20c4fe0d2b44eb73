"""Check each kind of FMU with a second tool: the schemas and rules of the standard."""

from __future__ import annotations

import zipfile
from pathlib import Path

import pytest

import anhyst
from anhyst_exchange.exporter import ExportedPart, export_fmu
from anhyst_exchange.part import FmiVersion
from tests.exchange.conftest import Fmu
from tests.exchange.slave import needs_binary
from tests.exchange.test_actuator import magnet
from tests.exchange.test_bearing import planar_made
from tests.once import made_once
from tests.study import bearings

toolbox = pytest.importorskip("fmu_manipulation_toolbox.operations")
checker = pytest.importorskip("fmu_manipulation_toolbox.checker")


def findings(path: Path) -> tuple[str | None, list[str]]:
    """Return the version of the standard that the description fulfils, and the violated rules."""
    fmu = toolbox.FMU(str(path))
    schema, rules = checker.OperationGenericCheck(), checker.OperationSemanticCheck()
    fmu.apply_operation(schema)
    fmu.apply_operation(rules)
    return schema.compliant_with_version, rules.errors


@needs_binary
@pytest.mark.slow
@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
@pytest.mark.parametrize("of", ["compensator", "actuator"])
def test_models_break_no_rule(of: ExportedPart, fmi: FmiVersion, fmu: Fmu, identified: anhyst.Model) -> None:
    model = identified if of == "compensator" else magnet("effective-field", "reluctance")
    assert findings(fmu(model, of, fmi)) == (fmi, [])


@pytest.mark.slow
@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_bearings_break_no_rule(fmi: FmiVersion, tmp_path: Path) -> None:
    rig = bearings.copy_known(tmp_path)
    assert findings(export_fmu(rig, tmp_path / "b.fmu", fmi=fmi, platforms=[])) == (fmi, [])


@needs_binary
@pytest.mark.slow
@pytest.mark.parametrize("fmi", ["2.0", "3.0"])
def test_stages_of_several_coordinates_break_no_rule(
    fmi: FmiVersion, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = made_once(tmp_path_factory, "fmu-planar", planar_made)
    assert findings(folder / f"{fmi[0]}.fmu") == (fmi, [])


def test_a_broken_description_is_found(tmp_path: Path) -> None:
    model = magnet("effective-field", "reluctance")
    path = export_fmu(model, tmp_path / "m.fmu", of="actuator", platforms=[])
    for old, new in (('name="iron_field"', 'name="force"'), ('causality="input"', 'causality="x"')):
        broken = tmp_path / "broken.fmu"
        with zipfile.ZipFile(path) as given, zipfile.ZipFile(broken, "w") as made:
            text = given.read("modelDescription.xml").decode()
            assert old in text
            made.writestr("modelDescription.xml", text.replace(old, new))
        assert findings(broken) != ("2.0", [])
