"""What is known of a magnet: identified from its loops, corrected by its motion, fitted, checked."""

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


@dataclass(frozen=True)
class IdentifiedMagnet:
    """What a controller knows of its magnet: measured loops, and the model identified from them."""

    loops: Loops  # force over current at several gaps
    model: Model  # identified from them
    # part by which the loop of a map with one play is wider; that of the model is so already
    loop_width_change: float = 0.0


def identify_magnet(loops: Loops, options: IdentifyTable | None = None) -> IdentifiedMagnet:
    """Identify the model of a bearing's magnet from its loops; the armature may move under it."""
    return IdentifiedMagnet(loops, identify_loops(loops, options or IdentifyTable(), "circuit"))


_ACCOMMODATING_LAW: LawName = "effective-field"
_NOISE_MEAN_SQUARE = 1.0
"""Expected mean square of misclosures that are only noise, in units of their variance."""
_MAX_NOISE_MEAN_SQUARE = 2.0
"""Largest mean square that may still be noise."""
_MIN_STANDARD_ERRORS = 2.0
"""Standard errors by which a law that forgets must be nearer to them."""


def identify_magnet_with_ripple(
    loops: Loops, options: IdentifyTable, is_usable: Callable[[IdentifiedMagnet], bool]
) -> IdentifiedMagnet:
    """Identify a magnet whose current ripples, by the law as which its small loops close.

    Cells keep every turning point, and lead astray on iron that forgets them with every ripple.
    """
    known = identify_magnet(loops, options)
    model = known.model
    if options.law != "auto" or model.operator_law.cells is None or model.has_eddy_currents:
        return known
    alone = squared_misclosures(loops, [model])
    if alone.size == 0 or alone.mean() <= _NOISE_MEAN_SQUARE:
        return known
    other = identify_magnet(loops, options.model_copy(update={"law": _ACCOMMODATING_LAW}))
    left = squared_misclosures(loops, [model, other.model])
    own, its = left.mean(axis=0).tolist()
    nearer = len(left) * (own - its) / max(its, 1.0) > _MIN_STANDARD_ERRORS**2
    if nearer and other.model.acceptance().passed is not False and is_usable(other):
        text = f"law {_ACCOMMODATING_LAW} is taken, which forgets them too; with a probe, 'fused' leaves less"
    elif nearer or own > _MAX_NOISE_MEAN_SQUARE:
        other = known
        text = "no law follows that, 'single-valued' may be better than 'full', and a probe is"
    else:
        return known
    text = f"small loops do not close: this iron does not keep its turning points; {text}"
    warnings.warn(text, ReturnPointMemoryWarning, stacklevel=3)
    return other


def fit_compensators(
    rig: BodyRig,
    operating_point: OperatingRange,
    magnets: Sequence[IdentifiedMagnet],
    variant: MethodName,
    number_format: NumberFormat,
) -> list[ForceController]:
    """Fit one variant to what is known of each magnet, where it works."""
    probe = calibrate_probe(rig) if variant in FLUX_PROBE_METHODS else None
    fitted = []
    for magnet in magnets:
        sources = Sources(operating_point, magnet.loops, magnet.model, probe)
        compensator = make_compensator(variant, sources, number_format)
        if magnet.loop_width_change and isinstance(compensator.parameters, PlayMap):
            wider = compensator.parameters.widened(magnet.loop_width_change)
            compensator = replace(compensator, parameters=wider)
        fitted.append(compensator)
    return fitted


def calibrate_magnet(
    magnet: IdentifiedMagnet,
    scale: float = 0.0,
    gap_zero: float = 0.0,
    width_change: float = 0.0,
    gap_margin: float = 0.0,
) -> IdentifiedMagnet:
    """Return what is known of a magnet in the currents and gaps of its controller.

    The loops and the model are those that would have been measured there: every format, block and
    firmware that is made of them is calibrated. Scale and width are parts, the gap zero is in m, as
    is how far over the gaps that were seen the model is believed.
    """
    more, known = 1.0 + scale, magnet.loops
    loops = [
        replace(loop, input=loop.input / more, schedule=loop.schedule + gap_zero)
        for loop in known.loops
        if loop.schedule is not None
    ]
    model = drifted_law(magnet.model, Drift(pinning=width_change)) if width_change else magnet.model
    parameters, valid = model.parameters, model.valid
    moved = {
        "c_H": map_parameter(parameters["c_H"], lambda value: more * value),
        "in_0": map_parameter(parameters["in_0"], lambda value: 1.0 / more * value),
    }
    if valid is not None and valid.schedule is not None:
        (low, high), (near, far) = valid.input, valid.schedule
        ends = near + gap_zero - gap_margin, far + gap_zero + gap_margin
        valid = replace(valid, input=(low / more, high / more), schedule=ends)
    nodes = tuple(node + gap_zero for node in model.nodes)
    model = replace(model, nodes=nodes, parameters={**parameters, **moved}, valid=valid)
    return IdentifiedMagnet(replace(known, loops=tuple(loops)), model, width_change)


def calibrate_probe(rig: BodyRig) -> FluxCalibration | None:
    """Measure flux density over force at several gaps, as a user would with a weight.

    The series is taken on the way up from a demagnetised iron; force and flux density belong to one
    gap flux, so that the direction does not matter.
    """
    hall = rig.settings.hall_probe
    if hall is None:
        return None
    high = rig.settings.measurement.current_max_A
    current = np.linspace(-rig.settings.magnet.is_bidirectional * high, high, 60)
    gaps = np.asarray(rig.settings.measurement.gaps_m)
    forces, densities = [], []
    for gap in gaps:
        force, _, density = rig.static_map(current, np.full(current.size, gap))
        forces.append(force)
        densities.append((1.0 + hall.gain_error) * density)
    timing, amplifier = rig.settings.timing, rig.settings.amplifier
    corners = (amplifier.bandwidth_Hz, hall.bandwidth_Hz)
    return FluxCalibration(
        gap=np.repeat(gaps, current.size),
        force=np.concatenate(forces),
        flux_density=np.concatenate(densities),
        delay=timing.delay_ticks * rig.dt + amplifier.delay_s,
        lag=sum(1.0 / (2.0 * math.pi * corner) for corner in corners)
        + rig.settings.magnet.eddy_time_s,
    )


def check_plant(rig: BodyRig, magnet: IdentifiedMagnet) -> PlantCheck:
    """Hold the plant of a rig, and what its controller knows, against the loops, of the slow ones."""
    return check_plant_against_loops(
        rig.fitted,
        select_slow_loops(magnet.loops),
        magnet.model,
        lambda loop, zero: simulate_loop(make_path_follower(rig.magnet), loop, zero),
        is_same_law=rig.law is not None and _is_same_law(rig.law, magnet.model),
    )


def _is_same_law(law: Model, model: Model) -> bool:
    """Whether two models are one, or of the same law and the same measurements."""
    if law.law != model.law:
        return False
    sources = {source.sha256 for source in law.provenance.sources}
    common = sources & {source.sha256 for source in model.provenance.sources}
    alike = dict(law.parameters) == dict(model.parameters) and law.cells == model.cells
    return alike or bool(common)
