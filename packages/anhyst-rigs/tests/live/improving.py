"""The bundled solenoid at one gap, with an iron that differs from its controller's model."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from anhyst.support.numeric import FloatArray
from anhyst.support.states import Command
from anhyst_rigs.rig.force.file import read_rig
from anhyst_rigs.rig.force.programs import loops_at_gap, read_rig_loops
from anhyst_rigs.study.force_control import build_program
from anhyst_rigs.study.prepared_benches import PreparedForce
from tests.study.measured_rigs import measured_rig
from tests.truths import truth

GAP = 1.0e-3
PINNING = 1.6
"""Ratio of the pinning of this iron to the pinning of the iron in the model."""

QUICK = {"sweep_A_per_s": 4.8, "sample_s": 0.005}
"""Settings of a measurement of a few seconds."""

_ONE_GAP = f"""
[excite]
gaps_m = [{GAP}]
continuous_A = 0.7
thermal_s = 60.0
"""


def unknown_iron(folder: Path) -> PreparedForce:
    """Return a controller of the bundled loops for a solenoid whose iron has stronger pinning."""
    path = measured_rig("solenoid", folder, extra_lines=_ONE_GAP, law="play-cells").path
    solenoid = folder / "solenoid.toml"
    text = solenoid.read_text(encoding="utf-8")
    pinning = "pinning_scale_A_per_m"
    before = float(text.split(pinning)[1].split("=")[1].split("#")[0].split()[0])
    for key, value in {pinning: PINNING * before, **QUICK}.items():
        line = next(line for line in text.splitlines() if line.startswith(key))
        text = text.replace(line, f"{key} = {value}")
    solenoid.write_text(text, encoding="utf-8")
    rig = read_rig(path)
    loops = loops_at_gap(read_rig_loops(rig), GAP)
    program = build_program(
        "full", truth("solenoid-held"), rig.settings.timing.rate_Hz, "library", folder / "c"
    )
    return PreparedForce(rig, loops, program)


def pinned_more(prepared: PreparedForce, factor: float) -> PreparedForce:
    """Return the same controller for an iron whose pinning increased by a factor."""
    file = prepared.complete_rig.solenoid_file
    assert file is not None
    scale = file.iron.pinning_scale_A_per_m * factor  # type: ignore[union-attr]
    iron = file.iron.model_copy(update={"pinning_scale_A_per_m": scale})
    other = file.model_copy(update={"iron": iron})
    return replace(prepared, complete_rig=replace(prepared.complete_rig, solenoid_file=other))


def swung(prepared: PreparedForce, cycles: int, period: float = 1.0) -> FloatArray:
    """Return the rows of a bench after start, while its force demand alternates."""
    bench = prepared.open()
    try:
        bench.advance(50)
        bench.command(Command.DEMAGNETISED)
        bench.command(Command.RUN)
        low, high, half = 5.0, 35.0, round(0.5 * period * bench.rate)
        bench.apply({"demand_slew": 1.2 * (high - low) / (0.5 * period)})
        parts = []
        for _ in range(cycles):
            for force in (high, low):
                bench.demand(force)
                parts.append(bench.advance(half))
    finally:
        bench.close()
    return np.concatenate(parts)
