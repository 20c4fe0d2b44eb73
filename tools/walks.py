"""Trace which files process a model on its way to C, and a rig file on its way to a recording.

``make house`` runs both jobs under a profiler. The trace records the file of each function at its
first call with an argument whose type is defined in the traced packages. Consecutive calls in one
file count as one visit. A *return* is a visit to a file that was left before. Code with fewer files
and returns is easier to read from start to end.
"""

from __future__ import annotations

import json
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from types import CodeType, FrameType

ROOT = Path(__file__).resolve().parents[1]
MODEL_FILE = ROOT / "packages" / "anhyst" / "tests" / "kept_models" / "electromagnet.toml"
RIG_FILE = ROOT / "examples" / "bearing" / "rig.toml"


class FileTrace:
    """The files that process objects of some packages, in the order of the calls."""

    def __init__(self, *packages: str) -> None:
        self.packages = packages
        self.visited_files: list[str] = []
        self._entered_functions: set[CodeType] = set()

    def trace_job(self, job: Callable[[], object]) -> dict[str, int]:
        """Run a job; return the number of files that it visits and of returns to a file."""
        sys.setprofile(self._record_call)
        try:
            job()
        finally:
            sys.setprofile(None)
        files = len(set(self.visited_files))
        return {"files": files, "returns": len(self.visited_files) - files}

    def _record_call(self, frame: FrameType, event: str, _: object) -> None:
        code = frame.f_code
        if event != "call" or code in self._entered_functions or "/src/anhyst" not in code.co_filename:
            return
        parameter_names = code.co_varnames[: code.co_argcount + code.co_kwonlyargcount]
        argument_modules = [type(frame.f_locals.get(name)).__module__ for name in parameter_names]
        if code.co_name.startswith("<") or not any(
            kind.startswith(self.packages) for kind in argument_modules
        ):
            return
        self._entered_functions.add(code)
        if self.visited_files[-1:] != [code.co_filename]:
            self.visited_files.append(code.co_filename)


def trace_model_to_c() -> dict[str, int]:
    """Trace a model to a folder of C."""
    import anhyst

    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "c"
        file_trace = FileTrace("anhyst.model", "anhyst.compensate", "anhyst.compilation")
        return file_trace.trace_job(lambda: anhyst.compile(MODEL_FILE, out, rate=20_000.0))


def trace_rig_to_recording() -> dict[str, int]:
    """Trace the rig file of a bearing to the recording of its steps."""
    from anhyst_rigs.rig.bearing.held import levitation_fault
    from anhyst_rigs.rig.bearing.loop import make_setups
    from anhyst_rigs.rig.bearing.scenario import plan_recorded_run
    from anhyst_rigs.rig.loop import SimulatedLoop
    from anhyst_rigs.study.bearing.inputs import check_inputs, read_files

    def job() -> None:
        rig, controller = read_files(RIG_FILE, None)
        prepared_rig = check_inputs(rig, controller)
        variant = controller.settings.compensation.variant
        setup = make_setups(prepared_rig.rig, controller, prepared_rig.identify_magnet(), (variant,))[variant]
        steps, *_ = plan_recorded_run(prepared_rig.rig, setup.controller)
        assert levitation_fault(setup, SimulatedLoop(setup).run(steps), steps) is None

    return FileTrace("anhyst_rigs").trace_job(job)


if __name__ == "__main__":
    print(json.dumps({"model to C": trace_model_to_c(), "rig to recording": trace_rig_to_recording()}))
