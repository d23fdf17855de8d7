"""What a job folder is called inside (docs/job_folder.md): the one place for its names. No ROS, no file is opened.

Maps are counted by layer: `map_after(3)` is the surface after layer 3. The scan_id of a height map is another number:
it counts every repeat and starts again with every run.
"""

from __future__ import annotations

import re
from pathlib import Path

LATEST = 'latest'  # link in the folder of all jobs to the newest one
LEARNED_DIR = 'learned'  # folder beside them of what jobs have taught, cell by cell
FORECASTS = 'forecasts'  # folder beside them of what `waam forecast` has foretold

JOB = 'job.yaml'  # what was asked, with parameters, versions and hashes
STATUS = 'status.json'  # state of the job; the supervisor writes INTERRUPTED into it
RECORDS = 'records.json'  # layers, anomalies and passes so far
CHECKPOINT = 'checkpoint.json'
CHECKPOINT_BEFORE = 'checkpoint.before.json'  # the generation before
REPORT = 'report.json'
REPORT_PAGE = 'report.html'
LEARNED = 'learned.json'  # what former jobs had taught when the job started
TELEMETRY = 'telemetry.npz'
TOLERANCE_MAP = 'tolerance_map.csv'
STOCK_MAP = 'stock_map.csv'  # of a job with finish machined: what is to be machined off
AS_LAID = 'as_laid.stl'  # its last surface
PRICES = (
    'prices.yaml'  # of wire, gas, energy and machine, for the report; in the folder of the jobs
)
MAPS = 'layers'  # folder of the surfaces
TRACK = 'track'  # folder of the telemetry while the job runs
PROGRAMS = 'program*.gcode'
PROGRAM_GIVEN = 'program_given.gcode'  # of a job that lays a program of others: that program
PROGRAM_DIALECT = 'program_dialect.yaml'  # and what its codes mean

_MAP = re.compile(r'scan_(\d{3,})\.npz')
_RECORD = re.compile(r'record(?:_(\d+))?')
_RUN = re.compile(r'(.+)\.r\d+')


def _numbered(stem: str, number: int, suffix: str = '') -> str:
    """The first has no number in its name."""
    return f'{stem}{suffix}' if number == 1 else f'{stem}_{number}{suffix}'


def plan(pass_number: int = 1) -> str:
    """Plan of a pass: plan.npz, plan_2.npz ..."""
    return _numbered('plan', pass_number, '.npz')


def program(pass_number: int = 1) -> str:
    """G-code of a pass: program.gcode, program_2.gcode ..."""
    return _numbered('program', pass_number, '.gcode')


def record(run: int = 1) -> str:
    """Folder of the recording (MCAP) of a run: record, record_2 ..."""
    return _numbered('record', run)


def viewer_recording(number: int = 1) -> str:
    """Recording for the viewer: job.rrd, job_2.rrd ..."""
    return _numbered('job', number, '.rrd')


def resume(run: int) -> str:
    """Who resumed the job, and with what: resume_2.yaml ..."""
    return f'resume_{run}.yaml'


def cell(run: int = 1) -> str:
    """The cell file as it was when a run started: cell.yaml, cell_2.yaml ..."""
    return _numbered('cell', run, '.yaml')


def map_after(layer: int) -> str:
    """Surface after layer `layer`, 0 = as found: layers/scan_000.npz ..."""
    return f'{MAPS}/scan_{layer:03d}.npz'


def layer_of(file: Path) -> int:
    """Number of the layer that a map was taken after. ValueError when the name is not that of a map."""
    found = _MAP.fullmatch(file.name)
    if found is None:
        raise ValueError(f'{file.name} is not the name of a map')
    return int(found.group(1))


def map_files(folder: Path) -> list[Path]:
    """All maps of a job, in the order of their layers."""
    files = [f for f in (folder / MAPS).glob('scan_*.npz') if _MAP.fullmatch(f.name)]
    return sorted(files, key=layer_of)


def track_piece(run: int, number: int) -> str:
    """A piece of the telemetry while the job runs; the names sort in the order of time."""
    return f'{TRACK}/{run:03d}_{number:05d}.npz'


def track_pieces(folder: Path) -> list[Path]:
    """In the order of time."""
    return sorted((folder / TRACK).glob('*.npz'))


def runs_resumed(folder: Path) -> int:
    """How often the job was resumed."""
    return len(list(folder.glob('resume_*.yaml')))


def is_record(name: str) -> bool:
    """Whether a folder of this name inside a job is the recording of a run."""
    return _RECORD.fullmatch(name) is not None


def record_folders(folder: Path) -> list[Path]:
    """Recordings of all runs of a job, in their order."""
    found = [
        f for f in folder.glob('record*') if is_record(f.name) and f.is_dir() and not f.is_symlink()
    ]
    return sorted(found, key=lambda f: int(f.name.partition('_')[2] or 1))


def run_id(job_id: str, run: int) -> str:
    """What a run is called towards the other nodes: every run is a job of its own there."""
    return job_id if run == 1 else f'{job_id}.r{run}'


def job_of(run: str) -> str:
    """The job that a run belongs to."""
    found = _RUN.fullmatch(run)
    return found.group(1) if found else run
