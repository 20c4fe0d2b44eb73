"""Identify a magnet from its loops, calibrate it, fit its compensators, and check its plant."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from anhyst.compensate.current_map import PlayMap
from anhyst.compensate.force_controller import ForceController
from anhyst.compensate.methods import make_compensator
from anhyst.compensate.sources import FluxCalibration, OperatingRange, Sources
from anhyst.data import Loops
from anhyst.data.speeds import select_slow_loops
from anhyst.identification.run import IdentifyTable
from anhyst.model.actuator import Model
from anhyst.model.schema import LawName
from anhyst.support.errors import ReturnPointMemoryWarning
from anhyst.support.kinds import FLUX_PROBE_METHODS, MethodName, NumberFormat
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.distance import PlantCheck, make_path_follower, simulate_loop
from anhyst_rigs.rig.drift import Drift, drifted_law, map_parameter
from anhyst_rigs.rig.from_loops import check_plant_against_loops
from anhyst_rigs.rig.measurement_table import identify_loops, squared_misclosures
from anhyst_rigs.rig.sensor_table import FluxSensorTable


@dataclass(frozen=True)
class IdentifiedMagnet:
    """A magnet as its controller sees it: measured loops, and the model identified from them."""

    loops: Loops  # loops of force over current at several gaps
    model: Model  # model that was identified from these loops
    # relative change of the loop width of a single-play map, which the model already includes
    loop_width_change: float = 0.0


def identify_magnet(loops: Loops, options: IdentifyTable | None = None) -> IdentifiedMagnet:
    """Identify the model of a bearing's magnet, with a gap map because the armature moves."""
    return IdentifiedMagnet(loops, identify_loops(loops, options or IdentifyTable(), "circuit"))


_ACCOMMODATING_LAW: LawName = "effective-field"
_NOISE_MEAN_SQUARE = 1.0
"""Expected mean square of misclosures that are pure noise, in units of the noise variance."""
_MAX_NOISE_MEAN_SQUARE = 2.0
"""Largest mean square of misclosures that noise alone may cause, in the same units."""
_MIN_STANDARD_ERRORS = 2.0
"""Number of standard errors by which a law without return-point memory must fit better."""


def identify_magnet_with_ripple(
    loops: Loops, options: IdentifyTable, is_usable: Callable[[IdentifiedMagnet], bool]
) -> IdentifiedMagnet:
    """Identify a magnet with current ripple; the misclosure of minor loops selects the law.

    Play cells have return-point memory, so they do not fit iron whose minor loops do not close.
    """
    cell_magnet = identify_magnet(loops, options)
    model = cell_magnet.model
    if options.law != "auto" or model.operator_law.cells is None or model.has_eddy_currents:
        return cell_magnet
    cell_misclosures = squared_misclosures(loops, [model])
    if cell_misclosures.size == 0 or cell_misclosures.mean() <= _NOISE_MEAN_SQUARE:
        return cell_magnet
    candidate = identify_magnet(loops, options.model_copy(update={"law": _ACCOMMODATING_LAW}))
    squared_errors = squared_misclosures(loops, [model, candidate.model])
    cell_error, alternative_error = squared_errors.mean(axis=0).tolist()
    is_better = (
        len(squared_errors) * (cell_error - alternative_error) / max(alternative_error, 1.0)
        > _MIN_STANDARD_ERRORS**2
    )
    if is_better and candidate.model.acceptance().passed is not False and is_usable(candidate):
        text = f"law {_ACCOMMODATING_LAW} is used, which drifts as well; "
        text += "'fused' with a probe is better"
    elif is_better or cell_error > _MAX_NOISE_MEAN_SQUARE:
        candidate = cell_magnet
        text = "no law describes this; 'single-valued' may be better than 'full', and a probe is better"
    else:
        return cell_magnet
    text = f"minor loops do not close: this iron has no return-point memory; {text}"
    warnings.warn(text, ReturnPointMemoryWarning, stacklevel=3)
    return candidate


def fit_compensators(
    rig: BodyRig,
    operating_point: OperatingRange,
    magnets: Sequence[IdentifiedMagnet],
    variant: MethodName,
    number_format: NumberFormat,
    commits_readings: bool = False,
) -> list[ForceController]:
    """Fit the compensator of a variant to each magnet at an operating point.

    `commits_readings` is whether the controller commits the measured currents of a tick.
    """
    probe = calibrate_probe(rig, commits_readings) if variant in FLUX_PROBE_METHODS else None
    fitted_compensators = []
    for magnet in magnets:
        sources = Sources(operating_point, magnet.loops, magnet.model, probe)
        compensator = make_compensator(variant, sources, number_format)
        if magnet.loop_width_change and isinstance(compensator.parameters, PlayMap):
            wider_parameters = compensator.parameters.widened(magnet.loop_width_change)
            compensator = replace(compensator, parameters=wider_parameters)
        fitted_compensators.append(compensator)
    return fitted_compensators


