"""Actuators that are not magnets and differ from all examples in scale, unit, offset, sign and law."""

from __future__ import annotations

import json
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from anhyst.model.actuator import read_model
from anhyst.support.numeric import FloatArray
from tests.cli.command import quick, unwrapped
from tests.once import made_once
from tests.refusals import says

STEP_MS = 20.0
RELAYS = 4000
STROKE, OFFSET = 7.5e-6, -31e-6


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("actuators")


def stack(drive: FloatArray) -> FloatArray:
    """Return the displacement of a stack of relays over kilovolts, m; no law of the package."""
    random = np.random.default_rng(3)
    up = random.gamma(2.0, 0.25, RELAYS)
    down = up - random.gamma(1.5, 0.12, RELAYS)
    on = np.zeros(RELAYS, dtype=np.bool_)
    found = np.empty(drive.size)
    for i, value in enumerate(drive.tolist()):
        on = (on | (value >= up)) & (value > down)
        found[i] = on.mean()
    free = 0.55 * drive - 0.05 * drive**2
    return np.asarray(OFFSET + STROKE * (0.45 * found + free / 1.2))


def path(points: list[float]) -> FloatArray:
    """Return linear ramps between points, kV."""
    pieces = [
        np.linspace(ramp, two, max(2, int(abs(two - ramp) / 0.01)), endpoint=False)
        for ramp, two in pairwise(points)
    ]
    return np.concatenate(pieces)


@cache
def written(place: Path, name: str, sign: float = 1.0) -> Path:
    points = {
        "loops": [0.0, 1.2, 0.0, 1.2, 0.0, 0.9, 0.0, 0.6, 0.0, 0.3, 1.1, 0.3, 0.8, 0.0, 1.2, 0.0],
        "unseen": [0.0, 1.2, 0.2, 1.0, 0.4, 0.7, 0.1, 1.15, 0.0],
    }[name.partition("-")[0]]
    drive = path(points)
    read = sign * stack(drive) + 4e-9 * np.random.default_rng(5).standard_normal(drive.size)
    rows = [
        f"{STEP_MS * i:g};{u:.5f};{1e9 * x:.2f}"
        for i, (u, x) in enumerate(zip(drive.tolist(), read.tolist(), strict=True))
    ]
    out = place / f"{name}.csv"
    out.write_text("\n".join(["t_ms;U_kV;x_nm", *rows]) + "\n", encoding="utf-8")
    return out


def identify_stack(folder: Path) -> None:
    loops = written(folder, "loops")
    options = ("--history", "conditioned:0", "--out", "stack.toml", "--json")
    completed = quick("identify", loops, *options, cwd=folder)
    assert completed.returncode == 0, completed.stderr
    (folder / "said.json").write_text(completed.stdout, encoding="utf-8")


@pytest.fixture(scope="module")
def identified(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Any]:
    """Return the model file of the stack, and the printed JSON."""
    folder = made_once(tmp_path_factory, "identified-stack", identify_stack)
    return folder / "stack.toml", json.loads((folder / "said.json").read_text(encoding="utf-8"))


def test_a_foreign_stack_is_identified_and_an_unseen_path_predicted(
    place: Path, identified: tuple[Path, Any]
) -> None:
    model, message = identified
    assert message["law"] == "play-cells"
    withheld_path = written(place, "unseen")
    completed = quick("predict", model, withheld_path, "--history", "conditioned:0", "--out", "p.csv",
                 "--json", cwd=place)  # fmt: skip
    assert completed.returncode == 0, completed.stderr
    assert json.loads(completed.stdout)["deviation"]["rms"] < 0.012 * STROKE


def test_the_voltage_it_asks_for_is_the_one_that_was_applied(
    place: Path, identified: tuple[Path, Any]
) -> None:
    model, _ = identified
    completed = quick("invert", model, written(place, "unseen"), "--history", "conditioned:0",
                 "--out", "u.csv", "--json", cwd=place)  # fmt: skip
    assert completed.returncode == 0, completed.stderr
    message = json.loads(completed.stdout)
    assert (message["column"], message["unit"]) == ("u_V", "V")
    assert message["deviation"]["rms"] < 0.02 * 1200.0


def test_the_verdict_of_a_piezo_is_in_micrometres(place: Path) -> None:
    completed = quick("inspect", written(place, "loops"), cwd=place)
    assert completed.returncode == 0, completed.stderr
    assert "µm high" in unwrapped(completed.stdout)
    assert "x µm" in completed.stdout


def test_its_inverse_is_compiled_to_a_tenth_of_a_per_cent_of_the_stroke(
    place: Path, identified: tuple[Path, Any]
) -> None:
    model, _ = identified
    completed = quick("compile", model, "--rate", "5000", "--out", "c", "--json", cwd=place)
    assert completed.returncode == 0, completed.stderr
    accuracy = json.loads(completed.stdout)["accuracy"]
    assert accuracy["largest_output"] == pytest.approx(np.ptp(read_model(model).valid.output))  # type: ignore[union-attr]
    assert accuracy["worst_percent"] <= 0.1


def test_an_output_that_falls_with_the_voltage_is_refused_with_flip_as_remedy(place: Path) -> None:
    loops = written(place, "loops-falling", -1.0)
    completed = quick("identify", loops, "--history", "conditioned:0", "--out", "f.toml", cwd=place)
    assert completed.returncode == 2
    assert says(completed.stderr, "output-falls: displacement; voltage")


@pytest.mark.slow
def test_magnetostrictive_strain_is_even_in_the_field(place: Path) -> None:
    field = 20.0 * np.sin(2.0 * np.pi * np.arange(241) / 80.0)
    lagging = 20.0 * np.sin(2.0 * np.pi * np.arange(241) / 80.0 - 0.15)
    rows = [f"{h:.4f},{900.0 * np.tanh(b / 15.0) ** 2:.3f}" for h, b in zip(field, lagging, strict=True)]
    loops = place / "rod.csv"
    loops.write_text("\n".join(["H_kA_per_m,eps_ppm", *rows[160:]]) + "\n", encoding="utf-8")
    completed = quick("identify", loops, "--history", "settled", "--out", "rod.toml", "--json", cwd=place)
    assert completed.returncode == 0, completed.stderr
    model = read_model(place / "rod.toml")
    assert (model.output.name, model.power) == ("magnetostriction", 2)
    fit = json.loads(completed.stdout)["fit"]
    assert fit["mean_abs"] < 0.02 * fit["largest_output"]
