"""Sensitivity of a running loop, measured: a stepped sine is added to what the controller sees.

The loop answers so that the controller sees ``S`` times what was added. Nothing is linearised, so
the answer holds for the amplitude that was injected; what the sine leaves unexplained is reported.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from anhyst.rig.recording import Recording
from anhyst.study.bearing.linear import Zone, zone
from anhyst.support.arrays import FloatArray
from anhyst.support.elementary import sine

_PERIODS, _SECONDS = 5, 0.02  # at least, of each frequency
_SETTLE_PERIODS, _SETTLE_SECONDS = 2, 0.02


@dataclass(frozen=True)
class Sensitivity:
    """A measured sensitivity."""

    frequency: FloatArray  # Hz; shape (n,)
    ratio: NDArray[np.complex128]  # what the controller saw over what was injected; shape (n,)
    # root mean square of what the sine does not explain (noise, harmonics), over that of the
    # injected sine; shape (n,)
    rest: FloatArray
    amplitude: float  # of the injected sine, m

    @property
    def magnitude(self) -> FloatArray:
        """Size of the ratio."""
        return np.abs(self.ratio)

    @property
    def decibel(self) -> FloatArray:
        """Size of the ratio, dB."""
        return np.asarray(20.0 * np.log10(self.magnitude))

    @property
    def peak(self) -> float:
        """Largest size of the ratio."""
        return float(np.max(self.magnitude))

    @property
    def peak_frequency(self) -> float:
        """Where it is, Hz."""
        return float(self.frequency[int(np.argmax(self.magnitude))])

    @property
    def zone(self) -> Zone:
        """Zone of ISO 14839-3."""
        return zone(self.peak)


@dataclass(frozen=True)
class _Piece:
    """Where one frequency stands in the sweep: settling from `begin`, measured in between."""

    frequency: float
    begin: int
    first: int
    end: int


def measure_sensitivity(
    run: Callable[[FloatArray], Recording], frequencies: ArrayLike, amplitude: float, rate: float
) -> Sensitivity:
    """Measure the sensitivity of a loop."""
    wanted = np.atleast_1d(np.asarray(frequencies, dtype=float))
    if not (np.all(wanted > 0.0) and np.all(wanted < 0.5 * rate)):
        raise ValueError(f"frequencies must lie between 0 and {0.5 * rate:g} Hz, half the rate")
    pieces = _sweep(wanted.tolist(), rate)
    inject = amplitude * np.concatenate([_sine(piece, rate) for piece in pieces])
    seen = run(inject)["gap_read_m"]
    if len(seen) != len(inject):
        raise ValueError(f"the run has {len(seen)} ticks where {len(inject)} were injected")
    answers = [_fit(seen, piece, rate) for piece in pieces]
    return Sensitivity(
        frequency=wanted,
        ratio=np.array([answer / amplitude for answer, _ in answers], dtype=np.complex128),
        rest=np.array([rest for _, rest in answers]) / (amplitude / math.sqrt(2.0)),
        amplitude=amplitude,
    )


def _sweep(frequencies: Sequence[float], rate: float) -> list[_Piece]:
    """Lay the frequencies out one after the other, each over whole periods."""
    pieces: list[_Piece] = []
    begin = 0
    for frequency in frequencies:
        settle = math.ceil(max(_SETTLE_PERIODS / frequency, _SETTLE_SECONDS) * rate)
        periods = max(_PERIODS, math.ceil(_SECONDS * frequency))
        first = begin + settle
        end = first + round(periods / frequency * rate)
        pieces.append(_Piece(frequency, begin, first, end))
        begin = end
    return pieces


def _sine(piece: _Piece, rate: float) -> FloatArray:
    """Return the sine of one piece, zero at its beginning."""
    ticks = np.arange(piece.end - piece.begin)
    return sine(piece.frequency / rate * ticks)


def _fit(seen: FloatArray, piece: _Piece, rate: float) -> tuple[complex, float]:
    """Return the complex amplitude against the sine of a piece, and the rms of what is left."""
    ticks = np.arange(piece.first, piece.end)
    phase = 2.0 * np.pi * piece.frequency / rate * (ticks - piece.begin)
    # The middle and a slow drift are no answer to the sine.
    drift = np.linspace(-1.0, 1.0, len(ticks))
    basis = np.column_stack([np.sin(phase), np.cos(phase), np.ones_like(phase), drift])
    row = seen[piece.first : piece.end]
    middle = float(np.mean(row))
    found, *_ = np.linalg.lstsq(basis, row - middle, rcond=None)
    rest = row - middle - basis @ found
    return complex(found[0], found[1]), float(np.sqrt(np.mean(rest**2)))
