"""Selection of the gap map, its explanation, and rejected requests."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from anhyst.data import Loop, Loops
from anhyst.data.reading import read_loops
from anhyst.identification import IdentifyResult, candidates, cell_search, identify, model_selection
from anhyst.identification.candidates import CandidateComparison, Fits, ModelCandidate, make_titles
from anhyst.identification.cell_kernel import CellKernel
from anhyst.identification.cross_validation import Refit, WithheldError, WithheldKind
from anhyst.identification.default_search import FoundModel, search_each_gap, search_one_gap
from anhyst.identification.fit_records import make_fit_records
from anhyst.identification.flux_force import OutputName
from anhyst.identification.model_building import make_model, make_response_form
from anhyst.identification.objective import Objective
from anhyst.identification.run import SearchRun
from anhyst.identification.uncertainty import OFFSET_NAMES
from anhyst.model.actuator import Model
from anhyst.model.parameters import GapMap
from anhyst.model.schema import FitFigures
from anhyst.support.errors import InputError, NoResponseError
from anhyst.support.numeric import FloatArray
from anhyst.support.units import QUANTITIES
from tests.identification.truths import (
    GAPS,
    apart,
    core,
    largest,
    loops_of,
    magnet,
    noisy,
    path,
    predicted,
    worst,
)
from tests.refusals import refused

NOISE = 2e-3


def fit_of(result: IdentifyResult) -> FitFigures:
    assert result.model.fit is not None
    return result.model.fit


def reason(result: IdentifyResult) -> str:
    return str(result.model.provenance.settings["gap_map_reason"])


@pytest.mark.slow
@pytest.mark.parametrize("output", ["force", "flux_linkage"])
@pytest.mark.parametrize("gap_map", ["scaling", "reluctance"])
def test_auto_finds_the_true_gap_map(gap_map: GapMap, output: OutputName) -> None:
    loops = loops_of(magnet(gap_map, output), noise=NOISE, samples=60)
    result = identify(loops, output=output)
    assert result.model.gap_map == gap_map
    left_out = fit_of(result).left_out
    assert set(left_out) == {"scaling", "reluctance", "circuit"}
    assert left_out[gap_map] < 1.1 * NOISE  # mean of the noise: 0.8 of its rms
    other = "scaling" if gap_map == "reluctance" else "reluctance"
    assert left_out[other] > 1.5 * left_out[gap_map]
    assert f"gap map '{gap_map}' predicts withheld gaps" in reason(result)


@pytest.mark.slow
def test_a_withheld_error_is_that_of_a_fit_without_that_gap() -> None:
    loops = loops_of(magnet("scaling"), noise=NOISE, samples=60)
    law = "effective-field"
    reported = fit_of(identify(loops, law=law, gap_map="reluctance")).left_out["reluctance"]
    missed = []
    for gap in GAPS[1:-1]:
        others = identify(loops.without(gap), law=law, gap_map="reluctance")
        seen = loops.at(gap)
        error = np.concatenate(predicted(others.model, seen)) - np.concatenate(
            [loop.output for loop in seen.loops]
        )
        missed.append(float(np.mean(np.abs(error))) / largest(loops))
    assert reported == pytest.approx(np.mean(missed), rel=0.02)


@pytest.mark.slow
def test_gaps_in_any_order_give_the_same_model() -> None:
    loops = loops_of(magnet(), noise=NOISE, samples=60)
    mixed = replace(loops, loops=loops.loops[1::2] + loops.loops[::2])
    one, other = identify(loops, gap_map="reluctance"), identify(mixed, gap_map="reluctance")
    assert one.model.nodes == other.model.nodes == GAPS
    assert apart(one.model, other.model, loops) < 1e-4


def test_one_gap_makes_a_model_of_that_gap_and_a_warning() -> None:
    loops = loops_of(magnet(gaps=GAPS[1:2]), noise=NOISE)
    result = identify(loops)
    assert result.model.gap_map == "none"
    assert result.model.nodes == GAPS[1:2]
    assert "loops at only one gap: the model is valid only there" in result.warnings
    assert fit_of(result).left_out == {}
    assert fit_of(result).rms == pytest.approx(NOISE * largest(loops), rel=0.15)


def test_with_two_gaps_the_gap_map_is_reported_as_a_guess() -> None:
    loops = loops_of(magnet(gaps=GAPS[1:3]), noise=NOISE)
    result = identify(loops)
    assert result.model.gap_map == "reluctance"
    assert any("none can be withheld" in text for text in result.warnings)
    assert any("a guess" in text for text in result.warnings)
    assert fit_of(result).left_out == {}
    expected = identify(loops, law="effective-field", gap_map="scaling")
    assert expected.model.gap_map == "scaling"
    assert any("none can be withheld" in text for text in expected.warnings)


@pytest.mark.parametrize("gap_map", ["scaling", "reluctance", "free"])
def test_a_gap_map_needs_two_gaps(gap_map: str) -> None:
    loops = loops_of(magnet(gaps=GAPS[:1]))
    with refused(f"single-gap: {gap_map}"):
        identify(loops, gap_map=gap_map)


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"law": "preisach"}, "unknown-choice"),
        ({"gap_map": "none"}, "unknown-choice"),
        ({"search": "luck"}, "unknown-choice"),
    ],
)
def test_unknown_settings_are_refused(settings: dict[str, str], said: str) -> None:
    with refused(said):
        identify(loops_of(core()), **settings)  # type: ignore[arg-type]


def test_a_single_loop_is_warned_of() -> None:
    loops = loops_of(core())
    alone = loops.with_loops(loops.loops[:1])
    assert any("only one loop" in text for text in identify(alone).warnings)
    assert not any("only one loop" in text for text in identify(loops).warnings)


def test_too_few_samples_are_warned_of() -> None:
    result = identify(loops_of(core(), samples=8))
    assert any("samples for 7 parameters" in text for text in result.warnings)


def test_a_moving_gap_is_refused() -> None:
    loops = loops_of(magnet(gaps=GAPS[:2]))
    first = loops.loops[0]
    moving = replace(first, schedule=np.linspace(GAPS[0], GAPS[1], first.n))
    with refused("schedule-moves gap"):
        identify(loops.with_loops([moving, *loops.loops[1:]]))


def test_another_schedule_than_the_gap_works_the_same_way() -> None:
    truth = replace(core(), schedule=QUANTITIES["temperature"], nodes=(-10.0, 5.0, 30.0), gap_map="scaling")
    warm = replace(truth, parameters={**truth.parameters, "c_H": (1.0, 0.9, 0.75)})
    loops = loops_of(warm, noise=NOISE, samples=60)
    result = identify(loops)
    assert result.model.schedule == QUANTITIES["temperature"]
    assert result.model.nodes == (-10.0, 5.0, 30.0)
    assert set(fit_of(result).left_out) <= {"scaling", "reluctance", "free"}
    assert fit_of(result).rms < 1.1 * NOISE * largest(loops)


@pytest.mark.slow
@pytest.mark.parametrize("output", ["force", "flux_linkage"])
def test_a_reluctance_truth_passes_the_acceptance_test(output: OutputName) -> None:
    loops = loops_of(magnet("reluctance", output), noise=NOISE, samples=60)
    result = identify(loops, gap_map="reluctance", output=output)
    assert fit_of(result).monotone is True
    check = result.model.check_over_gap()
    assert check is not None
    assert check.passed


@pytest.mark.first(2)
@pytest.mark.parametrize("gap_map", ["scaling", "reluctance"])
@pytest.mark.parametrize("in_0", [-0.03, 0.005, 0.03])
def test_an_offset_of_the_current_sensor_fails_no_magnet(gap_map: GapMap, in_0: float) -> None:
    """Below the offset, the true current is negative, and remanence changes which gap has more force."""
    loops = loops_of(magnet(gap_map, gaps=GAPS[::3], in_0=in_0), noise=NOISE, samples=60)
    assert fit_of(identify(loops, gap_map=gap_map)).monotone is True


@pytest.mark.slow
@pytest.mark.parametrize("output", ["force", pytest.param("flux_linkage", marks=pytest.mark.slow)])
def test_a_map_that_bends_between_the_gaps_is_not_selected(
    output: OutputName, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It fits every measured gap, so withheld gaps alone would select it."""
    loops = loops_of(magnet("reluctance", output), noise=0.1 * NOISE, samples=60)

    def bent(found: FoundModel, loopset: Loops) -> Model:
        model = make_model(found, loopset)
        if found.space.gap_map != "leakage":
            return model
        rho = np.asarray(model.parameters["rho"]) * np.where(np.isin(model.nodes, GAPS), 1.0, 1.03)
        return replace(model, parameters={**model.parameters, "rho": tuple(rho.tolist())})

    monkeypatch.setattr(model_selection, "make_model", bent)
    monkeypatch.setattr(candidates, "is_more_accurate", lambda *_: True)  # chance at the withheld gaps
    assert identify(loops, law="effective-field", output=output).model.gap_map != "circuit"
    monkeypatch.setattr(model_selection, "make_model", make_model)
    assert identify(loops, law="effective-field", output=output).model.gap_map == "circuit"


