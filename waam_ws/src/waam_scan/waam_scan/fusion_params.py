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
    points_nearest: float = param(
        1e-3, 'points of the topic points nearer than this are no returns', 'm', 0.0, 10.0
    )
    points_period: float = param(
        0.0, 'time between the rows of a cloud on points; 0 = one profile per cloud', 's', 0.0, 10.0
    )
    intensity_min: float = param(0.0, 'points darker than this are drop-outs', '', 0.0, 1e9)
    intensity_max: float = param(1e9, 'points brighter than this are drop-outs', '', 0.0, 1e9)
    telemetry_seconds: float = param(60.0, 'length of the pose track', 's', 1.0, 3600.0)
    telemetry_rate: float = param(
        100.0, 'telemetry rate that the track is sized for', 'Hz', 1.0, 10e3
    )
    max_gap: float = param(
        0.030,
        'a profile between telemetry frames further apart than this is rejected',
        's',
        1e-3,
        1.0,
    )
    max_waiting: int = param(2000, 'profiles that may wait for telemetry', '', 10, 1_000_000)
    max_cells: int = param(2_000_000, 'largest grid that is accepted', 'cells', 1, 50_000_000)
    height_min: float = param(-0.05, 'points below are outside (work frame)', 'm', -1.0, 1.0)
    height_max: float = param(0.30, 'points above are outside (work frame)', 'm', -1.0, 2.0)
    noise: float = param(
        50e-6, 'scatter of the scanner while the data cannot tell', 'm', 1e-7, 1e-2
    )
    spike_factor: float = param(
        4.0, 'points further from their cell than this many robust sigmas are spikes', '', 2.0, 20.0
    )
    support: float = param(
        0.6e-3,
        'cells with fewer than 4 points need a neighbour this close in height',
        'm',
        1e-5,
        0.1,
    )
    slots: int = param(16, 'points in the sample of a cell', '', 8, 256)
    threads: int = param(2, 'threads for large batches and for the map', '', 1, 64)
    refresh_period: float = param(
        0.25, 'cells are worked up during the scan this often (steady)', 's', 0.01, 60.0
    )
    min_coverage: float = param(
        0.5, 'plausible maps know at least this share of the grid', '', 0.0, 1.0
    )
    max_coverage_loss: float = param(
        0.4, 'largest loss of coverage against the previous map', '', 0.0, 1.0
    )
    max_residual: float = param(0.2e-3, 'largest scatter of points in a cell', 'm', 1e-6, 1e-2)
    max_growth: float = param(6e-3, 'largest possible growth per layer', 'm', 1e-4, 0.1)
    max_shrink: float = param(
        1e-3, 'largest possible loss of height, and tolerance of growth', 'm', 0.0, 0.1
    )
    max_jump_share: float = param(0.05, 'share of cells that may grow or sink more', '', 0.0, 1.0)
    max_age: float = param(
        0.5, 'largest age of the last profile at the end of the scan', 's', 0.0, 60.0
    )
    max_rejected: float = param(
        0.2, 'share of profiles that may be rejected, and of batches that may be lost', '', 0.0, 1.0
    )
    scanner_wait: float = param(
        1.0, 'how long to wait for the service scanner/enable to be there (steady)', 's', 0.05, 60.0
    )
    answer_wait: float = param(
        5.0, 'how long to wait for the answer of scanner/enable (steady)', 's', 0.05, 60.0
    )
    quiet_time: float = param(
        1.0, 'a finishing scan ends after this long without news (steady)', 's', 0.05, 60.0
    )
    finish_timeout: float = param(
        30.0, 'a finishing scan gives up after this long (steady)', 's', 0.1, 600.0
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
    def intensity(self) -> tuple[float, float] | None:
        """None when every intensity is good."""
        limits = (self.intensity_min, self.intensity_max)
        return None if limits == (0.0, 1e9) else limits

    @property
    def fusion(self) -> FusionLimits:
        """What the estimator of cells needs of them."""
        return FusionLimits(
            self.height_min,
            self.height_max,
            self.noise,
            self.spike_factor,
            self.support,
            self.slots,
        )

    @property
    def plausibility(self) -> PlausibilityLimits:
        """What the checks of a finished map need of them."""
        names = PlausibilityLimits.__dataclass_fields__
        return PlausibilityLimits(**{n: getattr(self, n) for n in names})
