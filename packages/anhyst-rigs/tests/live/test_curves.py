"""Test the background curves of the loop view: measured loops, thinned, and the model's loops."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from anhyst.data.reading import read_loops
from anhyst_rigs.rig.body import read_bearing
from anhyst_rigs.rig.force.file import read_rig
from anhyst_rigs.study.improve import make_drawn_loops
from tests.repository import ROOT
from tests.study import bearings

EXAMPLES = ROOT / "examples"


def test_the_loops_of_a_rig_lie_under_the_one_that_runs() -> None:
    curves = make_drawn_loops(read_bearing(EXAMPLES / "bearing" / "rig.toml").measured_loops.read())
    assert {curve.kind for curve in curves} == {"measured"}
    assert {curve.gap for curve in curves} == {0.35e-3, 0.42e-3, 0.48e-3, 0.55e-3}
    assert max(max(curve.force) for curve in curves) > 300.0
    assert make_drawn_loops(read_rig(EXAMPLES / "solenoid" / "rig.toml").measured_loops.read())


def test_the_model_is_drawn_along_the_same_currents() -> None:
    known = bearings.knowledge()
    curves = make_drawn_loops(known.loops, known.model)
    measured, model = curves[0::2], curves[1::2]
    for one, other in zip(measured, model, strict=True):
        assert (one.kind, other.kind, one.gap) == ("measured", "model", other.gap)
        assert one.current == other.current
        error = np.array(one.force) - np.array(other.force)
        assert np.abs(error).max() < 0.1 * max(one.force)


def test_a_loop_is_drawn_with_its_reversals(tmp_path: Path) -> None:
    current = np.concatenate([np.linspace(0, 4, 5000), np.linspace(4, 1, 3000), np.full(100, 1.0)])
    path = tmp_path / "loop.csv"
    np.savetxt(path, np.column_stack((current, current**2)), "%.9g", ",", header="I_A,F_N", comments="")
    (curve,) = make_drawn_loops(read_loops(path))
    assert len(curve.current) <= 210
    assert (max(curve.current), curve.current[-1]) == (4.0, 1.0)
    assert np.abs(np.diff(curve.current)).max() < 2.0 * 7.0 / 199


def test_loops_of_other_quantities_are_not_drawn(tmp_path: Path) -> None:
    path = tmp_path / "field.csv"
    lines = "\n".join(f"{h},{h / 1000}" for h in [*range(100), *range(100, 0, -1)])
    path.write_text(f"H_A_per_m,B_T\n{lines}\n")
    assert make_drawn_loops(read_loops(path)) == ()
