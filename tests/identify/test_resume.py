"""Runs that repeat exactly, that are killed and go on, and that are stopped by ctrl-C."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from anhyst.data import LoopSet
from anhyst.identify import IdentifyResult, identify
from anhyst.identify.fit_records import records_of
from anhyst.identify.gauge import form_of
from anhyst.identify.run import Run
from tests.identify.truths import GAPS, largest, loops_of, magnet, noisy

NOISE = 2e-3
STAGES = {"scaling": 5, "reluctance": 5, "auto": 8}
"""At four gaps: one gap, every map joined, each inner gap left out and, to choose among maps, both;
and the dead band."""


@pytest.fixture(scope="module")
def loops() -> LoopSet:
    return loops_of(magnet(), noise=NOISE, samples=40)


@pytest.fixture(scope="module")
def whole(loops: LoopSet) -> IdentifyResult:
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


class KilledError(BaseException):
    """A run that ends at once, as after a kill."""


@dataclass
class Executioner(Killer):
    def __call__(self, done: float, total: float) -> None:
        self.seen.append((done, total))
        if done >= self.after:
            raise KilledError


def same(one: IdentifyResult, other: IdentifyResult) -> bool:
    settled = [
        np.array_equal(first, second)
        for first, second in zip(one.fitted, other.fitted, strict=True)
    ]
    return (
        one.model.parameters == other.model.parameters
        and one.model.gap_map == other.model.gap_map
        and one.model.fit == other.model.fit
        and one.model.uncertainty == other.model.uncertainty
        and all(settled)
    )


def stages_in(checkpoint: Path) -> list[str]:
    return list(json.loads(checkpoint.read_text(encoding="utf-8"))["stages"])


def kill(loops: LoopSet, checkpoint: Path, after: int, **settings: Any) -> None:
    with pytest.raises(KilledError):
        identify(loops, checkpoint=checkpoint, progress=Executioner(after), **settings)
    assert len(stages_in(checkpoint)) == after


def test_the_same_seed_gives_the_same_model_to_the_last_digit(
    loops: LoopSet, whole: IdentifyResult
) -> None:
    assert same(identify(loops), whole)
    one, other = (identify(loops, gap_map="free", seed=4) for _ in range(2))
    assert same(one, other)


def test_ten_seeds_reach_the_same_optimum(loops: LoopSet) -> None:
    ends = [identify(loops, gap_map="reluctance", seed=seed) for seed in range(10)]
    rms = [end.model.fit.rms for end in ends if end.model.fit is not None]
    assert max(rms) < (1.0 + 1e-6) * min(rms)
    rho = np.array([end.model.parameters["rho"] for end in ends])
    assert np.abs(rho - rho[0]).max() < 1e-3 * rho.max()


@pytest.mark.parametrize("after", [1, 3, 6])
def test_a_killed_run_goes_on_where_it_was(
    loops: LoopSet, whole: IdentifyResult, tmp_path: Path, after: int
) -> None:
    checkpoint = tmp_path / "run.json"
    kill(loops, checkpoint, after)
    progress = Killer()
    resumed = identify(loops, checkpoint=checkpoint, progress=progress)
    assert f"{after} stages were done already" in " ".join(resumed.warnings)
    assert progress.seen[-1] == (STAGES["auto"], STAGES["auto"])
    assert same(resumed, whole)
    assert not checkpoint.exists()


def test_stages_done_are_not_done_again(tmp_path: Path, loops: LoopSet) -> None:
    form = form_of(loops.input, loops.output, "effective-field")
    records = records_of(loops)
    checkpoint = tmp_path / "run.json"
    first = Run(form, records, 1, frozenset(), checkpoint=checkpoint)
    made = first.stage("one", lambda: {"x": [0.1, float(np.pi), 1e-300], "n": 3})
    second = Run(form, records, 1, frozenset(), checkpoint=checkpoint)
    assert second.stage("one", lambda: pytest.fail("done again")) == made
    assert second.resumed == 1
    assert second.stage("two", lambda: 2) == 2
    assert (second.resumed, stages_in(checkpoint)) == (1, ["one", "two"])
    second.finish()
    assert not checkpoint.exists()


@pytest.mark.parametrize(
    "change",
    [
        {"seed": 2},
        {"weights": "relative"},
        {"offsets": False},
        {"law": "jiles-atherton-1986"},
    ],
    ids=lambda change: str(next(iter(change))),
)
def test_another_setting_does_not_go_on_from_there(
    loops: LoopSet, tmp_path: Path, change: dict[str, Any]
) -> None:
    checkpoint = tmp_path / "run.json"
    two = loops.at(GAPS[:2])
    settings: dict[str, Any] = {"gap_map": "scaling"}
    kill(two, checkpoint, 1, **settings)
    other = identify(two, checkpoint=checkpoint, **(settings | change))
    assert not any("checkpoint" in text for text in other.warnings)
    assert same(other, identify(two, **(settings | change)))


def test_other_data_do_not_go_on_from_there(loops: LoopSet, tmp_path: Path) -> None:
    checkpoint = tmp_path / "run.json"
    kill(loops, checkpoint, 2, gap_map="reluctance")
    others = noisy(loops, NOISE, 9)
    result = identify(others, gap_map="reluctance", checkpoint=checkpoint)
    assert not any("checkpoint" in text for text in result.warnings)
    assert same(result, identify(others, gap_map="reluctance"))


@pytest.mark.parametrize("history", ["settled", "conditioned:0,1.9,0"])
def test_another_past_does_not_go_on_from_there(
    loops: LoopSet, tmp_path: Path, history: str
) -> None:
    checkpoint = tmp_path / "run.json"
    one = loops.at(GAPS[:2])
    kill(one.with_history("conditioned:0,2,0"), checkpoint, 1, gap_map="reluctance")
    result = identify(one.with_history(history), gap_map="reluctance", checkpoint=checkpoint)
    assert not any("checkpoint" in text for text in result.warnings)


@pytest.mark.parametrize(
    ("first", "second"), [("scaling", "reluctance"), ("reluctance", "scaling"), ("auto", "scaling")]
)
def test_another_gap_map_takes_only_the_stages_it_shares(
    tmp_path: Path, first: str, second: str
) -> None:
    """Long loops, which end in a stage of their own on every sample."""
    loops = loops_of(magnet(gaps=GAPS[:2]), noise=NOISE, samples=410)
    checkpoint = tmp_path / "run.json"
    kill(loops, checkpoint, 4 if first == "auto" else 3, gap_map=first)
    result = identify(loops, gap_map=second, checkpoint=checkpoint)
    assert same(result, identify(loops, gap_map=second))


@pytest.mark.parametrize(
    "rubbish",
    [
        b"",
        b"{",
        b"[1, 2]",
        b'"text"',
        b'{"key": "another", "stages": {"one gap": 1}}',
        b"\xff\xfe\0",
    ],
)
def test_a_damaged_checkpoint_is_ignored(loops: LoopSet, tmp_path: Path, rubbish: bytes) -> None:
    checkpoint = tmp_path / "run.json"
    checkpoint.write_bytes(rubbish)
    one = loops.at(GAPS[0])
    result = identify(one, checkpoint=checkpoint)
    assert not any("checkpoint" in text for text in result.warnings)
    assert same(result, identify(one))
    assert not checkpoint.exists()


def test_a_checkpoint_cut_short_is_ignored(loops: LoopSet, tmp_path: Path) -> None:
    checkpoint = tmp_path / "run.json"
    kill(loops, checkpoint, 2, gap_map="reluctance")
    checkpoint.write_bytes(checkpoint.read_bytes()[:-20])
    result = identify(loops, gap_map="reluctance", checkpoint=checkpoint)
    assert not any("checkpoint" in text for text in result.warnings)


@pytest.mark.parametrize("samples", [40, 410])
def test_ctrl_c_leaves_the_best_so_far(tmp_path: Path, samples: int) -> None:
    loops = loops_of(magnet(), noise=NOISE, samples=samples)
    checkpoint = tmp_path / "run.json"
    early = identify(loops, progress=Killer(3), checkpoint=checkpoint)
    assert early.interrupted
    assert early.model.gap_map == "scaling"  # the only one joined by then
    assert early.model.provenance.settings["gap_map_reason"] == (
        "the search was interrupted: this is the best so far"
    )
    late = identify(loops, progress=Killer(6), checkpoint=checkpoint)
    assert late.interrupted
    assert late.model.gap_map == "reluctance"
    for result in (early, late):
        assert [out.size for out in result.fitted] == [loop.n for loop in loops.loops]
        assert result.model.fit is not None
        assert result.model.fit.left_out == {}
        assert result.model.uncertainty is not None
    assert late.model.fit is not None
    assert late.model.fit.rms < 1.1 * NOISE * largest(loops)
    assert checkpoint.exists()
    whole = identify(loops, checkpoint=checkpoint)
    assert not whole.interrupted
    assert not checkpoint.exists()


def test_ctrl_c_before_there_is_a_model_goes_on_as_ctrl_c(loops: LoopSet, tmp_path: Path) -> None:
    checkpoint = tmp_path / "run.json"
    with pytest.raises(KeyboardInterrupt):
        identify(loops, progress=Killer(1), checkpoint=checkpoint)
    assert stages_in(checkpoint) == ["one gap"]


def test_ctrl_c_inside_a_stage_loses_only_that_stage(
    loops: LoopSet, whole: IdentifyResult, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    checkpoint = tmp_path / "run.json"

    def interrupted(*_: object) -> float:
        raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr("anhyst.identify.choice.refit", interrupted)
        result = identify(loops, checkpoint=checkpoint)
    assert result.interrupted
    assert len(stages_in(checkpoint)) == 4  # one gap, and three maps joined
    assert same(identify(loops, checkpoint=checkpoint), whole)


def test_progress_counts_up_to_its_total(loops: LoopSet) -> None:
    for gap_map, stages in list(STAGES.items())[:2]:
        progress = Killer()
        identify(loops, gap_map=gap_map, progress=progress)
        assert progress.seen == [(done, stages) for done in range(1, stages + 1)]
    single = Killer()
    identify(loops.at(GAPS[0]), progress=single)
    assert single.seen == [(1, 2), (2, 2)]


def test_progress_counts_up_to_its_total_for_long_loops() -> None:
    long = loops_of(magnet(gaps=GAPS[:2]), noise=NOISE, samples=410)
    progress = Killer()
    identify(long, gap_map="scaling", progress=progress)
    assert [done for done, _ in progress.seen] == [1, 2, 3, 4]
    assert {total for _, total in progress.seen} == {4}
