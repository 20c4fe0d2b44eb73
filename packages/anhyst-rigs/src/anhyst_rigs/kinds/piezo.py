"""A piezo stage: a stack follows a displacement, controlled by feedforward and an integrator."""

from anhyst_rigs.kinds.rig_kind import RigKind

PIEZO = RigKind(
    word="displacement",
    title="a piezo stage",
    plural="piezo stages",
    verbs=("export", "simulate", "tune", "excite", "live"),
    places={
        "read": "anhyst_rigs.rig.piezo:read_piezo_rig",
        "files": "anhyst_rigs.rig.piezo:files_of_piezo",
        "simulate": "anhyst_rigs.reports.piezo:simulate",
        "printed": "anhyst_rigs.reports.piezo:terminal_summary",
        "written": "anhyst_rigs.reports.piezo:written_files",
        "plants": "anhyst_rigs.study.plants:read_piezo_plants",
        "benefit": "anhyst_rigs.reports.benefit:map_plants",
        "with_iron": "anhyst_rigs.study.benefit:piezo_with_iron",
        "tuning": "anhyst_rigs.study.tuning.tuning:PiezoSubject",
        "specimen": "anhyst_rigs.study.excite.excite:read_stack_specimen",
        "prepare": "anhyst_rigs.study.bench:prepare_piezo",
    },
    options={"tune": ("--error",)},
    reasons={
        "calibrate": "it has no magnets, whose errors could be estimated from motion",
        "force-control": "a stack is driven to a displacement, not to a force",
    },
)
