"""The model of an actuator: what identification gives, and what every use of it starts from.

Around the iron, whose law lives in the core, a model knows how drive and output reach it
(docs/theory.md)::

    c_H(gap) * (input - in_0) = H + rho(gap) * B / mu0 + gamma * dB/dt
    output                    = c_out(gap) * B**power + out_0

with ``power`` 2 for a force and 1 for everything else. A parameter is a number, or one number for
each node of the scheduling variable (:mod:`anhyst.model.gap_map` says what runs between the nodes).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import cached_property, lru_cache
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from anhyst._core import Iron
from anhyst.data.history import History
from anhyst.model.fit_record import FitFigures, Provenance, ReductionStep, Uncertainty, ValidRange
from anhyst.model.gap_map import Curve
from anhyst.support.arrays import FloatArray
from anhyst.support.errors import InputError
from anhyst.support.units import Quantity

if TYPE_CHECKING:
    from anhyst.model.acceptance import Acceptance, GapCheck
    from anhyst.model.predict import Prediction
    from anhyst.model.stepper import Stepper
Parameter = float | tuple[float, ...]
Law = Literal["effective-field", "jiles-atherton-1986"]
GapMap = Literal["none", "scaling", "reluctance", "circuit", "free"]

LAWS: tuple[Law, ...] = ("effective-field", "jiles-atherton-1986")
GAP_MAPS: tuple[GapMap, ...] = ("none", "scaling", "reluctance", "circuit", "free")

OPERATOR = ("M_s", "a", "k", "c", "alpha", "r_d")
"""Parameters of the iron itself. While one of them changes, the state has no meaning."""

DEFAULTS: Mapping[str, float] = MappingProxyType(
    {"alpha": 0.0, "r_d": 0.0, "rho": 0.0, "gamma": 0.0, "in_0": 0.0, "out_0": 0.0}
)
"""Parameters that may be left out, and what they are then."""

PARAMETERS = ("M_s", "a", "k", "c", "alpha", "r_d", "c_H", "rho", "gamma", "c_out", "in_0", "out_0")
"""Every parameter, in the order of the file."""

MAY_VARY: Mapping[GapMap, frozenset[str]] = MappingProxyType(
    {
        "none": frozenset(),
        "scaling": frozenset({"c_H", "c_out", "in_0", "out_0", "gamma"}),
        "reluctance": frozenset({"rho", "c_out", "in_0", "out_0", "gamma"}),
        "circuit": frozenset({"rho", "c_out", "in_0", "out_0", "gamma"}),
        "free": frozenset(PARAMETERS),
    }
)
"""What each gap map allows to run over the scheduling variable."""


@dataclass(frozen=True, slots=True)
class Problem:
    """One thing wrong with a set of parameters."""

    key: str
    text: str


def _range_problem(name: str, value: float) -> str | None:
    if not np.isfinite(value):
        return "is not a finite number"
    if name in {"M_s", "a", "k", "c_H", "c_out"} and value <= 0.0:
        return f"must be above 0, is {value:g}"
    if name in {"r_d", "gamma", "rho"} and value < 0.0:
        return f"must not be negative, is {value:g}"
    if name == "c" and not 0.0 <= value <= 1.0:
        return f"must lie within 0 and 1, is {value:g}"
    if name == "alpha" and value >= 1.0:
        return f"must be below 1, is {value:g}"
    return None


def find_problems(
    parameters: Mapping[str, Parameter], nodes: Sequence[float], gap_map: GapMap
) -> list[Problem]:
    """Find everything that is wrong with a set of parameters.

    Parameters
    ----------
    parameters : mapping of str to float or tuple of float
        As in :class:`ActuatorModel`.
    nodes : sequence of float
        Nodes of the scheduling variable, SI.
    gap_map : str
        One of :data:`GAP_MAPS`.

    Returns
    -------
    list of Problem
        Empty if nothing is wrong. The key is a parameter, ``"nodes"`` or ``"gap_map"``.
    """
    problems = []
    if gap_map not in GAP_MAPS:
        return [Problem("gap_map", f"is {gap_map!r}; use one of {', '.join(GAP_MAPS)}")]
    steps = np.diff(np.asarray(nodes, dtype=np.float64))
    if not np.isfinite(steps).all() or (steps <= 0.0).any():
        problems.append(Problem("nodes", "must be finite and ascend, without repeats"))
    for name in PARAMETERS:
        value = parameters.get(name)
        if value is None:
            if name not in DEFAULTS:
                problems.append(Problem(name, "is missing"))
            continue
        values = value if isinstance(value, tuple) else (value,)
        if isinstance(value, tuple):
            if len(value) != len(nodes):
                text = f"has {len(value)} values for {len(nodes)} nodes; give one for each node"
                problems.append(Problem(name, text))
            if name not in MAY_VARY[gap_map]:
                text = f"may not vary with the gap map '{gap_map}'; give a single number"
                problems.append(Problem(name, text))
        texts = (_range_problem(name, single) for single in values)
        problems.extend([Problem(name, text) for text in texts if text][:1])
    problems.extend(Problem(name, "is unknown") for name in parameters if name not in PARAMETERS)
    return problems


def _as_parameter(value: ArrayLike) -> Parameter:
    numbers = np.asarray(value, dtype=np.float64)
    return tuple(numbers.tolist()) if numbers.ndim else float(numbers)


@lru_cache(maxsize=256)
def _iron(m_s: float, a: float, k: float, c: float, alpha: float, r_d: float, law: Law) -> Iron:
    try:
        return Iron(m_s, a, k, c, alpha, r_d, law)
    except ValueError as error:
        raise InputError(f"model parameters: {error}") from error


@dataclass(frozen=True, slots=True)
class Circuit:
    """What surrounds the iron, one value a sample (scheduling variable already looked up)."""

    turns: FloatArray  # c_H, A/m per unit of the input
    rho: FloatArray
    eddy: FloatArray
    c_out: FloatArray
    in_0: FloatArray
    out_0: FloatArray
    power: int

    def magnetomotive(self, drive: FloatArray) -> FloatArray:
        """Drive in units of the input -> drive of the core, A/m."""
        with np.errstate(over="ignore"):  # the core refuses what is not finite, and says where
            product: FloatArray = self.turns * (drive - self.in_0)
        return product

    def drive(self, magnetomotive: FloatArray) -> FloatArray:
        """Drive of the core, A/m -> drive in units of the input."""
        return magnetomotive / self.turns + self.in_0

    def output(self, flux_density: FloatArray) -> FloatArray:
        """Flux density, T -> output in its own unit."""
        shaped = flux_density * flux_density if self.power == 2 else flux_density
        return self.c_out * shaped + self.out_0

    def flux_density(self, demand: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Demanded output -> flux density, T, and whether the demand can be reached.

        A force has two answers; the positive one is taken. A force below ``out_0`` has none: the
        flux density is then zero and the flag False.
        """
        shaped = (demand - self.out_0) / self.c_out
        if self.power == 1:
            return shaped, np.ones(shaped.shape, dtype=np.bool_)
        return np.sqrt(np.maximum(shaped, 0.0)), shaped >= 0.0


