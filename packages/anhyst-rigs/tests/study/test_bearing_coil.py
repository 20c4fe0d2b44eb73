"""Test a bearing whose flux is estimated from the voltage of a coil instead of a Hall probe."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from anhyst.support.kinds import MethodName
from anhyst_rigs.rig.bearing.loop import make_setup
from anhyst_rigs.rig.bearing.scenario import ScenarioBuilder
from anhyst_rigs.rig.body import read_bearing
from tests.study.bearings import EXAMPLE, GAP, controller, hovers_from, knowledge, run_plant

SENSORS = {
    "sense coil": 'of = "voltage"\nturns = 50\nrange_V = 40.0\nadc_bits = 20\nnoise_V = 0.0002\n',
    "winding": 'of = "voltage"\nrange_V = 160.0\nadc_bits = 20\nnoise_V = 0.001\nresistance_error = 0.2\n',
}


@pytest.mark.parametrize("method", ["flux", "fused"])
@pytest.mark.parametrize("sensor", SENSORS)
def test_a_bearing_lifts_and_settles_with_a_coil(tmp_path: Path, sensor: str, method: MethodName) -> None:
    """The resistance of the winding is wrong by 20 %."""
    shutil.copytree(EXAMPLE, tmp_path / "bearing")
    path = tmp_path / "bearing" / "rig.toml"
    first, *sensors = path.read_text(encoding="utf-8").split("[[sensor]]")
    texts = [
        f"\n{SENSORS[sensor]}\n{text[text.index('[load]') :]}" if 'of = "flux"' in text else text
        for text in sensors
    ]
    path.write_text("[[sensor]]".join([first, *texts]), encoding="utf-8")
    rig, table = read_bearing(path), controller().settings
    setup = make_setup(rig, table, knowledge(), method, "fixed")
    run = run_plant(setup, ScenarioBuilder(rig, GAP).lift_off(table).hold(0.5))
    assert run.loss is None
    assert hovers_from(run) is not None
    assert np.abs(run["gap_m"][-2000:] - GAP).max() < 2e-6
