"""Test that firmware builds for every board, and that the emulated one takes 1000 commands/s."""

from __future__ import annotations

import importlib.util
import shutil
import socket
from pathlib import Path

import pytest

from anhyst.cli.app import main
from anhyst.support.errors import NegativeResult
from anhyst.support.states import Command, Fault, State
from anhyst_rigs.link import wire
from anhyst_rigs.link.client import ControllerLink
from anhyst_rigs.link.firmware import build
from anhyst_rigs.link.virtual_boards import PlantBus, exchange_over_socket, run_host, run_library, run_qemu
from tests.refusals import refused

from .handmade import write_parameters
from .plant import NoisyPlant
from .sizes import read_sizes


@pytest.mark.slow
def test_the_nucleo_s_firmware_fits_with_room_to_spare(parameters: Path, tmp_path: Path) -> None:
    sizes = read_sizes(build("nucleo", parameters, tmp_path / "nucleo.elf"))
    assert 4000 < sizes.flash < 32 * 1024
    assert 0 < sizes.ram < 64 * 1024
    assert sizes.stack == 4096


def test_the_same_parameters_give_the_same_firmware(parameters: Path, tmp_path: Path) -> None:
    first = build("qemu-mps2", parameters, tmp_path / "first").read_bytes()
    assert build("qemu-mps2", parameters, tmp_path / "second").read_bytes() == first


@pytest.mark.slow
@pytest.mark.needs("qemu-system-arm")
@pytest.mark.parametrize("count", [3000, pytest.param(30_000, marks=pytest.mark.campaign)])
def test_no_demand_is_lost_on_the_emulated_board(qemu_firmware: Path, count: int) -> None:
    with run_qemu(qemu_firmware, NoisyPlant()) as board, ControllerLink(board.url, timeout=2.0) as controller:
        board.bus.step(40)
        controller.command(Command.ARM)
        controller.command(Command.RUN)
        forces = ((n % 1000) * 1_000_000 for n in range(1, count + 1))
        answered = 0
        for _ in controller.stream(forces):
            answered += 1
            if answered % 50 == 0:
                board.bus.step()
        board.bus.step()
        status = controller.status()
    assert answered == count
    assert status.codes.demand == (count % 1000) * 1_000_000
    assert (status.codes.lost_frames, status.codes.bad_frames) == (0, 0)
    assert status.state is State.RUN


@pytest.mark.needs("qemu-system-arm")
def test_process_and_emulated_board_drive_the_same_currents(host_firmware: Path, qemu_firmware: Path) -> None:
    drives = []
    for runner, program in ((run_host, host_firmware), (run_qemu, qemu_firmware)):
        plant = NoisyPlant()
        with runner(program, plant) as board, ControllerLink(board.url, timeout=2.0) as controller:
            board.bus.step(40)
            controller.command(Command.ARM)
            controller.command(Command.RUN)
            for n in range(60):
                controller.demand((37 * n % 101) * 20_000_000)
                board.bus.step(2)
            assert board.bus.fault is Fault.NONE
        drives.append(plant.drives)
    assert drives[0] == drives[1]
    assert len(set(drives[0])) > 50


def test_a_firmware_keeps_its_port_while_clients_come_and_go(host_firmware: Path) -> None:
    for link in ("pty", "tcp:0"):
        with run_host(host_firmware, NoisyPlant(), link) as board:
            for _ in range(3):
                with ControllerLink(board.url, timeout=1.0) as controller:
                    assert controller.status().state is State.INIT


def test_a_port_is_read_without_descriptors_as_on_windows(
    host_firmware: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(wire, "_file_descriptor", lambda port: None)
    with (
        run_host(host_firmware, NoisyPlant(), "tcp:0") as board,
        ControllerLink(board.url, timeout=2.0) as controller,
    ):
        board.bus.step(40)
        controller.command(Command.ARM)
        assert controller.status().state is State.READY


def test_a_board_that_is_not_known(parameters: Path, tmp_path: Path) -> None:
    with refused("unknown-board"):
        build("arduino", parameters, tmp_path / "x")


def test_a_folder_without_a_compensator(tmp_path: Path) -> None:
    with refused("not-a-compiled-folder"):
        build("host", tmp_path, tmp_path / "x")


@pytest.mark.parametrize("rate", [9, 4000.5, 1000001])
def test_a_rate_that_no_board_keeps(tmp_path: Path, rate: float) -> None:
    folder = write_parameters(tmp_path / "compiled", rate)
    with refused("rate-not-whole"):
        build("host", folder, tmp_path / "x")


def test_sources_that_do_not_compile(parameters: Path, tmp_path: Path) -> None:
    shutil.copytree(parameters, tmp_path / "compiled")
    (tmp_path / "compiled" / "handmade_parameters.c").write_text("no C", encoding="utf-8")
    with refused("does-not-compile", NegativeResult):
        build("host", tmp_path / "compiled", tmp_path / "x")


def test_a_missing_program_is_refused(tmp_path: Path) -> None:
    with refused("cannot-be-run"), run_host(tmp_path / "none", NoisyPlant()):
        pass


def test_tools_that_are_not_installed_are_named(
    parameters: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    with refused("not-installed"):
        build("nucleo", parameters, tmp_path / "x")
    monkeypatch.setenv("PATH", str(tmp_path))
    with refused("not-installed gcc"):
        build("host", parameters, tmp_path / "x")
    with refused("not-installed qemu-system-arm"), run_qemu(tmp_path / "x", NoisyPlant()):
        pass


def test_a_controller_that_hangs_up_is_reported() -> None:
    ours, theirs = socket.socketpair()
    with ours:
        theirs.close()
        with refused("tick-not-finished: tick 1"):
            PlantBus(NoisyPlant(), exchange_over_socket(ours)).step()


def test_records_of_the_bus_are_found_after_stray_bytes(host_firmware: Path) -> None:
    with run_host(host_firmware, NoisyPlant()) as board:
        board.bus.step(3)
        assert board.bus_socket is not None
        board.bus_socket.sendall(b"\1\2\3\4\5")
        board.bus.step(3)
        assert board.bus.tick == 6


def test_a_firmware_in_this_process_agrees_with_one_in_a_separate_process(
    library_firmware: Path, host_firmware: Path
) -> None:
    drives: list[list[float]] = []
    with (
        run_library(library_firmware, NoisyPlant()) as here,
        run_host(host_firmware, NoisyPlant()) as process,
    ):
        for board in (here, process):
            with ControllerLink(board.link, timeout=1.0) as controller:
                board.bus.step(40)
                controller.command(Command.DEMAGNETISED)
                controller.command(Command.RUN)
                seen = []
                for n in range(300):
                    controller.demand(n * 4_000_000)
                    board.bus.step()
                    seen.append(board.bus.drive)
                assert controller.repeated_count == 0
            drives.append(seen)
    assert drives[0] == drives[1]
    assert max(drives[0]) > 0.1


def test_a_package_of_an_ecosystem_is_no_compiled_folder(tmp_path: Path) -> None:
    (tmp_path / "manifest.json").write_text('{"package": "zephyr", "name": "a", "rate_Hz": 1000}')
    with refused("wrong-kind: package"):
        build("host", tmp_path, tmp_path / "firmware")
    assert main(["live", str(tmp_path)]) == 2
