"""A force rig as a component: the plant of ``anhyst force-control`` and its compiled compensator."""

from __future__ import annotations

from anhyst.support.atomic import PathLike
from anhyst_exchange.bearing_part import fields, magnet_text, plant_sources, volumes_of
from anhyst_exchange.part import CORE_OF_LAWS, Part, Variable, compensator_part, header
from anhyst_rigs.rig.force.file import READ, Rig, read_rig
from anhyst_rigs.rig.force.programs import find_model, loops_of_rig
from anhyst_rigs.rig.from_loops import complete_rig
from anhyst_rigs.rig.parts.magnet import circuit_numbers

_UNITS = {"gap": "m", "force": "N", "current": "A"}


def force_part(rig_path: PathLike) -> Part:
    """Return an actuator with its compensator: demand, gap and noise in; command, current, force out.

    It ticks at the rate of the controller, from demagnetised iron on.
    """
    rig = read_rig(rig_path)
    loops = loops_of_rig(rig)
    rig = complete_rig(rig, loops)
    rate = rig.settings.timing.rate_Hz
    compensator = compensator_part(find_model(rig, loops), rate, "full")
    others = "axes|piezo|position|body|loop|controller"
    sources = plant_sources(others, CORE_OF_LAWS, ["force.c"]) | dict(compensator.sources)
    # One component within another, which is the part of the FMU.
    renamed = b"#define anhyst_the_part anhyst_compensator_part\n"
    sources["compensator_numbers.h"] = renamed + sources["compensator_numbers.h"]
    demand, *gaps = compensator.named("input")
    sources["force_numbers.h"] = _numbers(rig, gaps).encode()
    title = rig.settings.name
    text = f"{title}, its force controlled by {compensator.text.partition(': ')[2]}"
    return Part(title, text, rate, _variables(rig, demand, gaps), sources)


def _numbers(rig: Rig, gaps: list[Variable]) -> str:
    """Return the plant as structures, and what the compensator gets of the gap."""
    solid = None
    if (file := rig.solenoid_file) is not None:
        circuit, cone = file.circuit.numbers(file.iron), file.circuit.cone()
        magnet, text = magnet_text(file.iron, circuit, None, cone)
    else:
        table = rig.settings.magnet
        solid = table.solid_iron
        magnet, text = magnet_text(
            rig.settings.steel, circuit_numbers(table.poles, 0.0, 1e-3), solid
        )
    sensors = rig.sensor_numbers(rig.dt)
    held = {
        "magnet": magnet,
        **rig.held_numbers(),
        "sensor": [{**sensors[name]} for name in READ],
    }
    text = (
        f'#include "anhyst_plant/held.h"\n\n{text}'
        f"static const anhyst_plant_held force_held = {fields(held)};\n\n"
    )
    ends = (gaps[0].low, gaps[0].high) if gaps else (0.0, 1.0)
    defined = {
        "FORCE_VOLUMES": volumes_of(solid),
        "FORCE_HAS_GAP": len(gaps),
        "FORCE_GAP_LOW": ends[0],
        "FORCE_GAP_HIGH": ends[1],
    }
    return header("force_numbers", defined, text)


def _variables(rig: Rig, demand: Variable, gaps: list[Variable]) -> list[Variable]:
    """Return what goes in and comes out, by the names of recordings."""
    where = "true gap, to which the armature is moved"
    ends = (gaps[0].low, gaps[0].high) if gaps else (None, None)
    noise = "added to what the sensor reads"
    said = "as its sensor said at the tick"
    return [
        Variable("demand_N", "input", "N", "wanted force", 0.0, demand.low, demand.high),
        Variable("gap_m", "input", "m", where, rig.settings.force.end_m, *ends),
        *(Variable(f"{name}_noise_{_UNITS[name]}", "input", _UNITS[name], noise) for name in READ),
        Variable("command_A", "output", "A", "current that is asked for from the next tick on"),
        Variable("current_A", "output", "A", "current at the tick"),
        Variable("force_N", "output", "N", "true force at the tick"),
        *(Variable(f"{name}_read_{_UNITS[name]}", "output", _UNITS[name], said) for name in READ),
    ]
