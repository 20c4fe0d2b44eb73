"""Calibrate the magnets of a rig from recorded motion, and write the calibration file.

The module checks each recording, computes its motion, and estimates the parameters of each method.
The result contains the values with their uncertainty. It is written only if a method was accepted.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np

from anhyst.control.controller_file import ControllerFile
from anhyst.data.headers import ignore_quantity_word
from anhyst.data.table import read_columns
from anhyst.support.atomic import PathLike, atomic_writer, check_path, check_writable
from anhyst.support.errors import InputError, NegativeResult, wrong_type
from anhyst.support.kinds import MethodName, require_capability
from anhyst.support.numeric import FloatArray
from anhyst.support.result import Result, rows_to_columns
from anhyst.support.toml_file import require_rig
from anhyst.support.toml_text import toml_value
from anhyst.support.units import parse_header
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.calibration import CalibratedMethod, CalibrationFile
from anhyst_rigs.rig.drift import remove_calibration
from anhyst_rigs.rig.fitting import IdentifiedMagnet
from anhyst_rigs.rig.recording import Recording
from anhyst_rigs.rig.stage.fitted import identify_stage_magnet
from anhyst_rigs.study.bearing.inputs import check_inputs, read_bearing_controller
from anhyst_rigs.study.tracking.bodies import CALIBRATABLE_METHODS, BearingLaw, StageLaw
from anhyst_rigs.study.tracking.estimator import calibrate_from_motions
from anhyst_rigs.study.tracking.motion import Motion, MotionLaw, refuse_slow_amplifier

if TYPE_CHECKING:
    from matplotlib.axes import Axes

MIN_ROWS = 100
"""Smallest number of rows in a recording."""
MAX_READING = 1e30
"""Largest absolute value of a valid reading, SI units."""
MIN_PAYLOAD_FRACTION = 0.4
"""Smallest mean scale of a method, relative to that of a reported payload, for which it is rejected.
Other parameters, such as the width, contain the rest of the payload."""
FILE_HEADER = """\
# Calibration of the magnets of a rig from motion, written by anhyst calibrate. A rig file names it
# as control.calibration. Values are ratios or have units in their names; the mass scales forces."""


def _read_columns(law: MotionLaw, path: PathLike) -> dict[str, FloatArray]:
    """Read the required and the optional columns of a file, SI units."""
    table = read_columns(path, has_own_names=True)
    columns = {}
    for name in (*law.required_columns, *law.optional_columns):
        quantity = ignore_quantity_word(parse_header(name)).quantity
        assert quantity is not None
        values = table.get(quantity.name)
        if values is None:
            continue
        column_title = table.headers[table.names.index(quantity.name)]
        if column_title.quantity is not None and column_title.quantity.unit != quantity.unit:
            raise InputError(
                f"{path}: column '{column_title.text}' is in {column_title.quantity.unit or 'no unit'}, but "
                f"{quantity.unit} is needed; record {name}",
                code="unit-of-another-kind",
                key=column_title.text,
            )
        columns[name] = values
    return columns


def _make_motion(law: MotionLaw, recording: Recording | PathLike) -> Motion:
    """Check a recording, and return its motion; it must contain every tick, beginning at rest."""
    if isinstance(recording, Recording):
        source, columns = "recording", recording.columns
    else:
        source, columns = str(recording), _read_columns(law, recording)
    for name in law.required_columns:
        if name not in columns:
            text = f"{source}: has no column {name}; record it, as anhyst simulate does"
            raise InputError(text, code="column-missing", key=name)
    for name in (*law.required_columns, *law.optional_columns):
        if not (np.abs(columns.get(name, 0.0)) < MAX_READING).all():
            text = f"{source}: {name} contains invalid values; begin the recording after them"
            raise InputError(text, code="not-finite", key=name)
    _check_ticks(law.rig, source, columns["t_s"])
    if start_fault := law.find_motion_at_start(columns):
        text = f"{source}: {start_fault.text}; begin at rest with demagnetised iron"
        raise InputError(text, code="begins-in-motion", key=start_fault.column)
    motion = law.make_motion(columns)
    if sign_fault := law.find_wrong_sign(motion):
        raise InputError(f"{source}: {sign_fault.text}", code="wrong-sign", key=sign_fault.column)
    if exchanged := law.find_exchanged_magnets(motion):
        text = f"{source}: the columns of the magnets {exchanged[0]} and {exchanged[1]} are exchanged"
        raise NegativeResult(f"{text}; correct the recording", code="magnets-exchanged")
    return motion


