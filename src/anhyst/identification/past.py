"""What the drive did before the first sample of a record, and at which gaps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from anhyst.support.arrays import FloatArray


@dataclass(frozen=True, eq=False)
class Past:
    """Turning points of the input, in their order."""

    drive: FloatArray  # SI; shape (n,)
    # where each was: the place of its gap among those of the problem, a fraction between two of
    # them; shape (n,)
    place: FloatArray

    @classmethod
    def at(cls, drive: FloatArray, gap: int) -> Past:
        """Return a past at one gap."""
        return cls(drive, np.full(drive.size, float(gap)))

    def then(self, drive: FloatArray, gap: int) -> Past:
        """Go on at a gap."""
        place = np.full(drive.size, float(gap))
        return Past(np.concatenate([self.drive, drive]), np.concatenate([self.place, place]))

    def only_at(self, gap: int) -> Past:
        """Take what was at one gap, as if there were no other."""
        here = self.place == gap
        return Past.at(self.drive[here], 0)

    def among(self, keep: list[int]) -> Past:
        """Renumber the gaps where only some are kept; what was between stays between."""
        return Past(self.drive, np.interp(self.place, keep, np.arange(len(keep))))

    def remembered(self) -> Past:
        """Take what play cells can keep of it: closed cycles at one gap are left out."""
        edges = np.flatnonzero(np.diff(self.place)) + 1
        kept = [
            Past(points, np.full(points.size, place[0]))
            for drive, place in zip(
                np.split(self.drive, edges), np.split(self.place, edges), strict=True
            )
            if drive.size
            for points in [remembered(drive)]
        ]
        if not kept:
            return self
        return Past(
            np.concatenate([one.drive for one in kept]), np.concatenate([one.place for one in kept])
        )


def remembered(drive: FloatArray) -> FloatArray:
    """Return what play cells can keep of a drive: its ends and turning points, closed cycles left out.

    A cycle is closed where both its neighbours reach beyond it. That holds wherever zero is, which
    the offset of the drive moves; so what only a demagnetised start would wipe out is kept.
    """
    way = np.sign(np.diff(drive))
    moving = np.flatnonzero(way)
    turns = moving[1:][way[moving[1:]] != way[moving[:-1]]]
    kept = [float(drive[0])]
    for point in [*drive[turns].tolist(), float(drive[-1])]:
        kept.append(point)
        while len(kept) > 3 and _closed(*kept[-4:]):
            del kept[-3:-1]
    return np.array(kept)


def _closed(before: float, first: float, second: float, after: float) -> bool:
    """Whether the cycle between two turning points lies within what comes before and after."""
    return abs(second - first) <= min(abs(first - before), abs(after - second))
