"""What the loops say about the plant of a bearing."""

from __future__ import annotations

from anhyst.model.actuator import Model
from anhyst.rig.bearing.file import BearingRig
from anhyst.rig.bearing.make_setup import IdentifiedMagnet
from anhyst.rig.bearing.plant import law_of, make_magnet
from anhyst.rig.distance import PlantCheck, along, distance, follower, model_distance


def check_plant(rig: BearingRig, knowledge: IdentifiedMagnet) -> PlantCheck:
    """Hold the plant of a rig, and what its controller knows, against the loops."""
    magnet, loops, fitted = make_magnet(rig), knowledge.loops, rig.fitted
    zeros = (0.0, 0.0) if fitted is None else (fitted.zero_current, fitted.zero_force)
    by_law = rig.settings.magnet.kind == "law"
    return PlantCheck(
        plant=distance(loops, lambda loop: along(follower(magnet), loop, zeros[0]) + zeros[1]),
        model=model_distance(loops, knowledge.model),
        same=by_law and _same(law_of(rig), knowledge.model),
        fitted=fitted is not None,
        guessed=() if fitted is None else fitted.guessed,
    )


def _same(law: Model, model: Model) -> bool:
    """Whether two models are one, or of the same law and the same measurements."""
    if law.law != model.law:
        return False
    sources = {source.sha256 for source in law.provenance.sources}
    common = sources & {source.sha256 for source in model.provenance.sources}
    alike = dict(law.parameters) == dict(model.parameters) and law.cells == model.cells
    return alike or bool(common)
