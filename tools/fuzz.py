"""Fuzz the firmware: parser, request handler, XCP slave and control task.

Usage: ``python tools/fuzz.py [--runs N] [--seed N] [--out FOLDER]``

A small model is compiled as the compensators ``full`` and ``simplified``. For each of them, the
harness tests/firmware/fuzz_firmware.c is built with clang's libFuzzer and its address and
undefined-behaviour sanitizers. Both programs run in parallel, each with half of the inputs. The
same number of inputs is run with XCP commands only, because other inputs need most of the time. The
exit code is 1 if an input caused a fault. That input is saved in the folder.
"""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import sys
from pathlib import Path

from anhyst.compensate.plan import CompileRequest
from anhyst.compilation.output import compile_model
from anhyst.model.actuator import Model
from anhyst.model.parameters import Parameter
from anhyst.model.schema import ValidRange
from anhyst.model.writer import write_model
from anhyst.support.units import QUANTITIES
from anhyst_rigs.link.firmware import actuator_defines

ROOT = Path(__file__).resolve().parents[1]
VARIANTS = ("full", "simplified")
XCP_RUNS = ("xcp-1", "xcp-2")
"""Runs with only XCP commands, each with its own seed."""

TICK_RATE_HZ = 100.0
"""Ticks per second. The rate is low, so that the heartbeat of 0.1 s is only a few ticks of a
script."""

COMPILER_FLAGS = [
    *("-std=c99", "-O2", "-g", "-fsanitize=fuzzer,address,undefined", "-fno-sanitize-recover=all"),
    # Comparisons need not be traced, because the harness makes valid frames itself. This doubles
    # the speed.
    "-fno-sanitize-coverage=trace-cmp,trace-div,trace-gep",
]
NAME = "magnet"
MAX_SCRIPT_BYTES = 160
"""Maximum length of an input, bytes."""


def make_small_magnet() -> Model:
    """Return a model of an electromagnet with two gaps."""
    gaps = (0.3e-3, 0.6e-3)
    parameters: dict[str, Parameter] = {"M_s": 1e6, "a": 1000.0, "k": 700.0, "c": 0.2}
    parameters |= {"c_H": 12e3, "rho": tuple(2e-4 + 11.5 * gap for gap in gaps)}
    parameters |= {"c_out": 60.0, "in_0": 0.015, "out_0": -0.4}
    return Model(
        "small magnet",
        QUANTITIES["current"],
        QUANTITIES["force"],
        parameters,
        gap_map="reluctance",
        schedule=QUANTITIES["gap"],
        nodes=gaps,
        valid=ValidRange((0.0, 2.0), (0.0, 200.0), (gaps[0], gaps[-1])),
    )


def build_harness(run_name: str, folder: Path, clang: str) -> Path:
    """Compile the compensator and the harness with it; return the program."""
    object_folder = folder / f"compiled-{run_name}"
    is_xcp_only = run_name in XCP_RUNS
    variant = VARIANTS[1] if is_xcp_only else run_name
    compile_model(
        folder / "model.toml", object_folder, CompileRequest(variant, "q31", TICK_RATE_HZ, name=NAME)
    )  # type: ignore[arg-type]
    sources = [
        ROOT / "tests" / "firmware" / "fuzz_firmware.c",
        *sorted(ROOT.glob("firmware/link/*.c")),
        *sorted(ROOT.glob("firmware/app/*.c")),
        *sorted(ROOT.glob("firmware/xcp/*.c")),
        *sorted(ROOT.glob("firmware/force/*.c")),
        ROOT / "core" / "src" / "control" / "supervisor.c",
        *sorted(object_folder.glob("src/*/*.c")),
        *object_folder.glob("*_parameters.c"),
    ]
    program = folder / f"fuzz-{run_name}"
    include = (ROOT / "firmware", object_folder / "include", ROOT / "core" / "include", object_folder)
    options = [f"-I{folder_path}" for folder_path in include]
    options += [f"-D{key}={value}" for key, value in actuator_defines(NAME).items()]
    options += ["-DFUZZ_XCP"] if is_xcp_only else []
    subprocess.run([clang, *COMPILER_FLAGS, *options, *map(str, sources), "-o", str(program)], check=True)
    return program


def start_run(run_name: str, program: Path, runs: int, seed: int) -> subprocess.Popen[str]:
    """Start a run of the fuzzer with an empty corpus."""
    corpus = program.with_name(f"corpus-{run_name}")
    shutil.rmtree(corpus, ignore_errors=True)
    corpus.mkdir()
    options = {
        "max_len": MAX_SCRIPT_BYTES,
        "runs": runs,
        "seed": seed,
        "entropic": 0,
        "reduce_inputs": 0,
        "artifact_prefix": f"{program.parent}/{run_name}-",
    }
    command = [str(program), *(f"-{name}={value}" for name, value in options.items()), str(corpus)]
    log = program.with_suffix(".log").open("w", encoding="utf-8")
    with log:
        return subprocess.Popen(command, stdout=log, stderr=subprocess.STDOUT, text=True)


def fuzz(runs: int, seed: int, folder: Path) -> int:
    """Build and run all programs; return the exit code."""
    clang = shutil.which("clang")
    if clang is None:
        print("clang is not installed: apt install clang libclang-rt-dev")
        return 2
    folder.mkdir(parents=True, exist_ok=True)
    write_model(make_small_magnet(), folder / "model.toml")
    failures = sum(
        run_in_parallel(run_names, runs, seed, folder, clang) for run_names in (XCP_RUNS, VARIANTS)
    )
    return 1 if failures else 0


def run_in_parallel(run_names: tuple[str, str], runs: int, seed: int, folder: Path, clang: str) -> int:
    """Build and run two programs, each with half of the inputs; return the number of failures."""
    programs = {run_name: build_harness(run_name, folder, clang) for run_name in run_names}
    running_processes = {
        run_label: start_run(run_label, programs[run_label], runs // 2, seed + number)
        for number, run_label in enumerate(run_names)
    }
    failures = 0
    for kind, process in running_processes.items():
        code = process.wait()
        log = programs[kind].with_suffix(".log").read_text(encoding="utf-8", errors="replace")
        edges = re.findall(r"cov: (\d+)", log)
        summaries = re.findall(r"^Done (\d+) runs in (\d+) second", log, re.MULTILINE)
        if code == 0 and summaries:
            inputs, seconds = summaries[-1]
            print(f"{kind}: {inputs} inputs in {seconds} s, {edges[-1]} edges reached, no fault")
        else:
            failures += 1
            print(f"{kind}: broken\n{log[-3000:]}")
    return failures


def main() -> int:
    """Read the command line and run the fuzzer."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0] if __doc__ else None)
    parser.add_argument("--runs", type=int, default=10_000_000, help="inputs altogether")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "fuzz")
    options = parser.parse_args()
    return fuzz(options.runs, options.seed, options.out)


if __name__ == "__main__":
    sys.exit(main())
