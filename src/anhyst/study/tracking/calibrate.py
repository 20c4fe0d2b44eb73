"""Calibration from motion: mass times acceleration is a force sensor that every stage has.

The law of a method follows the currents that were commanded, at the gaps that were read, in the
core's own code; what the body did is its acceleration. Both sides pass the same filter. What they
differ by is explained by a few numbers, each held by the standard deviation that the rig file
states.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from anhyst._core import allocate
from anhyst.compensate.flux_feedback import FluxFeedback
from anhyst.compensate.interface import MethodName
from anhyst.data.table import read_columns
from anhyst.rig.bearing.make_setup import IdentifiedMagnet
from anhyst.rig.recording import CURRENTS, MAGNETS, Recording, of_magnets, rms
from anhyst.rig.stage.file import (
    LIMITS,
    CalibratedMethod,
    CalibrationFile,
    LearntParameter,
    ParameterName,
    StageRig,
    per_root,
    read_stage,
)
from anhyst.rig.stage.loop import PROBES, READ, StageSetup, fit_method, identify_stage
from anhyst.study.tracking.simulate import follows_rate
from anhyst.support.arrays import FloatArray
from anhyst.support.atomic import PathLike, atomic_writer, check_writable
from anhyst.support.errors import InputError
from anhyst.support.result import Result, columns_of
from anhyst.support.toml_text import toml_value
from anhyst.support.units import parse_header

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FILTER_HZ = 250.0
"""Corner of the three poles that both sides pass; a twentieth of the ticks at most."""
UPDATES_HZ = 1000.0
"""How often the two sides are compared."""
DEAD = 0.06
"""Nothing is learnt below this part of the largest force: at rest any load would be taken for one."""
TRUST = 0.004
"""Standard deviation of a comparison, in parts of the largest force: what a good law leaves."""
MOST = 4.0
"""Standard deviations within which a parameter stays."""
PASSES = 3
"""Linear fits, each around the last."""
LEAST = 100
"""Rows of a recording."""
STILL = 20
"""Ticks over which a speed is taken, to see whether a recording begins at rest."""
AMPLIFIER = 16.0
"""Bandwidth that an amplifier must have, in corners of the filter: what it lags is not counted."""
SEEN = 0.7
"""Of its prior standard deviation: a parameter with more left is called not seen."""

_OF_IRON: tuple[ParameterName, ...] = ("scale_1", "scale_2", "width", "lag_s", "bias_N")
MOVED: Mapping[MethodName, tuple[ParameterName, ...]] = {
    "single-valued": ("scale_1", "scale_2", "lag_s", "bias_N"),
    "play": _OF_IRON,
    "at-rest": _OF_IRON,
    "full": _OF_IRON,
    "flux": ("scale_1", "scale_2", "bias_N"),
}
"""What can be learnt of each method. The gap zero is frozen: on one axis it is hardly to be told from
the difference of both scales."""
STEPS: Mapping[ParameterName, float] = {
    "scale_1": 0.005,
    "scale_2": 0.005,
    "width": 0.1,
    "lag_s": 25e-6,
    "bias_N": 1.0,
}
"""By which a parameter is moved for its derivative along the path."""
WIDTHS = 0.005
"""A law is fitted anew for widths on this grid."""
COMMANDS = of_magnets(CURRENTS[:1], 1, MAGNETS)
NEEDED = ("t_s", "demand_N", *READ, *COMMANDS)
KIND = 0.0037
"""Of the moving force: what a law of the right kind leaves at most, root mean square."""
FAULT = 0.01
"""The same of anything that is worth learning; where more is left, nothing is taken."""
HEAD = """\
# What motion taught of the magnets of a stage. Written by anhyst calibrate; a rig file names it as
# control.calibration. Values are parts, or carry their unit; the scale of force is the mass."""
PARAMETERS: tuple[ParameterName, ...] = get_args(ParameterName)


