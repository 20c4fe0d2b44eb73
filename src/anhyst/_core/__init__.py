"""The C core, bound: what every computation of the package runs on."""

from anhyst._core._native import (
    FixedCompensator,
    Iron,
    Operator,
    batch,
    batch_functions,
    demagnetised,
    langevin,
    status_text,
)

__all__ = [
    "FixedCompensator",
    "Iron",
    "Operator",
    "batch",
    "batch_functions",
    "demagnetised",
    "langevin",
    "status_text",
]
