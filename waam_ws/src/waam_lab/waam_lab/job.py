"""Jobs of the laboratory and their results. SI unless the name says otherwise."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from waam_job.model.goal import JobGoal
from waam_process.grid import GridSpec
from waam_sim.plant import PlantParams

from .params import Overrides


@dataclass(frozen=True)
class Fault:
    """A fault of the cell (waam_sim.faults): it begins with the deposition of `layer`. value: 0 = its default."""

    name: str
    value: float = 0.0
    layer: int = 1


@dataclass(frozen=True)
class LabJob:
    """One job on one cell.

    goal: as of run_job; its jobs_dir is used only with `keep`.
    as_found: mesh (mm) of the worn part that lies on the table; None: a flat plate, as for a build.
    seed: of everything random in the cell.
    overrides: node -> parameter -> value, on top of the files that the graph loads; unknown names are refused.
    plant: physics of the cell; None: as parameters of node `cell`.
    keep: the job folder stays in goal.jobs_dir; otherwise it is deleted once the result is read.
    """

    goal: JobGoal
    as_found: Path | None = None
    seed: int = 1
    overrides: Overrides = field(default_factory=dict)
    plant: PlantParams | None = None
    faults: tuple[Fault, ...] = ()
    keep: bool = False


def restore(part: Path, as_found: Path, seed: int = 1, **options: Any) -> LabJob:
    """A restoration. options: fields of LabJob and of JobGoal."""
    return _job(part, as_found, seed, 'restore', options)


def build(part: Path, seed: int = 1, **options: Any) -> LabJob:
    """A build on the plate. options: fields of LabJob and of JobGoal."""
    return _job(part, None, seed, 'build', options)


def _job(part: Path, as_found: Path | None, seed: int, mode: str, options: dict) -> LabJob:
    own = {k: options.pop(k) for k in ('overrides', 'plant', 'faults', 'keep') if k in options}
    fields = {'material': 'er70s-6', 'jobs_dir': Path('jobs'), 'mode': mode, **options}
    return LabJob(JobGoal(part=Path(part), **fields), as_found, seed, **own)


@dataclass(frozen=True)
class LabMaps:
    """The last scan, (rows, cols). error: m, surface minus wanted, NaN = not seen; region: all that was to be laid;
    interior: the part of it that is judged; as_found: m, error before the job."""

    spec: GridSpec
    error: np.ndarray
    region: np.ndarray
    interior: np.ndarray
    as_found: np.ndarray


@dataclass(frozen=True)
class LabResult:
    """What came out of one job.

    rms, mean, max_error: m over the judged area (interior); largest: m, 99.5 % of its cells are within;
    rms_edges: m over the whole region, with its rim; share_in_tolerance: of the judged area; share_edges: of the whole
    region; verdict_edges: over the whole region; overrun, overrun_mean: m, how far metal stands over the part's sides,
    largest and mean; layer_means: m, mean error of the judged area after every layer; fallbacks: layers without the
    correction law that was asked for;
    time: s of machine time; wire: m; reports: one dictionary per layer and one for the last scan (docs/job_folder.md);
    folder: of the job when it was kept; cpu: s of processor time that the job took.
    """

    seed: int
    verdict: str
    error_code: int
    message: str
    rms: float = math.nan
    mean: float = math.nan
    max_error: float = math.nan
    largest: float = math.nan
    rms_edges: float = math.nan
    share_in_tolerance: float = math.nan
    share_edges: float = math.nan
    verdict_edges: str = ''
    overrun: float = math.nan
    overrun_mean: float = math.nan
    layer_means: tuple[float, ...] = ()
    layers: int = 0
    fallbacks: int = 0
    time: float = math.nan
    wire: float = math.nan
    reports: tuple[Mapping[str, Any], ...] = ()
    anomalies: tuple[Mapping[str, Any], ...] = ()
    maps: LabMaps | None = None
    folder: Path | None = None
    cpu: float = math.nan

    @property
    def in_tolerance(self) -> bool:
        return self.verdict == 'in tolerance'

    @property
    def mean_size(self) -> float:
        """m: size of the mean error, whatever its sign."""
        return abs(self.mean)

    @property
    def failed(self) -> bool:
        return self.verdict == 'failed'

    @property
    def speed(self) -> float:
        """Simulated seconds per second of processor time."""
        return self.time / self.cpu if self.cpu > 0 else math.nan
