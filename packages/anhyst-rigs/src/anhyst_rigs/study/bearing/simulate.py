"""Simulate a magnetic bearing and assess its compensation: the command ``anhyst simulate``.

All variants run with the same gains. The rig file defines steps, trajectories and load steps.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from anhyst.compensate.methods import BASELINE_METHODS, MODEL_METHODS
from anhyst.control.controller_file import ControllerFile
from anhyst.data.table import check_recording
from anhyst.model.prediction import describe_fast_drives
from anhyst.model.writer import write_model
from anhyst.support.atomic import PathLike
from anhyst.support.errors import InputError, NegativeResult
from anhyst.support.jobs import Progress, split_progress
from anhyst.support.kinds import FLUX_PROBE_METHODS, MethodName
from anhyst.support.result import rows_to_columns
from anhyst_rigs.rig.bearing.held import levitation_fault, losses_after_steps
from anhyst_rigs.rig.bearing.loop import BearingSetup, calibrated_magnets, make_setups
from anhyst_rigs.rig.bearing.scenario import plan_recorded_run
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.distance import PlantCheck
from anhyst_rigs.rig.fitting import IdentifiedMagnet, check_plant
from anhyst_rigs.rig.loop import Scenario, SimulatedLoop
from anhyst_rigs.rig.recording import Recording
from anhyst_rigs.study.bearing import experiments, linear
from anhyst_rigs.study.bearing.inputs import check_inputs, read_files
from anhyst_rigs.study.bearing.operating import (
    OperatingPoint,
    has_constant_gains,
    make_linear_loop,
    sweep_frequencies,
)
from anhyst_rigs.study.bearing.responses import (
    Sensitivity,
    StepCell,
    compare_steps,
    default_seeds,
    group_by_step,
    judge_steps,
    measure_loop_sensitivity,
)
from anhyst_rigs.study.engine.table import FIGURES_FILE, CaseFigures, Judgement, StudyResult, save_lost_run

if TYPE_CHECKING:
    from matplotlib.axes import Axes

COMPARED_VARIANTS = (
    *BASELINE_METHODS,
    "flux",
    *(name for name in MODEL_METHODS if name not in ("at-rest", "fused")),
)
"""Variants compared with the variant of the controller file; ``flux`` requires a Hall
probe."""
_PART_WORK = (5.0, 4.0)
"""Work of model and first run, then of the steps, relative to that of another experiment."""


@dataclass(frozen=True, repr=False)
class Simulation(StudyResult):
    """The result of a simulation.

    Parameters
    ----------
    rig : BodyRig
    controller : ControllerFile
    knowledge : IdentifiedMagnet
        Loops and model.
    setups : mapping of str to BearingSetup
        By variant.
    operating_point : OperatingPoint
    recording : Recording
        Run of the variant of the controller file: lift-off, steps, load steps, landing.
    step_recordings : mapping of str to Recording
        Runs of the steps with one noise seed, by variant.
    scenario : Scenario
        Scenario of these runs.
    cells : list of StepCell
        Metrics of all steps, over all seeds.
    experiments : Experiments
        Metrics of all other experiments.
    loops : mapping of str to linear.LinearLoop
        Linear loops for small movements, by variant.
    sensitivity : mapping of str to Sensitivity
        Measured sensitivities, by variant; without variants that lost levitation.
    plant : PlantCheck
        Comparison of the plant with the measured loops.
    left_out : mapping of str to str
        Variants that could not be made, with the reason.
    losses_after_steps : sequence of str
        Parts of the recording after the steps in which levitation was lost.
    """

    kind: ClassVar = "levitation"
    rig: BodyRig
    controller: ControllerFile
    knowledge: IdentifiedMagnet
    setups: Mapping[MethodName, BearingSetup]
    operating_point: OperatingPoint
    recording: Recording
    step_recordings: Mapping[MethodName, Recording]
    scenario: Scenario
    cells: list[StepCell]
    experiments: experiments.Experiments
    loops: Mapping[MethodName, linear.LinearLoop]
    sensitivity: Mapping[MethodName, Sensitivity]
    plant: PlantCheck
    left_out: Mapping[MethodName, str]
    losses_after_steps: Sequence[str]

    @property
    def lost_in(self) -> list[str]:
        """All experiments in which the controller's own variant lost the levitation."""
        all_experiments = self.experiments
        blocks: list[tuple[str, CaseFigures]] = [
            *(
                (f"steps at {1e3 * figures.gap:g} mm", figures)
                for figures in self.cells
                if figures.variant == self.main_variant
            ),
            ("standstill", all_experiments.standstill[self.main_variant]),
        ]
        for shape, by_variant in all_experiments.trajectories:
            title = f"{shape.kind} of {1e6 * shape.amplitude_m:g} um"
            blocks.append((title, by_variant[self.main_variant]))
        for force, by_variant in all_experiments.load_steps:
            blocks.append((f"load step of {force:g} N", by_variant[self.main_variant]))
        blocks += [
            (event, by_variant[self.main_variant]) for event, by_variant in all_experiments.events.items()
        ]
        lost_counts = {title: figures.lost for title, figures in blocks if figures.lost}
        runs = [f"{title} ({n} run{'' if n == 1 else 's'})" for title, n in lost_counts.items()]
        sensitivity_losses = [] if self.main_variant in self.sensitivity else ["sensitivity"]
        return [*self.losses_after_steps, *runs, *sensitivity_losses]

    def refuse_losses(self) -> None:
        """Raise NegativeResult if the variant of the controller file lost levitation."""
        if self.lost_in:
            raise NegativeResult(
                f"'{self.main_variant}' of the controller file lost levitation: {'; '.join(self.lost_in)}; "
                "metrics and recording are saved",
                code="levitation-lost",
            )

    @property
    def verdict(self) -> Judgement:
        """Whether compensation is beneficial, judged by the overshoots of all steps."""
        return judge_steps(group_by_step(self.cells), self.main_variant)

    @property
    def main_variant(self) -> MethodName:
        """The variant of the controller file."""
        return self.controller.settings.compensation.variant

    def facts(self) -> dict[str, str]:
        """Return the overshoot and the standstill rms of every variant at the highest step."""
        facts = {"rig": self.rig.settings.name, "controller": self.main_variant}
        for name in self.setups:
            highest_step = [step_cell for step_cell in self.cells if step_cell.variant == name][-1]
            facts[name] = (
                f"overshoot {highest_step.interval('overshoot_percent').mean:.2f} % of "
                f"{1e6 * highest_step.height:g} um, standstill "
                f"{1e9 * highest_step.interval('standstill_rms_m').mean:.0f} nm"
            )
        return facts | self.losses_fact()

    @property
    def speed_notes(self) -> tuple[str, ...]:
        """A warning if the currents changed faster than the loops of the model allow."""
        return describe_fast_drives(self.knowledge.model, self.recording.current_runs)

    def to_columns(self) -> dict[str, Any]:
        """Return the metrics of all steps, one row per variant, gap and height, SI or per cent."""
        names = next((list(step_cell.figures) for step_cell in self.cells if step_cell.figures), [])
        rows = []
        for cell in self.cells:
            case = {"gap_m": cell.gap, "step_m": cell.height, "load_N": cell.load}
            mean_figures = {name: cell.interval(name).mean for name in names}
            rows.append({"variant": cell.variant, **case, "lost": cell.lost, **mean_figures})
        return rows_to_columns(rows)

    @cached_property
    def figures(self) -> dict[str, Any]:
        """The content of ``figures.json``, with infinity for levels that were not reached."""
        rig, controller = self.rig.settings, self.controller.settings
        sensitivities = {
            name: {"peak": response.peak, "peak_Hz": response.peak_frequency, "zone": response.zone}
            for name, response in self.sensitivity.items()
        }
        return {
            "format": "anhyst-simulation",
            "rig": rig.name,
            "controller": controller.name,
            "variant": controller.compensation.variant,
            "number_format": controller.compensation.format,
            "supply_V": rig.amplifier.supply,
            "rate_Hz": rig.timing.rate_Hz,
            "delay_ticks": rig.timing.delay_ticks,
            "plant": self.plant.as_dict(),
            "operating_point": _operating_point_dict(self.operating_point),
            "steps": [step_cell.as_dict() for step_cell in self.cells],
            **self.experiments.as_dict(),
            "loop": {
                name: asdict(self.loops[name].margins) if has_constant_gains(setup) else None
                for name, setup in self.setups.items()
            },
            "sensitivity": {name: sensitivities.get(name) for name in self.setups},
            "left_out": dict(self.left_out),
            "lost_in": self.lost_in,
        }

    def as_dict(self) -> dict[str, Any]:
        """Return the content of ``figures.json``."""
        return self.figures

    def draw(self, ax: Axes) -> None:
        """Draw the gap over time during the steps, for every variant and one noise seed."""
        for name, run in self.step_recordings.items():
            ax.plot(run["t_s"], 1e3 * run["gap_m"], lw=0.9, label=name)
        ax.set_xlabel("time [s]")
        ax.set_ylabel("gap [mm]")

    def save(self, path: PathLike) -> Path:
        """Write the recording, the identified model and ``figures.json``."""
        self.recording.save(path)
        _write_model(path, self.rig, self.controller, self.knowledge)
        self.write_figures(Path(path).parent / FIGURES_FILE)
        return Path(path)


