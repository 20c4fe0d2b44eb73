"""An independent XCP master: pyxcp, which shares no source with the slave."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

from pyxcp.config import create_application_from_config, set_application
from pyxcp.cpp_ext.cpp_ext import DaqList
from pyxcp.daq_stim import DaqOnlinePolicy
from pyxcp.master.master import Master
from pyxcp.types import XcpResponseError

from anhyst.support.xcp_map import AREA_ADDRESSES, INPUTS, SETTINGS, SIGNALS
from anhyst_rigs.link.virtual_boards import RunningFirmware
from anhyst_rigs.link.wire import compute_key

ECU, XCP = 0x01, 0x02
SEGMENT = 0
SERIAL = {"bitrate": 921600, "header_format": "HEADER_LEN_CTR_WORD", "tail_format": "CHECKSUM_WORD"}
PATIENCE = 20.0
"""Waiting time for samples in transit, s."""

ADDRESSES = {
    value.name: AREA_ADDRESSES[area] + 4 * number
    for area, values in (("signal", SIGNALS), ("setting", SETTINGS), ("input", INPUTS))
    for number, value in enumerate(values)
}


# Without arguments it would read the command line of the tests.
set_application(create_application_from_config({}, logging.CRITICAL))


class Samples(DaqOnlinePolicy):
    """Store received samples, one row per sample with its time stamp in ns first."""

    def __init__(self, names: Sequence[str], prescaler: int = 1) -> None:
        expected = [(name, ADDRESSES[name], 0, "I32") for name in names]
        self.rows: list[tuple[int, ...]] = []
        super().__init__([DaqList("all", 0, False, True, expected, 0, prescaler)])

    def on_daq_list(self, daq_list: int, received: int, stamp: int, values: list[int]) -> None:
        """Store a sample of one tick."""
        self.rows.append((stamp, *values))

    def begin(self) -> None:
        """Set the list up and start it."""
        self.setup()
        self.xcp_master.startStopSynch(1)

    def end(self) -> None:
        """Stop the list."""
        self.xcp_master.startStopSynch(0)

    def wait(self, count: int) -> None:
        """Wait until `count` samples have arrived."""
        end = time.monotonic() + PATIENCE
        while len(self.rows) < count and time.monotonic() < end:
            time.sleep(0.01)


@contextmanager
def master_on(board: RunningFirmware, policy: Samples | None = None, unlocked: bool = False) -> Iterator[Any]:
    """Connect a master to a board over TCP."""
    where = {"host": "127.0.0.1", "port": board.xcp_port, "protocol": "TCP", "tcp_nodelay": True}
    with _master("eth", {"Eth": where}, policy, unlocked) as master:
        yield master


@contextmanager
def master_on_serial(port: str, policy: Samples | None = None, unlocked: bool = False) -> Iterator[Any]:
    """Connect a master to a serial port, as the A2L describes it."""
    with _master("sxi", {"SxI": {"port": port, **SERIAL}}, policy, unlocked) as master:
        yield master


@contextmanager
def _master(layer: str, where: dict[str, Any], policy: Samples | None, unlocked: bool) -> Iterator[Any]:
    general = {
        "disable_error_handling": True,
        "seed_n_key_function": lambda resource, seed: compute_key(seed),
    }
    config = create_application_from_config({"Transport": where, "General": general}, logging.CRITICAL)
    with Master(layer, config=config, policy=policy) as master:
        master.connect()
        master.getCommModeInfo()
        if unlocked:
            master.getStatus()
            master.cond_unlock("calpag")
        yield master
        master.disconnect()


def read(master: Any, name: str) -> int:
    """Return a value of four bytes."""
    return int.from_bytes(master.shortUpload(4, ADDRESSES[name], 0), "little", signed=True)


def write(master: Any, name: str, value: int) -> None:
    """Write a value of four bytes."""
    master.setMta(ADDRESSES[name], 0)
    master.download(value.to_bytes(4, "little", signed=True))


def refused(error: XcpResponseError) -> str:
    """Return the name of an error."""
    return str(error.args[0])
