"""Measure the throughput of the serial link in QEMU and in a process; compute it for lines."""

from __future__ import annotations

import os
import shutil
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from random import Random

from anhyst.compensate.plan import CompileRequest
from anhyst.compilation.output import compile_model
from anhyst.data.reading import read_loops
from anhyst.identification import identify
from anhyst.model.writer import write_model
from anhyst.support.states import Command, State
from anhyst_rigs.link.client import ControllerLink
from anhyst_rigs.link.firmware import build
from anhyst_rigs.link.frames import DemandRequest, StatusAnswer
from anhyst_rigs.link.virtual_boards import Reading, RunningFirmware, run_host, run_qemu
from anhyst_rigs.link.wire import encode
from rows import ROOT, Row
from tests.link.sizes import read_sizes

EMULATED_COMMANDS = int(os.environ.get("ANHYST_LINK_COMMANDS", "1000000"))
HOST_COMMANDS = 20_000
STREAM_WINDOW = 24
COMMANDS_A_TICK = 10
CONTROL_RATE = 4000.0
BITS_PER_BYTE = 10
"""Eight data bits, a start bit and a stop bit."""


class Coil:
    """A plant whose current follows the command one step later, with noisy sensors."""

    def __init__(self) -> None:
        self._random = Random(1)
        self._coil_current = 0.0

    def step(self, tick: int, currents: tuple[float, ...]) -> Reading:
        """Return the readings of gap, force and current."""
        noise = [self._random.gauss(0.0, 1e-4) for _ in range(3)]
        coil_current, self._coil_current = self._coil_current, currents[0]
        return Reading(0.5 + noise[0], 0.5 * coil_current + noise[1], coil_current + noise[2])


def rows() -> list[Row]:
    """Measure throughput and memory of the link."""
    with tempfile.TemporaryDirectory() as folder_name:
        folder = Path(folder_name)
        loops = read_loops(ROOT / "examples" / "electromagnet" / "loops.csv")
        write_model(identify(loops, gap_map="scaling").model, folder / "model.toml")
        request = CompileRequest(kind="full", io="q31", rate=CONTROL_RATE)
        compiled = compile_model(folder / "model.toml", folder / "compiled", request).out
        return [
            *_measure_emulated_link(compiled, folder),
            _measure_process_link(compiled, folder),
            *(_compute_line_rate(baud) for baud in (115_200, 921_600)),
            _measure_memory(compiled, folder),
        ]


def _measure_emulated_link(compiled: Path, folder: Path) -> Iterator[Row]:
    if shutil.which("qemu-system-arm") is None:
        yield Row(
            "link on qemu-mps2",
            ">= 1000 force commands per second, none lost",
            "not measured: apt install qemu-system-arm",
            None,
        )
        return
    program = build("qemu-mps2", compiled, folder / "qemu.elf")
    with run_qemu(program, Coil()) as board:
        seconds, lost = _stream_demands(board, EMULATED_COMMANDS)
    yield Row(
        f"link on qemu-mps2, {EMULATED_COMMANDS} force commands",
        ">= 1000 per second, none lost",
        f"{EMULATED_COMMANDS / seconds:.0f} per second, {lost} lost",
        EMULATED_COMMANDS / seconds >= 1000 and lost == 0,
    )


def _measure_process_link(compiled: Path, folder: Path) -> Row:
    program = build("host", compiled, folder / "host")
    with run_host(program, Coil()) as board:
        seconds, lost = _stream_demands(board, HOST_COMMANDS)
        with ControllerLink(board.url, timeout=1.0) as controller:
            start_time = time.perf_counter()
            for n in range(HOST_COMMANDS):
                controller.demand(n)
                board.bus.step()
            stepped_seconds = time.perf_counter() - start_time
    return Row(
        "link on a pty to the firmware as a process",
        "",
        f"{HOST_COMMANDS / seconds:.0f} force commands per second, {lost} lost; one per tick with "
        f"answer, in lock-step: {HOST_COMMANDS / stepped_seconds:.0f} per second",
        None,
    )


def _stream_demands(board: RunningFirmware, count: int) -> tuple[float, int]:
    """Stream demands while the plant is stepped; return the duration, s, and the lost frames."""
    with ControllerLink(board.url, timeout=2.0) as controller:
        board.bus.step(40)
        controller.command(Command.ARM)
        controller.command(Command.RUN)
        forces = ((n % 1000) * 1_000_000 for n in range(1, count + 1))
        start_time = time.perf_counter()
        answer_count = 0
        for _ in controller.stream(forces, window=STREAM_WINDOW):
            answer_count += 1
            if answer_count % COMMANDS_A_TICK == 0:
                board.bus.step()
        seconds = time.perf_counter() - start_time
        status = controller.status()
    if status.state is not State.RUN:
        raise RuntimeError(f"the controller went to {status.state.name}: {status.fault.name}")
    return seconds, count - answer_count + status.codes.lost_frames + status.codes.bad_frames


def _compute_line_rate(baud: int) -> Row:
    """Compute the throughput of a full-duplex serial line, which the answers limit."""
    demand_bytes = len(encode(DemandRequest(0x01010101), 1, 0x01010101))
    status_bytes = len(encode(StatusAnswer(*([1] * 12)), 1, 0x01010101))
    bytes_per_second = baud / BITS_PER_BYTE
    return Row(
        f"a real line of {baud} baud, 8N1 (computed)",
        "",
        f"{bytes_per_second / status_bytes:.0f} force commands per second, each answered: "
        f"{demand_bytes} bytes out, {status_bytes} bytes back; "
        f"a single one takes {1e3 * (demand_bytes + status_bytes) / bytes_per_second:.2f} ms",
        None,
    )


def _measure_memory(compiled: Path, folder: Path) -> Row:
    firmware_sizes = read_sizes(build("nucleo", compiled, folder / "nucleo.elf"))
    return Row(
        "firmware for the Nucleo-F446RE",
        "",
        f"{firmware_sizes.flash} bytes of flash, {firmware_sizes.ram} bytes of variables (16384 for the "
        f"recorder), {firmware_sizes.stack} reserved for the stack",
        None,
    )


def main() -> None:
    """Print the rows of this module only."""
    for row in rows():
        print(f"{row.what}: {row.measured}" + (f" ({row.reach})" if row.reach else ""))


if __name__ == "__main__":
    main()
