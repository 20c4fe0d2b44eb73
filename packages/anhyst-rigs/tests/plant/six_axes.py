"""Provide bodies with six degrees of freedom, 20 kg and ten magnets of the example stage."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from anhyst._core import Plant
from anhyst.support.numeric import FloatArray
from anhyst_rigs.rig.parts.magnet import make_iron_magnet
from anhyst_rigs.rig.plant import plant_parameters
from tests.plant.rigs import GAP, OPEN_LOOP, example_poles, example_steel, rig

_ARM, _DEEP, _HIGH = 0.12, -0.005, 0.05
LINES: tuple[tuple[tuple[float, float, float], tuple[float, float, float]], ...] = (
    *(((side * 0.15, y, _DEEP), (side, 0.0, 0.0)) for y in (_ARM, -_ARM) for side in (1.0, -1.0)),
    *(((0.0, side * 0.15, 0.0), (0.0, side, 0.0)) for side in (1.0, -1.0)),
    *(((x, y, _HIGH), (0.0, 0.0, 1.0)) for x in (_ARM, -_ARM) for y in (_ARM, -_ARM)),
)
"""Place and direction of each magnet: two pairs along x below the centre of mass, one along y, four
from above."""
CABLE = [-0.1, 0.14, -0.06]
"""Point of the body at which a cable is fixed, m."""
IDEAL = {"step": 0.0, "noise": 0.0, "gain": 1.0, "offset": 0.0, "share": 1.0, "delay": 0}


@dataclass(frozen=True)
class Body:
    """Parameters of a body; its springs are end stops in permanent contact, 0 for none."""

    mass: float = 20.0  # kg
    inertia: FloatArray = field(  # about the centre of mass, kg m2
        default_factory=lambda: np.array([[0.2, 0.01, 0.0], [0.01, 0.25, 0.02], [0.0, 0.02, 0.3]])
    )
    centre: tuple[float, float, float] = (0.0, 0.0, 0.0)  # centre of mass, m
    gravity: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m/s2
    stiffness: tuple[float, float] = (0.0, 0.0)  # stiffness of the springs, N/m and N m/rad
    damping: tuple[float, float] = (0.0, 0.0)  # damping of the guide, N s/m and N m s/rad
    # stiffness and damping of the cable, N/m and N s/m, at :data:`CABLE`
    cable: tuple[float, float] = (0.0, 0.0)
    axes: Sequence[int] = range(6)
    lines: Sequence[tuple[tuple[float, float, float], tuple[float, float, float]]] = LINES

    def mass_matrix(self) -> FloatArray:
        """Return the mass matrix of all axes about the reference point of the lines."""
        jump = np.zeros((3, 6))  # velocity of the centre of mass
        jump[:, :3] = np.eye(3)
        jump[:, 3:] = np.cross(np.eye(3), np.array(self.centre)).T
        whole = self.mass * jump.T @ jump
        whole[3:, 3:] += self.inertia
        return whole

    def tie(self) -> FloatArray:
        """Return the restoring wrench of a cable with 1 N/m per unit of each coordinate."""
        moved = np.hstack([np.eye(3), np.cross(np.eye(3), np.array(CABLE)).T])
        return np.asarray(moved.T @ moved)

    def plant(self, rate: float, mode: str = "current") -> Plant:
        """Return the plant of this body without delays and converters."""
        example = plant_parameters(rig(OPEN_LOOP | {"amplifier.mode": mode, "timing.rate_Hz": rate}))
        magnet = make_iron_magnet(example_poles(), example_steel(), 0.0, GAP)
        wide = IDEAL | {"low": -1e9, "high": 1e9}

        def coordinate(axis: int) -> dict[str, float]:
            stiffness, damping = self.stiffness[axis // 3], self.damping[axis // 3]
            end = 0.0 if stiffness else 1.0
            named = {"axis": axis, "rest": 0.0, "damping": damping, "stop_stiffness": stiffness}
            return named | {"stop_low": -end, "stop_high": end, "stop_damping": 0.0}

        def line(place: Sequence[float], direction: Sequence[float]) -> dict[str, list[float]]:
            return {"r": list(place), "d": list(direction)}

        body: dict[str, Any] = example.body | {
            "coordinate": [coordinate(axis) for axis in self.axes],
            "mass": self.mass,
            "inertia": self.inertia.tolist(),
            "centre": list(self.centre),
            "gravity": list(self.gravity),
            "force_sensor": wide,
            "cable": {"at": CABLE, "stiffness": self.cable[0], "damping": self.cable[1]},
            "substeps": 1,
            "delay": 0,
        }
        own = example.actuators[0]
        actuators = [
            own
            | {"line": line(*one), "gap_zero": GAP, "amplifier": own["amplifier"] | {"step": 0.0}}
            | {"current_sensor": wide, "flux_probe": wide}
            for one in self.lines
        ]
        heads = [{"line": line(*one), "zero": 0.0, "sensor": wide, "base": 0} for one in self.lines[:6]]
        return Plant(body, actuators, heads, example.load, [magnet] * len(actuators), 0)


HEAVY = Body(centre=(2e-3, -1e-3, 4e-3), gravity=(0.0, 0.0, -9.81))
"""A free body whose centre of mass is not at the reference point."""
SPRUNG = replace(HEAVY, stiffness=(2e7, 3e5), damping=(12e3, 160.0), cable=(4e5, 1500.0))
"""A body on springs that are stiffer than the negative stiffness of its magnets, with a cable."""
