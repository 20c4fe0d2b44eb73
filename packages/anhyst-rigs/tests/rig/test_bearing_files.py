"""Check files of a bearing: reading, writing, and error messages with line numbers."""

from __future__ import annotations

import re
import shutil
import tomllib
from pathlib import Path
from typing import cast

import numpy as np
import pytest

from anhyst.control import design
from anhyst.control.controller_file import GainsTable, controller_text, read_controller, write_controller
from anhyst.data.reading import read_loops
from anhyst.model.actuator import Model
from anhyst.support.errors import InputError
from anhyst_rigs.rig.bearing.checks import check_controller
from anhyst_rigs.rig.bearing.loop import make_setups
from anhyst_rigs.rig.body import read_bearing, step_ends
from anhyst_rigs.rig.fitting import IdentifiedMagnet
from anhyst_rigs.rig.parts.magnet import check_flux_range, read_flux_table
from anhyst_rigs.study.bearing.operating import check_load, check_rate
from tests.refusals import refused
from tests.repository import ROOT
from tests.study import bearings

EXAMPLE = ROOT / "examples" / "bearing"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in ("rig.toml", "controller.toml"):
        shutil.copy(EXAMPLE / name, tmp_path)
    return tmp_path


def change(path: Path, old: str, new: str) -> int:
    """Replace a piece of text and return its line."""
    text = path.read_text()
    assert text.count(old) >= 1, old
    path.write_text(text.replace(old, new, 1))
    return text[: text.index(old)].count("\n") + 1


def reported(caught: pytest.ExceptionInfo[InputError]) -> str:
    text = str(caught.value)
    assert "\n" not in text
    return text


def test_the_bundled_bearing_has_the_specified_values() -> None:
    rig = read_bearing(EXAMPLE / "rig.toml")
    controller = read_controller(EXAMPLE / "controller.toml")
    check_controller(controller, rig)
    plant = rig.settings
    assert (plant.body.mass_kg, rig.static_load) == (2.0, 150.0)
    assert (plant.gap_m, plant.timing.rate_Hz) == (0.45e-3, 20e3)
    assert plant.timing.delay_ticks >= 1.0
    assert plant.gap_sensor.resolution == 50e-9
    assert plant.noise_seeds == 20
    assert plant.step.heights_m == [10e-6, 20e-6, 50e-6, 100e-6]
    assert rig.substep == pytest.approx(12.5e-6)
    assert rig.measured_loops.paths[0] == EXAMPLE / "loops.csv"
    assert (rig.model_path, rig.flux_table_path, controller.model) == (None, None, None)
    pidd2 = controller.settings.pidd2()
    gains = design(mass=2.0, bandwidth=120.0, damping=1.0)
    assert (pidd2.K_p, pidd2.K_i, pidd2.K_d, pidd2.K_dd) == (gains.K_p, gains.K_i, gains.K_d, gains.K_dd)
    assert (pidd2.weight, pidd2.low, pidd2.high) == (0.3, 0.0, 300.0)


def test_weight_that_opens_the_gap_adds_to_the_load(folder: Path) -> None:
    change(folder / "rig.toml", "mass_kg = 2.0", "mass_kg = 2.0\ngravity_m_per_s2 = -9.81")
    assert read_bearing(folder / "rig.toml").static_load == pytest.approx(150.0 - 19.62)


def test_steps_are_symmetric_about_the_gap() -> None:
    lower, upper = step_ends(0.45e-3, 100e-6)
    assert (lower, upper) == pytest.approx((0.50e-3, 0.40e-3))


@pytest.mark.parametrize(
    ("old", "new", "step"),
    [
        ("\nstep_m = 50e-9", "\nstep_m = 10e-9", 10e-9),
        ("\nstep_m = 50e-9", "", 50e-9),
        ("\nstep_m = 50e-9", "\nadc_bits = 16", 0.8e-3 / 65535),
        (
            'kind = "encoder"\nlow_m = 0.05e-3\nhigh_m = 0.85e-3\nstep_m = 50e-9',
            'kind = "lvdt"\nlow_m = 0.05e-3\nhigh_m = 0.85e-3',
            0.8e-3 / 65535,
        ),
    ],
)
def test_the_resolution_is_that_of_the_file_or_of_the_kind(
    folder: Path, old: str, new: str, step: float
) -> None:
    change(folder / "rig.toml", old, new)
    sensor = read_bearing(folder / "rig.toml").settings.gap_sensor
    assert sensor.resolution == pytest.approx(step, rel=1e-12)


