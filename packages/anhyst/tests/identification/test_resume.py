"""Reproducible runs, runs that continue after being killed, and interruption by ctrl-C."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from anhyst.data import Loops
from anhyst.identification import IdentifyResult, identify
from anhyst.identification.fit_records import make_fit_records
from anhyst.identification.model_building import make_response_form
from anhyst.identification.run import SearchRun
from tests.identification.truths import GAPS, core, largest, loops_of, magnet, noisy

NOISE = 2e-3
STAGES = {"scaling": 5, "reluctance": 5, "auto": 7}
"""Number of stages at four gaps: one gap, every map, inner gaps withheld, dead band, last steps."""


@pytest.fixture(scope="module")
def loops() -> Loops:
    return loops_of(magnet(), noise=NOISE, samples=40)


@pytest.fixture(scope="module")
def whole(loops: Loops) -> IdentifyResult:
    return identify(loops)


@dataclass
class Killer:
    """A progress callback that kills the run after a number of stages."""

    after: int = 10**9
    seen: list[tuple[float, float]] = field(default_factory=list)

    def __call__(self, done: float, total: float) -> None:
        self.seen.append((done, total))
        if done >= self.after:
            raise KeyboardInterrupt


def same(one: IdentifyResult, other: IdentifyResult) -> bool:
    settled = [np.array_equal(first, second) for first, second in zip(one.fitted, other.fitted, strict=True)]
    return (
        one.model.parameters == other.model.parameters
        and one.model.gap_map == other.model.gap_map
        and one.model.fit == other.model.fit
        and one.model.uncertainty == other.model.uncertainty
        and all(settled)
    )


def run_of(loops: Loops, checkpoint: Path, **settings: Any) -> SearchRun:
    form = make_response_form(loops.input, loops.output, settings.pop("law", "effective-field"))
    records = make_fit_records(loops, settings.pop("weights", "loops"))
    given: dict[str, Any] = {"seed": 1, "fixed": frozenset[str]()} | settings
    return SearchRun(form, records, checkpoint=checkpoint, **given)


def is_resumed(loops: Loops, checkpoint: Path, **settings: Any) -> bool:
    """Whether a run finds the stage that an earlier run stored."""
    run = run_of(loops, checkpoint, **settings)
    run.run_stage("one", lambda: 1)
    return run.resumed_stages == 1


@pytest.mark.slow
def test_the_same_seed_gives_the_same_model_to_the_last_digit(loops: Loops, whole: IdentifyResult) -> None:
    assert same(identify(loops), whole)
    few = loops.at(GAPS[:2])
    one, other = (identify(few, law="effective-field", gap_map="free", seed=4) for _ in range(2))
    assert same(one, other)


@pytest.mark.slow
def test_five_seeds_reach_the_same_optimum(loops: Loops) -> None:
    few = loops.at(GAPS[:2])
    ends = [
        identify(few, law="effective-field", gap_map="reluctance", dead_band=False, seed=seed)
        for seed in range(5)
    ]
    rms = [end.model.fit.rms for end in ends if end.model.fit is not None]
    assert max(rms) < (1.0 + 1e-6) * min(rms)
    rho = np.array([end.model.parameters["rho"] for end in ends])
    assert np.abs(rho - rho[0]).max() < 1e-3 * rho.max()


def test_completed_stages_are_not_repeated(tmp_path: Path, loops: Loops) -> None:
    checkpoint = tmp_path / "run.json"
    first = run_of(loops, checkpoint)
    made = first.run_stage("one", lambda: {"x": [0.1, float(np.pi), 1e-300], "n": 3})
    second = run_of(loops, checkpoint)
    assert second.run_stage("one", lambda: pytest.fail("done again")) == made
    assert second.resumed_stages == 1
    assert second.run_stage("two", lambda: 2) == 2
    assert second.resumed_stages == 1
    third = run_of(loops, checkpoint)
    assert [third.run_stage(name, lambda: None) for name in ("one", "two")] == [made, 2]
    second.remove_checkpoint()
    assert not checkpoint.exists()


@pytest.mark.parametrize(
    "change",
    [
        {"seed": 2},
        {"weights": "relative"},
        {"fixed": frozenset({"in_0", "out_0"})},
        {"law": "jiles-atherton-1986"},
    ],
    ids=lambda change: str(next(iter(change))),
)
def test_a_changed_setting_starts_a_new_search(loops: Loops, tmp_path: Path, change: dict[str, Any]) -> None:
    checkpoint = tmp_path / "run.json"
    run_of(loops, checkpoint).run_stage("one", lambda: 1)
    assert is_resumed(loops, checkpoint)
    assert not is_resumed(loops, checkpoint, **change)


@pytest.mark.parametrize("history", ["demagnetised", "conditioned:0,1.9,0"])
def test_changed_data_or_history_start_a_new_search(loops: Loops, tmp_path: Path, history: str) -> None:
    checkpoint = tmp_path / "run.json"
    for others in (noisy(loops, NOISE, 9), loops.at(GAPS[:2]), loops.with_history(history)):
        run_of(loops, checkpoint).run_stage("one", lambda: 1)
        assert not is_resumed(others, checkpoint)


@pytest.mark.parametrize(
    "rubbish", [b"", b"{", b"[1, 2]", b'"text"', b'{"key": "another", "stages": {"one": 1}}', b"\xff\xfe\0"]
)
def test_a_damaged_checkpoint_is_ignored(loops: Loops, tmp_path: Path, rubbish: bytes) -> None:
    checkpoint = tmp_path / "run.json"
    checkpoint.write_bytes(rubbish)
    assert not is_resumed(loops, checkpoint)
    checkpoint.write_bytes(checkpoint.read_bytes()[:-20])
    assert not is_resumed(loops, checkpoint)


@pytest.mark.slow
@pytest.mark.parametrize("samples", [40, 410])
def test_ctrl_c_returns_the_best_model_so_far(samples: int) -> None:
    loops = loops_of(magnet(), noise=NOISE, samples=samples)
    early = identify(loops, progress=Killer(3))
    assert early.interrupted
    assert early.model.gap_map == "scaling"  # the only map that was fitted by then
    assert early.model.provenance.settings["gap_map_reason"] == (
        "the search was interrupted: this is the best model so far"
    )
    late = identify(loops, progress=Killer(6))
    assert late.interrupted
    assert late.model.gap_map == "reluctance"
    for result in (early, late):
        assert [out.size for out in result.fitted] == [loop.n for loop in loops.loops]
        assert result.model.fit is not None
        assert result.model.fit.left_out == {}
        assert result.model.uncertainty is not None
    assert late.model.fit is not None
    assert late.model.fit.rms < 1.1 * NOISE * largest(loops)


def test_ctrl_c_before_the_first_model_is_passed_on(loops: Loops) -> None:
    with pytest.raises(KeyboardInterrupt):
        identify(loops, progress=Killer(1))


def test_ctrl_c_inside_a_stage_returns_the_best_model_so_far(
    loops: Loops, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object) -> float:
        raise KeyboardInterrupt

    monkeypatch.setattr("anhyst.identification.model_selection.refit", interrupted)
    assert identify(loops).interrupted


@pytest.mark.slow
def test_progress_counts_up_to_its_total(loops: Loops) -> None:
    for gap_map, stages in list(STAGES.items())[:2]:
        progress = Killer()
        identify(loops, law="effective-field", gap_map=gap_map, progress=progress)
        assert progress.seen == [(done, stages) for done in range(1, stages + 1)]
    single = Killer()
    identify(loops.at(GAPS[0]), law="effective-field", progress=single)
    assert single.seen == [(1, 3), (2, 3), (3, 3)]


@pytest.mark.slow
@pytest.mark.parametrize("gaps", [1, 4])
def test_progress_reaches_its_total_when_laws_are_compared(gaps: int) -> None:
    progress = Killer()
    iron = magnet("reluctance") if gaps > 1 else core()
    identify(loops_of(iron, noise=NOISE, samples=40), progress=progress)
    done = [one for one, _ in progress.seen]
    assert done == list(range(1, len(done) + 1))
    assert progress.seen[-1][0] == progress.seen[-1][1]


def test_progress_counts_up_to_its_total_for_long_loops() -> None:
    long = loops_of(magnet(gaps=GAPS[:2]), noise=NOISE, samples=410)
    progress = Killer()
    identify(long, law="effective-field", gap_map="scaling", progress=progress)
    assert [done for done, _ in progress.seen] == [1, 2, 3, 4]
    assert {total for _, total in progress.seen} == {4}
