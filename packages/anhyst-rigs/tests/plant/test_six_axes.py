"""Test a body with six degrees of freedom and ten magnets: energy and rigid-body motion."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.interpolate import CubicSpline
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

from anhyst._core import Plant
from anhyst.support.numeric import FloatArray
from tests.plant.oracle import Ledger, Shape, middles
from tests.plant.rigs import GAP, example_steel
from tests.plant.six_axes import HEAVY, LINES, SPRUNG, Body

SHAPE, STEEL = Shape(), example_steel()
PERIOD = 10e-3
SWINGS = np.array([30, -20, 25, -28, 22, -26, 30, -25, -20, 28])  # V
PHASES = 2.0 * np.pi * np.arange(10) * 0.37


@dataclass(frozen=True)
class Path:
    """A run with one row per sub-step."""

    pose: FloatArray  # shape (n + 1, 6)
    velocity: FloatArray
    coils: FloatArray  # shape (n + 1, magnets, 6): gap, current, linkage, pull, energy, heat


def run(plant: Plant, commands: FloatArray) -> Path:
    """Apply commands, one row per tick."""
    rows = [(plant.pose, plant.velocities, plant.coils())]
    for command in commands:
        plant.advance(command.tolist(), 0.0)
        rows.append((plant.pose, plant.velocities, plant.coils()))
    return Path(*(np.array(column) for column in zip(*rows, strict=True)))


def balance(samples: int) -> dict[str, float]:
    """Return the energy balance of the third of three equal cycles, J."""
    plant = SPRUNG.plant(samples / PERIOD, "voltage")
    for magnet in range(len(LINES)):
        plant.hold(2.0, magnet)
    turn = 2.0 * np.pi * (np.arange(3 * samples)[:, None] + 0.5) / samples
    path = run(plant, 2.0 * SHAPE.resistance + SWINGS * np.cos(turn))
    last = slice(2 * samples, None)
    pose, velocity = path.pose[last], path.velocity[last]
    ends = velocity[[0, -1]]
    spring, damping, weight = np.repeat((SPRUNG.stiffness, SPRUNG.damping, (0.0, 0.0)), 3, axis=1)
    weight = SPRUNG.mass * np.append(SPRUNG.gravity, np.cross(SPRUNG.centre, SPRUNG.gravity))
    parts = {
        "taken": 0.0,
        "winding": 0.0,
        "iron": 0.0,
        "field": 0.0,
        "pulled": 0.0,
        "guide": float(np.sum(damping * middles(velocity) * np.diff(pose, axis=0))),
        "motion": 0.5 * float(np.diff(np.einsum("ti,ij,tj->t", ends, SPRUNG.mass_matrix(), ends))[0]),
        "springs": float(np.diff(0.5 * pose[[0, -1]] ** 2 @ spring - pose[[0, -1]] @ weight)[0]),
    }
    tie, (stiffness, damps) = SPRUNG.tie(), SPRUNG.cable
    parts["cable"] = damps * float(np.sum(middles(velocity) @ tie * np.diff(pose, axis=0)))
    hung = np.einsum("ti,ij,tj->t", pose[[0, -1]], tie, pose[[0, -1]])
    parts["springs"] += 0.5 * stiffness * float(np.diff(hung)[0])
    for gap, current, psi, pull, energy, heat in path.coils.transpose(1, 2, 0):
        ledger = Ledger(SHAPE, STEEL, current, gap, psi)
        parts["taken"] += energy[-1] - energy[2 * samples]
        parts["winding"] += heat[-1] - heat[2 * samples]
        parts["iron"] += ledger.heat[-1] - ledger.heat[2 * samples]
        parts["field"] += ledger.stored[-1] - ledger.stored[2 * samples]
        parts["pulled"] -= float(middles(pull[last]) @ np.diff(gap[last]))
    return parts


def test_over_a_cycle_of_six_axes_energy_is_heat_and_motion() -> None:
    """The residual is 1e-4 of the iron's heat, and a quarter of it with half the step."""
    coarse, fine = balance(400), balance(800)

    def left_over(parts: dict[str, float]) -> float:
        spent = sum(parts[name] for name in ("winding", "iron", "field", "guide", "cable", "motion"))
        return parts["taken"] - spent - parts["springs"]

    moved = fine["guide"] + fine["cable"] + fine["motion"] + fine["springs"]
    assert fine["cable"] > 0.01 * fine["guide"]
    assert fine["pulled"] == pytest.approx(moved, abs=1e-3 * fine["guide"])
    assert fine["guide"] > 0.1 * fine["iron"] > abs(fine["field"])
    assert abs(left_over(fine)) < 1e-3 * fine["iron"]
    assert abs(left_over(fine)) < 0.4 * abs(left_over(coarse))


def fly(body: Body, scale: float, seconds: float = 8e-3) -> tuple[Path, FloatArray]:
    """Release the body under varying currents; return the run and its times."""
    rate = 160e3
    plant = body.plant(rate)
    time = np.arange(round(seconds * rate) + 1) / rate
    drive = 1.0 + 1.2 * np.sin(2.0 * np.pi * 250.0 * time[:-1, None] + PHASES)
    for magnet, current in enumerate((np.sqrt(scale) * drive[0]).tolist()):
        plant.hold(current, magnet)
    return run(plant, np.sqrt(scale) * drive), time


