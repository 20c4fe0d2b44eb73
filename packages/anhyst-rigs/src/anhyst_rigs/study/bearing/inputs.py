"""Read and check the files that a rig file and a controller file of a bearing name."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from anhyst.control.controller_file import ControllerFile, read_controller
from anhyst.data import Loops
from anhyst.data.output_map import is_electromagnet
from anhyst.model.actuator import Model, read_model
from anhyst.support.atomic import PathLike, check_writable
from anhyst.support.errors import InputError
from anhyst.support.kinds import MethodName
from anhyst_rigs.rig.bearing.checks import check_controller
from anhyst_rigs.rig.body import BodyRig, read_bearing
from anhyst_rigs.rig.fitting import IdentifiedMagnet, identify_magnet
from anhyst_rigs.rig.from_loops import complete_rig
from anhyst_rigs.study.bearing.operating import OperatingPoint, find_operating_point


def read_files(rig_path: PathLike, controller_path: PathLike | None) -> tuple[BodyRig, ControllerFile]:
    """Read a rig file and a controller file; the default is controller.toml next to the rig file."""
    rig = read_bearing(rig_path)
    return rig, read_bearing_controller(rig, controller_path)


def read_bearing_controller(rig: BodyRig, path: PathLike | None) -> ControllerFile:
    """Read the controller file of a bearing; the default file is next to the rig file."""
    return read_controller(rig.path.parent / "controller.toml" if path is None else path)


def list_bearing_files(rig_path: PathLike, controller_path: PathLike | None) -> list[Path]:
    """Return the rig file, the controller file, and all files that they name."""
    return _named_files(*read_files(rig_path, controller_path))


def _named_files(rig: BodyRig, controller: ControllerFile) -> list[Path]:
    loop_files, rig_files = (
        rig.measured_loops,
        [rig.path, rig.model_path, rig.flux_table_path, rig.calibration_path],
    )
    paths = [*rig_files, controller.path, controller.model]
    return [file for file in paths if file is not None] + list(loop_files.files)


@dataclass(frozen=True)
class BearingInputs:
    """A rig, its controller and its measured loops, which are consistent with each other."""

    rig: BodyRig  # rig with a complete magnet
    controller: ControllerFile
    loops: Loops
    model: Model | None  # model that the controller file names
    operating_point: OperatingPoint

    def identify_magnet(self) -> IdentifiedMagnet:
        """Return the loops with the model of the controller file, or with a model identified now."""
        if self.model is not None:
            return IdentifiedMagnet(self.loops, self.model)
        return identify_magnet(self.loops, self.rig.settings.loops)


def check_inputs(rig: BodyRig, controller: ControllerFile, outputs: Sequence[PathLike] = ()) -> BearingInputs:
    """Read and check all files of a rig and its controller before the computation begins."""
    input_files = _named_files(rig, controller)
    for path in outputs:
        check_writable(path, input_files=input_files)
    operating_point = None if rig.settings.magnet.has_iron_from_loops else find_operating_point(rig)
    check_controller(controller, rig)
    check_calibration_covers(rig, controller.settings.compensation.variant, rig.calibration_path)
    model = _controller_model(controller, rig)
    loops = rig.measured_loops.read()
    gaps = list(loops.by_schedule())
    operating_gap = rig.settings.gap_m
    if not min(gaps) < operating_gap < max(gaps):
        raise InputError(
            f"{rig.measured_loops.description}: loops at gaps of {min(gaps):g} to {max(gaps):g} m, {rig.path} "
            f"works at {operating_gap:g} m; measure loops around it",
            code="gaps-not-covered",
        )
    completed_rig = complete_rig(rig, loops)
    return BearingInputs(
        completed_rig, controller, loops, model, operating_point or find_operating_point(completed_rig)
    )


def check_calibration_covers(rig: BodyRig, method: MethodName, shown_path: Path | str | None) -> None:
    """Raise an error if a calibration lacks the method; `shown_path` is for the message."""
    if rig.calibration_path is not None and rig.method_calibration(method) is None:
        raise InputError(
            f"{rig.path}: control.calibration: {shown_path} does not contain '{method}', so only other "
            "methods would be calibrated; calibrate again with all methods",
            code="method-missing",
            key="control.calibration",
        )


def _controller_model(controller: ControllerFile, rig: BodyRig) -> Model | None:
    if controller.model is None:
        return None
    model = read_model(controller.model)
    if not is_electromagnet(model) or not model.needs_schedule:
        text = f"{controller.model}: a bearing needs a model of force over current and gap; identify"
        raise InputError(f"{text} one from {rig.measured_loops.description}", code="not-current-to-force")
    return model
