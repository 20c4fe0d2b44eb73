"""From what is known of a magnet to loops that are ready to run."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from anhyst.compensate.flux import FluxCalibration
from anhyst.compensate.force_controller import ForceController, MethodName, NumberFormat
from anhyst.compensate.methods import MODELS, PROBED, make_compensator
from anhyst.compensate.play_map import PlayMap
from anhyst.compensate.sources import Operating, Sources
from anhyst.control.controller_file import ControllerFile, ControllerTable, error_at_key
from anhyst.data import Loops
from anhyst.data.speeds import slow_loops
from anhyst.identification.run import IdentifyTable
from anhyst.model.actuator import Model
from anhyst.model.parameters import Parameter
from anhyst.model.schema import LawName
from anhyst.rig.bearing.drift import Drift, drifted_law
from anhyst.rig.bearing.file import BearingRig
from anhyst.rig.bearing.loop import Setup, check_controller, check_position, pair_of
from anhyst.rig.bearing.plant import law_of, make_magnet, static_map
from anhyst.rig.distance import PlantCheck, along, distance, follower, model_distance
from anhyst.rig.measurement_table import identify_loops, misclosures
from anhyst.support.errors import CreepWarning, InputError


@dataclass(frozen=True)
class IdentifiedMagnet:
    """What a controller knows of its magnet: measured loops, and the model identified from them."""

    loops: Loops  # force over current at several gaps
    model: Model  # identified from them
    # part by which the loop of a map with one play is wider; that of the model is so already
    wider: float = 0.0


def identify_magnet(loops: Loops, options: IdentifyTable | None = None) -> IdentifiedMagnet:
    """Identify the model of a bearing's magnet from its loops; the armature may move under it."""
    return IdentifiedMagnet(loops, identify_loops(loops, options or IdentifyTable(), "circuit"))


_FORGETS: LawName = "effective-field"
_NOISE, _OPEN = 1.0, 2.0
"""Mean square of what play cells leave of the closings of small loops, in squares of its error: of
noise, and from where on nobody takes it for noise."""
_CERTAIN = 2.0
"""Standard errors by which a law that forgets must be nearer to them."""


def identify_rippling(
    loops: Loops, options: IdentifyTable, usable: Callable[[IdentifiedMagnet], bool]
) -> IdentifiedMagnet:
    """Identify a magnet whose current ripples, by the law as which its small loops close.

    Cells keep every turning point, and lead astray on iron that forgets them with every ripple.
    """
    known = identify_magnet(loops, options)
    model = known.model
    if options.law != "auto" or model.operator_law.cells is None or model.has_eddy_currents:
        return known
    alone = misclosures(loops, [model])
    if alone.size == 0 or alone.mean() <= _NOISE:
        return known
    other = identify_magnet(loops, options.model_copy(update={"law": _FORGETS}))
    left = misclosures(loops, [model, other.model])
    own, its = left.mean(axis=0).tolist()
    nearer = len(left) * (own - its) / max(its, 1.0) > _CERTAIN**2
    if nearer and other.model.acceptance().passed is not False and usable(other):
        text = f"law {_FORGETS} is taken, which forgets them too; with a probe, 'fused' leaves less"
    elif nearer or own > _OPEN:
        other = known
        text = "no law follows that, 'single-valued' may be better than 'full', and a probe is"
    else:
        return known
    text = f"small loops do not close: this iron does not keep its turning points; {text}"
    warnings.warn(text, CreepWarning, stacklevel=3)
    return other


def make_setup(
    rig: BearingRig,
    controller: ControllerTable,
    magnet: IdentifiedMagnet,
    variant: MethodName,
    number_format: NumberFormat,
) -> Setup:
    """Fit one variant to what is known, and to what motion taught of it, behind the controller."""
    magnets = calibrated_magnets(rig, magnet, variant)
    each = fit_magnets(rig, controller, magnets, variant, number_format)
    chosen = controller.compensation.model_copy(
        update={"variant": variant, "format": number_format}
    )
    behind = controller.model_copy(update={"compensation": chosen})
    return Setup(rig, behind, each[0], tuple(each) if len(each) > 1 else ())


def fit_magnets(
    rig: BearingRig,
    controller: ControllerTable,
    magnets: Sequence[IdentifiedMagnet],
    variant: MethodName,
    number_format: NumberFormat,
) -> list[ForceController]:
    """Fit one variant to what is known of each magnet."""
    where = operating_point(rig, controller, *(magnet.loops for magnet in magnets))
    return fit_at(rig, where, magnets, variant, number_format)


def fit_at(
    rig: BearingRig,
    where: Operating,
    magnets: Sequence[IdentifiedMagnet],
    variant: MethodName,
    number_format: NumberFormat,
) -> list[ForceController]:
    """Fit one variant to what is known of each magnet, where it works."""
    probe = calibrate_probe(rig) if variant in PROBED else None
    fitted = []
    for magnet in magnets:
        sources = Sources(where, magnet.loops, magnet.model, probe)
        compensator = make_compensator(variant, sources, number_format)
        if magnet.wider and isinstance(compensator.parameters, PlayMap):
            wider = compensator.parameters.widened(magnet.wider)
            compensator = replace(compensator, parameters=wider)
        fitted.append(compensator)
    return fitted


