"""A piezo stage: a stack follows a displacement, with an integrator beside the feedforward."""

from anhyst.kinds.rig_kind import RigKind

PIEZO = RigKind(
    word="displacement",
    title="a piezo stage",
    plural="piezo stages",
    verbs=("export", "simulate", "tune", "excite", "live"),
    places={
        "read": "anhyst.rig.piezo:read_piezo_rig",
        "files": "anhyst.rig.piezo:files_of_piezo",
        "simulate": "anhyst.reports.piezo:simulate",
        "printed": "anhyst.reports.piezo:printed",
        "written": "anhyst.reports.piezo:written",
        "plants": "anhyst.study.plants:read_piezo_plants",
        "benefit": "anhyst.reports.benefit:map_plants",
        "with_iron": "anhyst.study.benefit:piezo_with_iron",
        "tuning": "anhyst.study.tuning.tuning:PiezoSubject",
        "specimen": "anhyst.study.excite.excite:read_stack_specimen",
        "prepare": "anhyst.study.bench:prepare_piezo",
        "part": "anhyst.exchange.piezo_part:piezo_part",
    },
    options={"tune": ("--error",)},
    reasons={
        "calibrate": "it has no magnets, whose errors are what motion teaches",
        "force-control": "a stack is driven to a displacement, not to a force",
    },
)
