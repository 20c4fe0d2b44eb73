"""The measured frequency response of a position loop: margins, zone, files and python-control."""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from anhyst.control.exchange import control_library
from anhyst.support.atomic import PathLike, atomic_writer, read_error
from anhyst.support.errors import InputError
from anhyst.support.numeric import FloatArray
from anhyst.support.result import Result
from anhyst_rigs.study.bearing.linear import Zone, find_zone
from anhyst_rigs.study.response.multisine import ComplexArray

if TYPE_CHECKING:
    from control import FrequencyResponseData
    from matplotlib.axes import Axes

ResponseName = Literal["closed_loop", "sensitivity", "plant"]
RESPONSE_NAMES: tuple[ResponseName, ...] = get_args(ResponseName)

MIN_COHERENCE = 0.95
"""Smallest coherence of a value that is stated."""
UNCERTAINTY_SIGMAS = 4.0
"""Number of standard deviations in a stated uncertainty. In simulated linear loops, the deviations are
1.2 times as large as the standard deviation from neighbouring lines."""
EXACT_UNCERTAINTY_DB = 0.3
"""Uncertainty up to which a point counts as exact; its phase is then exact to 2 degrees."""
_MAX_NEIGHBOUR_RATIO = 1.2
"""Largest ratio of two neighbouring frequencies between which a margin is interpolated."""


@dataclass(frozen=True)
class MeasuredResponse:
    """A response at all frequencies."""

    values: ComplexArray  # complex gain; nan where the coherence is too low; shape (n,)
    uncertainty: FloatArray  # relative standard deviation of the magnitude; shape (n,)
    coherence: FloatArray  # fraction of the power that the excitation explains, 0 to 1; shape (n,)
    # number of neighbouring points in the weighted mean; 1: the point alone; shape (n,)
    averaged: NDArray[np.int64]

    @property
    def uncertainty_decibel(self) -> FloatArray:
        """Uncertainty of the magnitude, dB; nan without a value."""
        decibel = 20.0 * np.log10(1.0 + UNCERTAINTY_SIGMAS * self.uncertainty)
        return np.where(np.isfinite(self.values), decibel, np.nan)

    def phase(self, anchor: int, target: float) -> FloatArray:
        """Return the continuous phase, degrees; at the anchor, it is within 180 degrees of a target."""
        phase, has_value = np.full(len(self.values), np.nan), np.isfinite(self.values)
        if has_value.any():
            continuous = np.degrees(np.unwrap(np.angle(self.values[has_value])))
            phase[has_value] = continuous - 360.0 * np.round((continuous[anchor] - target) / 360.0)
        return phase

    @property
    def exact_points(self) -> int:
        """Number of points with an uncertainty up to :data:`EXACT_UNCERTAINTY_DB`."""
        return int(np.count_nonzero(self.uncertainty_decibel <= EXACT_UNCERTAINTY_DB))


_PHASE_ANCHORS: Mapping[ResponseName, tuple[int, float]] = {
    "closed_loop": (0, 0.0),
    "sensitivity": (-1, 0.0),
    "plant": (0, -180.0),
}
"""Point of each response whose phase is known, and this phase, degrees."""


@dataclass(frozen=True)
class MeasuredMargins:
    """Stability margins within the measured range."""

    # factors on the loop gain at the stability limit, below and above 1; 0 or infinite if none
    gain_down: float
    gain_up: float
    phase: float  # smallest phase margin, degrees; nan if the loop gain crosses 1 nowhere
    crossover: float  # highest frequency with a loop gain of 1, Hz; nan if there is none
    modulus: float  # smallest distance of the loop gain from -1
    peak: float  # peak of the sensitivity
    peak_frequency: float  # frequency of this peak, Hz


