"""A proportional solenoid: a plunger in front of a stop with a control cone.

The iron path is in series with the sliding clearance of the plunger and with the working gap, whose
equations stand in ``plant/include/anhyst_plant/magnet.h``; here are their numbers.
"""

# ruff: noqa: N815 - keys of the file carry units

from __future__ import annotations

import math
from typing import Annotated

from pydantic import Field

from anhyst._core import Magnet
from anhyst.rig.parts.iron import AnySteel
from anhyst.support.toml_file import NotNegative, Positive, Table


class FluxPath(Table):
    """What ``[iron]`` says of its shape."""

    length_m: Positive  # mean length of the flux path in iron
    area_m2: Positive


class CircuitTable(Table):
    """``[circuit]``: winding and poles."""

    turns: Annotated[int, Field(ge=1)]
    slide_reluctance_per_H: NotNegative  # of the sliding clearance
    leakage_H: NotNegative  # permeance parallel to the working gap
    face_area_m2: Positive  # flat face of the plunger
    # how far the face field reaches beyond the edge: it widens the face by ``fringe`` times the gap
    # all round
    fringe: NotNegative
    cone_diameter_m: Positive  # mean diameter of the wall of the cone
    cone_clearance_m: Positive  # radial clearance between plunger and wall
    cone_depth_m: Positive  # gap at which the plunger begins to dip into the cone
    cone_onset_m: Positive  # length over which this beginning is washed out by fringing
    tip_thickness_m: Positive  # thickness of the wall at its end
    tip_taper: NotNegative  # how much thicker it is for each metre of depth
    tip_saturation_T: Positive  # flux density at which the wall saturates

    def cone(self) -> dict[str, float]:
        """Return its working gap by the names of ``anhyst_plant/magnet.h``."""
        return {
            "leakage": self.leakage_H,
            "side": math.sqrt(self.face_area_m2),
            "fringe": self.fringe,
            "around": math.pi * self.cone_diameter_m,
            "clearance": self.cone_clearance_m,
            "depth": self.cone_depth_m,
            "onset": self.cone_onset_m,
            "thickness": self.tip_thickness_m,
            "taper": self.tip_taper,
            "saturation": self.tip_saturation_T,
        }

    def numbers(self, path: FluxPath) -> dict[str, float]:
        """Return winding and iron path by the names of ``anhyst_plant/magnet.h``."""
        zeros = ("pole_width", "pole_depth", "leakage", "eddy", "bias", "middle", "spring")
        return {
            **dict.fromkeys((*zeros, "resistance"), 0.0),
            "iron_length": path.length_m,
            "iron_area": path.area_m2,
            "joints": self.slide_reluctance_per_H,
            "turns": float(self.turns),
        }


def solenoid_magnet(steel: AnySteel, path: FluxPath, circuit: CircuitTable) -> Magnet:
    """Return the solenoid as the plant computes it."""
    return Magnet(circuit.numbers(path), steel.plant(), circuit.cone())
