"""Many recorded jobs computed again, spread over workers (waam_node.spread), each result kept as it comes."""

from __future__ import annotations

import hashlib
import json
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from waam_node.files import write_atomically
from waam_node.job_folder import is_record, record_folders
from waam_node.spread import Workers, spread
from waam_process.safe_files import read_json

from .summary import as_json
from .tune import tune

PRELOAD = ('waam_replay.tune',)
Found = dict[str, Any]  # `summary.as_json` and 'seconds', or 'error'


@dataclass(frozen=True)
class Piece:
    """One record. job: its folder, absolute; settings: node.parameter=value; kept: file of the result."""

    job: Path
    settings: tuple[str, ...]
    kept: Path


def jobs_in(paths: list[Path]) -> list[Path]:
    """Job folders with a record, in `paths` and in folders of job folders. ValueError when there is none."""
    found: list[Path] = []
    for path in paths:
        if is_job(path) or not path.is_dir():
            found.append(path)  # what is wrong with it is said when it is read
        else:
            found += [p for p in sorted(path.iterdir()) if is_job(p) and not p.is_symlink()]
    if not found:
        raise ValueError(f'no recorded job in {", ".join(map(str, paths))}')
    return list(dict.fromkeys(f.resolve() for f in found))


def is_job(path: Path) -> bool:
    """Whether a folder is a job folder with a record, or a record folder itself."""
    if not path.is_dir():
        return False
    return bool(is_record(path.name) or record_folders(path) or list(path.glob('*.mcap')))


def replay_all(
    jobs: list[Path],
    settings: list[str],
    folder: Path,
    software: str,
    workers: Workers,
    done: Callable[[Path, Found], None] = lambda job, found: None,
) -> dict[Path, Found]:
    """A result per job, in the order of the jobs. done: called with every result as it comes.

    folder: where results are kept, one JSON file per job. A result that is there is used again when record, settings
    and software (its revision) are the same. ClusterError.
    """
    wanted = {job: Piece(job, tuple(settings), folder / _name(job)) for job in jobs}
    keys = {job: _key(piece, software) for job, piece in wanted.items()}
    found: dict[Path, Found] = {}

    def take(job: Path, result: Found) -> None:
        found[job] = result
        done(job, result)

    for job, piece in wanted.items():
        before = _read(piece.kept, keys[job])
        if before is not None:
            take(job, before)
    folder.mkdir(parents=True, exist_ok=True)
    waiting = {job: piece for job, piece in wanted.items() if job not in found}
    for job, result in spread(waiting, attempt, lost, workers):
        if 'error' not in result:
            kept = {'key': keys[job], 'result': result}
            write_atomically(wanted[job].kept, json.dumps(kept, indent=1))
        take(job, result)
    return {job: found[job] for job in jobs}


def attempt(piece: Piece) -> Found:
    """One record in a worker; whatever ends it is a result."""
    started = time.perf_counter()
    try:
        result = as_json(tune(piece.job, list(piece.settings)))
    except Exception as e:
        return lost(piece, e)
    return result | {'seconds': time.perf_counter() - started}


def lost(piece: Piece, error: Exception) -> Found:
    """The result of a record that cannot be computed again."""
    text = ' '.join(str(error).split()) or type(error).__name__
    return {'record': piece.job.name, 'error': text}


def same(found: Found) -> bool:
    """Whether a record gave what was recorded, to the last bit."""
    return bool(found.get('maps')) and all(n == of for n, of in found['identical'].values())


def _name(job: Path) -> str:
    """Of the file of a job's result: jobs of one name in several folders have several files."""
    return f'{job.name}-{hashlib.sha256(str(job).encode()).hexdigest()[:8]}.json'


def _key(piece: Piece, software: str) -> str:
    """What a result depends on: a record is known by names, sizes and times of its files."""
    folders = record_folders(piece.job) or [piece.job]
    listed = [f for folder in folders if folder.is_dir() for f in sorted(folder.iterdir())]
    files = [(str(f), f.stat().st_size, f.stat().st_mtime_ns) for f in listed if f.is_file()]
    told = repr((software, piece.settings, files))
    return hashlib.sha256(told.encode()).hexdigest()


def _read(file: Path, key: str) -> Found | None:
    """None: not there, torn, or of another record, setting or version."""
    try:
        data = read_json(file)
        return data['result'] if data['key'] == key else None
    except (ValueError, KeyError, TypeError):
        return None
