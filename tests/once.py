"""Create a slow test resource once for all workers of a test run."""

from __future__ import annotations

import fcntl
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest


def made_once(factory: pytest.TempPathFactory, name: str, make: Callable[[Path], object]) -> Path:
    """Return a folder that the first worker to request it has filled for the whole test run.

    Parameters
    ----------
    factory : TempPathFactory
        Factory of the test run.
    name : str
        Name of the folder. Its content must depend on nothing else.
    make : callable
        Fills the empty folder. The other workers wait and then only read. If it fails, the next
        worker that requests the folder tries again.

    Returns
    -------
    Path
        The folder.
    """
    base = factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        base = base.parent  # the folder of a worker is in the folder of the test run
    folder, whole = base / name, base / f"{name}.whole"
    with (base / f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not whole.exists():
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir()
            make(folder)
            whole.touch()
    return folder
