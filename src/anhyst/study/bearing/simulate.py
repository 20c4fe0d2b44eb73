"""Simulate a magnetic bearing and report what compensation is worth: ``anhyst simulate``."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from anhyst.compensate.force_controller import MethodName
from anhyst.compensate.methods import BASELINES, MODELS, PROBED
from anhyst.control.controller_file import ControllerFile
from anhyst.data.table import check_recording
from anhyst.model.compilable import has_layers
from anhyst.model.writer import write_model
from anhyst.rig.bearing.loop import LevitationRun, Setup, SimulatedLoop, lost_blocks, parts_of_run
from anhyst.rig.bearing.make_setup import calibrated_magnets, make_setups
from anhyst.rig.bearing.scenario import steps_up_and_down
from anhyst.rig.body import BodyRig
from anhyst.rig.distance import PlantCheck
from anhyst.rig.fitting import IdentifiedMagnet, check_plant
from anhyst.rig.loop import Scenario
from anhyst.rig.recording import Recording
from anhyst.study.bearing import experiments, linear
from anhyst.study.bearing.operating import (
    OperatingPoint,
    has_constants,
    linear_loop,
    make_ready,
    read_files,
    sweep_frequencies,
)
from anhyst.study.bearing.responses import (
    Sensitivity,
    StepCell,
    as_rows,
    compare,
    default_seeds,
    sweep,
)
from anhyst.support.atomic import PathLike, atomic_writer
from anhyst.support.errors import InputError, NegativeResult
from anhyst.support.json_text import json_text
from anhyst.support.progress import Progress, in_parts
from anhyst.support.result import Result, columns_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COMPARED = (*BASELINES, "flux", *(name for name in MODELS if name not in ("at-rest", "fused")))
"""What stands beside the variant of the controller file; ``flux`` only with a Hall probe."""
FIGURES = "figures.json"
"""What is written beside the recording."""
_WORK_OF_PARTS = (5.0, 4.0)
"""Model and first run, then the steps, in units of any other experiment."""


@dataclass(frozen=True, repr=False)
class Simulation(Result):
    """What a simulation gave.

    Parameters
    ----------
    rig : BodyRig
    controller : ControllerFile
    knowledge : IdentifiedMagnet
        Loops and model.
    setups : mapping of str to Setup
        By variant.
    at : OperatingPoint
    recording : Recording
        Of the controller file's own variant: lift-off, steps, load steps, landing.
    shown : mapping of str to Recording
        The steps alone, one noise seed, by variant.
    scenario : Scenario
        Of these.
    cells : list of StepCell
        Figures of all steps, over all seeds.
    loops : mapping of str to linear.SimulatedLoop
        For small movements, by variant.
    sensitivity : mapping of str to Sensitivity
        As measured, by variant; without those that lost levitation.
    plant : PlantCheck
        What the loops say about the plant.
    figures : dict
        What ``figures.json`` holds; infinite where a level was not reached, null in the file.
    """

    rig: BodyRig
    controller: ControllerFile
    knowledge: IdentifiedMagnet
    setups: Mapping[MethodName, Setup]
    at: OperatingPoint
    recording: Recording
    shown: Mapping[MethodName, Recording]
    scenario: Scenario
    cells: list[StepCell]
    loops: Mapping[MethodName, linear.LinearLoop]
    sensitivity: Mapping[MethodName, Sensitivity]
    plant: PlantCheck
    figures: dict[str, Any]

    @property
    def lost_in(self) -> list[str]:
        """Everything tried in which the controller file's own variant lost levitation."""
        lost: list[str] = self.figures["lost_in"]
        return lost

    def refuse_losses(self) -> None:
        """Raise NegativeResult where the controller file's own variant lost levitation."""
        if self.lost_in:
            raise NegativeResult(
                f"'{self.own}' of the controller file lost levitation: {'; '.join(self.lost_in)}; "
                "figures and recording are kept",
                code="levitation-lost",
            )

    @property
    def own(self) -> MethodName:
        """MethodName of the controller file."""
        return self.controller.settings.compensation.variant

    def facts(self) -> dict[str, str]:
        """Return overshoot and standstill of every variant at the highest step."""
        facts = {"rig": self.rig.settings.name, "controller": self.own}
        for name in self.setups:
            last = [cell for cell in self.cells if cell.variant == name][-1]
            facts[name] = (
                f"overshoot {last.of('overshoot_percent').mean:.2f} % of "
                f"{1e6 * last.height:g} um, standstill "
                f"{1e9 * last.of('standstill_rms_m').mean:.0f} nm"
            )
        return facts | ({"lost levitation in": "; ".join(self.lost_in)} if self.lost_in else {})

    def to_columns(self) -> dict[str, Any]:
        """Return the figures of all steps, one row a variant, gap and height, SI and per cent."""
        names = next((list(cell.figures) for cell in self.cells if cell.figures), [])
        return columns_of(
            [
                {
                    "variant": cell.variant,
                    "gap_m": cell.gap,
                    "step_m": cell.height,
                    "load_N": cell.load,
                    "lost": cell.lost,
                    **{name: cell.of(name).mean for name in names},
                }
                for cell in self.cells
            ]
        )

    def as_dict(self) -> dict[str, Any]:
        """Return what ``figures.json`` holds."""
        return self.figures

    def draw(self, ax: Axes) -> None:
        """Draw the steps of every variant: gap over time, one noise seed."""
        for name, run in self.shown.items():
            ax.plot(run["t_s"], 1e3 * run["gap_m"], lw=0.9, label=name)
        ax.set_xlabel("time [s]")
        ax.set_ylabel("gap [mm]")

    def save(self, path: PathLike) -> Path:
        """Write recording, identified model and ``figures.json``; see :func:`write_simulation`."""
        write_simulation(self, path)
        return Path(path)


