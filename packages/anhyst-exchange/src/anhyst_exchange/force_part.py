"""A rig for force control as a component: its plant and its compiled compensator."""

from __future__ import annotations

from anhyst.support.atomic import PathLike
from anhyst_exchange.bearing_part import c_initialiser, magnet_definition, plant_sources, volume_count
from anhyst_exchange.part import LAW_CORE_FILES, Part, Variable, compensator_part, header_text
from anhyst_rigs.rig.force.file import SENSOR_ORDER, ForceControlRig, read_rig
from anhyst_rigs.rig.force.programs import identify_force_model, read_rig_loops
from anhyst_rigs.rig.from_loops import complete_rig
from anhyst_rigs.rig.parts.magnet import circuit_parameters

_SENSOR_UNITS = {"gap": "m", "force": "N", "current": "A"}


def force_part(rig_path: PathLike) -> Part:
    """Return an actuator with its compensator as a component.

    The inputs are the demand, the gap and the noise; the outputs are the command, the current and
    the force. The component runs at the rate of the controller and starts with demagnetised iron.
    """
    rig = read_rig(rig_path)
    loops = read_rig_loops(rig)
    rig = complete_rig(rig, loops)
    rate = rig.settings.timing.rate_Hz
    compensator = compensator_part(identify_force_model(rig, loops), rate, "full")
    excluded_pattern = "axes|piezo|position|body|loop|controller"
    sources = plant_sources(excluded_pattern, LAW_CORE_FILES, ["force.c"]) | dict(compensator.sources)
    # The compensator is a component inside the component of the FMU.
    rename_macro = b"#define anhyst_the_part anhyst_compensator_part\n"
    sources["compensator_numbers.h"] = rename_macro + sources["compensator_numbers.h"]
    demand, *gaps = compensator.variables_with_causality("input")
    sources["force_numbers.h"] = _force_header(rig, gaps).encode()
    title = rig.settings.name
    text = f"{title}, its force controlled by {compensator.text.partition(': ')[2]}"
    return Part(title, text, rate, _force_variables(rig, demand, gaps), sources)


def _force_header(rig: ForceControlRig, gaps: list[Variable]) -> str:
    """Return the header with the parameters of the plant and the gap range of the compensator."""
    solid = None
    if (file := rig.solenoid_file) is not None:
        solenoid = file.circuit.circuit_parameters(file.iron)
        magnet, text = magnet_definition(file.iron, solenoid, None, file.circuit.cone_parameters())
    else:
        table = rig.settings.magnet
        solid = table.solid_iron
        circuit, cone = circuit_parameters(table.poles, 0.0, 1e-3), table.poles.cone_parameters()
        magnet, text = magnet_definition(rig.settings.steel, circuit, solid, cone)
    sensors = rig.sensor_parameters(rig.dt)
    plant_values = {
        "magnet": magnet,
        **rig.amplifier_parameters(),
        "sensor": [{**sensors[name]} for name in SENSOR_ORDER],
    }
    text = (
        f'#include "anhyst_plant/held.h"\n\n{text}'
        f"static const anhyst_plant_held force_held = {c_initialiser(plant_values)};\n\n"
    )
    gap_range = (gaps[0].low, gaps[0].high) if gaps else (0.0, 1.0)
    macros = {
        "FORCE_VOLUMES": volume_count(solid),
        "FORCE_HAS_GAP": len(gaps),
        "FORCE_GAP_LOW": gap_range[0],
        "FORCE_GAP_HIGH": gap_range[1],
    }
    return header_text("force_numbers", macros, text)


def _force_variables(rig: ForceControlRig, demand: Variable, gaps: list[Variable]) -> list[Variable]:
    """Return the inputs and outputs, with the names of recordings."""
    gap_text = "true gap; the armature is moved there"
    gap_range = (gaps[0].low, gaps[0].high) if gaps else (None, None)
    noise_text = "noise that is added to the reading of the sensor"
    reading_text = "reading of its sensor at the tick"
    return [
        Variable("demand_N", "input", "N", "demanded force", 0.0, demand.low, demand.high),
        Variable("gap_m", "input", "m", gap_text, rig.settings.force.end_m, *gap_range),
        *(
            Variable(f"{name}_noise_{_SENSOR_UNITS[name]}", "input", _SENSOR_UNITS[name], noise_text)
            for name in SENSOR_ORDER
        ),
        Variable("command_A", "output", "A", "current reference from the next tick on"),
        Variable("current_A", "output", "A", "current at the tick"),
        Variable("force_N", "output", "N", "true force at the tick"),
        *(
            Variable(f"{name}_read_{_SENSOR_UNITS[name]}", "output", _SENSOR_UNITS[name], reading_text)
            for name in SENSOR_ORDER
        ),
    ]
