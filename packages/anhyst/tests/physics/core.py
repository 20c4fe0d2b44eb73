"""Call the C core through the interface of the reference, so that tests can use both."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from anhyst import _core
from anhyst.support.numeric import FloatArray
from tests.oracles.iron import Iron
from tests.oracles.operator import DEMAGNETISED, LawState


class Record(NamedTuple):
    """Result of the core, with the state in the form of the reference."""

    found: FloatArray
    field: FloatArray
    state: LawState
    status: int
    sample: int


def core_of(iron: Iron) -> _core.Iron:
    return _core.Iron(iron.m_s, iron.a, iron.k, iron.c, iron.alpha, iron.r_d, iron.law, iron.step)


def run(
    core: _core.Iron,
    direction: str,
    given: ArrayLike,
    rho: ArrayLike = 0.0,
    eddy: ArrayLike = 0.0,
    state: LawState = DEMAGNETISED,
) -> Record:
    """Run the core forward or inverse without checking its status."""
    samples = np.atleast_1d(np.asarray(given, dtype=np.float64))
    ratio = np.broadcast_to(np.asarray(rho, dtype=np.float64), samples.shape).copy()
    memory = np.broadcast_to(np.asarray(eddy, dtype=np.float64), samples.shape).copy()
    call = core.forward if direction == "forward" else core.inverse
    found, field, after, status, index = call(samples, ratio, memory, np.array(state))
    return Record(found, field, LawState(*np.asarray(after).tolist()), status, index)


def forward(
    iron: Iron, drive: ArrayLike, rho: ArrayLike = 0.0, eddy: ArrayLike = 0.0, state: LawState = DEMAGNETISED
) -> tuple[FloatArray, FloatArray, LawState]:
    """Return the result of the core in the form of :meth:`Iron.forward`."""
    record = run(core_of(iron), "forward", drive, rho, eddy, state)
    assert record.status == 0, (_core.status_text(record.status), record.sample, iron)
    return record[:3]


def inverse(
    iron: Iron, b: ArrayLike, rho: ArrayLike = 0.0, eddy: ArrayLike = 0.0, state: LawState = DEMAGNETISED
) -> tuple[FloatArray, FloatArray, LawState]:
    """Return the result of the core in the form of :meth:`Iron.inverse`."""
    record = run(core_of(iron), "inverse", b, rho, eddy, state)
    assert record.status == 0, (_core.status_text(record.status), record.sample, iron)
    return record[:3]
