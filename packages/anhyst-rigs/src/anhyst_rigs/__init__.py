"""Simulate, tune, calibrate and operate test rigs of actuators with hysteresis.

Every command is a function with the same names and defaults. The classes are the types of the
results. Each name is imported when it is first used::

    import anhyst_rigs

    anhyst_rigs.simulate("rig.toml").plot()
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from anhyst.support.lazy import lazy_names

if TYPE_CHECKING:  # for type checkers and editors; other commands work too, but without types
    __version__: str

    from anhyst_rigs.draft.drafting import Drafted as Drafted
    from anhyst_rigs.study.bearing.on_board import BoardComparison as BoardComparison
    from anhyst_rigs.study.bearing.simulate import Simulation as Simulation
    from anhyst_rigs.study.bearing.state_space import linearise as linearise
    from anhyst_rigs.study.benefit import Benefit as Benefit
    from anhyst_rigs.study.engine.monte_carlo import MonteCarlo as MonteCarlo
    from anhyst_rigs.study.excite.excite import Excitation as Excitation
    from anhyst_rigs.study.fleet import Fleet as Fleet
    from anhyst_rigs.study.force_control import ForceControl as ForceControl
    from anhyst_rigs.study.piezo import PiezoTracking as PiezoTracking
    from anhyst_rigs.study.response.result import FrequencyResponse as FrequencyResponse
    from anhyst_rigs.study.response.result import read_response as read_response
    from anhyst_rigs.study.tracking.calibrate import Calibration as Calibration
    from anhyst_rigs.study.tracking.excitation import CalibratingMove as CalibratingMove
    from anhyst_rigs.study.tracking.excitation import excite_to_calibrate as excite_to_calibrate
    from anhyst_rigs.study.tracking.simulate import TrackingStudy as TrackingStudy
    from anhyst_rigs.study.tuning.result import Tuning as Tuning
    from anhyst_rigs.verbs.calibrate import calibrate as calibrate
    from anhyst_rigs.verbs.excite import excite as excite
    from anhyst_rigs.verbs.fleet import fleet as fleet
    from anhyst_rigs.verbs.force_control import force_control as force_control
    from anhyst_rigs.verbs.init import init as init
    from anhyst_rigs.verbs.live import live as live
    from anhyst_rigs.verbs.simulate import simulate as simulate
    from anhyst_rigs.verbs.tune import tune as tune
    from anhyst_rigs.verbs.watch import watch as watch
    from anhyst_rigs.verbs.xcp import xcp as xcp

_MODULES_BY_NAME = {
    "Benefit": "study.benefit",
    "BoardComparison": "study.bearing.on_board",
    "CalibratingMove": "study.tracking.excitation",
    "Calibration": "study.tracking.calibrate",
    "Drafted": "draft.drafting",
    "Excitation": "study.excite.excite",
    "FrequencyResponse": "study.response.result",
    "Fleet": "study.fleet",
    "ForceControl": "study.force_control",
    "MonteCarlo": "study.engine.monte_carlo",
    "PiezoTracking": "study.piezo",
    "Simulation": "study.bearing.simulate",
    "TrackingStudy": "study.tracking.simulate",
    "Tuning": "study.tuning.result",
    "excite_to_calibrate": "study.tracking.excitation",
    "linearise": "study.bearing.state_space",
    "read_response": "study.response.result",
}
"""Module of each exported name that is not a command."""

__all__, __getattr__ = lazy_names("anhyst_rigs", _MODULES_BY_NAME)


def __dir__() -> list[str]:
    return __all__