def prior(rig: StageRig, method: MethodName, name: ParameterName) -> float:
    """Return the standard deviation that a rig file states for a parameter."""
    spread = rig.settings.spread
    scale = spread.hall_percent if method == "flux" else spread.current_percent
    return {
        "scale_1": 0.01 * scale,
        "scale_2": 0.01 * scale,
        "gap_zero_m": spread.gap_zero_m,
        "width": 0.01 * spread.pinning_percent,
        "lag_s": spread.eddy_s,
        "bias_N": 0.01 * rig.settings.tracking.force_max_N,
    }[name]


@dataclass(frozen=True)
class Motion:
    """What was read while a stage moved, and what its body did."""

    rig: StageRig
    read: Mapping[str, FloatArray]  # by column

    @property
    def ticks(self) -> FloatArray:
        """Number of each tick."""
        return np.arange(self.read["demand_N"].size, dtype=np.float64)

    def filtered(self, force: FloatArray, late: float = 0.0) -> FloatArray:
        """Return a force that acts so many ticks late, through the filter of both sides."""
        share = -math.expm1(-2.0 * math.pi * min(FILTER_HZ * self.rig.dt, 0.05))
        passed = np.interp(self.ticks - late, self.ticks, force)
        for _ in range(3):
            passed = lfilter([share], [1.0, share - 1.0], passed)
        return np.asarray(passed)

    @cached_property
    def pushed(self) -> FloatArray:
        """Mass times acceleration, filtered, N."""
        place = self.read["position_read_m"]
        acceleration = np.zeros(place.size)
        acceleration[1:-1] = np.diff(place, 2) / self.rig.dt**2
        return self.filtered(self.rig.settings.body.mass_kg * acceleration)

    @property
    def noise(self) -> float:
        """Standard deviation of that force from the noise of the position, N."""
        tick = np.zeros(self.ticks.size)
        tick[:3] = 1.0, -2.0, 1.0
        passed = float(np.linalg.norm(self.filtered(tick))) / self.rig.dt**2
        file = self.rig.settings
        return file.body.mass_kg * file.position_sensor.noise_m * passed

    @cached_property
    def compared(self) -> NDArray[np.intp]:
        """Ticks at which both sides are compared: where much is demanded."""
        every = max(1, round(1.0 / (UPDATES_HZ * self.rig.dt)))
        least = DEAD * self.rig.settings.tracking.force_max_N
        asked = np.abs(self.filtered(self.read["demand_N"]))[::every]
        return every * np.flatnonzero(asked > least)

    @cached_property
    def rises(self) -> FloatArray:
        """By how much the root of the force of each magnet that was asked for rises in a tick."""
        idle = self.rig.idle
        asked = np.array([allocate(one, idle) for one in self.read["demand_N"].tolist()]).T
        return np.diff(np.sqrt(asked), prepend=0.0)

    @property
    def late(self) -> float:
        """Ticks from a command to its force: dead time and half a tick.

        The integral of an amplifier leaves no lag of what is slower than the filter here.
        """
        dead = self.rig.settings.amplifier.delay_s / self.rig.dt
        return self.rig.settings.timing.delay_ticks + 0.5 + dead


def _read(rig: StageRig, path: PathLike) -> dict[str, FloatArray]:
    """Read the columns that are needed of a file, SI."""
    table = read_columns(path)
    probes = PROBES if rig.settings.hall_probe is not None else ()
    columns = {}
    for name in (*NEEDED, *probes):
        wanted = parse_header(name).quantity
        assert wanted is not None
        values = table.get(wanted.name)
        if values is None:
            continue
        held = table.headers[table.names.index(wanted.name)]
        if held.quantity is not None and held.quantity.unit != wanted.unit:
            raise InputError(
                f"{path}: column '{held.text}' is in {held.quantity.unit or 'no unit'}, and "
                f"{wanted.unit} is needed; name it {name}",
                code="unit-of-another-kind",
                key=held.text,
            )
        columns[name] = values
    return columns


