"""Types of the binding. Status 0 is success; `index` is the first sample without a result."""

from collections.abc import Mapping, Sequence
from typing import Any, Self, overload

import numpy as np
from numpy.typing import NDArray

_Array = NDArray[np.float64]
_Reals = Sequence[float]
_Numbers = Mapping[str, float]
_Path = tuple[_Array, _Array, _Array, int, int]
AXES_ODD: int  # weight of a jump or a missing sample of a head, relative to an unchanged sample
POSITION_MAGNETS: int  # maximum number of magnets of a position controller

class AnyIron:
    """A material with any hysteresis law, in physical units: fields in A/m, flux densities in T."""

    def forward(self, drive: _Array, rho: _Array, eddy: _Array, state: _Array) -> _Path:
        """Return flux density (T), field (A/m), final state, status, index."""
    def inverse(self, b: _Array, rho: _Array, eddy: _Array, state: _Array) -> _Path:
        """Return drive (A/m), field (A/m), final state, status, index."""
    def settle(
        self, given: _Array, rho: _Array, eddy: _Array, state: _Array,
        inverse: bool = False, max_cycles: int = 10000, tol: float = 1e-12,
    ) -> tuple[_Array, int, int]:  # fmt: skip
        """Repeat a cycle until it closes; return state, cycles, status."""
    def make_solid(self, layers: int, surface: float, laminated: float) -> None:
        """Divide the iron into layers; the state is that of all, the surface first, sheets last."""
    def set_eddy_circuit(self, leaky: float, leaky_delay: float, excess: float) -> None:
        """Set leaky fraction, its delay divided by gamma, T m/A, and excess field, sqrt(A/m).

        With a leaky fraction, the flux density inside the ring is the last number of the state.
        """
    def check_state(self, state: _Array) -> int:
        """Return the status of a state from outside; raise ValueError if its length is wrong."""
    def flux_of(self, state: _Array) -> float:
        """Return the flux density of a state, T."""

class Iron(AnyIron):
    """An iron of a law with the Langevin curve; its state is x/a, M_irr/M_s, p/a."""

    def __init__(
        self, m_s: float, a: float, k: float, c: float, alpha: float, r_d: float = 0.0,
        law: str = "effective-field", step: str = "exact",
    ) -> None: ...  # fmt: skip

class CellIron(AnyIron):
    """An iron of play cells; thresholds (n + 1), widths, centres (J), weights (n + 1, J), in A/m.

    Its state is x, p_1 .. p_n in A/m. A state that no drive leads to is clipped to a valid one.
    ValueError if a parameter is out of range.
    """

    def __init__(
        self, thresholds: _Array, widths: _Array, weights: _Array,
        shape: str = "tanh", alpha: float = 0.0, centres: _Array | None = None,
    ) -> None: ...  # fmt: skip
    @property
    def steepest(self) -> float:
        """Upper bound of dM/dx over all states, 0.1 % above the largest value."""

class Operator:
    """The law in normalised units, M_s = a = 1; ValueError if a parameter is out of range."""

    def __init__(
        self, kappa: float, c: float, play: float = 0.0, eps: float = 0.0,
        law: str = "effective-field", step: str = "exact",
    ) -> None: ...  # fmt: skip
    def run(self, omega: _Array, r: _Array, state: _Array) -> _Path:
        """Follow x + omega*m(x) = r; return x, m, final state, status, index."""
    def sensitivity(
        self, omega: _Array, r: _Array, omega_t: _Array, r_t: _Array,
        law_t: _Array, state: _Array, state_t: _Array,
    ) -> tuple[_Array, _Array, _Array, _Array, _Array, _Array, int, int]:  # fmt: skip
        """Follow the path and its d tangents.

        omega_t, r_t: (n, d); law_t: (d, 3), for kappa, c and play; state_t: (d, 3). Return x, m
        (n), x_t, m_t (n, d), final state, its tangents (d, 3), status, index.
        """

class CellOperator:
    """The equation of play cells, in A/m; arguments as for `CellIron`."""

    def __init__(
        self, thresholds: _Array, widths: _Array, weights: _Array,
        shape: str = "tanh", aim: float = 1e-12, centres: _Array | None = None,
    ) -> None:  # fmt: skip
        """Create tables whose error is at most `aim`, relative to saturation."""
    @property
    def steepest(self) -> float:
        """Upper bound of dM/dx over all states."""
    def run(self, omega: _Array, r: _Array, begins: NDArray[np.int64]) -> tuple[_Array, _Array, int]:
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

        omega_t, r_t: (n, d); weights_t: (cells, widths, d); widths_t: (widths, d); thresholds_t:
        (cells, d). Return x, M (n), x_t, M_t (n, d), status.
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
    """Follow one drive with many sets, r = scale*(drive - offset); x and y are updated in place.

    Return m and x, (samples, sets); both are empty unless `keep`. `level` is the best one of the
    processor by default. ValueError if a set is out of range or the processor lacks the level.
    """

