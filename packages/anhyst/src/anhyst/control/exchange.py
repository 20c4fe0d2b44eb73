"""Convert PIDD2 controllers to python-control transfer functions and back.

Between its limits, the controller of the core is linear. Its gains per tick
(:attr:`Pidd2.per_tick`) are P, K (integral), D and E (derivatives) and L (load); s and t are the
coefficients of the low-passes. With the setpoint weight b, reference r, position p and load l::

    first  = s (z - 1)/(z - 1 + s)          second = t (z - 1)/(z - 1 + t) first
    u = (b P + K/(z - 1)) r - (P + K/(z - 1) + D first + E second) p + L l

python-control is in the extra ``control``; no other module of anhyst needs it.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.polynomial import Polynomial

from anhyst.control.pidd2 import FixedPidd2, Pidd2
from anhyst.support.errors import InputError, wrong_key
from anhyst.support.numeric import FloatArray

if TYPE_CHECKING:
    from control import TransferFunction

INPUT_NAMES = ("reference", "position", "load")
OUTPUT_NAME = "demand"

_RELATIVE_ROUNDING = 1e-12  # error, relative to the sum of the coefficients of a polynomial
_W = Polynomial([0.0, 1.0])  # z - 1


def to_control(controller: Pidd2 | FixedPidd2) -> TransferFunction:
    """Return the transfer function that the core calculates between its limits."""
    library = control_library()
    p, k, d, e, load, _, s, t, weight = (float(x) for x in controller.per_tick[:9])
    has_integral, has_first_filter, has_second_filter = k != 0.0, d != 0.0 or e != 0.0, e != 0.0
    unity = Polynomial([1.0])
    integral_factor = _W if has_integral else unity
    first_factor = _W + s if has_first_filter else unity
    second_factor = _W + t if has_second_filter else unity
    denominator = integral_factor * first_factor * second_factor
    position = p * denominator + k * first_factor * second_factor
    position = position + d * s * _W * integral_factor * second_factor
    position = position + e * s * t * _W**2 * integral_factor
    reference = weight * p * integral_factor + k
    rows = [(reference, integral_factor), (-position, denominator), (Polynomial([load]), unity)]
    numerators, denominators = ([[_coefficients_in_z(row[index]) for row in rows]] for index in (0, 1))
    signals = {"inputs": list(INPUT_NAMES), "outputs": [OUTPUT_NAME]}
    return library.TransferFunction(
        numerators, denominators, dt=1.0 / controller.rate, name="pidd2", **signals
    )


def from_control(transfer: TransferFunction, rate: float, weight: float = 1.0) -> Pidd2:
    """Read the gains of a PIDD2 from its transfer function."""
    control_library()
    _check_time(transfer, rate)
    if (transfer.noutputs, transfer.ninputs) == (1, 1):
        p, k, d, e, shares = _read_gains(transfer.num[0][0], transfer.den[0][0])
        load = 0.0
    elif (transfer.noutputs, transfer.ninputs) == (1, 3):
        p, k, d, e, shares = _read_gains(-np.asarray(transfer.num[0][1]), transfer.den[0][1])
        weight = _read_weight(transfer, p, k)
        load = _read_constant(transfer.num[0][2], transfer.den[0][2])
    else:
        raise InputError(
            f"transfer function: has {transfer.ninputs} inputs and {transfer.noutputs} outputs; "
            "give one from the error, or one with " + ", ".join(INPUT_NAMES),
            code="signals-wrong",
        )
    # cutoff of a low-pass that passes a given fraction of a step in one tick, Hz
    cutoff, cutoff_2 = (
        -math.log1p(-share) * rate / (2.0 * math.pi) if share < 1.0 - _RELATIVE_ROUNDING else math.inf
        for share in shares
    )
    return Pidd2(
        rate=rate,
        K_p=p,
        K_i=k * rate,
        K_d=d / rate,
        K_dd=e / rate**2,
        K_load=load,
        cutoff=cutoff,
        cutoff_2=cutoff_2,
        weight=weight,
    )


def control_library() -> Any:
    """Import python-control."""
    try:
        import control
    except ImportError as error:
        text = "python-control is not installed: pip install 'anhyst[control]'"
        raise InputError(text, code="not-installed", key="control") from error
    return control


def _coefficients_in_z(polynomial_in_w: Polynomial) -> FloatArray:
    """Return the coefficients in z, highest power first, of a polynomial in w = z - 1."""
    return np.asarray(polynomial_in_w(Polynomial([-1.0, 1.0])).coef[::-1])


def _coefficients_in_w(coefficients: FloatArray) -> FloatArray:
    """Return the coefficients in w = z - 1, lowest power first; rounding errors become zero."""
    descending = np.atleast_1d(np.asarray(coefficients, dtype=float))
    shifted = np.array(Polynomial(descending[::-1])(Polynomial([1.0, 1.0])).coef, dtype=np.float64)
    shifted[np.abs(shifted) < _RELATIVE_ROUNDING * np.sum(np.abs(descending))] = 0.0
    return shifted[: 1 + max(np.flatnonzero(shifted), default=0)]


def _check_time(transfer: TransferFunction, rate: float) -> None:
    """Check that a transfer function is discrete and has the given sample rate."""
    if not (math.isfinite(rate) and rate > 0.0):
        raise wrong_key("rate", f"{rate} Hz is not above zero", code="not-above-zero")
    if transfer.dt is None or transfer.dt == 0:
        raise InputError(
            "transfer function: it is continuous; discretise it first, with "
            f"control.sample_system(..., {1.0 / rate:g})",
            code="not-discrete",
        )
    if transfer.dt is not True and not math.isclose(transfer.dt * rate, 1.0, rel_tol=1e-9):
        raise InputError(
            f"transfer function: its sample time is {transfer.dt:g} s, which is not 1/rate = "
            f"{1.0 / rate:g} s",
            code="tick-differs",
        )


def _read_gains(
    numerator: FloatArray, denominator: FloatArray
) -> tuple[float, float, float, float, tuple[float, float]]:
    """Return the gains P, K, D and E, and the coefficients of both low-passes."""
    denominator_in_w = _coefficients_in_w(denominator)
    numerator_in_w = _coefficients_in_w(numerator)
    if not np.any(denominator_in_w):
        raise InputError("transfer function: its denominator is zero", code="denominator-zero")
    has_integral = denominator_in_w[0] == 0.0
    filters = denominator_in_w[1:] if has_integral else denominator_in_w  # polynomial of the filters
    if len(filters) > 3 or filters[0] == 0.0:
        raise InputError(
            "transfer function: has more than an integrator and two other poles; a PIDD2 has no "
            "more (control.minreal removes poles that cancel)",
            code="too-many-poles",
        )
    if len(numerator_in_w) > len(denominator_in_w):
        raise InputError(
            "transfer function: has more zeros than poles, so it is not causal", code="looks-ahead"
        )
    numerator_in_w = np.pad(numerator_in_w, (0, 4 - len(numerator_in_w))) / filters[-1]
    shares = _filter_coefficients(filters / filters[-1])
    s, t = shares
    if not has_integral:
        numerator_in_w = np.concatenate([[0.0], numerator_in_w[:3]])
    # The numerator belongs to (z - 1)(z - 1 + s)(z - 1 + t). A filter that does not exist has s =
    # 1, and its factor z cancels.
    for _ in range(3 - len(filters)):
        numerator_in_w = numerator_in_w + np.concatenate([[0.0], numerator_in_w[:3]])
    k = numerator_in_w[0] / (s * t)
    p = (numerator_in_w[1] - k * (s + t)) / (s * t)
    d = (numerator_in_w[2] - k - p * (s + t)) / (s * t)
    e = (numerator_in_w[3] - p - d * s) / (s * t)
    size = abs(p) + abs(d) * s
    return (float(p), float(k), float(d), float(e) if abs(e) * s * t > 1e-9 * size else 0.0, shares)


def _filter_coefficients(filters: FloatArray) -> tuple[float, float]:
    """Return the coefficients of two low-passes, the larger first, from (w + s)(w + t)."""
    if len(filters) == 1:
        return 1.0, 1.0
    if len(filters) == 2:
        shares = (float(filters[0]), 1.0)
    else:
        root_product, root_sum = float(filters[0]), float(filters[1])
        discriminant = (root_sum / 2.0) ** 2 - root_product
        if discriminant < -1e-9 * root_sum**2:
            text = "transfer function: has complex poles, which no filter of a PIDD2 has"
            raise InputError(text, code="complex-poles")
        larger_coefficient = root_sum / 2.0 + math.copysign(math.sqrt(max(0.0, discriminant)), root_sum)
        shares = (larger_coefficient, root_product / larger_coefficient)
    if not all(0.0 < share <= 1.0 + _RELATIVE_ROUNDING for share in shares):
        poles = ", ".join(f"{1.0 - share:g}" for share in shares)
        text = f"transfer function: poles at {poles}; those of filters must be within 0..1"
        raise InputError(text, code="poles-out-of-range")
    return shares


def _read_weight(transfer: TransferFunction, p: float, k: float) -> float:
    """Read the setpoint weight from the transfer function of the reference."""
    numerator = _coefficients_in_w(transfer.num[0][0])
    denominator = _coefficients_in_w(transfer.den[0][0])
    order = 1 if k == 0.0 else 2
    has_integral = len(denominator) == 2 and denominator[0] == 0.0
    if len(denominator) != order or len(numerator) > order or (order == 2 and not has_integral):
        text = "must pass proportionally and through the integral only"
        raise wrong_key("reference", text, code="not-a-pidd2")
    numerator = numerator / denominator[-1]
    if order == 2 and not math.isclose(numerator[0], k, rel_tol=1e-6):
        raise wrong_key(
            "reference", "has an integral gain that differs from that of the position", code="not-a-pidd2"
        )
    if p == 0.0:
        return 1.0
    weight = float(numerator[order - 1] / p) if len(numerator) == order else 0.0
    limited_weight = min(1.0, max(0.0, weight))
    return limited_weight if math.isclose(weight, limited_weight, abs_tol=1e-9) else weight


def _read_constant(numerator: FloatArray, denominator: FloatArray) -> float:
    """Return the value of a transfer function that must be constant."""
    num, den = _coefficients_in_w(numerator), _coefficients_in_w(denominator)
    if len(num) != 1 or len(den) != 1:
        raise wrong_key("load", "must be fed forward by a constant gain", code="not-a-pidd2")
    return float(num[0] / den[0])
