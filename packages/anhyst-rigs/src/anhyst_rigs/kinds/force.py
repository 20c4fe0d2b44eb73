"""A rig for force control: the force on a held armature is controlled in open loop."""

from anhyst_rigs.kinds.rig_kind import RigKind

FORCE = RigKind(
    word="force",
    title="a rig of force control",
    plural="rigs of force control",
    verbs=("export", "simulate", "force-control", "excite", "live"),
    places={
        "read": "anhyst_rigs.rig.force.file:read_rig",
        "files": "anhyst_rigs.rig.force.file:files_of_rig",
        "simulate": "anhyst_rigs.reports.force:simulate",
        "run_board": "anhyst_rigs.reports.force:run_firmware",
        "printed": "anhyst_rigs.reports.force:terminal_summary",
        "written": "anhyst_rigs.reports.force:written_files",
        "plants": "anhyst_rigs.study.plants:read_force_plants",
        "benefit": "anhyst_rigs.reports.force:map_benefit",
        "with_iron": "anhyst_rigs.study.benefit:force_with_iron",
        "specimen": "anhyst_rigs.study.excite.excite:read_force_specimen",
        "prepare": "anhyst_rigs.study.bench:prepare_force",
    },
    options={"simulate": ("--board",)},
    reasons={
        "tune": "the force is controlled in open loop, so there are no gains to tune",
        "calibrate": "the armature is fixed, so there is no motion from which errors could be estimated",
    },
)