def _check_ticks(rig: BodyRig, source: str, time: FloatArray) -> None:
    """Raise an error if a recording is too short, has another rate, or lacks ticks."""
    if time.size < MIN_ROWS:
        text = f"{source}: has {time.size} rows, but at least {MIN_ROWS} are needed; record a whole motion"
        raise InputError(text, code="too-short", key="t_s")
    duration_s = float(time[-1] - time[0])
    rate = (time.size - 1) / duration_s if duration_s else math.inf
    steps = np.diff(time) / rig.dt
    if abs(rate * rig.dt - 1.0) > 1e-3 and abs(float(np.median(steps)) - 1.0) > 1e-3:
        text = f"{source}: has {rate:g} rows a second, but {rig.path} has {1.0 / rig.dt:g} ticks"
        raise InputError(f"{text}; record every tick", code="rate-differs", key="t_s")
    if (irregular_rows := np.flatnonzero(np.abs(steps - 1.0) > 0.5)).size:
        row_index = irregular_rows[0]
        text = f"{source}: row {row_index + 2} is {steps[row_index]:.3g} ticks after the previous row"
        raise InputError(f"{text}; record every tick once", code="ticks-missing", key="t_s")


@dataclass(frozen=True, repr=False)
class Calibration(Result):
    """The calibration of the magnets of a stage or a bearing from motion.

    Parameters
    ----------
    file : CalibrationFile
        Corrections of every method.
    """

    file: CalibrationFile

    @property
    def has_estimates(self) -> bool:
        """Whether at least one method was accepted."""
        return any(method.is_applied for method in self.file.method)

    def facts(self) -> dict[str, str]:
        """Return the corrections and the residual of every method, and the mass that was used."""
        facts = {"rig": self.file.rig, "trusted": f"mass of {self.file.mass_kg:g} kg"}
        facts |= {method.name: method.summary for method in self.file.method}
        advice = self.file.mass_advice
        return facts if advice is None else facts | {"payload": advice}

    def to_columns(self) -> dict[str, Any]:
        """Return every parameter of every method with its posterior standard deviation."""
        return rows_to_columns(
            [
                {"method": method.name, **parameter.model_dump()}
                for method in self.file.method
                for parameter in method.parameter
            ]
        )

    def draw(self, ax: Axes) -> None:
        """Draw the parameters of every method, relative to their prior standard deviations."""
        for method in self.file.method:
            estimated = [parameter for parameter in method.parameter if not parameter.frozen]
            ax.errorbar(
                [parameter.name for parameter in estimated],
                [parameter.value / parameter.prior for parameter in estimated],
                [parameter.sigma / parameter.prior for parameter in estimated],
                fmt="o",
                label=method.name,
            )
        ax.set_ylabel("estimate over prior standard deviation")

    def save(self, path: PathLike) -> Path:
        """Write the file that a rig names as ``control.calibration``.

        Raises
        ------
        InputError
            The file cannot be written.
        """
        content = self.file.model_dump()
        lines = [FILE_HEADER]
        lines += [f"{key} = {toml_value(content[key])}" for key in content if key != "method"]
        for method in self.file.method:
            table = method.model_dump(exclude_none=True)
            lines += ["", "[[method]]"]
            lines += [f"{key} = {toml_value(table[key])}" for key in table if key != "parameter"]
            lines.append("parameter = [")
            lines += [f"  {toml_value(parameter)}," for parameter in table["parameter"]]
            lines.append("]")
        with atomic_writer(path) as stream:
            stream.write("\n".join(lines) + "\n")
        return Path(path)


LawFactory = Callable[..., MotionLaw]
"""Function that makes the :class:`MotionLaw` of a method; for bearings, also with
``is_load_recorded``."""


class HasCalibration(Protocol):
    """A kind of rig whose magnets can be calibrated from motion."""

    def read(self, rig: PathLike) -> BodyRig:
        """Read a rig file."""

    def motion_laws(
        self, rig: BodyRig, controller: ControllerFile | PathLike | None, magnet: IdentifiedMagnet | None
    ) -> tuple[LawFactory, IdentifiedMagnet]:
        """Return a function that makes motion laws, and the identified magnet."""


def stage_laws(
    rig: BodyRig, controller: ControllerFile | PathLike | None, magnet: IdentifiedMagnet | None
) -> tuple[LawFactory, IdentifiedMagnet]:
    """Return a function that makes the motion laws of a stage, and its identified magnet."""
    assert controller is None
    refuse_slow_amplifier(rig)
    identified_magnet = magnet or identify_stage_magnet(rig)
    return partial(StageLaw, rig, identified_magnet), identified_magnet


