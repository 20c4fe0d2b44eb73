"""Magnets with a permanent magnet in series, and two coils on one yoke, against their energy."""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from anhyst._core import Coil
from anhyst.data import read_loops
from anhyst.identification import identify
from anhyst.support.numeric import FloatArray
from anhyst.support.toml_text import toml_key, toml_value
from anhyst_rigs.rig.force.file import read_rig
from anhyst_rigs.rig.kind_rules import read_rig_file
from anhyst_rigs.rig.parts.coupling import tabulate_coupling
from anhyst_rigs.rig.parts.iron import PreisachSteel
from anhyst_rigs.rig.parts.magnet import ACTUATORS, Poles, make_iron_magnet
from anhyst_rigs.rig.plant import coupled_forces
from anhyst_rigs.rig.stage.file import read_stage
from anhyst_rigs.rig.stage.fitted import identify_stage_magnet, make_stage
from anhyst_rigs.rig.stage.loop import Feedforward, track
from anhyst_rigs.rig.stage.setpoint import scan_motion
from anhyst_rigs.verbs.excite import excite
from tests.refusals import refused
from tests.repository import ROOT

EXAMPLES = ROOT / "examples"
BIASED_RIG = Path(__file__).parents[1] / "study" / "biased.toml"
STEEL = PreisachSteel(
    family="preisach",
    saturation_T=1.2,
    pinning_A_per_m=80.0,
    pinning_spread=0.5,
    bias_A_per_m=55.0,
    bias_by_pinning=0.7,
    feedback_A_per_m_T=12.0,
    saturation_sharp_T=0.15,
    knee_sharp_A_per_m=320.0,
    saturation_slow_T=0.55,
    knee_slow_A_per_m=3500.0,
)
NUMBERS = {"remanence_T": 1.2, "coercivity_A_per_m": 900e3, "magnet_length_m": 2e-3, "magnet_area_m2": 6e-4}


def biased(poles: Poles, **changes: float) -> Poles:
    return ACTUATORS["permanent-magnet"].circuit(poles, NUMBERS | changes)


pole_sizes = st.builds(
    Poles,
    turns=st.integers(50, 500),
    resistance=st.just(2.0),
    width=st.floats(0.01, 0.03),
    depth=st.floats(0.01, 0.03),
    leakage=st.floats(0.0, 1e-7),
    iron_length=st.floats(0.1, 0.3),
)


class Anhysteretic:
    """The magnet of `STEEL` without hysteresis."""

    def __init__(self, poles: Poles) -> None:
        steel = SimpleNamespace(make_steel=STEEL.make_anhysteretic_steel)
        self.magnet = make_iron_magnet(poles, cast(PreisachSteel, steel))

    def run(self, current: FloatArray, gap: float) -> FloatArray:
        return Coil(self.magnet).run(current, np.full(current.size, gap))


@settings(max_examples=25, deadline=None)
@given(pole_sizes, st.floats(1e-3, 4e-3), st.floats(2e-4, 8e-4), st.floats(0.2e-3, 1e-3))
def test_the_force_of_a_biased_magnet_is_the_derivative_of_its_coenergy(
    poles: Poles, length: float, area: float, gap: float
) -> None:
    """The coenergy is integrated from the current without flux, where it does not depend on the gap."""
    poles = biased(poles, magnet_length_m=length, magnet_area_m2=area)
    magnet, step = Anhysteretic(poles), 1e-3 * gap
    zero_flux = -poles.magnet_mmf / poles.turns
    current = np.linspace(zero_flux, -0.7 * zero_flux, 4001)
    rows = {at: magnet.run(current, at) for at in (gap - step, gap, gap + step)}
    coenergies = [np.trapezoid(rows[at][:, 1], current) for at in (gap - step, gap + step)]
    force = float(coenergies[0] - coenergies[1]) / (2.0 * step)
    assert rows[gap][-1, 0] == pytest.approx(force, rel=2e-4)
    assert (np.diff(rows[gap][:, 0]) > 0.0).all()
    assert rows[gap][0, 0] == pytest.approx(0.0, abs=1e-6 * force)
    assert np.interp(0.0, current, rows[gap - step][:, 0]) > np.interp(0.0, current, rows[gap][:, 0]) > 0.0


