"""Test packages of ecosystems: their layout, their manifests, and the command."""

from __future__ import annotations

import configparser
import json
import re
import tomllib
import zipfile
from pathlib import Path
from xml.etree import ElementTree

import kconfiglib
import pytest
import yaml

import anhyst
from anhyst.cli.app import main
from anhyst.cli.docstring import read_docstring
from anhyst.compilation.manifest import write_folder
from anhyst.compilation.packages import PACKAGES, Ecosystem, check_package, license_text, make_package_files
from anhyst.verification.bundle import read_bundle
from tests.actuators import magnet
from tests.compilation.packaged import Plain, model_file, passed, plain
from tests.compilation.test_compile import measured
from tests.refusals import refused, says
from tests.repository import ROOT


@pytest.mark.parametrize("package", PACKAGES)
def test_every_package_has_licence_readme_and_every_c_file(place: Path, package: str, tmp_path: Path) -> None:
    one = plain(place, "cells")
    folder = one.write(package, tmp_path / "out")
    assert (folder / "LICENSE").read_text() == (ROOT / "LICENSE").read_text()
    readme = (folder / "README.md").read_text()
    assert "Apache-2.0" in readme
    assert "--name" in readme
    files = {path for path in folder.rglob("*") if path.is_file()}
    written = {path.name for path in files}
    guide = next(path for path in files if path.name == "DROP_IN.md").read_text()
    assert [name for name in ("anhyst.mk", "anhyst.cmake", "main.c", "example/") if name in guide] == []
    assert "interrupt.c" in written
    for name in one.files:
        if name.startswith(("include/", "src/", "upper_2_")):
            assert name.rpartition("/")[2] in written, name
    for path in files:
        own = path.suffix in {".c", ".h", ".rs", ".ino", ".yml", ".yaml", ".conf", ".pdsc"}
        if own or path.name in {"Cargo.toml", "CMakeLists.txt", "Kconfig", "platformio.ini"}:
            assert "SPDX-License-Identifier: Apache-2.0" in path.read_text(), path
        if package in {"zephyr", "platformio", "cmsis-pack"} and path.suffix in {".c", ".h"}:
            same = [text for name, text in one.files.items() if name.endswith(f"/{path.name}")]
            assert not same or path.read_text() in same, path


def test_the_licence_of_an_installed_wheel_is_that_of_the_project() -> None:
    assert license_text() == (ROOT / "LICENSE").read_text()


PDSC_CHILDREN = {
    "package": {
        "vendor", "name", "description", "url", "license", "requirements", "releases", "keywords",
        "taxonomy", "conditions", "components",
    },
    "condition": {"description", "require", "accept"},
    "component": {
        "description", "files", "Pre_Include_Global_h", "Pre_Include_Local_Component_h",
    },
    "files": {"file"},
}  # fmt: skip
PDSC_ATTRIBUTES = {
    "component": {
        "Cclass", "Cgroup", "Csub", "Cvariant", "Cversion", "condition", "isDefaultVariant",
    },
    "require": {"Cclass", "Cgroup", "Csub", "Cversion"},
    "accept": {"Dcore", "Ddsp"},
    "file": {"category", "name", "attr", "select"},
    "release": {"version"},
}  # fmt: skip
"""Attributes of the documented schema of pack descriptions (1.7) that the packs use."""


def test_the_pack_description_keeps_the_documented_rules(case: Plain, tmp_path: Path) -> None:
    folder = case.write("cmsis-pack", tmp_path / "out")
    name = case.values["name"]
    root = ElementTree.parse(folder / f"anhyst.{name}.pdsc").getroot()
    for element in root.iter():
        tag = element.tag
        if tag in PDSC_CHILDREN:
            assert {child.tag for child in element} <= PDSC_CHILDREN[tag], tag
        if tag in PDSC_ATTRIBUTES:
            assert set(element.keys()) <= PDSC_ATTRIBUTES[tag], tag
        for key in ("Cclass", "Cgroup", "Csub", "Cvariant"):
            assert 2 <= len(element.get(key, "xx")) <= 32
        if tag == "description":
            assert 0 < len(element.text or "") <= 256
    for key in ("name", "vendor"):
        assert re.fullmatch(r"[-_A-Za-z0-9]+", root.findtext(key, ""))
    (release,) = root.iter("release")
    assert re.fullmatch(r"\d+\.\d+\.\d+", release.attrib["version"])
    conditions = {one.get("id") for one in root.iter("condition")}
    for component in root.iter("component"):
        assert component.get("condition") in {None, *conditions}
        assert [child.tag for child in component].count("files") == 1
    for file in root.iter("file"):
        named = folder / file.attrib["name"]
        assert named.exists(), named
        assert named.is_dir() == (file.get("category") == "include")


