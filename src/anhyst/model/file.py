"""The model file: a versioned TOML that a person reads, edits and compares.

Everything is SI and the unit stands in the key, so ``k_A_per_m`` is ``k`` in A/m. Numbers are
written so that every bit comes back, and there is no time stamp: the same model gives the same
file. What is wrong with a file is reported with its line and key, all of it at once.
"""

from __future__ import annotations

from anhyst.model.actuator import Model
from anhyst.model.reader import read_as
from anhyst.support.atomic import PathLike


def read_model(path: PathLike) -> Model:
    """Read and check a model file.

    Parameters
    ----------
    path : path-like
        A file that :func:`~anhyst.model.writer.write_model` wrote, perhaps edited since.

    Returns
    -------
    Model
        Ready for use: the core has accepted its parameters.

    Raises
    ------
    InputError
        The file cannot be read or is no TOML.
    TomlFileError
        Another format or version, keys that are unknown, missing, without their unit or out of
        range; with line and key.
    """
    return read_as(path, Model)
