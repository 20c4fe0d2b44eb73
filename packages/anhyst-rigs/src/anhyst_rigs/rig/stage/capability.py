"""Check by linear programmes which wrenches the magnets of a stage can apply.

A pair of opposing magnets, or a magnet without an opposing one, is a drive whose force has two
bounds. Wrenches refer to the centre of mass, and moments are divided by the radius of gyration.
Therefore, all components are in N.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linprog

from anhyst.support.numeric import FloatArray
from anhyst.support.toml_file import FileFault
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.file import RigFile
from anhyst_rigs.rig.stage.drives import (
    largest_magnet_forces,
    opposing_magnets,
    usual_allocation,
    wrench_layout,
)
from anhyst_rigs.rig.stage.geometry import (
    gyration_radii,
    magnet_rows,
    scaled_wrenches,
    scan_wrench,
    weight_wrench,
)

_MIN_COMPONENT = 1e-6
"""Smallest component of a unit wrench, or of a certificate, that differs from rounding errors."""
_MAX_CONDITION = 1000.0
"""Largest accepted condition number. Above it, errors of the plant exceed the weakest wrench."""
_ALLOCATION_STEPS = 500
"""Number of wrenches in each direction for which the allocation is tested."""
_FACTOR_TOLERANCE = 1.01
"""Largest accepted ratio of the required to the available force of the set-point."""


@dataclass(frozen=True)
class Capability:
    """The drives of a stage, and the wrenches that they can apply. All wrenches are scaled."""

    axes: tuple[str, ...]
    rows: FloatArray  # scaled wrench of each drive for 1 N, one row per drive
    low: FloatArray  # smallest and largest force of each drive, N
    high: FloatArray
    weight: FloatArray  # scaled wrench of the weight, N
    radii: FloatArray  # radius of gyration of each rotation, m; 1 for a displacement
    forces: FloatArray  # largest force of each magnet, N

    def largest_factor(self, wrench: FloatArray, constant: FloatArray | float = 0.0) -> float:
        """Return the largest factor of a wrench that the drives apply with a constant one, or -inf."""
        solution = linprog(
            np.append(np.zeros(len(self.rows)), -1.0),
            A_eq=np.column_stack([self.rows.T, -wrench]),
            b_eq=np.broadcast_to(constant, wrench.shape),
            bounds=[*zip(self.low, self.high, strict=True), (0.0, None)],
        )
        return float(solution.x[-1]) if solution.status == 0 else -np.inf

    def singular_values(self) -> tuple[float, str]:
        """Return the condition number of the drives, and the coordinate that they push least.

        The condition number is the largest wrench of a unit root sum of squared forces, divided by
        the smallest one.
        """
        _, values, directions = np.linalg.svd(self.rows, full_matrices=False)
        return float(values[0] / values[-1]), self.axes[int(np.abs(directions[-1]).argmax())]

    def missing_directions(self) -> list[str]:
        """Return a text for each direction in which no magnet pushes, or one for coupled directions.

        The forces have no upper limit here, and the weight also pushes.
        """
        lengths = np.linalg.norm(self.rows, axis=1, keepdims=True)
        rows = np.vstack([self.rows / np.where(lengths > 0.0, lengths, 1.0), self.weight])
        bounds = [*((0.0 if low >= 0.0 else None, None) for low in self.low), (0.0, None)]
        pushes = np.vstack([rows, -rows[:-1][self.low < 0.0]])
        directions = np.vstack([np.eye(len(self.axes)), -np.eye(len(self.axes))])
        uncovered = [way for way in directions if (pushes @ way).max() < _MIN_COMPONENT]
        if uncovered:
            return [f"no magnet pushes along {self._name_directions(way)}" for way in uncovered]
        for way in directions:
            missing, certificate = _find_missing_wrench(rows, bounds, way)
            if np.abs(missing).sum() > _MIN_COMPONENT:
                coupled = self._name_directions(np.where(way == 0.0, -certificate, 0.0))
                text = f"all magnets that push along {self._name_directions(way)} also push along {coupled}"
                return [f"{text}, and nothing balances this"]
        return []

    def _name_directions(self, wrench: FloatArray) -> str:
        """Return the signs and coordinates of the components of a wrench."""
        components = zip(self.axes, wrench.tolist(), strict=True)
        return " or ".join(
            f"{'-+'[value > 0.0]}{axis}" for axis, value in components if abs(value) > _MIN_COMPONENT
        )

    def describe_shortage(self) -> str | None:
        """Return a text about the smallest missing wrench, or None if forces hold the body."""
        bounds = [*zip(self.low, self.high, strict=True)]
        missing, _ = _find_missing_wrench(self.rows, bounds, -self.weight)
        if np.abs(missing).sum() < _MIN_COMPONENT:
            return None
        axis = int(np.abs(missing).argmax())
        unit = "N m" if self.axes[axis].startswith("r") else "N"
        amount = abs(missing[axis]) * self.radii[axis]
        name = self._name_directions(np.where(np.arange(missing.size) == axis, missing, 0.0))
        return f"{amount:.3g} {unit} are missing along {name}"


def _find_missing_wrench(
    rows: FloatArray, bounds: Sequence[tuple[float | None, float | None]], target: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return what the drives lack for a wrench (least sum of absolute values), and a certificate.

    The certificate is the dual solution. If a wrench is missing, no forces within the bounds have a
    product with the certificate that is as large as the product of the target.
    """
    identity = np.eye(len(target))
    solution = linprog(
        np.repeat([0.0, 1.0], [len(rows), 2 * len(target)]),
        A_eq=np.column_stack([rows.T, identity, -identity]),
        b_eq=target,
        bounds=[*bounds, *[(0.0, None)] * (2 * len(target))],
    )
    positive, negative = np.split(solution.x[len(rows) :], 2)
    return np.asarray(positive - negative), np.asarray(solution.eqlin.marginals)


