"""One contact with a controller on a board: open a line, see that it is the right one, read."""

from __future__ import annotations

import struct
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from anhyst.compensate.layout import PLACES
from anhyst.control.states import Command, Fault, State
from anhyst.link.blocks import CRC_AT
from anhyst.link.frames import Body, Setting
from anhyst.rig.bench.board_columns import BoardColumns
from anhyst.rig.bench.settings import ControllerSettings
from anhyst.support.errors import InputError


class BoardLine(Protocol):
    """An open line to a controller."""

    url: str  # for messages
    name: str  # what the controller is called
    body: Body  # what the controller controls
    signals: tuple[str, ...]  # signals of ``contract/signals.toml`` that :meth:`take` returns
    every: int  # ticks from one sample to the next

    def take(self, tick: int) -> NDArray[np.int64]:
        """Wait for the last sample up to a tick, and return all that came: tick, codes."""

    def beat(self) -> None:
        """Say that the operator is there."""

    def clock(self) -> int:
        """Return the number of the last tick, modulo 2^32."""

    def goal(self) -> int:
        """Return what is demanded, q31 of full scale."""

    def aim(self, code: int) -> None:
        """Demand a force or a position, q31 of full scale."""

    def command(self, command: Command) -> State:
        """Change the state, and return the one it is in then."""

    def read_words(self, first: int, count: int) -> list[int]:
        """Return words of the parameter block in force."""

    def read_block(self) -> list[int]:
        """Return the parameter block in force."""

    def swap_block(self, words: Sequence[int]) -> None:
        """Download another parameter block and put it in force between two ticks."""

    def read_setting(self, setting: Setting) -> int:
        """Ask for a setting."""

    def write_setting(self, setting: Setting, value: int) -> int:
        """Set a setting from the next tick on."""

    def close(self) -> None:
        """Hang up."""


Reach = Callable[[], BoardLine]
"""Opens a line; an InputError where nobody answers."""


class OtherFirmware(InputError):  # noqa: N818 - it answers well, and is not the one
    """A controller answers, and it is not the one that the folder was compiled for."""


class Contact:
    """A controller that answers, and what it said at first. Nothing is commanded."""

    def __init__(self, line: BoardLine, manifest: Mapping[str, Any]) -> None:
        _check(line, manifest)
        self.line = line
        self.columns = BoardColumns(line.body, line.signals, manifest)
        self.settings = ControllerSettings(line, self.columns.settings)
        self.goal = line.goal()
        self.block = block_in_force(line)
        self.rows = line.take(0)
        self.at = time.monotonic()

    @property
    def state(self) -> State:
        """The state of the controller at the last sample."""
        return State(self._last("state"))

    @property
    def fault(self) -> Fault:
        """Its latched reason of a fault."""
        return Fault(self._last("fault"))

    def _last(self, signal: str) -> int:
        return int(self.rows[-1, 1 + self.line.signals.index(signal)])

    def check_same(self, before: Contact) -> None:
        """Refuse another controller than that of a contact before."""
        mine, other = self.line, before.line
        if (mine.name, mine.body, mine.signals, mine.every) != (
            other.name,
            other.body,
            other.signals,
            other.every,
        ):
            raise OtherFirmware(
                f"{mine.url}: '{mine.name}' answers with {len(mine.signals)} signals instead of "
                f"'{other.name}' with {len(other.signals)}; it is another firmware, start again "
                "with its folder",
                code="other-firmware",
            )


def open_contact(
    reach: Reach, manifest: Mapping[str, Any], before: Contact | None = None
) -> Contact:
    """Open a line and return the contact, the same controller as before; closed where it is not."""
    line = reach()
    try:
        found = Contact(line, manifest)
        if before is not None:
            found.check_same(before)
    except BaseException:
        line.close()
        raise
    return found


def block_in_force(line: BoardLine) -> list[int]:
    """Return the checksum of the parameter block in force, which tells one from another."""
    return line.read_words(CRC_AT, 2)


def _check(line: BoardLine, manifest: Mapping[str, Any]) -> None:
    """Refuse a folder whose numbers would be wrong for the signals of this controller."""
    signals = manifest["signals"]
    if (manifest["controller"] is None) is not (line.body is Body.FORCE):
        raise OtherFirmware(
            f"{line.url}: controls a {line.body.name.lower()}, the folder does not",
            code="other-firmware",
        )
    wanted = {
        "SCALE_DEMAND": ("full scale of the demand", signals["demand"]["scale"]),
        "SCALE_CURRENT": ("full scale of the current", signals["current"]["scale"]),
        "SCALE_RATE": ("rate", manifest["rate_Hz"]),
    }
    for word, (name, value) in wanted.items():
        words = line.read_words(PLACES[word], 2)
        (found,) = struct.unpack("<f", struct.pack("<2h", *words))
        if not abs(found - value) <= 1e-6 * abs(value):
            raise OtherFirmware(
                f"{line.url}: the {name} of its block is {found:g}, that of the folder {value:g}; "
                "name the folder that the firmware is built around",
                code="other-firmware",
                key=name,
            )