def _motion(rig: StageRig, recording: Recording | PathLike) -> Motion:
    """Take what is needed of a recording: every tick of the rig, from rest on."""
    if isinstance(recording, Recording):
        where, columns = "recording", recording.columns
    else:
        where, columns = str(recording), _read(rig, recording)
    for name in NEEDED:
        if name not in columns:
            raise InputError(
                f"{where}: has no column {name}; record it, as anhyst simulate does",
                code="column-missing",
                key=name,
            )
        if not np.isfinite(columns[name]).all():
            raise InputError(
                f"{where}: {name} holds what is no number; leave out what comes before it",
                code="not-finite",
                key=name,
            )
    _check_ticks(rig, where, columns["t_s"])
    _check_rest(rig, where, columns)
    return Motion(rig, columns)


def _check_ticks(rig: StageRig, where: str, time: FloatArray) -> None:
    """Refuse a recording that is too short, of another rate, or not of every tick."""
    if time.size < LEAST:
        raise InputError(
            f"{where}: has {time.size} rows, and {LEAST} are the least; record a whole motion",
            code="too-short",
            key="t_s",
        )
    rate = (time.size - 1) / (time[-1] - time[0])
    steps = np.diff(time) / rig.dt
    if abs(rate * rig.dt - 1.0) > 1e-3 and abs(float(np.median(steps)) - 1.0) > 1e-3:
        raise InputError(
            f"{where}: has {rate:g} rows a second, {rig.path} {1.0 / rig.dt:g} ticks; record "
            "every tick",
            code="rate-differs",
            key="t_s",
        )
    if (off := np.flatnonzero(np.abs(steps - 1.0) > 0.5)).size:
        raise InputError(
            f"{where}: row {off[0] + 2} comes {steps[off[0]]:.3g} ticks after the one before; "
            "record every tick once",
            code="ticks-missing",
            key="t_s",
        )


def _check_rest(rig: StageRig, where: str, columns: Mapping[str, FloatArray]) -> None:
    """Refuse a recording that begins in motion: what the iron remembers of before is not known."""
    place = columns["position_read_m"]
    speed = np.abs(place[STILL:] - place[:-STILL]) / (STILL * rig.dt)
    noise = 10.0 * rig.settings.position_sensor.noise_m / (STILL * rig.dt)
    pushed = abs(columns["demand_N"][0]) > DEAD * rig.settings.tracking.force_max_N
    if pushed or speed[0] > 0.02 * float(speed.max()) + noise:
        raise InputError(
            f"{where}: begins in motion; begin at rest with demagnetised iron",
            code="begins-in-motion",
            key="demand_N" if pushed else "position_read_m",
        )


