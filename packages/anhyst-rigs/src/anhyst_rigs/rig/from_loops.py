"""Fit the iron, the winding and the poles of the plant to measured loops.

The plant has pinned cells (:class:`anhyst_rigs.rig.parts.iron.CellSteel`) in the circuit of a
two-pole magnet, and never the hysteresis law of a compensator. Keys given in the rig file stay
fixed. Loops of force over current cannot separate two combinations of parameters. Below saturation,
these are turns and pole size. They are always iron length and the fields of the iron. Weak priors
of ordinary magnets determine their values.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import Field, dataclass, replace
from typing import Any, ClassVar, Protocol, TypeVar

import numpy as np
from scipy.optimize import least_squares

from anhyst._core import Magnet
from anhyst.data import Loop, Loops
from anhyst.data.speeds import group_by_speed, select_slow_loops
from anhyst.data.verdict import largest_output
from anhyst.model.actuator import Model
from anhyst.support.cache import cached_result
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst.support.units import MU_0
from anhyst_rigs.rig.distance import (
    PlantCheck,
    make_path_follower,
    measure_deviation,
    measure_model_deviation,
    simulate_loop,
    simulate_loop_in_time,
    thin_loops,
)
from anhyst_rigs.rig.file import RigFile
from anhyst_rigs.rig.magnet_table import FROM_LOOPS, POLE_KEYS, MagnetTable, SolidTable
from anhyst_rigs.rig.parts.iron import NamedCells
from anhyst_rigs.rig.parts.magnet import Poles, make_iron_magnet

PINNED_CELL_COUNT = 24
"""Number of pinned cells in the fitted iron."""

IRON_LENGTH_PER_POLE_SIDE = 11.0
"""Assumed length of the flux path in the iron, relative to the side of a pole."""

WINDING_RESISTIVITY_OHM_M = 1.75e-8 / 0.5
"""Resistivity of copper divided by a fill factor of 0.5, ohm m, for a window as large as a pole."""

TURN_LENGTH_PER_POLE_SIDE = 5.0
"""Assumed mean length of a winding turn, relative to the side of a pole."""

MAX_FORCE_FLUX_DENSITY_T = 1.2
"""Assumed flux density at the largest force, T, from which the prior of the pole area follows."""

RELATIVE_DEVIATION_SIGMA = 0.003 * 0.1
"""Relative mean deviation that costs as much as a parameter one sigma from its prior mean."""

GUESS_SAMPLES = 600
"""Number of samples for the comparison of initial guesses."""
FIT_SAMPLES = 2400
"""Number of samples for the fit of the plant."""

PINNING_STARTS = (-1.0, 0.5, 1.5)
"""Initial guesses of the pinning, in standard deviations of its prior."""

FAST_LOOP_SAMPLES = 100
"""Average number of samples per fast loop for the fit of the solid iron."""

STEEL_CONDUCTIVITY_S_PER_M = 5e6
"""Conductivity of plain steel, S/m."""
LOG_CONDUCTIVITY_STARTS = (-4.0, -2.0, 0.0, 2.0)
"""Initial guesses of the logarithm of the conductivity divided by that of plain steel."""
_LOG_CONDUCTIVITY_SIGMA = 3.0
"""Prior sigma of this logarithm and of the log odds of the path length; both means are 0."""

MAX_EVALUATIONS = 60
"""Largest number of evaluations of the residuals in a fit."""


@dataclass(frozen=True)
class FittedPlant:
    """A magnet that was fitted to loops."""

    poles: Poles
    steel: NamedCells
    zero_current: float  # sensor readings at zero current and force, A and N
    zero_force: float
    guessed_keys: tuple[str, ...]  # keys that neither the file nor the loops determine
    solid: SolidTable | None = None  # solid part of the core, with all its keys

    @property
    def magnet(self) -> Magnet:
        """The fitted magnet for the core."""
        return make_iron_magnet(self.poles, self.steel)

    @property
    def magnet_keys(self) -> Mapping[str, Any]:
        """Values of the keys of ``[[magnet]]`` in a rig file, except those of its iron."""
        poles = {key: getattr(self.poles, name) for name, key in POLE_KEYS.items()}
        return {**poles, "solid": self.solid}


def check_plant_against_loops(
    fitted_plant: FittedPlant | None,
    loops: Loops,
    model: Model,
    force: Callable[[Loop, float], FloatArray],
    is_same_law: bool = False,
) -> PlantCheck:
    """Compare a plant and a model with loops.

    `force` returns the force of the plant along a loop for a zero error of the current, A.
    """
    zeros = (0.0, 0.0) if fitted_plant is None else (fitted_plant.zero_current, fitted_plant.zero_force)
    return PlantCheck(
        plant=measure_deviation(loops, lambda loop: force(loop, zeros[0]) + zeros[1]),
        model=measure_model_deviation(loops, model),
        is_same_law=is_same_law,
        is_fitted=fitted_plant is not None,
        guessed_keys=() if fitted_plant is None else fitted_plant.guessed_keys,
    )


def fit_magnet(loops: Loops, table: MagnetTable) -> FittedPlant:
    """Fit the keys that a magnet omits; solid iron needs loops at several speeds."""
    return cached_result("plants", lambda: _fit_magnet_uncached(loops, table), loops, table)


def _fit_magnet_uncached(loops: Loops, table: MagnetTable) -> FittedPlant:
    slow_loops = select_slow_loops(loops)
    static_fit = _StaticFit(thin_loops(slow_loops, GUESS_SAMPLES), table)
    best_result = min(
        (static_fit.minimise(static_fit.initial_guess(pinning)) for pinning in PINNING_STARTS),
        key=lambda result: result[0],
    )
    static_fit = _StaticFit(thin_loops(slow_loops, FIT_SAMPLES), table)
    _, parameters = static_fit.minimise(best_result[1])
    turn_count = round(static_fit.estimate_turns(parameters))
    if table.turns is None:
        static_fit = _StaticFit(static_fit.loops, table.model_copy(update={"turns": turn_count}))
        _, parameters = static_fit.minimise(static_fit.initial_guess(0.0))
    fitted_plant = static_fit.make_plant(parameters, table)
    return replace(fitted_plant, solid=table.solid and _fit_solid_iron(loops, fitted_plant, table.solid))


class RigWithMagnet(Protocol):
    """A rig whose rig file contains magnets."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]

    @property
    def settings(self) -> RigFile:
        """Content of the rig file."""


