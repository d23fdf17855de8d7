"""Open3D's point-to-plane registration with Tukey's kernel, in the units that its convergence limits expect."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import open3d as o3d

MM = 1e3  # Open3D works in mm about the middle of the moving cloud: its limits are absolute
VOXEL = 2.3  # spacings: points are averaged over so much, which takes the noise off their planes
ITERATIONS = 50  # at most
NORMAL_RADIUS, NORMAL_POINTS = 4.0, 30  # voxels; neighbours of a local plane
# change of fitness and of rms (mm) below which the iterations stop: ROUGH about 2 um of motion, FINE 0.02 um
ROUGH = 1e-5
FINE = 1e-9


@dataclass
class Icp:
    """Two averaged clouds in mm about `centre`."""

    moving: o3d.geometry.PointCloud  # is brought onto the reference
    reference: o3d.geometry.PointCloud  # with normals
    centre: np.ndarray  # (3,) m
    # mm, added to the limit of the kernel because a partner lies beside the foot of a point
    beside: float

    @classmethod
    def of_clouds(cls, moving: np.ndarray, reference: np.ndarray, spacing: float) -> Icp:
        """points (n, 3) m; spacing: m, the larger one of the two clouds."""
        centre = moving.mean(axis=0)
        voxel = VOXEL * spacing * MM
        target = _averaged(reference - centre, voxel)
        target.estimate_normals(
            o3d.geometry.KDTreeSearchParamHybrid(NORMAL_RADIUS * voxel, NORMAL_POINTS)
        )
        return cls(_averaged(moving - centre, voxel), target, centre, voxel)

    @classmethod
    def of_surface(
        cls, moving: np.ndarray, points: np.ndarray, normals: np.ndarray, spacing: float
    ) -> Icp:
        """The reference is known exactly: points (n, 3) m with normals, as densely as wanted."""
        centre = moving.mean(axis=0)
        voxel = VOXEL * spacing * MM
        reference = _cloud(points - centre)
        reference.normals = o3d.utility.Vector3dVector(normals)
        return cls(_averaged(moving - centre, voxel), reference, centre, voxel)

    @property
    def points(self) -> np.ndarray:
        """(n, 3) m, averaged points of the moving cloud."""
        return np.asarray(self.moving.points) / MM + self.centre

    def align(
        self, start: np.ndarray, limit: float, settled: float, keep: np.ndarray
    ) -> np.ndarray:
        """(4, 4) m. start: (4, 4) first guess; limit: m, of Tukey's kernel; settled: ROUGH or FINE; keep: (n,) bool of
        `points`."""
        registration = o3d.pipelines.registration
        kernel = registration.TukeyLoss(limit * MM)
        found = registration.registration_icp(
            self.moving.select_by_index(np.flatnonzero(keep)),
            self.reference,
            limit * MM + self.beside,
            self._inside(start),
            registration.TransformationEstimationPointToPlane(kernel),
            registration.ICPConvergenceCriteria(settled, settled, ITERATIONS),
        )
        return self._outside(found.transformation)

    def _inside(self, matrix: np.ndarray) -> np.ndarray:
        m = matrix.copy()
        m[:3, 3] = (m[:3, :3] @ self.centre + m[:3, 3] - self.centre) * MM
        return m

    def _outside(self, matrix: np.ndarray) -> np.ndarray:
        m = matrix.copy()
        m[:3, 3] = m[:3, 3] / MM + self.centre - m[:3, :3] @ self.centre
        return m


def _cloud(points: np.ndarray) -> o3d.geometry.PointCloud:
    return o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points * MM))


def _averaged(points: np.ndarray, voxel: float) -> o3d.geometry.PointCloud:
    return _cloud(points).voxel_down_sample(voxel)