def simulate(
    rig_path: PathLike,
    out: PathLike,
    controller_path: PathLike | None = None,
    progress: Progress | None = None,
) -> Simulation:
    """Simulate a bearing with every kind of compensation; write recording and ``figures.json``.

    As :func:`explore`, and :func:`write_simulation` of what it found.
    """
    simulation = explore(rig_path, out, controller_path, progress)
    write_simulation(simulation, out)
    return simulation


def explore(
    rig_path: PathLike,
    out: PathLike | None = None,
    controller_path: PathLike | None = None,
    progress: Progress | None = None,
) -> Simulation:
    """Simulate a bearing with every kind of compensation."""
    rig, controller = read_files(rig_path, controller_path)
    ready = make_ready(rig, controller, _places(out, controller))
    rig = ready.rig
    tried = rig.settings
    beside_steps = len(tried.trajectories) + len(tried.load_steps_N) + len(experiments.EVENTS)
    parts = in_parts(progress, [*_WORK_OF_PARTS, *[1.0] * (1 + beside_steps)])
    knowledge = ready.knowledge()
    own = controller.settings.compensation.variant
    mine = make_setups(rig, controller, knowledge, (own,))[own]
    run = _whole_run(mine)
    fault = run.fault()
    if fault and out is None:
        raise NegativeResult(fault, code="levitation-lost")
    if fault and out is not None:
        (Path(out).parent / FIGURES).unlink(missing_ok=True)  # of another recording
        _write_recording(out, run.recording, rig, controller, knowledge)
        raise NegativeResult(f"{fault}; the recording is kept in {out}", code="levitation-lost")
    next(parts)(1, 1)
    setups, left_out = _beside(mine, controller, knowledge)
    simulation = _compare(controller, knowledge, setups, ready.at, run.recording, parts)
    simulation.figures["left_out"] = left_out
    simulation.figures["lost_in"] = [*run.lost_later(), *lost_blocks(simulation.figures)]
    return simulation


def _places(out: PathLike | None, controller: ControllerFile) -> tuple[PathLike, ...]:
    """Return what is written for a recording."""
    if out is None:
        return ()
    check_recording(out)
    model_file = [] if controller.model is not None else [_model_file(out)]
    return (out, Path(out).parent / FIGURES, *model_file)


def write_simulation(simulation: Simulation, out: PathLike) -> None:
    """Write recording, identified model and ``figures.json``."""
    _write_recording(
        out, simulation.recording, simulation.rig, simulation.controller, simulation.knowledge
    )
    with atomic_writer(Path(out).parent / FIGURES) as stream:
        stream.write(json_text(simulation.figures))


def _write_recording(
    out: PathLike,
    recording: Recording,
    rig: BodyRig,
    controller: ControllerFile,
    knowledge: IdentifiedMagnet,
) -> None:
    recording.save(out)
    if controller.model is None:
        magnets = calibrated_magnets(rig, knowledge, controller.settings.compensation.variant)
        # each of a calibrated pair has one of its own
        known = knowledge if len(magnets) > 1 else magnets[0]
        write_model(known.model, _model_file(out))


def _model_file(out: PathLike) -> Path:
    """Return where the model that was identified goes."""
    return Path(out).with_suffix(".model.toml")


def _beside(
    mine: Setup, controller: ControllerFile, knowledge: IdentifiedMagnet
) -> tuple[dict[MethodName, Setup], dict[MethodName, str]]:
    """Fit what is compared with a setup; report what cannot be made, such as a law without a loop."""
    setups: dict[MethodName, Setup] = {}
    left_out: dict[MethodName, str] = {}
    late: tuple[MethodName, ...] = ("at-rest",) if has_layers(knowledge.model) else ()
    for name in (*compared(mine.rig, mine.name), *late):
        try:
            setups |= (
                {name: mine}
                if name == mine.name
                else make_setups(mine.rig, controller, knowledge, (name,))
            )
        except InputError as error:
            left_out[name] = str(error)
    return setups, left_out