AnyRig = TypeVar("AnyRig", bound=RigWithMagnet)


def complete_rig(rig: AnyRig, loops: Loops) -> AnyRig:
    """Return a rig whose magnet has all keys; iron "from loops" is fitted to the loops."""
    file = rig.settings
    if file.solenoid is not None or not file.magnet.has_iron_from_loops or file.iron is not None:
        return rig
    plant = fit_magnet(loops, file.magnet)
    new_file = file.with_table_replaced(file.magnet, file.magnet.model_copy(update=plant.magnet_keys))
    irons = [*file.irons, plant.steel]
    return replace(rig, settings=new_file.model_copy(update={"irons": irons}), fitted=plant)


def _fit_solid_iron(loops: Loops, plant: FittedPlant, given_solid: SolidTable) -> SolidTable:
    """Fit the omitted keys of solid iron: conductivity, and length of its flux path."""
    if (given_solid.path_m or 0.0) > plant.poles.iron_length:
        raise InputError(
            f"magnet.solid.path_m is longer than the {plant.poles.iron_length:.3g} m of the path "
            "in the iron; lower it, or give iron_length_m",
            code="too-long",
            key="magnet.solid.path_m",
        )
    if given_solid.conductivity_S_per_m is not None and given_solid.path_m is not None:
        return given_solid
    speeds = group_by_speed(loops)
    if speeds is None:
        raise InputError(
            "magnet.solid: loops at one speed do not determine the eddy-current lag; give "
            "conductivity_S_per_m and path_m, or loops of several speeds with times (t_s)",
            code="one-speed",
            key="magnet.solid",
        )
    fast_loops = [loop for group in speeds.fast for loop in group]
    fit_loops = thin_loops(loops.with_loops(fast_loops), FAST_LOOP_SAMPLES * len(fast_loops))
    max_force = largest_output(loops)
    weight = 1.0 / (RELATIVE_DEVIATION_SIGMA * max_force * math.sqrt(sum(loop.n for loop in fit_loops.loops)))

    def table(parameters: FloatArray) -> SolidTable:
        conductivity = given_solid.conductivity_S_per_m or STEEL_CONDUCTIVITY_S_PER_M * math.exp(
            parameters[0]
        )
        path = given_solid.path_m or plant.poles.iron_length * _logistic(parameters[1])
        return given_solid.model_copy(update={"conductivity_S_per_m": conductivity, "path_m": path})

    def residuals(parameters: FloatArray) -> FloatArray:
        solid = table(parameters).make_solid_iron(plant.poles.iron_length)
        magnet = make_iron_magnet(plant.poles, plant.steel, solid=solid)
        deviations = [
            simulate_loop_in_time(magnet, loop, plant.zero_current) + plant.zero_force - loop.output
            for loop in fit_loops.loops
        ]
        return np.concatenate([weight * np.concatenate(deviations), parameters / _LOG_CONDUCTIVITY_SIGMA])

    start_points = (np.array([log_conductivity, 0.0]) for log_conductivity in LOG_CONDUCTIVITY_STARTS)
    start_point = min(start_points, key=lambda point: float(np.sum(residuals(point) ** 2)))
    return table(least_squares(residuals, start_point, max_nfev=MAX_EVALUATIONS, diff_step=1e-3, xtol=1e-4).x)


