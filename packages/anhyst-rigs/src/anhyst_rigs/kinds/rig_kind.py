"""What the record of a kind of rig is."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib import import_module
from typing import Any

from anhyst.support.kinds import RIG_FORMAT, FileKind


@dataclass(frozen=True, eq=False)
class RigKind(FileKind):
    """A kind of rig: its name, the verbs that take it, and where the work of each is done.

    A package registers an instance as an entry point of the group ``anhyst.kinds``, whose name is
    the word. What a verb asks of a kind is a protocol beside the work of that verb, and `places`
    has the methods of the protocols of all verbs of the kind:

    - ``simulate``: :class:`anhyst_rigs.reports.studies.HasSimulation`; with the option ``--board`` also
      ``HasBoard``, ``--monte-carlo`` ``HasPlants`` and ``--benefit`` ``HasBenefit`` of that module;
      where ``benefit`` is :func:`anhyst_rigs.reports.benefit.map_plants`, also
      :class:`anhyst_rigs.study.benefit.HasIrons`
    - ``tune``: :class:`anhyst_rigs.study.tuning.tuning.HasTuning`
    - ``excite``: :class:`anhyst_rigs.study.excite.excite.HasSpecimen`
    - ``calibrate``: :class:`anhyst_rigs.study.tracking.calibrate.HasCalibration`
    - ``live``: :class:`anhyst_rigs.study.bench.HasBench`
    - ``export``: an entry point of the group ``anhyst.exports``, see ``anhyst_exchange.exporter``
    - ``compile``: :class:`anhyst.compilation.compiled_stage.HasController`

    A function is imported when it is first asked for, so that the kind of a file is known at once.
    The module of the record is imported by every verb that takes a file: it should import nothing
    heavy and print nothing.

    `options` names, by verb, the options that this kind takes and others do not: ``--controller``,
    ``--board``, ``--calibrate``, and the aims of ``tune``. `reasons` says, by verb, why a verb that
    the kind does not list has no use for it.
    """

    # module and name of the function of each method, "package.module:function"
    places: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Raise TypeError if the places are no table."""
        if not isinstance(self.places, Mapping):
            raise TypeError("places is no table")

    @property
    def format(self) -> str:
        """What the key ``format`` of such a file says."""
        return RIG_FORMAT

    def __getattr__(self, method: str) -> Any:
        """Import the function of a method."""
        places: Mapping[str, str] = self.__dict__.get("places", {})  # none yet in a copy
        if method not in places:
            raise AttributeError(f"'{method}' is not among the places", name=method, obj=self)
        module, _, name = places[method].partition(":")
        return getattr(import_module(module), name)
