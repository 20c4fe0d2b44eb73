"""Laws of displacement loops: another law than play cells, and a refusal."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from anhyst.data import Loop, Loops
from anhyst.data.path import History
from anhyst.data.reading import read_loops
from anhyst.identification import identify
from anhyst.identification.run import IdentifyResult
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst.support.units import QUANTITIES

RAMP_SAMPLES = 60


def ramps(*corners: float) -> FloatArray:
    pieces = [
        np.linspace(begin, end, max(2, int(RAMP_SAMPLES * abs(end - begin))), endpoint=False)
        for begin, end in pairwise(corners)
    ]
    return np.concatenate(pieces)


def follow_bouc_wen(force: FloatArray) -> FloatArray:
    """Return the displacement of an actuator of Bouc and Wen, whose inner loops do not close."""
    displacement = hysteretic_force = previous = 0.0
    outputs = []
    for value in force:
        step = (value - previous) / 20.0
        for _ in range(20):
            sign = np.sign(step)
            stiffness = 1.0 - 1.5 * (0.8 * sign * hysteretic_force - 1.0 * abs(hysteretic_force))
            change = step / (1.0 + stiffness)
            displacement += change
            hysteretic_force += stiffness * change
        previous = value
        outputs.append(displacement)
    return np.array(outputs)


def follow_plays(force: FloatArray) -> FloatArray:
    thresholds = np.array([0.02, 0.1, 0.2, 0.35])
    states, outputs = np.zeros(4), []
    for value in force:
        states = np.minimum(np.maximum(states, value - thresholds), value + thresholds)
        outputs.append(float(states @ [0.5, 0.2, 0.2, 0.1]))
    return np.array(outputs)


def displacement_loops(outputs: list[FloatArray], drives: list[FloatArray]) -> Loops:
    rest = History.parse("demagnetised")
    loops = [
        Loop(str(number), 100.0 * drive, 1e-5 * output, None, None, rest)
        for number, (drive, output) in enumerate(zip(drives, outputs, strict=True))
    ]
    return Loops(tuple(loops), QUANTITIES["voltage"], QUANTITIES["displacement"])


DRIVES = [ramps(0.0, *[size, -size] * 2, size) for size in (1.0, 0.6, 0.3)]
OTHER_DRIVE = ramps(0.0, 1.0, -0.4, 0.7, 0.1, 0.5, -0.8, 0.2, -0.5, 0.9)


def other_error(result: IdentifyResult, truth: FloatArray) -> float:
    """Return the rms error on another record, relative to its standard deviation."""
    output = result.model.predict(100.0 * OTHER_DRIVE, None, None, "demagnetised").output
    return float(np.sqrt(np.mean((output - 1e-5 * truth) ** 2)) / np.std(1e-5 * truth))


def test_identify_uses_jiles_atherton_for_a_bouc_wen_actuator() -> None:
    result = identify(displacement_loops([follow_bouc_wen(drive) for drive in DRIVES], DRIVES))
    assert result.model.law == "effective-field"
    assert other_error(result, follow_bouc_wen(OTHER_DRIVE)) < 0.03
    assert result.model.fit is not None
    assert [candidate.note for candidate in result.model.fit.candidates][-1] == "chosen"
    assert "reduces the deviation" in str(result.model.provenance.settings["law_reason"])


def test_identify_keeps_play_cells_for_an_actuator_of_plays() -> None:
    result = identify(displacement_loops([follow_plays(drive) for drive in DRIVES], DRIVES))
    assert result.model.law == "play-cells"
    assert other_error(result, follow_plays(OTHER_DRIVE)) < 0.03


def test_identify_refuses_a_law_that_has_no_fit(measurements: Path) -> None:
    loops = read_loops(
        measurements / "piezo_flexure" / "model_run.csv",
        columns={"V_in": "u_V", "y_um": "x_um"},
        history="conditioned:0",
    )
    (record,) = loops.loops
    assert record.time is not None
    part = slice(*np.searchsorted(record.time, [0.1, 10.0]))
    time = record.time[part]
    short = Loop("1", record.input[part], record.output[part], None, time, History.parse("demagnetised"))
    with pytest.raises(InputError, match="no fit to these loops") as refusal:
        identify(loops.with_loops([short]), law="play-cells-langevin")
    assert refusal.value.code == "law-without-fit"
