"""Verify a firmware on an emulated board against the same firmware on this PC (``anhyst verify``)."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from dataclasses import asdict, dataclass
from pathlib import Path
from random import Random

from anhyst.compilation.toolchain import MissingTool, missing_modules, missing_programs
from anhyst.support.errors import InputError, NegativeResult
from anhyst.support.states import Command, Fault
from anhyst.verification.bundle import Bundle
from anhyst.verification.compare import Difference
from anhyst.verification.result import TargetResult
from anhyst_rigs.link.client import ControllerLink
from anhyst_rigs.link.firmware import build
from anhyst_rigs.link.virtual_boards import Plant, Reading, RunningFirmware, run_host, run_qemu

TARGET = "cortex-m3-qemu"
"""Name of this target's entry point in the group ``anhyst.targets``."""
QEMU = "qemu-system-arm"
Q31_ONE = 1 << 31
SELF_TEST_TICKS = 40
TICKS_PER_DEMAND = 5
RELATIVE_SENSOR_NOISE = 1e-4

Runner = Callable[[Path, Plant], AbstractContextManager[RunningFirmware]]


class WalkingPlant:
    """An actuator with a force proportional to its current, a slow gap change and noisy sensors."""

    def __init__(self, seed: int) -> None:
        self.drives: list[int] = []
        self._current = 0.0
        self._next_current = 0.0
        self._random = Random(seed)

    def step(self, tick: int, currents: tuple[float, ...]) -> Reading:
        """Apply the current of the previous tick, and return the sensor readings."""
        current = currents[0]
        self.drives.append(round(current * Q31_ONE))
        self._current, self._next_current = self._next_current, current
        gap = 0.5 + 0.3 * math.sin(tick * 2.0 * math.pi / 5000.0)
        gap, force, current_reading = (
            value + self._random.gauss(0.0, RELATIVE_SENSOR_NOISE)
            for value in (gap, 0.5 * self._current, self._current)
        )
        return Reading(gap, force, current_reading)


@dataclass(frozen=True, slots=True)
class FirmwareRun:
    """A run of a firmware: the current of each tick, and the status after each demand."""

    drives: list[int]
    statuses: list[dict[str, int]]


class FirmwareTarget:
    """A target of ``anhyst verify``: a complete firmware, once emulated and once on this PC."""

    def missing_tools(self) -> tuple[MissingTool, ...]:
        """Return the tools that are not installed: emulator, compiler, or modules of the link."""
        return (
            *missing_programs(TARGET, {QEMU: QEMU}),
            *missing_modules(TARGET, ["ziglang"]),
            *missing_modules(TARGET, ["serial"], extra="anhyst-rigs[link]"),
        )

    def verify(self, bundle: Bundle, folder: Path, steps: int, seed: int) -> TargetResult:
        """Run both firmwares with the same demands and readings, and compare every tick."""
        start_s = time.monotonic()
        identification = (TARGET, "firmware", "mps2-an385 in QEMU", "zig cc -Os")
        try:
            host, board = (
                _run_program(runner, build(name, bundle.folder, folder / f"firmware-{name}"), steps, seed)
                for name, runner in (("host", run_host), ("qemu-mps2", run_qemu))
            )
        except (InputError, NegativeResult) as error:
            return TargetResult(*identification, 0, 0, failure=f"target {TARGET}: {error}")
        return TargetResult(
            *identification,
            steps,
            0,
            difference=compare_runs(host, board),
            seconds=time.monotonic() - start_s,
        )


FIRMWARE = FirmwareTarget()


def _run_program(runner: Runner, program: Path, ticks: int, seed: int) -> FirmwareRun:
    random = Random(seed)
    plant = WalkingPlant(seed)
    statuses = []
    with runner(program, plant) as board, ControllerLink(board.url, timeout=5.0) as controller:
        board.bus.step(SELF_TEST_TICKS)
        controller.command(Command.ARM)
        controller.command(Command.RUN)
        demand = 0.0
        for _ in range(0, ticks, TICKS_PER_DEMAND):
            is_demand_step = random.random() < 0.1
            demand = random.random() if is_demand_step else demand + random.gauss(0.0, 0.02)
            demand = min(max(demand, 0.0), 1.0)
            statuses.append(asdict(controller.demand(round(demand * (Q31_ONE - 1))).codes))
            board.bus.step(TICKS_PER_DEMAND)
        if board.bus.fault is not Fault.NONE:
            raise NegativeResult(
                f"the firmware went to the fault {board.bus.fault.name}", code="controller-in-fault"
            )
    return FirmwareRun(plant.drives, statuses)


def compare_runs(host: FirmwareRun, board: FirmwareRun) -> Difference | None:
    """Return the first difference between the run of a board and that of this PC, or None."""
    for tick, (value, answer) in enumerate(zip(host.drives, board.drives, strict=True)):
        if value != answer:
            return Difference("firmware", tick, "drive", value, answer)
    for index, (expected_code, board_status) in enumerate(zip(host.statuses, board.statuses, strict=True)):
        for name, value in expected_code.items():
            if value != board_status[name]:
                return Difference("status", index, name, value, board_status[name])
    return None
