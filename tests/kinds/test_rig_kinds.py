"""A kind of rig is one record: it says where the work of each of its verbs is done."""

from __future__ import annotations

import inspect
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from anhyst.exchange.export import HasPart
from anhyst.kinds.rig_kind import RigKind
from anhyst.reports.studies import HasBoard, HasSimulation
from anhyst.study.bench import HasBench
from anhyst.study.benefit import HasIrons
from anhyst.study.excite.excite import HasSpecimen
from anhyst.study.tracking.calibrate import HasCalibration
from anhyst.study.tracking.compiled import HasController
from anhyst.study.tuning.tuning import HasTuning
from anhyst.support.errors import InputError
from anhyst.support.kinds import RIG_FORMAT, doing, kind_of, rig_kinds

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
PROTOCOLS: dict[str, tuple[type, ...]] = {
    "simulate": (HasSimulation,),
    "tune": (HasTuning,),
    "excite": (HasSpecimen,),
    "calibrate": (HasCalibration,),
    "live": (HasBench,),
    "export": (HasPart,),
    "compile": (HasController,),
    "force-control": (),
}
RIGS = {"bearing": "levitation", "stage": "tracking", "solenoid": "force", "piezo": "displacement"}


def methods_of(protocol: type) -> dict[str, Any]:
    return {name: one for name, one in vars(protocol).items() if not name.startswith("_")}


def arguments(function: Any) -> int:
    parameters = inspect.signature(function).parameters.values()
    return sum(one.default is one.empty and one.name != "self" for one in parameters)


@pytest.mark.parametrize("word", RIGS.values())
def test_a_record_does_what_every_verb_of_it_asks_and_nothing_else(word: str) -> None:
    kind = rig_kinds()[word]
    assert isinstance(kind, RigKind)
    asked = [one for verb in kind.verbs for one in PROTOCOLS[verb]]
    if kind.has_option("simulate", "--board"):
        asked.append(HasBoard)
    if "with_iron" in kind.places:
        asked.append(HasIrons)
    wanted = {name: one for protocol in asked for name, one in methods_of(protocol).items()}
    assert kind.places.keys() == wanted.keys()
    for name, method in wanted.items():
        own = arguments(getattr(kind, name))
        # an argument that has a default may be left out by those who ask
        assert own <= arguments(method), name
        assert len(inspect.signature(getattr(kind, name)).parameters) >= arguments(method), name


@pytest.mark.parametrize(("folder", "word"), RIGS.items())
def test_the_files_of_an_example_are_those_that_it_names(folder: str, word: str) -> None:
    path = EXAMPLES / folder / "rig.toml"
    assert kind_of(path).word == word
    files = doing(kind_of(path), HasBench).files(path, None)
    assert files[0] == path
    assert all(file.is_file() for file in files)
    named = {file.name for file in files}
    assert ("controller.toml" in named) == (word == "levitation")
    assert any(name.startswith("loops") for name in named) == (word != "displacement")


def test_a_kind_is_known_before_its_work_is_imported() -> None:
    program = (
        "import sys; from anhyst.support.kinds import kind_of;"
        f"assert kind_of({str(EXAMPLES / 'bearing' / 'rig.toml')!r}).title == 'a bearing';"
        "loaded = [one for one in sys.modules if one.startswith('anhyst.')];"
        "assert not [one for one in loaded if '.study' in one or '.rig.' in one], loaded"
    )
    subprocess.run([sys.executable, "-c", program], check=True)


OVEN = """
from pathlib import Path
from anhyst.kinds.rig_kind import RigKind
from anhyst.reports.study.page import Printed
from anhyst.study.engine.table import Judgement, StudyResult


class Heated(StudyResult):
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
    return Heated()


def printed(result):
    return Printed([], ["300 K"])


def written(result, out):
    return f"{out}"


def read(rig):
    return rig


def files(rig, controller):
    return [Path(rig)]


def none(*_):
    raise AssertionError


OVEN = RigKind(
    word="oven",
    title="an oven",
    plural="ovens",
    verbs=("simulate", "export"),
    places={
        **{name: f"oven:{name}" for name in ("simulate", "printed", "written", "read", "files")},
        **dict.fromkeys(("plants", "benefit"), "oven:none"),
    },
    reasons={"tune": "it has a switch and nothing else"},
)
"""


@pytest.fixture
def oven(tmp_path: Path) -> Path:
    """Install a package that adds a kind of rig, and return the folder with one of its files."""
    package = tmp_path / "package"
    (package / "oven-1.0.dist-info").mkdir(parents=True)
    (package / "oven.py").write_text(OVEN)
    (package / "oven-1.0.dist-info" / "METADATA").write_text("Name: oven\nVersion: 1.0\n")
    (package / "oven-1.0.dist-info" / "entry_points.txt").write_text(
        "[anhyst.kinds]\noven = oven:OVEN\n"
    )
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
    done = run(oven, "simulate", "rig.toml", "--out", "run.csv")
    assert done.returncode == 0, done.stderr
    assert "it is warm" in done.stdout
    assert "300 K" in done.stdout
    refused = run(oven, "tune", "rig.toml", "--out", "tuned")
    assert refused.returncode == 2
    assert "rig.toml: this is an oven; tune is for bearings, piezo stages and stages" in (
        refused.stderr
    )
    assert "it has a switch and nothing else; anhyst simulate and export take it" in refused.stderr
    refused = run(oven, "simulate", "rig.toml", "--out", "run.json", "--board", "host")
    assert (refused.returncode, "an oven has no --board; leave it out" in refused.stderr) == (
        2,
        True,
    )


def test_a_record_that_leaves_out_what_its_verb_asks_is_named(oven: Path) -> None:
    refused = run(oven, "export", "rig.toml", "--as", "simulink", "--out", "block")
    assert refused.returncode == 2
    assert "the package that adds 'oven' does not say how to 'part'" in refused.stderr
    with pytest.raises(InputError, match="does not say how to 'tuning'"):
        doing(rig_kinds()["force"], HasTuning)
