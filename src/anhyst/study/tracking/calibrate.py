"""Calibration from recorded motion: what a recording must hold, and what was found."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from anhyst.control.controller_file import ControllerFile, read_controller
from anhyst.data.headers import without_word
from anhyst.data.table import read_columns
from anhyst.model.actuator import has_layers
from anhyst.rig.body import BodyRig, read_bearing
from anhyst.rig.calibration import CalibrationFile
from anhyst.rig.drift import untaught
from anhyst.rig.fitting import IdentifiedMagnet
from anhyst.rig.recording import CURRENTS, Recording, of_magnets
from anhyst.rig.stage.file import read_stage
from anhyst.rig.stage.loop import (
    COMMANDS,
    READ,
    demand_columns,
    identify_stage,
    pose_columns,
)
from anhyst.study.bearing.operating import make_ready
from anhyst.study.tracking.bodies import BearingLaw, law_of
from anhyst.study.tracking.learner import fit
from anhyst.study.tracking.motion import DEAD, MOVED, Motion, MotionLaw, refuse_uncalibratable
from anhyst.support.atomic import PathLike, atomic_writer, check_path, check_writable
from anhyst.support.errors import InputError, wrong_type
from anhyst.support.kinds import PROBED, FileKind, MethodName, kind_of
from anhyst.support.numeric import FloatArray
from anhyst.support.result import Result, columns_of
from anhyst.support.toml_text import toml_value
from anhyst.support.units import parse_header

if TYPE_CHECKING:
    from matplotlib.axes import Axes

BEARING = ("t_s", "reference_m", "gap_read_m")
"""What is read of a bearing, beside the commands of its magnets and the state of its controller."""
LEAST = 100
"""Rows of a recording."""
NUMBER = 1e30
"""What is larger, in SI units, is no reading."""
STILL = 20
"""Ticks over which a speed is taken, to see whether a recording begins at rest."""
HEAD = """\
# What motion taught of the magnets of a rig. Written by anhyst calibrate; a rig file names it as
# control.calibration. Values are parts, or carry their unit; the scale of force is the mass."""


def needed(rig: BodyRig) -> list[str]:
    """Return the columns without which nothing is learnt."""
    file = rig.settings
    if file.kind is FileKind.BEARING:
        return [*BEARING, *of_magnets(CURRENTS[:1], 1, len(file.magnets)), "state"]
    if not file.several:
        return ["t_s", "demand_N", *READ, *COMMANDS]
    free, read = file.body.free, [("gap_read", "m"), *CURRENTS[:1]]
    of_body = [*demand_columns(free), *pose_columns(free)]
    return ["t_s", "demand_N", *of_body, *of_magnets(read, 1, len(file.placed))]


def _beside(rig: BodyRig) -> tuple[str, ...]:
    """Return the columns that help: of flux probes, where there are some; of a bearing its load.

    The live page writes the phase of a controller beside its state.
    """
    if rig.settings.kind is FileKind.BEARING:
        return ("load_N", "phase")
    has = rig.settings.hall_probe is not None
    return of_magnets([("flux_read", "T")], 1, len(rig.settings.placed)) if has else ()


def _read(rig: BodyRig, path: PathLike) -> dict[str, FloatArray]:
    """Read the columns that are needed of a file, SI."""
    table = read_columns(path, has_own_names=True)
    columns = {}
    for name in (*needed(rig), *_beside(rig)):
        wanted = without_word(parse_header(name)).quantity
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


def _motion(law: MotionLaw, recording: Recording | PathLike) -> Motion:
    """Take what is needed of a recording: every tick of the rig, from rest on."""
    rig = law.rig
    if isinstance(recording, Recording):
        where, columns = "recording", recording.columns
    else:
        where, columns = str(recording), _read(rig, recording)
    for name in needed(rig):
        if name not in columns:
            raise InputError(
                f"{where}: has no column {name}; record it, as anhyst simulate does",
                code="column-missing",
                key=name,
            )
    for name in (*needed(rig), *_beside(rig)):
        if not (np.abs(columns.get(name, 0.0)) < NUMBER).all():
            raise InputError(
                f"{where}: {name} holds what is no number; leave out what comes before it",
                code="not-finite",
                key=name,
            )
    _check_ticks(rig, where, columns["t_s"])
    _check_rest(rig, where, columns)
    motion = law.motion(columns)
    if rig.settings.kind is FileKind.STAGE:
        _check_sign(rig, where, motion)
    return motion


def _check_sign(rig: BodyRig, where: str, motion: Motion) -> None:
    """Refuse a demand that counts the other way than the body goes."""
    if float(motion.pushed[motion.compared] @ motion.asked[motion.compared]) < 0.0:
        why = (
            "demand_N and the body go the same way: it is positive where the first magnet pulls, "
            "towards smaller positions; turn its sign"
        )
        if rig.settings.several:
            why = "the body goes against demand_x_N and its likes; turn their sign"
        raise InputError(
            f"{where}: {why}",
            code="wrong-sign",
            key="demand_N",
        )


def _check_ticks(rig: BodyRig, where: str, time: FloatArray) -> None:
    """Refuse a recording that is too short, of another rate, or not of every tick."""
    if time.size < LEAST:
        raise InputError(
            f"{where}: has {time.size} rows, and {LEAST} are the least; record a whole motion",
            code="too-short",
            key="t_s",
        )
    lasted = float(time[-1] - time[0])
    rate = (time.size - 1) / lasted if lasted else math.inf
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


