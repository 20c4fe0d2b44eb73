"""The command ``calibrate``: estimate the errors of magnets from the motion that they cause."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from anhyst.cli.shared import OutputPart
    from anhyst.control.controller_file import ControllerFile
    from anhyst.support.atomic import PathLike
    from anhyst.support.kinds import MethodName
    from anhyst_rigs.rig.body import BodyRig
    from anhyst_rigs.rig.fitting import IdentifiedMagnet
    from anhyst_rigs.rig.recording import Recording
    from anhyst_rigs.study.tracking.calibrate import Calibration

PLACE = 34, "Rigs, simulated and real"


def calibrate(
    rig: BodyRig | PathLike,
    recordings: Recording | PathLike | Sequence[Recording | PathLike],
    out: PathLike | None = None,
    *,
    magnet: IdentifiedMagnet | None = None,
    methods: Sequence[MethodName] = (),
    controller: ControllerFile | PathLike | None = None,
) -> Calibration:
    """Estimate the errors of the magnets of a stage or a bearing from its motion.

    The command compares mass times acceleration (for a bearing, including the load) with the force
    that each method predicts from the currents. The mass in the rig file is assumed to be correct.
    [spread] gives the standard deviations of all other errors. To use the calibration in a
    simulation, enter its file as control.calibration in the rig file.

    Parameters
    ----------
    rig : BodyRig or path-like
        Rig file of a bearing or a stage.
    recordings : Recording, path-like, or a sequence of them, ``RUNS``
        Recordings of the motion.
    out : path-like, ``FILE``, optional
        Calibration file (TOML) to write.
    magnet : IdentifiedMagnet, optional, only in Python
        Identified magnets. By default, they are identified from the loops of the rig file.
    methods : sequence of str, only in Python
        Methods to calibrate. By default, these are all methods that the recordings can calibrate.
    controller : ControllerFile or path-like, ``FILE``, optional
        Controller file of a bearing. [default: 'controller.toml' next to the rig file]

    Returns
    -------
    Calibration

    Raises
    ------
    InputError
        A file cannot be read, or does not match the rig.

    Examples
    --------
    anhyst calibrate examples/stage/rig.toml run.csv --out calibration.toml

    anhyst calibrate examples/bearing/rig.toml run.csv --out calibration.toml
    """
    from anhyst_rigs.study.tracking.calibrate import calibrate as work

    return work(rig, recordings, out, magnet=magnet, methods=methods, controller=controller)


def warnings(result: Calibration) -> Iterator[str]:
    """Name the method that does not fit even with a calibration."""
    facts = result.facts()
    for method in result.file.method:
        if method.name == "full" and method.force_N > 0.0 and not method.fits:
            yield f"{method.name}: {facts[method.name]}; a flux probe would help"


def show(result: Calibration, arguments: Mapping[str, Any]) -> Iterator[OutputPart]:
    """Return the terminal output: the estimated parameters, and the fit of each method."""
    from anhyst.cli.printing import TerminalTable

    rows = TerminalTable("estimated from motion", ["method", "parameter", "value", "+/-", "before", ""])
    for method in result.file.method:
        for parameter in method.parameter:
            values = (f"{value:.3g}" for value in (parameter.value, parameter.sigma, parameter.prior))
            frozen_note = "fixed: not identifiable" if parameter.frozen else ""
            rows.add_row(
                method.name, parameter.name, *values, frozen_note if method.is_applied else "not used"
            )
    yield rows
    yield from (f"{name}: {text}" for name, text in result.facts().items())
    if arguments["out"] is not None and result.has_estimates:
        yield f"written: {arguments['out']}"


def refuse(result: Calibration, _: Mapping[str, Any]) -> None:
    """Raise NegativeResult if no parameter was estimated."""
    from anhyst.support.errors import NegativeResult

    if not result.has_estimates:
        text = "nothing was estimated: the motion or the force is too small, or no law explains it"
        raise NegativeResult(text, code="nothing-learnt")
