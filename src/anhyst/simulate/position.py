"""From the controller file to the controller: what :mod:`anhyst._core` runs."""

from __future__ import annotations

from anhyst._core import FixedPosition, LoopController, Position, SinglePosition
from anhyst.control.position import (
    Converter,
    DriveScales,
    Levitation,
    Limits,
    PositionControl,
)
from anhyst.simulate.setup import Setup

RELEASE_S = 0.1
"""Time in which the largest current goes to zero when nothing is controlled, s."""

_CLASSES = {"f64": Position, "f32": SinglePosition, "fixed": FixedPosition}


def make_position(setup: Setup) -> LoopController:
    """Return the controller of a setup, just switched on, with drives that remember nothing."""
    magnet = setup.rig.settings.magnet
    pair = magnet.arrangement == "pair"
    number_format = setup.drive.format
    control = position_control(setup)
    drives = [setup.drive.fresh().native for _ in range(2 if pair else 1)]
    controller: LoopController = _CLASSES[number_format](
        control.gains(number_format), drives, dict(control.settings(number_format))
    )
    return controller


def position_control(setup: Setup) -> PositionControl:
    """Return the controller of a setup in SI units."""
    table, plant = setup.controller, setup.rig.settings
    limits, scales = table.limits, setup.drive.scales
    return PositionControl(
        pidd2=table.pidd2(),
        levitation=Levitation(
            detect=table.lift_off.detect_m,
            rise_speed=table.lift_off.speed_m_per_s,
            descend_speed=table.landing.speed_m_per_s,
            lift_rate=table.lift_off.force_rate_N_per_s,
            set_down_rate=table.landing.force_rate_N_per_s,
        ),
        limits=Limits(
            gap_low=limits.gap_low_m,
            gap_high=limits.gap_high_m,
            step=limits.step_m,
            current_low=limits.current_low_A,
            current_high=limits.current_high_A,
            release=limits.current_high_A / RELEASE_S,
            patience=table.safety.patience_ticks,
            hold=table.safety.hold_ticks,
        ),
        converter=Converter(
            plant.amplifier.current_low_A, plant.amplifier.current_high_A, plant.amplifier.dac_bits
        ),
        scales=DriveScales(
            demand=scales.demand,
            current=scales.current,
            gap_low=scales.gap_low,
            gap_high=scales.gap_high,
            flux=setup.drive.flux_full_scale,
        ),
        bias=plant.magnet.bias_force_N or 0.0,
        gap_total=plant.magnet.gap_total_m,
        measured=table.compensation.applied == "measured",
    )
