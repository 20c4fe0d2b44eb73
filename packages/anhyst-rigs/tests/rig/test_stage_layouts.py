"""Test which layouts of magnets are refused, against linear programmes written from the definition."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import linprog

from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.magnet_table import MagnetTable
from anhyst_rigs.rig.stage import capability
from anhyst_rigs.rig.stage.file import read_stage
from anhyst_rigs.rig.stage.fitted import make_stage
from anhyst_rigs.study.tracking import compiled
from tests.refusals import refused
from tests.repository import ROOT
from tests.study import bearings

EXAMPLE = ROOT / "examples" / "planar" / "rig.toml"
AXES = ["x", "y", "z", "rx", "ry", "rz"]
Line = tuple[Sequence[float], Sequence[float]]
UP = (0.0, 0.0, 1.0)
FOUR_ABOVE: list[Line] = [((x, y, 0.05), UP) for x in (0.12, -0.12) for y in (0.12, -0.12)]
PUSH_PULL: list[Line] = [((0.0, 0.1, 0.0), (d, 0.0, 0.0)) for d in (1.0, -1.0)]
PINWHEEL: list[Line] = [
    ((0.0, -0.1, 0.0), (1.0, 0.0, 0.0)),
    ((0.0, 0.1, 0.0), (-1.0, 0.0, 0.0)),
    ((0.1, 0.0, 0.0), (0.0, 1.0, 0.0)),
    ((-0.1, 0.0, 0.0), (0.0, -1.0, 0.0)),
]
"""Four magnets that turn the body about +z only."""
HEADS: dict[str, Line] = {
    "x": ((0.15, 0.1, 0.02), (1.0, 0.0, 0.0)),
    "y": ((0.0, 0.15, 0.02), (0.0, 1.0, 0.0)),
    "z": ((0.1, 0.1, -0.05), UP),
    "rx": ((-0.1, -0.1, -0.05), UP),
    "ry": ((-0.1, 0.1, -0.05), UP),
    "rz": ((0.15, -0.1, 0.02), (1.0, 0.0, 0.0)),
}
TWO_WAY = {
    "bias_N = 5.0 ": "# ",
    "force_min_N = 0.5 ": "# ",
    'format = "fixed" ': 'format = "f64" ',
    "current_low_A = 0.0": "current_low_A = -4.5",
    "low_A = -0.5": "low_A = -5.0",
}
"""Changes for magnets that also push."""


def listed(vector: Sequence[float]) -> str:
    return str([float(component) for component in vector])


@dataclass(frozen=True)
class Stage:
    """A stage with the iron and the instruments of the example."""

    lines: list[Line]
    free: list[str]
    mass: float = 20.0
    push: float = 6.0  # largest acceleration of the set-point
    force_max: float = 240.0
    force_min: float = 0.5
    bias: float = 5.0
    centre: Sequence[float] = (0.0, 0.0, 0.0)
    is_two_way: bool = False

    def write(self, folder: Path) -> Path:
        """Write the rig file."""
        text = EXAMPLE.read_text(encoding="utf-8")
        begin, second = (re.search(rf'\[\[magnet\]\].*\nname = "{name}"', text) for name in ("x1", "x2"))
        end, heads, after = (
            text.index(one)
            for one in ("[[amplifier]]", "[[sensor]]                            # inter", "[frame]")
        )
        assert begin is not None
        assert second is not None
        first = text[begin.start() : second.start()].replace("[0.15, 0.12, -0.005]", listed(self.lines[0][0]))
        first = first.replace("[1.0, 0.0, 0.0]", listed(self.lines[0][1]))
        others = [
            f'[[magnet]]\nname = "m{number}"\nlike = "x1"\nposition_m = {listed(place)}\ndirection = {listed(way)}\n'
            "gap_m = 0.45e-3\n"
            for number, (place, way) in enumerate(self.lines[1:])
        ]
        sensors = [
            f'[[sensor]]\nof = "position"\nposition_m = {listed(HEADS[axis][0])}\n'
            f"direction = {listed(HEADS[axis][1])}\nnoise_m = 0.5e-9\n"
            for axis in self.free
        ]
        rest = text[after:].split("[[case]]                              # amplifier")
        text = text[: begin.start()] + first + "\n".join(others) + text[end:heads] + "\n".join(sensors)
        text += rest[0] + rest[1][rest[1].index("[spread]") :]
        changes = {
            'free = ["x", "y", "z", "rx", "ry", "rz"]': f"free = {self.free}".replace("'", '"'),
            "mass_kg = 20.0": f"mass_kg = {self.mass}",
            "gravity_m_per_s2 = 9.81": f"gravity_m_per_s2 = {self.gravity}",
            "centre_m = [0.0, 0.0, 0.0]": f"centre_m = {listed(self.centre)}",
            "force_max_N = 240.0": f"force_max_N = {self.force_max}",
            "force_min_N = 0.5": f"force_min_N = {self.force_min}",
            "bias_N = 5.0": f"bias_N = {self.bias}",
            "[22.0, 8.0, 16.0]": f"[{self.push}, {0.5 * self.push}]",
            "[22.0, 10.0, 18.0]": f"[{self.push}, {0.7 * self.push}]",
            "speed_m_per_s = 0.5": f"speed_m_per_s = {0.02 * self.push}",
        }
        for old, new in ((TWO_WAY if self.is_two_way else {}) | changes).items():
            text = text.replace(old, new)
        path = folder / "rig.toml"
        path.write_text(text, encoding="utf-8")
        return path

    @property
    def gravity(self) -> float:
        return 9.81 if "z" in self.free else 0.0

    def read(self, folder: Path) -> BodyRig:
        with pytest.MonkeyPatch.context() as patch:
            if self.is_two_way:  # a magnet of the example that also pushes
                patch.setattr(MagnetTable, "is_bidirectional", True)
                patch.setattr(MagnetTable, "_has_circuit", lambda _: True)
            return read_stage(self.write(folder))

    def verdict(self) -> str:
        """Return what the definition says: the reason of a refusal, or possible."""
        columns = [AXES.index(axis) for axis in self.free]
        full = np.array([[*way, *np.cross(place, way)] for place, way in self.lines])
        weight, push = (
            np.array([*force, *np.cross(self.centre, force)])[columns]
            for force in ([0.0, 0.0, -self.mass * self.gravity], [self.mass, 0.0, 0.0])
        )
        rows: list[FloatArray] = []
        bounds: list[tuple[float, float]] = []
        for number, row in enumerate(full):
            pair = [other for other, line in enumerate(full) if np.abs(row + line).max() < 1e-9]
            if self.is_two_way:
                rows, bounds = [*rows, row[columns]], [*bounds, (-self.force_max, self.force_max)]
            elif not pair:
                rows, bounds = [*rows, row[columns]], [*bounds, (self.force_min, self.force_max)]
            elif number < pair[0]:
                limit = self.force_max - self.bias**2 / self.force_max
                rows, bounds = [*rows, row[columns]], [*bounds, (-limit, limit)]
        made = np.array(rows)
        # every wrench has forces if the magnets and the weight balance with all forces above zero
        ways = [*made, *(-row for row, (low, _) in zip(made, bounds, strict=True) if low < 0.0)]
        ways += [weight] if weight.any() else []
        balanced = linprog(
            np.ones(len(ways)), A_eq=np.array(ways).T, b_eq=np.zeros(len(columns)), bounds=(1.0, None)
        )
        if np.linalg.matrix_rank(np.array(ways)) < len(columns) or balanced.status != 0:
            return "axis-not-held"
        radii = np.sqrt(np.array([1.0, 1.0, 1.0, 0.2 / self.mass, 0.25 / self.mass, 0.3 / self.mass]))
        about_centre = [[*way, *np.cross(np.subtract(place, self.centre), way)] for place, way in self.lines]
        values = np.linalg.svd((np.array(about_centre) / radii)[:, columns], compute_uv=False)
        if values[0] > 2000.0 * values[-1]:  # pairs count twice here, which changes the ratio by 1.4
            return "axis-not-held"
        for wrench, text in (
            (-weight, "load"),
            (self.push / 1.01 * push - weight, "scan"),
            (-self.push / 1.01 * push - weight, "scan"),
        ):
            if linprog(np.zeros(len(made)), A_eq=made.T, b_eq=wrench, bounds=bounds).status != 0:
                return text
        return "possible"


def draw(rng: np.random.Generator) -> Stage:
    """Return a random stage: pairs, single magnets, spare magnets, three or six coordinates."""
    free = [AXES, ["x", "y", "rz"], ["x", "z", "ry"]][rng.integers(3)]
    directions = [np.eye(3)[AXES.index(axis)] for axis in free if not axis.startswith("r")]
    lines: list[Line] = []
    for _ in range(int(rng.integers(max(2, len(free) // 2), len(free) + 2))):
        place, way = (
            rng.uniform(-0.15, 0.15, 3),
            directions[rng.integers(len(directions))] * rng.choice([-1.0, 1.0]),
        )
        if rng.random() < 0.15:
            way = rng.normal(size=3) * np.sum(directions, axis=0)
        way = way / np.linalg.norm(way)
        lines += [
            (place.tolist(), (sign * way).tolist())
            for sign in ((1.0, -1.0) if rng.random() < 0.7 else (1.0,))
        ]
    if "z" in free:
        lines += [([*rng.uniform(-0.15, 0.15, 2), 0.05], UP) for _ in range(int(rng.integers(1, 6)))]
    six = len(free) == 6
    return Stage(
        lines[:16],
        free,
        mass=float(rng.choice([5.0, 20.0, 60.0])),
        push=float(rng.choice([2.0, 6.0, 15.0])),
        force_min=float(rng.choice([0.5, 5.0])),
        bias=float(rng.choice([1.0, 20.0])),
        centre=rng.uniform(-0.01, 0.01, 3).tolist() if six else (0.0, 0.0, 0.0),
        is_two_way=bool(rng.random() < 0.25),
    )


def refusal(stage: Stage, folder: Path) -> str:
    """Return what the reader says, in the words of the definition."""
    try:
        stage.read(folder)
    except InputError as error:
        if error.code == "axis-not-held":
            return error.code
        if error.code != "load-too-large":
            raise
        if "the controller finds forces" in str(error):
            return "allocation"
        return "scan" if "case[1]" in str(error) else "load"
    return "possible"


def compare(seed: int, count: int, folder: Path) -> Counter[tuple[str, str]]:
    stages = [draw(np.random.default_rng([seed, number])) for number in range(count)]
    return Counter((stage.verdict(), refusal(stage, folder)) for stage in stages)


@pytest.mark.parametrize(("seed", "count"), [(5, 60), pytest.param(6, 600, marks=pytest.mark.slow)])
def test_drawn_layouts_are_refused_as_the_definition_says(seed: int, count: int, tmp_path: Path) -> None:
    found = compare(seed, count, tmp_path)
    differs = {pair: number for pair, number in found.items() if pair[0] != pair[1]}
    allocation = differs.pop(("possible", "allocation"), 0)
    assert not differs
    assert min(found[name, name] for name in ("axis-not-held", "load", "scan", "possible")) > 0
    assert allocation < found["possible", "possible"]


def test_a_weight_above_all_forces_is_named(tmp_path: Path) -> None:
    stage = Stage([*PUSH_PULL, *PUSH_PULL, *FOUR_ABOVE], ["x", "z", "ry"], mass=130.0, force_max=260.0)
    with refused(
        "load-too-large body[1].mass_kg: weighs 1275 N; can carry 1040 N; at most 260 N (force_max_N)"
    ):
        stage.read(tmp_path)


def test_a_magnet_is_limited_by_its_current(tmp_path: Path) -> None:
    stage = Stage([*PUSH_PULL, *FOUR_ABOVE], ["x", "z", "ry"], mass=130.0, push=2.0, force_max=400.0)
    with refused(
        "load-too-large body[1].mass_kg: can carry 1217 N; at most 304.2 N (current_high_A at its gap)"
    ):
        stage.read(tmp_path)


def test_the_missing_direction_is_named(tmp_path: Path) -> None:
    lines = [*PINWHEEL, *FOUR_ABOVE]
    with refused("axis-not-held magnet: no magnet pushes along -rz; turn a magnet"):
        Stage(lines, AXES).read(tmp_path)
    lines[1] = ((0.1, 0.1, 0.0), (-1.0, 0.0, 0.0))  # now x and y have a magnet each way, still one turn
    with refused("axis-not-held magnet: no magnet pushes along -rz"):
        Stage(lines, AXES).read(tmp_path)


def test_a_direction_that_is_coupled_to_another_names_both(tmp_path: Path) -> None:
    skew = 0.5**0.5
    lines: list[Line] = [((0.0, 0.1, 0.0), (way, 0.0, 0.0)) for way in (1.0, -1.0)]
    lines += [((0.1, 0.0, 0.0), (skew, sign * skew, 0.0)) for sign in (1.0, -1.0)]
    lines += [((-0.1, 0.0, 0.0), (skew, skew, 0.0))]
    assert Stage(lines, ["x", "y", "rz"]).verdict() == "axis-not-held"
    with refused("axis-not-held magnet: all magnets that push along; also push along; nothing balances this"):
        Stage(lines, ["x", "y", "rz"]).read(tmp_path)


def test_a_shortage_of_forces_above_their_minimum_is_named(tmp_path: Path) -> None:
    lines = [*PUSH_PULL, *FOUR_ABOVE, ((0.3, 0.0, 0.0), UP)]
    stage = Stage(lines, ["x", "z", "ry"], mass=5.0, force_min=12.0)
    with refused("load-too-large magnet: at least 12 N; 3.6 N m are missing along +ry; lower force_min_N"):
        stage.read(tmp_path)


def above_on_a_line(arm: float) -> list[Line]:
    """Return two pairs along x, one along y, and four magnets above, almost on one line."""
    lines: list[Line] = [((0.0, y, 0.0), (way, 0.0, 0.0)) for y in (0.12, -0.12) for way in (1.0, -1.0)]
    lines += [((0.0, 0.0, 0.0), (0.0, way, 0.0)) for way in (1.0, -1.0)]
    return [*lines, *(((x, float(np.sign(y)) * arm, z), way) for (x, y, z), way in FOUR_ABOVE)]


def test_the_condition_number_bounds_a_nearly_singular_layout(tmp_path: Path) -> None:
    arm = 2e-3
    drives = capability.make_capability(Stage(above_on_a_line(arm), AXES).read(tmp_path))
    condition, axis = drives.singular_values()
    # the drives along z: arm divided by the radius of gyration, against those along ry
    radii = np.sqrt(np.array([0.2, 0.25]) / 20.0)
    assert condition == pytest.approx((0.12 / radii[1]) / (arm / radii[0]), rel=0.3)
    assert axis == "rx"
    with refused("axis-not-held magnet: nearly singular; condition number; least along rx"):
        Stage(above_on_a_line(1e-4), AXES, push=2.0).read(tmp_path)


def test_a_layout_that_single_precision_cannot_share_is_not_compiled(tmp_path: Path) -> None:
    lines: list[Line] = [((0.0, y, 0.0), (way, 0.0, 0.0)) for y in (0.1, 0.104) for way in (1.0, -1.0)]
    lines += [((0.0, 0.0, 0.0), (0.0, way, 0.0)) for way in (1.0, -1.0)]
    setup = make_stage(
        Stage(lines, ["x", "y", "rz"], mass=5.0, push=1.0).read(tmp_path), bearings.knowledge(), "full"
    )
    compiled.refuse_unallocated(replace(setup, number_format="f64"))
    with refused("not-compilable magnet: nearly singular in f32, condition number; or compile with --io q31"):
        compiled.refuse_unallocated(replace(setup, number_format="f32"))
