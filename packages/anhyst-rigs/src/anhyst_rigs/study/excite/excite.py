"""Measure the loops of a rig's magnet: find how far it may be driven, design, run, write."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from anhyst.data.loops import Loop, Loops
from anhyst.data.sidecar import is_sidecar
from anhyst.support.atomic import PathLike, atomic_writer, check_writable
from anhyst.support.errors import InputError
from anhyst.support.jobs import Progress
from anhyst.support.kinds import capability
from anhyst.support.numeric import FloatArray
from anhyst.support.toml_file import take_rig
from anhyst.support.toml_text import toml_key, toml_value
from anhyst.support.units import QUANTITIES
from anhyst_rigs.rig.body import BodyRig, read_bearing
from anhyst_rigs.rig.force.file import read_rig
from anhyst_rigs.rig.from_loops import complete_rig
from anhyst_rigs.rig.measuring import Pull, read_stack, straight, take
from anhyst_rigs.rig.piezo import PiezoRig, read_piezo_rig
from anhyst_rigs.rig.sensor_table import Sensors
from anhyst_rigs.rig.stage.file import read_stage
from anhyst_rigs.study.excite.design import (
    INNER,
    Bound,
    Record,
    Specimen,
    bearing_specimen,
    coolest_peak,
    demagnetises,
    force_specimen,
    records,
    speeds_of,
    stack_specimen,
    step_of,
)

Measuring = Callable[[Specimen, Progress | None], "Excitation"]
"""How loops of a specimen are measured."""


@dataclass(frozen=True, slots=True)
class ReadSpecimen:
    """What is measured, and the files that say so."""

    specimen: Specimen
    reads: tuple[Path, ...]  # must not be written over
    how: Measuring  # what measures the virtual rig


class HasSpecimen(Protocol):
    """A kind of rig whose loops can be measured."""

    def specimen(self, rig: PathLike) -> ReadSpecimen:
        """Read what is measured of a rig file."""


def read_specimen(path: PathLike) -> ReadSpecimen:
    """Read a rig file of any kind."""
    return capability(take_rig(path, "excite"), HasSpecimen).specimen(path)


def read_stack_specimen(path: PathLike) -> ReadSpecimen:
    """Read the rig file of a piezo stage."""
    stack = read_piezo_rig(path)
    return ReadSpecimen(stack_specimen(stack), (stack.path,), partial(measure_stack, stack))


def read_force_specimen(path: PathLike) -> ReadSpecimen:
    """Read the rig file of an actuator whose force is controlled."""
    rig = read_rig(path)
    named = rig.settings.solenoid
    files = [rig.path] if named is None else [rig.path, rig.path.parent / named.file]
    if named is None and rig.settings.magnet.from_loops:
        files += rig.measured.files
        rig = complete_rig(rig, rig.measured.read())
    return ReadSpecimen(force_specimen(rig), tuple(files), measure)


def read_bearing_specimen(path: PathLike) -> ReadSpecimen:
    """Read the rig file of a bearing."""
    return _of_body(read_bearing(path))


def read_stage_specimen(path: PathLike) -> ReadSpecimen:
    """Read the rig file of a stage."""
    return _of_body(read_stage(path))


def _of_body(rig: BodyRig) -> ReadSpecimen:
    """Take a rig whose magnet may not be fitted to its loops yet."""
    files = [file for file in (rig.path, rig.model, rig.flux_table) if file is not None]
    if rig.settings.magnet.from_loops:
        files += rig.measured.files
        if rig.fitted is None:
            rig = complete_rig(rig, rig.measured.read())
    return ReadSpecimen(bearing_specimen(rig), tuple(files), measure)


SECANT = 0.1
"""Of the largest current, to either side of the operating point: over it the force's slope is taken."""
SPARE = 1.5
"""Fastest loops over the speed that is needed: beyond the fastest nothing is known."""
HEADROOM = 0.95
"""Share of the largest force at which the current is taken back."""
_PROBE = 1000
"""Number of the probe among the records, for the seed of its noise."""