def calibrate_magnet(
    magnet: IdentifiedMagnet,
    scale: float = 0.0,
    gap_zero: float = 0.0,
    width_change: float = 0.0,
    gap_margin: float = 0.0,
) -> IdentifiedMagnet:
    """Return a magnet whose currents and gaps are those that its controller would read.

    Every compensator and parameter block made from its loops and model is therefore calibrated.
    `scale` and `width_change` are relative changes, `gap_zero` is in m. The valid range of gaps is
    extended at both ends by `gap_margin`, m.
    """
    current_factor, measured_loops = 1.0 + scale, magnet.loops
    loops = [
        replace(loop, input=loop.input / current_factor, schedule=loop.schedule + gap_zero)
        for loop in measured_loops.loops
        if loop.schedule is not None
    ]
    model = drifted_law(magnet.model, Drift(pinning=width_change)) if width_change else magnet.model
    parameters, valid_range = model.parameters, model.valid
    model_changes = {
        "c_H": map_parameter(parameters["c_H"], lambda value: current_factor * value),
        "in_0": map_parameter(parameters["in_0"], lambda value: 1.0 / current_factor * value),
    }
    if valid_range is not None and valid_range.schedule is not None:
        (low_current, high_current), (near_gap, far_gap) = valid_range.input, valid_range.schedule
        gap_range = near_gap + gap_zero - gap_margin, far_gap + gap_zero + gap_margin
        valid_range = replace(
            valid_range,
            input=(low_current / current_factor, high_current / current_factor),
            schedule=gap_range,
        )
    gap_nodes = tuple(gap + gap_zero for gap in model.nodes)
    model = replace(model, nodes=gap_nodes, parameters={**parameters, **model_changes}, valid=valid_range)
    return IdentifiedMagnet(replace(measured_loops, loops=tuple(loops)), model, width_change)


def calibrate_probe(rig: BodyRig, commits_readings: bool = False) -> FluxCalibration | None:
    """Measure flux density against force at several gaps, as a user would with a weight.

    With a coil, this is the flux linkage.

    The series follows the first ascending branch of demagnetised iron. Both force and flux density
    depend only on the gap flux, so the direction does not matter.
    """
    file, probe = rig.settings, rig.settings.flux_sensor
    if probe is None:
        return None
    coil = file.coil_sensor
    share = 1.0 if coil is None or coil.turns is None else coil.turns / file.magnet.poles.turns
    max_current = rig.settings.measurement.current_max_A
    current = np.linspace(-rig.settings.magnet.is_bidirectional * max_current, max_current, 60)
    gaps = np.asarray(rig.settings.measurement.gaps_m)
    forces, densities = [], []
    for gap in gaps:
        force, linkage, density = rig.static_map(current, np.full(current.size, gap))
        forces.append(force)
        densities.append((1.0 + probe.gain_error) * (density if coil is None else share * linkage))
    timing, amplifier = rig.settings.timing, rig.settings.amplifier
    delay = timing.delay_ticks * rig.dt + amplifier.delay_s
    corner_frequencies = [amplifier.bandwidth_Hz]
    if isinstance(probe, FluxSensorTable):
        corner_frequencies.append(probe.bandwidth_Hz)
    current_delay = delay + 1.0 / (2.0 * math.pi * amplifier.bandwidth_Hz)
    used_delay = 0.5 * rig.dt if commits_readings else current_delay
    resistance = file.magnet.poles.resistance
    return FluxCalibration(
        gap=np.repeat(gaps, current.size),
        force=np.concatenate(forces),
        flux_density=np.concatenate(densities),
        delay=delay,
        lag=sum(1.0 / (2.0 * math.pi * corner_frequency) for corner_frequency in corner_frequencies)
        + rig.settings.magnet.eddy_time_s,
        coil=None if coil is None else coil.for_controller(resistance, used_delay),
    )


def check_plant(rig: BodyRig, magnet: IdentifiedMagnet) -> PlantCheck:
    """Compare the plant of a rig and its controller's model with the slow measured loops."""
    return check_plant_against_loops(
        rig.fitted,
        select_slow_loops(magnet.loops),
        magnet.model,
        lambda loop, zero: simulate_loop(make_path_follower(rig.magnet), loop, zero),
        is_same_law=rig.law is not None and _is_same_law(rig.law, magnet.model),
    )


def _is_same_law(law: Model, model: Model) -> bool:
    """Whether two models are equal, or have the same hysteresis law and a common measurement."""
    if law.law != model.law:
        return False
    sources = {source.sha256 for source in law.provenance.sources}
    common_sources = sources & {source.sha256 for source in model.provenance.sources}
    has_same_parameters = dict(law.parameters) == dict(model.parameters) and law.cells == model.cells
    return has_same_parameters or bool(common_sources)
