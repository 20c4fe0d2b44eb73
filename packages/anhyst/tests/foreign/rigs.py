"""Small rigs for the test magnets: a bearing and a force control, with iron from loops only."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from tests.foreign.magnets import ForeignMagnet

OPTIONS_FROM_LOOPS = 'iron = "from loops"'


def reach(magnet: ForeignMagnet, gap: float) -> float:
    """Return the force at the largest current, N."""
    return float(magnet.force(np.linspace(0.0, magnet.top, 20), gap)[-1])


def write_bearing(magnet: ForeignMagnet, folder: Path, keys: str = OPTIONS_FROM_LOOPS) -> Path:
    """Write loops, rig and controller of a bearing that one magnet carries; return the rig file.

    Parameters
    ----------
    magnet : ForeignMagnet
    folder : Path
    keys : str, optional
        What stands in ``[[magnet]]`` beside its name and its gap, and behind it.
    """
    magnet.write_loops(folder / "loops.csv")
    smallest_gap, high, top = magnet.gaps[0], magnet.gaps[-1], magnet.top
    step, middle, load = high - smallest_gap, 0.5 * (smallest_gap + high), 0.4 * reach(magnet, high)
    mass, largest = load / 30.0, reach(magnet, smallest_gap)
    rig = folder / "rig.toml"
    rig.write_text(f"""\
format = "anhyst-rig"
version = 2
name = "{magnet.name}"
noise_seeds = 2
[timing]
rate_Hz = 20000.0
[loops]
files = "loops.csv"
[[magnet]]
name = "magnet"
gap_m = {middle:.6g}
{keys}
[[amplifier]]
supply_V = 150.0
bandwidth_Hz = 2500.0
current_high_A = {top}
dac_bits = 16
[[body]]
mass_kg = {mass:.5g}
stop_low_m = {smallest_gap + 0.05 * step:.6g}
stop_high_m = {high - 0.05 * step:.6g}
[[sensor]]
of = "gap"
kind = "encoder"
low_m = {0.5 * smallest_gap:.6g}
high_m = {1.5 * high:.6g}
[[sensor]]
of = "current"
low_A = {-0.1 * top:.6g}
high_A = {1.1 * top:.6g}
adc_bits = 16
noise_A = {1e-4 * top:.3g}
bandwidth_Hz = 10e3
[[sensor]]
of = "force"
low_N = {-0.1 * largest:.6g}
high_N = {1.2 * largest:.6g}
adc_bits = 14
noise_N = {1e-3 * largest:.3g}
bandwidth_Hz = 500.0
[load]
force_N = {load:.5g}
bandwidth_Hz = 500.0
encoder_step_m = 50e-9
velocity_bandwidth_Hz = 200.0
[control]
kind = "levitation"
[measurement]
gaps_m = [{smallest_gap}, {high}]
current_max_A = {top}
sweep_A_per_s = {top}
sample_s = 0.01
conditioning_cycles = 1
records = [{{ name = "full", turns = [0.0, 1.0, 0.0] }}]
[[case]]
kind = "step"
heights_m = [{0.1 * step:.3g}]
hold_s = 0.03
""")
    (folder / "controller.toml").write_text(f"""\
format = "anhyst-controller"
version = 1
name = "by the design rule"
rate_Hz = 20000.0
set_point_weight = 0.3
[design]
mass_kg = {mass:.5g}
bandwidth_Hz = 150.0
damping = 1.0
[filter]
cutoff_Hz = 2000.0
cutoff_2_Hz = 2000.0
[limits]
force_low_N = 0.0
force_high_N = {2.0 * load:.5g}
current_low_A = 0.0
current_high_A = {top}
gap_low_m = {smallest_gap:.6g}
gap_high_m = {high:.6g}
step_m = 20e-6
[compensation]
variant = "full"
format = "fixed"
[lift_off]
force_rate_N_per_s = {8.0 * load:.5g}
detect_m = 2e-6
speed_m_per_s = 2e-3
[landing]
speed_m_per_s = 2e-3
force_rate_N_per_s = {8.0 * load:.5g}
[safety]
max_missing_samples = 3
hold_ticks = 2000
""")
    return rig


def write_force_control(magnet: ForeignMagnet, folder: Path) -> Path:
    """Write loops and rig of an open-loop force control; return the rig file."""
    magnet.write_loops(folder / "loops.csv")
    smallest_gap, high, top = magnet.gaps[0], magnet.gaps[-1], magnet.top
    largest = reach(magnet, smallest_gap)
    rig = folder / "rig.toml"
    rig.write_text(f"""\
format = "anhyst-rig"
version = 2
name = "{magnet.name}"
[timing]
rate_Hz = 1000.0
[loops]
files = "loops.csv"
[[magnet]]
name = "magnet"
{OPTIONS_FROM_LOOPS}
[[amplifier]]
current_high_A = {top}
dac_bits = 14
bandwidth_Hz = 200.0
slew_A_per_s = {100.0 * top:.6g}
[[sensor]]
of = "current"
low_A = {-0.1 * top:.6g}
high_A = {1.1 * top:.6g}
adc_bits = 14
noise_A = {1e-4 * top:.3g}
[[sensor]]
of = "gap"
kind = "lvdt"
low_m = 0.0
high_m = {1.5 * high:.6g}
adc_bits = 14
noise_m = {1e-4 * smallest_gap:.3g}
bandwidth_Hz = 50.0
[[sensor]]
of = "force"
low_N = {-0.1 * largest:.6g}
high_N = {1.2 * largest:.6g}
adc_bits = 14
noise_N = {1e-3 * largest:.3g}
bandwidth_Hz = 500.0
[control]
kind = "force"
force_max_N = {0.9 * reach(magnet, high):.5g}
end_m = {smallest_gap}
[[case]]
kind = "held"
gaps_m = [{0.5 * (smallest_gap + high):.6g}]
[[case]]
kind = "force"
name = "wide"
low = 0.1
high = 0.9
period_s = 0.5
cycles = 1
[[case]]
kind = "moving"
low_m = {smallest_gap}
high_m = {high}
period_s = 0.4
""")
    return rig