@settings(max_examples=15, deadline=None)
@given(pole_sizes, st.integers(0, 1000))
def test_a_permanent_magnet_acts_as_a_constant_current(poles: Poles, seed: int) -> None:
    """With hysteresis, too; the plant without a permanent magnet has another equation of its gaps."""
    poles = replace(poles, depth=poles.width)
    magnet = biased(poles)
    offset = magnet.magnet_mmf / magnet.turns
    current = np.random.default_rng(seed).uniform(-offset, offset, 40)
    gap = np.full(current.size, 0.4e-3)
    coil, other = (
        Coil(make_iron_magnet(magnet, STEEL)),
        Coil(make_iron_magnet(replace(magnet, magnet_mmf=0.0), STEEL)),
    )
    found, expected = coil.run(current, gap)[:, :2], other.run(current + offset, gap)[:, :2]
    assert (np.abs(found - expected).max(axis=0) <= 1e-3 * np.abs(expected).max(axis=0)).all()


def test_a_voltage_at_a_biased_magnet_conserves_energy_as_its_gap_moves() -> None:
    """Work and heat of a closed cycle without hysteresis equal the energy of the source."""
    poles = biased(Poles(200, 2.0, 0.02, 0.02, 2e-8, 0.2))
    coil, samples, seconds = Coil(Anhysteretic(poles).magnet), 4000, 1e-4
    turn = 2.0 * np.pi * np.arange(3 * samples + 1) / samples
    gap, rows = 0.5e-3 + 0.1e-3 * np.sin(turn + 0.5), []
    for voltage, at in zip((4.0 * np.sin(turn)).tolist(), gap.tolist(), strict=True):
        coil.step(voltage, at, seconds)
        rows.append((coil.force, coil.energy, coil.heat))
    force, energy, heat = np.array(rows)[-samples - 1 :].T
    gap = gap[-samples - 1 :]
    work = -float(0.5 * (force[1:] + force[:-1]) @ np.diff(gap))
    assert abs(work) > 1e-4
    assert energy[-1] - energy[0] - (heat[-1] - heat[0]) == pytest.approx(work, abs=2e-3 * abs(work))


def _rig(tmp_path: Path, content: dict[str, Any]) -> Path:
    path = tmp_path / "rig.toml"
    path.write_text("\n".join(f"{toml_key(key)} = {toml_value(value)}" for key, value in content.items()))
    return path


@pytest.mark.parametrize(
    ("place", "changes", "what"),
    [
        ("magnet", {"numbers": NUMBERS | {"coercivity_A_per_m": 1.2e6}}, "out-of-range magnet[1]: enter HcB, not HcJ"),
        ("magnet", {"numbers": NUMBERS | {"remanence_T": -1.0}}, "greater-than magnet[1].numbers.remanence_T"),
        ("magnet", {"numbers": {}}, "missing magnet[1]: needs numbers.coercivity_A_per_m"),
        ("magnet", {"iron": "from loops"}, "not-used iron[1]"),
        ("magnet", {"solid": {"depth_m": 4e-3, "conductivity_S_per_m": 2e6}},
         "not-for-this-kind magnet[1]: solid belongs to kind"),
        ("magnet", {"kind": "electromagnet", "numbers": {}}, "not-for-this-kind amplifier[1].current_low_A"),
        ("magnet", {"kind": "coupled-electromagnet", "numbers": {"shared_reluctance_per_H": 1e5}},
         "not-for-this-kind magnet[1].kind: needs a stage that moves along"),
        ("amplifier", {"current_low_A": -9.1}, "out-of-range amplifier[1].current_low_A: raise it to -9 A or more"),
    ],
)  # fmt: skip
def test_impossible_values_of_a_biased_magnet_are_refused(
    tmp_path: Path, place: str, changes: dict[str, Any], what: str
) -> None:
    content = tomllib.loads(BIASED_RIG.read_text())
    content[place][0] |= changes
    with refused(what):
        read_rig(_rig(tmp_path, content))


