"""The a-posteriori table of a job of several passes (source 004), and how often the job was resumed."""

from __future__ import annotations

from .html import fmt, table
from .job_data import Job, number

_COLUMNS = (
    ('set height, mm', 'set_height'), ('corrected height, mm', 'corrected_height'),
    ('measured error (RMS), mm', 'measured_rms'), ('measured error (mean), mm', 'measured_mean'),
)  # fmt: skip


def passes_section(job: Job) -> str:
    """'' for a job of one pass that was never interrupted."""
    passes = [p for p in job.run.get('passes') or [] if isinstance(p, dict)]
    runs = job.run.get('runs') or 1
    out = []
    if len(passes) > 1:
        rows = [
            [p.get('pass_number'), p.get('layers'), *(_mm(p, key) for _, key in _COLUMNS)]
            for p in passes
        ]
        head = ['pass', 'layers', *(title for title, _ in _COLUMNS)]
        out += [
            '<h2>Passes</h2>',
            table(head, rows, set()),
            '<p class=soft>Each pass after the first was planned anew from the scan before it: its corrected height is '
            'the set height, which the plan before had left for it, with what that scan found missing there. '
            'The measured error of the last pass is the final one.</p>',
        ]
        if job.run.get('stock') and any(p.get('set_height') is None for p in passes[1:]):
            out.append(
                '<p class=soft>Passes without a set height are top-ups: after the last scan the part did not clean '
                'up, and what was below nominal got one more.</p>'
            )
    if isinstance(runs, int) and runs > 1:
        again = runs - 1
        times = 'once' if again == 1 else f'{again} times'
        out.append(f'<p>The job was interrupted and resumed {times}; see the anomalies.</p>')
    return '\n'.join(out)


def _mm(record: dict, key: str) -> str:
    return fmt(number(record.get(key)) * 1e3, 3)
