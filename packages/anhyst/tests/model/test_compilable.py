"""Whether a model can be compiled; every command gets the same result."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from anhyst.model.actuator import GAP_SAMPLES as LOOKED_AT
from anhyst.model.actuator import Model, find_compile_obstacle, least_slope
from anhyst.model.dynamics import Layers
from anhyst.model.schema import ValidRange
from anhyst.support.units import QUANTITIES
from tests.model.test_model import GAPS, magnet

AT = np.linspace(GAPS[0], GAPS[-1], LOOKED_AT)


def drive_rises(model: Model, gap: float) -> bool:
    """Whether more flux always needs more drive, on rises after falls of every depth.

    The drive for a flux is computed directly, without a root search.
    """
    rise = np.linspace(-1.0, 1.0, 3001)
    for depth in (1.0, 0.6, 0.2):
        flux = np.concatenate([np.linspace(0.0, -depth, 300), rise[rise > -depth]])
        drive = model.invert(flux, np.full(flux.size, gap), history="demagnetised").drive
        if not (np.diff(drive[300:]) > 0.0).all():
            return False
    return True


@pytest.mark.parametrize("c", [0.0, 0.15, 0.7])
@pytest.mark.parametrize("alpha", [-0.02, 0.0045, 0.0055, 0.0065, 0.008, 0.02])
def test_a_jump_occurs_if_the_drive_falls_with_rising_flux(alpha: float, c: float) -> None:
    model = replace(magnet("reluctance", alpha=alpha, c=c), output=QUANTITIES["flux_density"])
    model = replace(model, parameters=dict(model.parameters) | {"c_out": 1.0, "out_0": 0.0})
    for gap in AT[::8]:
        smallest = float(least_slope(model, np.array([gap]))[0])
        if abs(smallest) > 0.01:
            assert drive_rises(model, gap) == (smallest > 0.0), (gap, smallest)
    assert (find_compile_obstacle(model) is None) == bool((least_slope(model, AT) > 0.001).all())


def test_a_coupling_that_outweighs_the_gap_without_a_jump_is_no_obstacle() -> None:
    model = magnet("reluctance", alpha=0.0045)
    assert model.interpolate_parameter("rho", GAPS[0])[0] < 0.0045 / (1.0 - 0.0045)
    assert find_compile_obstacle(model) is None


def test_a_jump_at_the_smallest_gaps_is_reported_with_the_usable_range() -> None:
    model = magnet("reluctance", alpha=0.0055)
    message = find_compile_obstacle(model)
    assert message is not None
    assert "it jumps at a gap of 0.0003 to 0.000337 m" in message
    assert "limit the gap in the model's [valid]" in message
    assert model.valid is not None
    beyond = replace(model.valid, schedule=(0.00036, GAPS[-1]))
    assert find_compile_obstacle(replace(model, valid=beyond)) is None


def test_other_obstacles_to_compiling_are_reported_with_the_option_that_helps() -> None:
    assert "--gap-map scaling or reluctance" in str(find_compile_obstacle(magnet("free")))
    late = magnet("none", gamma=0.5)
    assert (
        find_compile_obstacle(late)
        == find_compile_obstacle(late.at_rest)
        == find_compile_obstacle(magnet("none"))
    )
    layered = replace(late, layers=Layers(3, 0.1))  # not available for a Jiles-Atherton law
    assert "at_rest" in str(find_compile_obstacle(layered))
    old = replace(magnet("none"), law="jiles-atherton-1986")
    assert "--law effective-field" in str(find_compile_obstacle(old))


def test_a_jump_of_a_closed_core_is_reported() -> None:
    model = replace(magnet("none", alpha=0.01), valid=ValidRange((0.0, 2.0), (0.0, 200.0)))
    assert "predict and invert follow the jumps" in str(find_compile_obstacle(model))