@dataclass(frozen=True, slots=True)
class Place:
    """What was found at a gap before loops were measured there."""

    gap: float  # m; of a piezo stage not a number
    peak: Bound  # largest current, A, and what limits it
    force: float  # largest force that was read on the way there, N
    operating: float  # current about which inner loops are run, A
    reached: bool  # whether it gives the operating force
    # change of the current that the set-point asks for there, A/s; 0: not known
    needed: float = 0.0


@dataclass(frozen=True, eq=False)
class Played:
    """All that the amplifier was asked for, rests included; one value a sample."""

    time: FloatArray  # s
    current: FloatArray  # A
    gap: FloatArray  # m
    # of the winding, 1 where it just may stay for ever; not a number where nothing is known
    warmth: FloatArray


@dataclass(frozen=True, eq=False)
class Excitation:
    """Measured loops, and how they were measured.

    Parameters
    ----------
    loops : Loops
    specimen : Specimen
    places : tuple of Place
        In the order in which they were measured: from the largest gap to the smallest.
    played : Played
    notes : tuple of str
        What was designed down, and why.
    """

    loops: Loops
    specimen: Specimen
    places: tuple[Place, ...]
    played: Played
    notes: tuple[str, ...]

    def as_dict(self) -> dict[str, Any]:
        """Return it as what is printed as JSON."""
        played, specimen = self.played, self.specimen
        drive, unit = specimen.drive, specimen.units[0]
        answer = "displacement_m" if specimen.output == "displacement" else "force_N"
        return {
            "loops": len(self.loops),
            "samples": sum(loop.n for loop in self.loops.loops),
            "duration_s": float(played.time[-1]),
            "begins": "demagnetised" if self.demagnetised else "conditioned",
            f"rate_{unit}_per_s": step_of(specimen) / specimen.sample,
            "limits": {
                name: {"value": limit.value, "key": limit.key}
                for name, limit in (
                    (f"{drive}_{unit}", specimen.current),
                    (f"rate_{unit}_per_s", specimen.rate),
                    (answer, specimen.force),
                )
                if math.isfinite(limit.value)
            },
            "warmth": None if specimen.winding is None else float(played.warmth.max()),
            "gaps": [
                {
                    **({"gap_m": place.gap} if specimen.gaps else {}),
                    f"{drive}_max_{unit}": place.peak.value,
                    "limited_by": place.peak.key,
                    answer: place.force,
                    f"operating_{unit}": place.operating,
                    "operating_reached": place.reached,
                    **({"needed_A_per_s": place.needed} if place.needed else {}),
                }
                for place in self.places
            ],
            "notes": list(self.notes),
        }

    @property
    def demagnetised(self) -> bool:
        """Whether every record begins with demagnetised iron."""
        return all(loop.history.kind == "demagnetised" for loop in self.loops.loops)


@dataclass(slots=True)
class _Clock:
    """What has been played so far."""

    specimen: Specimen
    time: float = 0.0
    warmth: float = 0.0
    parts: list[tuple[FloatArray, ...]] = field(default_factory=list)

    def play(self, current: FloatArray, gap: float) -> FloatArray:
        """Take a path into the account; return the times of its samples, s."""
        sample, winding = self.specimen.sample, self.specimen.winding
        time: FloatArray = self.time + sample * np.arange(1.0, current.size + 1.0)
        if winding is None:
            warmth = np.full(current.size, np.nan)
        else:
            warmth = winding.along(current, sample, self.warmth)
            self.warmth = float(warmth[-1])
        self.parts.append((time, current, np.full(current.size, gap), warmth))
        self.time = float(time[-1])
        return time

    def rest(self, seconds: float, gap: float) -> None:
        """Wait without current."""
        count = int(np.ceil(seconds / self.specimen.sample))
        if count > 0:
            self.play(np.zeros(count), gap)

    def cool(self, current: FloatArray, gap: float) -> None:
        """Wait until a path can be played without the winding becoming too warm."""
        winding = self.specimen.winding
        if winding is not None:
            allowed = winding.start(current, self.specimen.sample)
            self.rest(winding.rest(self.warmth, allowed), gap)

    def played(self) -> Played:
        return Played(*(np.concatenate(column) for column in zip(*self.parts, strict=True)))


