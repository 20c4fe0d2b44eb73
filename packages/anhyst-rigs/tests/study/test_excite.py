"""Test that ``excite`` keeps its limits and that its loops give models as good as others."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from anhyst.data.reading import read_loops
from anhyst.data.speeds import describe_rate, group_by_speed
from anhyst.support.numeric import FloatArray
from anhyst.support.toml_text import toml_value
from anhyst_rigs.rig.measuring import HeldMagnet, HeldRig
from anhyst_rigs.rig.piezo import read_piezo_rig
from anhyst_rigs.rig.sensor_table import Sensors
from anhyst_rigs.study.excite.design import Bound, Specimen, Supply, Winding, fast_cycles
from anhyst_rigs.study.excite.excite import Excitation, excite, measure_gaps, read_specimen
from tests.plant.test_energy import STAGE
from tests.refusals import refused
from tests.repository import ROOT
from tests.study.measured_rigs import MINOR_REVERSALS, WIDE_REVERSALS, measured_rig

TIGHT_LIMITS = """
[excite]
current_max_A = 3.5
rate_max_A_per_s = 3.0
force_max_N = 170.0
operating_N = 80.0
continuous_A = 2.6
thermal_s = 15.0
"""


@dataclass
class ForceRecordingRig:
    """A rig with held armature that records all forces."""

    rig: HeldRig
    forces: list[float] = field(default_factory=list)

    def magnet(self) -> HeldMagnet:
        rig, forces = self.rig.magnet(), self.forces

        class Feeling:
            def hold(self, current: float, gap: float) -> float:
                forces.append(rig.hold(current, gap))
                return forces[-1]

            def run(self, current: FloatArray, gap: FloatArray, seconds: float = math.inf) -> FloatArray:
                rows = rig.run(current, gap, seconds)
                forces.extend(rows[:, 0].tolist())
                return rows

        return cast(Any, Feeling())  # type: ignore[no-any-return]

    def sensors(self, seed: list[int], sample: float) -> Sensors:
        return self.rig.sensors(seed, sample)


def bearing(folder: Path, extra_lines: str = "") -> Specimen:
    return read_specimen(measured_rig("bearing", folder, extra_lines=extra_lines).path).specimen


def check_limits(found: Excitation) -> None:
    """Check the complete drive, with rests and conditioning, against the limits."""
    specimen, played = found.specimen, found.drive_history
    assert played.current.max() <= specimen.max_current.value + 1e-12
    assert played.current.min() >= specimen.min_current
    rate = np.abs(np.diff(played.current)) / specimen.sample_s
    is_regular = np.diff(played.time) < 1.5 * specimen.sample_s
    assert is_regular.all()  # the history has no missing sample
    assert rate.max() <= specimen.max_rate.value * (1.0 + 1e-9)
    assert np.diff(played.gap)[np.abs(played.current[1:]) > 0.0].max() <= 0.0
    if specimen.winding is None:
        return
    # Temperature step of the firmware, with its filter constant.
    share, warmth, max_warmth = specimen.sample_s / specimen.winding.time_constant, 0.0, 0.0
    for current in played.current.tolist():
        warmth += share * ((current / specimen.winding.continuous_current) ** 2 - warmth)
        max_warmth = max(max_warmth, warmth)
    assert 0.5 < max_warmth < 1.0  # the winding was warm


def test_a_drive_keeps_to_current_rate_force_and_the_warmth_of_the_winding(tmp_path: Path) -> None:
    specimen = bearing(tmp_path, TIGHT_LIMITS)
    assert specimen.held_rig is not None
    watched = ForceRecordingRig(specimen.held_rig)
    found = measure_gaps(replace(specimen, held_rig=watched))
    check_limits(found)
    assert 0.9 * 170.0 < max(watched.forces) <= 170.0
    assert {place.peak.key for place in found.probed_gaps} == {"excite.force_max_N", "excite.current_max_A"}
    said = " ".join(found.notes)
    for key in ("excite.rate_max_A_per_s", "excite.force_max_N"):
        assert key in said


def test_a_hot_winding_lowers_the_current(tmp_path: Path) -> None:
    free = bearing(tmp_path)
    warm = measure_gaps(replace(free, winding=Winding(1.7, 20.0)))
    check_limits(warm)
    assert all(place.peak.key == "excite.continuous_A" for place in warm.probed_gaps)
    assert all(2.0 < place.peak.value < 4.4 for place in warm.probed_gaps)
    # A slow winding with the same current needs rests, but no lower current.
    slow = measure_gaps(replace(free, winding=Winding(1.7, 200.0)))
    check_limits(slow)
    assert all(place.peak.value == 4.5 for place in slow.probed_gaps)
    assert slow.drive_history.time[-1] > 1.5 * measure_gaps(free).drive_history.time[-1]


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["bearing", "solenoid"])
def test_bundled_rigs_are_measured_within_their_limits(kind: str, tmp_path: Path) -> None:
    specimen = read_specimen(measured_rig(kind, tmp_path).path).specimen
    found = measure_gaps(specimen)
    check_limits(found)
    assert len(found.loops) == 4 * len(specimen.gaps)
    assert all(place.is_force_reached for place in found.probed_gaps)


@pytest.mark.parametrize(
    ("changes", "key"),
    [
        ({"max_force": Bound(60.0, "excite.force_max_N")}, "operating-force-not-reached: excite.force_max_N"),
        ({"max_force": Bound(0.05, "excite.force_max_N")}, "force-limit-too-low excite.force_max_N"),
        (
            {"max_current": Bound(1.0, "excite.current_max_A")},
            "operating-force-not-reached: excite.current_max_A",
        ),
        ({"max_rate": Bound(-1.0, "amplifier.supply_V")}, "supply-too-weak amplifier.supply_V"),
        ({"winding": Winding(0.3, 5.0)}, "winding-too-warm excite.continuous_A"),
    ],
)
def test_an_impossible_measurement_is_refused_with_its_limit(
    changes: dict[str, object], key: str, tmp_path: Path
) -> None:
    specimen = replace(bearing(tmp_path), **changes)  # type: ignore[arg-type]
    with refused(key):
        measure_gaps(specimen)


def test_a_bipolar_amplifier_demagnetises_before_every_record(tmp_path: Path) -> None:
    specimen = replace(bearing(tmp_path), min_current=-4.5, gaps=(0.35e-3, 0.55e-3))
    found = measure_gaps(specimen)
    check_limits(found)
    assert found.begins_demagnetised
    assert found.drive_history.current.min() == pytest.approx(-0.85 * 4.5)
    for loop in found.loops.loops:
        assert specimen.held_rig is not None
        virgin, gap = specimen.held_rig.magnet(), float(loop.schedule[0])  # type: ignore[index]
        rise = slice(0, int(np.argmax(loop.input)) // 2)
        path = loop.input[rise].copy()
        true = virgin.run(path, np.full(path.size, gap))[:, 0]
        # Within the noise of the load cell: 0.5 N.
        assert np.mean(loop.output[rise] - true) == pytest.approx(0.0, abs=0.5)


def test_loops_are_read_back_with_their_histories(tmp_path: Path) -> None:
    path = measured_rig("bearing", tmp_path, extra_lines="[excite]\ngaps_m = [0.4e-3, 0.5e-3]\n").path
    made = excite(path, tmp_path / "new.csv")
    read = read_loops(tmp_path / "new.csv")
    assert read.schedule_values == (0.4e-3, 0.5e-3)
    assert len(read) == len(made.loops) == 8
    by_label = {loop.label: loop for loop in made.loops.loops}
    for loop in read.loops:
        assert loop.history == by_label[loop.label].history
        np.testing.assert_array_equal(loop.output, by_label[loop.label].output)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "iron"),
    [
        ("bearing", None),
        *(
            pytest.param(*case, marks=pytest.mark.campaign)
            for case in (
                *(("solenoid", None), ("bearing", "preisach-usual"), ("bearing", "duhem-usual")),
                *(("solenoid", "preisach-usual"), ("solenoid", "duhem-usual")),
            )
        ),
    ],
)
def test_a_model_of_these_loops_is_as_good_as_one_of_the_bundled_campaign(
    kind: str, iron: str | None, tmp_path: Path
) -> None:
    rig = measured_rig(kind, tmp_path, iron)
    own, usual = measure_gaps(read_specimen(rig.path).specimen).loops, rig.usual_loops()
    largest = max(float(loop.output.max()) for loop in usual.loops)
    ours, theirs = rig.model(own), rig.model(usual)
    for turns in (WIDE_REVERSALS, MINOR_REVERSALS):
        # Two searches with different noise differ by up to a thousandth of the force.
        allowed = 1.15 * rig.errors(theirs, turns) + 1e-3 * largest
        assert rig.errors(ours, turns) <= allowed


def solid_bearing(folder: Path, fast: str, extra_lines: str = "") -> Specimen:
    """Return the bearing with a solid core and fast cycles."""
    path = measured_rig("bearing", folder, extra_lines=extra_lines).path
    text = path.read_text(encoding="utf-8")
    table = "solid = { depth_m = 4e-3, conductivity_S_per_m = 2e6, path_m = 0.05 }"
    text = text.replace("turns = 250", f"turns = 250\n{table}")
    text = text.replace("sweep_A_per_s", f"fast_A_per_s = {fast}\nsweep_A_per_s")
    path.write_text(text, encoding="utf-8")
    return read_specimen(path).specimen


def test_fast_cycles_stay_within_limits_and_show_eddy_currents(tmp_path: Path) -> None:
    plain = bearing(tmp_path / "plain", TIGHT_LIMITS)
    specimen = solid_bearing(tmp_path / "solid", "[30.0, 300.0]", TIGHT_LIMITS.replace("3.0", "200.0"))
    specimen = replace(specimen, gaps=specimen.gaps[:1])
    found = measure_gaps(specimen)
    assert found.drive_history.warmth.max() < 1.0
    assert found.drive_history.current.max() <= specimen.max_current.value + 1e-12
    quick = [loop for loop in found.loops.loops if loop.label.endswith("A/s")]
    paces = [
        float(np.max(np.abs(np.diff(loop.input)) / np.diff(loop.time)))
        for loop in quick
        if loop.time is not None
    ]
    assert len(paces) == 2
    assert max(paces) < 1.2 * 200.0  # noise of the shunt on top of excite.rate_max_A_per_s
    assert len(found.loops.loops) - 2 == len(measure_gaps(replace(plain, gaps=plain.gaps[:1])).loops)
    assert any("300" in note and "rate_max" in note for note in found.notes)
    speeds = group_by_speed(found.loops)
    assert speeds is not None
    assert {loop.label for group in speeds.fast for loop in group} == {loop.label for loop in quick}
    assert "rate matters" in describe_rate(found.loops)


def test_a_weak_supply_limits_the_amplitude_and_slower_cycles_have_it_too(tmp_path: Path) -> None:
    specimen = solid_bearing(tmp_path, "[30.0, 300.0, 600.0]")
    top = specimen.max_current.value
    # The full current is possible up to 200 A/s, half of it up to 400 A/s.
    supply = Supply(600.0, 400.0 / top)
    slow, fast = (Bound(rate, "amplifier.supply_V") for rate in (200.0, 400.0))
    weak = replace(specimen, gaps=specimen.gaps[:1], supply=supply, max_rate=slow, max_fast_rate=fast)
    assert fast_cycles(weak, top) == [
        (30.0, top), (30.0, 0.75 * top), (30.0, 0.5 * top),
        (300.0, 0.75 * top), (300.0, 0.5 * top), (400.0, 0.5 * top),
    ]  # fmt: skip
    found = measure_gaps(weak)
    peak = found.probed_gaps[0].peak.value
    cycles = {loop.label: loop for loop in found.loops.loops if "A/s" in loop.label}
    assert len(cycles) == len(fast_cycles(weak, peak))
    for loop in cycles.values():
        assert loop.time is not None
        rate = float(np.ptp(loop.input)) * 4.0 / float(loop.time[-1])
        assert rate + supply.rate_per_ampere * float(loop.input.max()) < 1.05 * supply.rate_without_current
    texts = [note for note in found.notes if "eddy currents at this rate" in note]
    assert len(texts) == len(
        {rate for rate, top in fast_cycles(weak, peak) if supply.current_at(rate) < 0.95 * peak}
    )
    assert any("400 A/s instead of 600 A/s" in note for note in found.notes)
    strong = replace(specimen, supply=Supply(1e6, 1.0))
    assert fast_cycles(strong, top) == [(30.0, top), (300.0, top), (600.0, top)]


def test_the_speed_that_a_set_point_needs_is_that_of_its_force_over_the_slope() -> None:
    specimen = read_specimen(STAGE).specimen
    specimen = replace(specimen, gaps=(0.45e-3,))
    (place,) = measure_gaps(specimen).probed_gaps
    # The stage (10 kg) reaches 22 m/s2 in 5.5 ms. The force is about proportional to the current
    # squared; the operating force is 120 N, half of 240 N.
    force = 10.0 * 22.0 / 5.5e-3
    assert place.required_current_rate == pytest.approx(
        force * place.operating_current / (2.0 * 120.0), rel=0.25
    )
    slow = measure_gaps(replace(specimen, fast_rates=(20.0,)))
    assert any("fast_A_per_s" in note for note in slow.notes)
    assert not any(
        "fast_A_per_s" in note for note in measure_gaps(replace(specimen, fast_rates=(2e3,))).notes
    )


PIEZO = ROOT / "examples" / "piezo" / "rig.toml"


def piezo(folder: Path, **keys: float) -> Path:
    """The bundled piezo stage with changed values."""
    lines = PIEZO.read_text().splitlines()
    path = folder / "rig.toml"
    for key, value in keys.items():
        (place,) = (number for number, line in enumerate(lines) if line.startswith(f"{key} ="))
        lines[place] = f"{key} = {toml_value(value)}"
    path.write_text("\n".join(lines) + "\n")
    return path


def test_a_piezo_stage_is_measured_between_0_v_and_the_end_of_its_amplifier(tmp_path: Path) -> None:
    made = excite(piezo(tmp_path), tmp_path / "new.csv")
    assert (made.loops.input.name, made.loops.output.name) == ("voltage", "displacement")
    assert [loop.label for loop in made.loops.loops] == [*("major", "reversal", "above", "below", "1500V/s")]
    drive = made.drive_history.current
    assert drive.min() == 0.0
    assert drive.max() == 150.0
    (place,) = made.probed_gaps
    assert place.is_force_reached  # the middle of the triangle, 19 um, needs much less than 150 V
    assert 40e-6 < place.largest_force < 50e-6
    again = read_loops(tmp_path / "new.csv")
    for loop, first in zip(again.loops, made.loops.loops, strict=True):
        assert loop.history == first.history
        assert loop.time is not None
        # Reversal curves are open: at half of the range the branches differ by more than a
        # micrometre.
        rising = np.gradient(loop.input) > 0.0
        middle = np.abs(loop.input - 70.0) < 5.0
        assert loop.output[middle & ~rising].mean() - loop.output[middle & rising].mean() > 1e-6


def test_the_recorded_drive_is_the_drive_of_the_stage(tmp_path: Path) -> None:
    path = piezo(tmp_path)
    made, rig = excite(path, tmp_path / "new.csv"), read_piezo_rig(path)
    whole = rig.make_motion(made.specimen.sample_s).run(made.drive_history.current)
    for loop in made.loops.loops:
        assert loop.time is not None
        begin = int(np.searchsorted(made.drive_history.time, loop.time[0]))
        part = slice(begin, begin + loop.n)
        assert np.array_equal(made.drive_history.current[part], loop.input)
        assert np.std(loop.output - whole[part]) == pytest.approx(4e-9, rel=0.1)


@pytest.mark.parametrize(("resonance", "slower"), [(150.0, 2.67), (480.0, 1.0), (3000.0, 1.0)])
def test_a_slow_stage_is_driven_so_slowly_that_it_hardly_rings(
    resonance: float, slower: float, tmp_path: Path
) -> None:
    path = piezo(tmp_path, resonance_Hz=resonance, damping_ratio=0.005)
    made = excite(path, tmp_path / "new.csv")
    figures = made.as_dict()
    assert figures["rate_V_per_s"] == pytest.approx(300.0 / slower, rel=0.01)
    major = made.loops.loops[0]
    # Second differences from sensor noise and ringing; a quarter of the limit is 0.3 % of 45 um.
    assert np.std(np.diff(major.output, 2)) < 4.0 * 0.003 * 45e-6


def test_a_stack_that_cannot_rest_at_0_v_is_not_measured(tmp_path: Path) -> None:
    path = piezo(tmp_path, low_V=5.0)
    with refused("out-of-range amplifier.low_V: rig.toml"):
        excite(path, tmp_path / "new.csv")
    assert not (tmp_path / "new.csv").exists()