def batch_functions(t: _Array, level: str = ...) -> tuple[_Array, _Array]:
    """Return exp(-|t|) and L(t) as the batch computes them at a level; default: the best level."""

def batch_levels() -> list[str]:
    """Return the batch levels that this processor supports; the best is last."""

def demagnetised() -> _Array:
    """Return the state of demagnetised iron."""

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
    """Return why a controller refuses a command (supervisor.h): '', 'state', 'current', 'unknown'."""

def status_text(status: int) -> str:
    """Return the meaning of a status in words."""

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
    def run(self, demand: NDArray[np.int32], gap: NDArray[np.int32], q15: bool) -> NDArray[np.int32]: ...
    def conditioning_length(self) -> int: ...
    def conditioning_q15(self, tick: int) -> int: ...

class Controller:
    """The position controller of pidd2_real.h in double precision; ValueError if out of range.

    ``gains`` is ``Pidd2.per_tick``. ``solve`` keeps its trial step for the next ``commit``.
    """

    def __init__(self, gains: _Array) -> None: ...
    def start(self, reference: float, position: float, load: float, output: float) -> None:
        """Start at rest at this position, with the integral that gives this output."""
    def solve(self, reference: float, position: float, load: float) -> float:
        """Return the output of this tick, within its limits."""
    def commit(self, applied: float) -> None:
        """Advance to the next tick with the output that was applied."""
    def change(self, gains: _Array, reference: float, position: float, load: float) -> None:
        """Change the gains without a jump of the output."""
    @property
    def wanted(self) -> float:
        """Last output before its limits."""
    @property
    def state(self) -> tuple[float, float, float]:
        """Filtered position, velocity per tick, integral."""

class ControllerF32(Controller):
    """The position controller in single precision, together with its magnets."""

class FixedController:
    """The position controller in fixed point, pidd2.h; gains: ``FixedPidd2.words``, signals: q31."""

    def __init__(self, gains: NDArray[np.int32]) -> None: ...
    def start(self, reference: int, position: int, load: int, output: int) -> None: ...
    def solve(self, reference: int, position: int, load: int) -> int: ...
    def commit(self, applied: int) -> None: ...
    def change(self, gains: NDArray[np.int32], reference: int, position: int, load: int) -> None: ...
    @property
    def wanted(self) -> int:
        """Last output before its limits, q28."""
    @property
    def state(self) -> tuple[int, int, int]:
        """Filtered position and velocity per tick, q30; integral, q30 of the output."""

class _RealCompensator:
    """The floating-point compensator of include/anhyst/compensator/compensator_real.h, bit for bit.

    Signals are in the units of the model. A state has five values: x, y, p, turn, level.
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
    """A compensator in double precision."""

    def __init__(self, kind: str, words: _Array) -> None: ...
    def swap(self, words: _Array) -> None: ...

class CompensatorF32(_RealCompensator):
    """A compensator in single precision."""

    def __init__(self, kind: str, words: NDArray[np.float32]) -> None: ...
    def swap(self, words: NDArray[np.float32]) -> None: ...

class _RealForceController:
    """A controller of force_controller_real.h, bit for bit; signals in the units of the model.

    Rows of a map are gaps and columns are forces, both ascending; `low` and `high` are the limits
    of the current. `loop` contains proportional, integral, back and smoothing of
    ``anhyst_flux_loop``; :meth:`fuse` adds such a loop to a compensator. ValueError if a value is
    not valid.
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
    def sense(self, settings: _Array) -> None:
        """Estimate the flux from a coil's voltage, the `flux` of solve: ``anhyst_coil_flux_settings``."""
    def estimate(self) -> list[float]: ...  # law, flux; offset and resistance per tick
    def solve(self, demand: float, gap: float, flux: float) -> float:
        """Return the current for a force; `flux` is the measured flux density, T, or NaN."""
    def commit(self, applied: float, gap: float) -> float:
        """Advance with the current that was applied; return the expected force."""
    def follow(self, applied: _Array, gap: _Array) -> _Array: ...  # commits a path; expected forces
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
    """A force controller in fixed point, force_controller.h; signals are q31, map entries q15."""

    @staticmethod
    def map(entries: _Words, low: int, high: int) -> FixedForceController: ...
    @staticmethod
    def play(words: _Words) -> FixedForceController: ...
    @staticmethod
    def compensator(kind: str, words: _Words) -> FixedForceController: ...
    @staticmethod
    def flux(entries: _Words, wanted: _Words, loop: _Words, low: int, high: int) -> FixedForceController:
        """Create one with a flux loop; a row of `loop` is mantissa and shift of a factor."""
    def fuse(self, wanted: _Words, loop: _Words, most: int, low: int, high: int) -> None: ...
    def sense(self, settings: NDArray[np.int32]) -> None: ...
    def estimate(self) -> list[float]: ...
    def solve(self, demand: int, gap: int, flux: int) -> int:
        """Return the current for a force; `flux`: measured flux density, or -2^31 for none."""
    def commit(self, applied: int, gap: int) -> int:
        """Advance with the current that was applied; return the expected force."""
    def follow(self, applied: _Array, gap: _Array) -> _Array: ...  # commits codes
    @property
    def flags(self) -> int: ...
    def conditioning_length(self) -> int: ...
    def conditioning(self, tick: int) -> int: ...