def test_a_force_that_grows_with_the_gap_fails() -> None:
    loops = loops_of(magnet("scaling", c_H=(7e3, 8e3, 9e3, 10e3)), noise=NOISE, samples=60)
    assert fit_of(identify(loops, gap_map="scaling")).monotone is False


@pytest.mark.slow
def test_no_fitted_reluctance_is_negative_down_to_the_closed_gap() -> None:
    for rho in ((0.0, 0.0005, 0.001, 0.0015), (0.0035, 0.0047, 0.0059, 0.0070)):
        loops = loops_of(magnet(rho=rho), noise=NOISE, samples=60)
        model = identify(loops, gap_map="reluctance").model
        assert min(np.atleast_1d(model.parameters["rho"])) >= 0.0
        assert model.predict(loops.loops[0].input, 0.0).output.max() > 0.0


def smooth_truth() -> Model:
    """Return a magnet with all parameters smoothly dependent on the gap: only ``free`` can fit it."""
    x = np.linspace(-1.0, 1.0, len(GAPS))
    return replace(
        magnet("scaling"),
        gap_map="free",
        parameters={
            **magnet("scaling").parameters,
            "k": tuple(703.0 * np.exp(-0.15 * x)),
            "c": tuple(0.2 + 0.05 * x),
            "c_out": tuple(60.0 * np.exp(0.06 * x)),
        },
    )


