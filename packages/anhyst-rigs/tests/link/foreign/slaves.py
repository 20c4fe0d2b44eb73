"""Build and run the XCP slave for tests, and write A2L files for it."""

from __future__ import annotations

import os
import subprocess
import tty
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

from anhyst_rigs.link.foreign.a2l import read_a2l
from anhyst_rigs.link.foreign.slave import Slave
from anhyst_rigs.link.foreign.variables import Description
from anhyst_rigs.link.wire import Framing
from anhyst_rigs.link.xcp import XcpLine
from tests.once import made_once

SOURCES = [Path(__file__).with_name(name) for name in ("slave.c", "memory.c")]

MEASUREMENTS = {
    "tick": ("ULONG", "plain"),
    "sig_u8": ("UBYTE", "plain"),
    "sig_i8": ("SBYTE", "plain"),
    "sig_u16": ("UWORD", "plain"),
    "sig_i16": ("SWORD", "halved"),
    "sig_i32": ("SLONG", "rational"),
    "sig_u64": ("A_UINT64", "plain"),
    "sig_i64": ("A_INT64", "plain"),
    "sig_f32": ("FLOAT32_IEEE", "plain"),
    "sig_f64": ("FLOAT64_IEEE", "plain"),
}
PARAMETERS = {
    "par_gain": ("FLOAT32_IEEE", "plain", "0 100"),
    "par_wide": ("FLOAT64_IEEE", "plain", "-1 1"),
    "par_level": ("SWORD", "halved", "-500 500"),
    "par_limited": ("ULONG", "names", "0 99"),
}
CONVERSIONS = """
/begin COMPU_METHOD plain "" IDENTICAL "%.6" "" /end COMPU_METHOD
/begin COMPU_METHOD halved "" LINEAR "%.6" "mm" COEFFS_LINEAR 0.5 10 /end COMPU_METHOD
/begin COMPU_METHOD rational "raw = 4 x / 1" RAT_FUNC "%.6" "V" COEFFS 0 4 0 0 0 1 /end COMPU_METHOD
/begin COMPU_METHOD names "" TAB_VERB "%.6" "" COMPU_TAB_REF the_names /end COMPU_METHOD
/begin COMPU_VTAB the_names "" TAB_VERB 2 0 "off" 5 "half ""on"", 1" DEFAULT_VALUE "?" /end COMPU_VTAB
"""


def a2l_text(addresses: dict[str, int], *, big: bool = False, events: str = "", more: str = "") -> str:
    """Return an A2L file for the variables of the slave at these addresses."""
    types = sorted({kind for kind, *_ in (*MEASUREMENTS.values(), *PARAMETERS.values())})
    layouts = "\n".join(
        f"/begin RECORD_LAYOUT as_{kind} FNC_VALUES 1 {kind} ROW_DIR DIRECT /end RECORD_LAYOUT"
        for kind in types
    )
    measurements = "\n".join(
        f'/begin MEASUREMENT {name} "the {name}" {kind} {method} 0 0 -1E18 1E18\n'
        f"  ECU_ADDRESS {addresses[name]:#x} /end MEASUREMENT"
        for name, (kind, method) in MEASUREMENTS.items()
    )
    characteristics = "\n".join(
        f'/begin CHARACTERISTIC {name} "the {name}" VALUE {addresses[name]:#x} as_{kind} 0 {method} {limits}\n'
        "/end CHARACTERISTIC"
        for name, (kind, method, limits) in PARAMETERS.items()
    )
    return f"""ASAP2_VERSION 1 60
/begin PROJECT test "a slave for tests"
/begin MODULE m ""
/begin MOD_COMMON "" BYTE_ORDER {"MSB_FIRST" if big else "MSB_LAST"} /end MOD_COMMON
{CONVERSIONS} {layouts}
/begin IF_DATA XCP {events} /end IF_DATA
{measurements}
{characteristics}
{more}
/end MODULE /end PROJECT
"""


@dataclass
class RunningSlave:
    """A slave that runs, with the addresses of its variables."""

    url: str
    addresses: dict[str, int]
    program: Path
    process: subprocess.Popen[str]

    def describe(self, folder: Path, **options: object) -> Description:
        """Return the description of its variables that an A2L file contains."""
        path = folder / "slave.a2l"
        path.write_text(a2l_text(self.addresses, **options), encoding="utf-8")  # type: ignore[arg-type]
        return read_a2l(path)

    def open(self, timeout: float = 1.0) -> Slave:
        """Connect to the slave; its key is the seed with all bits inverted."""
        framing = Framing(checksum_bytes=0 if self.url.startswith("socket") else 2, max_packet_bytes=0xFFFF)
        line = XcpLine(self.url, timeout, framing, repeats=True)
        try:
            return Slave(line)
        except BaseException:
            line.close()
            raise


def build(factory: pytest.TempPathFactory) -> Path:
    """Return the slave as a program with debug information at fixed addresses."""

    def make(folder: Path) -> None:
        command = ["cc", "-O1", "-g", "-no-pie", "-o", str(folder / "slave"), *map(str, SOURCES)]
        subprocess.run(command, check=True)

    return made_once(factory, "xcp-slave", make) / "slave"


@contextmanager
def running(program: Path, serial: bool = False, **options: int) -> Iterator[RunningSlave]:
    """Run the slave until the test ends, on TCP or on a pseudo-terminal."""
    arguments = [f"{name}={value}" for name, value in options.items()]
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    command = [str(program), *arguments, *([f"tty={ours}"] if serial else [])]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, pass_fds=[ours]) as process:
        assert process.stdout is not None
        addresses: dict[str, int] = {}
        try:
            for line in process.stdout:
                name, _, value = line.strip().partition(" ")
                addresses[name] = int(value)
                if name == "port":
                    break
            port = addresses.pop("port")
            url = os.ttyname(theirs) if serial else f"socket://127.0.0.1:{port}"
            yield RunningSlave(url, addresses, program, process)
        finally:
            process.kill()
            os.close(ours)
            os.close(theirs)
