"""A job's folder in memory (docs/job_folder.md). Everything but report.json may be missing."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from waam_node import job_folder
from waam_process.safe_files import FileError, Missing, read_mapping, read_npz
from waam_process.unrolled import THINNEST, Unrolled


class JobError(ValueError):
    """A folder that is no job; the text names the file."""


@dataclass(frozen=True)
class Scan:
    """One file of `layers/`: float maps (rows, cols), m; missing ones are NaN."""

    layer: int  # taken after this one, 0 = as found
    origin: tuple[float, float]
    resolution: float
    maps: dict[str, np.ndarray]
    unrolled: bool = False  # of a shaft: x goes around it, y along its axis

    @property
    def z(self) -> np.ndarray:
        """(rows, cols) m, NaN = unknown."""
        return self.maps['z']

    @property
    def error(self) -> np.ndarray:
        """(rows, cols) m: surface minus the one wanted at that moment; NaN where one is unknown and off the region."""
        wanted = self.maps.get('target', np.full(self.z.shape, np.nan))
        return np.where(self.region, self.z - wanted, np.nan)

    @property
    def final_error(self) -> np.ndarray:
        """(rows, cols) m: surface minus nominal surface; NaN where one is unknown and off the region."""
        nominal = self.maps.get('nominal', np.full(self.z.shape, np.nan))
        return np.where(self.region, self.z - nominal, np.nan)

    @property
    def region(self) -> np.ndarray:
        """bool, cells to be restored; everything when the file does not say."""
        return self.maps.get('region', np.ones(self.z.shape)).astype(bool)

    @property
    def interior(self) -> np.ndarray:
        """bool, region without its margin: what the tolerance is judged on."""
        return self.maps.get('interior', self.region).astype(bool)

    @property
    def extent_mm(self) -> tuple[float, float, float, float]:
        """x_min, x_max, y_min, y_max in mm."""
        rows, cols = self.z.shape
        x, y, d = self.origin[0] * 1e3, self.origin[1] * 1e3, self.resolution * 1e3
        return x, x + cols * d, y, y + rows * d


@dataclass(frozen=True)
class Job:
    """One run in one loop mode."""

    folder: Path
    loop_mode: str
    report: dict[str, Any]
    run: dict[str, Any]
    scans: list[Scan] = field(default_factory=list)
    telemetry: dict[str, np.ndarray] = field(default_factory=dict)
    asked: dict[str, Any] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    @property
    def tolerance_mm(self) -> float:
        """Of the job; 0.2 when the report has none."""
        value = number(self.report.get('tolerance_mm'))
        return value if value > 0 else 0.2

    @property
    def shaft(self) -> Unrolled | None:
        """The shaft that was turned; None for a part that lay still."""
        return shaft_of(self.asked)

    @property
    def layers(self) -> list[dict]:
        """Records of the layers as in report.json; empty when there are none."""
        return [x for x in self.run.get('layers') or [] if isinstance(x, dict)]


def number(value: Any) -> float:
    """float, or NaN for anything that is none."""
    try:
        return math.nan if value is None else float(value)
    except (TypeError, ValueError):
        return math.nan


def mapping(value: Any) -> dict[str, Any]:
    """A dictionary; an empty one for anything else."""
    return value if isinstance(value, dict) else {}


def read_report(folder: Path) -> dict[str, Any]:
    """report.json of a folder. Raises JobError."""
    file = Path(folder) / job_folder.REPORT
    try:
        return read_mapping(file)
    except Missing:
        raise JobError(f'{file} is not there: not the folder of a finished job') from None
    except FileError as e:
        raise JobError(str(e)) from None


def load_job(folder: Path, report: dict[str, Any], loop_mode: str) -> Job:
    """The run in one loop mode with what its folder holds; `notes` says what could not be read."""
    run = report.get(loop_mode) or {}
    place = run_folder(folder, run)
    notes: list[str] = []
    scans = [s for f in job_folder.map_files(place) if (s := load_scan(f, notes))]
    asked = read_asked(place, notes)
    if shaft_of(asked):
        scans = [replace(s, unrolled=True) for s in scans]
    return Job(
        folder=place,
        loop_mode=loop_mode,
        report=report,
        run=run,
        scans=scans,
        telemetry=_telemetry(place, notes),
        asked=asked,
        notes=notes,
    )


def shaft_of(asked: dict[str, Any]) -> Unrolled | None:
    """The shaft that a job turns, by its job.yaml; None for a part that lies still."""
    given = mapping(asked.get('goal')).get('plan_settings')
    for text in given if isinstance(given, list) else []:
        name, _, value = str(text).partition('=')
        if name.strip() == 'shaft_diameter' and number(value) >= THINNEST:
            return Unrolled(number(value))
    return None


def shaft_in(folder: Path) -> Unrolled | None:
    """The same by the folder of a job."""
    return shaft_of(read_asked(Path(folder), []))


def run_folder(folder: Path, run: Any) -> Path:
    """Folder of a run of a report: the report's own, or one in it. JobError for any other place."""
    name = str((run if isinstance(run, dict) else {}).get('folder') or '.')
    place = Path(folder) / name
    if name != '.' and (name != Path(name).name or name == '..' or place.is_symlink()):
        raise JobError(f'{folder}: its report names the folder {name[:80]!r}, which is not in it')
    return place


