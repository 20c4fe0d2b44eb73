"""The rig file of a magnetic bearing: plant, instruments, and its test cases.

Everything is SI and the unit stands in the key. Every key is described in docs/rig-file.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from anhyst.rig.bearing.tables import BearingTable, MagnetTable
from anhyst.rig.from_loops import FittedPlant
from anhyst.rig.loop_files import Measured, identify_faults
from anhyst.support.atomic import PathLike
from anhyst.support.toml_file import FileFault, faults_error, read_toml
from anhyst.support.toml_text import Path as KeyPath

TICKS_PER_POLE = 20.0
"""Least sample rate in multiples of the unstable pole of the plant without controller."""
LEAST_HOLD = 8
"""Ticks for which a step is held, to judge it by."""
LONGEST_PERIOD_S = 60.0
"""Of a trajectory, s."""
TICKS_PER_PERIOD = 10.0
"""More than so many ticks make a period of a trajectory."""
MOST_DELAY = 128
"""Sub-steps between sample and output, or by which a sensor may be late."""


@dataclass(frozen=True, slots=True)
class PlacedMagnet:
    """A magnet in its place."""

    table: MagnetTable  # what it is
    # its gap and that of the bearing together, m, for one on the other side of the armature; None
    # for one that closes the gap
    total: float | None = None

    def gap(self, gap: float) -> float:
        """Return its own gap at a gap of the bearing, both m."""
        return gap if self.total is None else self.total - gap


@dataclass(frozen=True, slots=True)
class BearingRig:
    """A bearing as its file describes it."""

    path: Path  # the rig file
    settings: BearingTable  # what it says
    # magnet that was fitted to the loops; `settings` holds its numbers then
    fitted: FittedPlant | None = None

    @property
    def dt(self) -> float:
        """Time between ticks, s."""
        return 1.0 / self.settings.timing.rate_Hz

    @property
    def step(self) -> float:
        """Time between sub-steps, s."""
        return self.dt / self.settings.timing.substeps

    @property
    def measured(self) -> Measured:
        """The loops that its file names."""
        settings = self.settings
        return Measured(self.path, ("loops",), tuple(settings.loops), settings.identify)

    @property
    def magnets(self) -> tuple[PlacedMagnet, ...]:
        """All that pull the armature; the first one closes the gap."""
        magnet = self.settings.magnet
        first = PlacedMagnet(magnet)
        if magnet.arrangement == "single":
            return (first,)
        return first, PlacedMagnet(magnet, magnet.gap_total_m)

    @property
    def model(self) -> Path | None:
        """Model file of a magnet whose force an identified law makes."""
        model = self.settings.magnet.model
        return None if model is None else self.path.parent / model.file

    @property
    def flux_table(self) -> Path | None:
        """Flux table of such a magnet, if it has one."""
        model = self.settings.magnet.model
        if model is None or model.flux_table is None:
            return None
        return self.path.parent / model.flux_table

    @property
    def load(self) -> float:
        """Force that pulls the gap open all the time, N: load drive and weight."""
        mechanics = self.settings.mechanics
        return self.settings.load.force_N + mechanics.mass_kg * mechanics.gravity_m_per_s2


def step_ends(gap: float, height: float) -> tuple[float, float]:
    """Return the gaps between which a step goes: half its height to either side.

    High steps have room between the end stops then, up and down steps see the same magnet, and
    the plant linearised at the gap is that of the middle of every step.
    """
    return gap + height / 2.0, gap - height / 2.0


def read_bearing(path: PathLike) -> BearingRig:
    """Read the rig file of a bearing."""
    place = Path(path)
    settings = read_toml(place, BearingTable)
    faults = [*_delay_faults(settings), *_plant_faults(settings), *_simulate_faults(settings)]
    faults += identify_faults(settings.identify)
    if faults:
        raise faults_error(place, faults)
    return BearingRig(place, settings)


def check_load(rig: BearingRig, force_max: float) -> None:
    """Refuse a load that no current can carry."""
    load = rig.load
    steps = rig.settings.simulate.load_steps_N
    faults: list[FileFault] = []
    if not load < force_max:
        text = f"no current can carry {load:.4g} N, the magnet reaches {force_max:.4g} N"
        faults.append(
            FileFault(
                ("load", "force_N"),
                f"{text}; lower it or raise current_high_A",
                code="load-too-large",
            )
        )
    for place, step in enumerate(steps):
        if load < force_max <= load + step:
            text = f"{load:.4g} N and this step are {load + step:.4g} N"
            text += f", the magnet reaches {force_max:.4g} N; lower it"
            faults.append(
                FileFault(("simulate", "load_steps_N", place), text, code="load-too-large")
            )
    if faults:
        raise faults_error(rig.path, faults)


def check_rate(rig: BearingRig, pole_Hz: float) -> None:
    """Refuse a sample rate that is too slow for the plant."""
    rate, least = rig.settings.timing.rate_Hz, TICKS_PER_POLE * pole_Hz
    if rate < least:
        text = f"{rate:.6g} Hz is too slow for a plant whose unstable pole lies at {pole_Hz:.4g} Hz"
        text += f"; use at least {TICKS_PER_POLE:g} times that, {math.ceil(least)} Hz"
        raise faults_error(rig.path, [FileFault(("timing", "rate_Hz"), text, code="rate-too-low")])


def _delay_faults(settings: BearingTable) -> list[FileFault]:
    """Find delays that the plant has no memory for."""
    timing = settings.timing
    per_second = timing.rate_Hz * timing.substeps
    output = timing.delay_ticks * timing.substeps + settings.amplifier.delay_s * per_second
    faults: list[FileFault] = []
    for key, steps in (
        (("amplifier", "delay_s"), output),
        (("position_sensor", "delay_s"), settings.position_sensor.sensor().delay * per_second),
    ):
        if steps > MOST_DELAY:
            text = f"makes a delay of {steps:.0f} sub-steps, the plant has {MOST_DELAY}"
            faults.append(
                FileFault(key, f"{text}; shorten it or lower substeps", code="delay-too-long")
            )
    return faults


def _plant_faults(settings: BearingTable) -> list[FileFault]:
    """Find what does not fit together in the plant and its instruments."""
    faults: list[FileFault] = []
    mechanics, magnet = settings.mechanics, settings.magnet
    low, high = mechanics.stop_low_m, mechanics.stop_high_m
    if magnet.gap_total_m is not None and not high < magnet.gap_total_m:
        text = f"must be above stop_high_m, {high:g} m, or the second magnet is touched; raise it"
        faults.append(FileFault(("magnet", "gap_total_m"), text, code="range-too-narrow"))
    sensor = settings.position_sensor
    if not (sensor.low_m <= low and high <= sensor.high_m):
        text = f"its range must hold the travel, {low:g} to {high:g} m; widen low_m or high_m"
        faults.append(FileFault(("position_sensor",), text, code="range-too-narrow"))
    amplifier, shunt = settings.amplifier, settings.current_sensor
    if not (shunt.low_A <= amplifier.current_low_A and amplifier.current_high_A <= shunt.high_A):
        text = "its range must hold that of the amplifier; widen low_A or high_A"
        faults.append(FileFault(("current_sensor",), text, code="range-too-narrow"))
    if settings.measurement.current_max_A > amplifier.current_high_A:
        text = f"the amplifier ends at {amplifier.current_high_A:g} A; lower it"
        faults.append(FileFault(("measurement", "current_max_A"), text, code="beyond-amplifier"))
    return faults


def _simulate_faults(settings: BearingTable) -> list[FileFault]:
    """Find references outside the travel."""
    faults: list[FileFault] = []
    low, high = settings.mechanics.stop_low_m, settings.mechanics.stop_high_m
    cases = settings.simulate

    def check(key: KeyPath, what: str, lowest: float, highest: float) -> bool:
        if low < lowest and highest < high:
            return True
        goes = f"{highest:.5g}" if lowest == highest else f"{lowest:.5g} to {highest:.5g}"
        text = f"{what} is at {goes} m, outside the travel of {low:g} to {high:g} m"
        faults.append(
            FileFault(
                ("simulate", *key), f"{text}; lower it or move the stops", code="outside-travel"
            )
        )
        return False

    check(("gap_m",), "the reference", cases.gap_m, cases.gap_m)
    for place, gap in enumerate(cases.also_gaps_m):
        check(("also_gaps_m", place), "the reference", gap, gap)
    for place, height in enumerate(cases.steps_m):
        for gap in (cases.gap_m, *cases.also_gaps_m):
            lower, upper = step_ends(gap, height)
            if not check(("steps_m", place), f"the step around {gap:g} m", upper, lower):
                break
    for place, trajectory in enumerate(cases.trajectories):
        away = trajectory.amplitude_m
        ends = cases.gap_m - away, cases.gap_m + away
        check(("trajectories", place, "amplitude_m"), "the reference", *ends)
    return [*faults, *_time_faults(settings)]


def _time_faults(settings: BearingTable) -> list[FileFault]:
    """Find what is too short or too long for the rate."""
    faults: list[FileFault] = []
    cases, rate = settings.simulate, settings.timing.rate_Hz
    if round(cases.hold_s * rate) < LEAST_HOLD:
        text = f"holds a step for {cases.hold_s * rate:.3g} ticks of 1/{rate:g} s"
        text += f"; {LEAST_HOLD} at least, {LEAST_HOLD / rate:.4g} s"
        faults.append(FileFault(("simulate", "hold_s"), text, code="too-short"))
    most, least = rate / TICKS_PER_PERIOD, 1.0 / LONGEST_PERIOD_S
    for place, trajectory in enumerate(cases.trajectories):
        frequency, text = trajectory.frequency_Hz, ""
        if frequency >= most:
            text = f"{frequency:g} Hz is not below a tenth of rate_Hz, {most:g} Hz; lower it"
        elif frequency < least:
            text = f"a period of {1.0 / frequency:.4g} s is longer than {LONGEST_PERIOD_S:g} s"
            text += "; raise it"
        if text:
            faults.append(
                FileFault(
                    ("simulate", "trajectories", place, "frequency_Hz"), text, code="out-of-range"
                )
            )
    return faults
