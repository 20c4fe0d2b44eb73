"""From the map of what compensation gains to what its report is about."""

from __future__ import annotations

import hashlib
import math

from anhyst.control.controller_file import ControllerFile
from anhyst.reports.bearing.over_runs import BenefitCell
from anhyst.reports.bearing.subject import SimulationSubject
from anhyst.rig.bearing.file import BearingRig
from anhyst.study.bearing.benefit import MEASURES, Benefit, Comparison, MapCell, Measure
from anhyst.support.page.blocks import Note, PageTable, table
from anhyst.support.page.numbers import NBSP, NOT_KNOWN, number

STRONGEST = "the strongest baseline"
_TITLES: dict[Measure, str] = {
    "overshoot_percent": "overshoot",
    "settling_in_noise_s": "settling time",
}


def subject_of_benefit(
    rig: BearingRig, controller: ControllerFile, benefit_map: Benefit, command: str
) -> SimulationSubject:
    """Gather what the report of the map shows."""
    settings = controller.settings
    compensation = settings.compensation.model_copy(update={"variant": "full"})
    return SimulationSubject(
        rig=rig,
        controller=settings.model_copy(update={"compensation": compensation}),
        seeds=benefit_map.seeds,
        benefit=tuple(_cells(benefit_map)),
        blocks={"benefit": (_irons(benefit_map),)},
        notes=(
            Note(
                "info",
                "What is compared",
                f"Every iron is measured and identified again, all variants are fitted to the same "
                f"loops and run with the same gains, {benefit_map.seeds} noise seeds each. “{STRONGEST}” "
                "is, cell by cell, the best of ratio, linearised and single-valued, which know no "
                "hysteresis: chance favours it a little. flux, where there is a Hall probe, stands "
                "beside them: it needs no model, as it measures the flux density.",
            ),
        ),
        files={
            path.name: hashlib.sha256(path.read_bytes()).hexdigest()
            for path in (rig.path, controller.path)
        },
        command=command,
    )


def _cells(benefit_map: Benefit) -> list[BenefitCell]:
    return [
        _cell(benefit_map, cell, measure, against, comparison)
        for measure in MEASURES
        for cell in benefit_map.cells
        for against, comparisons in (
            ("ratio", cell.ratio),
            (STRONGEST, cell.strongest),
            ("flux", cell.flux),
        )
        if comparisons
        for comparison in (comparisons[measure],)
    ]


def _cell(
    benefit_map: Benefit, cell: MapCell, measure: Measure, against: str, comparison: Comparison
) -> BenefitCell:
    quotient = comparison.quotient
    return BenefitCell(
        measure=_TITLES[measure],
        against=against,
        baseline=comparison.baseline or "",
        loop_width=benefit_map.row_width(cell.iron.scale),
        reversible=cell.iron.reversible_fraction,
        pathological=cell.iron.label == "pathological",
        height=cell.height,
        ratio=math.nan if quotient is None else quotient.value,
        outcome=comparison.outcome,
    )


def _irons(benefit_map: Benefit) -> PageTable:
    """Describe every iron by what loops show of it."""
    rows = [
        [
            number(iron.scale, short=True),
            NOT_KNOWN
            if iron.reversible_fraction is None
            else number(iron.reversible_fraction, short=True),
            f"{number(100.0 * iron.loop_width)}{NBSP}%",
            NOT_KNOWN if iron.after_reversal is None else number(iron.after_reversal, 2),
            number(iron.after_reversal_true, 2),
            iron.label,
        ]
        for iron in dict.fromkeys(cell.iron for cell in benefit_map.cells)
    ]
    return table(
        "Irons",
        (
            "pinning, times",
            "reversible fraction",
            "loop width",
            "slope after reversal, from loops",
            "true",
            "label",
        ),
        rows,
        "Loop width: of the largest current. Slope just after a reversal over the static slope: "
        "below a quarter an iron is pathological.",
        texts=0,
    )