class MotionLaw:
    """A method as it is fitted to the loops, and with other numbers."""

    def __init__(self, rig: StageRig, magnet: IdentifiedMagnet, method: MethodName) -> None:
        self.rig, self.magnet, self.method = rig, magnet, method
        self.compensator = cache(lambda width: fit_method(rig, magnet, method, width))

    def stage(self, found: CalibratedMethod) -> StageSetup:
        """Return the stage whose controller is corrected by what was found."""
        compensator = self.compensator(found.value("width"))
        return StageSetup(self.rig, compensator, correction=found.correction(compensator, self.rig))

    def net(self, motion: Motion, values: Mapping[ParameterName, float]) -> FloatArray:
        """Return the net force along a path by the law with some numbers, filtered, N."""
        scales = np.array([[1.0 + values["scale_1"]], [1.0 + values["scale_2"]]])
        if self.method == "flux":
            forces, late = self._by_flux(motion, scales), -self._probe_late
        else:
            forces, late = self._by_currents(motion, scales, values), motion.late
        # the first magnet pulls towards smaller positions
        return motion.filtered(forces[1] - forces[0], late) + values["bias_N"]

    def _by_currents(
        self, motion: Motion, scales: FloatArray, values: Mapping[ParameterName, float]
    ) -> list[FloatArray]:
        read, rig = motion.read, self.rig
        compensator = self.compensator(round(values["width"] / WIDTHS) * WIDTHS)
        lead = values["lag_s"] / rig.dt * self._per_root
        flowed = scales * np.array([read[name] for name in COMMANDS]) - lead * motion.rises
        gap = np.interp(motion.ticks + motion.late, motion.ticks, read["gap_read_m"])
        return [
            compensator.fresh().follow(current, at)
            for current, at in zip(flowed, (gap, self._total - gap), strict=True)
        ]

    def _by_flux(self, motion: Motion, scales: FloatArray) -> list[FloatArray]:
        """Go back the way of the method's calibration: the force goes with the flux density squared.

        Its map has straight lines from force to force, which tells small ones too large.
        """
        found = self.compensator(0.0).parameters
        assert isinstance(found, FluxFeedback)
        of_root = found.wanted[:, -1] / math.sqrt(found.scales.demand)
        gaps = np.linspace(found.scales.gap_low, found.scales.gap_high, of_root.size)
        gap = motion.read["gap_read_m"]
        flux = scales * np.array([motion.read[name] for name in PROBES])
        return [
            (density / np.interp(at, gaps, of_root)) ** 2
            for density, at in zip(flux, (gap, self._total - gap), strict=True)
        ]

    @cached_property
    def _per_root(self) -> float:
        return per_root(self.compensator(0.0), self.rig)

    @property
    def _total(self) -> float:
        total = self.rig.settings.gap_total_m
        assert total is not None
        return total

    @property
    def _probe_late(self) -> float:
        probe = self.rig.settings.hall_probe
        assert probe is not None
        return 1.0 / (2.0 * math.pi * probe.bandwidth_Hz * self.rig.dt)


class _Fit:
    """A linear fit around the last one, a few times, of some parameters; the others stay at 0."""

    def __init__(
        self,
        law: MotionLaw,
        motions: Sequence[Motion],
        priors: Mapping[ParameterName, float],
        names: Sequence[ParameterName],
    ) -> None:
        self.law, self.motions, self.names = law, motions, names
        self.values: dict[ParameterName, float] = dict.fromkeys(PARAMETERS, 0.0)
        self.pushed = np.concatenate([one.pushed[one.compared] for one in motions])
        trust = TRUST * law.rig.settings.tracking.force_max_N
        held = np.array([priors[name] for name in names])
        far = np.minimum(MOST * held, [LIMITS[name] for name in names])
        slopes = np.zeros((self.pushed.size, len(names)))
        for turn in range(PASSES if len(names) and self.pushed.size else 0):
            slopes, expected = self._look(exact=turn == PASSES - 1)
            now = np.array([self.values[name] for name in names])
            normal = slopes.T @ slopes / trust**2 + np.diag(held**-2.0)
            pull = slopes.T @ (self.pushed - expected) / trust**2 - now / held**2
            now = np.clip(now + np.linalg.solve(normal, pull), -far, far)
            self.values |= dict(zip(names, now.tolist(), strict=True))
        self.values["width"] = round(self.values["width"] / WIDTHS) * WIDTHS
        self.residual = rms(self.pushed - self.forces({})) if self.pushed.size else 0.0
        normal = slopes.T @ slopes / max(trust, self.residual) ** 2 + np.diag(held**-2.0)
        left = np.sqrt(np.diag(np.linalg.inv(normal)))
        self.left: dict[ParameterName, float] = dict(zip(names, left.tolist(), strict=True))

    def forces(self, changed: Mapping[ParameterName, float]) -> FloatArray:
        """Return the force by the law with some numbers changed, where it is compared."""
        values = {**self.values, **changed}
        return np.concatenate([self.law.net(one, values)[one.compared] for one in self.motions])

    def _look(self, *, exact: bool) -> tuple[FloatArray, FloatArray]:
        """Return what each number does along the path, and the force with all of them.

        Paths are those of the law as it was fitted and of one with a wider loop, which are kept;
        exactly, the force is that of a law fitted anew.
        """
        flat = self.forces({"width": 0.0})
        slopes = np.zeros((flat.size, len(self.names)))
        for place, name in enumerate(self.names):
            step = STEPS[name]
            moved = {name: step if name == "width" else self.values[name] + step}
            slopes[:, place] = (self.forces({"width": 0.0, **moved}) - flat) / step
        if "width" not in self.names:
            return slopes, flat
        if exact:
            return slopes, self.forces({})
        return slopes, flat + self.values["width"] * slopes[:, self.names.index("width")]


