"""Build the firmware once for all tests of the link."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from anhyst_rigs.link import firmware
from anhyst_rigs.link.client import ControllerLink
from anhyst_rigs.link.firmware import build
from anhyst_rigs.link.virtual_boards import RunningFirmware, run_host

from .handmade import write_parameters
from .plant import NoisyPlant

RATE = 4000


firmware._WARNINGS.append("-Werror")  # the sources have no warnings


@pytest.fixture(scope="session")
def parameters(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The compiled folder from which the firmware is built."""
    return write_parameters(tmp_path_factory.mktemp("link") / "compiled", RATE)


@pytest.fixture(scope="session")
def host_firmware(parameters: Path) -> Path:
    """The firmware for a separate process."""
    return build("host", parameters, parameters.parent / "host")


@pytest.fixture(scope="session")
def library_firmware(parameters: Path) -> Path:
    """The firmware for this process."""
    return build("library", parameters, parameters.parent / "library")


@pytest.fixture(scope="session")
def qemu_firmware(parameters: Path) -> Path:
    """The firmware for the emulated board."""
    return build("qemu-mps2", parameters, parameters.parent / "qemu.elf")


@pytest.fixture
def board(host_firmware: Path) -> Iterator[RunningFirmware]:
    """A firmware on a pseudo-terminal after its self-test."""
    with run_host(host_firmware, NoisyPlant()) as running:
        running.bus.step(40)
        yield running


@pytest.fixture
def controller(board: RunningFirmware) -> Iterator[ControllerLink]:
    with ControllerLink(board.url, timeout=1.0) as controller:
        yield controller
