"""What recorded messages hold that is compared here. Their classes are made from the definitions in the record."""

from __future__ import annotations

from typing import Any, Protocol

from numpy.typing import ArrayLike


class RecordedMap(Protocol):
    """waam_msgs/HeightMap: z, sigma, count by rows."""

    job_id: str
    layer: int
    scan_id: int
    z: ArrayLike
    sigma: ArrayLike
    count: ArrayLike


class RecordedCorrection(Protocol):
    """waam_msgs/CorrectionMap: psi, confidence, residual_height by rows."""

    layer: int
    psi: ArrayLike
    confidence: ArrayLike
    residual_height: ArrayLike
    k_gain: float
    flow_factor: float
    width_ratio: float


class RecordedBatch(Protocol):
    """waam_msgs/ProfileBatch."""

    header: Any
    profile_count: int
    points_per_profile: int
    stamp_offsets_ns: ArrayLike
    x: ArrayLike
    z: ArrayLike
