"""Test two compiled actuators in one program: each gives the same bits as alone."""

from __future__ import annotations

import subprocess
from pathlib import Path

import numpy as np
import pytest

from anhyst.compensate.plan import CompileRequest
from anhyst.compilation.output import compile_model
from anhyst.compilation.toolchain import Build, compile_cortex_m
from anhyst.model.writer import write_model
from anhyst.verification.compare import HARNESS_FOLDER
from anhyst.verification.elf import FLASH_ADDRESS, read_image
from tests.actuators import magnet
from tests.compilation.test_compile import measured
from tests.core.test_c_core import tool
from tests.once import made_once
from tests.repository import ROOT

EXAMPLE = ROOT / "examples" / "two_magnets"
COLUMNS = ("demand", "gap", "applied", "expected")
RAM = 0x20000000


pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def folders(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Compile two magnets with different models and kinds."""

    def compile_both(place: Path) -> None:
        write_model(measured(magnet("reluctance")), place / "left.toml")
        write_model(measured(magnet("circuit", residual=0.2)), place / "right.toml")
        left = CompileRequest("full", "q31", 1e4, name="electromagnet")
        right = CompileRequest("simplified", "q31", 1e4, name="solenoid")
        compile_model(place / "left.toml", place / "electromagnet", left)
        compile_model(place / "right.toml", place / "solenoid", right)

    return made_once(tmp_path_factory, "two-magnets", compile_both)


def merged_core(folders: Path) -> dict[str, bytes]:
    """Return the core of both folders, each file once; common files must have the same bytes."""
    merged: dict[str, bytes] = {}
    for name in ("electromagnet", "solenoid"):
        for part in ("include", "src", "port"):
            for path in sorted((folders / name / part).rglob("*.[ch]")):
                file = path.relative_to(folders / name).as_posix()
                assert merged.setdefault(file, path.read_bytes()) == path.read_bytes(), file
    return merged


def test_the_example_links_both_and_gives_their_golden_currents(folders: Path, tmp_path: Path) -> None:
    make = [tool("make"), "-s", "-f", str(EXAMPLE / "Makefile"), f"FOLDERS={folders}"]
    completed = subprocess.run(make, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (completed.returncode, completed.stderr) == (0, "")
    vectors = [str(folders / name / "vectors.csv") for name in ("electromagnet", "solenoid")]
    command = [str(tmp_path / "two_magnets"), *vectors]
    message = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (message.returncode, message.stdout) == (0, "1000 rows, 0 differ\n")
    # A difference would be found.
    message = subprocess.run([*command[:2], vectors[0]], capture_output=True, text=True, check=False)
    assert message.returncode == 1


def test_cmake_links_both(folders: Path, tmp_path: Path) -> None:
    parts = "".join(f"include({folders}/{n}/anhyst.cmake)\n" for n in ("electromagnet", "solenoid"))
    (tmp_path / "CMakeLists.txt").write_text(
        "cmake_minimum_required(VERSION 3.20)\nproject(both LANGUAGES C)\n"
        f"{parts}add_executable(both {EXAMPLE}/main.c {EXAMPLE}/magnets.c)\n"
        "target_link_libraries(both anhyst)\n"
    )
    cmake, build = tool("cmake"), str(tmp_path / "build")
    subprocess.run([cmake, "-S", str(tmp_path), "-B", build], check=True, capture_output=True)
    subprocess.run([cmake, "--build", build], check=True, capture_output=True)
    vectors = [str(folders / name / "vectors.csv") for name in ("electromagnet", "solenoid")]
    subprocess.run([f"{build}/both", *vectors], check=True, capture_output=True)


@pytest.mark.parametrize("port", [False, True], ids=["portable", "port header"])
def test_an_emulated_cortex_m4_gives_the_same_currents(folders: Path, tmp_path: Path, port: bool) -> None:
    unicorn = pytest.importorskip("unicorn", reason="unicorn: pip install 'anhyst[verify]'")
    core = merged_core(folders)
    for file, content in core.items():
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / file).write_bytes(content)
    (tmp_path / "rows.h").write_text(rows_header(folders))
    sources = [tmp_path / file for file in core if file.endswith(".c")]
    sources += [folders / name / f"{name}_parameters.c" for name in ("electromagnet", "solenoid")]
    sources += [EXAMPLE / "magnets.c", Path(__file__).with_name("two_magnets_board.c")]
    include = [tmp_path, tmp_path / "include", tmp_path / "port", EXAMPLE, HARNESS_FOLDER]
    include += [folders / "electromagnet", folders / "solenoid"]
    defines = {"ANHYST_PORT_HEADER": '"anhyst_port_cortex_m4.h"'} if port else {}
    build = Build((*sources,), (*include,), defines, ("-O2",))
    program = tmp_path / "both.elf"
    assert compile_cortex_m("cortex_m4", build, HARNESS_FOLDER / "cortex_m.ld", program) == 0

    image = read_image(program)
    cpu = unicorn.Uc(unicorn.UC_ARCH_ARM, unicorn.UC_MODE_THUMB | unicorn.UC_MODE_MCLASS)
    cpu.ctl_set_cpu_model(unicorn.arm_const.UC_CPU_ARM_CORTEX_M4)
    cpu.mem_map(FLASH_ADDRESS, 256 * 1024)
    cpu.mem_map(RAM, 64 * 1024)
    for address, content in image.segments:
        cpu.mem_write(address, content)
    cpu.reg_write(unicorn.arm_const.UC_ARM_REG_SP, image.address("link_stack_top"))
    cpu.emu_start(image.address("reset") | 1, image.address("ended"))
    found = [
        int.from_bytes(cpu.mem_read(image.address(name), 4), "little")
        for name in ("started", "rows", "wrong")
    ]
    assert found == [1, 1000, 0]


def rows_header(folders: Path) -> str:
    """Write the golden vectors of both as tables in C."""
    tables = [
        np.loadtxt(folders / name / "vectors.csv", delimiter=",", skiprows=1, dtype=np.int64)
        for name in ("electromagnet", "solenoid")
    ]
    both = np.stack(tables, axis=1)  # row, magnet, column
    lines = [f"#define ROWS {len(both)}U"]
    for place, column in enumerate(COLUMNS):
        cells = ", ".join(f"{{{a}, {b}}}" for a, b in both[:, :, place].tolist())
        cells = cells.replace("-2147483648", "INT32_MIN")
        lines.append(f"static const int32_t {column}[ROWS][MAGNETS] = {{{cells}}};")
    return "\n".join(lines) + "\n"
