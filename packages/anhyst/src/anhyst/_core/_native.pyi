"""Types of the binding; status 0 is success, `index` the first sample without a result."""

from collections.abc import Mapping, Sequence
from typing import Any, Self, overload

import numpy as np
from numpy.typing import NDArray

_Array = NDArray[np.float64]
_Reals = Sequence[float]
_Numbers = Mapping[str, float]
_Path = tuple[_Array, _Array, _Array, int, int]
AXES_ODD: int  # how much longer a head may say the very same than no number
POSITION_MAGNETS: int  # of a position controller, at most

class AnyIron:
    """A material in physical units, of any law: A/m, and T for flux density."""

    def forward(self, drive: _Array, rho: _Array, eddy: _Array, state: _Array) -> _Path:
        """Return flux density (T), field (A/m), state after, status, index."""
    def inverse(self, b: _Array, rho: _Array, eddy: _Array, state: _Array) -> _Path:
        """Return drive (A/m), field (A/m), state after, status, index."""
    def settle(
        self, given: _Array, rho: _Array, eddy: _Array, state: _Array,
        inverse: bool = False, max_cycles: int = 10000, tol: float = 1e-12,
    ) -> tuple[_Array, int, int]:  # fmt: skip
        """Repeat a cycle till it closes; return state, cycles, status."""
    def make_solid(self, layers: int, surface: float, laminated: float) -> None:
        """Cut it into layers; its state is then theirs, the surface first, and that of sheets."""
    def check_state(self, state: _Array) -> int:
        """Return the status of a state given from outside; ValueError for a wrong length."""
    def flux_of(self, state: _Array) -> float:
        """Return the flux density of a state, T."""

class Iron(AnyIron):
    """An iron of a law on the Langevin curve; its state is x/a, M_irr/M_s, p/a."""

    def __init__(
        self, m_s: float, a: float, k: float, c: float, alpha: float, r_d: float = 0.0,
        law: str = "effective-field", step: str = "exact",
    ) -> None: ...  # fmt: skip

class CellIron(AnyIron):
    """An iron of play cells; thresholds (n + 1), widths and centres (J), weights (n + 1, J), A/m.

    Its state is x, p_1 .. p_n, A/m; one that no drive leads to is clipped to one that is valid.
    ValueError if out of range.
    """

    def __init__(
        self, thresholds: _Array, widths: _Array, weights: _Array,
        shape: str = "tanh", alpha: float = 0.0, centres: _Array | None = None,
    ) -> None: ...  # fmt: skip
    @property
    def steepest(self) -> float:
        """Upper bound of dM/dx over all states, a thousandth above the largest that there is."""

class Operator:
    """The law in units of its own, M_s = a = 1; ValueError if out of range."""

    def __init__(
        self, kappa: float, c: float, play: float = 0.0, eps: float = 0.0,
        law: str = "effective-field", step: str = "exact",
    ) -> None: ...  # fmt: skip
    def run(self, omega: _Array, r: _Array, state: _Array) -> _Path:
        """Follow x + omega*m(x) = r; return x, m, state after, status, index."""
    def sensitivity(
        self, omega: _Array, r: _Array, omega_t: _Array, r_t: _Array,
        law_t: _Array, state: _Array, state_t: _Array,
    ) -> tuple[_Array, _Array, _Array, _Array, _Array, _Array, int, int]:  # fmt: skip
        """Follow the path and d tangents of it.

        omega_t, r_t: (n, d); law_t: (d, 3), by kappa, c and play; state_t: (d, 3).
        Return x, m (n), x_t, m_t (n, d), state after, tangents of it (d, 3), status, index.
        """