class Steel:
    """A material of the simulated plant, plant/include/anhyst_plant/iron.h.

    It consists of pinned play cells with thresholds and weights, of Preisach relays with an Everett
    table, or it is a Duhem model with numbers only.
    """

    @overload
    def __init__(self, numbers: _Numbers, thresholds: _Array, weights: _Array) -> None: ...
    @overload
    def __init__(self, numbers: _Numbers, everett: _Array) -> None: ...
    @overload
    def __init__(self, numbers: _Numbers) -> None: ...

class Piece:
    """A piece of steel with its hysteresis state; it starts demagnetised."""

    def __init__(self, steel: Steel) -> None: ...
    def flux_density(self, field: float) -> tuple[float, float]: ...  # T, and slope in T m/A
    def commit(self, field: float) -> None: ...  # moves the field to a value (A/m)
    def solve(self, a: float, b: float, r: float) -> float: ...  # to H with a*H + b*B = r
    def run(self, field: _Array) -> _Array: ...  # rows of field (A/m) and flux density (T)
    def demagnetise(self) -> None: ...  # resets the state
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
    """The winding of a magnet with its state; it starts demagnetised."""

    def __init__(self, magnet: Magnet) -> None: ...
    def hold(self, current: float, gap: float) -> float: ...  # slowly; returns the pull (N)
    def lead(self, current: float, gap: float, seconds: float) -> None: ...  # any voltage
    def step(self, voltage: float, gap: float, seconds: float) -> None: ...  # given voltage
    def run(self, current: _Array, gap: _Array, seconds: float = ...) -> _Array:
        """Apply currents slowly or in `seconds` each; rows: force (N), linkage (Wb), density (T)."""
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
    """A sensor with the settings of anhyst_plant/sensor.h; the caller supplies the noise."""

    def __init__(self, numbers: _Numbers) -> None: ...
    def run(self, values: _Array, noise: _Array) -> _Array: ...

class HeldPlant:
    """An actuator whose armature is moved, with the settings of anhyst_plant/held.h."""

    def __init__(self, numbers: _Numbers, sensors: Sequence[_Numbers], magnet: Magnet) -> None: ...
    def hold(self, current: float, gap: float) -> None: ...  # slowly, without the amplifier
    def run(self, reference: _Array, gap: _Array, noise: _Array) -> _Array: ...  # a row per tick

class Plant:
    """A body at rest with demagnetised irons, with the settings of anhyst_plant/body.h."""

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
        """Advance by one tick with commands to the amplifiers and a force of the load drive (N)."""
    def place(self, pose: Sequence[float], velocity: Sequence[float]) -> None:
        """Set pose and velocity; one value per free coordinate, m or rad, and per second."""
    def set_load(self, damping: float, stiffness: float) -> None:
        """Set the damping (N s/m) and the stiffness (N/m) that the load drive emulates."""
    def hold(self, current: float, magnet: int) -> None:
        """Set the current of a magnet (A), as if it had been reached slowly."""

    supply: float  # supply of all amplifiers, V; the only writable value
    pose: list[float]  # pose in each free coordinate, m or rad
    velocities: list[float]
    wrench: list[float]  # wrench of the magnets, N or N m
    gap: float  # gap of the first magnet, m
    velocity: float  # velocity of the first coordinate, m/s
    force: float  # net force of the magnets along the force sensor, N
    current: float  # current of the first magnet, A
    psi: float  # flux linkage of the first magnet, Wb
    def coils(self) -> _Array:
        """Return rows per magnet: gap (m), current (A), linkage (Wb), pull (N), energy, heat (J)."""

class LoopController:
    """A controller that a simulated loop can run."""

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
        """Return both currents, reference (a gap), demand, 16*state + phase, flags; in SI units."""
    @property
    def fault(self) -> int:
        """Reason of the first fault, levitation.h."""

