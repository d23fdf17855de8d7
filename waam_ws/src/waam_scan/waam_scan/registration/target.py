"""What a cloud is registered to: another cloud, or a mesh. Both say where the surface is nearest to a point."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
import open3d as o3d
from scipy.spatial import cKDTree

from .icp import Icp

NEIGHBOURS = 24  # points of a local plane
REFERENCE_POINTS = 400_000  # more are thinned out
SURFACE_POINTS = 400_000  # on a mesh
STRAY = 3.0  # a point this many times further from its 5th neighbour than usual is a stray
ROUGH = 25.0  # variance across the local plane against the usual one from which there is no plane
EVEN = 0.25  # smaller to larger variance within the local plane below which scan lines lie too far apart
FLAT = 0.2  # of a mesh: sideways share of the distance from which the foot lies on an edge


@dataclass(frozen=True)
class Match:
    """Where a surface is nearest to n points."""

    foot: np.ndarray  # (n, 3) m, nearest place on the surface
    normal: np.ndarray  # (n, 3) its outward normal
    ok: np.ndarray  # (n,) bool, whether it is one


class Target(Protocol):
    """A surface that a cloud is registered to."""

    noise: float  # m, scatter of the surface itself
    exact: bool  # its normals carry no noise

    def match(self, p: np.ndarray) -> Match:
        """The nearest place on the surface to points (n, 3) m."""

    def icp(self, moving: Cloud) -> Icp:
        """The clouds for the iterative estimate that brings `moving` here."""


@dataclass(frozen=True)
class Cloud:
    """Points with their local planes."""

    points: np.ndarray  # (n, 3) m
    normals: np.ndarray  # (n, 3) unit vectors, z up
    noise: float  # m, robust scatter of points about their local planes
    spacing: float  # m, typical distance between neighbours

    @classmethod
    def of(cls, points: np.ndarray, limit: int = REFERENCE_POINTS, seed: int = 0) -> Cloud:
        """Local planes by principal components of the nearest points (Open3D). ValueError for unusable clouds."""
        p = np.asarray(points, float)
        if p.ndim != 2 or p.shape[1] != 3:
            raise ValueError(f'a cloud is (n, 3) points, not {p.shape}')
        p = p[np.isfinite(p).all(axis=1)]
        if len(p) < 4 * NEIGHBOURS:
            raise ValueError(f'a cloud of {len(p)} points is too small to register')
        if len(p) > 2 * limit:
            p = p[np.sort(np.random.default_rng(seed).choice(len(p), 2 * limit, replace=False))]
        p = evened(without_strays(p), seed)
        if len(p) > limit:
            p = p[np.sort(np.random.default_rng(seed).choice(len(p), limit, replace=False))]
        normals, smallest = local_planes(p)
        # elsewhere: edges, and strays among the neighbours
        flat = smallest < ROUGH * np.median(smallest)
        noise = np.sqrt(np.median(smallest) * NEIGHBOURS / (NEIGHBOURS - 3))
        return cls(p[flat], normals[flat], float(noise), spacing(p, seed))

    def take(self, count: int, rng: np.random.Generator) -> Cloud:
        """At most `count` of the points, drawn evenly; noise and spacing stay those of the whole."""
        if len(self.points) <= count:
            return self
        pick = np.sort(rng.choice(len(self.points), count, replace=False))
        return Cloud(self.points[pick], self.normals[pick], self.noise, self.spacing)


def without_strays(points: np.ndarray) -> np.ndarray:
    """Leaves out points that stand alone: specular spikes and spatter in the air would tilt the planes around them.

    points: (n, 3) m. Points that share a small cube with five others have their neighbours; only the rest are asked.
    """
    tree = cKDTree(points)
    few = points[:: 1 + len(points) // 5000]
    limit = STRAY * float(np.median(tree.query(few, k=6)[0][:, 5]))
    if limit == 0.0:
        return points
    cube = np.floor((points - points.min(axis=0)) / (limit / np.sqrt(3))).astype(np.int64)
    _, columns, layers = cube.max(axis=0) + 1
    number = (cube[:, 0] * columns + cube[:, 1]) * layers + cube[:, 2]
    _, own, count = np.unique(number, return_inverse=True, return_counts=True)
    keep = count[own] > 5
    asked = np.flatnonzero(~keep)
    away = tree.query(points[asked], k=6, distance_upper_bound=limit, workers=2)[0][:, 5]
    keep[asked] = np.isfinite(away)
    return points[keep]


def evened(points: np.ndarray, seed: int = 0) -> np.ndarray:
    """Thins points (n, 3) m of profiles that are denser along the line than across, until neighbours lie all around."""
    if _evenness(points, seed) > EVEN:
        return points
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector(points * 1e3))
    cell = 1e3 * spacing(points, seed)
    for _ in range(8):
        p = np.asarray(cloud.points)
        if len(p) < 8 * NEIGHBOURS or _evenness(p, seed) > EVEN:
            break
        cell *= 1.5
        cloud = cloud.voxel_down_sample(cell)
    return np.asarray(cloud.points) * 1e-3


def _evenness(p: np.ndarray, seed: int) -> float:
    """Median ratio of the two larger variances of the nearest points of a few places."""
    few = np.random.default_rng(seed).choice(len(p), min(len(p), 500), replace=False)
    near = p[_tree(p).query(p[few], k=NEIGHBOURS)[1]]
    near = near - near.mean(axis=1, keepdims=True)
    values = np.linalg.eigvalsh(np.einsum('nki,nkj->nij', near, near))
    return float(np.median(values[:, 1] / np.maximum(values[:, 2], 1e-30)))


def local_planes(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unit normals (n, 3), z up, and smallest variance (n,) in m2 of the NEIGHBOURS nearest points of each."""
    centre = points.mean(axis=0)
    cloud = o3d.geometry.PointCloud(o3d.utility.Vector3dVector((points - centre) * 1e3))
    cloud.estimate_covariances(o3d.geometry.KDTreeSearchParamKNN(NEIGHBOURS))
    cloud.estimate_normals()  # from these covariances
    normals, spread = np.array(cloud.normals), np.asarray(cloud.covariances)
    normals *= np.where(normals[:, 2:] < 0, -1.0, 1.0)
    smallest = np.einsum('ni,nij,nj->n', normals, spread, normals)
    return normals, np.maximum(smallest, 0.0) * 1e-6