def _check_rest(rig: BodyRig, where: str, columns: Mapping[str, FloatArray]) -> None:
    """Refuse a recording that begins in motion: what the iron remembers of before is not known."""
    if rig.settings.kind is FileKind.BEARING:
        if columns["command_A"][0] > 0.0:
            raise InputError(
                f"{where}: begins while a current flows; begin at rest with demagnetised iron",
                code="begins-in-motion",
                key="command_A",
            )
        return
    free = rig.settings.body.free if rig.settings.several else []
    read = [name for name in pose_columns(free) if name.endswith("_m")] or ["position_read_m"]
    place = np.column_stack([columns[name] for name in read])
    speed = np.linalg.norm(place[STILL:] - place[:-STILL], axis=1) / (STILL * rig.dt)
    noise = 10.0 * rig.settings.position_sensor.noise_m / (STILL * rig.dt)
    pushed = abs(columns["demand_N"][0]) > DEAD * rig.settings.tracking.force_max_N
    if pushed or speed[0] > 0.02 * float(speed.max()) + noise:
        raise InputError(
            f"{where}: begins in motion; begin at rest with demagnetised iron",
            code="begins-in-motion",
            key="demand_N" if pushed else read[0],
        )


@dataclass(frozen=True, repr=False)
class Calibration(Result):
    """What motion taught of the magnets of a stage or a bearing.

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
        facts = {"rig": self.file.rig, "trusted": f"mass of {self.file.mass_kg:g} kg"}
        for one in self.file.method:
            facts[one.name] = one.judgement
        return facts

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
            whole = one.model_dump(exclude_none=True)
            lines += ["", "[[method]]"]
            lines += [f"{key} = {toml_value(whole[key])}" for key in whole if key != "parameter"]
            lines.append("parameter = [")
            lines += [f"  {toml_value(number)}," for number in whole["parameter"]]
            lines.append("]")
        with atomic_writer(path) as stream:
            stream.write("\n".join(lines) + "\n")
        return Path(path)


def _read_rig(path: PathLike) -> BodyRig:
    return read_bearing(path) if kind_of(path) is FileKind.BEARING else read_stage(path)


def _laws(
    rig: BodyRig,
    controller: ControllerFile | PathLike | None,
    magnet: IdentifiedMagnet | None,
) -> tuple[Callable[..., MotionLaw], IdentifiedMagnet]:
    """Return what makes the law of a method, and what is known of the magnets of a rig."""
    if rig.settings.kind is FileKind.STAGE:
        if controller is not None:
            raise InputError(
                "controller: a stage has no controller file", code="option-not-for-this"
            )
        refuse_uncalibratable(rig)
        known = magnet or identify_stage(rig)
        return partial(law_of, rig, known), known
    if not isinstance(controller, ControllerFile):
        controller = read_controller(controller or rig.path.parent / "controller.toml")
    ready = make_ready(untaught(rig), controller)
    known = magnet or ready.knowledge()
    return partial(BearingLaw, ready.rig, controller.settings, known), known


def calibrate(
    rig: BodyRig | PathLike,
    recordings: Recording | PathLike | Sequence[Recording | PathLike],
    out: PathLike | None = None,
    *,
    magnet: IdentifiedMagnet | None = None,
    methods: Sequence[MethodName] = (),
    controller: ControllerFile | PathLike | None = None,
) -> Calibration:
    """Learn from recorded motions what magnets are off by: `anhyst.calibrate`.

    The recordings are runs from the demagnetised iron, as ``anhyst simulate`` writes them. The file
    is not written if nothing was learnt.
    """
    if not isinstance(rig, BodyRig):
        check_path(rig, "calibrate: rig", "the path of a rig file")
    whole = rig if isinstance(rig, BodyRig) else _read_rig(rig)
    alone = isinstance(recordings, Recording | str | Path)
    if not alone and not isinstance(recordings, Sequence):
        raise wrong_type("calibrate: recordings", "recordings or their paths", recordings)
    given: list[Recording | PathLike] = [recordings] if alone else list(recordings)  # type: ignore[arg-type,list-item]
    for one in given:
        if not isinstance(one, Recording):
            check_path(one, "calibrate: recordings", "recordings or their paths")
    files = [Path(one) for one in given if not isinstance(one, Recording)]
    if out is not None:
        check_writable(out, [whole.path, *whole.measured.files, *files])
    laws, known = _laws(whole, controller, magnet)
    motions = [_motion(laws("full"), one) for one in given]
    if not given or len({one.read["command_A"].tobytes() for one in motions}) < len(given):
        raise InputError(
            "RUNS: name at least one recording, and each once; the same one teaches nothing new",
            code="recordings-not-once",
            key="RUNS",
        )
    file, probes = whole.settings, _beside(laws("full").rig)
    left_out: set[MethodName] = set() if has_layers(known.model) else {"at-rest"}
    if whole.settings.kind is FileKind.BEARING:
        laws = partial(laws, load_known=all("load_N" in one.read for one in motions))
        left_out.update(PROBED)
    elif not probes or not all(name in one.read for one in motions for name in probes):
        left_out.update(PROBED)
    possible = [name for name in MOVED if name not in left_out]
    for name in methods:
        if name not in possible:
            raise InputError(
                f"methods: '{name}' cannot be calibrated of this; name {', '.join(possible)}",
                code="no-such-method",
                key="methods",
            )
    chosen = methods or possible
    calibration = Calibration(
        CalibrationFile(
            format="anhyst-calibration",
            version=1,
            rig=file.name,
            mass_kg=file.body.mass_kg,
            method=[fit(laws(name), motions) for name in chosen],
        )
    )
    if out is not None and calibration.learnt:
        calibration.save(out)
    return calibration
