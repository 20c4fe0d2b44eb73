"""The C core, bound: what every computation of the package runs on."""

from anhyst._core._native import (
    Controller,
    FixedCompensator,
    FixedController,
    Iron,
    Operator,
    SingleController,
    batch,
    batch_functions,
    demagnetised,
    langevin,
    status_text,
)

__all__ = [
    "Controller",
    "FixedCompensator",
    "FixedController",
    "Iron",
    "Operator",
    "SingleController",
    "batch",
    "batch_functions",
    "demagnetised",
    "langevin",
    "status_text",
]
