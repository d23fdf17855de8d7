"""What the job can be traced to (report.json, `trace`): people, feedstock, equipment, software, calibration, models."""

from __future__ import annotations

from .html import escape, table
from .job_data import Job, flatten

APART = ('not_told', 'remarks')  # said in words; everything else is a row


def traceability_section(job: Job) -> str:
    """'' for a job of a version that did not trace."""
    trace = job.report.get('trace')
    if not isinstance(trace, dict):
        return ''
    rows = [
        [key, value]
        for key, value in flatten({k: v for k, v in trace.items() if k not in APART})
        if value not in ('', None, 'None', '{}', '[]')
    ]
    out = ['<h2>Traceability</h2>', table(['what', 'value'], rows, {0, 1})]
    missing = [str(name).replace('_', ' ') for name in trace.get('not_told') or []]
    if missing:
        out.append(f'<p><b>Nobody told:</b> {escape(", ".join(missing))}.</p>')
    out += [f'<p class=soft>Remark: {escape(text)}.</p>' for text in trace.get('remarks') or []]
    about = job.run.get('tolerance_map')
    if isinstance(about, dict):
        out.append(
            f'<p>Tolerance map, cell by cell: <span class=mono>{escape(about.get("file"))}</span>; of '
            f'{about.get("cells")} judged cells of {about.get("cell_mm"):g} mm {about.get("in_tolerance")} are within '
            f'tolerance, {about.get("above")} above, {about.get("below")} below, {about.get("unseen")} not seen.</p>'
        )
    return '\n'.join(out)
