"""Parameters of scan_fusion; `config/scan_fusion.yaml` lists the same."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

from waam_node.params import ParameterError, param

from .fusion.limits import FusionLimits
from .fusion.plausibility import PlausibilityLimits
from .transform import Mounting


@dataclass(frozen=True)
class FusionParams:
    """Parameters of the node, with default, meaning, unit and limits."""

    mount_xyz: tuple = param(
        (0.060, 0.0, 0.120), 'scanner origin from the wire tip (torch_tcp), work axes', 'm'
    )
    mount_rpy: tuple = param(
        (0.0, 0.0, math.pi / 2),
        'roll, pitch, yaw of the scanner frame (x lateral, z up) in work axes',
        'rad',
    )
    profile_delay: float = param(
        0.0, 'added to profile stamps to bring them onto the clock of the telemetry', 's', -1.0, 1.0
    )
    calibration: str = param(
        '', 'file of waam scan calibrate; replaces mount_xyz, mount_rpy and profile_delay'
    )
    points_down: bool = param(
        True, 'z of the topic points is the distance from the scanner (drivers), not the height'
    )
    points_period: float = param(
        0.0, 'time between the rows of a cloud on points; 0 = one profile per cloud', 's', 0.0, 10.0
    )
    points_topic: str = param('points', 'of a driver that publishes PointCloud2')
    scan_topic: str = param('scan', 'of a driver that publishes LaserScan')
    scanner_frame: str = param('scanner', 'frame_id of points and scan; others are refused')
    height_min: float = param(-0.05, 'points below are outside (work frame)', 'm', -1.0, 1.0)
    height_max: float = param(0.30, 'points above are outside (work frame)', 'm', -1.0, 2.0)
    threads: int = param(2, 'threads for large batches and for the map', '', 1, 64)
    min_coverage: float = param(
        0.5, 'plausible maps know at least this share of the grid', '', 0.0, 1.0
    )
    max_growth: float = param(6e-3, 'largest possible growth per layer', 'm', 1e-4, 0.1)
    scanner_wait: float = param(
        1.0,
        'how long to wait for the service scanner/enable, or a profile without it (steady)',
        's',
        0.05,
        60.0,
    )

    @property
    def mounting(self) -> Mounting:
        """From the calibration file when there is one. ParameterError when it cannot be trusted."""
        if self.calibration:
            from .calibration.file import load_calibration

            try:
                return load_calibration(Path(self.calibration)).mounting
            except ValueError as error:
                raise ParameterError(f"parameter 'calibration': {error}") from None
        return Mounting.from_rpy(self.mount_xyz, self.mount_rpy, self.profile_delay)

    @property
    def fusion(self) -> FusionLimits:
        """What the estimator of cells needs of them."""
        return FusionLimits(self.height_min, self.height_max)

    @property
    def plausibility(self) -> PlausibilityLimits:
        """What the checks of a finished map need of them."""
        return PlausibilityLimits(self.min_coverage, max_growth=self.max_growth)
