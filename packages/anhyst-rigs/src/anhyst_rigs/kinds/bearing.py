"""A bearing: a position controller levitates an armature between end stops."""

from anhyst_rigs.kinds.rig_kind import RigKind

BEARING = RigKind(
    word="levitation",
    title="a bearing",
    plural="bearings",
    verbs=("export", "simulate", "calibrate", "tune", "excite", "live"),
    places={
        "read": "anhyst_rigs.rig.body:read_bearing",
        "files": "anhyst_rigs.study.bearing.inputs:list_bearing_files",
        "simulate": "anhyst_rigs.reports.bearing.study:simulate",
        "run_board": "anhyst_rigs.reports.bearing.study:run_firmware",
        "printed": "anhyst_rigs.reports.bearing.subject:terminal_summary",
        "written": "anhyst_rigs.reports.study.task:files_written",
        "plants": "anhyst_rigs.study.plants:read_bearing_plants",
        "benefit": "anhyst_rigs.reports.benefit:map_bearing",
        "tuning": "anhyst_rigs.study.tuning.tuning:BearingSubject",
        "specimen": "anhyst_rigs.study.excite.excite:read_bearing_specimen",
        "motion_laws": "anhyst_rigs.study.tracking.calibrate:bearing_laws",
        "prepare": "anhyst_rigs.study.bench:prepare_bearing",
    },
    options={
        "simulate": ("--controller", "--board"),
        "excite": ("--response",),
        "live": ("--controller",),
        "calibrate": ("--controller",),
        "tune": ("--controller", "--overshoot", "--settling", "--standstill", "--effort"),
    },
    reasons={
        "force-control": "its armature is levitated, and force control needs a fixed armature",
        "compile": "compile its model, with --controller for the complete controller",
    },
)
