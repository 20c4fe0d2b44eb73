"""A stage: a body between magnets, free in one to six coordinates, that follows a set-point."""

from anhyst.kinds.rig_kind import RigKind

STAGE = RigKind(
    word="tracking",
    title="a stage",
    plural="stages",
    verbs=("compile", "export", "simulate", "calibrate", "tune", "excite", "live"),
    places={
        "read": "anhyst.rig.stage.file:read_stage",
        "files": "anhyst.rig.stage.file:files_of_stage",
        "simulate": "anhyst.reports.tracking:simulate",
        "printed": "anhyst.reports.tracking:printed",
        "written": "anhyst.reports.study.task:files_written",
        "plants": "anhyst.study.plants:read_stage_plants",
        "benefit": "anhyst.reports.benefit:map_plants",
        "with_iron": "anhyst.study.benefit:stage_with_iron",
        "tuning": "anhyst.study.tuning.tuning:StageSubject",
        "specimen": "anhyst.study.excite.excite:read_stage_specimen",
        "motion_laws": "anhyst.study.tracking.calibrate:stage_laws",
        "prepare": "anhyst.study.bench:prepare_stage",
        "part": "anhyst.exchange.stage_part:stage_part",
        "compile_controller": "anhyst.study.tracking.compiled:compile_stage",
    },
    options={
        "excite": ("--calibrate",),
        "tune": (
            *("--average", "--crossover", "--error", "--settling", "--standstill", "--effort"),
        ),
    },
    reasons={"force-control": "its body moves, and here an armature is held"},
)