def test_a_zero_is_not_a_missing_value(folder: Path) -> None:
    change(folder / "rig.toml", "noise_m = 5e-9", "noise_m = 0.0\ndelay_s = 0.0")
    change(folder / "rig.toml", 'kind = "encoder"', 'kind = "laser"')
    sensor = read_bearing(folder / "rig.toml").settings.gap_sensor
    assert (sensor.noise_m, sensor.delay_s) == (0.0, 0.0)


@pytest.mark.parametrize(
    ("old", "new", "key", "what"),
    [
        (
            "bandwidth_Hz = 2500.0",
            "bandwidth = 2500.0",
            "amplifier[1].bandwidth",
            "unit-missing amplifier[1].bandwidth: bandwidth_Hz",
        ),
        ("mass_kg = 2.0", "mass = 2.0", "body[1].mass", "unit-missing body[1].mass: mass_kg"),
        ("substeps = 4", "substep = 4", "timing.substep", "extra-forbidden timing.substep: substeps"),
        (
            "knee_slow_A_per_m",
            "knee_slow_A_per_mm",
            "iron[1].knee_slow_A_per_mm",
            "extra-forbidden iron[1].knee_slow_A_per_mm",
        ),
        ("delay_ticks = 1.0", "delay_ticks = 1.1", "timing", "delay-not-whole"),
        ("turns = 250", "turns = 250.5", "magnet[1].turns", "int-type magnet[1].turns"),
        (
            'kind = "levitation"',
            'kind = "levitation"\nbias_N = 80.0',
            "control.bias_N",
            "pair-only control.bias_N",
        ),
        ('kind = "electromagnet"', 'kind = "law"', "magnet[1]", "missing: model"),
        ('kind = "electromagnet"', 'model = "m.toml"', "magnet[1]", "not-for-this-kind: model; flux_table"),
        (
            "turns = 250",
            "turns = 250\nsolid = { depth_m = 4e-3, conductivity_S_per_m = 2e6, path_m = 1.0 }",
            "magnet[1]",
            "too-long: solid.path_m; iron_length_m",
        ),
        (
            "turns = 250",
            "turns = 250\nsolid = { depth_m = 4e-3, conductivity_S_per_m = 1e300 }",
            "magnet[1].solid.conductivity_S_per_m",
            "less-than-equal magnet[1].solid.conductivity_S_per_m",
        ),
        (
            "sweep_A_per_s",
            "fast_A_per_s = [45.0, 1e-3]\nsweep_A_per_s",
            "measurement",
            "speed-out-of-range measurement: fast_A_per_s",
        ),
        (
            "sweep_A_per_s",
            "fast_A_per_s = [45.0, 45.00001]\nsweep_A_per_s",
            "measurement",
            "name-twice measurement: fast_A_per_s",
        ),
        ('iron = "core"\n', "", "magnet[1]", "missing: [[iron]]"),
        ('iron = "core"', 'iron = "cork"', "magnet[1].iron", "unknown-name: 'cork'"),
        ('name = "core"', 'name = "cork"', "magnet[1].iron", "unknown-name: 'core'"),
        ("turns = 250\n", "", "magnet[1]", "missing: turns"),
        ("gap_m = 0.45e-3 ", "direction = [-1.0, 0.0, 0.0] #", "magnet[1].gap_m", "missing"),
        ("turns = 250", "turns = 250\ndirection = [1.0, 0.0, 0.0]", "magnet[1].direction", "wrong-direction"),
        ("cells = 24", "cells = 64", "iron[1].cells", "too-many-cells"),
        (
            "stop_low_m = 0.35e-3",
            "stop_low_m = 0.55e-3",
            "body[1]",
            "range-reversed: stop_low_m; stop_high_m",
        ),
        ("stop_low_m = 0.35e-3", "stop_low_m = 0.01e-3", "sensor[1]", "range-too-narrow sensor[1]"),
        ("high_A = 5.0", "high_A = 4.4", "sensor[2]", "range-too-narrow sensor[2]"),
        (
            "current_max_A = 4.5",
            "current_max_A = 4.6",
            "measurement.current_max_A",
            "beyond-amplifier measurement.current_max_A: 4.5 A",
        ),
        (
            "gap_m = 0.45e-3",
            "gap_m = 0.56e-3",
            "magnet[1].gap_m",
            "outside-travel magnet[1].gap_m: 0.00056 m; 0.00035; 0.00055 m",
        ),
        ("0.42e-3, 0.48e-3]\nhold", "0.42e-3, 0.34e-3]\nhold", "case[1].also_gaps_m[2]", "outside-travel"),
        (
            "50e-6, 100e-6]",
            "50e-6, 200e-6]",
            "case[1].heights_m[4]",
            "outside-travel case[1].heights_m[4]: 0.00045 m; 0.00035; 0.00055 m",
        ),
        ("amplitude_m = 20e-6", "amplitude_m = 100e-6", "case[3].amplitude_m", "outside-travel"),
        ("\nstep_m = 50e-9", "\nstep_m = 50e-9\nadc_bits = 16", "sensor[1]", "both-given"),
        ("noise_m = 5e-9 ", "delay_s = 2e-3 #", "sensor[1].delay_s", "delay-too-long sensor[1].delay_s: 160"),
        (
            "dac_bits = 16",
            "dac_bits = 16\ndelay_s = 1.6e-3",
            "amplifier[1].delay_s",
            "delay-too-long amplifier[1].delay_s: 132",
        ),
        ("noise_seeds = 20", "noise_seeds = 1", "noise_seeds", "greater-than-equal noise_seeds"),
        (
            "turns = [0.0, 1.0,",
            "turns = [0.0, 1.1,",
            "measurement.records[1].turns[2]",
            "less-than-equal measurement.records[1].turns[2]",
        ),
    ],
)
def test_rig_errors_are_reported_by_line(folder: Path, old: str, new: str, key: str, what: str) -> None:
    path = folder / "rig.toml"
    change(path, old, new)
    with refused(what) as caught:
        read_bearing(path)
    text = reported(caught)
    assert f": {key}: " in text
    line = re.match(re.escape(str(path)) + r":(\d+): ", text)
    assert line
    near = path.read_text().splitlines()[int(line[1]) - 1]
    assert any(name in near for name in re.findall(r"[A-Za-z]\w*", key)[-2:])