def calibrated_magnets(
    rig: BearingRig, magnet: IdentifiedMagnet, variant: MethodName
) -> list[IdentifiedMagnet]:
    """Return what is known of each magnet by what motion taught of a variant, or of all at once.

    The second magnet's gap is what is left of both: it is read too small by what the first one's is
    read too large.
    """
    calibration = rig.learnt(variant)
    if calibration is None or not calibration.taken:
        return [magnet]
    widths, zero = calibration.widths(len(rig.magnets)), calibration.value("gap_zero_m")
    # one range of gaps for both of a pair
    over = 2.0 * abs(zero) if len(widths) > 1 else 0.0
    return [
        calibrated(
            magnet, calibration.value(f"scale_{number + 1}"), (zero, -zero)[number], wider, over
        )
        for number, wider in enumerate(widths)
    ]


def calibrated(
    magnet: IdentifiedMagnet,
    scale: float = 0.0,
    zero: float = 0.0,
    wider: float = 0.0,
    over: float = 0.0,
) -> IdentifiedMagnet:
    """Return what is known of a magnet in the currents and gaps of its controller.

    The loops and the model are those that would have been measured there: every format, block and
    firmware that is made of them is calibrated. Scale and width are parts, the gap zero is in m, as
    is how far over the gaps that were seen the model is believed.
    """
    more, known = 1.0 + scale, magnet.loops
    loops = [
        replace(loop, input=loop.input / more, schedule=loop.schedule + zero)
        for loop in known.loops
        if loop.schedule is not None
    ]
    model = drifted_law(magnet.model, Drift(pinning=wider)) if wider else magnet.model
    parameters, valid = model.parameters, model.valid
    moved = {"c_H": _times(parameters["c_H"], more), "in_0": _times(parameters["in_0"], 1.0 / more)}
    if valid is not None and valid.schedule is not None:
        (low, high), (near, far) = valid.input, valid.schedule
        ends = near + zero - over, far + zero + over
        valid = replace(valid, input=(low / more, high / more), schedule=ends)
    nodes = tuple(node + zero for node in model.nodes)
    model = replace(model, nodes=nodes, parameters={**parameters, **moved}, valid=valid)
    return IdentifiedMagnet(replace(known, loops=tuple(loops)), model, wider)


def _times(value: Parameter, factor: float) -> Parameter:
    return (
        tuple(factor * coefficient for coefficient in value)
        if isinstance(value, tuple)
        else factor * value
    )


def compiled_model(rig: BearingRig, magnet: IdentifiedMagnet, variant: MethodName) -> Model:
    """Return the model of which a block is compiled: with what motion taught of it."""
    magnets = calibrated_magnets(rig, magnet, variant)
    if len(magnets) > 1:
        raise InputError(
            f"{rig.path}: control.calibration: both magnets of a pair share one block, and each was "
            "calibrated for itself; leave it out",
            code="calibration-not-compiled",
            key="control.calibration",
        )
    return magnets[0].model


def make_setups(
    rig: BearingRig,
    controller: ControllerFile,
    magnet: IdentifiedMagnet,
    variants: tuple[MethodName, ...],
) -> Mapping[MethodName, Setup]:
    """Fit several variants in the number format of a controller file."""
    check_controller(controller, rig)
    table = controller.settings
    setups = {}
    for variant in variants:
        modelled = variant in MODELS and controller.model is not None
        try:
            setups[variant] = make_setup(rig, table, magnet, variant, table.compensation.format)
        except InputError as error:
            raise error.at(controller.model if modelled else rig.measured.text) from error
        with error_at_key(controller):
            check_position(setups[variant])
    return setups


def operating_point(rig: BearingRig, controller: ControllerTable, *loops: Loops) -> Operating:
    """Return where a bearing works, over all loops: each magnet of a pair around its bias."""
    pair = pair_of(rig)
    measured = [gap for loop in loops for gap in loop.by_schedule() if gap is not None]
    return Operating(
        gap=rig.settings.gap_m,
        force=rig.load if pair is None else pair.bias_force_N,
        rate=controller.rate_Hz,
        gap_range=controller.working_gaps(pair, (min(measured), max(measured))),
        force_max=controller.force_max(pair),
        current_max=controller.limits.current_high_A,
    )


def calibrate_probe(rig: BearingRig) -> FluxCalibration | None:
    """Measure flux density over force at several gaps, as a user would with a weight.

    The series is taken on the way up from a demagnetised iron; force and flux density belong to one
    gap flux, so that the direction does not matter.
    """
    hall = rig.settings.hall_probe
    if hall is None:
        return None
    high = rig.settings.measurement.current_max_A
    current = np.linspace(-rig.settings.magnet.both_ways * high, high, 60)
    gaps = np.asarray(rig.settings.measurement.gaps_m)
    forces, densities = [], []
    for gap in gaps:
        force, _, density = static_map(rig, current, np.full(current.size, gap))
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


def check_plant(rig: BearingRig, knowledge: IdentifiedMagnet) -> PlantCheck:
    """Hold the plant of a rig, and what its controller knows, against the loops, of the slow ones."""
    magnet, fitted, loops = make_magnet(rig), rig.fitted, slow_loops(knowledge.loops)
    zeros = (0.0, 0.0) if fitted is None else (fitted.zero_current, fitted.zero_force)
    return PlantCheck(
        plant=distance(loops, lambda loop: along(follower(magnet), loop, zeros[0]) + zeros[1]),
        model=model_distance(loops, knowledge.model),
        same=rig.settings.magnet.kind == "law" and _same(law_of(rig), knowledge.model),
        fitted=fitted is not None,
        guessed=() if fitted is None else fitted.guessed,
    )


def _same(law: Model, model: Model) -> bool:
    """Whether two models are one, or of the same law and the same measurements."""
    if law.law != model.law:
        return False
    sources = {source.sha256 for source in law.provenance.sources}
    common = sources & {source.sha256 for source in model.provenance.sources}
    alike = dict(law.parameters) == dict(model.parameters) and law.cells == model.cells
    return alike or bool(common)