def simulate_bearing(
    rig_path: PathLike,
    out: PathLike | None = None,
    controller_path: PathLike | None = None,
    progress: Progress | None = None,
) -> Simulation:
    """Simulate a bearing with all variants; files are written only if levitation is lost."""
    rig, controller = read_files(rig_path, controller_path)
    inputs = check_inputs(rig, controller, _output_paths(out, controller))
    rig = inputs.rig
    settings = rig.settings
    experiment_count = len(settings.trajectories) + len(settings.load_steps_N) + len(experiments.EVENTS)
    part_progress = split_progress(progress, [*_PART_WORK, *[1.0] * (1 + experiment_count)])
    knowledge = inputs.identify_magnet()
    main_variant = controller.settings.compensation.variant
    main_setup = make_setups(rig, controller, knowledge, (main_variant,))[main_variant]
    steps, load_steps, landing_tick = plan_recorded_run(rig, main_setup.controller)
    loop = SimulatedLoop(main_setup)
    recording = step_recording = loop.run(steps)
    if len(step_recording) == steps.ticks:
        recording = Recording.concatenate([step_recording, loop.run(load_steps)])
    if fault := levitation_fault(main_setup, recording, steps):
        if out is None:
            raise NegativeResult(fault, code="levitation-lost")
        save_lost_run(recording, out)
        _write_model(out, rig, controller, knowledge)
        raise NegativeResult(f"{fault}; the recording is kept in {out}", code="levitation-lost")
    next(part_progress)(1, 1)
    setups, left_out = _make_compared_setups(main_setup, controller, knowledge)
    shown_recordings = {
        name: step_recording if name == main_variant else SimulatedLoop(setup).run(steps)
        for name, setup in setups.items()
    }
    heights, load, seeds = settings.step.heights_m, settings.load.force_N, default_seeds(rig)
    all_setups = list(setups.values())
    cells = compare_steps(all_setups, settings.step_gaps_m, heights, [load], seeds, next(part_progress))
    experiment_results = experiments.run_experiments(rig, setups, seeds, part_progress)
    frequencies_Hz = sweep_frequencies(rig)
    sensitivities = {
        name: measure_loop_sensitivity(setup, settings.gap_m, load, frequencies_Hz, seed=0)
        for name, setup in setups.items()
    }
    return Simulation(
        rig=rig,
        controller=controller,
        knowledge=knowledge,
        setups=setups,
        operating_point=inputs.operating_point,
        recording=recording,
        step_recordings=shown_recordings,
        scenario=steps,
        cells=cells,
        experiments=experiment_results,
        loops={name: make_linear_loop(setup, inputs.operating_point) for name, setup in setups.items()},
        sensitivity={name: setup for name, setup in sensitivities.items() if setup is not None},
        plant=check_plant(rig, knowledge),
        left_out=left_out,
        losses_after_steps=losses_after_steps(rig, recording, steps.ticks, landing_tick),
    )