@pytest.mark.parametrize(
    ("new", "code"),
    [
        ('kind = "step"\nforce_N = 5.0\nfrequency_Hz = 3.0', "not-for-a-step"),
        ('kind = "sine"\nforce_N = 5.0', "missing"),
    ],
)
def test_disturbances_need_the_keys_of_their_kind(folder: Path, new: str, code: str) -> None:
    path = folder / "rig.toml"
    change(path, "\n[control]", f"\n[[load.disturbance]]\n{new}\n\n[control]")
    with refused(f"{code} load.disturbance[1]: frequency_Hz"):
        read_bearing(path)


def test_a_pair_needs_room_for_its_second_magnet(folder: Path) -> None:
    path = folder / "rig.toml"
    text = path.read_text()
    path.write_text(bearings.pair_text(text, 80.0))
    assert read_bearing(path).settings.bias_N == 80.0
    path.write_text(bearings.pair_text(text, 80.0, 0.1e-3))
    line = 1 + path.read_text().splitlines().index("gap_m = 0.0001")
    with refused(f"range-too-narrow magnet[2].gap_m: :{line}:"):
        read_bearing(path)


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ('like = "magnet"', 'like = "other"', "unknown-name magnet[2].like: 'magnet'"),
        ("[1.0, 0.0, 0.0]", "[-1.0, 0.0, 0.0]", "wrong-direction magnet[2].direction"),
        ("[1.0, 0.0, 0.0]", "[1.0, 0.0]", "too-short magnet[2].direction"),
        ("gap_m = 0.00045", "", "missing magnet[2].gap_m"),
        ("bias_N = 80.0", "", "pair-only control.bias_N"),
    ],
)
def test_the_second_magnet_of_a_pair_names_its_model_and_position(
    folder: Path, old: str, new: str, what: str
) -> None:
    path = folder / "rig.toml"
    path.write_text(bearings.pair_text(path.read_text(), 80.0))
    change(path, old, new)
    with refused(what):
        read_bearing(path)


