"""Run a prover on one copy of core/."""

from __future__ import annotations

import os
import signal
import subprocess
import tempfile
from dataclasses import dataclass
from pathlib import Path
from threading import Timer

from tools.prove.copies import copy_core
from tools.prove.listing import ROOT, Proof
from tools.prove.provers import command
from tools.prove.verdict import PROVED, REFUTED, TIMEOUT, verdict_of

MAX_PROCESSOR_S = 1200  # limit of the processor time of one run of a tool, s
MAX_ELAPSED_S = 3600  # limit of the elapsed time of one run, even on a busy machine, s


@dataclass(frozen=True)
class Outcome:
    """The verdict of a tool, its processor time in seconds, and its output."""

    verdict: str
    seconds: float
    output: str


@dataclass(frozen=True)
class Evidence:
    """The results of a proof and of its control."""

    real: Outcome
    control: Outcome

    @property
    def holds(self) -> bool:
        """Whether the tool proved the property and rejected the control."""
        return self.real.verdict == PROVED and self.control.verdict == REFUTED

    @property
    def seconds(self) -> float:
        """Processor time of both runs, s."""
        return self.real.seconds + self.control.seconds


def run_prover(proof: Proof, *, broken: bool) -> Outcome:
    """Run one proof on a copy of core/, or its control on a copy with the seeded fault."""
    with tempfile.TemporaryDirectory() as folder:
        core, log = Path(folder) / "core", Path(folder) / "log"
        copy_core(ROOT / "core", proof, core, broken=broken)
        limited = ["sh", "-c", f'ulimit -t {MAX_PROCESSOR_S}; exec "$@"', "sh", *command(proof, core)]
        with log.open("wb") as out:
            process = subprocess.Popen(limited, cwd=folder, stdout=out, stderr=subprocess.STDOUT)
            timer = Timer(MAX_ELAPSED_S, process.kill)
            timer.start()
            _, status, resource_usage = os.wait4(process.pid, 0)  # wait4 returns the processor time
            timer.cancel()
            process.returncode = os.waitstatus_to_exitcode(status)
        output = log.read_text(encoding="utf-8", errors="replace")
        is_timeout = process.returncode in {-signal.SIGXCPU, -signal.SIGKILL}
        verdict = TIMEOUT if is_timeout else verdict_of(proof.tool, output)
        return Outcome(verdict, resource_usage.ru_utime + resource_usage.ru_stime, output)