def test_the_cmsis_solution_names_components_of_the_pack(case: Plain, tmp_path: Path) -> None:
    folder = case.write("cmsis-pack", tmp_path / "out")
    (file,) = folder.glob("*.pdsc")
    identities = [
        tuple(one.get(key) for key in ("Cgroup", "Csub", "Cvariant"))
        for one in ElementTree.parse(file).getroot().iter("component")
    ]
    assert len(set(identities)) == len(identities)
    project = folder / "examples" / "golden_vectors" / "golden_vectors.cproject.yml"
    listed = yaml.safe_load(project.read_text())["project"]["components"]
    pattern = re.compile(r"anhyst::Anhyst:(\w+)(?::(\w+))?(?:&([\w-]+))?")
    found = [pattern.fullmatch(one["component"]) for one in listed]
    own = [one.groups() for one in found if one is not None]
    assert set(own) <= set(identities)
    assert {group for group, _, _ in own} == {group for group, _, _ in identities}


def test_the_pack_contains_every_file_and_has_the_same_bytes(case: Plain, tmp_path: Path) -> None:
    folder = case.write("cmsis-pack", tmp_path / "out")
    (pack,) = folder.glob("*.pack")
    with zipfile.ZipFile(pack) as archive:
        packed = {info.filename for info in archive.infolist()}
        assert archive.testzip() is None
    on_disk = {path.relative_to(folder).as_posix() for path in folder.rglob("*") if path.is_file()}
    assert packed == on_disk - {pack.name}
    again = case.write("cmsis-pack", tmp_path / "again")
    assert (again / pack.name).read_bytes() == pack.read_bytes()


def test_zephyr_finds_all_files_of_the_module(case: Plain, tmp_path: Path) -> None:
    folder = case.write("zephyr", tmp_path / "out")
    module = yaml.safe_load((folder / "zephyr" / "module.yml").read_text())
    assert set(module) == {"name", "build", "samples"}
    assert set(module["build"]) == {"cmake", "kconfig"}
    assert (folder / module["build"]["cmake"] / "CMakeLists.txt").is_file()
    assert (folder / module["build"]["kconfig"]).is_file()
    sample = yaml.safe_load((folder / "samples/golden_vectors/sample.yaml").read_text())
    assert set(sample) == {"sample", "tests"}
    (test,) = sample["tests"].values()
    assert test["harness_config"]["regex"] == [passed(case).strip()]
    option = f"ANHYST_{case.values['name'].upper()}"
    assert f"CONFIG_{option}=y" in (folder / "samples/golden_vectors/prj.conf").read_text()
    assert f"config {option}\n" in (folder / "zephyr" / "Kconfig").read_text()


KCONFIG = """
config CPU_CORTEX_M4
	def_bool {is_m4}
config CPU_CORTEX_M7
	bool
config CPU_CORTEX_M33
	bool
config ARMV8_M_DSP
	bool
config CPU_HAS_FPU
	def_bool y
config FPU
	bool "FPU"
	depends on CPU_HAS_FPU
rsource "first/zephyr/Kconfig"
rsource "second/zephyr/Kconfig"
"""
"""Declarations of Zephyr's Kconfig files, followed by two modules."""


@pytest.mark.parametrize("is_m4", ["y", "n"])
def test_kconfig_enables_the_features_of_the_processor(place: Path, is_m4: str, tmp_path: Path) -> None:
    plain(place, "cells").write("zephyr", tmp_path / "first")
    plain(place, "single").write("zephyr", tmp_path / "second")
    (tmp_path / "Kconfig").write_text(KCONFIG.format(is_m4=is_m4))
    found = kconfiglib.Kconfig(str(tmp_path / "Kconfig"))
    port, fpu = found.syms["ANHYST_PORT_CORTEX_M4"], found.syms["FPU"]
    assert (port.str_value, fpu.str_value) == ("n", "n")
    found.syms["ANHYST_UPPER_2"].set_value("y")
    assert (port.str_value, fpu.str_value) == (is_m4, "n")
    found.syms["ANHYST_REAL"].set_value("y")
    assert fpu.str_value == "y"
    assert found.warnings == []


