"""Write parameters of the slave for tests, and read them back."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

import pytest

from anhyst_rigs.link.foreign.elf import read_elf
from anhyst_rigs.link.foreign.slave import Slave
from anhyst_rigs.link.xcp import XcpLine
from anhyst_rigs.rig.bench.foreign import ForeignBench
from tests.link.foreign.slaves import RunningSlave, running
from tests.refusals import refused


@contextmanager
def opened(program: Path, folder: Path, **options: int) -> Iterator[tuple[ForeignBench, RunningSlave]]:
    with running(program, serial=False, **options) as slave:
        bench = ForeignBench(slave.open, slave.describe(folder, big=bool(options.get("big"))))
        with closing(bench):
            yield bench, slave


def values(bench: ForeignBench) -> dict[str, float]:
    return {parameter.name: parameter.value for parameter in bench.parameters()}


@pytest.mark.parametrize(
    "options", [{}, {"big": 1}, {"short_download": 0}, {"short_upload": 0, "daq": 0}, {"pending": 1}]
)
def test_written_values_are_read_back(program: Path, tmp_path: Path, options: dict[str, int]) -> None:
    """The bytes in the memory of the slave are those of the physical values."""
    with opened(program, tmp_path, **options) as (bench, slave):
        assert values(bench) == {"par_gain": 2.5, "par_wide": 1e-3, "par_level": -40.0, "par_limited": 5.0}
        bench.apply({"par_gain": 0.1, "par_level": 12.5, "par_wide": -0.25})
        assert values(bench)["par_gain"] == pytest.approx(0.1, rel=1e-7)
        assert values(bench)["par_level"] == 12.5
        order = ">" if options.get("big") else "<"
        memory = bench._slave.read(slave.addresses["par_level"], 0, 2)
        assert struct.unpack(f"{order}h", memory) == (5,)
        memory = bench._slave.read(slave.addresses["par_wide"], 0, 8)
        assert struct.unpack(f"{order}d", memory) == (-0.25,)


def test_values_beyond_the_limits_are_refused_before_any_is_written(program: Path, tmp_path: Path) -> None:
    """The limits are those of the A2L; none of the values is written."""
    with opened(program, tmp_path) as (bench, _):
        with refused("out-of-range par_gain: 0 to 100"):
            bench.apply({"par_level": 1.0, "par_gain": 100.5})
        with refused("unknown-parameter sig_u8"):
            bench.apply({"sig_u8": 1.0})
        assert values(bench)["par_level"] == -40.0


def test_a_value_that_the_slave_limits_is_reported_and_the_others_are_restored(
    program: Path, tmp_path: Path
) -> None:
    """The slave clips at 10; the message names both values."""
    with opened(program, tmp_path) as (bench, _):
        with refused("not-kept par_limited: 50 was written; holds 10"):
            bench.apply({"par_gain": 9.0, "par_limited": 50.0})
        assert values(bench)["par_gain"] == 2.5
        assert values(bench)["par_limited"] == 10.0


def test_a_value_that_needs_two_commands_is_refused(program: Path, tmp_path: Path) -> None:
    """With MAX_CTO 8, eight bytes would be half old and half new for a moment."""
    with opened(program, tmp_path, cto=8, dto=8) as (bench, _):
        with refused("xcp-too-long: par_wide; MAX_CTO"):
            bench.apply({"par_wide": 0.5})
        bench.apply({"par_gain": 0.5})
        assert values(bench)["par_wide"] == 1e-3
        assert values(bench)["par_gain"] == 0.5


def test_protected_calibration_needs_a_key(program: Path, tmp_path: Path) -> None:
    """Without a key function, signals can be seen; with it, parameters can be written."""
    with opened(program, tmp_path, locked=1) as (bench, _):
        with refused("xcp-locked: par_gain; calibration with seed and key"):
            bench.apply({"par_gain": 1.0})
        assert len(bench.signals) == 10
    with running(program, locked=5) as slave:
        line = XcpLine(slave.url, 1.0, repeats=True)
        opened_slave = Slave(line, lambda seed: bytes(255 - byte for byte in seed))
        with closing(opened_slave):
            opened_slave.write(slave.addresses["par_gain"], 0, struct.pack("<f", 4.0))
            assert opened_slave.read(slave.addresses["par_gain"], 0, 4) == struct.pack("<f", 4.0)
        line = XcpLine(slave.url, 1.0, repeats=True)
        with closing(line), refused("xcp-refused: unlock; seed and key"):
            Slave(line, lambda seed: seed)


def test_bit_fields_leave_their_neighbours_unchanged(program: Path) -> None:
    """Structures, arrays, bit fields and enumerations of the DWARF are those of the running program."""
    with running(program) as slave:
        description = read_elf(program)
        bench = ForeignBench(slave.open, description)
        names = ["controller.enabled", "controller.trim", "controller.speed", "controller.mode"]
        names += ["controller.axis[3].level[0]", "controller.axis[1].gain", "par_flags"]
        with closing(bench):
            assert bench.parameters() == ()
            bench.choose(["tick", "sig_f64", "controller.speed", "controller.trim"], names, None)
            assert list(values(bench).values()) == [1.0, -9.0, 777.0, 7.0, -40.0, 0.5, 0xA5]
            bench.apply({"controller.trim": 13.0, "controller.speed": 1023.0})
            bench.apply({"controller.axis[3].level[0]": -32768.0})
            assert list(values(bench).values()) == [1.0, 13.0, 1023.0, 7.0, -32768.0, 0.5, 0xA5]
            with refused("out-of-range controller.trim: -16 to 15"):
                bench.apply({"controller.trim": 16.0})
            rows = bench.advance(1)
            while not len(rows):
                rows = bench.advance(1)
            assert rows[-1, 2] == -0.125 * rows[-1, 1]
            assert list(rows[-1, 3:]) == [1023.0, 13.0]
            with refused("unknown-parameter par_fixed: read-only"):
                bench.choose(["tick"], ["par_fixed"], None)
