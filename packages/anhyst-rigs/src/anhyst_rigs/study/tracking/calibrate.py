"""Calibration from recorded motion: what a recording must hold, and what was found."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from anhyst.control.controller_file import ControllerFile
from anhyst.data.headers import without_word
from anhyst.data.table import read_columns
from anhyst.support.atomic import PathLike, atomic_writer, check_path, check_writable
from anhyst.support.errors import InputError, wrong_type
from anhyst.support.kinds import MethodName, capability
from anhyst.support.numeric import FloatArray
from anhyst.support.result import Result, columns_of
from anhyst.support.toml_file import take_rig
from anhyst.support.toml_text import toml_value
from anhyst.support.units import parse_header
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.calibration import CalibrationFile
from anhyst_rigs.rig.drift import untaught
from anhyst_rigs.rig.fitting import IdentifiedMagnet
from anhyst_rigs.rig.recording import Recording
from anhyst_rigs.rig.stage.fitted import identify_stage
from anhyst_rigs.study.bearing.ready import controller_of, make_ready
from anhyst_rigs.study.tracking.bodies import LEARNT, BearingLaw, StageLaw
from anhyst_rigs.study.tracking.learner import fit
from anhyst_rigs.study.tracking.motion import Motion, MotionLaw, refuse_uncalibratable

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LEAST = 100
"""Rows of a recording."""
NUMBER = 1e30
"""What is larger, in SI units, is no reading."""
HEAD = """\
# What motion taught of the magnets of a rig. Written by anhyst calibrate; a rig file names it as
# control.calibration. Values are parts, or carry their unit; the scale of force is the mass."""


def _read(law: MotionLaw, path: PathLike) -> dict[str, FloatArray]:
    """Read the columns that are needed of a file, SI."""
    table = read_columns(path, has_own_names=True)
    columns = {}
    for name in (*law.needed, *law.helpful):
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
    if isinstance(recording, Recording):
        where, columns = "recording", recording.columns
    else:
        where, columns = str(recording), _read(law, recording)
    for name in law.needed:
        if name not in columns:
            text = f"{where}: has no column {name}; record it, as anhyst simulate does"
            raise InputError(text, code="column-missing", key=name)
    for name in (*law.needed, *law.helpful):
        if not (np.abs(columns.get(name, 0.0)) < NUMBER).all():
            text = f"{where}: {name} holds what is no number; leave out what comes before it"
            raise InputError(text, code="not-finite", key=name)
    _check_ticks(law.rig, where, columns["t_s"])
    if moving := law.begins_in_motion(columns):
        text = f"{where}: {moving.text}; begin at rest with demagnetised iron"
        raise InputError(text, code="begins-in-motion", key=moving.column)
    motion = law.motion(columns)
    if wrong := law.wrong_sign(motion):
        raise InputError(f"{where}: {wrong.text}", code="wrong-sign", key=wrong.column)
    return motion


def _check_ticks(rig: BodyRig, where: str, time: FloatArray) -> None:
    """Refuse a recording that is too short, of another rate, or not of every tick."""
    if time.size < LEAST:
        text = f"{where}: has {time.size} rows, and {LEAST} are the least; record a whole motion"
        raise InputError(text, code="too-short", key="t_s")
    lasted = float(time[-1] - time[0])
    rate = (time.size - 1) / lasted if lasted else math.inf
    steps = np.diff(time) / rig.dt
    if abs(rate * rig.dt - 1.0) > 1e-3 and abs(float(np.median(steps)) - 1.0) > 1e-3:
        text = f"{where}: has {rate:g} rows a second, {rig.path} {1.0 / rig.dt:g} ticks; record"
        raise InputError(f"{text} every tick", code="rate-differs", key="t_s")
    if (off := np.flatnonzero(np.abs(steps - 1.0) > 0.5)).size:
        text = f"{where}: row {off[0] + 2} comes {steps[off[0]]:.3g} ticks after the one before"
        raise InputError(f"{text}; record every tick once", code="ticks-missing", key="t_s")


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
        return facts | {one.name: one.judgement for one in self.file.method}

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
        lines = [HEAD]
        lines += [f"{key} = {toml_value(content[key])}" for key in content if key != "method"]
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


Laws = Callable[..., MotionLaw]
"""What makes the law of a method, and of a bearing may take ``load_known``."""


class HasCalibration(Protocol):
    """A kind of rig whose motion teaches what its magnets are off by."""

    def read(self, rig: PathLike) -> BodyRig:
        """Read a rig file."""

    def motion_laws(
        self,
        rig: BodyRig,
        controller: ControllerFile | PathLike | None,
        magnet: IdentifiedMagnet | None,
    ) -> tuple[Laws, IdentifiedMagnet]:
        """Return what makes the law of a method, and what is known of the magnets."""


def stage_laws(
    rig: BodyRig,
    controller: ControllerFile | PathLike | None,
    magnet: IdentifiedMagnet | None,
) -> tuple[Laws, IdentifiedMagnet]:
    """Return what makes the law of a method of a stage, and what is known of its magnets."""
    assert controller is None
    refuse_uncalibratable(rig)
    known = magnet or identify_stage(rig)
    return partial(StageLaw, rig, known), known


def bearing_laws(
    rig: BodyRig,
    controller: ControllerFile | PathLike | None,
    magnet: IdentifiedMagnet | None,
) -> tuple[Laws, IdentifiedMagnet]:
    """Return the same of a bearing."""
    if not isinstance(controller, ControllerFile):
        controller = controller_of(rig, controller)
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
    kind = rig.settings.kind if isinstance(rig, BodyRig) else take_rig(rig, "calibrate")
    calibrates = capability(kind, HasCalibration)
    whole = rig if isinstance(rig, BodyRig) else calibrates.read(rig)
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
    kind.refuse_options("calibrate", {"--controller": controller})
    laws, known = calibrates.motion_laws(whole, controller, magnet)
    motions = [_motion(laws("full"), one) for one in given]
    if not given or len({one.read["command_A"].tobytes() for one in motions}) < len(given):
        raise InputError(
            "RUNS: name at least one recording, and each once; the same one teaches nothing new",
            code="recordings-not-once",
            key="RUNS",
        )
    file, law = whole.settings, laws("full")
    left_out = set(law.left_out(motions))
    if not known.model.has_layers:
        left_out.add("at-rest")
    laws = partial(laws, **law.known_from(motions))
    possible = [name for name in LEARNT if name not in left_out]
    for name in methods:
        if name not in possible:
            text = f"methods: '{name}' cannot be calibrated of this; name {', '.join(possible)}"
            raise InputError(text, code="no-such-method", key="methods")
    found = CalibrationFile(
        format="anhyst-calibration",
        version=1,
        rig=file.name,
        mass_kg=file.body.mass_kg,
        method=[fit(laws(name), motions) for name in methods or possible],
    )
    calibration = Calibration(found)
    if out is not None and calibration.learnt:
        calibration.save(out)
    return calibration
