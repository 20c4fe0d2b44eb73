"""Simple records of a magnet (a play operator before a square) that tests modify."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from anhyst.model.actuator import Model
from anhyst.model.schema import ValidRange
from anhyst.model.writer import model_text
from anhyst.support.units import QUANTITIES

GAPS = (0.3, 0.5)
"""Gaps, mm."""

PLAIN = ("--law", "effective-field", "--gap-map", "scaling")
"""Options of identify that fix the law and the gap map, for tests of other functions."""

_RISE = np.linspace(0.0, 2.0, 40)
DRIVE = np.concatenate([_RISE, _RISE[-2::-1]])
LAG = np.concatenate([np.maximum(_RISE - 0.1, 0.0), np.minimum(_RISE + 0.1, 1.9)[-2::-1]])

Row = list[str]


def rows(gaps: Sequence[float] = GAPS) -> list[Row]:
    """Time in s, current in A, force in N and gap in m; one loop at each gap, in mm."""
    return [
        [f"{0.01 * place:.2f}", f"{drive:.4f}", f"{12.0 * (lag / gap) ** 2 / 4.0:.4f}", f"{gap}e-3"]
        for gap in gaps
        for place, (drive, lag) in enumerate(zip(DRIVE, LAG, strict=True))
    ]


def table(lines: Sequence[Row] | None = None, header: str = "t_s,I_A,F_N,gap_m") -> str:
    """Text of a CSV file."""
    body = rows() if lines is None else lines
    return "\n".join([header, *(",".join(line) for line in body)]) + "\n"


def model() -> str:
    """Text of a model of the same magnet over the gap."""
    return model_text(
        Model(
            name="magnet",
            input=QUANTITIES["current"],
            output=QUANTITIES["force"],
            parameters={
                "M_s": 1.3e6,
                "a": 400.0,
                "k": 300.0,
                "c": 0.15,
                "c_H": 9000.0,
                "c_out": 60.0,
                "rho": (0.004, 0.008),
            },
            gap_map="reluctance",
            schedule=QUANTITIES["gap"],
            nodes=(0.3e-3, 0.6e-3),
            valid=ValidRange((0.0, 2.0), (0.0, 500.0), (0.3e-3, 0.6e-3)),
        )
    )