def _compare(
    controller: ControllerFile,
    knowledge: IdentifiedMagnet,
    setups: Mapping[MethodName, Setup],
    at: OperatingPoint,
    recording: Recording,
    parts: Iterator[Progress],
) -> Simulation:
    """Try everything with every variant."""
    rig = setups[controller.settings.compensation.variant].rig
    tried = rig.settings
    cells = compare(
        list(setups.values()),
        [rig.settings.gap_m, *rig.settings.step.also_gaps_m],
        _heights(rig),
        [_load(rig)],
        default_seeds(rig),
        next(parts),
    )
    scenario = steps_up_and_down(rig, controller.settings, tried.gap_m, _heights(rig))
    loops = {name: linear_loop(setup, at) for name, setup in setups.items()}
    point, frequencies = (tried.gap_m, _load(rig)), sweep_frequencies(rig)
    swept = {
        name: sweep(sensitivity, *point, frequencies, seed=0)
        for name, sensitivity in setups.items()
    }
    plant = check_plant(rig, knowledge)
    figures = {
        **_head(rig, controller),
        "plant": plant.as_dict(),
        "operating_point": _point(at),
        "steps": as_rows(cells),
        **_experiments(rig, setups, parts),
        "loop": {
            name: asdict(loops[name].margins) if has_constants(setup) else None
            for name, setup in setups.items()
        },
        "sensitivity": {
            name: sensitivity
            and {
                "peak": sensitivity.peak,
                "peak_Hz": sensitivity.peak_frequency,
                "zone": sensitivity.zone,
            }
            for name, sensitivity in swept.items()
        },
    }
    return Simulation(
        rig=rig,
        controller=controller,
        knowledge=knowledge,
        setups=setups,
        at=at,
        recording=recording,
        shown={name: SimulatedLoop(setup).run(scenario) for name, setup in setups.items()},
        scenario=scenario,
        cells=cells,
        loops=loops,
        sensitivity={
            name: sensitivity for name, sensitivity in swept.items() if sensitivity is not None
        },
        plant=plant,
        figures=figures,
    )


def _head(rig: BodyRig, controller: ControllerFile) -> dict[str, Any]:
    """Return what was simulated."""
    return {
        "format": "anhyst-simulation",
        "rig": rig.settings.name,
        "controller": controller.settings.name,
        "variant": controller.settings.compensation.variant,
        "number_format": controller.settings.compensation.format,
        "supply_V": rig.settings.amplifier.supply,
        "rate_Hz": rig.settings.timing.rate_Hz,
        "delay_ticks": rig.settings.timing.delay_ticks,
    }


def compared(rig: BodyRig, own: MethodName) -> tuple[MethodName, ...]:
    """Return all variants that a rig allows, that of the controller file among them."""
    methods = [
        name for name in COMPARED if name not in PROBED or rig.settings.hall_probe is not None
    ]
    return tuple(dict.fromkeys([*methods, own]))


def _heights(rig: BodyRig) -> list[float]:
    return rig.settings.step.heights_m


def _load(rig: BodyRig) -> float:
    return rig.settings.load.force_N


def _whole_run(setup: Setup) -> LevitationRun:
    """Lift off, step, load, land."""
    steps, after, landing = parts_of_run(setup)
    loop = SimulatedLoop(setup)
    parts = [loop.run(steps)]
    if len(parts[0]) == steps.ticks:
        parts.append(loop.run(after))
    return LevitationRun(setup, Recording.joined(parts), steps, landing)


def _experiments(
    rig: BodyRig, setups: Mapping[MethodName, Setup], parts: Iterator[Progress]
) -> dict[str, Any]:
    """Try everything beside steps, with every variant."""
    seeds: Sequence[int] = default_seeds(rig)
    tried = rig.settings
    figures: dict[str, Any] = {
        "standstill": experiments.of_all(experiments.stand_still, setups, seeds, None, next(parts))
    }
    figures["trajectories"] = [
        {
            "kind": shape.kind,
            "amplitude_m": shape.amplitude_m,
            "frequency_Hz": shape.frequency_Hz,
            "variants": experiments.of_all(experiments.follow, setups, seeds, shape, next(parts)),
        }
        for shape in tried.trajectories
    ]
    figures["load_steps"] = [
        {
            "force_N": force,
            "variants": experiments.of_all(
                experiments.step_load, setups, seeds, force, next(parts)
            ),
        }
        for force in tried.load_steps_N
    ]
    figures["events"] = {
        event: experiments.of_all(experiments.recover, setups, seeds, event, next(parts))
        for event in experiments.EVENTS
    }
    return figures


def _point(at: OperatingPoint) -> dict[str, Any]:
    slopes = at.slopes
    return {
        "gap_m": at.gap,
        "force_N": at.force,
        "current_A": at.current,
        "force_max_N": at.force_max,
        "k_i_N_per_A": slopes.static.k_i,
        "k_s_N_per_m": at.point.k_s,
        "k_i_after_reversal_N_per_A": min(slopes.after_rise, slopes.after_fall),
        "iron": slopes.label,
        "inductance_H": at.point.inductance,
        "unstable_pole_Hz": at.point.pole_at_current,
    }