def measure(specimen: Specimen, progress: Progress | None = None) -> Excitation:
    """Measure loops at every gap, within the limits.

    From the largest gap to the smallest: the flux rises from gap to gap, so that conditioning wipes
    out what was before. At each gap the current is first raised once, until it, the force or the
    winding is at its limit: that is the largest current of the records there.
    """
    assert specimen.held is not None
    cool = coolest_peak(specimen)
    magnet, clock = specimen.held.magnet(), _Clock(specimen)
    gaps = sorted(specimen.gaps, reverse=True)
    loops: list[Loop] = []
    places = []
    for number, gap in enumerate(gaps):
        if number:
            clock.rest(specimen.pause, gap)
        place = _probe(specimen, magnet, clock, gap, number, cool)
        places.append(place)
        paths = records(specimen, place.peak.value, place.operating)
        for count, record in enumerate(paths):
            sensors = specimen.held.sensors([number, count], record.sample)
            loops.append(_take(specimen, magnet, sensors, clock, gap, record))
            if progress is not None:
                progress(number * len(paths) + count + 1, len(gaps) * len(paths))
    check_operating(specimen, places)
    names = QUANTITIES["current"], QUANTITIES[specimen.output], QUANTITIES["gap"]
    return Excitation(
        Loops(tuple(loops), *names),
        specimen,
        tuple(places),
        clock.played(),
        tuple(notes_of(specimen, places)),
    )


def measure_stack(
    rig: PiezoRig, specimen: Specimen, progress: Progress | None = None
) -> Excitation:
    """Measure loops of a piezo stage in one drive, from long rest at 0 V, as its creep goes on."""
    clock, cool, nowhere = _Clock(specimen), coolest_peak(specimen), math.nan
    seed = [rig.settings.seed, _PROBE]
    rise = straight([0.0, cool.value], step_of(specimen))
    clock.play(np.concatenate([rise, rise[::-1]]), nowhere)
    probed = read_stack(rig, clock.played().current, specimen.sample, seed)
    place = place_of(specimen, nowhere, rise, probed[: rise.size].tolist(), cool)
    paths = records(specimen, place.peak.value, place.operating)
    times = []
    for record in paths:
        clock.play(record.approach, nowhere)
        clock.rest(specimen.pause, nowhere)
        times.append(clock.play(record.path, nowhere))
    played = clock.played()
    read = read_stack(rig, played.current, specimen.sample, seed)
    loops = []
    for count, (record, time) in enumerate(zip(paths, times, strict=True)):
        begin = round(time[0] / specimen.sample) - 1
        answer = read[begin : begin + time.size]
        loops.append(Loop(record.name, record.path, answer, None, time, record.history))
        if progress is not None:
            progress(count + 1, len(paths))
    names = QUANTITIES[specimen.drive], QUANTITIES[specimen.output]
    notes = tuple(notes_of(specimen, [place]))
    return Excitation(Loops(tuple(loops), *names), specimen, (place,), played, notes)


