"""A rig of force control: a held armature whose force is commanded, open loop."""

from anhyst.kinds.rig_kind import RigKind

FORCE = RigKind(
    word="force",
    title="a rig of force control",
    plural="rigs of force control",
    verbs=("export", "simulate", "force-control", "excite", "live"),
    places={
        "read": "anhyst.rig.force.file:read_rig",
        "files": "anhyst.rig.force.file:files_of_rig",
        "simulate": "anhyst.reports.force:simulate",
        "run_board": "anhyst.reports.force:run_firmware",
        "printed": "anhyst.reports.force:printed",
        "written": "anhyst.reports.force:written",
        "plants": "anhyst.study.plants:read_force_plants",
        "benefit": "anhyst.reports.force:map_benefit",
        "with_iron": "anhyst.study.benefit:force_with_iron",
        "specimen": "anhyst.study.excite.excite:read_force_specimen",
        "prepare": "anhyst.study.bench:prepare_force",
        "part": "anhyst.exchange.force_part:force_part",
    },
    options={"simulate": ("--board",)},
    reasons={
        "tune": "its force is controlled open loop, so there are no gains to find",
        "calibrate": "its armature is held, so there is no motion to learn from",
    },
)