def fit(law: MotionLaw, motions: Sequence[Motion]) -> CalibratedMethod:
    """Find the numbers with which a law explains motions best; what is not seen stays where it was."""
    priors = {name: prior(law.rig, law.method, name) for name in PARAMETERS}
    names = [name for name in MOVED[law.method] if priors[name] > 0.0]
    found = _Fit(law, motions, priors, names)
    seen = [name for name in names if found.left[name] <= SEEN * priors[name]]
    if seen != names:
        found = _Fit(law, motions, priors, seen)
    moved = rms(found.pushed) if found.pushed.size else 0.0
    noise = motions[0].noise
    if found.residual > math.hypot(FAULT * moved, noise):
        seen, found.values = [], dict.fromkeys(PARAMETERS, 0.0)
    return CalibratedMethod(
        name=law.method,
        residual_N=found.residual,
        force_N=moved,
        fits=moved > 0.0 and found.residual <= math.hypot(KIND * moved, noise),
        parameter=[
            LearntParameter(
                name=name,
                value=found.values[name],
                sigma=found.left[name] if name in seen else priors[name],
                prior=priors[name],
                frozen=name not in seen,
            )
            for name in PARAMETERS
            if name in MOVED[law.method] or name == "gap_zero_m"
        ],
    )


@dataclass(frozen=True, repr=False)
class Calibration(Result):
    """What motion taught of the magnets of a stage.

    Parameters
    ----------
    file : CalibrationFile
        Every method with what it is corrected by.
    """

    file: CalibrationFile

    @property
    def learnt(self) -> bool:
        """Whether anything was learnt of any method."""
        return any(one.taken for one in self.file.method)

    def facts(self) -> dict[str, str]:
        """Return what every method is corrected by and what is left, and the number trusted."""
        told = {"rig": self.file.rig, "trusted": f"mass of {self.file.mass_kg:g} kg"}
        for one in self.file.method:
            left = f"{one.residual_N:.2g} of {one.force_N:.3g} N not explained"
            if one.force_N == 0.0:
                left = "too little force was asked for"
            elif not one.fits:
                left += ": more than a law of the right kind leaves"
            told[one.name] = left if one.taken else f"{left}; nothing is taken"
        return told

    def to_columns(self) -> dict[str, Any]:
        """Return every number of every method with what is left of its uncertainty."""
        return columns_of(
            [
                {"method": one.name, **number.model_dump()}
                for one in self.file.method
                for number in one.parameter
            ]
        )

    def draw(self, ax: Axes) -> None:
        """Draw the numbers of every method in parts of their standard deviation before."""
        for one in self.file.method:
            learnt = [number for number in one.parameter if not number.frozen]
            ax.errorbar(
                [number.name for number in learnt],
                [number.value / number.prior for number in learnt],
                [number.sigma / number.prior for number in learnt],
                fmt="o",
                label=one.name,
            )
        ax.set_ylabel("learnt, of the standard deviation before")

    def save(self, path: PathLike) -> Path:
        """Write the file that a rig names as ``control.calibration``.

        Raises
        ------
        InputError
            The place cannot be written.
        """
        content = self.file.model_dump()
        lines = [
            HEAD,
            *(f"{key} = {toml_value(content[key])}" for key in content if key != "method"),
        ]
        for one in self.file.method:
            whole = one.model_dump()
            lines += ["", "[[method]]"]
            lines += [f"{key} = {toml_value(whole[key])}" for key in whole if key != "parameter"]
            lines.append("parameter = [")
            lines += [f"  {toml_value(number)}," for number in whole["parameter"]]
            lines.append("]")
        with atomic_writer(path) as stream:
            stream.write("\n".join(lines) + "\n")
        return Path(path)