def test_library_manifests_describe_the_folder(case: Plain, tmp_path: Path) -> None:
    name = case.values["name"]
    library = case.write("platformio", tmp_path / "platformio")
    described = json.loads((library / "library.json").read_text())
    assert described["license"] == "Apache-2.0"
    assert (library / "include" / described["headers"]).is_file()
    for example in described["examples"]:
        assert all((library / example["base"] / file).is_file() for file in example["files"])
    assert case.values["real"] == ("-ffp-contract=off" in described["build"].get("flags", []))
    sketch = case.write("arduino", tmp_path / "arduino")
    reader = configparser.ConfigParser()
    reader.optionxform = str  # type: ignore[assignment, method-assign]
    reader.read_string("[properties]\n" + (sketch / "library.properties").read_text())
    properties = reader["properties"]
    needed = [
        "name",
        "version",
        "author",
        "maintainer",
        "sentence",
        "paragraph",
        "category",
        "url",
        "architectures",
    ]
    assert set(needed) <= set(properties)
    assert re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9 _.-]*", properties["name"])
    assert (sketch / "src" / properties["includes"]).is_file()
    for line in (sketch / "keywords.txt").read_text().splitlines():
        assert re.fullmatch(r"\w+\t(KEYWORD[12]|LITERAL1)", line)
    crate = case.write("cargo", tmp_path / "cargo")
    manifest = tomllib.loads((crate / "Cargo.toml").read_text())
    assert manifest["package"]["links"] == manifest["lib"]["name"] == f"anhyst_{name}"
    assert "dependencies" not in manifest


def test_another_ecosystem_is_one_record(place: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    own = Ecosystem(
        "own library",
        folders={"include": "h", "src": "c", "headers": "h", "sources": "c"},
        templates={"{name}.json": "platformio/library.json.j2"},
    )
    monkeypatch.setitem(PACKAGES, "own", own)
    check_package("own")
    one = plain(place, "cells")
    files = make_package_files("own", one.files, one.manifest, one.values)
    assert {"h/anhyst/numeric/fixed.h", "h/upper_2_parameters.h", "upper_2.json"} <= set(files)
    assert {"c/compensator/cells.c", "c/upper_2_parameters.c", "LICENSE"} <= set(files)
    assert not any(name.startswith("port/") or name.endswith(".md") for name in files)


def test_the_command_writes_and_replaces_a_package(
    place: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = model_file(tmp_path, measured(magnet()))
    out = tmp_path / "out"
    one = plain(place, "cells")
    write_folder(out, make_package_files("cmsis-pack", one.files, one.manifest, one.values), {})
    options = ["--rate", "1e4", "--kind", "simplified", "--accuracy", "40", "--name", "lower"]
    command = ["compile", str(file), "--out", str(out), *options]
    assert main([*command, "--package", "zephyr"]) == 0
    manifest = json.loads((out / "manifest.json").read_text())
    assert manifest["package"] == "zephyr"
    written = {path.relative_to(out).as_posix() for path in out.rglob("*") if path.is_file()}
    assert written == {"manifest.json", *manifest["files"]}
    assert main(["verify", str(out)]) == 2
    assert says(capsys.readouterr().err, "wrong-kind: package; --package")
    with refused("wrong-kind: package"):
        read_bundle(out)
    (out / "notes.txt").write_text("mine")
    assert main([*command, "--package", "zephyr"]) == 2
    assert (out / "notes.txt").read_text() == "mine"


@pytest.mark.parametrize("source", ["model", "stage"])
def test_the_command_refuses_kinds_without_a_package(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], source: str
) -> None:
    stage = ROOT / "examples" / "stage" / "rig.toml"
    file = stage if source == "stage" else model_file(tmp_path, measured(magnet()))
    package = "zephyr" if source == "stage" else "conan"
    out = tmp_path / "out"
    command = ["compile", str(file), "--rate", "1e4", "--out", str(out), "--package", package]
    assert main(command) == 2
    message = capsys.readouterr().err
    assert message.count("\n") == 1
    kind = "option-not-for-this" if source == "stage" else "unknown-package"
    assert says(message, f"{kind} --package")
    assert source == "stage" or all(name in message for name in PACKAGES)
    assert not out.exists()


def test_help_and_documents_name_every_package() -> None:
    help_ = read_docstring(anhyst.compile).parameters["package"].text
    page = (ROOT / "docs" / "compile.md").read_text()
    for name in PACKAGES:
        assert name in help_
        assert f"`{name}`" in page
