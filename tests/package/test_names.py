"""Test the names that ``import anhyst`` provides."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

import anhyst
import anhyst_exchange
import anhyst_rigs
from tests.repository import ROOT


def test_every_exported_name_exists_and_is_documented() -> None:
    for name in anhyst.__all__:
        found = getattr(anhyst, name)
        assert name == "__version__" or (found.__doc__ and "\n" in found.__doc__.strip()), name
    assert dir(anhyst) == sorted(anhyst.__all__)
    for part in (anhyst_rigs, anhyst_exchange):
        for name in part.__all__:
            assert "\n" in (getattr(part, name).__doc__ or "").strip(), name
        assert dir(part) == sorted(part.__all__)
    assert anhyst.__version__.startswith("0.")
    with pytest.raises(AttributeError, match="no attribute 'identity'"):
        anhyst.identity  # noqa: B018


def test_nothing_heavy_is_imported_before_it_is_used() -> None:
    heavy = ("numpy", "scipy", "pydantic", "matplotlib", "pandas", "typer")
    command = f"import anhyst, sys; print([m for m in {heavy} if m in sys.modules])"
    completed = subprocess.run([sys.executable, "-c", command], capture_output=True, text=True, check=True)
    assert completed.stdout.strip() == "[]"


SCRIPT = """
import numpy as np
import anhyst
import anhyst_rigs

loops: anhyst.Loops = anhyst.read_loops("loops.csv")
verdict: str = anhyst.inspect(loops).verdict.level
found: anhyst.IdentifyResult = anhyst.identify(loops, law="effective-field")
model: anhyst.Model = found.model
force = model(np.linspace(0.0, 1.0, 5), 3e-4)
current = model.inverse(force, 3e-4)
print(verdict, float(current[-1]), model.save("model.toml"), anhyst.__version__)
anhyst.compile(model, "controller", rate=2e4, kind="ful")
reveal_type(anhyst.verify("controller"))
reveal_type(anhyst_rigs.tune("rig.toml", "tuned"))
"""


@pytest.mark.slow
def test_a_script_of_a_user_is_typed(tmp_path: Path) -> None:
    (tmp_path / "script.py").write_text(SCRIPT)
    completed = subprocess.run(
        [sys.executable, "-m", "mypy", "--strict", "--cache-dir", tmp_path / "cache", "script.py"],
        cwd=tmp_path,
        env=os.environ | {"MYPYPATH": os.pathsep.join(map(str, (ROOT / "packages").glob("*/src")))},
        capture_output=True,
        text=True,
        check=False,
    )
    lines = [line for line in completed.stdout.splitlines() if line.startswith("script.py")]
    assert len(lines) == 3, completed.stdout
    assert '"kind"' in lines[0]
    assert "Literal['ful']" in lines[0] or '"ful"' in lines[0]
    assert 'Revealed type is "anhyst.verification.result.Verification"' in lines[1]
    assert 'Revealed type is "anhyst_rigs.study.tuning.result.Tuning"' in lines[2]
