"""Test the figures of the page of a simulation."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from anhyst.control.controller_file import ControllerTable, FilterTable, GainsTable
from anhyst.data.loops import Loop, Loops
from anhyst.support.kinds import MethodName
from anhyst.support.units import QUANTITIES
from anhyst_rigs.reports.bearing.block_diagram import figure_structure
from anhyst_rigs.reports.bearing.figures import (
    LoopCurve,
    figure_force_current,
    figure_forces,
    figure_sensitivity,
    figure_steps,
    nearest_loops,
    window_s,
)
from anhyst_rigs.reports.bearing.subject import SimulationSubject
from anhyst_rigs.reports.benefit import figure_benefit
from anhyst_rigs.reports.plants import figure_drift
from anhyst_rigs.reports.study.page import COLOURS, DASHES, MAX_CURVE_POINTS, reduce_curve_points
from anhyst_rigs.reports.tuning import GainsPoint, pareto_front
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.drift import change_rig
from anhyst_rigs.rig.magnet_table import OPENS_GAP, LikeTable
from anhyst_rigs.rig.recording import Recording
from anhyst_rigs.rig.tables import DisturbanceTable
from anhyst_rigs.study.bearing.responses import SETTLING_BAND
from anhyst_rigs.study.benefit import STEP_METRICS, MethodComparison
from anhyst_rigs.study.engine.table import Interval
from tests.reports import bearing_reports
from tests.reports.bearing_reports import GAP, OVERSHOOT, SHOWN, lag
from tests.reports.colour_vision import VISIONS, seen_difference


@pytest.fixture(scope="module", name="runs")
def _runs() -> dict[MethodName, Recording]:
    return bearing_reports.runs()


def texts_of(figure: Figure) -> list[str]:
    return [text.get_text() for ax in figure.axes for text in ax.texts]


def test_the_diagram_holds_the_numbers_of_the_files(rig: BodyRig, controller: ControllerTable) -> None:
    reported = texts_of(figure_structure(rig, controller))
    gains = controller.pidd2_gains()
    for text in (
        f"K_d {gains.K_d:.0f} N s/m", "full hysteresis compensator", "fixed point",
        "20 kHz, tick 50 µs", "16 bits, 69 µA a step", "supply ±150 V", "250 turns, 1.2 Ω",
        "reversible fraction 0.15", "mass 2 kg", "stops at 0.35 and 0.55 mm", "150 N, 500 Hz",
        "encoder: step 50 nm", "noise 5 nm rms, 20 kHz",
    ):  # fmt: skip
        assert text in reported
    heavier = change_rig(rig, {"body.mass_kg": 3.5})
    assert "mass 3.5 kg" in texts_of(figure_structure(heavier, controller))


def fullest(rig: BodyRig) -> BodyRig:
    """A rig in which every block has as much text as possible."""
    second = LikeTable(name="opposite", like="magnet", direction=OPENS_GAP, gap_m=0.45e-3)
    changes = {
        "magnets": [rig.settings.magnet.model_copy(update={"eddy_time_s": 12.5e-6}), second],
        "control.bias_N": 120.5,
        "load.stiffness_N_per_m": 12500.0,
        "load.damping_N_s_per_m": 12.5,
        "load.disturbance": [DisturbanceTable(kind="sine", force_N=12.5, frequency_Hz=50.0)] * 3,
        "body.damping_N_s_per_m": 12.5,
        "body.gravity_m_per_s2": 9.81,
        "amplifier.delay_s": 12.5e-6,
        "gap_sensor.kind": "laser",
        "gap_sensor.delay_s": 1e-5,
    }
    return change_rig(rig, changes)


def tuned(controller: ControllerTable) -> ControllerTable:
    """A controller with gains as a tuning writes them."""
    gains = GainsTable(
        K_p_N_per_m=7804312.6, K_i_N_per_m_s=3384512345.0, K_d_N_s_per_m=67149.13,
        K_dd_N_s2_per_m=0.943551,
    )  # fmt: skip
    corners = FilterTable(cutoff_Hz=3172.71, cutoff_2_Hz=3490.13)
    return controller.model_copy(
        update={"gains": gains, "design": None, "filter": corners, "set_point_weight": 0.226891}
    )


@pytest.mark.slow
@pytest.mark.parametrize("variant", list(COLOURS))
@pytest.mark.parametrize(
    ("full", "after_tuning"),
    [
        (True, True),
        *(
            pytest.param(*one, marks=pytest.mark.slow)
            for one in ((False, False), (False, True), (True, False))
        ),
    ],
)
def test_texts_of_the_diagram_stay_in_their_boxes_and_do_not_overlap(
    rig: BodyRig, controller: ControllerTable, variant: MethodName, full: bool, after_tuning: bool
) -> None:
    chosen = controller.compensation.model_copy(update={"variant": variant, "applied": "measured"})
    table = controller.model_copy(update={"compensation": chosen})
    table = tuned(table) if after_tuning else table
    figure = figure_structure(fullest(rig) if full else rig, table)
    renderer = FigureCanvasAgg(figure).get_renderer()  # type: ignore[no-untyped-call]
    (ax,) = figure.axes
    boxes = {
        str(patch.get_gid()): patch.get_window_extent(renderer)
        for patch in ax.patches
        if str(patch.get_gid()).startswith("box-")
    }
    assert len(boxes) == 9
    placed = [(text, text.get_window_extent(renderer)) for text in ax.texts if text.get_text()]
    for text, place in placed:
        if text.get_gid():
            box = boxes[f"box-{str(text.get_gid()).partition('-')[2]}"]
            inside = (box.x0 < place.x0, place.x1 < box.x1, box.y0 < place.y0, place.y1 < box.y1)
            assert all(inside), text.get_text()
        else:
            assert not any(place.overlaps(box) for box in boxes.values()), text.get_text()
    for (one, first), (two, second) in itertools.combinations(placed, 2):
        assert not first.overlaps(second), (one.get_text(), two.get_text())


@pytest.mark.parametrize("vision", list(VISIONS))
def test_variants_are_reported_apart_by_colour_or_by_dash(vision: str) -> None:
    for one, two in itertools.combinations(COLOURS, 2):
        apart = seen_difference(COLOURS[one], COLOURS[two], vision)
        assert apart > (12.0 if DASHES[one] == DASHES[two] else 7.0), (one, two, apart)


def test_steps_show_reference_and_every_variant_with_its_overshoot(subject: SimulationSubject) -> None:
    ax, below = figure_steps(subject.panels).axes
    labels = [str(line.get_label()) for line in ax.lines]
    assert labels == [
        "reference",
        "ratio: overshoot 30.25 ± 0.40\N{NO-BREAK SPACE}%",
        "single-valued: overshoot 10.00 ± 0.30\N{NO-BREAK SPACE}%",
        "full: overshoot 12.10 ± 0.25\N{NO-BREAK SPACE}%",
    ]
    for line, name in zip(ax.lines[1:], SHOWN, strict=True):
        position = np.asarray(line.get_ydata())
        assert position.max() == pytest.approx(10.0 + OVERSHOOT[name][0][0] / 10.0, abs=0.05)
        assert np.asarray(line.get_xdata())[0] == pytest.approx(-3.0)
    for line, name in zip(below.lines[: len(SHOWN)], SHOWN, strict=True):
        off = np.asarray(line.get_ydata())
        assert off.max() == pytest.approx(OVERSHOOT[name][0][0], abs=0.5)
    assert below.get_ylim()[1] > OVERSHOOT["ratio"][0][0]
    assert below.get_ylabel() == "deviation (% of height)"


def test_the_drawn_window_of_a_step_contains_its_settling(subject: SimulationSubject) -> None:
    (panel,) = subject.panels
    run = panel.recordings["full"]
    time = run["t_s"] - run["t_s"][panel.step.begin]
    outside = np.abs(run["gap_m"] - panel.step.gap_after) > SETTLING_BAND * panel.step.height
    settling_s = float(time[outside].max())
    assert settling_s > 0.015
    shown = replace(panel, shown_s=window_s([settling_s], 0.03))
    low, high = figure_steps([shown]).axes[0].get_xlim()
    assert low < 0.0
    assert 1e3 * settling_s < high <= 30.0
    assert shown.cut(run)["t_s"][-1] - run["t_s"][panel.step.begin] > settling_s


def test_the_force_figure_states_the_error_of_its_curves(runs: dict[MethodName, Recording]) -> None:
    figure = figure_forces(runs)
    error = runs["full"]["force_N"] - runs["full"]["demand_N"]
    worst = f"worst {np.abs(error).max():.2f} N"
    assert any(worst in ax.get_title(loc="left") for ax in figure.axes)


def test_the_run_is_drawn_over_the_nearest_loops() -> None:
    current = np.array([0.0, 2.0, 4.0, 2.0, 0.0])
    loops = Loops(
        tuple(
            Loop("a", current, 1e-6 * current / gap, np.full(5, gap))
            for gap in (0.35e-3, 0.42e-3, 0.48e-3, 0.55e-3)
        ),
        QUANTITIES["current"],
        QUANTITIES["force"],
        QUANTITIES["gap"],
    )
    assert [loop.gap for loop in nearest_loops(loops, 0.45e-3)] == [0.42e-3, 0.48e-3]
    assert [loop.gap for loop in nearest_loops(loops, 0.48e-3)] == [0.48e-3, 0.55e-3]
    assert [loop.gap for loop in nearest_loops(loops, 0.6e-3)] == [0.55e-3]


def test_loops_are_drawn_less_their_curve_too(runs: dict[MethodName, Recording]) -> None:
    half = np.linspace(0.0, 4.0, 200)
    current = np.concatenate([half, half[::-1]])
    width = 3.0 * np.sin(np.pi * current / 4.0)
    force = 20.0 * current**2 + np.concatenate([-width[:200], width[200:]])
    loop = LoopCurve(GAP, current, force)
    below = figure_force_current(runs, (loop,), None).axes[2]
    drawn = next(line for line in below.lines if str(line.get_label()).startswith("measured"))
    left = np.asarray(drawn.get_ydata())
    assert np.abs(left).max() == pytest.approx(3.0, abs=0.3)
    assert left[100] < -2.5 < 2.5 < left[300]


def test_the_second_panel_of_the_plane_holds_the_whole_run(
    runs: dict[MethodName, Recording], subject: SimulationSubject
) -> None:
    _, near, _ = figure_force_current(runs, subject.measured_loops, subject.identified).axes
    low, high = near.get_xlim()
    current = runs["full"]["current_A"]
    assert low < current.min()
    assert current.max() < high < 3.5


def test_thinning_keeps_peaks() -> None:
    time = np.arange(50_000.0)
    signal = np.zeros(50_000)
    signal[12_345], signal[43_211] = 7.0, -3.0
    at, kept = reduce_curve_points(time, signal)
    assert kept.size <= MAX_CURVE_POINTS + 3
    assert (kept.max(), kept.min()) == (7.0, -3.0)
    assert at[kept.argmax()] == 12_345.0
    assert at[-1] == 49_999.0


def test_sensitivities_beyond_the_figure_widen_it() -> None:
    (ax,) = figure_sensitivity({"full": lag(800.0, 40.0)}, {}).axes
    assert ax.get_ylim()[1] > 20.0 * math.log10(40.0)


def test_cells_without_a_certain_gain_are_hatched() -> None:
    figure = figure_benefit(bearing_reports.gains(), STEP_METRICS[0])
    maps = [ax for ax in figure.axes if ax.get_title(loc="left")]
    hatched = {ax.get_title(loc="left"): len(ax.patches) for ax in maps}
    assert hatched == {
        "10 µm, against ratio": 0,
        "50 µm, against ratio": 0,
        "10 µm, against the strongest baseline": 1,
        "50 µm, against the strongest baseline": 1,
    }
    for ax in maps:
        (squares,) = ax.collections
        assert all(patch.get_zorder() > squares.get_zorder() for patch in ax.patches)
    assert sorted(texts_of(figure)) == sorted(2 * ["0.30†", "0.38", "0.90†\nsingle", "0.98\nsingle"])


def test_every_outcome_except_gain_has_a_distinct_hatch() -> None:
    outcomes = {"gain": (1.0, 0.1), "no gain": (0.0, 1.0), "nothing to gain": (0.0, 0.1),
                "loss": (-1.0, 0.1)}  # fmt: skip
    found = bearing_reports.gains()
    cells = []
    for place, (outcome, difference) in enumerate(outcomes.items()):
        comparison = replace(
            found.cells[0].ratio["overshoot_percent"],
            difference=Interval(*difference, 20),
            is_below_floor=outcome == "nothing to gain",
        )
        assert comparison.outcome == outcome
        iron = replace(found.cells[0].iron, reversible_fraction=0.1 * place)
        ratio: Mapping[str, MethodComparison] = {"overshoot_percent": comparison}
        cells.append(replace(found.cells[0], iron=iron, ratio=ratio, strongest={}))
    figure = figure_benefit(replace(found, cells=tuple(cells)), STEP_METRICS[0])
    (ax,) = (ax for ax in figure.axes if ax.get_title(loc="left"))
    hatches = {patch.get_hatch() for patch in ax.patches}
    assert len(hatches) == len(ax.patches) == 3
    (legend,) = figure.legends
    assert {patch.get_hatch() for patch in legend.get_patches()} == hatches
    assert "significant loss" in {text.get_text() for text in legend.get_texts()}


def test_nothing_on_the_front_is_beaten() -> None:
    rng = np.random.default_rng(5)
    tried = [
        GainsPoint("full", settling, peak, meets_other_aims=True)
        for settling, peak in rng.uniform(1.0, 2.0, (200, 2)).tolist()
    ]
    front = pareto_front(tried)
    beaten = [
        one
        for one in tried
        if any(two.reached <= one.reached and two.peak <= one.peak and two is not one for two in tried)
    ]
    assert {id(one) for one in front} == {id(one) for one in tried} - {id(one) for one in beaten}


def test_the_pareto_figure_shows_the_choice_and_omits_unsettled_gains() -> None:
    (ax,) = bearing_reports.tuning().axes
    labels = [str(line.get_label()) for line in ax.lines]
    assert "chosen, full: 5.50 ms, peak 2.12" in labels
    assert sum(np.asarray(points.get_offsets()).shape[0] for points in ax.collections) == 2


def test_plants_that_were_lost_stay_below_nothing() -> None:
    values = np.array([*range(1, 91), *[math.inf] * 10], dtype=np.float64)
    (ax,) = figure_drift({"overshoot (%)": {"full": values}}).axes
    shares = np.asarray(ax.lines[0].get_ydata())
    assert shares.max() == pytest.approx(90.0)
