"""The C core, bound: what every computation of the package runs on."""

from anhyst._core._native import *  # noqa: F403 - the stub lists every name