def test_a_magnet_of_an_identified_law_names_its_files(folder: Path) -> None:
    path = folder / "rig.toml"
    law = 'kind = "law"\nmodel = "m.toml"\nflux_table = "psi.csv"'
    change(path, 'kind = "electromagnet"', law)
    rig = read_bearing(path)
    assert (rig.model_path, rig.flux_table_path) == (folder / "m.toml", folder / "psi.csv")


def test_a_load_that_no_current_carries_is_refused(folder: Path) -> None:
    rig = read_bearing(folder / "rig.toml")
    check_load(rig, 171.0)
    with refused("load-too-large case[2].forces_N[1]: 150 N"):
        check_load(rig, 170.0)
    with refused("load-too-large load.force_N: 150 N"):
        check_load(rig, 150.0)


def test_a_rate_too_slow_for_the_plant_is_refused(folder: Path) -> None:
    rig = read_bearing(folder / "rig.toml")
    check_rate(rig, 1000.0)
    with refused("rate-too-low timing.rate_Hz: 20000 Hz; 20002 Hz"):
        check_rate(rig, 1000.1)


@pytest.mark.parametrize(
    ("old", "new", "key", "what"),
    [
        (
            "[filter]",
            "[gains]\nK_p_N_per_m = 1.0\nK_i_N_per_m_s = 1.0\nK_d_N_s_per_m = 1.0\n[filter]",
            "gains",
            "both-given gains",
        ),
        ("mass_kg = 2.0\n", "mass_kg = 2.0\nvirtual_mass_kg = -2.0\n", "design", "virtual-mass-too-negative"),
        ("cutoff_Hz = 2000.0", "cutoff_Hz = 10000.0", "filter.cutoff_Hz", "above-half-rate filter.cutoff_Hz"),
        ("force_low_N = 0.0", "force_low_N = 300.0", "limits", "range-reversed: force_low_N"),
        ("detect_m", "detect", "lift_off.detect", "unit-missing lift_off.detect: detect_m"),
        (
            'variant = "full"',
            'variant = "fulll"',
            "compensation.variant",
            "literal-error compensation.variant: 'ratio'",
        ),
        ("rate_Hz = 20000.0", "rate_Hz = 10000.0", "rate_Hz", "differs-from-rig"),
        (
            "current_low_A = 0.0",
            "current_low_A = -0.1",
            "limits.current_low_A",
            "beyond-amplifier limits.current_low_A",
        ),
        (
            "current_high_A = 4.5",
            "current_high_A = 4.6",
            "limits.current_high_A",
            "beyond-amplifier limits.current_high_A: 4.5 A",
        ),
        ("force_low_N = 0.0", "force_low_N = -1.0", "limits.force_low_N", "cannot-push limits.force_low_N"),
        (
            "gap_low_m = 0.33e-3",
            "gap_low_m = 0.38e-3",
            "limits.gap_low_m",
            "gaps-not-covered limits.gap_low_m: 0.00037 m",
        ),
        (
            "gap_high_m = 0.57e-3",
            "gap_high_m = 0.55e-3",
            "limits.gap_high_m",
            "gaps-not-covered limits.gap_high_m: 0.00055 m",
        ),
        (
            "[safety]",
            "[converter]\nlow_A = 0.0\nhigh_A = 4.5\nbits = 12\n[safety]",
            "converter.bits",
            "differs-from-rig converter.bits",
        ),
        (
            "[safety]",
            "[converter]\nlow_A = 4.5\nhigh_A = 4.5\nbits = 16\n[safety]",
            "converter",
            "range-reversed",
        ),
        (
            "[safety]",
            "[pair]\nbias_force_N = 100.0\ngap_total_m = 0.9e-3\n[safety]",
            "pair",
            "differs-from-rig pair",
        ),
    ],
)
def test_controller_errors_are_reported_by_line(
    folder: Path, old: str, new: str, key: str, what: str
) -> None:
    path = folder / "controller.toml"
    line = change(path, old, new)
    rig = read_bearing(folder / "rig.toml")
    with refused(what) as caught:
        check_controller(read_controller(path), rig)
    text = reported(caught)
    assert re.match(re.escape(str(path)) + r":\d+: " + re.escape(key) + ": ", text)
    if key not in {"design", "limits", "converter.bits"}:
        assert text.startswith(f"{path}:{line}: ")