def _probe(
    specimen: Specimen, magnet: Pull, clock: _Clock, gap: float, number: int, cool: Bound
) -> Place:
    """Raise the current once until something is at its limit, and take it back."""
    assert specimen.held is not None
    path = straight([0.0, cool.value], step_of(specimen))
    clock.cool(np.concatenate([path, path[::-1]]), gap)
    sensors = specimen.held.sensors([number, _PROBE], specimen.sample)
    forces: list[float] = []
    for current in path.tolist():
        forces.append(sensors["force"].read(np.array([magnet.hold(current, gap)])).item())
        if forces[-1] >= HEADROOM * specimen.force.value:
            break
    magnet.hold(0.0, gap)
    gone = path[: len(forces)]
    clock.play(np.concatenate([gone, gone[::-1]]), gap)
    return place_of(specimen, gap, gone, forces, cool)


def place_of(
    specimen: Specimen, gap: float, gone: FloatArray, forces: Sequence[float], cool: Bound
) -> Place:
    """Return what the first rise of the current at a gap showed."""
    peak = cool
    if forces[-1] >= HEADROOM * specimen.force.value:
        # One sample back: what was there is below the limit for certain.
        peak = Bound(float(gone[max(gone.size - 2, 0)]), specimen.force.key)
    if gone.size < 3:
        raise InputError(
            f"{specimen.force.key}: at {1e3 * gap:g} mm {specimen.force.value:g} N are reached at "
            f"{gone[-1]:.3g} A; there is no room for a loop",
            code="force-limit-too-low",
            key=specimen.force.key,
        )
    enough = np.flatnonzero(np.array(forces) >= specimen.operating.value)
    least, most = (share * peak.value for share in INNER)
    bias = float(gone[enough[0]]) if enough.size else np.inf
    operating = min(max(bias, least), most)
    needed = _needed(specimen, gone, np.array(forces), operating)
    return Place(gap, peak, max(forces), operating, bias == operating, needed)


def _needed(specimen: Specimen, current: FloatArray, force: FloatArray, operating: float) -> float:
    """Return how fast the current changes where the force does as fast as is asked for, A/s."""
    near = np.abs(current - operating) <= SECANT * current[-1]
    if specimen.hurry == 0.0 or np.count_nonzero(near) < 3:
        return 0.0
    slope = float(np.polynomial.polynomial.polyfit(current[near], force[near], 1)[1])
    return specimen.hurry / slope if slope > 0.0 else 0.0


def _take(
    specimen: Specimen, magnet: Pull, sensors: Sensors, clock: _Clock, gap: float, record: Record
) -> Loop:
    """Bring the iron into the state that a record begins with, and record."""
    clock.cool(record.whole(specimen.sample), gap)
    clock.play(record.approach, gap)
    for turn in record.before:
        magnet.hold(turn, gap)
    time = clock.time + record.sample * np.arange(1.0, record.path.size + 1.0)
    clock.play(record.counted(specimen.sample), gap)
    seconds = record.sample if record.fast else math.inf
    current, force = take(magnet, sensors, gap, record.path, seconds)
    label = f"{1e3 * gap:g}mm-{record.name}"
    above = np.flatnonzero(np.abs(force) > specimen.force.value)
    if above.size:
        raise InputError(
            f"{specimen.force.key}: {label} reads {force[above[0]]:.4g} N at "
            f"{current[above[0]]:.4g} A, more than {specimen.force.value:g} N and more than the "
            "first rise at this gap showed; lower excite.current_max_A",
            code="force-above-limit",
            key=specimen.force.key,
        )
    return Loop(label, current, force, np.full(time.size, gap), time, record.history)


def check_operating(specimen: Specimen, places: Sequence[Place]) -> None:
    """Refuse places none of which gives the operating force."""
    if any(place.reached for place in places):
        return
    best = max(places, key=lambda place: place.force)
    raise InputError(
        f"{specimen.operating.key}: inner loops are wanted about {specimen.operating.value:g} N, "
        f"and at no gap is that between {100 * INNER[0]:.0f} and {100 * INNER[1]:.0f} % of the "
        f"largest current; {best.peak.key} leaves {best.peak.value:.3g} A and {best.force:.4g} N at "
        f"{1e3 * best.gap:g} mm; give excite.operating_N, or raise that limit",
        code="operating-force-not-reached",
        key=specimen.operating.key,
    )


