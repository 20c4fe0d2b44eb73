"""The command ``excite``: measure loops on a rig."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any, Literal, overload

if TYPE_CHECKING:
    from anhyst.cli.shared import OutputPart
    from anhyst.support.atomic import PathLike
    from anhyst.support.jobs import Progress
    from anhyst_rigs.study.excite.excite import Excitation
    from anhyst_rigs.study.response.result import FrequencyResponse
    from anhyst_rigs.study.tracking.excitation import CalibratingMove

PLACE = 36, "Rigs, simulated and real"
PROGRESS = "measuring"


@overload
def excite(
    rig: PathLike,
    out: PathLike,
    *,
    calibrate: Literal[False] = False,
    response: Literal[False] = False,
    voltage: bool = False,
    plot: PathLike | None = None,
    folder: PathLike | None = None,
    xcp: str | None = None,
    port: str | None = None,
    progress: Progress | None = None,
) -> Excitation: ...


@overload
def excite(
    rig: PathLike, out: PathLike, *, calibrate: Literal[True], plot: PathLike | None = None
) -> CalibratingMove: ...


@overload
def excite(
    rig: PathLike,
    out: PathLike,
    *,
    response: Literal[True],
    motion: float | None = None,
    plot: PathLike | None = None,
    progress: Progress | None = None,
) -> FrequencyResponse: ...


def excite(
    rig: PathLike,
    out: PathLike,
    *,
    calibrate: bool = False,
    response: bool = False,
    motion: float | None = None,
    voltage: bool = False,
    plot: PathLike | None = None,
    folder: PathLike | None = None,
    xcp: str | None = None,
    port: str | None = None,
    progress: Progress | None = None,
) -> Excitation | CalibratingMove | FrequencyResponse:
    """Measure loops on a rig: design a drive within its limits, apply it and record the loops.

    The armature is fixed at every gap. The drive consists of nested major loops, first-order
    reversal curves, and minor loops around the operating point. The operating point is approached
    from below, from above and with a decaying sine. At the beginning of every record, the iron is
    demagnetised, or conditioned if the amplifier cannot drive a negative current. The current, its
    rate, the force and the I^2 t of the winding stay within the limits of the rig file. The command
    reports each limit that reduced the drive. For a piezo stage, it records displacement against
    voltage in the same way, and two fast cycles. The rig is simulated. With `xcp` or `port`, the
    controller of a real rig with a fixed armature drives the current and is stopped afterwards.

    Parameters
    ----------
    rig : path-like
        Rig file of any kind; with `calibrate`, the rig file of a stage.
    out : path-like, ``FILE``
        CSV file to write, with a sidecar .toml of the same name.
    calibrate : bool
        Instead, run the shortest motion of a stage that reveals the errors of its magnets. FILE is
        then the recording for anhyst calibrate.
    response : bool
        Instead, levitate the body of a bearing or a stage, and measure closed loop, sensitivity and
        plant with a multi-sine: 200 points from 1 Hz to 5 kHz in 18 s of rig time. FILE is then the
        frequency response.
    motion : float, ``METRES``, optional
        With `response`: largest motion of the body. [default: a hundredth of the gap]
    voltage : bool
        Measure the voltage of the coil instead of the force, at four gaps. The flux linkage follows
        from it, and the force from the flux linkage.
    plot : path-like, ``FILE``, optional
        Picture of the drive and the loops, or of the motion (png, svg or pdf).
    folder : path-like, ``FOLDER``, optional
        With `xcp` or `port`: the compiled folder of the firmware.
    xcp : str, ``HOST:PORT``, optional
        Measure through a force controller that runs independently and offers XCP at this address.
    port : str, ``PORT``, optional
        The same through a serial port with XCP.
    progress : callable, optional
        Called with the work done and the total work.

    Returns
    -------
    Excitation, CalibratingMove or FrequencyResponse
        The loops, the largest drive at each gap, and the limit that set it; or the motion; or the
        frequency response.

    Raises
    ------
    InputError
        A file cannot be read or written, a rig cannot measure loops, or no controller answers.

    Examples
    --------
    anhyst excite rig.toml --out loops.csv; anhyst identify loops.csv --out model.toml

    anhyst excite examples/solenoid/rig.toml --voltage --out coil.csv

    anhyst excite --calibrate examples/stage/rig.toml --out run.csv

    anhyst excite --response examples/bearing/rig.toml --out response.csv
    """
    from anhyst.support.atomic import check_path, check_picture, write_figure
    from anhyst.support.errors import InputError
    from anhyst_rigs.dashboard.verb import controller_url
    from anhyst_rigs.reports.excitation import figure_excitation, figure_response
    from anhyst_rigs.study.bench import measure_through_board
    from anhyst_rigs.study.excite.excite import excite as work
    from anhyst_rigs.study.excite.voltage import measure_voltage
    from anhyst_rigs.study.response.virtual import excite_loop
    from anhyst_rigs.study.tracking.excitation import excite_to_calibrate

    if calibrate or response:
        option = "--calibrate" if calibrate else "--response"
        if folder or xcp or port or voltage or (calibrate and response):
            text = f"{option}: uses the simulated rig alone; omit --folder, --xcp, --port, --voltage"
            raise InputError(
                f"{text} and {'--response' if calibrate else '--calibrate'}",
                code="option-not-for-this",
                key=option,
            )
    if motion is not None and not response:
        text = "--motion: limits the motion of --response; add it, or omit --motion"
        raise InputError(text, code="options-missing", key="--motion")
    if calibrate:
        return excite_to_calibrate(rig, out, plot=plot)
    check_path(rig, "excite: rig", "the path of a rig file")
    check_path(out, "excite: out")
    if plot is not None:
        check_picture(plot)
    if response:
        measured = excite_loop(rig, out, motion, progress)
        if plot is not None:
            write_figure(figure_response(measured), plot)
        return measured
    url = controller_url(xcp, port)
    if (url is None) is not (folder is None):
        text = "--folder: needs --xcp or --port, and these need --folder"
        raise InputError(text, code="options-missing", key="--folder")
    if voltage and url is not None:
        text = "--voltage: a force controller does not record the voltage of the coil; omit --xcp and --port"
        raise InputError(text, code="option-not-for-this", key="--voltage")
    connection = None if folder is None or url is None else measure_through_board(folder, url)
    excitation = work(rig, out, progress, measure_voltage if voltage else connection)
    if plot is not None:
        write_figure(figure_excitation(excitation), plot)
    return excitation


def warnings(result: Excitation | CalibratingMove | FrequencyResponse) -> list[str]:
    """Return the warning that ``calibrate`` would reject the recording."""
    rejection = getattr(result, "rejection", None)
    return [] if rejection is None else [rejection]


def show(
    result: Excitation | CalibratingMove | FrequencyResponse, arguments: Mapping[str, Any]
) -> Iterator[OutputPart]:
    """Return the terminal output: drives, effect of the motion or response, and the files written."""
    from anhyst_rigs.study.excite.excite import Excitation
    from anhyst_rigs.study.response.result import FrequencyResponse

    if isinstance(result, Excitation):
        yield from _show_excitation(result)
        written = [arguments["out"], arguments["out"].with_suffix(".toml"), arguments["plot"]]
    else:
        if isinstance(result, FrequencyResponse):
            yield from (f"{name}: {text}" for name, text in result.facts().items())
        else:
            yield from _show_move(result)
        written = [arguments["out"], arguments["plot"]]
    yield from (f"written: {path}" for path in written if path is not None)


def _show_excitation(excitation: Excitation) -> Iterator[OutputPart]:
    from anhyst.cli.printing import TerminalTable
    from anhyst.support.wording import count_text

    figures = excitation.as_dict()
    specimen, unit = excitation.specimen, excitation.specimen.units[0]
    gap = ["gap mm"] if specimen.gaps else []
    output_heading, factor = {"displacement": ("stroke µm", 1e6), "voltage": ("voltage V", 1.0)}.get(
        specimen.output, ("force N", 1.0)
    )
    operating = [] if specimen.output == "voltage" else [f"operating point {unit}"]
    headings = [*gap, f"largest {unit}", output_heading, *operating, "limited by"]
    table = TerminalTable(f"{count_text(figures['loops'], 'loop')}, {figures['samples']} samples", headings)
    for place in excitation.probed_gaps:
        table.add_row(
            *([f"{1e3 * place.gap:g}"] if gap else []),
            f"{place.peak.value:.4g}",
            f"{factor * place.largest_force:.4g}",
            *([f"{place.operating_current:.4g}"] if operating else []),
            place.peak.key,
        )
    minutes = figures["duration_s"] / 60.0
    warmth = figures["warmth"]
    warmth_text = "" if warmth is None else f", I^2 t at most {100.0 * warmth:.0f} % of the trip level"
    yield table
    yield f"{minutes:.1f} min of measurement, {figures[f'rate_{unit}_per_s']:.4g} {unit}/s{warmth_text}"
    yield from (f"note: {note}" for note in excitation.notes)


def _show_move(result: CalibratingMove) -> Iterator[OutputPart]:
    import re

    from anhyst.cli.printing import TerminalTable

    move, own_setpoint = result.move, result.work
    kinds: dict[str, list[str]] = {}
    for name in move.left:
        kinds.setdefault(re.sub(r"_(\d+|[xyz](?=_m))", "", name), []).append(name)
    headings = ["posterior / prior sigma", "this motion", "its own set-point"]
    table = TerminalTable(f"{move.duration_s:.2f} s", headings)
    for kind, names in kinds.items():
        sigma_ratios = [[f"{item.left[name]:.2f}" for name in names] for item in (move, own_setpoint)]
        table.add_row(
            kind, *(" to ".join(dict.fromkeys((min(ratios), max(ratios)))) for ratios in sigma_ratios)
        )
    table.add_row("duration, s", *(f"{motion.duration_s:.2f}" for motion in (move, own_setpoint)))
    table.add_row("condition number", *(f"{motion.condition:.2g}" for motion in (move, own_setpoint)))
    hidden_by_setpoint = ", ".join(name for name in own_setpoint.hidden if name not in move.hidden)
    yield table
    for axis, motion_leg in result.legs.items():
        peak_text = ", ".join(f"{peak:.3g}" for peak in motion_leg.peaks)
        yield f"{axis}: {peak_text} m/s2 at {motion_leg.speed:.3g} m/s"
    yield f"not identifiable: {', '.join(move.hidden) or 'nothing'}"
    yield (
        f"not identifiable with its own set-point: {hidden_by_setpoint}"
        if hidden_by_setpoint
        else "its own set-point identifies the same parameters"
    )