@dataclass(frozen=True)
class ActuatorModel:
    """A complete model: law, parameters, gap map, output map, history, valid range, origin.

    Parameters
    ----------
    name : str
        Free text.
    law : str
        ``"effective-field"`` or ``"jiles-atherton-1986"``.
    input, output : Quantity
        What drives the actuator and what it answers with.
    parameters : mapping of str to float or tuple of float
        SI; a tuple has one value for each node. ``M_s, a, k, r_d`` in A/m, ``c, alpha, rho``
        pure numbers, ``c_H`` in A/m per unit of the input, ``gamma`` in A s/(m T), ``c_out`` in
        units of the output per T (per T^2 for a force), ``in_0, out_0`` in units of input and
        output. Those in :data:`DEFAULTS` may be left out.
    gap_map : str
        ``"none"``, ``"scaling"``, ``"reluctance"``, ``"circuit"`` or ``"free"``.
    schedule : Quantity or None
        The scheduling variable.
    nodes : tuple of float
        Its values at which parameters were found, ascending, SI.
    history : History
        What happened before the first sample, unless a call says otherwise.
    valid : ValidRange or None
        Where the model was seen to hold.
    fit, uncertainty, reduction, provenance
        Records of the identification; see :mod:`anhyst.model.fit_record`.

    Raises
    ------
    InputError
        A parameter is missing, unknown, out of range or has the wrong number of values.

    Examples
    --------
    >>> from anhyst.support.units import QUANTITIES
    >>> iron = dict(M_s=4e5, a=30.0, k=20.0, c=0.2, c_H=1.0, c_out=1.0)
    >>> model = ActuatorModel("core", QUANTITIES["field"], QUANTITIES["flux_density"], iron)
    >>> model.predict([0.0, 100.0, 0.0]).output.round(3)
    array([0.   , 0.32 , 0.079])
    """

    name: str
    input: Quantity
    output: Quantity
    parameters: Mapping[str, Parameter]
    law: Law = "effective-field"
    gap_map: GapMap = "none"
    schedule: Quantity | None = None
    nodes: tuple[float, ...] = ()
    history: History = field(default_factory=lambda: History("demagnetised"))
    valid: ValidRange | None = None
    fit: FitFigures | None = None
    uncertainty: Uncertainty | None = None
    reduction: tuple[ReductionStep, ...] = ()
    provenance: Provenance = field(default_factory=Provenance)

    def __post_init__(self) -> None:
        given = {name: _as_parameter(value) for name, value in self.parameters.items()}
        nodes = tuple(float(node) for node in self.nodes)
        object.__setattr__(self, "nodes", nodes)
        if self.law not in LAWS:
            raise InputError(f"law: is {self.law!r}; use one of {', '.join(LAWS)}")
        problems = find_problems(given, nodes, self.gap_map)
        if problems:
            raise InputError(f"model parameter {problems[0].key}: {problems[0].text}")
        if nodes and self.schedule is None:
            raise InputError("model: there are nodes but no scheduling variable; name it")
        complete = {name: given.get(name, DEFAULTS.get(name, 0.0)) for name in PARAMETERS}
        object.__setattr__(self, "parameters", MappingProxyType(complete))

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle by value: caches and the read-only view of the parameters are not picklable."""
        kept = {f.name: getattr(self, f.name) for f in fields(self)}
        return _rebuild, (kept | {"parameters": dict(self.parameters)},)

    @property
    def power(self) -> int:
        """Power of the flux density in the output: 2 for a force, 1 otherwise."""
        return 2 if self.output.name == "force" else 1

    @property
    def varying(self) -> tuple[str, ...]:
        """Names of the parameters that really differ between nodes."""
        return tuple(
            name
            for name, value in self.parameters.items()
            if isinstance(value, tuple) and len(set(value)) > 1
        )

    @property
    def fixed_gap_only(self) -> bool:
        """Whether the scheduling variable must stand still during a run (a ``free`` gap map)."""
        return any(name in OPERATOR for name in self.varying)

    @property
    def needs_schedule(self) -> bool:
        """Whether a run has to say where the scheduling variable was."""
        return bool(self.varying)

    @cached_property
    def curves(self) -> Mapping[str, Curve]:
        """Every varying parameter as a curve over the scheduling variable."""
        nodes = np.array(self.nodes)
        return {name: Curve(name, nodes, np.array(self.parameters[name])) for name in self.varying}

    def over_schedule(self, name: str, at: ArrayLike) -> FloatArray:
        """Return one parameter at values of the scheduling variable.

        Parameters
        ----------
        name : str
            One of :data:`PARAMETERS`.
        at : array_like, shape (n,)
            Scheduling variable, SI.

        Returns
        -------
        ndarray, shape (n,)
            The parameter, SI.

        Raises
        ------
        InputError
            So far outside the nodes that the parameter leaves its range.
        """
        query = np.atleast_1d(np.asarray(at, dtype=np.float64))
        if name in self.curves and query.size:
            values = self.curves[name](query)
            for extreme in (values.min(), values.max()):
                if problem := _range_problem(name, float(extreme)):
                    raise InputError(
                        f"{name} {problem}, in the straight line beyond the nodes "
                        f"{self.nodes[0]:g} to {self.nodes[-1]:g}; stay nearer to them"
                    )
            return values
        value = self.parameters[name]
        return np.full(query.shape, value[0] if isinstance(value, tuple) else value)

    def parameters_at(self, schedule: float | None = None) -> dict[str, float]:
        """Return all parameters at one value of the scheduling variable.

        Parameters
        ----------
        schedule : float, optional
            Scheduling variable, SI; may be left out where nothing varies.

        Returns
        -------
        dict of str to float
            SI.

        Raises
        ------
        InputError
            The model needs the scheduling variable.
        """
        at = np.array([self.schedule_or_default(schedule)])
        return {name: float(self.over_schedule(name, at)[0]) for name in PARAMETERS}

    def schedule_or_default(self, schedule: float | None) -> float:
        """Return the scheduling variable, or any where it does not matter.

        Raises
        ------
        InputError
            It matters and was not given.
        """
        if schedule is not None:
            return float(schedule)
        if self.needs_schedule:
            assert self.schedule is not None
            raise InputError(
                f"the model runs over {self.schedule.name}: give it, in a file as column "
                f"{self.schedule.column}"
            )
        return self.nodes[0] if self.nodes else 0.0

    def iron_at(self, schedule: float | None = None) -> Iron:
        """Return the iron of the core at one value of the scheduling variable.

        Parameters
        ----------
        schedule : float, optional
            Scheduling variable, SI; matters only for a ``free`` gap map.

        Returns
        -------
        Iron
            It keeps no state and may be shared.

        Raises
        ------
        InputError
            The core refuses the parameters.
        """
        at = np.array([self.schedule_or_default(schedule) if self.fixed_gap_only else 0.0])
        values = (float(self.over_schedule(name, at)[0]) for name in OPERATOR)
        return _iron(*values, law=self.law)

    def circuit(self, schedule: FloatArray | None, eddy_rate: FloatArray) -> Circuit:
        """Return what surrounds the iron, sample by sample.

        Parameters
        ----------
        schedule : ndarray, shape (n,), or None
            Scheduling variable, SI.
        eddy_rate : ndarray, shape (n,)
            1/dt of each sample, 1/s; 0 where eddy currents do not count.

        Returns
        -------
        Circuit
            Arrays of shape (n,).
        """
        at = (
            np.full(eddy_rate.shape, self.schedule_or_default(None))
            if schedule is None
            else schedule
        )
        c_h, rho, gamma, c_out, in_0, out_0 = (
            self.over_schedule(name, at) for name in PARAMETERS[len(OPERATOR) :]
        )
        return Circuit(c_h, rho, gamma * eddy_rate, c_out, in_0, out_0, self.power)

    def predict(
        self,
        drive: ArrayLike,
        schedule: ArrayLike | None = None,
        time: ArrayLike | None = None,
        history: History | str | None = None,
    ) -> Prediction:
        """Compute the output that a drive gives; see :func:`anhyst.model.predict.predict`."""
        from anhyst.model.predict import predict

        return predict(self, drive, schedule, time, history)

    def invert(
        self,
        demand: ArrayLike,
        schedule: ArrayLike | None = None,
        time: ArrayLike | None = None,
        history: History | str | None = None,
    ) -> Prediction:
        """Compute the drive that a demanded output needs; see :func:`anhyst.model.predict.invert`."""
        from anhyst.model.predict import invert

        return invert(self, demand, schedule, time, history)

    def stepper(
        self, schedule: float | None = None, history: History | str | None = None
    ) -> Stepper:
        """Start the model for use sample by sample; see :class:`anhyst.model.stepper.Stepper`."""
        from anhyst.model.stepper import Stepper

        return Stepper(self, schedule, history)

    def check_over_gap(self) -> GapCheck | None:
        """Run the acceptance test over the gap; see :func:`anhyst.model.acceptance.check_over_gap`."""
        from anhyst.model.acceptance import check_over_gap

        return check_over_gap(self)

    def acceptance(self) -> Acceptance:
        """Run the whole acceptance test; see :func:`anhyst.model.acceptance.check_acceptance`."""
        from anhyst.model.acceptance import check_acceptance

        return check_acceptance(self)

    def is_monotone_over_gap(self) -> bool:
        """Whether the output rises at any fixed drive as the gap closes.

        The acceptance test of the paper (II.C) over a dense grid of gaps and both branches. True
        also where it does not apply: no gap, or a single one.
        """
        check = self.check_over_gap()
        return check is None or check.passed


def _rebuild(kept: dict[str, Any]) -> ActuatorModel:
    return ActuatorModel(**kept)
