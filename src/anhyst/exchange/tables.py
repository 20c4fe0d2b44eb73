"""A model as look-up tables: settled loops over the gap, for tools that know tables alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from anhyst.data.formats.text import write_csv
from anhyst.model.actuator import Model
from anhyst.support.atomic import PathLike, atomic_writer, check_writable
from anhyst.support.errors import InputError
from anhyst.support.json_text import json_text

POINTS, GAPS = 101, 11


def export_tables(model: Model, out: PathLike) -> Path:
    """Write the settled loop of a model over its valid range as tables.

    A table holds the major loop alone: inner loops, and so hysteresis in use, need the model.
    """
    path = Path(out)
    if path.suffix not in {".csv", ".json"}:
        raise InputError(
            f"{path}: tables are written as .csv or .json; name it so", code="wrong-ending"
        )
    if model.valid is None:
        raise InputError(
            "the model does not say where it holds ([valid]): no range for a table",
            code="no-valid-range",
            key="valid",
        )
    check_writable(path)
    ends, name = model.valid.schedule, model.output.column
    at = np.array([0.0]) if ends is None else np.linspace(*ends, GAPS if ends[0] < ends[1] else 1)
    given = [None if model.schedule is None else float(value) for value in at]
    loops = [model.settled_loop(one, POINTS) for one in given]
    axes = {model.input.column: loops[0][0][:POINTS]}
    if model.schedule is not None:
        axes = {model.schedule.column: at} | axes
    branches = {
        f"{name}_rising": np.array([output[:POINTS] for _, output in loops]),
        f"{name}_falling": np.array([output[: POINTS - 1 : -1] for _, output in loops]),
    }
    if path.suffix == ".csv":
        grid = np.meshgrid(*axes.values(), indexing="ij")
        columns = dict(zip(axes, grid, strict=True)) | branches
        write_csv(path, {head: values.ravel() for head, values in columns.items()})
        return path
    content = {head: values.tolist() for head, values in branches.items()}
    said = {"format": "anhyst-tables", "model": model.name}
    with atomic_writer(path) as stream:
        stream.write(json_text(said | {"axes": {k: v.tolist() for k, v in axes.items()}} | content))
    return path
