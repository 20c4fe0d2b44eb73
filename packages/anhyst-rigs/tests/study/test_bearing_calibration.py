"""Test the calibration of a bearing from its motion: recordings, rejections, and the benefit."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from anhyst import InputError
from anhyst.control.controller_file import ControllerFile
from anhyst.support.numeric import rms
from anhyst.support.states import Command
from anhyst_rigs import Calibration, calibrate
from anhyst_rigs.dashboard.recording import start_recording
from anhyst_rigs.rig.bearing.loop import BearingSetup, fit_bearing_compensators, make_setup, model_to_compile
from anhyst_rigs.rig.bearing.scenario import plan_recorded_run
from anhyst_rigs.rig.bench.bearing import BearingBench
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.calibration import CalibratedMethod, CalibrationFile
from anhyst_rigs.rig.drift import NO_DRIFT, Drift, change_iron, change_rig, drifted_plant
from anhyst_rigs.rig.fitting import calibrate_magnet
from anhyst_rigs.rig.loop import Scenario, SimulatedLoop
from anhyst_rigs.rig.recording import Recording
from anhyst_rigs.study.bearing.experiments import plan_trajectory
from anhyst_rigs.study.bearing.inputs import check_inputs, read_files
from anhyst_rigs.study.plants import run_bearing
from anhyst_rigs.study.tracking.bodies import BearingLaw
from tests.study import bearings

WRONG_DRIFT = Drift(pinning=0.2, gap_offset=10e-6)
"""Plant of the table: 20 % more pinning, and a gap reading that is 10 um too large."""
UNCERTAIN_GAP = {"spread.gap_zero_m": 5e-6}
"""Prior standard deviation of the gap zero in the rig file; estimates stay within four of them."""


def rig(two: bool = False) -> BodyRig:
    return change_rig(bearings.pair_rig() if two else bearings.example(), UNCERTAIN_GAP)


def setup(two: bool = False) -> BearingSetup:
    return bearings.pair() if two else bearings.single()


def flown(of: BearingSetup, scenario: Scenario, drift: Drift = WRONG_DRIFT) -> Recording:
    return SimulatedLoop(of, plant=drifted_plant(of.rig, drift, 1)).run(scenario)


@cache
def recorded(two: bool = False) -> Recording:
    """Lift-off and the steps of the example with a drifted plant."""
    mine = setup(two)
    return flown(mine, plan_recorded_run(mine.rig, mine.controller)[0])


def calibrate_run(run: Recording | Path, two: bool = False, out: Path | None = None) -> Calibration:
    table = bearings.pair_controller() if two else bearings.controller().settings
    file = ControllerFile(bearings.controller().path, table)
    known = bearings.knowledge()
    return calibrate(rig(two), run, out, magnet=known, methods=["full"], controller=file)


@cache
def learnt(two: bool = False) -> CalibratedMethod:
    (found,) = calibrate_run(recorded(two), two).file.method
    return found


def corrected(folder: Path, two: bool = False) -> BodyRig:
    """The rig with the calibration."""
    assert calibrate_run(recorded(two), two, folder / "calibration.toml").has_estimates
    calibrated_rig = change_rig(rig(two), {"control.calibration": "calibration.toml"})
    return replace(calibrated_rig, path=folder / "rig.toml")


def with_columns(**columns: np.ndarray) -> Recording:
    return Recording({**recorded().columns, **columns})


def force_error(of: BearingSetup, drift: Drift) -> float:
    """Force error in the second period of the slow triangle, N."""
    scenario, begin = plan_trajectory(of, of.rig.settings.trajectories[0])
    run = flown(of, scenario, drift).slice_ticks(begin, scenario.ticks)
    return rms(run["force_N"] - run["demand_N"])


@pytest.mark.slow
def test_gap_zero_and_width_are_found_from_the_steps_of_usual_work() -> None:
    found = learnt()
    assert found.fits
    assert found.value("gap_zero_m") == pytest.approx(10e-6, abs=2.5e-6)
    assert found.value("width") == pytest.approx(0.2, abs=0.05)
    assert abs(found.value("scale_1")) < 0.01


@pytest.mark.slow
@pytest.mark.parametrize("two", [False, True], ids=["one magnet", "a pair"])
def test_the_calibrated_bearing_is_as_good_as_one_that_never_drifted(tmp_path: Path, two: bool) -> None:
    table = bearings.pair_controller() if two else bearings.controller().settings
    after = make_setup(corrected(tmp_path, two), table, bearings.knowledge(), "full", "fixed")
    nominal = force_error(setup(two), NO_DRIFT)
    assert force_error(setup(two), WRONG_DRIFT) > 2.5 * nominal
    assert force_error(after, WRONG_DRIFT) < 1.2 * nominal


@pytest.mark.slow
def test_overshoot_after_calibration_is_that_of_a_bearing_that_never_drifted(tmp_path: Path) -> None:
    table = bearings.controller().settings
    after = make_setup(corrected(tmp_path), table, bearings.knowledge(), "full", "fixed")

    def overshoot(of: BearingSetup, drift: Drift) -> float:
        """Overshoot of the highest step, on which noise has the least effect, %."""
        return float(run_bearing({"full": of}, "full", drift, 1)["overshoot_percent"][-1])

    assert overshoot(after, WRONG_DRIFT) < 1.2 * overshoot(setup(), NO_DRIFT) + 0.05


@pytest.mark.slow
def test_the_block_is_of_the_model_that_motion_corrected(tmp_path: Path) -> None:
    found, known, own = learnt(), bearings.knowledge(), corrected(tmp_path)
    model = model_to_compile(own, known, "full")
    assert model.nodes == pytest.approx(np.add(known.model.nodes, found.value("gap_zero_m")))
    scale = 1.0 + found.value("scale_1")
    before, after = (each_model.interpolate_parameter("c_H", 0.45e-3) for each_model in (known.model, model))
    assert after == pytest.approx(scale * before)
    with pytest.raises(InputError, match="share one block"):
        model_to_compile(corrected(tmp_path, True), known, "full")


@pytest.mark.slow
@pytest.mark.parametrize("two", [False, True], ids=["one magnet", "a pair"])
def test_a_controller_expects_the_force_that_was_learnt(two: bool) -> None:
    table = bearings.pair_controller() if two else bearings.controller().settings
    law = BearingLaw(rig(two), table, bearings.knowledge(), "full")
    motion, zero = law.make_motion(recorded(two).columns), 4e-6
    values = dict.fromkeys(law.names, 0.0) | {"scale_1": 0.01, "gap_zero_m": zero}
    each = [calibrate_magnet(bearings.knowledge(), 0.01, zero, gap_margin=2.0 * zero)]
    each += [calibrate_magnet(bearings.knowledge(), 0.0, -zero, gap_margin=2.0 * zero)] if two else []
    total, net = bearings.TOTAL, np.zeros(motion.tick_numbers.size)
    gap = np.interp(
        motion.tick_numbers + motion.delay_ticks, motion.tick_numbers, motion.columns["gap_read_m"]
    )
    commands = [motion.columns[name] for name in ("command_A", "command_2_A")]
    for number, compensator in enumerate(fit_bearing_compensators(law.rig, table, each, "full", "f64")):
        at = total - gap if number else gap
        pulled = compensator.reset_copy().follow(np.ascontiguousarray(commands[number]), at)
        net += (-1.0) ** number * motion.filter_force(pulled, motion.delay_ticks)
    force_error = (net - law.net_force(motion, values))[motion.compared_indices]
    assert rms(force_error) < 1e-3 * motion.force_rms


@pytest.mark.slow
def test_with_another_iron_the_law_does_not_fit_and_nothing_is_estimated() -> None:
    other = replace(setup(), rig=change_iron(bearings.example(), 0.3, 1.0))
    run = flown(other, plan_recorded_run(other.rig, other.controller)[0], NO_DRIFT)
    found = calibrate_run(run)
    assert not found.file.method[0].fits
    assert not found.has_estimates


def test_hanging_still_under_a_load_that_swings_teaches_nothing() -> None:
    script = bearings.lifted(setup())
    for swing in (8.0, -8.0, 4.0):
        script.set_load(150.0 + swing).hold(0.1)
    run = flown(setup(), script.build())
    columns = {name: row for name, row in run.columns.items() if name != "load_N"}
    for recording in (run, Recording(columns)):
        found = calibrate_run(recording)
        assert not found.has_estimates
        (method,) = found.file.method
        assert all(number.frozen and number.value == 0.0 for number in method.parameter)


@pytest.mark.slow
def test_recordings_of_the_live_page_give_the_same_estimates(
    tmp_path: Path, tmp_path_factory: pytest.TempPathFactory
) -> None:
    bench = BearingBench(bearings.single(), bearings.firmware(tmp_path_factory))
    place = tmp_path / "run.csv"
    file = start_recording(place, bench.signals, bench.rate)
    file.write_rows(bench.advance(120))
    for command in (Command.DEMAGNETISED, Command.LIFT):
        bench.command(command)
    file.write_rows(bench.advance(9000))
    for height in (-25e-6, 25e-6, -50e-6, 50e-6):
        bench.demand(bearings.GAP + height)
        file.write_rows(bench.advance(1500))
    file.close()
    bench.close()
    (found,) = calibrate_run(place).file.method
    assert found.fits, found.summary
    assert found.is_applied
    # the plant of this test has no drift
    assert abs(found.value("width")) < 0.05
    assert abs(found.value("gap_zero_m")) < 6e-6


FAULTS: dict[str, Callable[[Recording], Recording]] = {
    "gap stuck": lambda run: with_columns(gap_read_m=np.full(len(run), run["gap_read_m"][0])),
    "gap 20 % off": lambda run: with_columns(gap_read_m=1.2 * run["gap_read_m"]),
    "command absent": lambda run: with_columns(command_A=0.0 * run["command_A"]),
    "command 30 % off": lambda run: with_columns(command_A=1.3 * run["command_A"]),
    "load not as recorded": lambda run: with_columns(load_N=0.8 * run["load_N"]),
}


@pytest.mark.slow
@pytest.mark.parametrize("fault", FAULTS)
def test_after_a_fault_nothing_is_estimated(fault: str) -> None:
    assert not calibrate_run(FAULTS[fault](recorded())).has_estimates


def test_a_recording_without_needed_columns_is_refused() -> None:
    run = bearings.run(setup(), bearings.lifted(setup()).hold(0.001).build())
    kept = {name: row for name, row in run.columns.items() if name != "state"}
    with pytest.raises(InputError, match="no column state"):
        calibrate_run(Recording(kept))
    with pytest.raises(InputError, match="begins while a current flows"):
        calibrate_run(run.slice_ticks(len(run) - 200, len(run)))


def test_a_reading_beyond_all_numbers_is_refused() -> None:
    run = bearings.run(setup(), bearings.lifted(setup()).hold(0.001).build())
    for name, value in (("gap_read_m", 1e300), ("load_N", -1e300), ("state", np.nan)):
        wrong = np.where(np.arange(len(run)) == len(run) // 2, value, run[name])
        with pytest.raises(InputError, match=f"{name} contains invalid values"):
            calibrate_run(Recording({**run.columns, name: wrong}))


def naming(folder: Path) -> Path:
    """The example's rig file with a calibration in the same folder."""
    place, kind = bearings.copy_known(folder), 'kind = "levitation"'
    text = place.read_text(encoding="utf-8")
    place.write_text(text.replace(kind, f'calibration = "calibration.toml"\n{kind}'), "utf-8")
    return place


def test_a_calibration_without_the_controllers_method_is_refused(tmp_path: Path) -> None:
    method = CalibratedMethod(name="play", residual_N=0.0, force_N=0.0, fits=True, parameter=[])
    file = CalibrationFile(
        format="anhyst-calibration",
        version=1,
        rig=bearings.example().settings.name,
        mass_kg=2.0,
        method=[method],
    )
    Calibration(file).save(tmp_path / "calibration.toml")
    with pytest.raises(InputError, match="does not contain 'full'"):
        check_inputs(*read_files(naming(tmp_path), None))


def test_a_calibration_file_may_be_named_before_it_exists(tmp_path: Path) -> None:
    run = bearings.run(setup(), bearings.lifted(setup()).hold(0.001).build())
    with pytest.raises(InputError, match="begins while"):
        calibrate(naming(tmp_path), run.slice_ticks(len(run) - 200, len(run)))