def notes_of(specimen: Specimen, places: Sequence[Place]) -> list[str]:
    """Say what was designed down, and why."""
    notes = []
    unit, answer = specimen.units
    if specimen.sweep > specimen.rate.value:
        notes.append(
            f"current changes by {specimen.rate.value:.4g} A/s instead of {specimen.sweep:.4g} A/s: "
            f"{specimen.rate.key}"
        )
    for place in places:
        at = f"{1e3 * place.gap:g} mm: " if specimen.gaps else ""
        if place.peak.value < specimen.current.value:
            notes.append(
                f"{at}largest current {place.peak.value:.4g} A instead of "
                f"{specimen.current.value:.4g} A: {place.peak.key}"
            )
        if not place.reached:
            notes.append(
                f"{at}inner loops about {place.operating:.4g} {unit}, which does not give the "
                f"{specimen.operating.value:.4g} {answer} of {specimen.operating.key}"
            )
    if not all(demagnetises(specimen, place.peak.value) for place in places):
        notes.append(
            "the amplifier does not drive as far below zero as above: records begin after "
            f"{specimen.cycles} cycles from 0 to the largest {specimen.drive} instead of "
            "demagnetised"
        )
    notes += [
        f"full cycles at {specimen.rate.value:.4g} A/s instead of {speed:.4g} A/s: {specimen.rate.key}"
        for speed in specimen.fast
        if speed > specimen.rate.value
    ]
    needed = SPARE * max(place.needed for place in places)
    if specimen.fast and needed > max(speeds_of(specimen)):
        notes.append(
            f"the set-point asks for {needed / SPARE:.3g} A/s at the operating point, and "
            f"cycles of {needed:.3g} A/s would show what solid iron does there "
            "(measurement.fast_A_per_s)"
        )
    if specimen.gaps and specimen.winding is None:
        notes.append(
            "the rig file does not say what the winding stands (excite.continuous_A, thermal_s): "
            "its temperature is not looked at"
        )
    return notes


def excite(
    rig: PathLike, out: PathLike, progress: Progress | None = None, how: Measuring | None = None
) -> Excitation:
    """Measure the loops of a rig and write them, with a sidecar that says how they begin.

    Without `how` it is the virtual rig that is measured.
    """
    file = Path(out)
    if file.suffix.lower() != ".csv":
        raise InputError(
            f"{file}: loops are written as .csv; change the ending", code="wrong-ending"
        )
    read = read_specimen(rig)
    if how is not None and not read.specimen.gaps:
        raise InputError(
            "--xcp and --port measure through a controller of force, which a piezo stage has none "
            "of; leave them and --folder out",
            code="option-not-for-this",
            key="--xcp",
        )
    sidecar = file.with_suffix(".toml")
    for path in (file, sidecar):
        check_writable(path, reads=read.reads)
    if sidecar.exists() and not is_sidecar(sidecar):
        raise InputError(
            f"{sidecar}: is no description of loops; write to another file", code="not-a-sidecar"
        )
    try:
        measured = (how or read.how)(read.specimen, progress)
    except InputError as error:
        raise error.at(rig) from error
    write_excitation(measured, Path(rig), file)
    return measured


def write_excitation(measured: Excitation, rig: Path, out: Path) -> None:
    """Write measured loops, and the sidecar that says how they begin."""
    lines = [f"# measured by anhyst excite {rig.name}", *(f"# {note}" for note in measured.notes)]
    histories = {loop.label: str(loop.history) for loop in measured.loops.loops}
    lines += ["", "[history]"]
    lines += [f"{toml_key(label)} = {toml_value(past)}" for label, past in histories.items()]
    with atomic_writer(out.with_suffix(".toml")) as file:
        file.write("\n".join(lines) + "\n")
    measured.loops.save(out)
