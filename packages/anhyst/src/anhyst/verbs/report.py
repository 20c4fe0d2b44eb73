"""The command ``report``: write the report of a model as a web page."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from anhyst.model.actuator import Model
    from anhyst.support.atomic import PathLike

PLACE = 15, "From measurements to a model"


def report(model: Model | PathLike, out: PathLike = "report.html") -> tuple[str, ...]:
    """Write the report of a model as one self-contained HTML file.

    The report shows measured and modelled loops at each gap, residuals, parameters over the gap,
    the cost of each reduction, uncertainties, the verdict and the provenance. The command reads the
    measurements of the model again. If they are missing or have changed, the report is made from
    the model only and says so.

    Parameters
    ----------
    model : Model or path-like
        A model.toml.
    out : path-like, ``FILE``
        HTML file to write.

    Returns
    -------
    tuple of str
        Warnings, one sentence each: measurements that could not be read, fit figures that are out
        of date, an acceptance test that failed.

    Raises
    ------
    InputError
        The model file cannot be used, or the report cannot be written.

    Examples
    --------
    anhyst report model.toml --out report.html
    """
    from anhyst.reports.page import write_report

    return write_report(model, out)


def warnings(result: tuple[str, ...]) -> tuple[str, ...]:
    """Return the warnings of the report."""
    return result


def as_json(result: tuple[str, ...], arguments: Mapping[str, Any]) -> dict[str, Any]:
    """Return the result for ``--json``."""
    return {"out": str(arguments["out"]), "warnings": list(result)}
