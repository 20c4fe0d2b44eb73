"""Test that an external package can add a law, a format, a command and a rig kind."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from anhyst.model.actuator import read_model
from tests.house.outside import build_installed_package, installed, page_file
from tests.repository import ROOT

LOOPS = ROOT / "examples" / "electromagnet" / "loops.csv"


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder in which the package of docs/contributing.md is installed."""
    return build_installed_package(tmp_path_factory)


def run_python(site: Path, place: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Run Python with an installed package."""
    path = os.pathsep.join([str(site), os.environ["PYTHONPATH"]])
    return subprocess.run(
        [sys.executable, *words],
        cwd=place,
        env=os.environ | {"PYTHONPATH": path, "COLUMNS": "300"},
        capture_output=True,
        text=True,
        check=False,
    )


def anhyst(site: Path, place: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Run a command with an installed package."""
    return run_python(site, place, "-m", "anhyst.cli.app", *arguments)


def write_loops(path: Path) -> None:
    """Write loops of a single play operator in the format of the package."""
    ascending_current = np.linspace(0.0, 3.0, 13)
    lines: list[list[object]] = [["I_A", "F_N", "gap_mm", "loop"]]
    for gap in (0.3, 0.5):
        for label, relative_peak in (("large", 1.0), ("small", 0.4)):
            drive = relative_peak * np.concatenate(
                [ascending_current, ascending_current[-2::-1], ascending_current[1:]]
            )
            play_state = 0.0
            for current in drive:
                play_state = min(max(play_state, current - 0.2), current + 0.2)
                lines.append([float(current), 30.0 * (play_state / (0.2 + gap)) ** 2, gap, label])
    path.write_text("\n".join(map(json.dumps, lines)))


def test_its_law_fits_loops_in_its_format_and_its_verb_reads_them(site: Path, tmp_path: Path) -> None:
    write_loops(tmp_path / "loops.toy")
    arguments = ("loops.toy", "--history", "demagnetised")
    found = anhyst(
        *(site, tmp_path, "identify", *arguments, "--law", "play"),
        *("--gap-map", "reluctance", "--out", "model.toml", "--json"),
    )
    assert found.returncode == 0, found.stderr
    with installed(site):
        model = read_model(tmp_path / "model.toml")
        assert model.law == "play"
        assert [source.path for source in model.provenance.sources] == ["loops.toy"]
        assert model.predict([0.0, 1.0, 2.0], 0.3e-3, history="demagnetised").output[2] > 0.0
    found = anhyst(site, tmp_path, "widest", *arguments, "--share", "0.25", "--json")
    assert found.returncode == 0, found.stderr
    printed_model = json.loads(found.stdout)
    assert 0.3 < printed_model["width"] < 0.5  # twice the play
    assert "Example: anhyst widest" in anhyst(site, tmp_path, "widest", "--help").stdout
    program = "import anhyst; print(anhyst.widest('loops.toy', history='demagnetised')['loop'])"
    completed = run_python(site, tmp_path, "-c", program)
    assert completed.stdout.split() == [printed_model["loop"]]


def test_without_it_nothing_knows_its_law_or_its_verb(site: Path, tmp_path: Path) -> None:
    assert site.is_dir()
    failed_command = anhyst(tmp_path, tmp_path, "identify", str(LOOPS), "--law", "play", "--out", "m.toml")
    assert failed_command.returncode == 2
    assert "play" in failed_command.stderr
    assert anhyst(tmp_path, tmp_path, "widest", str(LOOPS)).returncode == 2


def test_its_kind_of_rig_is_simulated(site: Path, tmp_path: Path) -> None:
    (tmp_path / "oven.toml").write_text(page_file("oven.toml"))
    found = anhyst(site, tmp_path, "simulate", "oven.toml", "--out", "run.csv")
    assert found.returncode == 0, found.stderr
    assert "300 K" in found.stdout
    assert (tmp_path / "run.csv").is_file()


def install_module(folder: Path, name: str, entry_points: str, text: str) -> None:
    """Install a package of one module by hand."""
    metadata_folder = folder / f"{name}-1.0.dist-info"
    metadata_folder.mkdir(parents=True)
    (folder / f"{name}.py").write_text(text)
    (metadata_folder / "METADATA").write_text(f"Name: {name}\nVersion: 1.0\n")
    (metadata_folder / "entry_points.txt").write_text(entry_points)


LAW_MODULE = """
from dataclasses import replace
from anhyst.laws.play_cells import PLAY_CELLS
LAW = replace(PLAY_CELLS, name="{name}")
"""

SWAPPED_PARAMETERS_MODULE = """
from anhyst.laws.law import Law, ParameterSpec
def iron(r, chi): pass
LAW = Law("bad", "moved", (ParameterSpec("chi", "a"), ParameterSpec("r", "b")), iron)
"""

FAULTY_PACKAGES = {
    "parameters in wrong order": ("[anhyst.laws]\nbad = other:LAW\n", SWAPPED_PARAMETERS_MODULE),
    "cannot be imported": ("[anhyst.laws]\nbad = other:LAW\n", "import no_such_module"),
    "leaves the process": ("[anhyst.laws]\nbad = other:LAW\n", "raise SystemExit(3)"),
    "is no law": ("[anhyst.laws]\nbad = other:LAW\n", "LAW = 1"),
    "has another name": ("[anhyst.laws]\nbad = other:LAW\n", LAW_MODULE.format(name="good")),
    "is no function": ("[anhyst.formats]\nbad = other:open\n", "open = 1"),
    "has no verbs": ("[anhyst.verbs]\nbad = other\n", ""),
    "missing module of verbs": ("[anhyst.verbs]\nbad = other.verbs\n", ""),
    "no target": ("[anhyst.targets]\nbad = other:TARGET\n", "TARGET = 1"),
    "no kind": ("[anhyst.kinds]\nbad = other:KIND\n", "KIND = 1"),
    "invalid entry point": ("[anhyst.laws]\nbad = not a module!\n", ""),
    "damaged metadata": ("[anhyst.laws]\nbad\n", ""),
    "prints": ("[anhyst.formats]\nbad = other:open\n", "print('HELLO')\ndef open(): pass"),
    "no actuator": ("[anhyst.actuators]\nbad = other:KIND\n", "KIND = 1"),
}


@pytest.mark.parametrize(("points", "text"), FAULTY_PACKAGES.values(), ids=FAULTY_PACKAGES)
def test_a_package_with_a_fault_disturbs_no_command(points: str, text: str, tmp_path: Path) -> None:
    install_module(tmp_path / "site", "other", points, text)
    found = anhyst(tmp_path / "site", tmp_path, "inspect", str(LOOPS), "--json")
    assert found.returncode == 0, found.stderr
    assert json.loads(found.stdout)["loops"]
    assert found.stderr.count("\n") <= 1
    if "verbs" in points:
        assert "warning: left out: other: 'other" in found.stderr


def test_an_unusable_law_is_reported_with_the_reason(tmp_path: Path) -> None:
    install_module(tmp_path / "site", "other", *FAULTY_PACKAGES["cannot be imported"])
    refused = anhyst(
        *(tmp_path / "site", tmp_path, "identify", str(LOOPS), "--law", "bad", "--out", "m.toml")
    )
    assert refused.returncode == 2
    assert "other adds it and cannot be loaded" in refused.stderr
    assert refused.stderr.count("\n") == 1


def test_an_unusable_format_is_reported_with_the_reason(tmp_path: Path) -> None:
    install_module(tmp_path / "site", "other", *FAULTY_PACKAGES["is no function"])
    (tmp_path / "loops.bad").write_text("I_A,F_N\n0,0\n")
    refused = anhyst(tmp_path / "site", tmp_path, "inspect", "loops.bad")
    assert refused.returncode == 2
    assert "loops.bad: other adds it, and it is not a function; update it" in refused.stderr


HELLO_MODULE = '''print("imported")


def hello(name: str) -> dict:
    """Greet.

    Parameters
    ----------
    name : str
        Who.
    """
    return {"hello": name}


'''


def test_a_faulty_verb_is_omitted_and_others_remain(tmp_path: Path) -> None:
    site = tmp_path / "site"
    install_module(site, "other", "[anhyst.verbs]\nother = more.verbs\n", "")
    (site / "more" / "verbs").mkdir(parents=True)
    for name in ("__init__.py", "verbs/__init__.py", "verbs/empty.py"):
        (site / "more" / name).write_text("")
    (site / "more" / "__init__.py").write_text("from anhyst import InputError, Model, identify\n")
    (site / "more" / "verbs" / "broken.py").write_text("import no_such_module")
    (site / "more" / "verbs" / "inspect.py").write_text("raise SystemExit('replaced')")
    (site / "more" / "verbs" / "ends.py").write_text("raise SystemExit(3)")
    (site / "more" / "verbs" / "_helper.py").write_text("import no_such_module")
    (site / "more" / "verbs" / "hello.py").write_text(HELLO_MODULE)
    placed = HELLO_MODULE.replace("hello", "placed") + "PLACE = 'top'\n"
    (site / "more" / "verbs" / "placed.py").write_text(placed)
    found = anhyst(site, tmp_path, "hello", "you", "--json")
    assert json.loads(found.stdout) == {"hello": "you"}
    for expected_text in (
        "left out: the verb broken of more.verbs.broken: No module named",
        "left out: the verb empty of more.verbs.empty",
        "left out: other: its verb inspect, which anhyst has too; rename it",
        "left out: the verb ends of more.verbs.ends: 3",
        "left out: the verb placed of more.verbs.placed: PLACE must be",
    ):
        assert expected_text in found.stderr
    assert len(found.stderr.splitlines()) == 5 + 2  # and the output of two of the modules
    assert "hello" in anhyst(site, tmp_path, "--help").stdout
    program = "from anhyst import *; import anhyst; print(identify is anhyst.identify)"
    assert run_python(site, tmp_path, "-c", program).stdout == "True\n"
    assert anhyst(site, tmp_path, "inspect", str(LOOPS)).returncode == 0
    for first in ("more.verbs, anhyst", "anhyst, more.verbs"):
        completed = run_python(site, tmp_path, "-c", f"import {first}; print(anhyst.hello('me'))")
        assert completed.stdout.endswith("{'hello': 'me'}\n"), completed.stderr


def test_an_error_in_a_package_names_the_package(tmp_path: Path) -> None:
    text = "def open(path, least):\n    return {}[path]"
    install_module(tmp_path, "other", "[anhyst.formats]\nbad = other:open\n", text)
    (tmp_path / "loops.bad").write_text("1")
    fault = anhyst(tmp_path, tmp_path, "inspect", "loops.bad")
    assert fault.returncode == 70
    assert "this is a fault of the package other, not of your input" in fault.stderr


def test_a_law_with_parameters_in_wrong_order_is_refused(tmp_path: Path) -> None:
    install_module(tmp_path, "other", *FAULTY_PACKAGES["parameters in wrong order"])
    arguments = ("identify", str(LOOPS), "--law", "bad", "--out", "m.toml")
    refused = anhyst(tmp_path, tmp_path, *arguments)
    assert "its iron takes the parameters in another order" in refused.stderr


TYPED_VERB_MODULE = '''from typing import Literal, Optional


def typed(a: int, *, b: Optional[float] = None, c: Literal["kg", "g"] = "g") -> dict:
    """Show types.

    Parameters
    ----------
    a : int
        One.
    b : float, optional
        Two.
    c : str
        Three.
    """
    return {"types": " ".join(type(one).__name__ for one in (a, b, c))}
'''


@pytest.mark.parametrize("future", ["", "from __future__ import annotations\n"])
def test_types_of_a_verb_reach_its_function(future: str, tmp_path: Path) -> None:
    install_module(tmp_path, "other", "[anhyst.verbs]\nother = lab.verbs\n", "")
    (tmp_path / "lab" / "verbs").mkdir(parents=True)
    (tmp_path / "lab" / "verbs" / "__init__.py").write_text("")
    (tmp_path / "lab" / "verbs" / "typed.py").write_text(future + TYPED_VERB_MODULE)
    completed = anhyst(tmp_path, tmp_path, "typed", "3", "--b", "2", "--c", "kg")
    assert completed.stdout == "types: int float str\n", completed.stderr
    assert "'t' is not one of 'kg', 'g'" in anhyst(tmp_path, tmp_path, "typed", "3", "--c", "t").stderr


def test_two_packages_with_one_law_are_named(tmp_path: Path) -> None:
    for name in ("one", "two"):
        install_module(tmp_path, name, f"[anhyst.laws]\nmine = {name}:LAW\n", LAW_MODULE.format(name="mine"))
    refused = anhyst(*(tmp_path, tmp_path, "identify", str(LOOPS), "--law", "mine", "--out", "m.toml"))
    assert refused.returncode == 2
    assert "one and two both add it; remove one of them" in refused.stderr


def test_a_package_without_its_metadata_adds_nothing_and_breaks_nothing(tmp_path: Path) -> None:
    install_module(tmp_path, "other", *FAULTY_PACKAGES["is no law"])
    (tmp_path / "other-1.0.dist-info" / "METADATA").unlink()
    assert anhyst(tmp_path, tmp_path, "inspect", str(LOOPS), "--json").returncode == 0


def test_two_packages_with_one_verb_are_named_and_neither_is_used(tmp_path: Path) -> None:
    for name in ("one", "two"):
        install_module(tmp_path, name, f"[anhyst.verbs]\n{name} = {name}_lab.verbs\n", "")
        (tmp_path / f"{name}_lab" / "verbs").mkdir(parents=True)
        (tmp_path / f"{name}_lab" / "verbs" / "__init__.py").write_text("")
        (tmp_path / f"{name}_lab" / "verbs" / "hello.py").write_text(HELLO_MODULE)
    refused = anhyst(tmp_path, tmp_path, "hello", "you")
    assert refused.returncode == 2
    assert "left out: two: its verb hello, which one has too; rename it" in refused.stderr


def test_a_package_does_not_replace_a_target(tmp_path: Path) -> None:
    target = "class T:\n    missing_tools = verify = lambda *a: 1 / 0\nT = T()\n"
    points = "[anhyst.targets]\nhost = other:T\nmine = other:U\n"
    install_module(tmp_path, "other", points, target)
    program = (
        "from anhyst.verification.targets import TARGETS, WHOLE_TARGETS as whole;"
        "print('host' in whole, 'host' in TARGETS, whole.explain_unusable('mine'))"
    )
    said = run_python(tmp_path, tmp_path, "-c", program).stdout
    assert said.startswith("False True other adds it and cannot be loaded")


@pytest.mark.parametrize("init", [True, False])
def test_a_changed_package_invalidates_cached_results(init: bool, tmp_path: Path) -> None:
    install_module(tmp_path, "other", "[anhyst.laws]\nmine = lab.law:LAW\n", "")
    (tmp_path / "lab").mkdir()
    if init:
        (tmp_path / "lab" / "__init__.py").write_text("")
    program = "from anhyst.support.cache import code_digest; print(code_digest().hex())"
    found = set()
    for law in ("mine", "mine", "other"):
        (tmp_path / "lab" / "law.py").write_text(LAW_MODULE.format(name=law))
        found.add(run_python(tmp_path, tmp_path, "-c", program).stdout)
    assert len(found) == 2