def make_capability(rig: BodyRig) -> Capability:
    """Return what the magnets of a stage can apply at its operating point."""
    file = rig.settings
    rows, opponents, idle = magnet_rows(file), opposing_magnets(file), file.bias_N or 0.0
    forces = largest_magnet_forces(rig)
    first = [magnet for magnet, other in enumerate(opponents) if magnet not in opponents[:magnet]]
    low, high = np.full(len(rows), file.tracking.force_min_N), forces.copy()
    if file.magnet.is_bidirectional:
        low = -forces
    for magnet, other in ((magnet, other) for magnet, other in enumerate(opponents) if other != magnet):
        # the product of both forces of a pair is the square of the bias force
        high[magnet] = forces[magnet] - idle**2 / forces[magnet]
        low[magnet] = idle**2 / forces[other] - forces[other]
    return Capability(
        axes=tuple(file.body.free),
        rows=scaled_wrenches(file, rows[first]),
        low=low[first],
        high=high[first],
        weight=scaled_wrenches(file, weight_wrench(file)[None, :])[0],
        radii=gyration_radii(file),
        forces=forces,
    )


def largest_wrench_factor(rig: BodyRig, wrench: FloatArray) -> float:
    """Return the largest factor of a wrench in both directions, in addition to the weight.

    The controller can allocate the wrench for all smaller factors.
    """
    return _largest_factors(rig, make_capability(rig), wrench)[1]