class _RealPosition(_Position):
    def __init__(
        self, gains: _Array, magnets: list[ForceController] | list[ForceControllerF32], settings: _Numbers
    ) -> None: ...

class Position(_RealPosition):
    """A controller of position_real.h with ``PositionControl`` settings, for 1 or 2 magnets."""

class PositionF32(_RealPosition):
    """The position controller in single precision, with single-precision force controllers."""

class FixedPosition(_Position):
    """The position controller in fixed point, position.h; the signals of `tick` are in SI units."""

    def __init__(
        self, gains: NDArray[np.int32], magnets: list[FixedForceController], settings: _Numbers
    ) -> None: ...

class BusController(LoopController):
    """A firmware as the controller of a loop, plant/include/anhyst_plant/bus.h."""

    def __init__(self, tick: int, firmware: int, scales: _Numbers) -> None: ...  # addresses
    def take(self) -> NDArray[np.uint32]: ...  # answers since the last call, a row per tick
    def end(self) -> None: ...  # call before its firmware is unloaded
    @property
    def tick(self) -> int:
        """Number of the last sample; 0 before the first one."""

_Rows = Mapping[str, _Array]
_Drive = ForceController | ForceControllerF32 | FixedForceController

class WrenchLayout:
    """Magnets that only pull, around a body, with the names of anhyst/control/wrench.h."""

    def __init__(  # forces: idle, minimum and maximum, N
        self, pull: _Array, against: Sequence[int], kind: int, *forces: float, yields: _Reals
    ) -> None: ...
    def lose(self, drive: int) -> None: ...  # index from 0
    def share(self, wrench: Sequence[float]) -> tuple[list[float], bool]:
        """Return the forces (N) for a wrench (N and N m), and whether they produce it."""

class _Axes(LoopController):
    # currents, wrench, flags, bit mask of lost drives, state as in axes.h; head deviations, m
    def tick(
        self, head: _Reals, forward: _Reals, gap: _Reals, read: _Reals, command: int = 0
    ) -> tuple[list[float], list[float], int, int, int]: ...

class TrackingAxes(_Axes):
    """PID controllers of several axes with allocation, core/include/anhyst/control/axes.h."""

    def __init__(
        self, magnets: list[_Drive], layout: WrenchLayout, rows: _Rows, settings: _Numbers
    ) -> None: ...
    def correct(self, rows: _Array) -> None: ...  # one anhyst_correction per magnet

class TrackingAxesF32(TrackingAxes): ...  # in single precision, with its magnets

class FixedWrench:
    """A WrenchLayout in fixed point: tables of ``control.fixed_axes``; signals are codes."""

    def __init__(self, words: _Rows, settings: Mapping[str, int]) -> None: ...
    def lose(self, drive: int) -> None: ...  # index from 0
    def share(self, wrench: Sequence[int]) -> tuple[list[int], bool]: ...

class FixedAxes(_Axes):
    """TrackingAxes in fixed point, `tick` in codes; `scales`: full scales of the signals."""

    def __init__(
        self, magnets: list[_Drive], words: _Rows, settings: Mapping[str, int],
        scales: Mapping[str, float | list[float]],
    ) -> None: ...  # fmt: skip

class PiezoMotion:
    """A piezo stack that moves a stage, plant/include/anhyst_plant/piezo.h."""

    def __init__(self, stage: _Numbers, creep_times: _Array, creep_shares: _Array) -> None: ...
    def run(self, command: _Array) -> _Array: ...  # position at each tick, m, after a long rest

class PiezoLoop:
    """A piezo stage and its controller; rows: position, reading, corrected (m), voltage (V)."""

    def __init__(self, motion: PiezoMotion, sensor_step: float) -> None: ...
    def control(
        self,
        drive: _Drive,
        filters: list[_Array],
        pid: _Array,
        settings: _Numbers,
        change: float | None = None,
    ) -> None:
        """Start a controller at rest, or continue from the previous one with a changed integral."""
    def run(self, wanted: _Array, expected: _Array, noise: _Array, load: _Array) -> _Array: ...

class PlantLoop:
    """A plant and its controller in lock-step, plant/include/anhyst_plant/loop.h."""

    def __init__(
        self, plant: Plant, controller: LoopController, current_loops: Sequence[_Numbers]
    ) -> None: ...
    @property
    def signals(self) -> list[tuple[str, str, int]]:
        """Columns of the record: signal, unit, number of magnet, head or coordinate, from 1."""
    def run(
        self,
        target: _Array,
        load: _Array,
        inject: _Array,
        feed: _Array,
        command: NDArray[np.uint32],
        frame: _Array | None = None,
    ) -> _Array:
        """Run tick by tick; return one row per tick, and fewer rows if a value is no longer finite.

        All arguments except load and command have one value per free coordinate and tick, tick
        after tick.
        """
