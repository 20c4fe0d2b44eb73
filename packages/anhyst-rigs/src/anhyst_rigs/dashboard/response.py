"""Measure the frequency response of the running bench of a session, in a thread."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

from anhyst.support.errors import InputError
from anhyst.support.jobs import Progress
from anhyst_rigs.dashboard.improver import BoardJob, OperatorSeat
from anhyst_rigs.rig.bench.injection import InjectionPort
from anhyst_rigs.study.response.measurement import measure_response
from anhyst_rigs.study.response.result import FrequencyResponse


class ResponseMeter:
    """The running measurement of a frequency response, if any, and the last result."""

    def __init__(self, port: InjectionPort | None) -> None:
        self.port = port
        self.result: FrequencyResponse | None = None
        self._job: BoardJob | None = None
        self._error_text = ""

    @property
    def is_driving(self) -> bool:
        """Whether a measurement excites the running controller."""
        return self._job is not None

    def measure(self, motion: float, seat: Callable[[], OperatorSeat]) -> None:
        """Start a measurement with a largest motion, m."""
        if self._job is not None:
            raise InputError(
                "response: a measurement is running; wait, or cancel it", code="busy", key="response"
            )
        self._error_text = ""

        def work(progress: Progress, bench: OperatorSeat) -> Mapping[str, Any]:
            return {"response": measure_response(bench, motion, progress)}

        def ended(outcome: Mapping[str, Any] | str) -> None:
            if isinstance(outcome, str):
                self._error_text = outcome
            else:
                self.result = outcome["response"]
            self._job = None

        self._job = BoardJob(work, seat, ended)

    def cancel(self, *, wait: bool = False) -> None:
        """Cancel the measurement; the rig remains as it is. The thread of the bench must not wait."""
        if (job := self._job) is not None:
            job.cancel()
            if wait:
                job.wait()

    def refusal_reason(self, values: Mapping[str, float]) -> str:
        """Return why no measurement can start with these signals; empty if it can."""
        if self.port is None:
            return "this rig cannot add a signal to its position reading"
        if self._job is not None:
            return "a measurement is running; wait, or cancel it"
        is_held = all(values.get(name) == value for name, value in self.port.held_values.items())
        return "" if is_held else "only while the body is held at rest; lift it first"

    def status(self) -> Mapping[str, Any]:
        """Return the progress, which a page shows."""
        job = self._job
        return {
            "running": job is not None,
            "share": 0.0 if job is None else job.completed_fraction,
            "trouble": self._error_text,
        }


def describe_response(result: FrequencyResponse | None) -> Mapping[str, Any]:
    """Return the message with a result for a page, with the content of its CSV file."""
    content = None if result is None else {**result.as_dict(), "csv": result.csv_text()}
    return {"kind": "response", "result": content}
