"""The main job on the bundled example: from measured loops to a model, checked on the unseen.

Inspects the loops at four gaps, identifies with both gap maps, predicts the two unseen gaps,
inverts triangular force demands between the gaps and lets the simulated magnet run the currents,
writes models, reports, plots and a table, and turns the better model into fixed-point C, which an
emulated Cortex-M4 runs bit for bit like the PC. ``make demo`` runs it; all goes to ``demo/``.

The baseline is a single-valued curve, and the best there can be: it is fitted to true loops of the
very gap it is judged at, where the model has to get along with what other gaps show.
"""

from __future__ import annotations

import argparse
import importlib.util
import sys
import time
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import numpy as np
from rich.console import Console
from rich.table import Table

from anhyst.compensate.plan import CompileRequest
from anhyst.compilation.output import compile_model
from anhyst.data import Loops
from anhyst.data.inspection import inspect
from anhyst.data.reading import read_loops
from anhyst.data.verdict import monotone_fit, single_valued
from anhyst.identification import identify
from anhyst.model.actuator import Model
from anhyst.model.file import read_model
from anhyst.model.writer import write_model
from anhyst.reports import write_plots, write_report
from anhyst.support.arrays import FloatArray
from anhyst.verification import verify

Array = FloatArray

HERE = Path(__file__).parent
BETWEEN = 0.45e-3
"""Gap of the demands, m: not measured, the one of the paper's Figs. 2 and 5."""


@dataclass(frozen=True)
class Deviation:
    """Mean and largest absolute deviation, N."""

    mean: float
    worst: float

    @classmethod
    def of(cls, parts: list[Array]) -> Deviation:
        """Over all samples of several records."""
        size = np.abs(np.concatenate(parts))
        return cls(float(size.mean()), float(size.max()))


def load_magnet() -> ModuleType:
    """Load the script that simulates the magnet; it stands beside this one."""
    name = "anhyst_example_magnet"
    if name not in sys.modules:
        spec = importlib.util.spec_from_file_location(name, HERE / "make_loops.py")
        assert spec is not None
        assert spec.loader is not None
        sys.modules[name] = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(sys.modules[name])
    return sys.modules[name]


def unseen_deviation(model: Model, truth: Loops) -> Deviation:
    """Model against noise-free loops at gaps it has not seen."""
    return Deviation.of(
        [
            model.predict(loop.input, loop.schedule, loop.time, loop.history).output - loop.output
            for loop in truth.loops
        ]
    )


def unseen_single_valued(truth: Loops) -> Deviation:
    """Judge the best single-valued curves at the same gaps, fitted to these very loops."""
    return Deviation.of([residual for _, residual in single_valued(truth)])


