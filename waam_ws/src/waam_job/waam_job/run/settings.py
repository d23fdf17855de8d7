"""How this machine runs jobs (parameters of the node). SI."""

from __future__ import annotations

from dataclasses import dataclass, field

from waam_process.segment import Point

from .watch import Limits


@dataclass(frozen=True)
class Settings:
    """Defaults are those of the simulated cell."""

    work_offset: Point = (0.100, 0.080, 0.020)
    plate_zero: Point = (0.020, 0.020, 0.010)
    margin: float = 5e-3
    resolution: float = 0.5e-3
    follow_reach: float = 3e-3
    cooling_timeout: float = 1800.0
    pyrometer_patience: float = 30.0
    home_timeout: float = 120.0
    scan_max_age: float = 900.0
    height_warning: float = 1.0e-3
    cold_metal: float = 2e-4
    restart_metal: float = 0.8
    calibration_max_days: float = 30.0
    simulated: bool = True
    share_in_tolerance: float = 0.95
    lease_nodes: tuple[str, ...] = ()
    limits: Limits = field(default_factory=Limits)
