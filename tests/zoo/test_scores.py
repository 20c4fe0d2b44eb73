"""The scores of the benchmark are what they say, for models whose behaviour is known exactly."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from zoo.inversion import round_trip_error
from zoo.model import Model, Refusal
from zoo.probes import probe_behaviour
from zoo.ranking import rank
from zoo.records import FloatArray, Record
from zoo.results import Results
from zoo.scores import Errors, Scores, score
from zoo.task import Task


class PlayModel:
    """A play operator with a linear part; everything about it can be computed by hand."""

    threshold = 0.2
    lag_sign = 1.0
    drift_per_sample = 0.0

    def fit(self, records: Sequence[Record]) -> None:
        assert all(np.all(np.isfinite(record.output)) for record in records)

    def predict(self, record: Record) -> FloatArray:
        assert np.all(np.isnan(record.output)), "a model must not see the output that it predicts"
        path, state, outputs = record.path, 0.0, []
        for number, value in enumerate(path.input):
            state = min(max(state, value - self.threshold), value + self.threshold)
            outputs.append(value + self.lag_sign * (state - value) + self.drift_per_sample * number)
        return path.cut(np.array(outputs))

    def n_parameters(self) -> int:
        return 1


class LeadingModel(PlayModel):
    lag_sign = -1.0


class DriftingModel(PlayModel):
    drift_per_sample = 1e-5


class DecliningModel(PlayModel):
    def fit(self, records: Sequence[Record]) -> None:
        raise Refusal("too little data")


def make_cycle(name: str, size: float, count: int = 200) -> Record:
    drive = size * np.cos(2.0 * np.pi * np.arange(count) / count)
    record = Record(name, drive, np.full(count, np.nan))
    return replace(record, output=PlayModel().predict(record))


@pytest.fixture
def task() -> Task:
    return Task(
        name="play", title="A play operator", difficulty="", split="", source="", licence="", kind="simulated",
        input="H (A/m)", output="B (T)", schedule="", is_rate_dependent=False,
        training=[make_cycle("large", 1.0)], test=[make_cycle("small", 0.6)],
    )  # fmt: skip


def test_the_true_model_has_no_error_and_a_threshold_that_is_wrong_has_its_own(task: Task) -> None:
    scores, (output,) = score(PlayModel(), task)
    assert scores.nrms == 0.0
    assert scores.worst == 0.0
    assert output.shape == task.test[0].output.shape
    wrong_model = PlayModel()
    wrong_model.threshold = 0.25  # shifts both branches by 0.05 where the play moves
    scores, _ = score(wrong_model, task)
    assert scores.worst == pytest.approx(100.0 * 0.05 / np.max(np.abs(task.test[0].output)), rel=1e-6)
    assert scores.mean is not None
    assert scores.worst is not None
    assert 0.5 * scores.worst < scores.mean < scores.worst


def test_only_scored_samples_count() -> None:
    record = replace(make_cycle("a", 1.0), is_scored=np.arange(200) >= 150)
    output = record.output + np.where(record.scored, 0.0, 9.0)
    assert Errors.compare([output], [record]).worst == 0.0
    assert Errors.compare([output + 0.1], [record]).worst > 0.0


def test_probes_recognise_lag_lead_and_drift(task: Task) -> None:
    lagging = probe_behaviour(PlayModel(), task.training)
    assert lagging.is_passive
    assert lagging.rest_drift == 0.0
    assert lagging.minor_loop_gap < 1e-12
    assert not probe_behaviour(LeadingModel(), task.training).is_passive
    drifting = probe_behaviour(DriftingModel(), task.training)
    assert drifting.rest_drift == pytest.approx(
        100.0 * 1999 * 1e-5 / np.max(task.training[0].output), rel=1e-6
    )
    assert drifting.minor_loop_gap > 0.0


def test_the_search_inverts_a_model_and_shows_demands_that_it_cannot_reach(task: Task) -> None:
    class MixedModel(PlayModel):
        lag_sign = 0.5  # half of the output follows without play, so that every output has one input

    assert round_trip_error(MixedModel(), task.test[0], task.training) < 1e-4
    too_large = replace(task.test[0], output=6.0 * task.test[0].output)
    assert round_trip_error(MixedModel(), too_large, task.training) > 0.1


def test_a_refusal_is_recorded_and_ranks_last(task: Task) -> None:
    declined, outputs = score(DecliningModel(), task)
    assert declined.refusal == "too little data"
    assert outputs == []
    exact, rough = Scores(nrms=0.01), Scores(nrms=0.02)
    results = Results(
        scores={
            "a": {"one": exact, "two": rough, "three": declined},
            "b": {"one": rough, "two": exact, "three": rough},
            "c": {"one": exact, "two": replace(exact, nrms=0.0109), "three": declined},
        }
    )
    first, second, last = rank(results)
    assert (first.model, second.model, last.model) == ("one", "two", "three")
    assert (first.first_count, first.near_first_count) == (2, 2)
    assert (second.first_count, second.near_first_count) == (1, 2)
    assert last.declined_count == 2
    assert first.interval[0] <= first.mean_rank <= first.interval[1]


def test_the_models_of_these_tests_have_the_interface() -> None:
    assert isinstance(PlayModel(), Model)


def test_results_keep_every_digit(tmp_path: object, task: Task) -> None:
    from pathlib import Path

    assert isinstance(tmp_path, Path)
    scores, _ = score(LeadingModel(), task)
    results = Results(["a machine"], {"play": {"leading": scores}}, {"other": "no data"})
    results.write(tmp_path / "results.json")
    again = Results.read(tmp_path / "results.json")
    assert again == results
    assert again.differences(results, ["leading"]) == []
    again.scores["play"]["leading"] = replace(scores, nrms=np.nextafter(scores.nrms or 0.0, 1.0))
    assert len(again.differences(results, ["leading"])) == 1
