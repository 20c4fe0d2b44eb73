"""Virtual magnets that are independent of the development of the package.

Their parameters were fixed before the first fit. The magnets differ in size, family of iron and way
of recording. A result that holds for all of them is therefore not specific to the bundled examples.

==========  ==========================  ===========================================================
magnet      iron                        loops
==========  ==========================  ===========================================================
``u``       Preisach                    four gaps, 0 to 5 A, 0.78 kN, every record starts
                                        demagnetised, noise 0.03 %, no offsets
``hard``    Preisach, wide loop         five gaps, driven to twice the knee, settled cycles that
                                        start anywhere, offsets of both sensors
``soft``    friction, loop below 0.5 %  three gaps, 9 N, in mA and mm, with a bias loop
==========  ==========================  ===========================================================

``python -m foreign.magnets NAME FILE`` writes the loops of one magnet.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np

from anhyst.support.numeric import FloatArray
from anhyst.support.units import MU_0
from tests.foreign.irons import FrictionIron, FrictionSteel, Iron, PreisachIron, PreisachSteel


@dataclass(frozen=True)
class Geometry:
    """Winding, core and the two air gaps of a U-shaped magnet in front of a flat armature."""

    turns: int
    width: float  # width of a pole, m
    depth: float  # m
    iron_length: float  # m
    leakage: float  # H, between the legs
    parasitic_gap: float  # m, gap of the joints of the core

    def permeances(self, gap: float) -> tuple[float, float]:
        """Return the permeances of the working gaps, and of the total path outside the iron, H."""
        area = (self.width + gap) * (self.depth + gap)
        gaps = MU_0 * area / (2.0 * gap)
        joints = MU_0 * self.width * self.depth / self.parasitic_gap
        return gaps, 1.0 / (1.0 / (gaps + self.leakage) + 1.0 / joints)


@dataclass(frozen=True)
class Sensors:
    """Errors of the sensors; noise in rms, SI units."""

    current_noise: float
    force_noise: float
    current_offset: float = 0.0
    force_offset: float = 0.0


@dataclass(frozen=True)
class ForeignMagnet:
    """A magnet, the drive of its loops, and their file layout."""

    name: str
    make_iron: Callable[[], Iron]
    geometry: Geometry
    sensors: Sensors
    gaps: tuple[float, ...]  # m, measured gaps
    unseen: tuple[float, ...]  # m, gaps for predictions
    ranges: tuple[tuple[float, float], ...]  # A, amplitudes of the loops
    demagnetised: bool  # records start demagnetised; otherwise settled, anywhere in the cycle
    units: dict[str, tuple[str, float]] = field(
        default_factory=lambda: {"I": ("A", 1.0), "F": ("N", 1.0), "gap": ("m", 1.0)}
    )
    samples: int = 200  # number of samples of a sweep over the whole range
    sweep: float = 1.0  # s, duration of such a sweep

    @property
    def top(self) -> float:
        """Largest current, A."""
        return max(high for _, high in self.ranges)

    def force(self, current: FloatArray, gap: FloatArray | float, iron: Iron | None = None) -> FloatArray:
        """Return the true force, N, of a new (or a given) magnet along a drive."""
        iron = iron or self.make_iron()
        gaps = np.broadcast_to(np.asarray(gap, dtype=np.float64), current.shape)
        return np.array([self._pull(iron, i, g) for i, g in zip(current, gaps, strict=True)])

    def _pull(self, iron: Iron, current: float, gap: float) -> float:
        shape = self.geometry
        area = shape.width * shape.depth
        working, all_gaps = shape.permeances(gap)
        flux_density = iron.move(shape.turns * current, shape.iron_length, area / all_gaps)
        # The working gaps carry the flux of the iron without the leakage.
        flux = flux_density * area * working / (working + shape.leakage)
        rim = (shape.width + gap) * (shape.depth + gap)
        fringes = 1.0 - gap * (shape.width + shape.depth + 2.0 * gap) / rim
        return flux * flux / (MU_0 * rim) * fringes

    def sweep_between(self, *ends: float) -> FloatArray:
        """Return linear ramps of current between some ends, A, evenly sampled."""
        step = self.top / self.samples
        parts = [np.array(ends[:1])]
        for start, end in pairwise(ends):
            count = max(2, round(abs(end - start) / step))
            parts.append(np.linspace(start, end, count + 1)[1:])
        return np.concatenate(parts)

    def _records(self) -> Iterator[tuple[int, float, FloatArray, FloatArray]]:
        for gap in self.gaps:
            for number, (lowest, high) in enumerate(self.ranges, start=1):
                iron = self.make_iron()
                if self.demagnetised:
                    drive = self.sweep_between(lowest, high, lowest, high, lowest)
                else:
                    cycle = self.sweep_between(lowest, high, lowest)[:-1]
                    self.force(np.tile(cycle, 3), gap, iron)
                    turn = round(0.3 * number * cycle.size)
                    self.force(cycle[:turn], gap, iron)
                    drive = np.roll(cycle, -turn)
                yield number, gap, drive, self.force(drive, gap, iron)

    def write_loops(self, path: Path) -> Path:
        """Write the loops with the errors of the sensors; repeated calls write equal bytes."""
        noise = np.random.default_rng(20261122)
        sensors = self.sensors
        header = [f"{name}_{unit}" for name, (unit, _) in self.units.items()]
        lines = [",".join(["t_s", *header, "loop"])]
        clock, step = 0.0, self.sweep / self.samples
        for number, gap, current, force in self._records():
            read = {
                "I": current
                + sensors.current_offset
                + noise.normal(0.0, sensors.current_noise, current.size),
                "F": force + sensors.force_offset + noise.normal(0.0, sensors.force_noise, force.size),
                "gap": np.full(current.size, gap),
            }
            scaled = [read[name] / scale for name, (_, scale) in self.units.items()]
            for row in zip(*scaled, strict=True):
                lines.append(",".join([f"{clock:.5f}", *(f"{value:.8g}" for value in row), str(number)]))
                clock += step
            clock += 1.0
        path.write_text("\n".join(lines) + "\n", encoding="utf-8")
        return path


U = ForeignMagnet(
    name="u",
    make_iron=lambda: PreisachIron(
        PreisachSteel(
            saturation=1.75,
            pinning=55.0,
            pinning_spread=0.55,
            bias=160.0,
            bias_by_pinning=1.1,
            reversible_fraction=0.12,
        )
    ),
    geometry=Geometry(
        turns=200, width=0.022, depth=0.0205, iron_length=0.24, leakage=1.6e-7, parasitic_gap=2e-5
    ),
    sensors=Sensors(current_noise=1e-3, force_noise=0.22),
    gaps=(0.3e-3, 0.4e-3, 0.5e-3, 0.6e-3),
    unseen=(0.35e-3, 0.55e-3),
    ranges=((0.0, 5.0), (0.0, 3.5), (0.0, 2.0)),
    demagnetised=True,
)

HARD = ForeignMagnet(
    name="hard",
    make_iron=lambda: PreisachIron(
        PreisachSteel(
            saturation=1.55,
            pinning=900.0,
            pinning_spread=0.35,
            bias=420.0,
            bias_by_pinning=0.45,
            reversible_fraction=0.2,
        )
    ),
    geometry=Geometry(turns=260, width=0.016, depth=0.02, iron_length=0.2, leakage=9e-8, parasitic_gap=3e-5),
    sensors=Sensors(current_noise=2e-3, force_noise=0.12, current_offset=0.06, force_offset=-1.6),
    gaps=(0.2e-3, 0.3e-3, 0.4e-3, 0.5e-3, 0.65e-3),
    unseen=(0.25e-3, 0.55e-3),
    ranges=((0.0, 8.0), (0.0, 5.0), (2.0, 6.0)),
    demagnetised=False,
)

SOFT = ForeignMagnet(
    name="soft",
    make_iron=lambda: FrictionIron(
        FrictionSteel(knee_field=18.0, knee_flux=0.62, coercivity=4.0, friction_flux=0.035)
    ),
    geometry=Geometry(
        turns=480, width=0.006, depth=0.008, iron_length=0.07, leakage=1.2e-8, parasitic_gap=1e-5
    ),
    sensors=Sensors(current_noise=0.1e-3, force_noise=2e-3),
    gaps=(0.15e-3, 0.25e-3, 0.4e-3),
    unseen=(0.2e-3, 0.32e-3),
    ranges=((0.0, 0.3), (0.0, 0.18), (0.1, 0.25)),
    demagnetised=False,
    units={"I": ("mA", 1e-3), "F": ("N", 1.0), "gap": ("mm", 1e-3)},
    sweep=4.0,
)

MAGNETS = {magnet.name: magnet for magnet in (U, HARD, SOFT)}


if __name__ == "__main__":
    MAGNETS[sys.argv[1]].write_loops(Path(sys.argv[2]))
