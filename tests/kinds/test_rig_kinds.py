"""Test rig kinds: each kind is one record that names the functions for its commands."""

from __future__ import annotations

import copy
import inspect
import os
import pickle
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from anhyst.compilation.compiled_stage import HasController
from anhyst.support.errors import InputError
from anhyst.support.kinds import RIG_FORMAT, file_kind, require_capability, rig_kinds
from anhyst_exchange.exporter import RIG_PART_FACTORIES
from anhyst_rigs.kinds.rig_kind import RigKind
from anhyst_rigs.reports.studies import HasBenefit, HasBoard, HasPlants, HasSimulation
from anhyst_rigs.study.bench import HasBench
from anhyst_rigs.study.benefit import HasIrons
from anhyst_rigs.study.excite.excite import HasSpecimen
from anhyst_rigs.study.tracking.calibrate import HasCalibration
from anhyst_rigs.study.tuning.tuning import HasTuning
from tests.repository import ROOT

EXAMPLES = ROOT / "examples"
PROTOCOLS: dict[str, tuple[type, ...]] = {
    "simulate": (HasSimulation, HasPlants, HasBenefit),
    "tune": (HasTuning,),
    "excite": (HasSpecimen,),
    "calibrate": (HasCalibration,),
    "live": (HasBench,),
    "export": (),
    "compile": (HasController,),
    "force-control": (),
}
RIGS = {"bearing": "levitation", "stage": "tracking", "solenoid": "force", "piezo": "displacement"}


def methods_of(protocol: type) -> dict[str, Any]:
    return {name: var for name, var in vars(protocol).items() if not name.startswith("_")}


def arguments(function: Any) -> int:
    parameters = inspect.signature(function).parameters.values()
    return sum(parameter.default is parameter.empty and parameter.name != "self" for parameter in parameters)


@pytest.mark.parametrize("word", RIGS.values())
def test_a_rig_kind_implements_exactly_the_protocols_of_its_verbs(word: str) -> None:
    kind = rig_kinds()[word]
    assert isinstance(kind, RigKind)
    assert ("export" in kind.verbs) == (word in RIG_PART_FACTORIES)
    required_protocols = [protocol for verb in kind.verbs for protocol in PROTOCOLS[verb]]
    if kind.has_option("simulate", "--board"):
        required_protocols.append(HasBoard)
    if "with_iron" in kind.places:
        required_protocols.append(HasIrons)
    expected_methods = {
        name: method for protocol in required_protocols for name, method in methods_of(protocol).items()
    }
    assert kind.places.keys() == expected_methods.keys()
    for name, method in expected_methods.items():
        own_arguments = arguments(getattr(kind, name))
        # callers may omit an argument that has a default
        assert own_arguments <= arguments(method), name
        assert len(inspect.signature(getattr(kind, name)).parameters) >= arguments(method), name


@pytest.mark.parametrize(("folder", "word"), RIGS.items())
def test_the_files_of_an_example_are_those_that_it_names(folder: str, word: str) -> None:
    path = EXAMPLES / folder / "rig.toml"
    assert file_kind(path).word == word
    files = require_capability(file_kind(path), HasBench).files(path, None)
    assert files[0] == path
    assert all(file.is_file() for file in files)
    file_names = {file.name for file in files}
    assert ("controller.toml" in file_names) == (word == "levitation")
    assert any(name.startswith("loops") for name in file_names) == (word != "displacement")


def test_a_record_is_copied_and_has_its_places_then() -> None:
    kind = rig_kinds()["levitation"]
    assert vars(copy.copy(kind)) == vars(pickle.loads(pickle.dumps(kind))) == vars(kind)


def test_a_kind_is_known_before_its_work_is_imported() -> None:
    program = (
        "import sys; from anhyst.support.kinds import file_kind;"
        f"assert file_kind({str(EXAMPLES / 'bearing' / 'rig.toml')!r}).title == 'a bearing';"
        "loaded = [one for one in sys.modules if one.startswith('anhyst')];"
        "assert not [one for one in loaded if '.study' in one or '.rig.' in one], loaded"
    )
    subprocess.run([sys.executable, "-c", program], check=True)


OVEN = """
from pathlib import Path
from anhyst_rigs.kinds.rig_kind import RigKind
from anhyst_rigs.reports.study.page import TerminalSummary
from anhyst_rigs.study.engine.table import Judgement, StudyResult


class Heated(StudyResult):
    kind = "oven"
    lost_in = []
    verdict = Judgement("yes", "it is warm")

    def as_dict(self):
        return {"kelvin": 300.0}

    def facts(self):
        return {"kelvin": "300"}

    def to_columns(self):
        return {"kelvin": [300.0]}

    def draw(self, ax):
        ax.plot([300.0])


def simulate(task):
    if task.writes_files:
        task.out.write_text("kelvin\\n300\\n")
    return Heated()


def printed(result):
    return TerminalSummary([], ["300 K"])


def written(result, out):
    return f"{out}"


OVEN = RigKind(
    word="oven",
    title="an oven",
    plural="ovens",
    verbs=("simulate", "export"),
    places={name: f"oven:{name}" for name in ("simulate", "printed", "written")},
    reasons={"tune": "it has a switch and nothing else"},
)
"""