def calibrate(
    rig: StageRig | PathLike,
    recordings: Recording | PathLike | Sequence[Recording | PathLike],
    out: PathLike | None = None,
    *,
    magnet: IdentifiedMagnet | None = None,
    methods: Sequence[MethodName] = (),
) -> Calibration:
    """Learn from recorded motions of a stage what its magnets are off by.

    Parameters
    ----------
    rig : StageRig or path-like
        The stage, or its rig file. Its mass is the scale of all forces, its ``[spread]`` says how
        far each number may be off.
    recordings : Recording, path-like, or a sequence of them
        Runs from the demagnetised iron, as ``anhyst simulate`` writes them: demanded force,
        position and gap as read, commanded currents of both magnets; flux densities for ``flux``.
    out : path-like, optional
        File to write, which the rig file names as ``control.calibration``; not written where
        nothing was learnt.
    magnet : IdentifiedMagnet, optional
        What is known of the magnets; identified from the loops of the rig file if left out.
    methods : sequence of str
        Which to calibrate; all that the recordings suffice for if left out.

    Returns
    -------
    Calibration

    Raises
    ------
    InputError
        A file cannot be read, or does not fit the rig.
    """
    stage = rig if isinstance(rig, StageRig) else read_stage(rig)
    file = stage.settings
    if file.several:
        raise InputError(
            f"{stage.path}: body.free: one coordinate alone is calibrated; name a stage of one",
            code="one-coordinate-only",
            key="body.free",
        )
    least = AMPLIFIER * FILTER_HZ
    if file.amplifier.bandwidth_Hz < least:
        raise InputError(
            f"{stage.path}: amplifier.bandwidth_Hz: is below {least:g} Hz, and its lag would be "
            "taken for the iron's; calibrate with a faster amplifier",
            code="amplifier-too-slow",
            key="amplifier.bandwidth_Hz",
        )
    alone = isinstance(recordings, Recording | str | Path)
    given: list[Recording | PathLike] = [recordings] if alone else list(recordings)  # type: ignore[arg-type,list-item]
    files = [Path(one) for one in given if not isinstance(one, Recording)]
    if not given or len({one.resolve() for one in files}) < len(files):
        raise InputError(
            "RUNS: name at least one recording, and each once; the same one teaches nothing new",
            code="recordings-not-once",
            key="RUNS",
        )
    if out is not None:
        check_writable(out, [stage.path, *stage.measured.files, *files])
    motions = [_motion(stage, one) for one in given]
    known = magnet or identify_stage(stage)
    left_out = set() if follows_rate(stage, known.model) else {"at-rest"}
    if not all(name in one.read for one in motions for name in PROBES):
        left_out.add("flux")
    possible = [name for name in MOVED if name not in left_out]
    for name in methods:
        if name not in possible:
            raise InputError(
                f"methods: '{name}' cannot be calibrated of this; name {', '.join(possible)}",
                code="no-such-method",
                key="methods",
            )
    chosen = methods or possible
    found = Calibration(
        CalibrationFile(
            format="anhyst-calibration",
            version=1,
            rig=file.name,
            mass_kg=file.body.mass_kg,
            method=[fit(MotionLaw(stage, known, name), motions) for name in chosen],
        )
    )
    if out is not None and found.learnt:
        found.save(out)
    return found