@pytest.mark.slow
def test_the_free_map_predicts_a_smooth_truth_between_gaps() -> None:
    loops = loops_of(smooth_truth(), samples=60)
    law = "effective-field"
    assert identify(loops, law=law).model.gap_map != "free"  # it would require a fixed gap
    clean = identify(loops, law=law, gap_map="free")
    assert worst(loops, clean.fitted) < 2e-4  # the smoothness penalty causes a small residual
    assert fit_of(clean).left_out["free"] < 1e-3
    rough = identify(noisy(loops, NOISE, 1), law=law, gap_map="free")
    assert fit_of(rough).left_out["free"] < 2.0 * NOISE


def roughness(coordinates: FloatArray) -> float:
    return float(np.sum(np.diff(coordinates) ** 2))


def test_undetermined_parameters_vary_smoothly_over_the_gap() -> None:
    """One noisy loop per gap, far from saturation, determines little; the penalty costs almost
    nothing."""
    truth = magnet("scaling")
    loops = []
    for gap in GAPS:
        cycle = path([0.0, 1.0, 0.0], 60)[:-1]
        output = truth.predict(cycle, gap, history="settled").output
        loops.append(Loop("half", cycle, output, np.full(cycle.size, gap)))
    measured = noisy(Loops(tuple(loops), truth.input, truth.output, truth.schedule), 1e-2, 1)
    form = make_response_form(measured.input, measured.output, "effective-field")
    records = make_fit_records(measured)
    tied = search_each_gap(form, records, 1, frozenset())
    space = tied.space
    alone = [search_one_gap(form, records.at_gap(gap), 1, frozenset()) for gap in range(len(GAPS))]
    loose = space.pack([one.parameter_sets[0] for one in alone])
    for name in ("kappa", "c", "omega", "gain"):
        at = [place for place, (one, _) in enumerate(space.entries) if one == name]
        assert roughness(tied.theta[at]) < 0.7 * roughness(loose[at])
    costs = [float(np.sum(Objective(space).deviations(t) ** 2)) for t in (tied.theta, loose)]
    assert costs[0] < 1.002 * costs[1]
    assert costs[0] < tied.cost < 1.01 * costs[0]


