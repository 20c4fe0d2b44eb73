"""The compiled C core as a Python module; all computations of the package use it."""

from anhyst._core._native import *  # noqa: F403 - the stub lists every name
