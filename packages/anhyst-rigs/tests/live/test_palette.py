"""Test that the live page has the colours of the figures."""

from __future__ import annotations

import re

from anhyst.support.figures import ALARM_COLOUR, PALETTE
from anhyst_rigs.dashboard.connections import ASSETS_FOLDER

HEX = r"#[0-9a-f]{6}\b"


def test_lines_have_the_colours_of_the_figures() -> None:
    source = (ASSETS_FOLDER / "colours.js").read_text()
    assert re.findall(HEX, source) == [colour.lower() for colour in PALETTE.values()]


def test_no_other_script_defines_a_colour() -> None:
    scripts = [path for path in ASSETS_FOLDER.glob("*.js") if path.name != "colours.js"]
    assert len(scripts) > 20
    assert [path.name for path in scripts if re.search(f'"{HEX}"', path.read_text(), re.IGNORECASE)] == []


def test_themes_have_the_blue_and_the_alarm_colour_of_the_figures() -> None:
    light, dark = re.findall(rf"--blue: ({HEX});", (ASSETS_FOLDER / "live.css").read_text())
    assert (light, dark) == (PALETTE["blue"].lower(), PALETTE["light blue"].lower())
    alarm = re.search(rf"--bad: ({HEX});", (ASSETS_FOLDER / "live.css").read_text())
    assert alarm is not None
    assert alarm[1] == ALARM_COLOUR.lower()