class CellOperator:
    """Play cells by their equation alone, A/m; arguments as those of `CellIron`."""

    def __init__(
        self, thresholds: _Array, widths: _Array, weights: _Array,
        shape: str = "tanh", aim: float = 1e-12, centres: _Array | None = None,
    ) -> None:  # fmt: skip
        """Lay tables whose error is `aim`, of the saturation."""
    @property
    def steepest(self) -> float:
        """Upper bound of dM/dx over all states."""
    def run(
        self, omega: _Array, r: _Array, begins: NDArray[np.int64]
    ) -> tuple[_Array, _Array, int]:
        """Return x, M, status along x + omega*M(x) = r; each drive begins demagnetised."""
    def sensitivity(
        self,
        omega: _Array,
        r: _Array,
        omega_t: _Array,
        r_t: _Array,
        weights_t: _Array,
        widths_t: _Array,
        thresholds_t: _Array,
        begins: NDArray[np.int64],
    ) -> tuple[_Array, _Array, _Array, _Array, int]:
        """Follow the same drives and d tangents of each.

        omega_t, r_t: (n, d); weights_t: (cells, widths, d); widths_t: (widths, d);
        thresholds_t: (cells, d). Return x, M (n), x_t, M_t (n, d), status.
        """

def batch(
    kappa: _Array,
    c: _Array,
    omega: _Array,
    scale: _Array,
    offset: _Array,
    drive: _Array,
    x: _Array,
    y: _Array,
    implicit: bool = True,
    keep: bool = True,
    level: str = ...,
) -> tuple[_Array, _Array]:
    """Follow one drive with many sets, r = scale*(drive - offset); x and y are advanced in place.

    Return m and x, (samples, sets), empty unless `keep`; ValueError if a set is out of range or
    the processor lacks the level; the best one unless said.
    """

def batch_functions(t: _Array, level: str = ...) -> tuple[_Array, _Array]:
    """Return exp(-|t|) and L(t) as the batch computes them at a level, the best unless said."""

def batch_levels() -> list[str]:
    """Return the levels of the batch that this processor has, the best last."""

def demagnetised() -> _Array:
    """Return the state of a demagnetised iron."""

def exp(x: _Array) -> _Array:
    """Return exp(x), with the same bits on every processor."""

def langevin(z: _Array) -> tuple[_Array, _Array]:
    """Return L(z) and L'(z)."""

def log(x: _Array) -> _Array:
    """Return log(x), with the same bits on every processor."""

def obstacle(
    command: int,
    state: int,
    conditioning: bool,
    plausible: bool,
    levitates: bool,
    resting: bool,
    at_zero: bool,
) -> str:
    """Return why a controller refuses a command, supervisor.h: '', 'state', 'current', 'unknown'."""

def status_text(status: int) -> str:
    """Return what a status means, in words."""

class FixedCompensator:
    """The fixed-point compensator of core/include/anhyst/compensator/compensator.h, bit for bit."""

    def __init__(self, kind: str, words: NDArray[np.int16]) -> None: ...
    def solve_q31(self, demand: int, gap: int) -> int: ...
    def solve_q15(self, demand: int, gap: int) -> int: ...
    def commit_q31(self, applied: int, gap: int) -> None: ...
    def commit_q15(self, applied: int, gap: int) -> None: ...
    def output_q31(self) -> int: ...
    def output_q15(self) -> int: ...
    @property
    def flags(self) -> int: ...
    def swap(self, words: NDArray[np.int16]) -> None: ...
    @property
    def memory(self) -> NDArray[np.int32]: ...
    def set_memory(self, words: NDArray[np.int32]) -> None: ...
    def run(
        self, demand: NDArray[np.int32], gap: NDArray[np.int32], q15: bool
    ) -> NDArray[np.int32]: ...
    def conditioning_length(self) -> int: ...
    def conditioning_q15(self, tick: int) -> int: ...

