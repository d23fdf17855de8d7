"""The verdict over the whole region, from the last scan."""

from __future__ import annotations

import numpy as np

from waam_plan import finish
from waam_plan.plan import Plan

from ..model.cell import Scan
from ..model.overrun import overrun
from ..model.program import deviation_of
from ..model.records import LayerRecord
from ..model.shaft import figures
from ..model.stock import counted_area, stock_of
from ..model.verdict import Verdict
from ..store import stock_files, tolerance_map
from .context import JobContext


def judge(context: JobContext, scan: Scan) -> Verdict:
    """Judges by the region and the surface of the first plan, however many passes there were, and keeps the map."""
    first, goal, journal = context.program.first, context.goal, context.journal
    target = context.program.final_target
    journal.scan(context.program.layers[-1].number, scan, first, target)
    wanted = np.isfinite(target)
    counts = tolerance_map.write(
        journal.folder.path,
        scan.map.spec,
        scan.map.z - target,
        region=first.region & wanted,
        interior=first.interior & wanted,
        tolerance=goal.tolerance,
    )
    machined = first.settings.finish == finish.MACHINED
    if machined:
        stock_files.write(journal.folder.path, first, scan.map.z)
    verdict = Verdict(
        share_wanted=context.settings.share_in_tolerance,
        tolerance=goal.tolerance,
        final=deviation_of(first, scan.map.z, target, goal.tolerance),
        as_found_rms=deviation_of(first, first.as_found.z, target, goal.tolerance).rms,
        tolerance_map=counts,
        overrun=overrun(
            first.as_found.z,
            scan.map.z,
            np.isfinite(first.nominal.z),
            first.region & wanted,
            first.spec.resolution,
        ),
        stock=stock_of(first, scan.map.z) if machined else None,
        unlaid=_unlaid(first) if first.mode == 'restore' else None,
        shaft=figures(first, scan.map.z),
    )
    told = [verdict.text] if machined else []
    _report_last_layer(context, scan, (scan.map.z - target)[first.interior], told)
    return verdict


def _unlaid(first: Plan) -> finish.Unlaid:
    missing = first.nominal.z - first.as_found.z
    return finish.unlaid(counted_area(first), first.region, missing, first.spec)


def _report_last_layer(
    context: JobContext, scan: Scan, errors: np.ndarray, told: list[str]
) -> None:
    """The layer report of the final surface; errors: of the judged area, m; told: remarks."""
    program, journal = context.program, context.journal
    record = LayerRecord(
        job_id=context.run_id,
        loop_mode=context.goal.loop_mode,
        layer=program.layers[-1].number,
        pass_number=program.pass_number,
        final=True,
        temperature=context.cell.heat().temperature,
    )
    record.reasons += told
    record.add_errors(errors)
    record.add_scan(scan)
    journal.layer(record)
    journal.status.progress, journal.status.time_left = 1.0, 0.0
