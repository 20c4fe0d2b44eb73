"""Export a bearing for small movements as a state-space object of python-control.

The optional dependencies ``control`` of this package contain python-control.
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
from anhyst_rigs.study.bearing.linear import LinearBearing, discretise, voltage_matrices
from anhyst_rigs.study.bearing.operating import find_operating_point, make_amplifier, make_timing

if TYPE_CHECKING:
    from control import StateSpace

Drive = Literal["current", "voltage", "reference"]


def linearise(
    rig: PathLike | BodyRig, gap: float | None = None, force: float | None = None, *, drive: Drive = "current"
) -> StateSpace:
    """Linearise a magnetic bearing at an operating point.

    With the position ``p = gap_middle - gap``, ``m p'' = k_i i + k_s p - d p' - load``. With a
    voltage drive, the winding and the motion-induced voltage are added
    (:mod:`anhyst_rigs.study.bearing.linear`). The slopes are static, averaged over the ascending
    and the descending branch. Just after a reversal, iron with hysteresis has a smaller slope.

    Parameters
    ----------
    rig : path-like or BodyRig
        A bearing, or its rig file.
    gap : float, optional
        Operating gap, m; default: that of the rig file.
    force : float, optional
        Force of the magnet at the operating point, N (of a pair: the bias of each); default: that of the
        rig file.
    drive : str
        ``"current"``: the flux follows the current immediately; ``"voltage"``: winding and eddy currents
        are included; ``"reference"``: amplifier, delay and position sensor are included too, sampled at
        the control rate, as :func:`anhyst_rigs.excite` measures with `response`.

    Returns
    -------
    control.StateSpace
        Continuous, with named signals: inputs ``current`` (A) or ``voltage`` (V), both relative to
        the operating point, and ``load`` (N, opens the gap); outputs ``position`` (m, closes the gap),
        ``force`` (N) and, with a voltage drive, ``current`` (A). With ``"reference"``: discrete, from
        ``current`` (A), the current reference, to ``position`` (m), the position reading.

    Raises
    ------
    InputError
        The rig cannot be read, no current carries the force, or python-control is not installed.
    """
    if not isinstance(rig, BodyRig):
        check_path(rig, "linearise: rig", "the path of a rig file")
    library = control_library()
    bearing_rig = rig if isinstance(rig, BodyRig) else read_bearing(rig)
    bearing_rig = _at_operating_point(bearing_rig, gap, force)
    if bearing_rig.settings.magnet.has_iron_from_loops:
        bearing_rig = complete_rig(bearing_rig, bearing_rig.measured_loops.read())
    bearing_model = find_operating_point(bearing_rig).bearing
    if drive == "reference":
        a, b, c = discretise(bearing_model, make_amplifier(bearing_rig), make_timing(bearing_rig))
        signals = {"inputs": ["current"], "outputs": ["position"]}
        column, row = b[:, None], c[None, :]
        return library.StateSpace(a, column, row, np.zeros((1, 1)), bearing_rig.dt, name="bearing", **signals)
    a, b, c, d = (
        _current_driven_matrices(bearing_model)
        if drive == "current"
        else _voltage_driven_matrices(bearing_model)
    )
    names = {"inputs": [drive, "load"], "outputs": ["position", "force", "current"][: len(c)]}
    states = ["position", "velocity", "flux_current"][: len(a)]
    return library.StateSpace(a, b, c, d, **names, states=states, name="bearing")


def _at_operating_point(rig: BodyRig, gap: float | None, force: float | None) -> BodyRig:
    """Return a rig with another operating gap and force."""
    changes: dict[str, float] = {}
    if gap is not None:
        changes["gap_m"] = gap
    if force is not None and rig.settings.bias_N is None:
        changes["load.force_N"] = rig.settings.load.force_N + force - rig.static_load
    elif force is not None:
        changes["control.bias_N"] = force
    return change_rig(rig, changes)


def _current_driven_matrices(bearing: LinearBearing) -> tuple[FloatArray, ...]:
    mass = bearing.mass
    a = np.array([[0.0, 1.0], [bearing.k_s / mass, -bearing.damping / mass]])
    b = np.array([[0.0, 0.0], [bearing.k_i / mass, -1.0 / mass]])
    c = np.array([[1.0, 0.0], [bearing.k_s, 0.0]])
    return a, b, c, np.array([[0.0, 0.0], [bearing.k_i, 0.0]])


def _voltage_driven_matrices(bearing: LinearBearing) -> tuple[FloatArray, ...]:
    a, input_vector, current, feedthrough = voltage_matrices(bearing)
    b = np.column_stack([input_vector, [0.0, -1.0 / bearing.mass, 0.0]])
    c = np.array([[1.0, 0.0, 0.0], [bearing.k_s, 0.0, bearing.k_i], current])
    return a, b, c, np.array([[0.0, 0.0], [0.0, 0.0], [feedthrough, 0.0]])
