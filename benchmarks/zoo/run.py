"""Run models on tasks in several processes."""

from __future__ import annotations

import os
import signal
import sys
import time
import warnings
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from .model import find_models
from .records import FloatArray
from .results import Results
from .scores import Scores, score
from .task import MissingData, read_task


@dataclass(frozen=True)
class Job:
    """One model on one task."""

    task: str
    model: str
    files: tuple[Path, ...]  # files of models that are not part of the benchmark


PROCESSOR_TIME_LIMIT_S = 60.0
"""Processor time of one model on one task after which it is stopped and counts as declined."""


@contextmanager
def limited_time() -> Iterator[None]:
    """Raise `TimeoutError` when the block exceeds the limit of processor time."""

    def stop(*_: object) -> None:
        raise TimeoutError(f"stopped after {PROCESSOR_TIME_LIMIT_S:g} s of processor time")

    signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, PROCESSOR_TIME_LIMIT_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)


def run_job(job: Job) -> tuple[Scores, list[FloatArray]]:
    """Score a model; a model that fails gets its error as the reason."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            model, task = find_models(job.files)[job.model](), read_task(job.task)
            with limited_time():
                return score(model, task)
        except MissingData:
            raise
        except TimeoutError as limit:
            return Scores(refusal=str(limit)), []
        except Exception as error:  # the fault of a model must not stop the others
            return Scores(refusal=f"failed: {type(error).__name__}: {error}"), []


def run(
    tasks: Sequence[str], models: Sequence[str], files: Sequence[Path], folder: Path, workers: int
) -> Results:
    """Run all models on all tasks; write the outputs of the test records into a folder."""
    results = Results()
    jobs = []
    for task in tasks:
        try:
            read_task(task)
        except MissingData as missing:
            results.skipped[task] = str(missing)
            continue
        results.scores[task] = {}
        jobs += [Job(task, model, tuple(files)) for model in models]
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # processor times are for one core
    began = time.monotonic()
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        futures = {pool.submit(run_job, job): job for job in jobs}
        for count, future in enumerate(as_completed(futures), 1):
            job, (scores, outputs) = futures[future], future.result()
            results.scores[job.task][job.model] = scores
            if outputs:
                (folder / "outputs" / job.task).mkdir(parents=True, exist_ok=True)
                np.savez(folder / "outputs" / job.task / f"{job.model}.npz", *outputs)
            answer = scores.refusal[:60] if scores.nrms is None else f"{100.0 * scores.nrms:.3g} %"
            print(
                f"{count:4d} of {len(jobs)}  {time.monotonic() - began:4.0f} s  {job.task}, {job.model}: {answer}",
                file=sys.stderr,
                flush=True,
            )
    results.scores = {
        task: {model: results.scores[task][model] for model in models} for task in results.scores
    }
    return results
