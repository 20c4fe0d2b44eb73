"""Read the variables of ELF files: their values in the file are those of the C source."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import pytest
from elftools.elf.elffile import ELFFile

from anhyst.support.errors import InputError
from anhyst.support.kinds import is_elf
from anhyst_rigs.link.foreign.elf import read_elf
from anhyst_rigs.link.foreign.variables import Description
from tests.once import made_once
from tests.refusals import refused

SOURCE = Path(__file__).with_name("layout.c")

TARGETS = {
    "x86-64, DWARF 5": ["cc", "-gdwarf-5", "-static", "-no-pie"],
    "x86-64, DWARF 2": ["cc", "-gdwarf-2", "-gstrict-dwarf", "-static", "-no-pie"],
    "Arm, DWARF 4": [
        sys.executable,
        "-m",
        "ziglang",
        "cc",
        "-target",
        "thumb-freestanding-eabi",
        "-gdwarf-4",
    ],
    "PowerPC, most significant byte first": [
        *(sys.executable, "-m", "ziglang", "cc", "-target", "powerpc-freestanding-eabi", "-gdwarf-4")
    ],
}

VALUES: Mapping[str, float] = {
    "a.wide": 0xABCDE,
    "a.signed_bits": -33,
    "a.last": 21,
    "a.items[0].rows[0][1]": 2,
    "a.items[2].rows[1][0]": -15,
    "a.items[1].first": 11,
    "a.items[2].second": 18,
    "a.items[1].any.value": -2.5,
    "a.items[2].any.value": 3.5,
    "a.far": -1e-9,
    "state": 3,
    "other": -1,
    "flag": 1,
    "small": -7,
    "large": -5000000000,
    "calibration": 0.75,
    "hidden": 513,
}


@pytest.fixture(scope="module", params=TARGETS)
def program(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    def make(folder: Path) -> None:
        arguments = ["-O0", "-nostdlib", "-ffreestanding", "-o", str(folder / "layout.elf"), str(SOURCE)]
        subprocess.run([*TARGETS[request.param], *arguments], check=True)

    return made_once(tmp_path_factory, f"layout-{request.param}".replace(" ", "-"), make) / "layout.elf"


def value_in_file(program: Path, description: Description, name: str) -> float:
    """Return the initial value of a variable from the content of the file."""
    variable = description.variables[name]
    with program.open("rb") as stream:
        for segment in ELFFile(stream).iter_segments():
            offset = variable.address - segment["p_vaddr"]
            if segment["p_type"] == "PT_LOAD" and 0 <= offset < segment["p_filesz"]:
                return variable.value_of(segment.data()[offset : offset + variable.size])
    raise AssertionError(f"{name} is not in the file")


def test_variables_have_the_values_of_the_source(program: Path) -> None:
    """Arrays, nested structures, unions, bit fields, enumerations and all sizes, in both byte orders."""
    assert is_elf(program)
    description = read_elf(program)
    assert {name: value_in_file(program, description, name) for name in VALUES} == VALUES
    assert description.variables["state"].doc == "-1 IDLE, 3 RUN"
    assert description.variables["a.items[2].any.bits"].address == (
        description.variables["a.items[2].any.value"].address
    )
    assert "pointer" not in description.variables
    assert "too_many[0]" not in description.variables
    assert "1 with the type pointer" in description.describe_omitted()
    assert "1 with more than 4096 elements" in description.describe_omitted()


def test_constants_are_read_only(program: Path) -> None:
    """The compiler may use a constant without reading it, wherever the linker places it."""
    variables = read_elf(program).variables
    assert variables["a.wide"].is_writable
    assert not variables["fixed"].is_writable


def test_a_file_without_debug_information_is_refused(tmp_path: Path) -> None:
    """The message says how to compile; an object file has no addresses."""
    program = tmp_path / "stripped.elf"
    arguments = ["-nostdlib", "-ffreestanding", "-static", "-o", str(program), str(SOURCE)]
    subprocess.run(["cc", "-s", *arguments], check=True)
    with refused("no-data: stripped.elf; compile it with -g"):
        read_elf(program)
    subprocess.run(["cc", "-g", "-c", "-o", str(program), str(SOURCE)], check=True)
    with refused("no-data: stripped.elf; object file"):
        read_elf(program)


def test_a_file_cut_anywhere_gives_one_line(program: Path, tmp_path: Path) -> None:
    """A cut file is damaged, or its debug information is missing; no cut gives other values."""
    content = program.read_bytes()
    cut = tmp_path / "cut.elf"
    whole = read_elf(program).variables
    for end in range(0, len(content), max(1, len(content) // 40)):
        cut.write_bytes(content[:end])
        text = ""
        try:
            assert read_elf(cut).variables == whole
        except InputError as error:
            text = str(error)
        assert not text or ("cut.elf" in text and "\n" not in text)