def _largest_factors(rig: BodyRig, capability: Capability, wrench: FloatArray) -> tuple[float, float]:
    """Return the largest factor that the magnets can apply, and that the controller can allocate."""
    file = rig.settings
    push = scaled_wrenches(file, wrench[None, :])[0]
    possible = min(capability.largest_factor(way, -capability.weight) for way in (push, -push))
    if possible <= 0.0:
        return 0.0, 0.0
    layout = wrench_layout(file, usual_allocation(file), file.bias_N or 0.0)
    allocated = 0.0
    for factor in np.linspace(0.0, possible, _ALLOCATION_STEPS + 1).tolist():
        for way in (factor * wrench, -factor * wrench):
            forces, is_made = layout.share((way - weight_wrench(file)).tolist())
            if not is_made or (np.array(forces) > (1.0 + _MIN_COMPONENT) * capability.forces).any():
                return possible, allocated
        allocated = factor
    return possible, allocated


def capability_faults(rig: BodyRig) -> Iterator[FileFault]:
    """Find reasons why the magnets cannot hold the body, or cannot follow the set-point."""
    file, capability = rig.settings, make_capability(rig)
    if texts := capability.missing_directions():
        text = f"{'; '.join(texts)}; turn a magnet, add one, or move them"
        yield FileFault(("magnet",), text, code="axis-not-held")
        return
    condition, axis = capability.singular_values()
    try:
        wrench_layout(file, usual_allocation(file), file.bias_N or 0.0)
        is_singular = condition > _MAX_CONDITION
    except ValueError:
        is_singular = True
    if is_singular:
        text = f"these magnets are nearly singular: condition number {condition:.3g}, at most "
        text += f"{_MAX_CONDITION:g} is accepted; they push least along {axis}: move them apart, or turn one"
        yield FileFault(("magnet",), text, code="axis-not-held")
        return
    limit_text = _describe_limit(file, capability)
    if capability.weight.any():
        largest = capability.largest_factor(-capability.weight)
        if 0.0 <= largest < 1.0:
            text = f"the body weighs {file.body.weight_N:.4g} N, but the magnets can carry "
            text += f"{largest * file.body.weight_N:.4g} N at this centre of mass, {limit_text}; "
            text += "lower it, or add a magnet"
            yield FileFault(file.key_path(file.body, "mass_kg"), text, code="load-too-large")
            return
    if shortage := capability.describe_shortage():
        text = f"no forces of at least {file.tracking.force_min_N:g} N, {limit_text}, hold the body and "
        text += f"its weight: {shortage}; lower force_min_N, or move a magnet"
        yield FileFault(("magnet",), text, code="load-too-large")
        return
    yield from _scan_faults(rig, capability, limit_text)


def _scan_faults(rig: BodyRig, capability: Capability, limit_text: str) -> Iterator[FileFault]:
    """Find accelerations of the set-point that the magnets cannot apply in both directions."""
    file = rig.settings
    possible, allocated = _largest_factors(rig, capability, scan_wrench(file))
    for key in ("train_m_per_s2", "test_m_per_s2"):
        required = file.body.mass_kg * max(getattr(file.scan, key))
        required_text = f"{file.body.mass_kg:g} kg need {required:.4g} N along the set-point"
        if required > _FACTOR_TOLERANCE * possible:
            text = f"{required_text}, but the magnets can apply {possible:.4g} N in both directions in "
            text += f"addition to the weight, {limit_text}; lower it"
            yield FileFault(file.key_path(file.scan, key), text, code="load-too-large")
        elif required > _FACTOR_TOLERANCE * allocated:
            text = f"{required_text}, but the controller finds forces for only {allocated:.4g} N, "
            text += f"although the magnets can apply {possible:.4g} N; lower it, or move a magnet"
            yield FileFault(file.key_path(file.scan, key), text, code="load-too-large")


def _describe_limit(file: RigFile, capability: Capability) -> str:
    """Return a text with the largest force of one magnet and its cause."""
    least, largest = capability.forces.min(), capability.forces.max()
    force_text = f"{least:.4g}" if np.isclose(least, largest) else f"{least:.4g} to {largest:.4g}"
    cause = "force_max_N" if least >= file.tracking.force_max_N else "current_high_A at its gap"
    return f"each at most {force_text} N ({cause})"
