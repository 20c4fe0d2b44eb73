"""Rigs with other irons, the true forces of their magnets, and the errors of models."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from anhyst.data import Loops
from anhyst.data.path import History
from anhyst.identification import identify
from anhyst.model.actuator import Model
from anhyst.support.numeric import FloatArray
from anhyst.support.units import QUANTITIES
from anhyst_rigs.rig.body import read_bearing
from anhyst_rigs.rig.force.file import read_rig
from anhyst_rigs.rig.measurement_table import MeasurementTable
from anhyst_rigs.rig.measuring import HeldBearing, HeldRig, measure_at_gap, sweep_path
from tests.rig.test_iron_families import EXAMPLES, keys_of, with_keys

UNMEASURED_GAPS_M = {"bearing": (0.38e-3, 0.45e-3, 0.52e-3), "solenoid": (1.07e-3, 1.25e-3, 1.8e-3, 2.6e-3)}
IRON = {"bearing": "rig.toml", "solenoid": "solenoid.toml"}
GAP_MAP = {"bearing": "circuit", "solenoid": "reluctance"}
WIDE_REVERSALS = (0.0, 0.95, 0.1, 0.8, 0.05, 0.6, 0.3, 0.9, 0.0)
MINOR_REVERSALS = (
    0.0,
    *(
        turn
        for middle in (0.35, 0.5, 0.65)
        for side in (0.0, 1.0)
        for turn in (side, *(middle + swing for swing in (0.06, -0.06, 0.06, -0.06, 0.03, -0.03)))
    ),
    0.0,
)


@dataclass(frozen=True)
class MeasuredRig:
    """A rig in a separate folder."""

    kind: str
    path: Path
    held: HeldRig
    campaign: MeasurementTable
    zero: float
    """Reading of the shunt at zero current, A."""

    @property
    def past(self) -> list[float]:
        return [0.0, *[self.campaign.current_max_A, 0.0] * 3]

    def usual_loops(self) -> Loops:
        """Return the loops that [measurement] of the rig requires."""
        magnet = self.held.magnet()
        places = range(len(self.campaign.gaps_m))
        loops = [loop for index in places for loop in measure_at_gap(self.held, self.campaign, index, magnet)]
        names = QUANTITIES["current"], QUANTITIES["force"], QUANTITIES["gap"]
        return Loops(tuple(loops), *names)

    def model(self, loops: Loops) -> Model:
        return identify(loops, law="play-cells", gap_map=GAP_MAP[self.kind]).model

    def truth(self, turns: tuple[float, ...], gap: float) -> tuple[FloatArray, FloatArray]:
        """Return current and force along a path of reversal points, after conditioning."""
        largest, magnet = self.campaign.current_max_A, self.held.magnet()
        for turn in self.past:
            magnet.hold(turn, gap)
        current = sweep_path([largest * turn for turn in turns], largest / 80.0)
        return current, magnet.run(current, np.full(current.size, gap))[:, 0].copy()

    def errors(self, model: Model, turns: tuple[float, ...]) -> float:
        """Return the rms error of a model at gaps that were not measured, N."""
        squares = []
        for gap in UNMEASURED_GAPS_M[self.kind]:
            current, force = self.truth(turns, gap)
            history = History("conditioned", tuple(self.past))
            found = model.predict(current + self.zero, np.full(current.size, gap), history=history)
            squares.append(np.mean(np.square(found.output - force)))
        return float(np.sqrt(np.mean(squares)))


def measured_rig(
    kind: str, folder: Path, iron: str | None = None, extra_lines: str = "", law: str = ""
) -> MeasuredRig:
    """Copy a bundled rig, optionally with another iron, a law to identify and more lines."""
    shutil.copytree(EXAMPLES / kind, folder, dirs_exist_ok=True)
    if iron is not None:
        with_keys(folder / IRON[kind], keys_of(iron))
    path = folder / "rig.toml"
    text = path.read_text(encoding="utf-8") + extra_lines
    if law:
        text = text.replace("[loops]", f'[loops]\nlaw = "{law}"')
    path.write_text(text, encoding="utf-8")
    if kind == "bearing":
        bearing = read_bearing(path)
        return MeasuredRig(kind, path, HeldBearing(bearing), bearing.settings.measurement, 0.0)
    rig = read_rig(path)
    assert rig.solenoid_file is not None
    campaign = rig.solenoid_file.measurement
    assert campaign is not None
    return MeasuredRig(kind, path, rig, campaign, rig.settings.current_sensor.offset_A)
