"""How a job came to its surface, in a few sentences: the layer schedule, the corrections, what the cell had learned."""

from __future__ import annotations

from itertools import pairwise
from typing import Any

from waam_process.loop_mode import LoopMode

from .html import escape
from .job_data import Job, number

DIGEST = 12  # characters of a hash that tell two files apart at a glance


def loop_summary(job: Job) -> str:
    """'' for a run without layers."""
    laid = [x for x in job.layers if not x.get('final')]
    if not laid:
        return ''
    said = [
        *_schedule(job), _corrections(job, laid), _expected(job), _flow(laid), _width(job), _former_jobs(job),
    ]  # fmt: skip
    items = ''.join(f'<li>{escape(text)}</li>' for text in said if text)
    return f'<h2>How it was laid</h2><ul>{items}</ul>'


def _schedule(job: Job) -> list[str]:
    """One sentence per pass."""
    passes = [p for p in job.run.get('passes') or [] if isinstance(p, dict) and p.get('schedule')]
    return [f'Layer schedule{_of_pass(p, passes)}: {p["schedule"]}.' for p in passes]


def _of_pass(record: dict, passes: list[dict]) -> str:
    return f' of pass {record.get("pass_number")}' if len(passes) > 1 else ''


def _corrections(job: Job, laid: list[dict]) -> str:
    if job.loop_mode == LoopMode.OPEN_LOOP:
        return 'Corrections: none; the plan was laid as it was.'
    applied = [x for x in laid if x.get('correction_applied')]
    if not applied:
        return 'Corrections: computed, not applied.'
    laws: dict[str, int] = {}
    for layer in applied:
        law = 'fallback' if layer.get('fallback') else str(layer.get('law') or 'unknown')
        laws[law] = laws.get(law, 0) + 1
    told = ', '.join(f'{n} by {law.replace("_", " ")}' for law, n in laws.items())
    models = _trace(job).get('models') or {}
    named = ', '.join(str(digest)[:DIGEST] for digest in models)
    weights = f' Network weights {named}.' if named else ''
    return f'Corrections: {len(applied)} of {len(laid)} layers: {told}.{weights}'


def _expected(job: Job) -> str:
    """How often the surface had the RMS that was expected before its layer; '' where nothing was expected."""
    inside = [
        number(x.get('expected_rms_low')) <= rms <= number(x.get('expected_rms_high'))
        for x, after in pairwise(job.layers)
        if number(x.get('expected_rms')) > 0 and (rms := number(after.get('height_error_rms'))) > 0
    ]
    if not inside:
        return ''
    return f'Expected RMS: the surface lay in its 90 % interval after {sum(inside)} of {len(inside)} layers.'


def _trace(job: Job) -> dict[str, Any]:
    """Of the run in a report of several, else of the report."""
    return job.run.get('trace') or job.report.get('trace') or {}


def _former_jobs(job: Job) -> str:
    """What the job started with, and what it left; '' for one that neither read nor kept anything."""
    learned = _trace(job).get('learned') or {}
    if 'jobs' not in learned:
        return ''
    count, before = learned['jobs'], str(learned.get('sha256') or '')[:DIGEST]
    plural = '' if count == 1 else 's'
    told = (
        f'{count} job{plural}{f" ({before})" if before else ""}' if count else 'none, started fresh'
    )
    after = str(learned.get('sha256_after') or '')[:DIGEST]
    return f'Learned from former jobs of this cell: {told}.' + (
        f' Kept for the next one: {after}.' if after else ''
    )


def _flow(laid: list[dict]) -> str:
    """What the job learned of its metal."""
    network = any(x.get('law') in ('unet', 'growth_net') for x in laid)  # the latter before 0.3
    source = ', and from the network how layers differ' if network else ''
    flow = [number(x.get('flow_factor')) for x in laid]
    flow = [f for f in flow if f > 0]
    if len(flow) < 2:
        return ''
    return (
        f'Wire: factor for the metal that the cell loses {flow[0]:.3f} at the first layer, '
        f'{flow[-1]:.3f} at the last; learned from the scans{source}.'
    )


def _width(job: Job) -> str:
    """What the scans showed of the bead width, and whether the voltage held it; '' where no bead stood free."""
    seen = [x for x in job.layers if number(x.get('bead_width')) > 0]
    if not seen:
        return ''
    widths = [1e3 * number(x.get('bead_width')) for x in seen]
    span = f'{widths[0]:.2f}' if len(widths) == 1 else f'{min(widths):.2f} to {max(widths):.2f}'
    u = max(1e3 * number(x.get('bead_width_u')) for x in seen)
    held = sum(number(x.get('width_ratio')) > 0 for x in job.layers)
    plural = '' if held == 1 else 's'
    by = f'held by the voltage in {held} layer{plural}' if held else 'constant voltage'
    return f'Bead width: {span} mm where beads stood free (± {u:.2f} mm or less, {len(seen)} scans); {by}.'
