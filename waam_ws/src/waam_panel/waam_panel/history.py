"""The jobs on disk, newest first, for the history and its reports. No ROS."""

from __future__ import annotations

import math
import re
from pathlib import Path
from typing import Any

from waam_node.job_folder import JOB, REPORT, REPORT_PAGE, STATUS
from waam_process.loop_mode import LOOP_MODES, with_loop_mode
from waam_process.names import INTERRUPTED
from waam_process.safe_files import FileError, Missing, is_file, read_mapping

_NAME = re.compile(r'[A-Za-z0-9][A-Za-z0-9._-]*')
SHOWN_FIRST = tuple(reversed(LOOP_MODES))  # of a demo: the closed loop
UNFINISHED = (INTERRUPTED, 'FAILED', 'ABORTED')
SHOWN = 60


class HistoryError(ValueError):
    """The name is not that of a job."""


def facts_of(file: Path) -> dict[str, Any]:
    """The object in a JSON file of a job; {} for none and for a damaged one."""
    try:
        return read_mapping(file)
    except FileError:
        return {}


def jobs(folder: Path, shown: int = SHOWN) -> list[dict[str, Any]]:
    """One row per job (and demo) of a folder. A folder without status and report is no job."""
    found = [f for f in folder.iterdir() if _is_job(f)] if folder.is_dir() else []
    found.sort(key=lambda f: f.name, reverse=True)
    return [_row(f) for f in found[:shown]]


def _is_job(folder: Path) -> bool:
    if folder.is_symlink() or not folder.is_dir() or not _NAME.fullmatch(folder.name):
        return False
    return any(is_file(folder / n) for n in (REPORT, STATUS, JOB))


def _row(folder: Path) -> dict[str, Any]:
    told: dict[str, dict[str, Any]] = {}
    damaged: list[str] = []
    for name in (STATUS, REPORT):
        told[name] = {}
        try:
            told[name] = read_mapping(folder / name)
        except Missing:
            continue
        except FileError as e:
            damaged.append(str(e).removeprefix(f'{folder}/'))
    status, report = with_loop_mode(told[STATUS]), told[REPORT]
    run: dict[str, Any] = next(
        (report[p] for p in SHOWN_FIRST if isinstance(report.get(p), dict)), {}
    )
    runs = [p for p in SHOWN_FIRST if p in report]
    return {
        'id': folder.name,
        'state': _state(status, report, not damaged),
        'message': '; '.join([*damaged, str(status.get('message') or '')]).removesuffix('; '),
        'part': str(report.get('part') or ''),
        'material': str(report.get('material') or ''),
        'loop_mode': ', '.join(runs) or str(status.get('loop_mode') or ''),
        'verdict': str(report.get('verdict') or ''),
        'rms_mm': _number(run.get('rms_mm')),
        'layers': _number(status.get('layers')),
        'duration_s': _number(run.get('duration_s')),
        'report': bool(report),
        'can_go_on': can_go_on(folder),
    }


def _state(status: dict[str, Any], report: dict[str, Any], whole: bool) -> str:
    """A report alone tells that the job is done, unless a damaged file may say something else."""
    return str(status.get('state') or ('DONE' if report and whole else 'UNKNOWN'))


def can_go_on(folder: Path) -> bool:
    """It ended before its last layer and its goal is on disk."""
    state = facts_of(folder / STATUS).get('state')
    return state in UNFINISHED and is_file(folder / JOB)


def _number(value: Any) -> float | None:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    return float(value) if math.isfinite(value) else None


def find(folder: Path, name: str) -> Path:
    """The folder of a job. Raises HistoryError; names only, so nothing outside can be named."""
    if not _NAME.fullmatch(name) or not _is_job(folder / name):
        raise HistoryError(f'there is no job {name!r}')
    return folder / name


def report_is_old(folder: Path) -> bool:
    """report.html is missing, no file, or older than report.json."""
    page, data = folder / REPORT_PAGE, folder / REPORT
    return not is_file(page) or page.stat().st_mtime < data.stat().st_mtime