def test_a_controller_without_gains_is_refused(folder: Path) -> None:
    path = folder / "controller.toml"
    settings = read_controller(path).settings
    change(path, "[design]", "[design_]")
    with refused("extra-forbidden design_"):
        read_controller(path)
    write_controller(path, settings.model_copy(update={"design": None}), "without")
    with refused("missing design"):
        read_controller(path)
    with refused("missing design"):
        settings.model_copy(update={"design": None}).pidd2()


def test_one_step_is_enough_of_a_case(folder: Path) -> None:
    text = (folder / "rig.toml").read_text()
    text = re.sub(r"\[\[case\]\]\nkind = \"(load|triangle)\"\n(.+\n)+\n?", "", text)
    text = re.sub(r"heights_m = .*\nalso_gaps_m = .*", "heights_m = [20e-6]", text)
    (folder / "rig.toml").write_text(text)
    rig = read_bearing(folder / "rig.toml")
    assert (len(rig.settings.step_gaps_m), rig.settings.trajectories) == (1, [])
    check_controller(read_controller(folder / "controller.toml"), rig)


def test_measured_flux_needs_a_probe(folder: Path) -> None:
    line = change(folder / "controller.toml", 'variant = "full"', 'variant = "flux"')
    controller = read_controller(folder / "controller.toml")
    check_controller(controller, read_bearing(folder / "rig.toml"))
    text = (folder / "rig.toml").read_text()
    without = re.sub(r"\[\[sensor\]\].*\nof = \"flux\"(.*\n)+?\n", "", text, count=1)
    assert len(without) < len(text)
    (folder / "rig.toml").write_text(without)
    with refused(f"no-hall-probe compensation.variant: toml:{line}:"):
        check_controller(controller, read_bearing(folder / "rig.toml"))


def test_gains_that_fixed_point_cannot_hold_are_reported_with_their_key(folder: Path) -> None:
    path = folder / "controller.toml"
    line = change(path, "bandwidth_Hz = 120.0", "bandwidth_Hz = 1e6")
    rig, where = read_bearing(folder / "rig.toml"), f"{path}:{line}: "
    loops = read_loops(EXAMPLE / "loops.csv")
    known = IdentifiedMagnet(loops, cast(Model, None))  # no variant below uses a model
    with refused(f"too-large-for-fixed-point design.bandwidth_Hz: {where}"):
        make_setups(rig, read_controller(path), known, ("single-valued",))
    change(path, 'format = "fixed"', 'format = "f64"')
    make_setups(rig, read_controller(path), known, ("single-valued",))


def test_a_written_controller_reads_back_to_the_same_settings(tmp_path: Path) -> None:
    settings = read_controller(EXAMPLE / "controller.toml").settings
    gains = GainsTable(K_p_N_per_m=0.1 + 0.2, K_i_N_per_m_s=1e8 / 3.0, K_d_N_s_per_m=4.5e3)
    tuned = settings.model_copy(update={"design": None, "gains": gains, "name": 'a "b"\n# c'})
    note = "Tuned for the bearing.\n\nOvershoot 2 %."
    for wanted in (settings, tuned):
        path = tmp_path / "new.toml"
        write_controller(path, wanted, note)
        assert read_controller(path).settings == wanted
        assert path.read_text() == controller_text(wanted, note)
        lines = path.read_text().splitlines()
        assert lines[:3] == ["# Tuned for the bearing.", "#", "# Overshoot 2 %."]
    assert tuned.pidd2().K_i == 1e8 / 3.0
    cutoffs = settings.filter.model_copy(update={"cutoff_2_Hz": 900.0})
    pidd2 = settings.model_copy(update={"filter": cutoffs}).pidd2()
    assert (pidd2.cutoff, pidd2.cutoff_2) == (2000.0, 900.0)


