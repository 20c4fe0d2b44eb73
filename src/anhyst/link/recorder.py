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
    """What was recorded."""

    ticks: NDArray[np.int64]  # tick of each record; shape (records,)
    trigger: int  # number of the record at the trigger
    # for each signal its codes, int32, shape (records,); formats as in ``contract/signals.toml``
    signals: dict[RecorderSignal, NDArray[np.int32]]


@dataclass(frozen=True, slots=True)
class When:
    """What starts a recording."""

    trigger: Trigger = Trigger.NOW  # at once, or as a signal rises or falls through a level
    signal: RecorderSignal = RecorderSignal.DEMAND  # which
    level: int = 0  # in the code of the signal
    before: int = 0  # records wanted from before the trigger


def start_recording(
    controller: ControllerLink,
    signals: Sequence[RecorderSignal],
    when: When | None = None,
    decimation: int = 1,
    records: int = 0,
) -> RecorderInfoAnswer:
    """Set the recorder up and start it; what it held is forgotten."""
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
    """Read out what was recorded."""
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
    columns = {signal: table[:, column].copy() for column, signal in enumerate(signals)}
    return FirmwareRecording(ticks, info.before, columns)
