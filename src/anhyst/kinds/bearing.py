"""A bearing: an armature that a position controller levitates between end stops."""

from anhyst.kinds.rig_kind import RigKind

BEARING = RigKind(
    word="levitation",
    title="a bearing",
    plural="bearings",
    verbs=("export", "simulate", "calibrate", "tune", "excite", "live"),
    places={
        "read": "anhyst.rig.body:read_bearing",
        "files": "anhyst.study.bearing.operating:files_of_bearing",
        "simulate": "anhyst.reports.bearing.study:simulate",
        "run_board": "anhyst.reports.bearing.study:run_firmware",
        "printed": "anhyst.reports.bearing.subject:printed",
        "written": "anhyst.reports.study.task:files_written",
        "plants": "anhyst.study.plants:read_bearing_plants",
        "benefit": "anhyst.reports.benefit:map_bearing",
        "tuning": "anhyst.study.tuning.tuning:BearingSubject",
        "specimen": "anhyst.study.excite.excite:read_bearing_specimen",
        "motion_laws": "anhyst.study.tracking.calibrate:bearing_laws",
        "prepare": "anhyst.study.bench:prepare_bearing",
        "part": "anhyst.exchange.bearing_part:bearing_part",
    },
    options={
        "simulate": ("--controller", "--board"),
        "live": ("--controller",),
        "calibrate": ("--controller",),
        "tune": ("--controller", "--overshoot", "--settling", "--standstill", "--effort"),
    },
    reasons={
        "force-control": "its armature flies, and here one is held",
        "compile": "compile its model, with --controller for the whole controller",
    },
)
