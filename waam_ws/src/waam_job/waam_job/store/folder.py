"""The job on disk (docs/job_folder.md). Everything that a crash must not tear is written to a new file and renamed."""

from __future__ import annotations

import json
import math
import os
import re
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from waam_node import job_folder
from waam_node.files import write_atomically, write_state
from waam_process.grid import GridSpec
from waam_process.safe_files import FileError, read_mapping, read_npz


def clean(value: Any) -> Any:
    """JSON has no NaN: they become null; numpy scalars become numbers."""
    if isinstance(value, dict):
        return {k: clean(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [clean(v) for v in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value


def make_job_id(title: str, now: datetime | None = None) -> str:
    """<UTC>_<name>, safe as a folder name."""
    stamp = (now or datetime.now(UTC)).strftime('%Y%m%dT%H%M%SZ')
    return f'{stamp}_{re.sub(r"[^A-Za-z0-9._-]+", "-", title)[:60] or "job"}'


@dataclass(frozen=True)
class JobFolder:
    """One job's folder; `path` exists. passing: it goes with the job, so nothing is written from which a crashed job
    would go on: no checkpoints, no track."""

    path: Path
    job_id: str
    passing: bool = False

    @classmethod
    def create(cls, jobs_dir: Path, title: str) -> JobFolder:
        """Makes the folder (a number is added when two jobs start in the same second) and points `latest` at it."""
        jobs_dir.mkdir(parents=True, exist_ok=True)
        base = make_job_id(title)
        for attempt in range(1, 1000):
            job_id = base if attempt == 1 else f'{base}-{attempt}'
            try:
                (jobs_dir / job_id).mkdir()
            except FileExistsError:
                continue
            (jobs_dir / job_id / job_folder.MAPS).mkdir()
            point_latest(jobs_dir, job_id)
            return cls(jobs_dir / job_id, job_id)
        raise OSError(f'{jobs_dir}: a thousand jobs within one second')

    @classmethod
    def open(cls, path: Path) -> JobFolder:
        """A job that is there already."""
        return cls(path, path.name)

    def read_yaml(self, name: str) -> dict:
        """Raises ValueError that names the file when it cannot be read."""
        return read_mapping(self.path / name, self.path)

    def next_run(self) -> int:
        """Number of the run that would start now; 1 is the job's first."""
        return 2 + job_folder.runs_resumed(self.path)

    def read_json(self, name: str) -> dict | None:
        """None when the file is missing or torn."""
        try:
            return read_mapping(self.path / name, self.path)
        except FileError:
            return None

    def read_map(self, number: int) -> dict[str, np.ndarray] | None:
        """Maps (rows, cols) after layer `number` by name (docs/job_folder.md); None when it is missing or torn."""
        return self._arrays(self.path / job_folder.map_after(number))

    def last_map(self) -> int:
        """Number of the newest whole scan, -1 = none."""
        numbers = [job_folder.layer_of(f) for f in job_folder.map_files(self.path)]
        return next((n for n in reversed(numbers) if self.read_map(n)), -1)

    def _arrays(self, file: Path) -> dict[str, np.ndarray] | None:
        try:
            return read_npz(file, self.path)
        except FileError:
            return None

    def write_track(self, run: int, number: int, columns: dict[str, np.ndarray]) -> None:
        """A piece of the telemetry track, columns (n,) SI, to be joined at the end."""
        if columns and not self.passing:
            (self.path / job_folder.TRACK).mkdir(exist_ok=True)
            _replace_npz(self.path / job_folder.track_piece(run, number), columns)

    def last_temperature(self) -> float:
        """degC that the newest whole piece of the telemetry track ends with, NaN when there is none."""
        pieces = reversed(job_folder.track_pieces(self.path))
        for piece in (*pieces, self.path / job_folder.TELEMETRY):
            shown = (self._arrays(piece) or {}).get('temperature')
            if shown is not None and shown.size:
                return float(shown[-1])
        return math.nan

    def join_tracks(self) -> None:
        """telemetry.npz out of all pieces, in the order of their names; the pieces go."""
        pieces = job_folder.track_pieces(self.path)
        parts = [p for p in map(self._arrays, [self.path / job_folder.TELEMETRY, *pieces]) if p]
        if pieces and parts:
            joined = {k: np.concatenate([p[k] for p in parts]) for k in parts[0]}
            _replace_npz(self.path / job_folder.TELEMETRY, joined)
        for piece in pieces:
            piece.unlink()
        if (self.path / job_folder.TRACK).exists():
            (self.path / job_folder.TRACK).rmdir()

    def write_yaml(self, name: str, data: dict) -> None:
        """Replaces the file as a whole. NaN and infinity become null, numpy scalars plain numbers."""
        write_atomically(self.path / name, yaml.safe_dump(clean(data), sort_keys=False))

    def keep(self, name: str, text: str) -> None:
        """Replaces the file by a text as a whole."""
        write_atomically(self.path / name, text)

    def write_json(self, name: str, data: dict) -> None:
        """Replaces the file as a whole. NaN and infinity become null, numpy scalars plain numbers."""
        write_atomically(self.path / name, json.dumps(clean(data), indent=1))

    def write_state(self, name: str, data: dict) -> None:
        """`write_json` that a full disk does not stop (`waam_node.files.write_state`)."""
        write_state(self.path / name, json.dumps(clean(data), indent=1))

    def write_map(self, number: int, spec: GridSpec, **maps: np.ndarray) -> None:
        """Maps (rows, cols) after layer `number` with their geometry; float maps are stored as float32."""
        small = {
            k: np.asarray(v, np.float32) if np.asarray(v).dtype.kind == 'f' else np.asarray(v)
            for k, v in maps.items()
        }
        geometry = {
            'origin': np.array([spec.origin_x, spec.origin_y]),
            'resolution': np.array(spec.resolution),
        }
        _replace_npz(self.path / job_folder.map_after(number), {**geometry, **small})


def _replace_npz(path: Path, arrays: dict[str, np.ndarray]) -> None:
    unfinished = path.with_name(f'.{path.name}')
    unfinished.unlink(missing_ok=True)  # torn, or a link that somebody put there
    np.savez_compressed(unfinished, allow_pickle=False, **arrays)
    with open(unfinished, 'rb') as f:
        os.fsync(f.fileno())
    os.replace(unfinished, path)


def point_latest(jobs_dir: Path, target: str) -> None:
    """jobs/latest -> target, replaced in one step."""
    link = jobs_dir / f'.latest.{os.getpid()}'
    link.unlink(missing_ok=True)
    link.symlink_to(target)
    os.replace(link, jobs_dir / job_folder.LATEST)
