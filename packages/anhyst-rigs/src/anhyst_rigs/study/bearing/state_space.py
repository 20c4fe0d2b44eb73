"""A bearing for small movements as an object of python-control.

python-control is in the extra ``control``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np

from anhyst.control.exchange import control_library
from anhyst.support.atomic import PathLike, check_path
from anhyst.support.numeric import FloatArray
from anhyst_rigs.rig.body import BodyRig, read_bearing
from anhyst_rigs.rig.drift import change_rig
from anhyst_rigs.rig.from_loops import complete_rig
from anhyst_rigs.study.bearing.linear import LinearBearing, voltage_matrices
from anhyst_rigs.study.bearing.operating import find_operating_point

if TYPE_CHECKING:
    from control import StateSpace

Drive = Literal["current", "voltage"]


def linearise(
    rig: PathLike | BodyRig,
    gap: float | None = None,
    force: float | None = None,
    *,
    drive: Drive = "current",
) -> StateSpace:
    """Linearise a magnetic bearing about an operating point.

    With the position ``p = gap_middle - gap``, ``m p'' = k_i i + k_s p - d p' - load``; driven by a
    voltage, the winding and the voltage that motion induces come on top
    (:mod:`anhyst_rigs.study.bearing.linear`). The slopes are static ones, rising and falling
    branch averaged: just after a reversal iron with hysteresis answers less.

    Parameters
    ----------
    rig : path-like or BodyRig
        A bearing, or its rig file.
    gap : float, optional
        Operating gap, m; that of the rig file if left out.
    force : float, optional
        What the magnet carries there, N (of a pair: the bias of each); that of the rig file if left
        out.
    drive : str
        ``"current"``: the flux follows the current at once; ``"voltage"``: winding and eddy
        currents are part of it.

    Returns
    -------
    control.StateSpace
        Continuous, with named signals: inputs ``current`` (A) or ``voltage`` (V), both less their
        value at the operating point, and ``load`` (N, opens the gap); outputs ``position`` (m,
        closes the gap), ``force`` (N) and, driven by a voltage, ``current`` (A).

    Raises
    ------
    InputError
        The rig cannot be read, no current carries the force, or python-control is not installed.
    """
    if not isinstance(rig, BodyRig):
        check_path(rig, "linearise: rig", "the path of a rig file")
    library = control_library()
    bearing = rig if isinstance(rig, BodyRig) else read_bearing(rig)
    bearing = _at_operating_point(bearing, gap, force)
    if bearing.settings.magnet.has_iron_from_loops:
        bearing = complete_rig(bearing, bearing.measured_loops.read())
    point = find_operating_point(bearing).bearing
    a, b, c, d = (
        _current_driven_matrices(point) if drive == "current" else _voltage_driven_matrices(point)
    )
    names = {"inputs": [drive, "load"], "outputs": ["position", "force", "current"][: len(c)]}
    states = ["position", "velocity", "flux_current"][: len(a)]
    return library.StateSpace(a, b, c, d, **names, states=states, name="bearing")


def _at_operating_point(rig: BodyRig, gap: float | None, force: float | None) -> BodyRig:
    """Return a rig at another operating point."""
    changes: dict[str, float] = {}
    if gap is not None:
        changes["gap_m"] = gap
    if force is not None and rig.settings.bias_N is None:
        changes["load.force_N"] = rig.settings.load.force_N + force - rig.static_load
    elif force is not None:
        changes["control.bias_N"] = force
    return change_rig(rig, changes)


def _current_driven_matrices(point: LinearBearing) -> tuple[FloatArray, ...]:
    mass = point.mass
    a = np.array([[0.0, 1.0], [point.k_s / mass, -point.damping / mass]])
    b = np.array([[0.0, 0.0], [point.k_i / mass, -1.0 / mass]])
    c = np.array([[1.0, 0.0], [point.k_s, 0.0]])
    return a, b, c, np.array([[0.0, 0.0], [point.k_i, 0.0]])


def _voltage_driven_matrices(point: LinearBearing) -> tuple[FloatArray, ...]:
    a, into, current, direct = voltage_matrices(point)
    b = np.column_stack([into, [0.0, -1.0 / point.mass, 0.0]])
    c = np.array([[1.0, 0.0, 0.0], [point.k_s, 0.0, point.k_i], current])
    return a, b, c, np.array([[0.0, 0.0], [0.0, 0.0], [direct, 0.0]])
