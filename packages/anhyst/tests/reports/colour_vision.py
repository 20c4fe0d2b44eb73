"""Colours as people with a colour deficiency see them, and their differences."""

from __future__ import annotations

import numpy as np

from anhyst.support.numeric import FloatArray

VISIONS = {
    "normal": ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)),
    "deuteranopia": (
        (0.367322, 0.860646, -0.227968),
        (0.280085, 0.672501, 0.047413),
        (-0.011820, 0.042940, 0.968881),
    ),
    "protanopia": (
        (0.152286, 1.052583, -0.204868),
        (0.114503, 0.786281, 0.099216),
        (-0.003882, -0.048116, 1.051998),
    ),
}
"""Matrices for linear RGB (Machado, Oliveira and Fernandes 2009, severity 1)."""
XYZ = np.array(
    ((0.4124564, 0.3575761, 0.1804375), (0.2126729, 0.7151522, 0.0721750), (0.0193339, 0.1191920, 0.9503041))
)
WHITE = np.array((0.95047, 1.0, 1.08883))


def linear_rgb(colour: str) -> FloatArray:
    """Return the linear components of a colour such as #0072B2."""
    values = np.array([int(colour[at : at + 2], 16) for at in (1, 3, 5)]) / 255.0
    return np.where(values <= 0.04045, values / 12.92, ((values + 0.055) / 1.055) ** 2.4)


def lab_of_linear(rgb: FloatArray) -> FloatArray:
    """Return L*, a* and b* (CIE 1976, D65) of linear components."""
    ratios = XYZ @ np.clip(rgb, 0.0, 1.0) / WHITE
    f = np.where(ratios > 216.0 / 24389.0, np.cbrt(ratios), (24389.0 / 27.0 * ratios + 16.0) / 116.0)
    return np.array((116.0 * f[1] - 16.0, 500.0 * (f[0] - f[1]), 200.0 * (f[1] - f[2])))


def difference(first_colour: FloatArray, second_colour: FloatArray) -> float:
    """Return the colour difference CIEDE2000 of two colours in L*a*b*."""
    mean_c7 = (0.5 * (np.hypot(*first_colour[1:]) + np.hypot(*second_colour[1:]))) ** 7
    stretch = 1.0 + 0.5 * (1.0 - np.sqrt(mean_c7 / (mean_c7 + 25.0**7)))
    chroma, hue = zip(
        *(
            (np.hypot(stretch * a, b), np.degrees(np.arctan2(b, stretch * a)) % 360.0)
            for _, a, b in (first_colour, second_colour)
        ),
        strict=True,
    )
    turn = (hue[1] - hue[0] + 180.0) % 360.0 - 180.0
    hue_difference = 2.0 * np.sqrt(chroma[0] * chroma[1]) * np.sin(np.radians(0.5 * turn))
    mean_l, mean_c, mean_h = (
        0.5 * (first_colour[0] + second_colour[0]),
        0.5 * sum(chroma),
        (hue[0] + 0.5 * turn) % 360.0,
    )
    t = 1.0 - 0.17 * np.cos(np.radians(mean_h - 30.0)) + 0.24 * np.cos(np.radians(2.0 * mean_h))
    t += 0.32 * np.cos(np.radians(3.0 * mean_h + 6.0)) - 0.20 * np.cos(np.radians(4.0 * mean_h - 63.0))
    l_term = (second_colour[0] - first_colour[0]) / (
        1.0 + 0.015 * (mean_l - 50.0) ** 2 / np.sqrt(20.0 + (mean_l - 50.0) ** 2)
    )
    c_term = (chroma[1] - chroma[0]) / (1.0 + 0.045 * mean_c)
    h_term = hue_difference / (1.0 + 0.015 * mean_c * t)
    rotation = -2.0 * np.sqrt(mean_c**7 / (mean_c**7 + 25.0**7))
    rotation *= np.sin(np.radians(60.0 * np.exp(-(((mean_h - 275.0) / 25.0) ** 2))))
    return float(np.sqrt(l_term**2 + c_term**2 + h_term**2 + rotation * c_term * h_term))


def seen_difference(first_colour: str, second_colour: str, vision: str) -> float:
    """Return the colour difference CIEDE2000 that a kind of colour vision sees."""
    return difference(
        *(
            lab_of_linear(np.array(VISIONS[vision]) @ linear_rgb(colour))
            for colour in (first_colour, second_colour)
        )
    )