def install(folder: Path, name: str, entry: str, text: str) -> None:
    """Install a package of one module that adds a kind of rig."""
    about = folder / "package" / f"{name}-1.0.dist-info"
    about.mkdir(parents=True)
    (folder / "package" / f"{name}.py").write_text(text)
    (about / "METADATA").write_text(f"Name: {name}\nVersion: 1.0\n")
    (about / "entry_points.txt").write_text(f"[anhyst.kinds]\n{entry}\n")


@pytest.fixture
def oven(tmp_path: Path) -> Path:
    """Return a folder with a rig file of a kind that an installed package adds."""
    install(tmp_path, "oven", "oven = oven:OVEN", OVEN)
    (tmp_path / "rig.toml").write_text(f'format = "{RIG_FORMAT}"\n[control]\nkind = "oven"\n')
    return tmp_path


def run(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, "-m", "anhyst.cli.app", *arguments],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(folder / "package"), "COLUMNS": "300"},
        capture_output=True,
        text=True,
        check=False,
    )


def test_an_installed_package_adds_a_kind_of_rig(oven: Path) -> None:
    completed = run(oven, "simulate", "rig.toml", "--out", "run.csv")
    assert completed.returncode == 0, completed.stderr
    assert "it is warm" in completed.stdout
    assert "300 K" in completed.stdout
    assert (oven / "run.csv").is_file()
    refused = run(oven, "tune", "rig.toml", "--out", "tuned")
    assert refused.returncode == 2
    assert "rig.toml: this is an oven; tune is for bearings, piezo stages and stages" in (refused.stderr)
    assert "it has a switch and nothing else; anhyst simulate and export take it" in refused.stderr
    refused = run(oven, "simulate", "rig.toml", "--out", "run.json", "--board", "host")
    assert (refused.returncode, "an oven has no --board; leave it out" in refused.stderr) == (2, True)


def test_a_rig_kind_without_a_needed_method_is_named(oven: Path) -> None:
    refused = run(oven, "export", "rig.toml", "--as", "simulink", "--out", "block")
    assert refused.returncode == 2
    assert "rig.toml: control.kind: 'oven' has no part for export; ask the author" in refused.stderr
    refused = run(oven, "simulate", "rig.toml", "--out", "p.jsonl", "--monte-carlo", "2")
    assert refused.returncode == 2
    assert "'files' of the kind 'oven' cannot be used" in refused.stderr
    with pytest.raises(InputError, match="'tuning' of the kind 'force'"):
        require_capability(rig_kinds()["force"], HasTuning)


@pytest.mark.parametrize(
    ("entry", "text", "why"),
    [
        ("oven = other:OVEN", "import none_such", "other adds it and cannot be loaded"),
        ("oven = other:NONE", "", "other adds it and cannot be loaded"),
        ("oven = other:OVEN", "raise SystemExit(3)", "other adds it and cannot be loaded"),
        ("oven = other:OVEN", "OVEN = 1", "other adds it, and its record is not a kind of rig"),
        ("oven = other:OVEN", OVEN.replace('"oven"', '"stove"'), "other adds it, and its record has"),
        ("oven = other:OVEN", OVEN.replace('"ovens"', "None"), "other adds it, and its title or its plural"),
        ("oven = other:OVEN", OVEN.replace('("simulate", "export")', '("watch")'), "other adds it, an"),
        ("oven = anhyst_rigs.kinds.nosuch:OVEN", "", "other adds it and cannot be loaded"),
    ],
)
def test_an_unusable_package_affects_only_its_own_files(
    entry: str, text: str, why: str, tmp_path: Path
) -> None:
    install(tmp_path, "other", entry, text)
    (tmp_path / "rig.toml").write_text(f'format = "{RIG_FORMAT}"\n[control]\nkind = "oven"\n')
    refused = run(tmp_path, "simulate", "rig.toml", "--out", "run.csv")
    assert refused.returncode == 2
    assert f"rig.toml:3: control.kind: {why}" in refused.stderr
    assert refused.stderr.count("\n") == 1
    good = run(tmp_path, "tune", str(EXAMPLES / "solenoid" / "rig.toml"), "--out", "tuned")
    assert "this is a rig of force control" in good.stderr


def test_two_packages_of_one_kind_are_named_and_neither_is_used(oven: Path) -> None:
    install(oven, "stove", "oven = stove:OVEN", OVEN)
    refused = run(oven, "simulate", "rig.toml", "--out", "run.csv")
    assert refused.returncode == 2
    assert "both add it; remove one of them" in refused.stderr


def test_a_package_does_not_replace_a_kind_of_anhyst(tmp_path: Path) -> None:
    install(tmp_path, "force", "force = force:OVEN", OVEN.replace('"oven"', '"force"'))
    refused = run(tmp_path, "tune", str(EXAMPLES / "solenoid" / "rig.toml"), "--out", "tuned")
    assert "this is a rig of force control" in refused.stderr