def bearing_laws(
    rig: BodyRig, controller: ControllerFile | PathLike | None, magnet: IdentifiedMagnet | None
) -> tuple[LawFactory, IdentifiedMagnet]:
    """Return a function that makes the motion laws of a bearing, and its identified magnet."""
    if not isinstance(controller, ControllerFile):
        controller = read_bearing_controller(rig, controller)
    ready = check_inputs(remove_calibration(rig), controller)
    identified_magnet = magnet or ready.identify_magnet()
    return partial(BearingLaw, ready.rig, controller.settings, identified_magnet), identified_magnet


def _withdraw_payload(methods: Sequence[CalibratedMethod], mass_kg: float) -> list[CalibratedMethod]:
    """Reject methods whose scales contain a large part of a payload that another method reports."""
    masses = [method.mass_kg for method in methods if method.mass_kg is not None]
    if not masses:
        return list(methods)
    payload_scale = -0.5 * (masses[-1] / mass_kg - 1.0)  # the force is proportional to current squared
    reason = f"its scales follow the mass of {masses[-1]:.4g} kg that another method reports"

    def has_payload(method: CalibratedMethod) -> bool:
        return bool(np.mean(method.scale_values or [0.0]) / payload_scale >= MIN_PAYLOAD_FRACTION)

    changes = {"fits": False, "reason": reason}
    return [m.model_copy(update=changes) if m.is_applied and has_payload(m) else m for m in methods]


def calibrate(
    rig: BodyRig | PathLike,
    recordings: Recording | PathLike | Sequence[Recording | PathLike],
    out: PathLike | None = None,
    *,
    magnet: IdentifiedMagnet | None = None,
    methods: Sequence[MethodName] = (),
    controller: ControllerFile | PathLike | None = None,
) -> Calibration:
    """Estimate the errors of the magnets from recorded motions: `anhyst.calibrate`.

    The recordings begin with demagnetised iron, as those that ``anhyst simulate`` writes. The file
    is not written if no method was accepted.
    """
    if not isinstance(rig, BodyRig):
        check_path(rig, "calibrate: rig", "the path of a rig file")
    kind = rig.settings.kind if isinstance(rig, BodyRig) else require_rig(rig, "calibrate")
    calibrates = require_capability(kind, HasCalibration)
    body_rig = rig if isinstance(rig, BodyRig) else calibrates.read(rig)
    is_single = isinstance(recordings, Recording | str | Path)
    if not is_single and not isinstance(recordings, Sequence):
        raise wrong_type("calibrate: recordings", "recordings or their paths", recordings)
    sources: list[Recording | PathLike] = [recordings] if is_single else list(recordings)  # type: ignore[arg-type,list-item]
    for source in sources:
        if not isinstance(source, Recording):
            check_path(source, "calibrate: recordings", "recordings or their paths")
    files = [Path(source) for source in sources if not isinstance(source, Recording)]
    if out is not None:
        check_writable(out, [body_rig.path, *body_rig.measured_loops.files, *files])
    kind.refuse_options("calibrate", {"--controller": controller})
    make_law, identified_magnet = calibrates.motion_laws(body_rig, controller, magnet)
    motions = [_make_motion(make_law("full"), source) for source in sources]
    if not sources or len({motion.columns["command_A"].tobytes() for motion in motions}) < len(sources):
        raise InputError(
            "RUNS: give at least one recording, and each only once", code="recordings-not-once", key="RUNS"
        )
    settings, full_law = body_rig.settings, make_law("full")
    excluded_methods = set(full_law.uncalibratable_methods(motions))
    if not identified_magnet.model.has_layers:
        excluded_methods.add("at-rest")
    make_law = partial(make_law, **full_law.law_options(motions))
    possible_methods = [name for name in CALIBRATABLE_METHODS if name not in excluded_methods]
    for name in methods:
        if name not in possible_methods:
            text = f"methods: '{name}' cannot be calibrated with these recordings; choose from "
            text += ", ".join(possible_methods)
            raise InputError(text, code="no-such-method", key="methods")
    file_content = CalibrationFile(
        format="anhyst-calibration",
        version=1,
        rig=settings.name,
        mass_kg=settings.body.mass_kg,
        method=_withdraw_payload(
            [calibrate_from_motions(make_law(name), motions) for name in methods or possible_methods],
            settings.body.mass_kg,
        ),
    )
    calibration = Calibration(file_content)
    if out is not None and calibration.has_estimates:
        calibration.save(out)
    return calibration