def spacing(points: np.ndarray, seed: int = 0) -> float:
    """Median distance to the nearest other point, m."""
    few = np.random.default_rng(seed).choice(len(points), min(len(points), 5000), replace=False)
    return float(np.median(_tree(points).query(points[few], k=2)[0][:, 1]))


def _tree(points: np.ndarray) -> cKDTree:
    """For few questions: built in a quarter of the time, answers a little slower."""
    return cKDTree(points, compact_nodes=False, balanced_tree=False)


class CloudTarget:
    """The nearest point of a reference cloud, and its local plane."""

    exact = False

    def __init__(self, cloud: Cloud) -> None:
        self.cloud, self.noise = cloud, cloud.noise
        self._tree = cKDTree(cloud.points)
        # in a sampled plane the nearest point lies within the diagonal of a cell; scan lines may be further apart
        self._sideways = 3.0 * cloud.spacing

    def match(self, p: np.ndarray) -> Match:
        """The nearest reference point to p (n, 3) m; ok where p lies over its neighbourhood, not beyond the rim of the
        cloud."""
        _, i = self._tree.query(p, workers=2)
        foot, normal = self.cloud.points[i], self.cloud.normals[i]
        away = p - foot
        along = np.einsum('ij,ij->i', away, normal)
        sideways = np.linalg.norm(away - along[:, None] * normal, axis=1)
        return Match(foot, normal, sideways < self._sideways + FLAT * np.abs(along))

    def icp(self, moving: Cloud) -> Icp:
        """Open3D's registration of a cloud to this one."""
        spacing = max(moving.spacing, self.cloud.spacing)
        return Icp.of_clouds(moving.points, self.cloud.points, spacing)


class MeshTarget:
    """The nearest point of a triangle mesh: triangles (n, 3, 3) in m, outward by the right-hand rule."""

    exact = True
    noise = 0.0

    def __init__(self, triangles: np.ndarray) -> None:
        t = np.asarray(triangles, float)
        self._centre = t.reshape(-1, 3).mean(axis=0)
        vertices = ((t.reshape(-1, 3) - self._centre) * 1e3).astype(np.float32)
        faces = np.arange(len(vertices), dtype=np.uint32).reshape(-1, 3)
        self._mesh = o3d.geometry.TriangleMesh(
            o3d.utility.Vector3dVector(vertices.astype(float)),
            o3d.utility.Vector3iVector(faces.astype(np.int32)),
        )
        self._mesh.compute_triangle_normals()
        self._scene = o3d.t.geometry.RaycastingScene(nthreads=2)
        self._scene.add_triangles(o3d.core.Tensor(vertices), o3d.core.Tensor(faces))

    def match(self, p: np.ndarray) -> Match:
        """The nearest place on the triangles to p (n, 3) m; ok where p lies above a face, not beside an edge."""
        q = ((p - self._centre) * 1e3).astype(np.float32)
        found = self._scene.compute_closest_points(o3d.core.Tensor(q))
        foot = found['points'].numpy().astype(float) * 1e-3 + self._centre
        normal = found['primitive_normals'].numpy().astype(float)
        normal /= np.maximum(np.linalg.norm(normal, axis=1), 1e-12)[:, None]
        away = p - foot
        along = np.einsum('ij,ij->i', away, normal)
        sideways = np.linalg.norm(away - along[:, None] * normal, axis=1)
        return Match(foot, normal, sideways < 2e-6 + FLAT * np.abs(along))

    def icp(self, moving: Cloud) -> Icp:
        """Open3D's registration of a cloud to points on the mesh."""
        o3d.utility.random.seed(0)
        points = self._mesh.sample_points_uniformly(SURFACE_POINTS, use_triangle_normal=True)
        places = np.asarray(points.points) * 1e-3 + self._centre
        return Icp.of_surface(moving.points, places, np.asarray(points.normals), moving.spacing)
