"""Compare the picture of a body with several coordinates in a real browser with its data rows."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from anhyst_rigs.rig.bench.stage import StageBench
from anhyst_rigs.rig.body import BodyRig
from anhyst_rigs.rig.stage.file import read_stage
from anhyst_rigs.rig.stage.fitted import make_stage
from anhyst_rigs.rig.stage.geometry import magnet_rows
from anhyst_rigs.rig.stage.loop import StageSetup
from tests.live.conftest import Serve, Show, wait_for
from tests.live.test_page import last, press, ready, seen, state_is, until
from tests.study import bearings
from tests.study.test_axes import planar, three_magnets

pytestmark = [pytest.mark.needs("chromium"), pytest.mark.slow]


def setups(rig: BodyRig) -> list[StageSetup]:
    return [make_stage(rig, bearings.knowledge(), name) for name in ("single-valued", "full")]


def test_the_body_is_drawn_at_its_pose_and_rotated_by_mouse_and_keys(serve: Serve, show: Show) -> None:
    page = show(serve(bench=StageBench(setups(planar()))))
    ready(page)
    state_is(page, "ready")
    page.keyboard.press("0")
    press(page, "run")
    state_is(page, "run")
    page.wait_for_timeout(300)
    page.locator("#pause").click()
    until(page, "document.getElementById('pause').textContent === 'Continue'")
    page.wait_for_timeout(300)
    errors = [last(page, f"error_{axis}") for axis in ("x", "y", "z", "rx", "ry", "rz")]
    assert np.ravel(seen(page, "page.views.get('body').pose()")) == pytest.approx(
        [-error for error in errors]
    )
    page.select_option("#pose", "gap")
    gaps = [last(page, name) for name in ("gap", *(f"gap_{number}" for number in range(2, 11)))]
    pose = np.ravel(seen(page, "page.views.get('body').pose()"))
    assert -magnet_rows(planar().settings) @ pose == pytest.approx(np.array(gaps) - 0.45e-3, abs=1e-10)
    # the title states the exaggeration, which is automatic or set by the user
    until(page, "document.querySelector('#body canvas')?.title?.startsWith('position in the gaps × ')")
    factor = seen(page, "page.views.get('body').factor")
    assert 0.03 < factor * np.abs(pose).max() / 0.3 < 0.2
    page.select_option("#exaggerated", "1000")
    until(page, "document.querySelector('#body canvas')?.title?.includes('× 1\u202f000')")
    # the table shows the values of the row
    cell = page.locator("#body [data-signal=pull_7] span").first
    assert float(cell.inner_text().split()[0]) == pytest.approx(last(page, "pull_7"), rel=1e-3)
    canvas = page.locator("#body canvas")
    before = seen(page, "({ ...page.views.get('body').space.view })")
    canvas.focus()
    page.keyboard.press("ArrowLeft")
    page.keyboard.press("ArrowUp")
    keyed = seen(page, "({ ...page.views.get('body').space.view })")
    assert keyed["round"] > before["round"]
    assert keyed["up"] > before["up"]
    canvas.hover()
    page.mouse.down()
    page.mouse.move(500, 300, steps=3)
    page.mouse.up()
    assert seen(page, "page.views.get('body').space.view.round") != keyed["round"]
    page.keyboard.press("Home")
    assert seen(page, "({ ...page.views.get('body').space.view })") == before
    with page.expect_download() as saved:
        page.locator("#csv").click()
    heads = saved.value.path().read_text().splitlines()[0].split(",")
    assert heads[:4] == ["t_s", "demand_x_N", "wrench_x_N", "error_x_m"]
    assert "pull_10_N" in heads


def test_buttons_land_and_lift_a_body_and_cycles_pause_meanwhile(serve: Serve, show: Show) -> None:
    page = show(serve(bench=StageBench(setups(planar()))))
    ready(page)
    state_is(page, "ready")
    assert page.locator(".commands button[data-order=lift]").is_disabled()
    press(page, "land")
    state_is(page, "idle")
    until(page, "document.body.innerText.includes('Press Lift, then Run')")
    assert page.locator(".commands button[data-order=run]").is_disabled()
    assert last(page, "error_z") > 0.09e-3
    page.keyboard.press("0")
    page.select_option("#pose", "gap")
    page.wait_for_timeout(300)
    assert np.ravel(seen(page, "page.views.get('body').pose()"))[2] < -0.09e-3
    press(page, "lift")
    state_is(page, "ready")
    assert last(page, "lap") == 0.0
    press(page, "run")
    state_is(page, "run")
    press(page, "idle")
    state_is(page, "idle")


def test_another_layout_is_drawn_from_its_file_and_pushed_along_a_coordinate(
    serve: Serve, show: Show, tmp_path: Path
) -> None:
    served = serve(bench=StageBench(setups(read_stage(three_magnets(tmp_path)))))
    page = show(served)
    ready(page)
    page.keyboard.press("0")
    until(page, "document.querySelector('#body canvas')?.title?.includes('error')")
    assert page.locator("#axes tbody tr").count() == 2
    assert page.locator("#magnets tbody tr").count() == 3
    assert "nan" not in page.locator("#body").inner_text().lower()
    way, turn = seen(page, "page.views.get('body').pose()")
    assert np.any(way[:2])
    assert [way[2], *turn] == [0.0] * 4
    # a push along a coordinate acts on that coordinate
    page.select_option("#push-axis", "push_y")
    page.locator("#push").focus()
    page.keyboard.press("End")
    largest = {parameter.name: parameter.high for parameter in served.session.parameters}["push_y"]
    wait_for(
        lambda: (
            {parameter.name: parameter.value for parameter in served.session.parameters}["push_y"] == largest
        )
    )
    until(page, "window.anhyst.views.get('body').figures.axes[1][1][2].peak > 1e-7")
