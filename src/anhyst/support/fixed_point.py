"""Numbers as the fixed point of the core takes them: a q31, and a gain as an ``anhyst_factor``."""

from __future__ import annotations

import math

from anhyst.support.errors import InputError

_Q31 = 2.0**31
_SHIFT_LOW, _SHIFT_HIGH = -15, 16
_LEAST_MANTISSA = 512  # rounded to 0.1 %


def q31(part: float) -> int:
    """Return the nearest code of a part of full scale; what is beyond saturates."""
    return int(max(-_Q31, min(_Q31 - 1.0, round(part * _Q31))))


def as_factor(name: str, value: float) -> tuple[int, int]:
    """Return the nearest ``anhyst_factor``."""
    if value == 0.0:
        return 0, 0
    fraction, exponent = math.frexp(value)
    mantissa, shift = round(fraction * 32768.0), exponent + 1
    if mantissa == 32768:
        mantissa, shift = 16384, shift + 1
    if shift > _SHIFT_HIGH:
        raise InputError(
            f"{name}: the gain is too large for the full scales, a last place of the input would "
            "move the output by more than 1/8192; lower the rate or raise the output's full scale",
            code="too-large-for-fixed-point",
            key=name,
        )
    if shift < _SHIFT_LOW:
        mantissa, shift = round(math.ldexp(value, 16 - _SHIFT_LOW)), _SHIFT_LOW
        if abs(mantissa) < _LEAST_MANTISSA:
            raise InputError(
                f"{name}: the gain is too small for the full scales to be kept to 0.1 %; set it "
                "to zero or lower the output's full scale",
                code="too-small-for-fixed-point",
                key=name,
            )
    return mantissa, shift


def as_smoothing(name: str, share: float) -> tuple[int, int]:
    """Return the ``anhyst_factor`` of a filter: minus the share of a step that it passes in a tick."""
    shift = 1 if share > 0.5 else 0
    mantissa = -round(share * 65536.0 / 2.0**shift)
    if -mantissa < _LEAST_MANTISSA:
        raise InputError(
            f"{name}: too low for this rate to be kept to 0.1 %; raise it",
            code="too-small-for-fixed-point",
            key=name,
        )
    return mantissa, shift
