"""report.html: what a job did, on one self-contained page.

`write_report(folder)` reads what docs/job_folder.md describes. A folder with one run becomes the
report of that run, a folder with several runs (demo) a comparison that links to theirs.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

from waam_node import job_folder
from waam_node.files import write_atomically
from waam_process.loop_mode import LOOP_MODES
from waam_process.safe_files import is_file

from .comparison import comparison_page, machines
from .engineer_pages import (
    anomalies_section,
    beads_section,
    corrections_section,
    heat_section,
    limits_section,
    surface_section,
)
from .forecast_section import forecast_section
from .html import escape, page, table
from .job_data import Job, JobError, flatten, load_job, read_report, run_folder
from .layer_tables import layers_section
from .loop_summary import loop_summary
from .owner_page import owner_page
from .passes import passes_section
from .positioner_section import positioner_section
from .shaft_section import shaft_section
from .traceability import traceability_section
from .worst_places import worst_places


def write_report(folder: Path) -> Path:
    """Writes `report.html` into a job or demo folder and returns its path. Raises JobError without
    report.json."""
    folder = Path(folder)
    report = read_report(folder)
    modes = [p for p in LOOP_MODES if isinstance(report.get(p), dict)]
    if not modes:
        raise JobError(f'{folder / job_folder.REPORT}: holds none of {", ".join(LOOP_MODES)}')
    jobs = [load_job(folder, report, p) for p in modes]
    one = len(jobs) == 1
    beside = machines(folder, report, jobs)
    text = job_page(jobs[0], beside) if one else comparison_page(folder, jobs, beside)
    target = folder / job_folder.REPORT_PAGE
    own = folder / f'.report_{os.getpid()}.html'  # client and dashboard may write at the same time
    write_atomically(own, text)
    os.replace(own, target)
    return target


def write_all(folder: Path) -> list[Path]:
    """The report of a folder, after those of the runs inside it (demo). Raises JobError."""
    report = read_report(Path(folder))
    inside = {run_folder(folder, report.get(p)) for p in LOOP_MODES} - {Path(folder)}
    written = [write_report(f) for f in sorted(inside) if is_file(f / job_folder.REPORT)]
    return [*written, write_report(folder)]


def job_page(job: Job, machines: str = '') -> str:
    """The page of one run. machines: HTML of `comparison.machines`."""
    name = job.report.get('name') or job.report.get('job_id') or job.folder.name
    places = worst_places(job)
    owner = f'<section class=owner>{owner_page(job, places)}</section>'
    parts = [
        owner,
        forecast_section(job),
        shaft_section(job),
        surface_section(job, places),
        loop_summary(job),
        beads_section(job),
        limits_section(job),
        heat_section(job),
        machines,
        positioner_section(job),
        corrections_section(job),
        layers_section(job),
        passes_section(job),
        anomalies_section(job),
        traceability_section(job),
        _provenance(job),
    ]
    return page(f'{name}: WAAM job report', '\n'.join(p for p in parts if p))


# of job.yaml; everything else there says what ran
_SETTINGS = ('job_id', 'goal', 'material', 'parameters', 'nodes')


def _provenance(job: Job) -> str:
    """Versions and hashes; the settings of the job can be unfolded."""
    told = (
        job.run.get('trace') or job.report.get('trace') or {}
    )  # the hashes there are not said again
    ran = {
        k: v
        for k, v in job.asked.items()
        if k not in _SETTINGS and v not in ('', None) and v != told.get(k)
    }
    settings = {k: v for k, v in job.asked.items() if k in _SETTINGS}
    out = ['<h2>Provenance</h2>']
    if ran:
        out.append(table(['what', 'value'], [list(r) for r in flatten(ran)], {0, 1}))
    else:
        out.append('<p>job.yaml gives no versions or hashes.</p>')
    if settings:
        listed = table(['key', 'value'], [list(r) for r in flatten(settings)], {0, 1})
        out.append(f'<details><summary>Goal, material and parameters</summary>{listed}</details>')
    for file, text in (
        (job_folder.viewer_recording(), 'rerun recording'),
        (job_folder.record(), 'MCAP recording'),
    ):
        if (job.folder / file).exists():
            out.append(f'<p>{text}: <span class=mono>{escape(file)}</span></p>')
    out += [f'<p class=soft>Note: {escape(n)}</p>' for n in job.notes]
    return '\n'.join(out)


def main(arguments: list[str]) -> int:
    """python3 -m waam_view.report FOLDER: 0, or 1 with one line on stderr."""
    try:
        print(write_report(Path(arguments[0])))
    except (ValueError, OSError) as e:
        print(e, file=sys.stderr)
        return 1
    return 0


if __name__ == '__main__':
    sys.exit(main(sys.argv[1:]))
