"""What a job folder says about its cell: height maps, telemetry, plan. Nothing is read that a real cell could not say.

In particular the parameters of a simulated cell, which the laboratory notes in job.yaml, are not looked at.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path

import numpy as np

from waam_job.model.geometry import aim_at
from waam_node import job_folder
from waam_process.grid import GridSpec
from waam_process.safe_files import FileError, read_npz

NEEDED = ('t', 'x', 'y', 'z', 'current', 'voltage', 'wire_feed', 'arc', 'layer')
MAPPED = ('z', 'origin', 'resolution', 'planned')


class RecordError(ValueError):
    """A folder that nothing can be learned from; the text names it and says why."""


@dataclass(frozen=True)
class LaidLayer:
    """One layer: the surface before and after it, m, (rows, cols), NaN = not seen; `planned`: metal asked for, m."""

    number: int
    before: np.ndarray
    after: np.ndarray
    planned: np.ndarray


@dataclass(frozen=True)
class JobRecord:
    """What was recorded of one job. `telemetry`: columns (n,) SI, work frame, about 10 Hz (docs/job_folder.md).
    `nominal`: the finished surface (rows, cols), NaN beside the part. `spots`: layer -> (x, y) m, where the pyrometer
    looked. `paths`: layer -> ends (n, 2), (n, 2) m of the pieces that the torch lays, in their order."""

    name: str
    spec: GridSpec
    layers: tuple[LaidLayer, ...]
    telemetry: dict[str, np.ndarray]
    nominal: np.ndarray
    spots: dict[int, tuple[float, float]]
    paths: dict[int, tuple[np.ndarray, np.ndarray]] = field(default_factory=dict)

    @property
    def first(self) -> np.ndarray:
        """The surface as found, (rows, cols) m."""
        return self.layers[0].before

    @cached_property
    def fingerprint(self) -> str:
        """The same for the same content, whatever the name of the folder."""
        parts = [self.nominal, *(v for _, v in sorted(self.telemetry.items()))]
        parts += [a for one in self.layers for a in (one.before, one.after, one.planned)]
        parts += [a for _, ends in sorted(self.paths.items()) for a in ends]
        digest = hashlib.sha256(repr((self.spec, sorted(self.telemetry), self.spots)).encode())
        for array in parts:
            digest.update(np.ascontiguousarray(array).tobytes())
        return digest.hexdigest()


def read(folder: Path) -> JobRecord:
    """Reads a job folder. RecordError says what is missing."""
    if not folder.is_dir():
        raise RecordError(f'{folder}: no such folder')
    maps = {job_folder.layer_of(f): _npz(f) for f in job_folder.map_files(folder)}
    if not maps:
        if (folder / job_folder.MAPS).is_dir():
            raise RecordError(f'{folder}: the job has no height maps; nothing was scanned')
        raise RecordError(f'{folder}: is not a job folder (no {job_folder.MAPS}/scan_000.npz)')
    layers, spec = _layers(folder, maps)
    telemetry = _telemetry(folder)
    file = folder / job_folder.plan()
    plan = _npz(file) if file.exists() else {}
    first = maps[min(maps)]
    nominal = np.asarray(first.get('nominal', first['z']), float)
    name, spots, paths = folder.name, _spots(plan), _paths(plan)
    return JobRecord(name, spec, layers, telemetry, nominal, spots, paths)


def read_all(paths: list[Path]) -> list[JobRecord]:
    """Of job folders, or of folders that hold some. RecordError when there is nothing to learn from at all."""
    folders: list[Path] = []
    for path in paths:
        within = [] if (path / job_folder.MAPS).is_dir() or not path.is_dir() else _jobs_in(path)
        folders += within or [path]
    if not folders:
        raise RecordError('no jobs were given: name job folders, as in jobs/20260101T080000Z_jaw')
    return [read(f) for f in dict.fromkeys(f.resolve() for f in folders)]


def _jobs_in(folder: Path) -> list[Path]:
    found = [p for p in sorted(folder.iterdir()) if (p / job_folder.MAPS).is_dir()]
    return [p for p in found if not p.is_symlink()]


def _layers(
    folder: Path, maps: dict[int, dict[str, np.ndarray]]
) -> tuple[tuple[LaidLayer, ...], GridSpec]:
    for number, one in maps.items():
        if missing := [k for k in MAPPED[:3] if k not in one]:
            raise RecordError(f"{folder}: the map after layer {number} has no '{missing[0]}'")
    first = maps[min(maps)]
    x, y = (float(v) for v in first['origin'])
    spec = GridSpec(x, y, float(first['resolution']), *first['z'].shape)
    layers = []
    for number in sorted(maps):
        before, after = maps.get(number - 1), maps[number]
        if before is None or before['z'].shape != after['z'].shape or 'planned' not in before:
            continue
        z0, z1 = (np.asarray(m['z'], float) for m in (before, after))
        layers.append(LaidLayer(number, z0, z1, np.asarray(before['planned'], float)))
    if not layers:
        raise RecordError(f'{folder}: no layer was scanned before and after; nothing to compare')
    return tuple(layers), spec


def _telemetry(folder: Path) -> dict[str, np.ndarray]:
    file = folder / job_folder.TELEMETRY
    if not file.exists():
        raise RecordError(f'{folder}: no {file.name}; the job did not come to its end')
    data = {k: np.asarray(v, float) for k, v in _npz(file).items()}
    if missing := [k for k in NEEDED if k not in data]:
        raise RecordError(f"{file}: has no column '{missing[0]}'")
    order = np.flatnonzero(np.diff(data['t'], prepend=-np.inf) > 0)
    data = {k: v[order] for k, v in data.items()}
    if not (data['arc'] > 0.5).any():
        raise RecordError(f'{file}: the arc never burned')
    return data


def _spots(plan: dict[str, np.ndarray]) -> dict[int, tuple[float, float]]:
    """Middle of what each layer lays, as waam_job aims the pyrometer."""
    found = {}
    for number, use in _deposits(plan).items():
        a, b = plan['start'][use][:, :2], plan['end'][use][:, :2]
        length = np.maximum(np.hypot(*(b - a).T), 1e-9)
        x, y = aim_at((a + b) / 2, length, plan['width'][use])
        found[number] = (x, y)
    return found


def _paths(plan: dict[str, np.ndarray]) -> dict[int, tuple[np.ndarray, np.ndarray]]:
    return {
        number: (plan['start'][use][:, :2], plan['end'][use][:, :2])
        for number, use in _deposits(plan).items()
    }


def _deposits(plan: dict[str, np.ndarray]) -> dict[int, np.ndarray]:
    """Layer -> which segments of the plan (n,) bool lay its metal; none without a plan."""
    if not plan:
        return {}
    deposit = plan['kind'] == 1
    return {int(k): deposit & (plan['layer'] == k) for k in np.unique(plan['layer'][deposit])}


def _npz(file: Path) -> dict[str, np.ndarray]:
    try:
        return read_npz(file)
    except FileError as e:
        raise RecordError(str(e)) from None