def test_provenance_reports_the_settings(tmp_path: Path) -> None:
    made = loops_of(magnet(gaps=GAPS[:2]), samples=60)
    made.save(tmp_path / "two_gaps.csv")
    loops = read_loops(tmp_path / "two_gaps.csv", history="settled")
    result = identify(
        loops, law="effective-field", gap_map="scaling", seed=7, weights="relative", offsets=False
    )
    reported = result.model.provenance
    assert reported.seed == 7
    assert reported.sources == loops.sources
    assert reported.settings["weights"] == "relative"
    assert reported.settings["offsets"] is False
    assert reported.settings["gap_map_wanted"] == "scaling"
    assert result.model.name == "two_gaps"
    assert str(result.model.history) == "settled"
    valid = result.model.valid
    assert valid is not None
    assert valid.schedule == GAPS[:2]
    assert valid.output[1] == largest(loops)
    assert result.evaluations > 0
    assert result.seconds > 0.0


def bent_loops() -> Loops:
    """Return loops that no law can fit exactly."""
    loops = loops_of(core(), samples=40)
    bent = [replace(loop, output=0.4 * np.tanh(loop.output / 0.2)) for loop in loops.loops]
    return loops.with_loops(bent)


def test_identify_drops_a_candidate_that_fails_and_names_it(monkeypatch: pytest.MonkeyPatch) -> None:
    fit = cell_search.CellSearch._fit_candidate

    def break_one(
        search: cell_search.CellSearch, levels: cell_search._SampleSpaces, *others: Any
    ) -> list[FoundModel]:
        if levels.kernel.shape == "tanh":
            raise NoResponseError("the magnetisation may jump")
        return fit(search, levels, *others)

    monkeypatch.setattr(cell_search.CellSearch, "_fit_candidate", break_one)
    candidates = fit_of(identify(bent_loops())).candidates
    (failed,) = (candidate for candidate in candidates if candidate.note.startswith("dropped"))
    assert failed.law == "play-cells, 1 population"
    assert failed.text() == f"{failed.law}, none (dropped: the magnetisation may jump)"
    assert "play-cells-langevin, 1 population" in {candidate.law for candidate in candidates}


