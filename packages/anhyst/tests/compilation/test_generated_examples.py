"""Test that every C example compiles: in generated guides, in the docs, and the interrupt."""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from anhyst.compensate.plan import CompileRequest
from anhyst.compilation.output import compile_model
from anhyst.model.writer import write_model
from tests.actuators import magnet
from tests.compilation.test_compile import WARNINGS, measured
from tests.core.test_c_core import tool
from tests.docs.blocks import PAGES, blocks

FORMATS = ("q15", "q31", "f32")
CORTEX_M4 = ("-target", "thumb-freestanding-eabihf", "-mcpu=cortex_m4+vfp4d16sp")
HOST_BOARD = """
#include <stdio.h>
#include <string.h>
#include "magnet_parameters.h"

static uint16_t gap_counts = 2000, driven, stuck, ticks = 1;
static int is_off, is_stuck;
static {type} demand;
{type} board_demand(void);
uint16_t board_gap_counts(void);
uint16_t board_current_counts(void);
uint16_t board_ticks_since_last(void);
void board_drive_counts(uint16_t counts);
void board_switch_off(void);
_Bool control_init(void);
void control_tick(void);
{type} board_demand(void) {{ return demand; }}
uint16_t board_gap_counts(void) {{ return gap_counts; }}
uint16_t board_current_counts(void) {{ return is_stuck ? stuck : driven; }}
uint16_t board_ticks_since_last(void) {{ return ticks; }}
void board_drive_counts(uint16_t counts) {{ driven = counts; }}
void board_switch_off(void) {{ is_off = 1; }}

int main(int count, char **words)
{{
  int largest = 0;
  if (!control_init()) {{
    return 2;
  }}
  for (int i = 0; i < 40000; i++) {{
    if (i == 30000) {{
      demand = ({type})({demand});
    }}
    if (i == 32000 && count > 1 && strcmp(words[1], "gap") == 0) {{
      gap_counts = 4095;
    }}
    if (i == 32000 && count > 1 && strcmp(words[1], "current") == 0) {{
      is_stuck = 1;
    }}
    if (i == 33000 && count > 1 && strcmp(words[1], "missed") == 0) {{
      ticks = 5;
    }}
    control_tick();
    largest = i < 30000 && driven > largest ? driven : largest;
    if (is_off) {{
      printf("off at %d\\n", i);
      return 0;
    }}
  }}
  printf("%d then %d\\n", largest, driven);
  return 0;
}}
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("examples")
    write_model(measured(magnet(play=105.0)), folder / "magnet.toml")
    return folder


@pytest.fixture(scope="module", params=FORMATS)
def folder(place: Path, request: pytest.FixtureRequest) -> Path:
    """Compile the same magnet in each format, with small tables."""
    io = request.param
    expected = CompileRequest("full", io, 2e4, accuracy=2.0, name="magnet")
    return compile_model(place / "magnet.toml", place / io, expected).out


def io_of(folder: Path) -> str:
    return folder.name


def compiles(folder: Path, source: Path, *command: str) -> None:
    include = [f"-I{folder / 'include'}", f"-I{folder}"]
    out = source.with_suffix(".o")
    completed = subprocess.run(
        [*command, *WARNINGS, *include, "-c", str(source), "-o", str(out)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert completed.returncode == 0, completed.stderr


def guide(folder: Path) -> str:
    """Return all C of a drop-in guide in its order, as one file."""
    text = (folder / "DROP_IN.md").read_text(encoding="utf-8")
    return "\n".join(block.code for block in blocks(text) if block.language == "c")


def test_every_example_of_the_drop_in_guide_compiles(folder: Path, tmp_path: Path) -> None:
    source = tmp_path / "guide.c"
    source.write_text(guide(folder))
    assert source.read_text().count("{") > 3
    compiles(folder, source, tool("cc"))


def test_the_commands_at_the_head_of_the_example_run_as_printed(folder: Path, tmp_path: Path) -> None:
    place = Path(shutil.copytree(folder, tmp_path / "folder"))
    head = (place / "main.c").read_text().split("*/", 2)[1]
    commands = "\n".join(re.findall(r"(?m)^     .*$", head))
    assert "play_vectors <" in commands
    completed = subprocess.run(
        ["sh", "-ec", commands], cwd=place, capture_output=True, text=True, check=False
    )
    assert (completed.returncode, completed.stderr) == (0, "")
    assert completed.stdout.endswith(" rows, 0 differ\n")


def test_the_interrupt_example_compiles_for_a_cortex_m4(folder: Path, tmp_path: Path) -> None:
    source = tmp_path / "interrupt.c"
    source.write_text((folder / "example" / "interrupt.c").read_text())
    compiles(folder, source, sys.executable, "-m", "ziglang", "cc", *CORTEX_M4)


def run_interrupt(folder: Path, tmp_path: Path, *words: str) -> str:
    """Run the example on a simulated board; return its output."""
    io = io_of(folder)
    type_, demand = {
        "q15": ("int16_t", "MAGNET_DEMAND_MAX / 2"),
        "q31": ("int32_t", "MAGNET_DEMAND_MAX / 2"),
        "f32": ("float", "MAGNET_DEMAND_MAX / 2"),
    }[io]
    program = tmp_path / "program"
    board = tmp_path / "board.c"
    board.write_text(HOST_BOARD.format(type=type_, demand=demand))
    own = [folder / "magnet_parameters.c", folder / "example" / "interrupt.c", board]
    sources = [str(path) for path in (*own, *sorted((folder / "src").rglob("*.c")))]
    command = [tool("cc"), *WARNINGS, "-fsanitize=undefined", "-fno-sanitize-recover=all"]
    completed = subprocess.run(
        [*command, f"-I{folder / 'include'}", f"-I{folder}", *sources, "-o", str(program)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert completed.returncode == 0, completed.stderr
    run = subprocess.run([program, *words], capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stderr
    return run.stdout.strip()


def test_the_interrupt_example_starts_up_and_controls(folder: Path, tmp_path: Path) -> None:
    """The start-up uses the whole range of the converter; half of the force needs less."""
    match = re.fullmatch(r"(\d+) then (\d+)", run_interrupt(folder, tmp_path))
    assert match is not None
    largest, then = map(int, match.groups())
    assert largest == 4095
    assert 400 < then < 4000


@pytest.mark.parametrize("fault", ["gap", "current"])
def test_the_interrupt_example_switches_off_on_a_fault(folder: Path, tmp_path: Path, fault: str) -> None:
    """It switches off within 21 ticks of a broken gap sensor or of a current that reads zero."""
    assert run_interrupt(folder, tmp_path, fault) == "off at 32020"


def test_the_interrupt_example_survives_missed_ticks(folder: Path, tmp_path: Path) -> None:
    assert run_interrupt(folder, tmp_path, "missed") == run_interrupt(folder, tmp_path)


def test_header_states_the_limits_of_the_block(folder: Path) -> None:
    """The header also lists every function with its permitted context."""
    text = (folder / "magnet_parameters.h").read_text(encoding="utf-8")
    for signal in ("DEMAND", "CURRENT", "GAP"):
        low, high = (re.search(rf"#define MAGNET_{signal}_{end} (\S+)", text) for end in ("MIN", "MAX"))
        assert low is not None
        assert high is not None
        numbers = [float(found[1].strip("()").rstrip("f")) for found in (low, high)]
        assert numbers[0] < numbers[1]
    for name in ("solve", "commit_after", "conditioning_step", "save, restore", "swap"):
        assert name in text


def test_every_c_example_of_the_docs_compiles(tmp_path: Path) -> None:
    """Those of contributing.md are built into a board by tests/house/test_openness.py."""
    tried = 0
    for page in PAGES:
        if page.name == "contributing.md":
            continue
        for block in blocks(page.read_text(encoding="utf-8")):
            if block.language == "c":
                source = tmp_path / f"{page.stem}_{block.line}.c"
                source.write_text(f"#include <stdint.h>\n{block.code}")
                options = [flag for flag in WARNINGS if flag != "-Wpedantic"]
                command = [tool("cc"), *options, "-fsyntax-only", str(source)]
                done = subprocess.run(command, capture_output=True, text=True, check=False)
                assert done.returncode == 0, f"{page.name}:{block.line}: {done.stderr}"
                tried += 1
    assert tried > 0
