"""The end of a job: reports a failure, and leaves machine and folder in order whatever happened."""

from __future__ import annotations

from collections.abc import Callable

from ..model.goal import Code, JobError
from ..model.records import State
from ..model.verdict import Verdict
from ..store import forecasts
from .context import JobContext

CLASS_OF = {  # of the anomaly that a failure leaves when nothing else has said what happened
    Code.MACHINE_NOT_READY: 'link',
    Code.PLAN_FAILED: 'height',
    Code.BAD_RESUME: 'height',
    Code.SCAN_FAILED: 'scan',
    Code.LINK_LOST: 'link',
    Code.TIMEOUT: 'link',
}


def fail(context: JobContext, error: JobError) -> None:
    """Code and text of the error become the job's last status, and an anomaly when there was none."""
    journal = context.journal
    journal.status.error_code = int(error.code)
    aborted = error.code == Code.ABORTED
    if aborted:
        journal.note('WARNING', 'operator', str(error), 'arc ended, queue dropped')
    elif not journal.faulted:
        journal.note('FAULT', CLASS_OF.get(error.code, 'node'), str(error), 'job ended')
    # told before it is written: a full disk changes nothing of that
    _try(context, lambda: journal.state(State.ABORTED if aborted else State.FAILED, str(error)))


def release(context: JobContext, verdict: Verdict) -> None:
    """Leaves machine and folder in order. What cannot be done is noted, not raised, and keeps nothing else from it."""
    cell = context.cell
    if context.status.state != State.DONE:
        _try(context, lambda: cell.command('STOP'))
    _try(context, lambda: cell.command('DISARM'))
    _try(context, lambda: cell.record(False, context.record_folder))
    context.note_remarks()
    _try(context, lambda: _look_for_forecast(context))
    _try(context, lambda: context.journal.report(verdict))


def _look_for_forecast(context: JobContext) -> None:
    if context.program.whole is not None and not context.journal.folder.passing:
        found, why = forecasts.find(context.checked, context.program.whole.volume)
        context.journal.forecast = found
        if why:
            context.journal.note('INFO', 'height', why, 'the report shows none')


def _try(context: JobContext, step: Callable[[], object]) -> None:
    try:
        step()
    except (JobError, OSError) as e:
        context.journal.note('WARNING', 'link', f'at the end of the job: {e}', 'none')
