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

from waam_node.files import write_atomically
from waam_process.grid import GridSpec


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
    """One job's folder; `path` exists."""

    path: Path
    job_id: str

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
            (jobs_dir / job_id / 'layers').mkdir()
            point_latest(jobs_dir, job_id)
            return cls(jobs_dir / job_id, job_id)
        raise OSError(f'{jobs_dir}: a thousand jobs within one second')

    def write_yaml(self, name: str, data: dict) -> None:
        write_atomically(self.path / name, yaml.safe_dump(clean(data), sort_keys=False))

    def write_json(self, name: str, data: dict) -> None:
        write_atomically(self.path / name, json.dumps(clean(data), indent=1))

    def write_map(self, number: int, spec: GridSpec, **maps: np.ndarray) -> None:
        """layers/scan_NNN.npz with geometry; float maps are stored as float32."""
        small = {
            k: np.asarray(v, np.float32) if np.asarray(v).dtype.kind == 'f' else np.asarray(v)
            for k, v in maps.items()
        }
        np.savez_compressed(
            self.path / 'layers' / f'scan_{number:03d}.npz',
            origin=np.array([spec.origin_x, spec.origin_y]),
            resolution=np.array(spec.resolution),
            **small,
        )


def point_latest(jobs_dir: Path, target: str) -> None:
    """jobs/latest -> target, replaced in one step."""
    link = jobs_dir / f'.latest.{os.getpid()}'
    link.unlink(missing_ok=True)
    link.symlink_to(target)
    os.replace(link, jobs_dir / 'latest')