def rigid(body: Body, pulls: FloatArray, time: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return pose and gaps of a rigid body under given pulls, for any angle and with gyroscopic
    moments."""
    pull = CubicSpline(time, pulls)
    places, normals = np.array([line[0] for line in LINES]), np.array([line[1] for line in LINES])
    centre = np.array(body.centre)

    def rate(t: float, state: FloatArray) -> FloatArray:
        at, speed, turned, spin = state[:3], state[3:6], Rotation.from_quat(state[6:10]), state[10:]
        forces = pull(t)[:, None] * turned.apply(normals)
        moment = turned.inv().apply(np.sum(np.cross(places - at, forces), axis=0))
        angular = np.linalg.solve(body.inertia, moment - np.cross(spin, body.inertia @ spin))
        x, y, z, w = state[6:10]
        quaternion = 0.5 * np.array(
            [
                w * spin[0] + y * spin[2] - z * spin[1],
                w * spin[1] + z * spin[0] - x * spin[2],
                w * spin[2] + x * spin[1] - y * spin[0],
                -x * spin[0] - y * spin[1] - z * spin[2],
            ]
        )
        fall = np.sum(forces, axis=0) / body.mass + body.gravity
        return np.concatenate((speed, fall, quaternion, angular))

    begin = np.concatenate((centre, np.zeros(6), [1.0], np.zeros(3)))
    found = solve_ivp(rate, (0.0, time[-1]), begin, "DOP853", time, rtol=1e-11, atol=1e-13).y.T
    turned = Rotation.from_quat(found[:, 6:10])
    origin = found[:, :3] - turned.apply(centre)
    faces = [
        np.sum((place - origin) * turned.apply(normal), axis=1) - place @ normal
        for place, normal in zip(places, normals, strict=True)
    ]
    return np.column_stack((origin, turned.as_rotvec())), GAP + np.array(faces).T


@pytest.mark.slow
@pytest.mark.parametrize("scale", [1.0, 0.3, 0.1])
def test_a_body_follows_newton_euler_to_first_order_in_angles(scale: float) -> None:
    """At 0.5 mrad the pose is accurate to 0.1 % and gaps to 60 nm; at a tenth to a hundredth of
    this."""
    body = replace(HEAVY, gravity=(0.0, 0.0, scale * HEAVY.gravity[2]))
    path, time = fly(body, scale)
    pose, gaps = rigid(body, path.coils[:, :, 3], time)
    moves = np.ptp(pose, axis=0)
    turned = float(np.max(moves[3:]))
    assert turned > scale * 3e-4
    assert np.all(np.max(np.abs(path.pose - pose), axis=0) < 5.0 * turned * moves)
    assert np.all(np.abs(path.coils[:, :, 0] - gaps) < 0.6 * turned**2)


def test_on_a_hinge_a_body_turns_about_it_and_not_about_its_centre() -> None:
    """Its weight rotates it by half of m*g*c/(J + m*c^2) times the square of the time."""
    body = replace(HEAVY, axes=(4,), centre=(0.05, 0.0, 0.0), gravity=(0.0, 0.0, -1e-2))
    plant = body.plant(20e3)
    for _ in range(200):
        plant.advance([0.0] * len(LINES), 0.0)
    turning = body.mass * 1e-2 * 0.05 / (body.inertia[1, 1] + body.mass * 0.05**2)
    assert plant.pose == pytest.approx([0.5 * turning * 1e-4], rel=1e-9)
    gap = plant.coils()[6, 0]  # at (0.12, 0.12, 0.05), pulled up
    assert gap - GAP == pytest.approx(0.12 * plant.pose[0], rel=1e-6)


def test_a_body_on_a_cable_follows_its_linear_equations() -> None:
    """Half the step leaves a quarter of the error."""
    body, seconds = replace(HEAVY, gravity=(0.0, 0.0, 0.0), cable=(4e5, 1500.0)), 8e-3
    pose = np.array([2e-5, -3e-5, 5e-5, 2e-4, -1e-4, 3e-4])
    pushed = -np.linalg.solve(body.mass_matrix(), body.tie())
    rate = np.block([[np.zeros((6, 6)), np.eye(6)], [4e5 * pushed, 1500.0 * pushed]])
    exact = (expm(seconds * rate) @ np.append(pose, np.zeros(6)))[:6]
    off = []
    for steps in (80, 160):
        plant = body.plant(steps / seconds)
        plant.place(pose.tolist(), [0.0] * 6)
        for _ in range(steps):
            plant.advance([0.0] * len(LINES), 0.0)
        off.append(float(np.abs(np.array(plant.pose) - exact).max()))
    assert np.abs(exact - pose).max() > 1e-4
    assert off[0] < 1e-2 * np.abs(pose).max()
    assert 3.5 < off[0] / off[1] < 4.5


def test_sensor_heads_give_the_pose_of_the_body() -> None:
    """Six heads at points of the magnets; small angles combine linearly."""
    plant = HEAVY.plant(20e3)
    pose = np.array([2e-6, -3e-6, 5e-6, 4e-5, -6e-5, 3e-5])
    plant.place(pose.tolist(), [0.0] * 6)
    rows = [np.append(d, np.cross(r, d)) for r, d in np.array(LINES[:6])]
    assert plant.read()[0] == pytest.approx(np.array(rows) @ pose, abs=1e-9)


def test_a_body_without_inertia_does_not_turn() -> None:
    weightless = replace(HEAVY, inertia=np.zeros((3, 3)), centre=(0.0, 0.0, 0.0))
    with pytest.raises(ValueError, match="mass and inertia are those of no body"):
        weightless.plant(20e3)