@pytest.mark.parametrize("kind", ["bearing", "stage"])
def test_a_permanent_magnet_is_only_for_force_control(tmp_path: Path, kind: str) -> None:
    content = tomllib.loads((EXAMPLES / kind / "rig.toml").read_text())
    content["magnet"][0] |= {"kind": "permanent-magnet", "numbers": NUMBERS}
    content["sensor"] = [sensor for sensor in content["sensor"] if sensor["of"] != "flux"]
    with refused("not-for-this-kind magnet[1].kind: is only for force control"):
        read_rig_file(_rig(tmp_path, content), content["control"]["kind"])


def test_a_voltage_does_not_show_the_flux_of_a_permanent_magnet(tmp_path: Path) -> None:
    content = tomllib.loads(BIASED_RIG.read_text())
    content["sensor"].append({"of": "voltage", "range_V": 20.0, "adc_bits": 16, "noise_V": 0.005})
    with refused("not-for-this-kind sensor[4]: is not available"):
        read_rig(_rig(tmp_path, content))


@pytest.mark.slow
@pytest.mark.parametrize("polarity", [1.0, -1.0])
def test_force_loops_of_a_biased_magnet_are_identified_with_either_polarity(polarity: float) -> None:
    """The offset of the input is the current that cancels the permanent magnet."""
    rig = read_rig(BIASED_RIG)
    poles, rng = rig.settings.magnet.poles, np.random.default_rng(3)
    history = [0.0, *[6.0, -6.0] * 3, 0.0]
    path = np.concatenate(
        [np.linspace(a, b, 120) for a, b in ((0, 6), (6, -6), (-6, 6), (6, -2), (-2, 5), (5, 0))]
    )

    def force(current: FloatArray, gap: float) -> FloatArray:
        coil = rig.magnet()
        for reversal in history:
            coil.hold(reversal, gap)
        return coil.run(current, np.full(current.size, gap))[:, 0]

    columns: dict[str, list[Any]] = {"loop": [], "I_A": [], "F_N": [], "gap_m": []}
    for gap in (0.3e-3, 0.38e-3, 0.48e-3, 0.6e-3):
        columns["loop"] += [f"{gap:g}"] * path.size
        columns["I_A"] += (polarity * path).tolist()
        columns["F_N"] += (force(path, gap) + 0.5 * rng.standard_normal(path.size)).tolist()
        columns["gap_m"] += [gap] * path.size
    text = "conditioned:" + ",".join(str(polarity * value) for value in history)
    model = identify(read_loops(columns, history=text), gap_map="circuit").model
    zero_flux = -poles.magnet_mmf / poles.turns
    assert np.mean(model.parameters["in_0"]) == pytest.approx(polarity * zero_flux, rel=0.1)
    test = np.concatenate([np.linspace(a, b, 50) for a, b in ((0, 5), (5, -4), (-4, 2), (2, -1), (-1, 4))])
    expected = force(test, 0.43e-3)
    error = model.predict(polarity * test, 0.43e-3, history=text).output - expected
    assert np.abs(error).mean() < 1e-3 * expected.max()
    assert np.abs(error).max() < 5e-3 * expected.max()


# Two coils on one yoke


def _flux(poles: Poles, magnetic: Anhysteretic, current: float, gap: float) -> float:
    return float(magnetic.run(np.array([current]), gap)[0, 1]) / poles.turns


