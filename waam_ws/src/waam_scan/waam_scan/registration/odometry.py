"""Where a scanner without poses was: hand-held, or carried by a robot that does not report its position.

KISS-ICP (Vizzo et al. 2023) finds every frame against the map of those before it: it needs no start value but constant
motion. On smooth metal its point-to-point pairs slide, though (docs/registration.md), so each pose is then refined by
robust point-to-plane registration against the merged frames before it; where that does not end on the surface, steady
motion and no motion are tried as well. Both poses are given: what the refinement changed is a measure of trust.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from .result import Registration, RegistrationError
from .solve import register
from .target import Cloud, CloudTarget, Target

MAP_POINTS = 150_000  # of the merged frames
MAX_VOXELS_PER_FRAME = (
    12  # voxels by which KISS-ICP may be wrong from frame to frame on smooth surfaces
)
AGREED = 0.2  # share of a frame that may lie beside the frames before
UNIT = 1e3  # KISS-ICP's convergence limits are absolute: it works in mm here


@dataclass(frozen=True)
class Track:
    """Poses of n frames in the first frame, (4, 4) m each."""

    coarse: np.ndarray  # (n, 4, 4) of KISS-ICP
    poses: np.ndarray  # (n, 4, 4) refined where possible
    refined: np.ndarray  # (n,) bool
    steps: list[Registration | None]  # registration of every refined frame, None otherwise
    notes: list[str]  # frames that were not refined, and why

    def merged(self, frames: list[np.ndarray]) -> np.ndarray:
        """All points (n, 3) m in the axes of the first frame."""
        return np.vstack(
            [f @ p[:3, :3].T + p[:3, 3] for f, p in zip(frames, self.poses, strict=True)]
        )


def odometer(voxel: float, first_error: float = 5e-3) -> Any:
    """A KISS-ICP set up for surfaces of centimetres. voxel: m; first_error: m, how far the first guess may be off."""
    from kiss_icp.config import KISSConfig
    from kiss_icp.kiss_icp import KissICP

    config = KISSConfig()
    config.data.max_range, config.data.min_range, config.data.deskew = 1e6, 0.0, False
    config.mapping.voxel_size = voxel * UNIT
    config.registration.max_num_threads = 2
    config.registration.convergence_criterion = 1e-4
    config.adaptive_threshold.initial_threshold = first_error * UNIT
    config.adaptive_threshold.min_motion_th = 0.02 * voxel * UNIT
    return KissICP(config)


def coarse_poses(frames: list[np.ndarray], voxel: float) -> np.ndarray:
    """(n, 4, 4) m: KISS-ICP alone."""
    kiss = odometer(voxel)
    centre = frames[0].mean(axis=0)  # rotations are found best about the middle of the surface
    found = []
    for frame in frames:
        kiss.register_frame((frame - centre) * UNIT, np.zeros(len(frame)))
        pose = kiss.last_pose.copy()
        pose[:3, 3] = pose[:3, 3] / UNIT + centre - pose[:3, :3] @ centre
        found.append(pose)
    return np.array(found)


def track(
    frames: list[np.ndarray],
    voxel: float = 0.5e-3,
    change: str = 'any',
    seed: int = 0,
    progress: Callable[[int], None] = lambda done: None,
) -> Track:
    """Poses of successive frames (n_i, 3) m; consecutive ones must overlap by more than half.

    ValueError for fewer than two frames or frames without enough points.
    """
    if len(frames) < 2:
        raise ValueError(f'odometry needs at least two frames, not {len(frames)}')
    for number, frame in enumerate(frames):
        if frame.ndim != 2 or frame.shape[1] != 3 or len(frame) < 500:
            raise ValueError(f'frame {number}: {frame.shape} points are not enough for odometry')
    coarse = coarse_poses(frames, voxel)
    poses, refined, notes = [np.eye(4)], [True], list[str]()
    steps: list[Registration | None] = [None]
    merged = frames[0]
    rng = np.random.default_rng(seed)
    for number in range(1, len(frames)):
        step = np.linalg.inv(coarse[number - 1]) @ coarse[number]
        last = np.linalg.inv(poses[-2]) @ poses[-1] if number > 1 else np.eye(4)
        guesses = [poses[-1] @ s for s in (step, last, np.eye(4))]
        cloud = Cloud.of(frames[number], seed=seed)
        target = CloudTarget(Cloud.of(merged, seed=seed))
        found = _refine(cloud, target, guesses, change, MAX_VOXELS_PER_FRAME * voxel, seed)
        pose = guesses[0] if found is None else found.matrix
        notes += _remarks(number, found)
        poses.append(pose)
        steps.append(found)
        refined.append(found is not None)
        moved = frames[number] @ pose[:3, :3].T + pose[:3, 3]
        merged = np.vstack([merged, moved])
        if len(merged) > MAP_POINTS:
            merged = merged[rng.choice(len(merged), MAP_POINTS, replace=False)]
        progress(number + 1)
    return Track(coarse, np.array(poses), np.array(refined), steps, notes)


def _refine(
    cloud: Cloud, target: Target, guesses: list[np.ndarray], change: str, reach: float, seed: int
) -> Registration | None:
    """From the first guess (KISS-ICP, steady motion, none) that ends on the surface; None where none does."""
    best = None
    for guess in guesses:
        try:
            r = register(cloud, target, change, reach, guess, points=20_000, seed=seed)
        except (RegistrationError, np.linalg.LinAlgError):
            continue
        if best is None or r.changed < best.changed:
            best = r
        if best.changed < AGREED:
            break
    return best


def _remarks(number: int, found: Registration | None) -> list[str]:
    """What is wrong with the refinement of a frame."""
    if found is None:
        return [f'frame {number}: does not agree with the frames before: KISS-ICP is kept']
    remarks = []
    if found.unobserved:
        left = '; '.join(found.unobserved)
        remarks.append(f'frame {number}: not observed, left as guessed: {left}')
    if found.changed > AGREED:
        remarks.append(
            f'frame {number}: {found.changed:.0%} of it does not lie on the frames before'
        )
    return remarks
