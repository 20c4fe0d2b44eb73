"""Use a model: read it from its file, predict and invert records, test it, and run it in steps.

The model file is a versioned TOML file for reading, editing and comparing. All values are SI with
the unit in the key: ``k_A_per_m`` is ``k`` in A/m. Numbers are written with full precision and
without a time stamp, so that the same model gives the same file. All errors of a file are reported
together, with line and key.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike

from anhyst._core import AnyIron
from anhyst.data.clean import SETTING_PREFIX, ReadOptions
from anhyst.data.loops import Loop, Loops
from anhyst.data.path import HistoryLike
from anhyst.laws import LAWS
from anhyst.model.acceptance import Acceptance, GapCheck, check_acceptance, check_over_gap
from anhyst.model.model_data import MIN_SLOPE, ModelData
from anhyst.model.predict import as_samples, run_record
from anhyst.model.prediction import InputKind, Prediction, warn_if_far
from anhyst.model.reader import read_as
from anhyst.model.stepper import Stepper
from anhyst.model.writer import write_model
from anhyst.support.atomic import PathLike, check_path
from anhyst.support.errors import InputError, wrong_key
from anhyst.support.numeric import FloatArray
from anhyst.support.result import Result, group_label, length_scale, range_text, schedule_colours

if TYPE_CHECKING:
    from matplotlib.axes import Axes

DRAWN_SAMPLES = 400
"""Number of samples of a plotted branch."""

CYCLE_S = 1.0
"""Length of the cycle of a rate-dependent model, s."""


@dataclass(frozen=True, repr=False)
class Model(Result, ModelData):
    """A model of an actuator, with prediction, inversion and tests.

    Examples
    --------
    >>> from anhyst.support.units import QUANTITIES
    >>> iron = dict(M_s=4e5, a=30.0, k=20.0, c=0.2, c_H=1.0, c_out=1.0)
    >>> model = Model("core", QUANTITIES["field"], QUANTITIES["flux_density"], iron)
    >>> model.predict([0.0, 100.0, 0.0]).output.round(3)
    array([0.   , 0.32 , 0.079])
    >>> model([0.0, 100.0, 0.0]).round(3)
    array([0.   , 0.32 , 0.079])
    >>> model.inverse([0.0, 0.32, 0.079]).round(0)
    array([  0., 100.,   0.])
    """

    def __call__(
        self,
        drive: ArrayLike,
        schedule: ArrayLike | None = None,
        time: ArrayLike | None = None,
        history: HistoryLike | None = None,
    ) -> FloatArray:
        """Return the output for a drive, shape (n,); see :meth:`predict`."""
        return self.predict(drive, schedule, time, history).output

    def inverse(
        self,
        demand: ArrayLike,
        schedule: ArrayLike | None = None,
        time: ArrayLike | None = None,
        history: HistoryLike | None = None,
    ) -> FloatArray:
        """Return the drive for a demanded output, shape (n,); see :meth:`invert`."""
        return self.invert(demand, schedule, time, history).drive

    def predict(
        self,
        drive: ArrayLike,
        schedule: ArrayLike | None = None,
        time: ArrayLike | None = None,
        history: HistoryLike | None = None,
    ) -> Prediction:
        """Compute the output for a drive."""
        return self._run_record("drive", drive, schedule, time, history)

    def invert(
        self,
        demand: ArrayLike,
        schedule: ArrayLike | None = None,
        time: ArrayLike | None = None,
        history: HistoryLike | None = None,
    ) -> Prediction:
        """Compute the drive for a demanded output.

        The drive for a force is unipolar. A sample without a solution is flagged
        (:meth:`.Circuit.flux_density`).
        """
        return self._run_record("demand", demand, schedule, time, history)

    def _run_record(
        self,
        kind: InputKind,
        values: ArrayLike,
        schedule: ArrayLike | None,
        time: ArrayLike | None,
        history: HistoryLike | None,
    ) -> Prediction:
        result = run_record(self, kind, values, schedule, time, history)
        quantity = self.input if kind == "drive" else self.output
        warn_if_far(self, quantity, as_samples(values, kind), schedule)
        return result

    def predict_loop(self, loop: Loop) -> FloatArray:
        """Return the modelled output for the drive of a measured loop, shape (n,)."""
        return self.predict(loop.input, loop.schedule, loop.time, loop.history).output

    def stepper(self, schedule: float | None = None, history: HistoryLike | None = None) -> Stepper:
        """Return a stepper for use sample by sample; see :class:`anhyst.model.stepper.Stepper`."""
        return Stepper(self, schedule, history)

    def check_over_gap(self) -> GapCheck | None:
        """Test the model over the gap: :func:`anhyst.model.acceptance.check_over_gap`."""
        return check_over_gap(self)

    def acceptance(self) -> Acceptance:
        """Run the acceptance tests; see :func:`anhyst.model.acceptance.check_acceptance`."""
        return check_acceptance(self)

    def settled_loop(self, schedule: float | None, samples: int) -> tuple[FloatArray, FloatArray]:
        """Return drive and output of the steady-state loop over the valid range, ascending first.

        Each branch has `samples` samples. A cycle of a rate-dependent model takes :data:`CYCLE_S`.
        A model without a valid range raises `InputError`.
        """
        ascending_drive = np.linspace(*self.valid_range.input, samples)
        drive = np.concatenate([ascending_drive, ascending_drive[::-1]])
        time = np.linspace(0.0, CYCLE_S, drive.size) if self.needs_time else None
        return drive, self(drive, schedule, time, "settled")

    def facts(self) -> dict[str, str]:
        """Return law, gap map, valid ranges and accuracy."""
        facts = {"name": self.name, "law": self.law, "gap map": self.gap_map}
        if (valid_range := self.valid) is not None:
            facts[self.input.name] = range_text(*valid_range.input, self.input.unit)
            facts[self.output.name] = range_text(*valid_range.output, self.output.unit)
            if valid_range.input_rate is not None:
                facts["measured up to"] = f"{valid_range.input_rate:.3g} {self.input.unit}/s"
            if valid_range.schedule is not None and self.schedule is not None:
                facts["holds from"] = " to ".join(map(self.schedule.show, valid_range.schedule))
        if (fit := self.fit) is not None:
            share = 100.0 / fit.largest_output
            facts["fit"] = f"mean {share * fit.mean_abs:.2g} %, worst {share * fit.worst:.2g} %"
        return facts

    def to_columns(self) -> dict[str, Any]:
        """Return the parameters, SI, one row each; gap-dependent ones have one row per node."""
        rows = []
        for name, value in self.parameters.items():
            values = value if isinstance(value, tuple) else (value,)
            nodes = self.nodes if len(values) > 1 else (float("nan"),)
            rows += [(self.file_keys[name][1], *entry) for entry in zip(nodes, values, strict=True)]
        node_column = self.schedule.column if self.schedule is not None else "node"
        names, positions, numbers = zip(*rows, strict=True)
        return {"parameter": list(names), node_column: list(positions), "value": list(numbers)}

    def draw(self, ax: Axes) -> None:
        """Draw :meth:`settled_loop` at each node."""
        scale, label = length_scale(self.output)
        for node, colour in schedule_colours(self.nodes or (0.0,)).items():
            gap = node if self.nodes else None
            drive, output = self.settled_loop(gap, DRAWN_SAMPLES)
            name = group_label(self.schedule, gap)
            ax.plot(drive, scale * output, color=colour, lw=1.1, label=name)
        ax.set_xlabel(self.input.label)
        ax.set_ylabel(label)

    def with_read_options(self, options: ReadOptions) -> Self:
        """Return the model with the options for reading its measurements in its provenance."""
        provenance = self.provenance
        settings = dict(provenance.settings) | options.as_settings()
        return replace(self, provenance=replace(provenance, settings=settings))

    def save(self, path: PathLike) -> Path:
        """Write the model file; see :func:`anhyst.model.writer.write_model`."""
        write_model(self, path)
        return Path(path)


def read_model(path: PathLike) -> Model:
    """Read and check a model file.

    Parameters
    ----------
    path : path-like
        A file of :func:`~anhyst.model.writer.write_model`, possibly edited.

    Returns
    -------
    Model
        The checked model; the core has accepted its parameters.

    Raises
    ------
    InputError
        The file cannot be read or is not TOML.
    TomlFileError
        Another format or version, keys that are unknown, missing, without their unit or out of
        range; with line and key.
    """
    check_path(path, "read_model: path", "the path of a model file")
    return read_as(path, Model)


def resolve_model(model: Model | PathLike, verb: str, argument: str = "model") -> Model:
    """Return the model that a command was given, read from its file if necessary."""
    if isinstance(model, Model):
        return model
    check_path(model, f"{verb}: {argument}", MODEL_SOURCES)
    return read_model(model)


MODEL_SOURCES = "a Model or the path of a model file"
"""What a command accepts as a model, for messages."""


def read_sources(model: Model, folder: PathLike = ".") -> Loops:
    """Read the measurements of a model again, with the options of its identification."""
    sources = model.provenance.sources
    if not sources:
        text = "the model does not list its measurements; identify again, or add [provenance]"
        raise InputError(text, code="no-provenance", key="provenance")
    texts = {
        name.removeprefix(SETTING_PREFIX): str(value)
        for name, value in model.provenance.settings.items()
        if name.startswith(SETTING_PREFIX)
    }
    unknown_options = set(texts) - {item.name for item in fields(ReadOptions)}
    if unknown_options:
        key = f"provenance.settings.{SETTING_PREFIX}{min(unknown_options)}"
        raise wrong_key(key, "is unknown; remove it", code="extra-forbidden")
    options = ReadOptions.from_text(**texts)
    loops = options.read([_find_source(source.path, source.sha256, Path(folder)) for source in sources])
    if model.flux is not None and loops.output.name == "flux_linkage":
        loops = model.flux.force_loops(model.flux.corrected_loops(loops))
    return loops.split_tables()[1] or loops  # a table in addition to measured loops is not compared


def _find_source(path: str, sha256: str, folder: Path) -> Path:
    candidates = [Path(path), folder / path, folder / Path(path).name]
    existing_files = [path for path in candidates if path.is_file()]
    for candidate in existing_files:
        with candidate.open("rb") as stream:
            if hashlib.file_digest(stream, "sha256").hexdigest() == sha256:
                return candidate
    if existing_files:
        text = f"{existing_files[0]}: file changed after the identification; identify again"
        raise InputError(text, code="source-changed")
    raise InputError(f"{path}: no such file; restore the measurements or identify again", code="no-such-file")


GAP_SAMPLES = 65
"""Number of gaps at which a model is checked, in addition to its nodes."""


def find_compile_obstacle(model: Model) -> str | None:
    """Return why a model cannot be compiled, and the remedy; None if it can be compiled."""
    law = model.operator_law
    if law.least_slope is None:
        alternatives = " or ".join(f"--law {law.name}" for law in LAWS.values() if law.least_slope)
        return (
            f"law {model.law!r} cannot be compiled: {law.no_compensator_reason}; identify with {alternatives}"
        )
    if model.needs_fixed_gap:
        schedule_name = model.schedule.name if model.schedule else "gap"
        alternatives = "scaling or reluctance" if schedule_name == "gap" else "scaling"
        return (
            f"gap map 'free' cannot be compiled: the iron itself would change with the {schedule_name}; "
            f"identify with --gap-map {alternatives}"
        )
    if model.has_eddy_currents and not (model.has_layers or model.has_lag):
        return "gamma: these eddy currents cannot be compiled; use the model at rest (at_rest)"
    return _find_jump(model)


def require_core(model: Model, at: float) -> None:
    """Raise an error for a model whose law is not in the core."""
    if not isinstance(model.iron_at(at), AnyIron):
        raise InputError(
            f"law {model.law!r}: the core does not have it; identify with one of {', '.join(LAWS)}",
            code="law-not-in-core",
        )


def least_slope(model: Model, at: FloatArray) -> FloatArray:
    """Return ``1 + w*S``: the smallest slope of drive over field, relative to that without iron."""
    slope_function = model.operator_law.least_slope
    assert slope_function is not None
    return slope_function(model.parameters_at(float(at[0])), model.interpolate_parameter("rho", at))


def _find_jump(model: Model) -> str | None:
    gaps = _gaps_to_check(model)
    has_jump = least_slope(model, gaps) < MIN_SLOPE
    if not has_jump.any():
        return None
    text = (
        "alpha: the output jumps at some currents, and no current gives the values between "
        "(the coupling of the iron exceeds the effect of the gap), so the model cannot be compiled: "
    )
    if has_jump.all():
        other_map = "scaling" if "rho" in model.varying else "reluctance"
        gap_map_advice = f"identify with --gap-map {other_map}, or " if len(model.nodes) > 1 else ""
        return f"{text}{gap_map_advice}measure with a wider gap; predict and invert follow the jumps"
    name, unit = ("", "") if model.schedule is None else (model.schedule.name, model.schedule.unit)
    low, high = gaps[has_jump].min(), gaps[has_jump].max()
    return (
        f"{text}it jumps at a {name} of {low:.3g} to {high:.3g} {unit}: remove the loops there, "
        f"or limit the {name} in the model's [valid] to values without jumps"
    )


def _gaps_to_check(model: Model) -> FloatArray:
    """Return evenly spaced gaps over the valid range, and the nodes inside it."""
    nodes = np.array(model.nodes)
    valid_gaps = None if model.valid is None else model.valid.schedule
    low, high = valid_gaps or ((nodes[0], nodes[-1]) if nodes.size else (0.0, 0.0))
    nodes_inside = nodes[(nodes > low) & (nodes < high)]
    return np.unique(np.concatenate([np.linspace(low, high, GAP_SAMPLES), nodes_inside]))