class _StaticFit:
    """Least-squares fit of the quasi-static force, with priors."""

    def __init__(self, loops: Loops, table: MagnetTable) -> None:
        self.loops = loops
        self._table = table
        self._max_force = max(float(np.max(loop.output)) for loop in loops.loops)
        self._max_current = max(float(np.max(np.abs(loop.input))) for loop in loops.loops)
        parameter_priors = _parameter_priors(loops, table, self._max_force)
        self._names = tuple(parameter_priors)
        self._prior_mean = np.array([mean for mean, _ in parameter_priors.values()])
        self._prior_sigma = np.array([sigma for _, sigma in parameter_priors.values()])
        samples = sum(loop.n for loop in loops.loops)
        self._weight = 1.0 / (RELATIVE_DEVIATION_SIGMA * self._max_force * math.sqrt(samples))

    def initial_guess(self, pinning: float) -> FloatArray:
        """Return an initial guess, in prior standard deviations from the prior mean."""
        parameters = np.zeros(len(self._names))
        parameters[self._names.index("pinning")] = pinning
        return parameters

    def minimise(self, start_point: FloatArray) -> tuple[float, FloatArray]:
        """Minimise the cost from an initial guess; return the smallest cost and its parameters."""
        result = least_squares(self._residuals, start_point, max_nfev=MAX_EVALUATIONS, diff_step=1e-4)
        return float(result.cost), result.x

    def estimate_turns(self, point: FloatArray) -> float:
        """Return the number of turns for given parameters, before rounding."""
        return self._make_poles_and_steel(self._named_parameters(point))[0].turns

    def make_plant(self, point: FloatArray, table: MagnetTable) -> FittedPlant:
        """Return the magnet for given parameters."""
        values = self._named_parameters(point)
        poles, steel = self._make_poles_and_steel(values)
        resistance = (
            WINDING_RESISTIVITY_OHM_M
            * TURN_LENGTH_PER_POLE_SIDE
            * poles.turns**2
            / math.sqrt(poles.width * poles.depth)
        )
        guessed_keys = [key for key in ("resistance_ohm", "iron_length_m") if getattr(table, key) is None]
        return FittedPlant(
            replace(poles, resistance=table.resistance_ohm or resistance),
            steel,
            values["zero_current"] * self._max_current,
            values["zero_force"] * self._max_force,
            tuple(guessed_keys),
        )

    def _named_parameters(self, point: FloatArray) -> dict[str, float]:
        return dict(zip(self._names, (self._prior_mean + self._prior_sigma * point).tolist(), strict=True))

    def _make_poles_and_steel(self, values: Mapping[str, float]) -> tuple[Poles, NamedCells]:
        table = self._table
        width, depth = table.pole_width_m, table.pole_depth_m
        pole_side = math.exp(values["side"]) if "side" in values else math.sqrt((width or 0) * (depth or 0))
        width = width or (pole_side * pole_side / depth if depth else pole_side)
        depth = depth or pole_side * pole_side / width
        poles = Poles(
            turns=table.turns or math.exp(values["turns"]),
            resistance=1.0,
            width=width,
            depth=depth,
            leakage=math.exp(values["leakage"]) if table.leakage_H is None else table.leakage_H,
            iron_length=table.iron_length_m or IRON_LENGTH_PER_POLE_SIDE * pole_side,
            joints=math.exp(values["joints"]) if table.joints_m is None else table.joints_m,
        )
        saturation, knee_field = math.exp(values["saturation"]), math.exp(values["knee"])
        sharp_fraction = _logistic(values["sharp"])
        steel = NamedCells.model_construct(
            name=FROM_LOOPS,
            cells=PINNED_CELL_COUNT,
            reversible_fraction=_logistic(values["reversible"]),
            pinning_scale_A_per_m=math.exp(values["pinning"]),
            pinning_shape=math.exp(values["shape"]),
            saturation_sharp_T=saturation * sharp_fraction,
            knee_sharp_A_per_m=knee_field,
            saturation_slow_T=saturation * (1.0 - sharp_fraction),
            knee_slow_A_per_m=knee_field * math.exp(values["knee_ratio"]),
        )
        return poles, steel

    def _residuals(self, point: FloatArray) -> FloatArray:
        values = self._named_parameters(point)
        poles, steel = self._make_poles_and_steel(values)
        magnet = make_iron_magnet(poles, steel)
        zero_current = values["zero_current"] * self._max_current
        zero_force = values["zero_force"] * self._max_force
        deviations = [
            simulate_loop(make_path_follower(magnet), loop, zero_current) + zero_force - loop.output
            for loop in self.loops.loops
        ]
        return np.concatenate([self._weight * np.concatenate(deviations), point])


