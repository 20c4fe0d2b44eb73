"""What is fitted and compared: laws and gap maps, the simplest first."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from anhyst.data import Loops
from anhyst.identification.cell_kernel import LAW_OF, CellKernel
from anhyst.identification.fit_records import FitRecords
from anhyst.identification.offsets import OFFSETS
from anhyst.identification.run import SearchRun
from anhyst.laws.cells import Shape
from anhyst.support.errors import InputError

POPULATIONS = 3
"""Of play cells that are tried, at most."""

_STEP = 10


@dataclass(frozen=True)
class ModelCandidate:
    """A law and a gap map, and what they may vary."""

    gap_map: str  # the map
    held: frozenset[str]  # parameters that are zero and not fitted
    # parameters that are the same at every gap although the map lets them differ
    common: frozenset[str] = frozenset()
    # complexity: one of a higher rank is taken only where it is better by more than its scatter
    rank: int = 0
    cells: CellKernel | None = None  # play cells, in how many populations; None: the law of the run
    polished: bool = False  # whether every weight of the cells has moved by itself at the end

    def title(self, law: str) -> str:
        """Name it to a reader, beside its map; of a run with this law."""
        if self.cells is None:
            return law
        count = self.cells.populations
        text = f"{LAW_OF[self.cells.shape]}, {count} population{'s' if count > 1 else ''}"
        if "omega" in self.held:
            text += ", no interaction"
        return f"{text}, weights fitted" if self.polished else text


def require_gaps(records: FitRecords, gap_map: str) -> None:
    """Refuse a gap map where there is nothing to see of it."""
    if gap_map != "auto" and records.gaps < 2:
        raise InputError(
            f"gap map '{gap_map}' needs loops at two gaps or more, there are loops at one; measure "
            "another gap, or use --gap-map auto for a model of this gap alone",
            code="single-gap",
            key="gap_map",
        )


def map_candidates(run: SearchRun, loopset: Loops, gap_map: str) -> list[ModelCandidate]:
    """Name the candidates, the simplest first.

    A reluctance in series is physics of a gap only, and does not go with the law of 1986. Of
    ``circuit`` and ``free``, two gaps say too little. Under ``free`` the gap cannot move, so it is
    for other schedules. The offsets of a sensor do not depend on the gap: ``circuit`` lets them
    only where it is asked for.
    """
    gaps, held = run.searched.gaps, run.held
    if gap_map == "circuit":
        candidates = [ModelCandidate("leakage", held)] if gaps >= 3 else []
        candidates.append(ModelCandidate("circuit", held, OFFSETS, rank=1))
        apart = gaps >= 3 and not held >= OFFSETS
        return [*candidates, ModelCandidate("circuit", held, rank=2)] if apart else candidates
    if gap_map == "free":
        # With everything free at each gap, interaction and shape of the anhysteretic replace each
        # other almost without trace, and what is interpolated of them need not fit together.
        # Without interaction the fit is a little worse and may predict much better.
        # The same holds of offsets at every gap.
        if gaps < 3:
            return [ModelCandidate("free", held)]
        candidates = [
            ModelCandidate("free", held | OFFSETS),
            ModelCandidate("free", held | OFFSETS | {"omega"}),
        ]
        if not held >= OFFSETS:
            candidates += [
                ModelCandidate("free", held, rank=1),
                ModelCandidate("free", held | {"omega"}, rank=1),
            ]
        return candidates
    if gap_map != "auto":
        return [ModelCandidate(gap_map, held)]
    candidates = [ModelCandidate("scaling", held)]
    if loopset.schedule is None or loopset.schedule.name != "gap":
        others = map_candidates(run, loopset, "free") if gaps >= 3 else []
        return candidates + [replace(other, rank=other.rank + 1) for other in others]
    if not run.form.kernel.coupled:
        candidates.append(ModelCandidate("reluctance", held))
        candidates += [ModelCandidate("leakage", held, rank=1)] if gaps >= 3 else []
    return candidates


def cell_map(base: ModelCandidate, maps: Sequence[ModelCandidate]) -> ModelCandidate:
    """Name the gap map under which play cells are searched for: the most flexible of a gap's."""
    order = ("leakage", "circuit", "reluctance")
    able = [candidate for candidate in maps if candidate.gap_map in order]
    return min(able, key=lambda candidate: order.index(candidate.gap_map)) if able else base


def under(cells: ModelCandidate, other: ModelCandidate) -> ModelCandidate:
    """Name play cells under the gap map of another candidate."""
    return replace(other, cells=cells.cells, rank=cells.rank - cells.rank % _STEP + other.rank)


def cell_candidates(base: ModelCandidate, shapes: tuple[Shape, ...]) -> list[ModelCandidate]:
    """Name those with play cells, under the map of another one, the simplest first.

    A population more is a step in complexity larger than any between maps.
    """
    return [
        replace(base, cells=CellKernel(shape, count), rank=base.rank + _STEP * (2 * count - 1))
        for count in range(1, POPULATIONS + 1)
        for shape in shapes
    ]


def without_interaction(candidate: ModelCandidate) -> ModelCandidate:
    """Name the same play cells without interaction; they are simpler by that number."""
    return replace(candidate, held=candidate.held | {"omega"}, rank=candidate.rank - 1)


def polished(candidate: ModelCandidate) -> ModelCandidate:
    """Name the same play cells with every weight fitted."""
    return replace(candidate, polished=True, rank=candidate.rank + _STEP)