def test_a_note_cannot_become_a_key(tmp_path: Path) -> None:
    settings = read_controller(EXAMPLE / "controller.toml").settings
    text = controller_text(settings, "one\rrate_Hz = 5.0\ntwo\x0bthree\u2028four = 1")
    assert tomllib.loads(text)["rate_Hz"] == 20000.0


def grid(path: Path, rows: list[str]) -> Path:
    path.write_text("I_A,gap_mm,psi_Wb\n" + "\n".join(rows) + "\n")
    return path


ROWS = ["2,0.4,0.05", "0,0.4,0", "1,0.4,0.03", "0,0.5,0", "1,0.5,0.025", "2,0.5,0.045"]


def test_a_flux_table_is_a_grid_whatever_the_order_of_its_rows(tmp_path: Path) -> None:
    table = read_flux_table(grid(tmp_path / "psi.csv", ROWS))
    assert table.current.tolist() == [0.0, 1.0, 2.0]
    np.testing.assert_allclose(table.gap, [0.4e-3, 0.5e-3], rtol=1e-12)
    assert table.psi.tolist() == [[0.0, 0.03, 0.05], [0.0, 0.025, 0.045]]


@pytest.mark.parametrize(
    ("rows", "what"),
    [
        (ROWS[:-1], "grid-has-holes: psi.csv; 0.5 mm"),
        ([*ROWS[1:3], *ROWS[3:4], "3,0.5,0.05"], "grid-has-holes: 0.4 mm"),
        ([*ROWS, "1,0.4,0.03"], "value-again: line 8; 0.4 mm"),
        (["2,0.4,0.03", *ROWS[1:]], "not-monotone: line 2; 0.4 mm"),
        ([*ROWS[:4], "1,0.5,0.03", ROWS[5]], "not-monotone: line 6; 0.5"),
        (["2,0.4,0.05", "0,0.4,1e-3", *ROWS[2:]], "not-monotone: line 3; 0.4"),
        (["-2,0.4,-0.05", *ROWS], "currents-not-from-zero I_A: line 2"),
        (ROWS[:3], "too-few-values gap"),
        (["2,0.4,nan", *ROWS[1:]], "not-finite psi_Wb: line 2"),
        (["2,0.4,", *ROWS[1:]], "not-finite psi_Wb: line 2"),
    ],
)
def test_an_invalid_flux_table_is_reported_by_line_or_point(
    tmp_path: Path, rows: list[str], what: str
) -> None:
    path = grid(tmp_path / "psi.csv", rows)
    with refused(what):
        read_flux_table(path)


def test_a_flux_table_covers_the_range_of_the_plant(tmp_path: Path) -> None:
    path = grid(tmp_path / "psi.csv", ROWS)
    table = read_flux_table(path)
    low, high = table.gap.tolist()
    check_flux_range(path, table, low, high, 2.0)
    with refused("gaps-not-covered gap_m: 0.0004; 0.0005 m"):
        check_flux_range(path, table, low - 1e-6, high, 2.0)
    with refused("gaps-not-covered gap_m: 0.0004; 0.000501 m"):
        check_flux_range(path, table, low, high + 1e-6, 2.0)
    with refused("currents-not-covered I_A: 2.1 A"):
        check_flux_range(path, table, low, high, 2.1)


def test_a_flux_table_without_flux_is_reported(tmp_path: Path) -> None:
    path = tmp_path / "psi.csv"
    path.write_text("I_A,gap_mm,F_N\n0,0.4,0\n1,0.4,3\n")
    with refused("column-missing flux_linkage: 'psi_Wb'"):
        read_flux_table(path)


def test_every_magnet_has_its_own_gap() -> None:
    gap = np.array([0.4e-3])
    total = bearings.pair_rig().settings.gap_total_m
    assert total is not None
    assert bearings.example().magnet_gaps(gap) == [gap]
    assert bearings.pair_rig().magnet_gaps(gap) == [gap, total - gap]
