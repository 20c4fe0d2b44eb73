"""Test the wheel of anhyst alone, as a user without the repository installs it."""

from __future__ import annotations

import json
import os
import shutil
import sys
from pathlib import Path

import pytest

from anhyst._core import _native
from tests.once import made_once
from tests.repository import ROOT
from tools.wheel import (
    build_others,
    build_wheel,
    check_wheel,
    empty_environment,
    installed_megabytes,
    run,
    run_page,
    try_tutorial,
)

HERE = Path(sys.executable)
LOOPS = ROOT / "examples" / "electromagnet" / "loops.csv"

SLOW = pytest.mark.slow


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the wheel of this Python for this machine, as it is published."""
    folder = made_once(
        tmp_path_factory, "wheel", lambda folder: build_wheel(HERE, os.uname().machine, folder)
    )
    (found,) = folder.glob("*.whl")
    return found


@pytest.fixture(scope="module")
def alone(wheel: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Install the wheel into an empty environment; return the Python of that environment."""
    folder = made_once(tmp_path_factory, "empty", lambda folder: empty_environment(HERE, wheel, folder))
    return folder / "bin" / "python"


def anhyst(python: Path, *arguments: object, cwd: Path) -> str:
    return run([str(python), "-m", "anhyst.cli.app", *map(str, arguments)], cwd)


@SLOW
def test_the_wheel_runs_on_the_old_systems_that_its_name_promises(wheel: Path, tmp_path: Path) -> None:
    check_wheel(wheel)
    older = tmp_path / wheel.name.replace("manylinux_2_17", "manylinux_2_5")
    shutil.copy(wheel, older)
    with pytest.raises(RuntimeError, match=r"GLIBC_2\.1[0-9]"):
        check_wheel(older)


@SLOW
def test_the_wheel_selects_the_instruction_set_of_the_native_build(alone: Path, tmp_path: Path) -> None:
    script = "from anhyst._core import _native; print(*_native.batch_levels())"
    assert run([str(alone), "-c", script], tmp_path).split() == _native.batch_levels()


@SLOW
def test_the_wheel_finds_the_model_that_the_native_build_finds(alone: Path, tmp_path: Path) -> None:
    asked = ("identify", LOOPS, "--law", "effective-field", "--gap-map", "scaling", "--json")
    ours, theirs = (
        json.loads(anhyst(python, *asked, "--out", tmp_path / name, cwd=tmp_path))
        for python, name in ((HERE, "native.toml"), (alone, "wheel.toml"))
    )
    for name in ("M_s", "a", "k", "c", "alpha"):
        assert theirs["parameters"][name] == pytest.approx(ours["parameters"][name], rel=1e-3)
    assert theirs["fit"]["worst"] == pytest.approx(ours["fit"]["worst"], rel=1e-3)


@SLOW
def test_the_wheel_contains_examples_and_core_sources(alone: Path, tmp_path: Path) -> None:
    module_path = run([str(alone), "-c", "import anhyst; print(anhyst.__file__)"], tmp_path)
    assert Path(module_path).is_relative_to(alone.parents[1])
    anhyst(alone, "example", "bearing", "--out", "my", cwd=tmp_path)
    example = ROOT / "examples" / "bearing" / "rig.toml"
    assert (tmp_path / "my" / "rig.toml").read_bytes() == example.read_bytes()
    assert "12 loops" in anhyst(alone, "inspect", "my/loops.csv", cwd=tmp_path)


@SLOW
def test_a_verb_of_another_package_is_named_with_its_package(alone: Path, tmp_path: Path) -> None:
    for words, package in (
        (("simulate", "rig.toml", "--out", "x"), "anhyst-rigs"),
        (("force-control", "--help"), "anhyst-rigs"),
        (("export", "model.toml"), "anhyst-exchange"),
    ):
        with pytest.raises(RuntimeError, match=f"{words[0]} is in the package {package}"):
            anhyst(alone, *words, cwd=tmp_path)
    script = "import anhyst; anhyst.simulate"
    with pytest.raises(RuntimeError, match=r"anhyst\.simulate is in the package anhyst-rigs"):
        run([str(alone), "-c", script], tmp_path)
    shutil.copy(ROOT / "examples" / "stage" / "rig.toml", tmp_path)
    with pytest.raises(RuntimeError, match=r"this is a rig file; .* pip install anhyst-rigs"):
        anhyst(alone, "compile", "rig.toml", "--out", "c", cwd=tmp_path)


@SLOW
def test_the_tutorial_runs_up_to_step_6_with_anhyst_alone_and_then_with_all_parts(
    alone: Path, tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    other_wheels = build_others(tmp_path_factory.mktemp("others"))
    said: list[str] = []
    try_tutorial(alone, other_wheels, tmp_path, said.append)
    alone_, all_ = (int(text.split()[0]) for text in said)
    assert 7 <= alone_ < all_
    assert installed_megabytes(alone) < 400.0


PAGE = """
```sh
echo 4 > number.txt
```

<!-- not run: there is no such thing -->
```sh
no-such-command
```

```python
assert open("number.txt").read() == "4\\n"
```

```text
no-such-command
```
"""


def test_blocks_of_a_page_run_in_order_and_a_failure_is_reported(tmp_path: Path) -> None:
    assert run_page(PAGE, HERE, tmp_path) == 2
    with pytest.raises(RuntimeError, match="no-such-command"):
        run_page(PAGE.replace("<!-- not run: there is no such thing -->", ""), HERE, tmp_path)