class Controller:
    """The position controller of pidd2_real.h in double precision; ValueError if out of range.

    ``gains`` is ``Pidd2.per_tick``. ``solve`` keeps its candidate for the ``commit`` that follows.
    """

    def __init__(self, gains: _Array) -> None: ...
    def start(self, reference: float, position: float, load: float, output: float) -> None:
        """Be at rest there, with the integral that makes the output be the given one."""
    def solve(self, reference: float, position: float, load: float) -> float:
        """Return the output of this tick, within its limits."""
    def commit(self, applied: float) -> None:
        """Go on to the next tick with the output that was applied."""
    def change(self, gains: _Array, reference: float, position: float, load: float) -> None:
        """Go over to other gains without a jump of the output."""
    @property
    def wanted(self) -> float:
        """The last output before its limits."""
    @property
    def state(self) -> tuple[float, float, float]:
        """Filtered position, velocity a tick, integral."""

class ControllerF32(Controller):
    """The same in single precision, its magnets too."""

class FixedController:
    """The same in fixed point, pidd2.h; ``gains`` is ``FixedPidd2.words``, signals are q31."""

    def __init__(self, gains: NDArray[np.int32]) -> None: ...
    def start(self, reference: int, position: int, load: int, output: int) -> None: ...
    def solve(self, reference: int, position: int, load: int) -> int: ...
    def commit(self, applied: int) -> None: ...
    def change(
        self, gains: NDArray[np.int32], reference: int, position: int, load: int
    ) -> None: ...
    @property
    def wanted(self) -> int:
        """The last output before its limits, q28."""
    @property
    def state(self) -> tuple[int, int, int]:
        """Filtered position and velocity a tick, q30; integral, q30 of the output."""

class _RealCompensator:
    """The floating-point compensator of core/include/anhyst/compensator/compensator_real.h, bit for bit.

    Signals in the model's units. A memory has five numbers: x, y, p, turn, level.
    """

    def solve(self, demand: float, gap: float) -> float: ...
    def commit(self, applied: float, gap: float) -> None: ...
    def output(self) -> float: ...
    @property
    def flags(self) -> int: ...
    @property
    def memory(self) -> _Array: ...
    def set_memory(self, values: _Array) -> None: ...
    def run(self, demand: _Array, gap: _Array) -> _Array: ...
    def conditioning_length(self) -> int: ...
    def conditioning(self, tick: int) -> float: ...

class Compensator(_RealCompensator):
    """In double precision."""

    def __init__(self, kind: str, words: _Array) -> None: ...
    def swap(self, words: _Array) -> None: ...

class CompensatorF32(_RealCompensator):
    """In single precision."""

    def __init__(self, kind: str, words: NDArray[np.float32]) -> None: ...
    def swap(self, words: NDArray[np.float32]) -> None: ...

class _RealForceController:
    """A controller of force_controller_real.h, bit for bit; signals in the model's units.

    Rows of a map stand for gaps, its columns for forces, from the lowest to the highest; `low` and
    `high` are the limits of the current. `loop` holds proportional, integral, back and smoothing of
    ``anhyst_flux_loop``; :meth:`fuse` puts one around a compensator. ValueError if something is not valid.
    """

    @classmethod
    def map(
        cls, entries: _Array, force_low: float, force_high: float, gap_low: float,
        gap_high: float, low: float, high: float,
    ) -> Self: ...  # fmt: skip
    @classmethod
    def flux(
        cls, entries: _Array, wanted: _Array, loop: _Array, force_low: float, force_high: float,
        gap_low: float, gap_high: float, low: float, high: float,
    ) -> Self: ...  # fmt: skip
    def fuse(
        self, wanted: _Array, loop: _Array, most: float, force_low: float, force_high: float,
        gap_low: float, gap_high: float, low: float, high: float,
    ) -> None: ...  # fmt: skip
    def solve(self, demand: float, gap: float, flux: float) -> float:
        """Return the current for a force; `flux` is the measured density, T, or NaN."""
    def commit(self, applied: float, gap: float) -> float:
        """Advance with the current that was applied; return the force to expect."""
    def follow(self, applied: _Array, gap: _Array) -> _Array: ...  # commits a path
    @property
    def flags(self) -> int: ...
    def conditioning_length(self) -> int: ...
    def conditioning(self, tick: int) -> float: ...