def _output_paths(out: PathLike | None, controller: ControllerFile) -> tuple[PathLike, ...]:
    """Return the paths of the files that are written together with a recording."""
    if out is None:
        return ()
    check_recording(out)
    model_file = [] if controller.model is not None else [_model_path(out)]
    return (out, Path(out).parent / FIGURES_FILE, *model_file)


def _write_model(
    out: PathLike, rig: BodyRig, controller: ControllerFile, knowledge: IdentifiedMagnet
) -> None:
    """Write the identified model, if the controller file names none."""
    if controller.model is None:
        magnets = calibrated_magnets(rig, knowledge, controller.settings.compensation.variant)
        # Each magnet of a calibrated pair has its own model.
        identified_magnet = knowledge if len(magnets) > 1 else magnets[0]
        write_model(identified_magnet.model, _model_path(out))


def _model_path(out: PathLike) -> Path:
    """Return the path of the identified model."""
    return Path(out).with_suffix(".model.toml")


def _make_compared_setups(
    main_setup: BearingSetup, controller: ControllerFile, knowledge: IdentifiedMagnet
) -> tuple[dict[MethodName, BearingSetup], dict[MethodName, str]]:
    """Make the setups of all variants; return errors for the variants that cannot be made."""
    setups: dict[MethodName, BearingSetup] = {}
    failed_variants: dict[MethodName, str] = {}
    eddy_variants: tuple[MethodName, ...] = ("at-rest",) if knowledge.model.has_layers else ()
    for name in (*compared_variants(main_setup.rig, main_setup.method), *eddy_variants):
        try:
            main_only = {name: main_setup} if name == main_setup.method else None
            setups |= main_only or make_setups(main_setup.rig, controller, knowledge, (name,))
        except InputError as error:
            failed_variants[name] = str(error)
    return setups, failed_variants


def compared_variants(rig: BodyRig, main_variant: MethodName) -> tuple[MethodName, ...]:
    """Return all variants that a rig permits, including the one in the controller file."""
    methods = [
        name
        for name in COMPARED_VARIANTS
        if name not in FLUX_PROBE_METHODS or rig.settings.flux_sensor is not None
    ]
    return tuple(dict.fromkeys([*methods, main_variant]))


def _operating_point_dict(operating_point: OperatingPoint) -> dict[str, Any]:
    slopes = operating_point.slopes
    return {
        "gap_m": operating_point.gap,
        "force_N": operating_point.force,
        "current_A": operating_point.current,
        "force_max_N": operating_point.force_max,
        "k_i_N_per_A": slopes.static.k_i,
        "k_s_N_per_m": operating_point.bearing.k_s,
        "k_i_after_reversal_N_per_A": min(slopes.after_rise, slopes.after_fall),
        "iron": slopes.label,
        "inductance_H": operating_point.bearing.inductance,
        "unstable_pole_Hz": operating_point.bearing.current_drive_pole,
    }
