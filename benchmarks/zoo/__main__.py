"""The command line: ``python -m benchmarks.zoo run|list|train``."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # processor times are for one core

from .model import find_models, load_file
from .models.anhyst import DEFAULT
from .page import write_page
from .ranking import find_error, is_competitor, rank
from .results import RECORD_FILE, Results
from .run import run
from .table import summary_text, task_text
from .task import PROJECT, read_task, task_names

OUT = PROJECT / "build" / "zoo"


def main(arguments: Sequence[str]) -> int:
    """Run one command; return the exit code."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.zoo", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    run_parser = commands.add_parser("run", help="fit models, predict test records, write page and results")
    train_parser = commands.add_parser("train", help="train networks with PyTorch and record their weights")
    commands.add_parser("list", help="list tasks and models")
    for command in (run_parser, train_parser):
        command.add_argument("--model", nargs="+", default=["all"],
                             help="names of models, or Python files with MODELS; default: all")  # fmt: skip
        command.add_argument("--task", nargs="+", default=["all"], help="names of tasks; default: all")
    run_parser.add_argument("--out", type=Path, default=OUT, help="folder to write; default: build/zoo")
    run_parser.add_argument("--workers", type=int, default=os.cpu_count() or 1,
                            help="number of processes; default: one for each core")  # fmt: skip
    run_parser.add_argument("--record", action="store_true", help="write the results into the record too")
    options = parser.parse_args(arguments)
    if options.command == "list":
        return list_all()
    tasks = _select(options.task, task_names(), "task")
    if options.command == "train":
        return train_networks(options.model, tasks)
    files = [Path(name) for name in options.model if name.endswith(".py")]
    model_names = [name for name in options.model if not name.endswith(".py")]
    models = [name for file in files for name in load_file(file)]
    if clash := set(models) & set(find_models()):
        raise SystemExit(f"the name '{min(clash)}' belongs to a model of the benchmark; choose another name")
    models += _select(model_names, list(find_models()), "model") if model_names else []
    return run_models(models, tasks, files, options)


def run_models(
    models: Sequence[str], tasks: Sequence[str], files: Sequence[Path], options: argparse.Namespace
) -> int:
    """Run models, print the tables and write the page; compare with the record."""
    measured = run(tasks, models, files, options.out, options.workers)
    record = Results.read()
    all_results = record.updated(measured)
    measured.machine = describe_machine()
    if options.record:
        all_results.machine = measured.machine
        all_results.write(RECORD_FILE)
    measured.write(options.out / "results.json")
    own_models = [model for model in models if model.startswith(DEFAULT)]
    differences = measured.differences(record, own_models)
    for task in measured.scores:
        print(task_text(task, all_results.scores[task]))
    print(summary_text(rank(all_results)))
    for task, reason in measured.skipped.items():
        print(f"skipped: {task}: {reason}")
    if own_models and record.scores:
        print("\n".join(differences) or "The figures of anhyst equal the recorded figures in all digits.")
        if rank_order(measured, record):
            print("The models of each task are ordered as in the record.")
    print("writing the page", file=sys.stderr, flush=True)
    emphasised = {DEFAULT, *(models if files else ())}
    print(f"page: {write_page(all_results, options.out, list(measured.scores), emphasised)}")
    has_failed = any(
        row.refusal.startswith("failed") for rows in measured.scores.values() for row in rows.values()
    )
    return 1 if has_failed else 0


def rank_order(measured: Results, record: Results) -> bool:
    """Whether the models of each measured task are ordered as in the record."""

    def order(results: Results, task: str) -> list[str]:
        scores = results.scores.get(task, {})
        names = [name for name in measured.scores[task] if is_competitor(name) and name in scores]
        return sorted(names, key=lambda name: (find_error(scores, name), name))

    return all(order(measured, task) == order(record, task) for task in measured.scores)


def list_all() -> int:
    """Print the names of all tasks and models."""
    for name in task_names():
        try:
            print(f"task   {name}: {read_task(name).title}")
        except Exception as error:  # a task without data is listed too
            print(f"task   {name}: {error}")
    for name in find_models():
        print(f"model  {name}")
    return 0


def train_networks(models: Sequence[str], tasks: Sequence[str]) -> int:
    """Train networks on the training records of tasks, and record their weights."""
    from .models._trainable import TRAINABLE, train

    for model in _select(models, list(TRAINABLE), "network"):
        for task in tasks:
            print(f"{model}, {task}", file=sys.stderr, flush=True)
            train(model, task)
    return 0


def describe_machine() -> list[str]:
    """Describe this machine as the other benchmarks do."""
    sys.path.append(str(PROJECT / "benchmarks"))
    from machine import this_machine

    return this_machine().lines()


def _select(requested_names: Sequence[str], available_names: Sequence[str], kind: str) -> list[str]:
    if list(requested_names) == ["all"]:
        return list(available_names)
    if unknown := [name for name in requested_names if name not in available_names]:
        raise SystemExit(f"no {kind} '{unknown[0]}'; there are: {', '.join(available_names)}")
    return list(requested_names)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