class ForceController(_RealForceController):
    @staticmethod
    def compensator(kind: str, words: _Array) -> ForceController: ...
    @staticmethod
    def play(words: _Array) -> ForceController: ...

class ForceControllerF32(_RealForceController):
    @staticmethod
    def compensator(kind: str, words: NDArray[np.float32]) -> ForceControllerF32: ...
    @staticmethod
    def play(words: NDArray[np.float32]) -> ForceControllerF32: ...

_Words = NDArray[np.int16]

class FixedForceController:
    """The same in fixed point, force_controller.h; signals are q31, entries of a map q15."""

    @staticmethod
    def map(entries: _Words, low: int, high: int) -> FixedForceController: ...
    @staticmethod
    def play(words: _Words) -> FixedForceController: ...
    @staticmethod
    def compensator(kind: str, words: _Words) -> FixedForceController: ...
    @staticmethod
    def flux(
        entries: _Words, wanted: _Words, loop: _Words, low: int, high: int
    ) -> FixedForceController:
        """Make one; a row of `loop` is mantissa and shift of a factor."""
    def fuse(self, wanted: _Words, loop: _Words, most: int, low: int, high: int) -> None: ...
    def solve(self, demand: int, gap: int, flux: int) -> int:
        """Return the current for a force; `flux` is the measured density, or -2^31 for none."""
    def commit(self, applied: int, gap: int) -> int:
        """Advance with the current that was applied; return the force to expect."""
    def follow(self, applied: _Array, gap: _Array) -> _Array: ...  # commits a path of codes
    @property
    def flags(self) -> int: ...
    def conditioning_length(self) -> int: ...
    def conditioning(self, tick: int) -> int: ...

class Steel:
    """What an iron of the plant is made of, plant/include/anhyst_plant/iron.h.

    Of pinned cells with thresholds and weights, of relays with an Everett table, or of Duhem's kind
    with numbers alone.
    """

    @overload
    def __init__(self, numbers: _Numbers, thresholds: _Array, weights: _Array) -> None: ...
    @overload
    def __init__(self, numbers: _Numbers, everett: _Array) -> None: ...
    @overload
    def __init__(self, numbers: _Numbers) -> None: ...

class Piece:
    """A piece of steel with its memory; starts demagnetised."""

    def __init__(self, steel: Steel) -> None: ...
    def flux_density(self, field: float) -> tuple[float, float]: ...  # T and slope, straight there
    def commit(self, field: float) -> None: ...  # moves straight to a field (A/m)
    def solve(self, a: float, b: float, r: float) -> float: ...  # to H where a*H + b*B = r
    def run(self, field: _Array) -> _Array: ...  # rows of field (A/m) and flux density (T)
    def demagnetise(self) -> None: ...  # forgets everything
    @property
    def field(self) -> float: ...
    @property
    def density(self) -> float: ...

class Magnet:
    """An electromagnet, plant/include/anhyst_plant/magnet.h: an iron, or a law and a table."""

    @overload
    def __init__(self, numbers: _Numbers, steel: Steel, cone: _Numbers) -> None: ...
    @overload
    def __init__(self, numbers: _Numbers, steel: Steel, *solid: float | _Array) -> None: ...
    @overload
    def __init__(self, numbers: _Numbers, iron: AnyIron, rows: _Array, psi: _Array) -> None: ...

class Coil:
    """The winding of a magnet with its memory; starts demagnetised."""

    def __init__(self, magnet: Magnet) -> None: ...
    def hold(self, current: float, gap: float) -> float: ...  # slowly; the pull there (N)
    def lead(self, current: float, gap: float, seconds: float) -> None: ...  # under any voltage
    def step(self, voltage: float, gap: float, seconds: float) -> None: ...  # under a voltage
    def run(self, current: _Array, gap: _Array, seconds: float = ...) -> _Array:
        """Hold, or lead in `seconds` each; rows of force (N), flux linkage (Wb), flux density (T)."""
    @property
    def force(self) -> float: ...
    @property
    def psi(self) -> float: ...
    @property
    def density(self) -> float: ...
    @property
    def current(self) -> float: ...
    @property
    def heat(self) -> float: ...
    @property
    def energy(self) -> float: ...

