"""Jobs of the laboratory and their results. SI unless the name says otherwise."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from waam_job.model.goal import JobGoal
from waam_plan.finish import MACHINED
from waam_process.grid import GridSpec
from waam_process.operating import DEFAULT_MATERIAL, DEFAULT_PRESET, GANTRY
from waam_process.verdicts import FAILED, GOOD
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
    """One job on one cell."""

    goal: JobGoal  # as of run_job; its jobs_dir is used only with `keep`
    # mesh or cloud of the worn part on the table, in coordinates and units of the nominal one; None = a flat plate
    as_found: Path | None = None
    seed: int = 1  # of everything random in the cell
    # node -> parameter -> value, on top of the graph's files; unknown names are refused
    overrides: Overrides = field(default_factory=dict)
    preset: str = DEFAULT_PRESET  # of PRESETS: how rough the cell is, before the overrides
    plant: PlantParams | None = None  # physics of the cell; None = as parameters of node `cell`
    faults: tuple[Fault, ...] = ()
    machine: str = GANTRY  # of MACHINES; a robot has six axes and a positioner (waam_robot_bridge)
    # the job folder stays in goal.jobs_dir; otherwise it is deleted once the result is read
    keep: bool = False
    learned: Path | None = None  # folder of what jobs have taught; None = the job starts fresh
    # The job adds to that folder; jobs that do must not run at the same time.
    keep_learned: bool = False

    @property
    def machined(self) -> bool:
        """Whether it is judged by what is below nominal after machining."""
        return f'finish={MACHINED}' in self.goal.plan_settings

    @property
    def shaft_diameter(self) -> float:
        """m, nominal, of a shaft that turns; 0 for a part that lies still."""
        return self.goal.shaft_diameter

    @property
    def chuck(self) -> bool:
        """Whether its cell turns a shaft in place of the X axis: laboratories of a gantry have what a job needs."""
        return self.machine == GANTRY and self.shaft_diameter > 0


# of LabJob, beside those of its goal
OWN = ('overrides', 'preset', 'plant', 'faults', 'machine', 'keep', 'learned', 'keep_learned')


def restore(part: Path, as_found: Path, seed: int = 1, **options: Any) -> LabJob:
    """A restoration. options: fields of LabJob and of JobGoal."""
    return _job(part, as_found, seed, 'restore', options)


def restore_shaft(
    scan: Path, diameter: float, ends: float, seed: int = 1, **options: Any
) -> LabJob:
    """The restoration of a shaft that turns. scan: of the worn shaft (`waam_plan.shaft.surfaces`); diameter, ends: m,
    as of `waam plan --shaft`. options: fields of LabJob and of JobGoal."""
    own = (f'shaft_diameter={diameter!r}', f'shaft_ends={ends!r}')
    given = tuple(options.pop('plan_settings', ()))
    return _job(scan, scan, seed, 'restore', {**options, 'plan_settings': (*given, *own)})


def build(part: Path, seed: int = 1, **options: Any) -> LabJob:
    """A build on the plate. options: fields of LabJob and of JobGoal."""
    return _job(part, None, seed, 'build', options)


def _job(part: Path, as_found: Path | None, seed: int, mode: str, options: dict) -> LabJob:
    own = {k: options.pop(k) for k in OWN if k in options}
    fields = {'material': DEFAULT_MATERIAL, 'jobs_dir': Path('jobs'), 'mode': mode, **options}
    return LabJob(JobGoal(part=Path(part), **fields), as_found, seed, **own)


@dataclass(frozen=True)
class LabMaps:
    """The last scan, (rows, cols)."""

    spec: GridSpec
    error: np.ndarray  # m, surface minus wanted; NaN = not seen
    region: np.ndarray  # bool, all that was to be laid
    interior: np.ndarray  # bool, the part of it that is judged
    as_found: np.ndarray  # m, error before the job
    # int8, number of `causes.PLACES`, -1 = nothing is laid or needed
    places: np.ndarray | None = None
    # bool, of finish machined: needed and below nominal; None = as laid
    below: np.ndarray | None = None


@dataclass(frozen=True)
class LabResult:
    """What came out of one job. The judged area is the interior of the region."""

    seed: int
    verdict: str
    error_code: int
    message: str
    rms: float = math.nan  # m, over the judged area
    mean: float = math.nan  # m, over the judged area
    max_error: float = math.nan  # m, over the judged area
    largest: float = math.nan  # m, 99.5 % of the judged cells are within
    rms_edges: float = math.nan  # m, over the whole region, with its rim
    share_in_tolerance: float = math.nan  # of the judged area
    share_edges: float = math.nan  # of the whole region
    verdict_edges: str = ''  # over the whole region
    overrun: float = math.nan  # m, how far metal stands over the sides of the part, largest
    overrun_mean: float = math.nan  # m, the same on average
    # share of the needed area at or above nominal; NaN unless the finish is machined
    clean_share: float = math.nan
    stock_mean: float = math.nan  # m to be machined off what was laid
    stock_high: float = math.nan  # m, 99 % of it have less
    unlaid_share: float = math.nan  # of the needed area: too narrow or too shallow for a bead
    # of a shaft, see `waam_job.model.shaft.ShaftFigures`
    clean_diameter: float = math.nan
    roundness: float = math.nan
    new_run_out: float = math.nan
    seam_step: float = math.nan
    axis: tuple[float, float] = (math.nan, math.nan)
    layer_means: tuple[float, ...] = ()  # m, mean error of the judged area after every layer
    layer_rms: tuple[float, ...] = ()  # m, RMS of the same error
    layers: int = 0
    fallbacks: int = 0  # layers without the correction law that was asked for
    time: float = math.nan  # s of machine time
    scan_time: float = math.nan  # s of it in which the job was scanning, ways to the scans included
    wire: float = math.nan  # m
    volume: float = math.nan  # m3 that the first plan lays
    # one per layer and one for the last scan (docs/job_folder.md)
    reports: tuple[Mapping[str, Any], ...] = ()
    anomalies: tuple[Mapping[str, Any], ...] = ()
    maps: LabMaps | None = None
    # m, true contact distance less 15 mm, from 1 s after each strike on
    contact_rms: float = math.nan
    contact_worst: float = math.nan  # m, largest of it
    contact_least: float = math.nan  # m, smallest contact distance of all, strikes included
    # variance of the true current, power and heat input over the square of their means, in steady travel, of means over
    # 0.5 s
    process_variance: Mapping[str, float] = field(default_factory=dict)
    # m, by layer: mean true width of the pool in steady travel
    bead_widths: Mapping[int, float] = field(default_factory=dict)
    arcs_lost: int = 0  # arcs that went out although they were wanted
    folder: Path | None = None  # of the job, when it was kept
    cpu: float = math.nan  # s of processor time that the job took

    @property
    def in_tolerance(self) -> bool:
        """Of the judged area; with finish machined: it cleans up."""
        return self.verdict in GOOD

    @property
    def mean_size(self) -> float:
        """m: size of the mean error, whatever its sign."""
        return abs(self.mean)

    @property
    def failed(self) -> bool:
        """The job ended with an error: see `error_code` and `message`."""
        return self.verdict == FAILED

    @property
    def speed(self) -> float:
        """Simulated seconds per second of processor time."""
        return self.time / self.cpu if self.cpu > 0 else math.nan
