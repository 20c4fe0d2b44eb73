"""Test the code in the README of each part."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

from anhyst.compensate.plan import CompileRequest
from anhyst.compilation.output import compile_model
from tests.core.test_c_core import tool
from tests.docs.blocks import commands, refusal
from tests.repository import ROOT
from tests.truths import path_of

PARTS = ("core", "firmware", "packages/anhyst", "packages/anhyst-rigs", "packages/anhyst-exchange")


def read(part: str) -> str:
    return (ROOT / part / "README.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("part", PARTS)
def test_a_part_says_how_it_is_tested_and_its_commands_and_folders_exist(part: str) -> None:
    text = read(part)
    assert len(re.sub(r"```.*?```", "", text, flags=re.S).split()) < 400  # takes a minute
    (target,) = set(re.findall(r"`make test PART=([\w-]+)`", text))
    assert target == "c" or (ROOT / "packages" / target / "tests").is_dir()
    assert [reason for words in commands(text) if (reason := refusal(words))] == []
    named_folders = re.findall(r"`((?:include|src|packages|port)/[\w/-]+)`", text)
    assert [one for one in named_folders if not ((ROOT / part / one).exists() or (ROOT / one).exists())] == []


def test_the_c_of_the_library_s_page_runs_without_python(tmp_path: Path) -> None:
    (code,) = re.findall(r"^```c\n(.*?)^```$", read("core"), re.M | re.S)
    request = CompileRequest("full", "q15", 10_000.0, name="magnet")
    folder = compile_model(path_of("electromagnet"), tmp_path / "magnet", request).out
    main = """
int main(void)
{
  if (start() != ANHYST_OK) {
    return 1;
  }
  for (long i = 0; i < 100000; i++) { /* the start-up sequence ends */
    (void)tick(0, 9000);
  }
  const int16_t more = tick(16000, 9000);
  const int16_t less = tick(4000, 9000);
  return more > less && less > 0 ? 0 : 2;
}
"""
    (tmp_path / "main.c").write_text(code + main)
    sources = [*map(str, folder.glob("src/**/*.c")), str(folder / "magnet_parameters.c")]
    flags = ["-std=c99", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-Wno-missing-prototypes"]
    include_options = [f"-I{folder}", f"-I{folder / 'include'}"]
    program = tmp_path / "program"
    subprocess.run(
        [tool("cc"), *flags, *include_options, str(tmp_path / "main.c"), *sources, "-lm", "-o", str(program)],
        check=True,
    )
    assert subprocess.run([program], check=False).returncode == 0
