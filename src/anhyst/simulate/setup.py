"""A rig and a controller made ready to run: drives fitted, everything that a process needs."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from anhyst.controllerfile import told_by_key
from anhyst.data import LoopSet
from anhyst.errors import InputError
from anhyst.identifyoptions import IdentifyTable
from anhyst.model import ActuatorModel
from anhyst.rig.loopfiles import identify_loops
from anhyst.simulate.controllerfile import (
    ControllerFile,
    ControllerTable,
    Format,
    Variant,
    check_controller,
    pair_of,
)
from anhyst.simulate.drive import Drive
from anhyst.simulate.flux import FluxCalibration
from anhyst.simulate.plant import static_map
from anhyst.simulate.position import check_position
from anhyst.simulate.rigfile import BearingRig
from anhyst.simulate.variants import Operating, fit_drive


@dataclass(frozen=True)
class Setup:
    """Everything one loop needs; goes to other processes.

    Parameters
    ----------
    rig : BearingRig
        The plant.
    controller : ControllerTable
        Gains, limits, lift-off.
    drive : Drive
        From force to current, as fitted; never run itself.
    """

    rig: BearingRig
    controller: ControllerTable
    drive: Drive

    @property
    def name(self) -> Variant:
        """Of the variant."""
        return self.drive.variant


@dataclass(frozen=True)
class Knowledge:
    """What a controller knows of its magnet: measured loops, and the model identified from them.

    Parameters
    ----------
    loops : LoopSet
        Force over current at several gaps.
    model : ActuatorModel
        Identified from them.
    """

    loops: LoopSet
    model: ActuatorModel


def learn(loops: LoopSet, options: IdentifyTable | None = None) -> Knowledge:
    """Identify the model of a bearing's magnet from its loops; the armature may move under it.

    Parameters
    ----------
    loops : LoopSet
        Force over current at several gaps.
    options : IdentifyTable, optional
        How, as the rig file says; the gap map is ``circuit`` where it says nothing.

    Returns
    -------
    Knowledge
        The model has a dead band, unless the options forbid it: noise of the position reaches it.
    """
    return Knowledge(loops, identify_loops(loops, options or IdentifyTable(), "circuit"))


def make_setup(
    rig: BearingRig,
    controller: ControllerTable,
    knowledge: Knowledge,
    variant: Variant,
    number_format: Format,
) -> Setup:
    """Fit one variant to what is known and put it behind the controller.

    Parameters
    ----------
    rig : BearingRig
    controller : ControllerTable
        Its own variant and format do not count.
    knowledge : Knowledge
    variant, number_format : str

    Returns
    -------
    Setup

    Raises
    ------
    InputError
        What is known does not make a drive of this variant.
    """
    drive = fit_drive(
        variant,
        knowledge.loops,
        knowledge.model,
        operating_point(rig, controller, knowledge.loops),
        number_format,
        calibrate_probe(rig) if variant == "flux" else None,
    )
    chosen = controller.compensation.model_copy(
        update={"variant": variant, "format": number_format}
    )
    return Setup(rig, controller.model_copy(update={"compensation": chosen}), drive)


def make_setups(
    rig: BearingRig,
    controller: ControllerFile,
    knowledge: Knowledge,
    variants: tuple[Variant, ...],
) -> Mapping[Variant, Setup]:
    """Fit several variants in the number format of a controller file.

    Parameters
    ----------
    rig : BearingRig
    controller : ControllerFile
        Its own variant does not count.
    knowledge : Knowledge
    variants : tuple of str

    Returns
    -------
    mapping of str to Setup
        By variant.

    Raises
    ------
    InputError
        The controller does not fit the rig, or what is known does not make a drive; names the file
        that it comes from.
    """
    check_controller(controller, rig)
    table = controller.settings
    found = {}
    for variant in variants:
        modelled = variant in ("simplified", "full") and controller.model is not None
        try:
            found[variant] = make_setup(rig, table, knowledge, variant, table.compensation.format)
        except InputError as error:
            raise InputError(
                f"{controller.model if modelled else rig.measured.text}: {error}"
            ) from error
        with told_by_key(controller):
            check_position(found[variant])
    return found


def with_gains(setup: Setup, controller: ControllerTable) -> Setup:
    """Return the same drive behind another controller of the same limits."""
    return replace(setup, controller=controller)


def operating_point(rig: BearingRig, controller: ControllerTable, loops: LoopSet) -> Operating:
    """Return where a bearing works: each magnet of a pair around its bias.

    Parameters
    ----------
    rig : BearingRig
        Operating gap and load, or the bias of a pair.
    controller : ControllerTable
        Rate and limits.
    loops : LoopSet
        For the gaps that were measured.

    Returns
    -------
    Operating
    """
    pair = pair_of(rig)
    measured = [gap for gap in loops.by_schedule() if gap is not None]
    return Operating(
        gap=rig.settings.simulate.gap_m,
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
    current = np.linspace(0.0, rig.settings.measurement.current_max_A, 60)
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
