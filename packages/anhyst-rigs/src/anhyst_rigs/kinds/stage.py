"""A stage: a body between magnets that follows a set-point in one to six coordinates."""

from anhyst_rigs.kinds.rig_kind import RigKind

STAGE = RigKind(
    word="tracking",
    title="a stage",
    plural="stages",
    verbs=("compile", "export", "simulate", "calibrate", "tune", "excite", "live"),
    places={
        "read": "anhyst_rigs.rig.stage.file:read_stage",
        "files": "anhyst_rigs.rig.stage.file:files_of_stage",
        "simulate": "anhyst_rigs.reports.tracking:simulate",
        "printed": "anhyst_rigs.reports.tracking:terminal_summary",
        "written": "anhyst_rigs.reports.study.task:files_written",
        "plants": "anhyst_rigs.study.plants:read_stage_plants",
        "benefit": "anhyst_rigs.reports.benefit:map_plants",
        "with_iron": "anhyst_rigs.study.benefit:stage_with_iron",
        "tuning": "anhyst_rigs.study.tuning.tuning:StageSubject",
        "specimen": "anhyst_rigs.study.excite.excite:read_stage_specimen",
        "motion_laws": "anhyst_rigs.study.tracking.calibrate:stage_laws",
        "prepare": "anhyst_rigs.study.bench:prepare_stage",
        "compile_controller": "anhyst_rigs.study.tracking.compiled:compile_stage",
    },
    options={
        "excite": ("--calibrate", "--response"),
        "tune": (*("--average", "--crossover", "--error", "--settling", "--standstill", "--effort"),),
    },
    reasons={"force-control": "its body moves, and force control needs a fixed armature"},
)