def _arrays(file: Path, notes: list[str]) -> dict[str, np.ndarray]:
    try:
        below = file.parent.parent if file.parent.name == job_folder.MAPS else file.parent
        return read_npz(file, below)
    except FileError as e:
        notes.append(f'{file.name} cannot be read ({e})')
        return {}


def load_scan(file: Path, notes: list[str]) -> Scan | None:
    """One file of `layers/`; None, with a reason added to `notes`, when it cannot be read."""
    data = _arrays(file, notes)
    if not data:
        return None
    try:
        z = np.asarray(data['z'], float)
        maps = {
            k: np.asarray(v, float)
            for k, v in data.items()
            if np.shape(v) == z.shape and z.ndim == 2
        }
        x, y = (float(v) for v in data['origin'])
        layer = job_folder.layer_of(file)
        return Scan(layer, (x, y), float(data['resolution']), {'z': z, **maps})
    except (KeyError, ValueError, TypeError, IndexError) as e:
        notes.append(f'{file.name} is not a scan ({type(e).__name__}: {e})')
        return None


def _telemetry(place: Path, notes: list[str]) -> dict[str, np.ndarray]:
    file = place / job_folder.TELEMETRY
    data = _arrays(file, notes) if os.path.lexists(file) else {}
    return data if 't' in data and len(data['t']) else {}


def read_asked(place: Path, notes: list[str]) -> dict[str, Any]:
    """job.yaml of a run: what it was asked for; empty, with a reason in `notes`, when it cannot be read."""
    file = place / job_folder.JOB
    try:
        return read_mapping(file)
    except Missing:
        return {}
    except FileError as e:
        notes.append(f'job.yaml cannot be read ({e})')
        return {}


def find_value(tree: Any, key: str) -> Any:
    """First value with this key anywhere in nested dictionaries, or None."""
    if isinstance(tree, dict):
        if key in tree:
            return tree[key]
        for value in tree.values():
            found = find_value(value, key)
            if found is not None:
                return found
    return None


def interpass_limit(job: Job) -> float:
    """degC, NaN = not known: that of the thermal compensator, else that of the material."""
    own = number(find_value(job.asked.get('nodes') or {}, 'interpass_limit'))
    return own if math.isfinite(own) else number(find_value(job.asked, 'interpass_limit'))


def flatten(tree: dict[str, Any], prefix: str = '') -> list[tuple[str, str]]:
    """Nested dictionary -> [('a.b', 'value')]."""
    rows: list[tuple[str, str]] = []
    for key, value in tree.items():
        if isinstance(value, dict):
            rows += flatten(value, f'{prefix}{key}.')
        else:
            rows.append((f'{prefix}{key}', str(value)))
    return rows
