"""The controller's recorder: signals at the rate of its ticks, around a trigger."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from anhyst.link.client import ControllerLink
from anhyst.link.frames import (
    Recorder,
    RecorderDataAnswer,
    RecorderInfoAnswer,
    RecorderQueryRequest,
    RecorderReadRequest,
    RecorderSetupRequest,
    RecorderSignal,
    Trigger,
)
from anhyst.support.errors import InputError

_VALUES_MOST = 58
"""Values in one frame."""


@dataclass(frozen=True)
class FirmwareRecording:
    """What was recorded.

    Parameters
    ----------
    ticks : array of int64, shape (records,)
        Tick of each record.
    trigger : int
        Number of the record at the trigger.
    signals : dict
        For each signal its codes, int32, shape (records,); formats as in
        ``contract/signals.toml``.
    """

    ticks: NDArray[np.int64]
    trigger: int
    signals: dict[RecorderSignal, NDArray[np.int32]]


@dataclass(frozen=True, slots=True)
class When:
    """What starts a recording.

    Parameters
    ----------
    trigger : Trigger, optional
        At once, or as a signal rises or falls through a level.
    signal : RecorderSignal, optional
        Which.
    level : int, optional
        In the code of the signal.
    before : int, optional
        Records wanted from before the trigger.
    """

    trigger: Trigger = Trigger.NOW
    signal: RecorderSignal = RecorderSignal.DEMAND
    level: int = 0
    before: int = 0


def start_recording(
    controller: ControllerLink,
    signals: Sequence[RecorderSignal],
    when: When | None = None,
    decimation: int = 1,
    records: int = 0,
) -> RecorderInfoAnswer:
    """Set the recorder up and start it; what it held is forgotten.

    Parameters
    ----------
    controller : ControllerLink
        Whose.
    signals : sequence of RecorderSignal
        What to record.
    when : When, optional
        What starts it; at once if left out.
    decimation : int, optional
        Records every n-th tick, 1 to 65535.
    records : int, optional
        How many; 0 for as many as fit.

    Raises
    ------
    Refused
        A number is out of its range, or the records do not fit.
    """
    when = when or When()
    mask = sum(1 << signal for signal in set(signals))
    setup = RecorderSetupRequest(
        mask, when.signal, when.trigger, decimation, when.before, records, when.level
    )
    return controller.request(setup, RecorderInfoAnswer)


def recorder_state(controller: ControllerLink) -> Recorder:
    """Ask what the recorder does."""
    return Recorder(controller.request(RecorderQueryRequest(), RecorderInfoAnswer).recorder)


def read_recording(controller: ControllerLink) -> FirmwareRecording:
    """Read out what was recorded.

    Parameters
    ----------
    controller : ControllerLink
        Whose; its recorder is done.

    Returns
    -------
    FirmwareRecording

    Raises
    ------
    InputError
        The recorder is not done.
    """
    info = controller.request(RecorderQueryRequest(), RecorderInfoAnswer)
    if info.recorder != Recorder.DONE:
        state = Recorder(info.recorder).name.lower()
        raise InputError(
            f"{controller.url}: the recorder is {state}; wait until it is done",
            code="recorder-busy",
        )
    signals = [signal for signal in RecorderSignal if info.mask >> signal & 1]
    total = info.records * len(signals)
    values: list[int] = []
    while len(values) < total:
        count = min(total - len(values), _VALUES_MOST)
        request = RecorderReadRequest(len(values), count)
        values += controller.request(request, RecorderDataAnswer).values
    table = np.array(values, dtype=np.int32).reshape(info.records, len(signals))
    ticks = info.tick + info.decimation * (np.arange(info.records, dtype=np.int64) - info.before)
    columns = {signal: table[:, place].copy() for place, signal in enumerate(signals)}
    return FirmwareRecording(ticks, info.before, columns)
