"""How this machine runs jobs (parameters of the node). SI."""

from __future__ import annotations

from dataclasses import dataclass, field

from waam_process.operating import PLATE_ZERO
from waam_process.segment import Point

from .watch import Limits


@dataclass(frozen=True)
class Settings:
    """Defaults are those of the simulated cell."""

    work_offset: Point = (0.100, 0.080, 0.020)  # m, work zero in machine coordinates
    # m, mode build: work zero seen from the plate's corner
    plate_zero: Point = PLATE_ZERO
    chuck_steps_per_turn: float = 0.0  # of a chuck in place of the X axis; 0 = there is none
    margin: float = 5e-3  # m, map beyond the part
    resolution: float = 0.5e-3  # m, edge of a grid cell
    follow_reach: float = 3e-3  # m, smoothing of the surface that the torch height follows
    cooling_timeout: float = 1800.0  # s, longest interpass wait
    pyrometer_patience: float = 30.0  # s without a plausible temperature
    home_timeout: float = 120.0  # s
    scan_max_age: float = 900.0  # s, an older map is scanned again; 0 = any age
    # the pass after a layer covers only what it has changed (model/changed.py)
    scan_changed_only: bool = False
    height_warning: float = 1.0e-3  # m, height error after a layer that is noted
    cold_metal: float = 2e-4  # 1/K, less metal on a part that has cooled since an interruption
    restart_metal: float = 0.8  # share of its metal that an interrupted path gets after its restart
    calibration_max_days: float = 30.0  # 0 = any age
    simulated: bool = True  # the cell is a simulated one
    cell_file: str = ''  # of this cell; '' = it has none
    cell: str = ''  # name under which jobs keep what they teach; '' = that of the controller
    # a real cell goes on although the pyrometer is doubted
    allow_unbelieved_temperature: bool = False
    keep_learned: bool = True  # what a job has taught is kept for the next one
    share_in_tolerance: float = 0.95  # of the judged area, for a good verdict
    lease_nodes: tuple[str, ...] = ()  # whose heartbeat the arc lease needs
    limits: Limits = field(default_factory=Limits)
