"""The C core, bound: what every computation of the package runs on."""

from anhyst._core._native import (
    Compensator,
    Controller,
    FixedCompensator,
    FixedController,
    Iron,
    Operator,
    Parameters,
    SingleCompensator,
    SingleController,
    SingleParameters,
    batch,
    batch_functions,
    demagnetised,
    langevin,
    status_text,
)

__all__ = [
    "Compensator",
    "Controller",
    "FixedCompensator",
    "FixedController",
    "Iron",
    "Operator",
    "Parameters",
    "SingleCompensator",
    "SingleController",
    "SingleParameters",
    "batch",
    "batch_functions",
    "demagnetised",
    "langevin",
    "status_text",
]
