"""Test parameter sets: saved completely, in one folder only, and activated on one tick."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from anhyst_rigs.dashboard.sets import FILE_SUFFIX, ParameterSets, changed_values
from anhyst_rigs.rig.bench.protocol import Parameter
from tests.live.conftest import Serve, Served, Show, wait_for
from tests.live.test_page import labelled, ready, until
from tests.refusals import refused


def parameters(damping: float = 2.5, mass: float = 0.1) -> list[Parameter]:
    return [
        Parameter("damping", "N s/m", 0.0, 10.0, "of the load drive", damping),
        Parameter("mass", "kg", 0.0, 1.0, "", mass),
    ]


def test_a_parameter_set_is_read_bit_for_bit_and_compared(tmp_path: Path) -> None:
    sets = ParameterSets(tmp_path, parameters())
    sets.save("soft 1", parameters(0.1 + 0.2))
    assert sets.names == ParameterSets(tmp_path, parameters()).names == ("soft 1",)
    held = sets.read("soft 1")
    assert held["damping"] == {"value": 0.1 + 0.2, "unit": "N s/m"}
    assert changed_values(parameters(0.3), held) == {"damping": 0.1 + 0.2}
    assert changed_values(parameters(0.1 + 0.2), held) == {}
    assert [one.name for one in tmp_path.iterdir()] == [f"soft 1{FILE_SUFFIX}"]


def test_a_set_is_not_written_over(tmp_path: Path) -> None:
    sets = ParameterSets(tmp_path, parameters())
    sets.save("one", parameters())
    with refused("exists-already"):
        sets.save("one", parameters(1.0))
    assert sets.read("one")["damping"]["value"] == 2.5


@pytest.mark.parametrize("name", ["../one", "a/b", "", ".one", "a\0", "C:\\x", 61 * "a"])
def test_no_other_folder_is_touched(tmp_path: Path, name: str) -> None:
    folder = tmp_path / "work"
    folder.mkdir()
    (tmp_path / f"one{FILE_SUFFIX}").write_text("{}")
    sets = ParameterSets(folder, parameters())
    with refused("bad-name set"):
        sets.save(name, parameters())
    with refused("bad-name set"):
        sets.read(name)
    assert sorted(one.name for one in tmp_path.rglob("*")) == [f"one{FILE_SUFFIX}", "work"]


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("no json", "not-a-parameter-set"),
        ('{"format": "other"}', "not-a-parameter-set"),
        ('{"format": "anhyst-parameters"}', "missing"),
        ('{"format": "anhyst-parameters", "parameters": {"mass": 1}}', "no-value-with-unit"),
        (
            '{"format": "anhyst-parameters", "parameters": {"mass": {"value": NaN, "unit": ""}}}',
            "no-value-with-unit",
        ),
    ],
)
def test_a_file_that_is_no_set_is_refused(tmp_path: Path, text: str, why: str) -> None:
    (tmp_path / f"one{FILE_SUFFIX}").write_text(text)
    with refused(why):
        ParameterSets(tmp_path, parameters()).read("one")


def test_a_set_of_another_bench_is_refused(tmp_path: Path) -> None:
    sets = ParameterSets(tmp_path, parameters())
    sets.save("one", parameters())
    with refused("unknown-parameter: mass"):
        changed_values(parameters()[:1], sets.read("one"))
    assert ParameterSets(tmp_path, parameters()[:1]).names == ()  # another bench does not list it
    with refused("exists-already"):
        ParameterSets(tmp_path, parameters()[:1]).save("one", parameters()[:1])
    other = [parameters()[0], parameters()[1]._replace(unit="g")]
    with refused("units-differ mass: kg; g"):
        changed_values(other, sets.read("one"))


def load_damping(served: Served) -> Parameter:
    return next(parameter for parameter in served.session.parameters if parameter.name == "load_damping")


@pytest.mark.slow
@pytest.mark.needs("chromium")
def test_sets_are_saved_compared_staged_and_rolled_back(serve: Serve, show: Show) -> None:
    served = serve()
    page = show(served)
    ready(page)
    page.keyboard.press("4")
    one = load_damping(served)
    old, new = one.value, 0.5 * one.high
    page.locator("#set-name").fill("before")
    page.locator("#set-save").click()
    until(page, "document.getElementById('set-second').options.length === 2")
    page.get_by_label(labelled(one.name), exact=True).fill(f"{new} {one.unit}")
    page.locator("#apply").click()
    wait_for(lambda: load_damping(served).value == new)
    page.locator("#set-stage").click()
    assert page.locator("#set-note").inner_text() == "choose a saved set as the second"
    page.select_option("#set-second", "before")
    until(page, "document.querySelectorAll('#differences td').length === 3")
    cells = page.locator("#differences td").all_inner_texts()
    assert cells == [f"{value:.5g} {one.unit}" for value in (new, old, old - new)]
    assert page.locator("#differences tr th[scope=row]").inner_text() == labelled(one.name)
    page.locator("#set-stage").click()
    page.get_by_role("button", name="Apply 1 staged").click()
    wait_for(lambda: load_damping(served).value == old)
    page.locator("#log").evaluate("() => document.activeElement.blur()")
    page.keyboard.press("b")
    wait_for(lambda: load_damping(served).value == new)
    path = served.session.recorder.folder / f"before{FILE_SUFFIX}"
    assert json.loads(path.read_text())["parameters"][one.name]["value"] == old