class Sensor:
    """A sensor by the names of plant/include/anhyst_plant/sensor.h; noise comes from outside."""

    def __init__(self, numbers: _Numbers) -> None: ...
    def run(self, values: _Array, noise: _Array) -> _Array: ...

class HeldPlant:
    """An actuator whose armature is moved, by the names of plant/include/anhyst_plant/held.h."""

    def __init__(self, numbers: _Numbers, sensors: Sequence[_Numbers], magnet: Magnet) -> None: ...
    def hold(self, current: float, gap: float) -> None: ...  # slowly and past the amplifier
    def run(self, reference: _Array, gap: _Array, noise: _Array) -> _Array: ...  # a row a tick

class Plant:
    """A body at rest, irons demagnetised, by the names of plant/include/anhyst_plant/body.h."""

    def __init__(
        self,
        body: Mapping[str, Any],
        actuators: Sequence[Mapping[str, Any]],
        heads: Sequence[Mapping[str, Any]],
        load: Mapping[str, Any],
        magnets: Sequence[Magnet],
        seed: int,
    ) -> None: ...
    def read(self) -> tuple[list[float], list[float], list[float], float]:
        """Return heads (m), currents (A), flux densities (T; NaN without probe), force (N)."""
    def advance(self, commands: Sequence[float], load: float) -> None:
        """Go on by one tick with commands to the amplifiers and to the load drive (N)."""
    def place(self, pose: Sequence[float], velocity: Sequence[float]) -> None:
        """Put the body somewhere; a number each free coordinate, m or rad, and a second."""
    def set_load(self, damping: float, stiffness: float) -> None:
        """Let the load drive render another damping, N s/m, and stiffness, N/m."""
    def hold(self, current: float, magnet: int) -> None:
        """Let a current flow that has come slowly, A."""

    supply: float  # of all amplifiers, V; the one number here that may be set
    pose: list[float]  # of each free coordinate, m or rad
    velocities: list[float]
    wrench: list[float]  # of the magnets, N or N m
    gap: float  # of the first magnet, m
    velocity: float  # of the first coordinate, m/s
    force: float  # of the magnets, net, as the force sensor is turned, N
    current: float  # of the first magnet, A
    psi: float  # Wb
    def coils(self) -> _Array:
        """Return a row each magnet: gap, m, current, A, linkage, Wb, pull, N, energy, heat, J."""

class LoopController:
    """What a loop takes for a controller."""

class _Position(LoopController):
    def tick(
        self,
        gap: float,
        target: float,
        load: float = 0.0,
        current: tuple[float, float] = ...,
        flux: tuple[float, float] = ...,
        command: int = 0,
    ) -> tuple[float, float, float, float, int, int]:
        """Return both currents, reference (a gap), demand, 16*state + phase, flags; SI."""
    @property
    def fault(self) -> int:
        """First reason of a fault, levitation.h."""

class _RealPosition(_Position):
    def __init__(
        self,
        gains: _Array,
        magnets: list[ForceController] | list[ForceControllerF32],
        settings: _Numbers,
    ) -> None: ...

class Position(_RealPosition):
    """A controller of position_real.h by the numbers of ``PositionControl``, one or two magnets."""

class PositionF32(_RealPosition):
    """The same in single precision, with force controllers of that."""

class FixedPosition(_Position):
    """The same in fixed point, position.h; signals of `tick` are SI here too."""

    def __init__(
        self, gains: NDArray[np.int32], magnets: list[FixedForceController], settings: _Numbers
    ) -> None: ...

class BusController(LoopController):
    """A firmware as the controller of a loop, plant/include/anhyst_plant/bus.h."""

    def __init__(self, tick: int, firmware: int, scales: _Numbers) -> None: ...  # addresses
    def take(self) -> NDArray[np.uint32]: ...  # its answers since the last time, a row a tick
    def end(self) -> None: ...  # before its firmware is unloaded
    @property
    def tick(self) -> int:
        """Number of the last sample; 0 before the first."""

