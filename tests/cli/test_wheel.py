"""The wheel alone: what a user has who never saw the repository."""

from __future__ import annotations

import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

from .command import ENVIRONMENT

ROOT = Path(__file__).parents[2]
OTHERS = sysconfig.get_paths()["purelib"]


def run(*command: object, cwd: Path) -> subprocess.CompletedProcess[str]:
    result = subprocess.run(
        [sys.executable, *map(str, command)],
        cwd=cwd,
        capture_output=True,
        text=True,
        check=False,
        env=ENVIRONMENT,
    )
    assert result.returncode == 0, result.stderr
    return result


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Build the wheel and install it, without what it depends on, into a folder."""
    folder = tmp_path_factory.mktemp("wheel")
    pip = ("-m", "pip", "--disable-pip-version-check", "--quiet")
    alone = ("--no-deps", "--no-build-isolation", "--wheel-dir", folder)
    run(*pip, "wheel", *alone, ROOT, cwd=folder)
    (wheel,) = folder.glob("anhyst-*.whl")
    run(*pip, "install", "--no-deps", "--target", folder / "site", wheel, cwd=folder)
    return folder / "site"


@pytest.mark.slow
def test_the_wheel_runs_outside_the_repository_and_brings_its_examples(
    installed: Path, tmp_path: Path
) -> None:
    where = ("-S", "-c", START.format(own=installed, others=OTHERS))
    there = run(*where, "--version", cwd=tmp_path)
    assert there.stdout.split()[-1] == str(installed / "anhyst")
    run(*where, "init", "--example", "bearing", "--out", "my", cwd=tmp_path)
    example = ROOT / "examples" / "bearing" / "rig.toml"
    assert (tmp_path / "my" / "rig.toml").read_bytes() == example.read_bytes()
    own = run(*where, "init", "my/loops.csv", "--out", "own", cwd=tmp_path)
    assert "anhyst simulate own/rig.toml" in own.stdout
    found = run(*where, "inspect", "own/loops/loops.csv", cwd=tmp_path)
    assert "12 loops" in found.stdout


START = """\
import sys
sys.path[:0] = ["{own}"]
sys.path.append("{others}")
import anhyst
from anhyst.cli.app import main
code = main(sys.argv[1:])
if sys.argv[1] == "--version":
    print(anhyst.__path__[0])
sys.exit(code)
"""
"""Without site, so that no editable installation gets in the way; its libraries come last."""