@dataclass(frozen=True, repr=False)
class FrequencyResponse(Result):
    """A measured frequency response.

    The signal x is added to the position reading. With the position y and the reading r = y + x,
    the sensitivity is r/x and the closed loop -y/x. The plant leads from its input to the position.

    Parameters
    ----------
    frequency : array
        Frequencies, Hz.
    responses : mapping of str to MeasuredResponse
        ``closed_loop``, ``sensitivity`` and ``plant``.
    rate : float
        Tick rate of the loop, Hz.
    plant_unit : str
        Unit of the plant: ``m/A`` or ``m/N``.
    motion : float
        Largest motion of the body from its mean during the measurement, m.
    injected : float
        Largest value of the injected signal, m.
    duration : float
        Duration of the measurement, s of rig time.
    """

    frequency: FloatArray
    responses: Mapping[ResponseName, MeasuredResponse]
    rate: float
    plant_unit: str
    motion: float
    injected: float
    duration: float

    @cached_property
    def margins(self) -> MeasuredMargins:
        """Margins of the loop gain, from neighbouring points that both have a value."""
        return find_margins(self.frequency, self.responses)

    @property
    def zone(self) -> Zone:
        """Zone of ISO 14839-3 for the peak of the sensitivity."""
        return find_zone(self.margins.peak)

    def to_control(self, name: ResponseName = "plant") -> FrequencyResponseData:
        """Return a response as an object of python-control, without the points that have no value."""
        if name not in RESPONSE_NAMES:
            raise InputError(
                f"to_control: no response '{name}'; take {', '.join(RESPONSE_NAMES)}",
                code="unknown-name",
                key="name",
            )
        values = self.responses[name].values
        has_value = np.isfinite(values)
        omega = 2.0 * np.pi * self.frequency[has_value]
        plant_input = "current" if self.plant_unit == "m/A" else "force"
        signals = {
            "inputs": [plant_input if name == "plant" else "injected"],
            "outputs": ["reading" if name == "sensitivity" else "position"],
        }
        return control_library().FrequencyResponseData(
            values[has_value], omega, 1.0 / self.rate, name=name, **signals
        )

    def facts(self) -> dict[str, str]:
        """Return margins, zone and the excitation as texts."""
        margins = self.margins
        counts = [f"{name} {response.exact_points}" for name, response in self.responses.items()]
        return {
            "sensitivity peak": f"{margins.peak:.3g} at {margins.peak_frequency:.4g} Hz",
            "zone of ISO 14839-3": self.zone,
            "modulus margin": f"{margins.modulus:.3g}",
            "phase margin": f"{margins.phase:.3g} degrees at {margins.crossover:.4g} Hz",
            "gain margins": f"factors {margins.gain_down:.3g} and {margins.gain_up:.3g}",
            "largest motion": f"{1e6 * self.motion:.3g} um",
            "rig time": f"{self.duration:.3g} s",
            f"points of {len(self.frequency)} within {EXACT_UNCERTAINTY_DB:g} dB and 2 degrees": ", ".join(
                counts
            ).replace("_", " "),
        }

    def to_columns(self) -> dict[str, Any]:
        """Return magnitude, phase, coherence, uncertainty and averaged points of each response."""
        columns: dict[str, Any] = {"frequency_Hz": self.frequency}
        for name, response in self.responses.items():
            unit = f"_{self.plant_unit.replace('/', '_per_')}" if name == "plant" else ""
            columns[f"{name}{unit}"] = np.abs(response.values)
            columns[f"{name}_deg"] = response.phase(*_PHASE_ANCHORS[name])
            columns[f"{name}_coherence"] = response.coherence
            columns[f"{name}_uncertainty_dB"] = response.uncertainty_decibel
            columns[f"{name}_averaged"] = response.averaged
        return columns

    def as_dict(self) -> dict[str, Any]:
        """Return the content of the JSON output and of the message to a page; None: no value."""
        lists = {
            name: [None if isinstance(x, float) and math.isnan(x) else x for x in np.asarray(values).tolist()]
            for name, values in super().as_dict().items()
        }
        margins = {
            name: value if math.isfinite(value) else None for name, value in vars(self.margins).items()
        }
        return {
            "columns": lists,
            "margins": margins,
            "zone": self.zone,
            "plant_unit": self.plant_unit,
            "rate_Hz": self.rate,
            "motion_m": self.motion,
            "injected_m": self.injected,
            "duration_s": self.duration,
            "facts": self.facts(),
        }

    def csv_text(self) -> str:
        """Return the content of the CSV file. A cell without a value is empty."""
        columns = self.to_columns()
        settings = {
            name: getattr(self, name) for name in ("rate", "plant_unit", "motion", "injected", "duration")
        }
        lines = [f"# {name} = {value}" for name, value in settings.items()]
        lines.append(",".join(columns))
        rows = zip(*(np.asarray(values).tolist() for values in columns.values()), strict=True)
        lines += [",".join("" if math.isnan(x) else repr(x) for x in row) for row in rows]
        return "\n".join(lines) + "\n"

    def save(self, path: PathLike) -> Path:
        """Write the responses as CSV."""
        with atomic_writer(path) as file:
            file.write(self.csv_text())
        return Path(path)

    def draw(self, ax: Axes) -> None:
        """Draw the magnitudes in dB; that of the plant relative to its first value."""
        for name, response in self.responses.items():
            magnitude = np.abs(response.values)
            if name == "plant":
                magnitude = magnitude / magnitude[np.isfinite(magnitude)][0]
            ax.semilogx(self.frequency, 20.0 * np.log10(magnitude), ".-", label=name.replace("_", " "))
        ax.set_xlabel("frequency [Hz]")
        ax.set_ylabel("magnitude [dB]")