_Rows = Mapping[str, _Array]
_Drive = ForceController | ForceControllerF32 | FixedForceController

class WrenchLayout:
    """Drives that only pull, around a body, by the names of core/include/anhyst/control/wrench.h."""

    def __init__(  # forces: idle, least and most, N
        self, pull: _Array, against: Sequence[int], kind: int, *forces: float, yields: _Reals
    ) -> None: ...
    def lose(self, drive: int) -> None: ...  # from 0 on
    def share(self, wrench: Sequence[float]) -> tuple[list[float], bool]:
        """Return the forces, N, for a wrench, N and N m, and whether they make it."""

class _Axes(LoopController):
    # currents, wrench, flags, what is lost bit by bit, state as in axes.h; heads off target, m
    def tick(
        self, head: _Reals, forward: _Reals, gap: _Reals, read: _Reals, command: int = 0
    ) -> tuple[list[float], list[float], int, int, int]: ...

class TrackingAxes(_Axes):
    """PIDs of several axes and allocation, core/include/anhyst/control/axes.h: rows as there."""

    def __init__(
        self, magnets: list[_Drive], layout: WrenchLayout, rows: _Rows, settings: _Numbers
    ) -> None: ...
    def correct(self, rows: _Array) -> None: ...  # an anhyst_correction a magnet

class TrackingAxesF32(TrackingAxes): ...  # in single precision, its magnets too

class FixedWrench:
    """A WrenchLayout in fixed point: tables and numbers of ``control.fixed_axes``, signals as codes."""

    def __init__(self, words: _Rows, settings: Mapping[str, int]) -> None: ...
    def lose(self, drive: int) -> None: ...  # from 0 on
    def share(self, wrench: Sequence[int]) -> tuple[list[int], bool]: ...

class FixedAxes(_Axes):
    """TrackingAxes in fixed point, `tick` in codes; `scales`: full scales of the signals in a loop."""

    def __init__(
        self, magnets: list[_Drive], words: _Rows, settings: Mapping[str, int],
        scales: Mapping[str, float | list[float]],
    ) -> None: ...  # fmt: skip

class PiezoMotion:
    """A piezo stack that pushes a stage, plant/include/anhyst_plant/piezo.h."""

    def __init__(self, stage: _Numbers, creep_times: _Array, creep_shares: _Array) -> None: ...
    def run(self, command: _Array) -> _Array: ...  # where it is at each tick, m, from long rest

class PiezoLoop:
    """A piezo stage and its controller from rest; rows: place, read, corrected (m), voltage."""

    def __init__(self, motion: PiezoMotion, sensor_step: float) -> None: ...
    def control(
        self,
        drive: _Drive,
        filters: list[_Array],
        pid: _Array,
        settings: _Numbers,
        change: float | None = None,
    ) -> None:
        """Put a controller in force, at rest or as the last one left off, its integral changed."""
    def run(self, wanted: _Array, expected: _Array, noise: _Array, load: _Array) -> _Array: ...

class PlantLoop:
    """A plant and its controller in lock-step, plant/include/anhyst_plant/loop.h."""

    def __init__(
        self, plant: Plant, controller: LoopController, current_loops: Sequence[_Numbers]
    ) -> None: ...
    @property
    def signals(self) -> list[tuple[str, str, int]]:
        """Columns of its record: signal, unit, and of which magnet, head or coordinate, from 1."""
    def run(
        self,
        target: _Array,
        load: _Array,
        inject: _Array,
        feed: _Array,
        command: NDArray[np.uint32],
        frame: _Array | None = None,
    ) -> _Array:
        """Go on tick by tick; a row a tick, fewer where a number ceased to be finite.

        Of all but load and command a number a free coordinate each tick, one tick after the other.
        """