def test_identify_takes_the_next_candidate_if_the_best_one_cannot_be_finished(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    finish, tried = model_selection._finish_fit, list[FoundModel]()

    def fail_once(run: SearchRun, loops: Loops, found: FoundModel) -> tuple[FoundModel, str]:
        tried.append(found)
        if len(tried) == 1:
            raise np.linalg.LinAlgError("singular matrix")
        return finish(run, loops, found)

    monkeypatch.setattr(model_selection, "_finish_fit", fail_once)
    loops = bent_loops()
    candidates = fit_of(identify(loops)).candidates
    assert [candidate.note for candidate in candidates].count("chosen") == 1
    assert sum(candidate.note == "dropped: singular matrix" for candidate in candidates) == 1

    tried.clear()
    listed = fit_of(identify(loops_of(core(), samples=40))).candidates
    assert [one.note for one in listed if one.law == "effective-field"] == ["dropped: singular matrix"]

    def fail(*_: object) -> None:
        raise InputError("no answer", code="sample-refused")

    monkeypatch.setattr(model_selection, "_finish_fit", fail)
    with refused("sample-refused"):  # every candidate failed
        identify(loops)


def contest_of(by: WithheldKind, *fits: tuple[float, tuple[float, ...]]) -> CandidateComparison:
    """Return a comparison of candidates with given rms residuals and errors at withheld places."""
    entrants = [ModelCandidate("none", frozenset(), rank=rank) for rank in range(len(fits))]
    places = range(len(fits[0][1]))
    refits = {
        frozenset({place}): {
            entrant: Refit(rms**2, {place: WithheldError(errors[place], (errors[place] ** 2,))})
            for entrant, (rms, errors) in zip(entrants, fits, strict=True)
        }
        for place in places
    }
    found = {}
    for entrant, (rms, _) in zip(entrants, fits, strict=True):
        fit: Any = SimpleNamespace(cost=rms**2)
        found[entrant] = Fits(fit, fit)
    return CandidateComparison(entrants, found, refits, places, by)


@pytest.mark.parametrize(
    ("by", "fits", "chosen"),
    [
        # a place with extrapolation hides that the second law predicts better elsewhere
        ("block", [(0.1, (0.02, 0.2, 0.02)), (0.005, (0.01, 0.21, 0.01))], 1),
        ("gap", [(0.01, (0.006,)), (0.001, (0.007,))], 1),
        ("gap", [(0.01, (0.002,)), (0.001, (0.02,))], 0),  # a good fit with bad predictions
        ("block", [(0.01, (0.01, 0.01, 0.01)), (0.009, (0.01, 0.01, 0.01))], 0),
    ],
)
def test_winner_fits_no_several_times_worse_than_one_that_predicts_as_well(
    by: WithheldKind, fits: list[tuple[float, tuple[float, ...]]], chosen: int
) -> None:
    contest = contest_of(by, *fits)
    assert contest.select_best() == contest.contenders[chosen]
    contest.noise_cost = fits[chosen][0] ** 2  # the residual of the selected fit is only noise
    assert contest.select_best() == contest.contenders[chosen]


def test_no_two_candidates_carry_the_same_name() -> None:
    free = [ModelCandidate("free", held) for held in (frozenset(), OFFSET_NAMES, OFFSET_NAMES | {"omega"})]
    maps = [
        ModelCandidate("leakage", frozenset()),
        ModelCandidate("circuit", frozenset(), OFFSET_NAMES),
        ModelCandidate("circuit", frozenset()),
    ]
    every = [*free, *maps, *(replace(one, cells=CellKernel("tanh", 1)) for one in maps)]
    names = zip(make_titles(every, "effective-field"), (one.gap_map for one in every), strict=True)
    written = [(name, "circuit" if gap_map == "leakage" else gap_map) for name, gap_map in names]
    assert len(set(written)) == len(every)


def loops_of_two_temperatures(output: str, **changes: tuple[float, float]) -> Loops:
    """Return loops of a magnet or a core whose iron changes with the temperature."""
    truth = core() if output == "flux_density" else magnet("scaling", output, gaps=GAPS[:2])
    warm = replace(
        truth,
        gap_map="free" if changes else "scaling",
        schedule=QUANTITIES["temperature"],
        nodes=(20.0, 80.0),
        parameters={**truth.parameters, **changes},
    )
    return loops_of(warm, noise=NOISE, samples=60)


@pytest.mark.parametrize(
    ("output", "changes"),
    [
        ("flux_density", {"k": (11.0, 3.3), "M_s": (4e5, 2.8e5)}),
        ("force", {"k": (700.0, 210.0), "c_out": (60.0, 42.0)}),
    ],
)
def test_auto_lets_an_iron_change_with_the_temperature_and_warns(
    output: str, changes: dict[str, tuple[float, float]]
) -> None:
    loops = loops_of_two_temperatures(output, **changes)
    result = identify(loops)
    assert result.model.gap_map == "free"
    assert fit_of(result).rms < 1.2 * NOISE * largest(loops)
    assert any("would change with the temperature" in text for text in result.warnings)
    assert "with two values of the temperature none can be withheld" in reason(result)


def test_auto_prefers_a_map_that_can_be_compiled_if_it_fits_about_as_well() -> None:
    result = identify(loops_of_two_temperatures("force"))
    assert result.model.gap_map == "scaling"
    assert not any("would change with the temperature" in text for text in result.warnings)
