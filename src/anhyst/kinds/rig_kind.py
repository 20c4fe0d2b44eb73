"""What the record of a kind of rig is."""

from __future__ import annotations

from dataclasses import dataclass

from anhyst.support.kinds import RIG_FORMAT, FileKind


@dataclass(frozen=True, eq=False)
class RigKind(FileKind):
    """A kind of rig: its name, the verbs that take it, and what each of them does with it.

    A package registers an instance as an entry point of the group ``anhyst.kinds``. What a verb
    asks of a kind is a protocol beside the work of that verb, and a kind that lists the verb has
    its methods:

    - ``simulate``: :class:`anhyst.reports.studies.HasSimulation`, for ``--board`` also ``HasBoard``,
      for ``--benefit`` of what is not a bearing :class:`anhyst.study.benefit.HasIrons`
    - ``tune``: :class:`anhyst.study.tuning.tuning.HasTuning`
    - ``excite``: :class:`anhyst.study.excite.excite.HasSpecimen`
    - ``calibrate``: :class:`anhyst.study.tracking.calibrate.HasCalibration`
    - ``live``: :class:`anhyst.study.bench.HasBench`
    - ``export``: :class:`anhyst.exchange.export.HasPart`
    - ``compile``: :class:`anhyst.study.tracking.compiled.HasController`

    Methods import what they work with when they are called, so that the kind of a file is known at
    once.
    """

    @property
    def format(self) -> str:
        """What the key ``format`` of such a file says."""
        return RIG_FORMAT