def _parameter_priors(loops: Loops, table: MagnetTable, max_force: float) -> dict[str, tuple[float, float]]:
    """Return the prior mean and standard deviation of all parameters, as logarithms or log odds."""
    area, expected_turns = MU_0 * max_force / MAX_FORCE_FLUX_DENSITY_T**2, 0.0
    width, depth = table.pole_width_m, table.pole_depth_m
    if width and depth:
        area = width * depth
    expected_turns = table.turns or math.sqrt(_estimate_turns_squared_area(loops) / area)
    pole_side = math.sqrt(area)
    expected_values = {
        "side": (math.log(pole_side), 1.0),
        "turns": (math.log(expected_turns), 2.0),
        "leakage": (math.log(MU_0 * pole_side), 1.0),
        "joints": (math.log(1e-3 * pole_side), 1.0),
        "knee": (math.log(250.0), 1.0),
        "pinning": (math.log(150.0), 1.5),
        "saturation": (math.log(1.9), 0.15),
        "sharp": (0.6, 0.5),
        "knee_ratio": (math.log(20.0), 0.7),
        "shape": (math.log(2.0), 0.5),
        "reversible": (math.log(0.2 / 0.8), 0.7),
        "zero_current": (0.0, 0.02),
        "zero_force": (0.0, 0.02),
    }
    is_fixed = {
        "side": bool(width and depth),
        "turns": table.turns is not None,
        "leakage": table.leakage_H is not None,
        "joints": table.joints_m is not None,
    }
    return {name: value for name, value in expected_values.items() if not is_fixed.get(name, False)}


def _estimate_turns_squared_area(loops: Loops) -> float:
    """Return turns^2 times the pole area, m^2, estimated with infinitely permeable iron."""
    estimates = []
    for loop in loops.loops:
        assert loop.schedule is not None
        max_force = float(np.max(loop.output))
        is_usable = (loop.output > 0.05 * max_force) & (loop.output < 0.4 * max_force) & (loop.input != 0.0)
        estimates += (loop.output * (2.0 * loop.schedule / loop.input) ** 2 / MU_0)[is_usable].tolist()
    return float(np.median(estimates)) if estimates else 1.0


def _logistic(odds: float) -> float:
    return 1.0 / (1.0 + math.exp(-odds))
