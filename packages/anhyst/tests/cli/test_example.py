"""``anhyst example``: a copy of a bundled example."""

from __future__ import annotations

from pathlib import Path
from typing import get_args

import pytest

from anhyst import InputError, example_files
from anhyst.data.examples import EXAMPLES as EXAMPLE_NAMES
from anhyst.verbs.example import ExampleName
from tests.cli.command import contents, quick, refused
from tests.refusals import says
from tests.repository import ROOT

EXAMPLES = ROOT / "examples"


@pytest.mark.parametrize(
    "name", ["bearing", "electromagnet", "magnetostrictive", "piezo", "solenoid", "stage", "steels"]
)
def test_an_example_is_copied_as_it_is(tmp_path: Path, name: str) -> None:
    result = quick("example", name, "--out", "my", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    for place, content in contents(tmp_path / "my").items():
        if content is not None:
            assert content == (EXAMPLES / name / place).read_bytes()
    has_licence = (EXAMPLES / name / "LICENSE").is_file()
    assert has_licence == (tmp_path / "my" / "LICENSE").is_file()
    command = result.stdout.splitlines()[-1].split()
    assert command[0] == "anhyst"
    assert (tmp_path / command[2]).is_file()


def test_an_unknown_example_is_refused_with_the_list_of_examples(tmp_path: Path) -> None:
    message = refused("example", "motor", "--out", "my", cwd=tmp_path)
    known = ("bearing", "electromagnet", "magnetostrictive", "piezo", "solenoid", "stage", "steels")
    assert "'motor' is not one of " + ", ".join(f"'{name}'" for name in known) in message
    assert get_args(ExampleName) == tuple(EXAMPLE_NAMES) == known
    with pytest.raises(InputError, match=f"motor.*{', '.join(known)}"):
        example_files("motor")


def test_an_existing_file_is_not_replaced(tmp_path: Path) -> None:
    (tmp_path / "loops.csv").write_text("mine")
    message = refused("example", "bearing", "--out", ".", cwd=tmp_path)
    assert says(message, "exists-already: loops.csv")
    assert contents(tmp_path) == {"loops.csv": b"mine"}
