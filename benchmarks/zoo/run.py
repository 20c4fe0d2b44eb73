"""Run models on tasks in several processes."""

from __future__ import annotations

import sys
import time
import traceback
import warnings
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from functools import cache
from multiprocessing import get_context
from pathlib import Path

import numpy as np

from .model import find_models
from .records import FloatArray
from .results import Results
from .scores import Scores, score
from .task import MissingData, read_task

read_task_once = cache(read_task)
"""Reads a task once for each process, which runs many models on it."""


@dataclass(frozen=True)
class Job:
    """One model on one task."""

    task: str
    model: str
    files: tuple[Path, ...]  # files of models that are not part of the benchmark


def run_job(job: Job) -> tuple[Scores, list[FloatArray]]:
    """Score a model; a model that fails gets its error as the reason."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return score(find_models(job.files)[job.model](), read_task_once(job.task))
        except MissingData:
            raise
        except TimeoutError as limit:
            return Scores(refusal=str(limit)), []
        except Exception as error:  # the fault of a model must not stop the others
            traceback.print_exc()
            return Scores(refusal=f"failed: {type(error).__name__}: {error}"), []


def run(
    tasks: Sequence[str], models: Sequence[str], files: Sequence[Path], folder: Path, workers: int
) -> Results:
    """Run all models on all tasks; write the outputs of the test records into a folder."""
    results = Results()
    jobs = []
    for task in tasks:
        try:
            read_task_once(task)
        except MissingData as missing:
            results.skipped[task] = str(missing)
            continue
        results.scores[task] = {}
        jobs += [Job(task, model, tuple(files)) for model in models]
    began = time.monotonic()
    with ProcessPoolExecutor(workers, mp_context=get_context("spawn")) as pool:
        futures = {pool.submit(run_job, job): job for job in jobs}
        for count, future in enumerate(as_completed(futures), 1):
            job, (scores, outputs) = futures[future], future.result()
            results.scores[job.task][job.model] = scores
            if outputs:
                (folder / "outputs" / job.task).mkdir(parents=True, exist_ok=True)
                np.savez(folder / "outputs" / job.task / f"{job.model}.npz", *outputs)
            answer = scores.refusal[:200] if scores.nrms is None else f"{100.0 * scores.nrms:.3g} %"
            print(
                f"{count:4d} of {len(jobs)}  {time.monotonic() - began:4.0f} s  {job.task}, {job.model}: {answer}",
                file=sys.stderr,
                flush=True,
            )
    results.scores = {
        task: {model: results.scores[task][model] for model in models} for task in results.scores
    }
    return results
