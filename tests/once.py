"""What is slow to make, made once however many workers share the tests."""

from __future__ import annotations

import fcntl
import os
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest


def made_once(factory: pytest.TempPathFactory, name: str, make: Callable[[Path], object]) -> Path:
    """Return a folder of this test run that was filled by whichever worker came first.

    Parameters
    ----------
    factory : TempPathFactory
        The run's own.
    name : str
        Of the folder; what it holds must depend on nothing else.
    make : callable
        Fills the empty folder. The other workers wait, and then read only. If it fails, the next
        worker that asks tries again.

    Returns
    -------
    Path
        The folder.
    """
    base = factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        base = base.parent  # a worker's own folder lies in that of the run
    folder, whole = base / name, base / f"{name}.whole"
    with (base / f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not whole.exists():
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir()
            make(folder)
            whole.touch()
    return folder