def read_response(path: PathLike) -> FrequencyResponse:
    """Read a frequency response from a CSV file.

    Parameters
    ----------
    path : path
        File that `anhyst excite --response`, the live page, or :meth:`FrequencyResponse.save` wrote.

    Returns
    -------
    FrequencyResponse
        Closed loop, sensitivity and plant, with their uncertainties, as they were saved.

    Raises
    ------
    InputError
        If the file cannot be read, or is not a frequency response.
    """
    try:
        lines = Path(path).read_text(encoding="utf-8").splitlines()
    except OSError as error:
        raise read_error(path, error) from error
    try:
        settings = dict(line[2:].split(" = ", 1) for line in lines if line.startswith("# "))
        header, *rows = csv.reader(line for line in lines if not line.startswith("#"))
        table = np.array([[float(cell) if cell else math.nan for cell in row] for row in rows]).T
        columns = dict(zip(header, table, strict=True))
        plant_unit = settings.pop("plant_unit")
        responses = {}
        for number, name in enumerate(RESPONSE_NAMES):
            magnitude, phase, coherence, decibel, averaged = table[1 + 5 * number : 6 + 5 * number]
            values = magnitude * np.exp(1j * np.radians(phase))
            uncertainty = (10.0 ** (decibel / 20.0) - 1.0) / UNCERTAINTY_SIGMAS
            responses[name] = MeasuredResponse(values, uncertainty, coherence, averaged.astype(np.int64))
        numbers = {name: float(value) for name, value in settings.items()}
        return FrequencyResponse(columns["frequency_Hz"], responses, plant_unit=plant_unit, **numbers)
    except (ValueError, KeyError, TypeError, IndexError) as error:
        raise InputError(
            f"{path}: is not a frequency response; give a CSV from anhyst excite --response",
            code="not-a-response",
        ) from error


def find_margins(
    frequency: FloatArray, responses: Mapping[ResponseName, MeasuredResponse]
) -> MeasuredMargins:
    """Return the margins of the loop gain, which is the closed loop divided by the sensitivity."""
    sensitivity = responses["sensitivity"].values
    magnitude = np.abs(sensitivity)
    is_neighbour = frequency[1:] < _MAX_NEIGHBOUR_RATIO * frequency[:-1]
    with np.errstate(invalid="ignore"):
        gain = responses["closed_loop"].values / sensitivity
        axis = _crossings(gain, gain.imag, is_neighbour)
        circle = _crossings(gain, np.abs(gain) - 1.0, is_neighbour)
        crossovers = _crossings(frequency.astype(np.complex128), np.abs(gain) - 1.0, is_neighbour).real
    factors = -1.0 / axis.real[axis.real < 0.0]
    phases = np.abs(np.degrees(np.angle(-circle)))
    peak_index = int(np.nanargmax(magnitude)) if np.isfinite(magnitude).any() else 0
    return MeasuredMargins(
        gain_down=float(np.max(factors[factors < 1.0], initial=0.0)),
        gain_up=float(np.min(factors[factors > 1.0], initial=math.inf)),
        phase=float(np.min(phases)) if len(phases) else math.nan,
        crossover=float(np.max(crossovers)) if len(crossovers) else math.nan,
        modulus=1.0 / float(magnitude[peak_index]),
        peak=float(magnitude[peak_index]),
        peak_frequency=float(frequency[peak_index]),
    )


def _crossings(curve: ComplexArray, crossing: FloatArray, is_neighbour: NDArray[np.bool_]) -> ComplexArray:
    """Return the points of a curve where another curve crosses zero, interpolated linearly."""
    start = np.flatnonzero((crossing[:-1] * crossing[1:] < 0.0) & is_neighbour)
    fraction = crossing[start] / (crossing[start] - crossing[start + 1])
    return np.asarray(curve[start] + fraction * (curve[start + 1] - curve[start]))