def _fluxes(
    poles: Poles, magnetic: Anhysteretic, currents: tuple[float, float], gaps: tuple[float, float]
) -> FloatArray:
    """Return both fluxes, Wb: each coil sees the other flux in the shared path."""
    share = poles.shared / poles.turns

    def second(first_flux: float) -> float:
        return _flux(poles, magnetic, currents[1] - share * first_flux, gaps[1])

    def excess(first_flux: float) -> float:
        return _flux(poles, magnetic, currents[0] - share * second(first_flux), gaps[0]) - first_flux

    first = float(brentq(excess, -2e-3, 2e-3, xtol=1e-13))
    return np.array([first, second(first)])


@pytest.mark.parametrize("currents", [(2.0, 0.5), (1.0, 3.0), (3.5, 3.0), (0.0, 2.0)])
def test_the_force_map_of_two_coils_is_the_derivative_of_their_coenergy(
    currents: tuple[float, float],
) -> None:
    """The coenergy is integrated along the first current, then along the second one."""
    poles = ACTUATORS["coupled-electromagnet"].circuit(
        Poles(250, 1.2, 0.016, 0.014, 1.2e-8, 0.2), {"shared_reluctance_per_H": 4e5}
    )
    magnetic, gap, step = Anhysteretic(poles), 0.42e-3, 2e-6
    nodes, weights = np.polynomial.legendre.leggauss(40)

    def coenergy(width: float) -> float:
        gaps = width, 0.9e-3 - width
        total = 0.0
        for coil, peak in enumerate(currents):
            for node, weight in zip(0.5 * peak * (nodes + 1.0), 0.5 * peak * weights, strict=True):
                pair = (node, 0.0) if coil == 0 else (currents[0], node)
                total += weight * poles.turns * _fluxes(poles, magnetic, pair, gaps)[coil]
        return total

    table = tabulate_coupling(poles, STEEL, (0.0, 4.0), (0.3e-3, 0.6e-3), 0.9e-3)
    alone = [
        magnetic.run(np.array([current]), at)[0, 0]
        for current, at in zip(currents, (gap, 0.9e-3 - gap), strict=True)
    ]
    forces = np.array(alone) + table.force_changes(np.array(currents), gap)
    closing = (coenergy(gap - step) - coenergy(gap + step)) / (2.0 * step)
    assert forces[0] - forces[1] == pytest.approx(closing, abs=2e-3 * np.abs(forces).max())
    assert np.abs(forces - alone).max() > 0.01 * np.abs(forces).max()


def coupled_stage(tmp_path: Path, shared: float) -> Path:
    content = tomllib.loads((EXAMPLES / "stage" / "rig.toml").read_text())
    content["magnet"][0] |= {"kind": "coupled-electromagnet", "numbers": {"shared_reluctance_per_H": shared}}
    content["sensor"] = [sensor for sensor in content["sensor"] if sensor["of"] != "flux"]
    return _rig(tmp_path, content)


@pytest.mark.slow
def test_a_stage_with_two_coils_on_one_yoke_follows_less_well(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Without a change of the force, running tick by tick gives the same bits as the core's loop."""
    path = coupled_stage(tmp_path, 4e5)
    excite(path, out=tmp_path / "loops.csv")
    rig = read_stage(path)
    setup = make_stage(rig, identify_stage_magnet(rig), "full")
    motion = scan_motion(rig.settings.scan, rig.settings.scan.test_m_per_s2)
    table = coupled_forces(rig)
    assert table is not None
    rms = {}
    for name, coupling in (
        ("coupled", table),
        ("zero", replace(table, change=0.0 * table.change)),
        ("separate", None),
    ):
        monkeypatch.setattr("anhyst_rigs.rig.loop.coupled_forces", lambda _, found=coupling: found)
        run = track(setup, motion, Feedforward())
        assert run.loss is None
        rms[name] = float(np.sqrt(np.mean(run["error_m"] ** 2)))
    assert rms["zero"] == rms["separate"]
    assert rms["coupled"] > 1.5 * rms["separate"]
