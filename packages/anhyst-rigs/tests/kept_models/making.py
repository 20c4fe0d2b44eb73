"""Define how each saved model of ``tests.truths`` is identified: its loops and its options.

The loops come from an example or from a virtual magnet.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

from anhyst.data.loops import Loops
from anhyst.data.reading import read_loops
from anhyst.identification import identify
from anhyst.model.actuator import Model
from anhyst_rigs.rig.body import read_bearing
from anhyst_rigs.rig.drift import change_iron, change_rig
from anhyst_rigs.rig.force.file import read_rig
from anhyst_rigs.rig.force.programs import identify_force_model, loops_at_gap
from anhyst_rigs.rig.measuring import measure_loops
from tests.plant.irons import generator
from tests.repository import ROOT

EXAMPLES = ROOT / "examples"


def measured(example: str, *gaps: float) -> Loops:
    """Return the bundled loops of an example at the given gaps, or at all gaps."""
    loops = read_loops(EXAMPLES / example / "loops.csv")
    return loops.at(gaps) if gaps else loops


def bearing(fraction: float = 0.15) -> Loops:
    """Measure the magnet of the bundled bearing with another reversible fraction."""
    return measure_loops(change_iron(read_bearing(EXAMPLES / "bearing" / "rig.toml"), fraction))


def family(iron: str) -> Loops:
    """Measure the bundled magnet of the bearing with an iron of another family, in coarser steps."""
    changes: dict[str, Any] = {"measurement.sample_s": 0.025}
    if iron != "cells":
        changes["iron"] = generator().tables()[iron]
    return measure_loops(change_rig(read_bearing(EXAMPLES / "bearing" / "rig.toml"), changes))


@dataclass(frozen=True)
class ModelRecipe:
    """Loops and options from which a saved model is identified."""

    loops: Callable[[], Loops]
    options: dict[str, Any] = field(default_factory=dict)

    def identify(self) -> Model:
        return identify(self.loops(), **self.options).model


@dataclass(frozen=True)
class ForceControlled(ModelRecipe):
    """A model of the bundled solenoid at one gap, ready for force control."""

    gap: float = 0.0
    """m; 0: the end of the stroke."""

    def identify(self) -> Model:
        rig = read_rig(EXAMPLES / "solenoid" / "rig.toml")
        chosen = rig.settings.loops.model_copy(update=self.options)
        rig = replace(rig, settings=rig.settings.model_copy(update={"given_loops": chosen}))
        gap = self.gap or rig.settings.force.end_m
        return identify_force_model(rig, loops_at_gap(self.loops(), gap))


def _law(name: str, gap_map: str = "circuit", **more: Any) -> dict[str, Any]:
    return {"law": name, "gap_map": gap_map, **more}


MODEL_RECIPES: dict[str, ModelRecipe] = {
    "bearing": ModelRecipe(bearing, {"gap_map": "circuit"}),
    "bearing-reversible": ModelRecipe(lambda: bearing(0.3), {"gap_map": "circuit"}),
    "bearing-jiles-atherton": ModelRecipe(bearing, _law("effective-field")),
    "electromagnet": ModelRecipe(lambda: measured("electromagnet")),
    "solenoid-end": ForceControlled(lambda: measured("solenoid")),
    "solenoid-held": ForceControlled(lambda: measured("solenoid"), {"law": "play-cells"}, 1.0e-3),
    "solenoid-three-gaps": ModelRecipe(
        lambda: measured("solenoid", 1.0e-3, 1.6e-3, 2.8e-3), _law("play-cells", "reluctance")
    ),
    **{
        f"{iron}-{law}": ModelRecipe(partial(family, iron), _law(law))
        for iron, law in (
            ("cells", "play-cells"),
            ("preisach-usual", "play-cells"),
            ("duhem-soft", "play-cells"),
            ("duhem-soft", "auto"),
        )
    },
    **{
        f"{example}-{law}-{gap_map}": ModelRecipe(partial(measured, example), _law(law, gap_map))
        for example, law, gap_map in (
            ("electromagnet", "play-cells", "scaling"),
            ("electromagnet", "effective-field", "scaling"),
            ("electromagnet", "effective-field", "reluctance"),
            ("bearing", "effective-field", "reluctance"),
            ("solenoid", "effective-field", "reluctance"),
        )
    },
    **{
        f"{example}-no-dead-band": ModelRecipe(
            partial(measured, example), _law("effective-field", "reluctance", dead_band=False)
        )
        for example in ("electromagnet", "bearing")
    },
}
"""Loops and options of each saved model, by the name of its file."""