def triangle(low: float, high: float, samples: int = 400) -> Array:
    """One cycle of a triangular demand, from low to high and back."""
    up = np.linspace(low, high, samples // 2, endpoint=False)
    return np.concatenate([up, up[::-1] + (high - low) / (samples // 2)])


def run_magnet(current: Array, gap: float) -> Array:
    """Give the true force in the fourth cycle of a current, which the sensor's offset shifts."""
    magnet, settings = load_magnet().load()
    flowing = np.maximum(current - settings["sensors"]["current_offset_A"], 0.0)
    cycles = settings["drive"]["conditioning_cycles"] + 1
    force = np.array([magnet.step(i, gap) for i in np.tile(flowing, cycles)])
    return force[-current.size :]


def single_valued_inverse(gap: float) -> tuple[Array, Array]:
    """Best single-valued current over force at a gap, fitted to true loops there."""
    module = load_magnet()
    _, settings = module.load()
    largest = settings["drive"]["current_max_A"]
    offset = settings["sensors"]["current_offset_A"]
    parts = []
    for loop in settings["identification"]["loops"]:
        magnet, _ = module.load()
        current, force, _ = module.settled_loop(
            magnet, gap, loop["low"] * largest, loop["high"] * largest, settings
        )
        parts.append((force, current + offset))
    force, current = (np.concatenate(column) for column in zip(*parts, strict=True))
    order = np.argsort(force, kind="stable")
    return force[order], monotone_fit(current[order], np.ones(order.size))


def demand_deviations(model: Model) -> dict[str, tuple[Deviation, Deviation, float]]:
    """Open loop at a gap between those measured: demand against true force.

    Returns
    -------
    dict
        For each demand: deviation with the model inverted, with the single-valued inverse, and the
        largest force at that gap, N.
    """
    force, current = single_valued_inverse(BETWEEN)
    largest = float(force[-1])
    found = {}
    for low, high in ((0.05, 0.95), (0.30, 0.70)):
        demand = triangle(low * largest, high * largest)
        inverse = model.invert(demand, BETWEEN, history="settled")
        compensated = run_magnet(inverse.drive, BETWEEN) - demand
        plain = run_magnet(np.interp(demand, force, current), BETWEEN) - demand
        name = f"{100 * low:.0f} to {100 * high:.0f} %"
        found[name] = (Deviation.of([compensated]), Deviation.of([plain]), largest)
    return found


def table_of(models: dict[str, Model], truth: Loops, seconds: dict[str, float]) -> Table:
    """Build the one table of the demo."""
    largest = max(float(np.max(loop.output)) for loop in truth.loops)
    table = Table(title="bundled example (simulated): error of the force", title_justify="left")
    for name in ("what", "with", "mean", "worst", "in % of"):
        table.add_column(name, justify="right" if name in {"mean", "worst"} else "left")

    def add(what: str, how: str, off: Deviation, of: float) -> None:
        mean, worst = (f"{100 * value / of:.2f} %" for value in (off.mean, off.worst))
        table.add_row(what, how, mean, worst, f"{of:.1f} N")

    for name, model in models.items():
        if model.fit is not None:
            off = Deviation(model.fit.mean_abs, model.fit.worst)
            add("fit to 16 noisy loops", name, off, model.fit.largest_output)
    table.add_section()
    for name, model in models.items():
        add("two unseen gaps, truth", name, unseen_deviation(model, truth), largest)
    add("", "single-valued curve", unseen_single_valued(truth), largest)
    inverted = {name: demand_deviations(model) for name, model in models.items()}
    for demand in next(iter(inverted.values())):
        table.add_section()
        for name, found in inverted.items():
            off, plain, of = found[demand]
            add(f"demand {demand}, 0.45 mm", name, off, of)
        add("", "single-valued inverse", plain, of)
    total = f"total {sum(seconds.values()):.2f} s"
    table.caption = ", ".join(f"{what} {spent:.2f} s" for what, spent in seconds.items())
    table.caption += f": {total}"
    return table


def compiled_and_verified(model: Path, folder: Path) -> str:
    """Turn a model into C and run that on an emulated Cortex-M4; report what came out."""
    compiled = compile_model(
        model, folder, CompileRequest("full", "q15", rate=20e3, accuracy=0.2, name="electromagnet")
    )
    found = verify(folder, "cortex-m4")
    worst = compiled.manifest["accuracy"]["worst_percent"]
    size = compiled.manifest["memory"]["parameters_bytes"]
    portable = found.results[0].cost("solve")
    assert portable is not None
    verdict = "bit for bit as on the PC" if found.passed else "NOT as on the PC"
    return (
        f"fixed-point C: within {worst:.2f} % of the model, {size} bytes of "
        f"parameters, {portable.most} instructions at most on a Cortex-M4, {verdict}: {folder}/"
    )


def main() -> None:
    """Run the demo."""
    parser = argparse.ArgumentParser(description="Run the bundled example from loops to report.")
    parser.add_argument("--out", type=Path, default=Path("demo"), help="folder to write to")
    out = parser.parse_args().out
    out.mkdir(parents=True, exist_ok=True)
    console = Console()
    seconds = {}
    began = time.perf_counter()
    loops = read_loops(HERE / "loops.csv")
    truth = read_loops(HERE / "unseen_truth.csv")
    console.print(*inspect(loops).verdict.sentences, sep="\n", highlight=False)
    seconds["read and inspect"] = time.perf_counter() - began

    models = {}
    for gap_map in ("scaling", "reluctance"):
        began = time.perf_counter()
        found = identify(loops, gap_map=gap_map)
        seconds[f"identify '{gap_map}'"] = time.perf_counter() - began
        models[gap_map] = found.model
        write_model(found.model, out / f"{gap_map}.toml")
        write_plots(found.model, loops, found.fitted, out / gap_map)
        check = found.model.check_over_gap()
        assert check is not None
        console.print(f"map {gap_map}: {check.text('A')}", highlight=False)

    began = time.perf_counter()
    for gap_map in models:
        write_report(out / f"{gap_map}.toml", out / f"{gap_map}.html")
    seconds["reports"] = time.perf_counter() - began
    # What is judged is what the files hold, not what is still in memory.
    stored = {gap_map: read_model(out / f"{gap_map}.toml") for gap_map in models}
    table = table_of(stored, truth, seconds)
    console.print(table)
    with (out / "table.txt").open("w", encoding="utf-8") as file:
        Console(file=file, width=110).print(table)
    console.print(f"models, reports and plots are in {out}/", highlight=False)
    console.print(
        compiled_and_verified(out / "reluctance.toml", out / "compensator"),
        highlight=False,
        soft_wrap=True,
    )


if __name__ == "__main__":
    main()
