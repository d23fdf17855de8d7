"""Reads job folders (docs/job_folder.md). A folder whose job.yaml or report.json is damaged is refused by name; a
damaged map or telemetry file is named in the notes, and the rest is taken."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from typing import Any

import numpy as np

from waam_node import job_folder
from waam_process.materials import MaterialError, get
from waam_process.names import INTERRUPTED, JOB_ENDED
from waam_process.safe_files import (
    FileError,
    Missing,
    is_file,
    opened,
    parse_json,
    parse_yaml,
    read_npz,
    read_text,
)

from .beads import Paths, bead_rows
from .content import Content, Surface
from .rows import Told, all_rows
from .surfaces import add_counts, add_surfaces
from .values import mapping, number, text

READ_FILES = (job_folder.JOB, job_folder.REPORT, job_folder.RECORDS, job_folder.STATUS)
TRACK = (
    't', 'x', 'y', 'z', 'current', 'voltage', 'wire_feed', 'wire_feed_commanded', 'speed', 'temperature', 'arc',
    'layer',
)  # fmt: skip
DEPOSIT = 1  # kind of a segment that lays metal
BLOCK = 1 << 20


class SourceError(ValueError):
    """A job that cannot be taken; the text names the file and what is wrong with it."""


class NotFinished(SourceError):
    """A job that is still running; it is taken when it has ended."""


def is_job(folder: Path) -> bool:
    """A folder of one run. The folder of a demo, which holds a report of several, is none."""
    return (
        is_file(folder / job_folder.JOB)
        or is_file(folder / job_folder.RECORDS)
        or (is_file(folder / job_folder.REPORT) and (folder / job_folder.MAPS).is_dir())
    )


def stamp_of(folder: Path) -> str:
    """Names, sizes and times of modification of the files of a job: the same when nothing was written since."""
    found = [(f, f.stat()) for f in _files(folder)]
    facts = [(str(f.relative_to(folder)), s.st_size, s.st_mtime_ns) for f, s in found]
    return hashlib.sha256(repr(facts).encode()).hexdigest()[:32]


def _files(folder: Path) -> list[Path]:
    """What is ingested of a folder."""
    fixed = [folder / n for n in (*READ_FILES, job_folder.TELEMETRY)]
    plans = sorted(folder.glob('plan*.npz'))
    found = [*fixed, *plans, *job_folder.map_files(folder), *job_folder.track_pieces(folder)]
    return [f for f in found if is_file(f)]


def content_hash(folder: Path) -> str:
    """sha256 over names and contents of what is ingested."""
    total = hashlib.sha256()
    for file in _files(folder):
        total.update(f'{file.relative_to(folder)}\0{hash_file(file)}\n'.encode())
    return total.hexdigest()


def hash_file(file: Path) -> str:
    """sha256 of its content."""
    total = hashlib.sha256()
    with opened(file) as f:
        while block := f.read(1 << 20):
            total.update(block)
    return total.hexdigest()


def job_id(folder: Path) -> str:
    """As job.yaml or report.json say it, else the name of the folder. SourceError when one of them is damaged."""
    told = tell(folder)
    named = text(told.asked.get('job_id')) or text(mapping(told.report).get('job_id'))
    return named or text(folder.resolve().name) or 'job'


def tell(folder: Path) -> Told:
    """What the job says about itself. SourceError names a damaged file."""
    asked_text, report_text = (_text(folder / n) for n in (job_folder.JOB, job_folder.REPORT))
    return Told(
        asked=_parse(folder / job_folder.JOB, asked_text) or {},
        report=_parse(folder / job_folder.REPORT, report_text),
        records=_parse(folder / job_folder.RECORDS, _text(folder / job_folder.RECORDS)) or {},
        status=_parse(folder / job_folder.STATUS, _text(folder / job_folder.STATUS)) or {},
        report_text=report_text or '',
        asked_text=asked_text or '',
    )


def _text(file: Path) -> str | None:
    """None when there is no such file. SourceError when it is no text."""
    try:
        return read_text(file)
    except Missing:
        return None
    except FileError as e:
        raise SourceError(str(e)) from None


def _parse(file: Path, content: str | None) -> dict[str, Any] | None:
    if content is None:
        return None
    try:
        parse = parse_json if file.suffix == '.json' else parse_yaml
        data = parse(content, str(file))
    except FileError as e:
        raise SourceError(str(e)) from None
    if not isinstance(data, dict):
        raise SourceError(f'{file}: damaged (it holds no mapping)')
    return data


def read(folder: Path) -> Content:
    """All of one job folder. SourceError; NotFinished while it runs."""
    told = tell(folder)
    state = told.status.get('state')
    if told.report is None and state not in (*JOB_ENDED, INTERRUPTED):
        raise NotFinished(
            f'{folder}: the job has not ended (state {state or "unknown"}, no report)'
        )
    content = Content(job_id(folder), content_hash(folder), str(folder.resolve()), stamp_of(folder))
    area, kg_per_m, kept = wire_of(told)
    content.rows = all_rows(content.job, told, kg_per_m, kept)
    content.surfaces = _surfaces(folder, content.notes)
    content.telemetry = _telemetry(folder, content.notes)
    content.rows['beads'] = bead_rows(content.job, content.telemetry, _paths(folder, content.notes))
    job = content.rows['jobs'][0]
    job |= {'sha256': content.sha256, 'source': text(content.source), 'kind': 'folder'}
    add_surfaces(job, content.surfaces, area)
    add_counts(job, content.rows['beads'])
    return content


def wire_of(told: Told) -> tuple[float | None, float | None, float | None]:
    """Cross-section (m2), mass per length (kg/m) and efficiency of the wire, from job.yaml or the material table."""
    m = mapping(told.asked.get('material'))
    known = [number(m.get(k)) for k in ('wire_diameter', 'density', 'efficiency')]
    if None in known:
        name = text(mapping(told.report).get('material')) or text(told.goal.get('material')) or ''
        try:
            found = get(name)
        except MaterialError:
            return None, None, None
        known = [found.wire_diameter, found.density, found.efficiency]
    diameter, density, kept = (v or 0.0 for v in known)
    area = float(np.pi) * diameter**2 / 4
    return area, area * density, kept


# ---- arrays --------------------------------------------------------------------------------------


def _load(file: Path, folder: Path, notes: list[str]) -> dict[str, np.ndarray]:
    """Arrays of a file; empty, with a note, when it is damaged."""
    try:
        return read_npz(file, folder)
    except FileError as e:
        notes.append(f'{e}; left out')
        return {}


def _surfaces(folder: Path, notes: list[str]) -> list[Surface]:
    found = []
    for file in job_folder.map_files(folder):
        if not (data := _load(file, folder, notes)):
            continue
        try:
            found.append(_surface(job_folder.layer_of(file), data))
        except (KeyError, ValueError, TypeError) as e:
            notes.append(f'{file}: no map, left out ({type(e).__name__}: {e})')
    return found


def _surface(layer: int, data: dict[str, np.ndarray]) -> Surface:
    shape = data['z'].shape
    if len(shape) != 2:
        raise ValueError(f'z has {len(shape)} dimensions')
    x, y = (float(v) for v in data['origin'])
    maps = {k: v for k, v in data.items() if v.shape == shape and v.dtype.kind in 'bfiu'}
    return Surface(layer, (x, y), float(data['resolution']), maps)


def _telemetry(folder: Path, notes: list[str]) -> dict[str, np.ndarray]:
    """Columns (n,) of the track; of a job that was cut off, of its pieces."""
    joined = folder / job_folder.TELEMETRY
    files = [f for f in (joined, *job_folder.track_pieces(folder)) if os.path.lexists(f)]
    parts = [p for f in files if (p := _track(f, folder, notes))]
    return {k: np.concatenate([p[k] for p in parts]) for k in TRACK} if parts else {}


def _track(file: Path, folder: Path, notes: list[str]) -> dict[str, np.ndarray]:
    data = _load(file, folder, notes)
    try:
        track = {k: np.asarray(data[k], float) for k in TRACK} if data else {}
    except (KeyError, ValueError, TypeError) as e:
        notes.append(f'{file}: no telemetry, left out ({type(e).__name__}: {e})')
        return {}
    if len({v.shape for v in track.values()}) > 1 or any(v.ndim != 1 for v in track.values()):
        notes.append(f'{file}: columns of different length, left out')
        return {}
    return track


def _paths(folder: Path, notes: list[str]) -> Paths:
    """Planned beads of all passes; a later pass counts layers on."""
    parts = []
    for file in sorted(folder.glob('plan*.npz')):
        data = _load(file, folder, notes)
        try:
            on = data['kind'] == DEPOSIT if data else np.empty(0, bool)
            if on.any():
                parts.append([data[k][on] for k in ('layer', 'bead', 'start', 'end')])
        except (KeyError, IndexError, ValueError) as e:
            notes.append(f'{file}: no plan, left out ({type(e).__name__}: {e})')
    usable = [p for p in parts if p[2].shape == p[3].shape == (len(p[0]), 3)]
    return (
        Paths(*(np.concatenate(c) for c in zip(*usable, strict=True))) if usable else Paths.none()
    )
