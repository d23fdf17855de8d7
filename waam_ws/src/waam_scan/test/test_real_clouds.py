"""Clouds and parts made by others: registration works on real metal."""

from pathlib import Path

import numpy as np
import pytest
import registration_sim as sim

from waam_process.grid import GridSpec
from waam_scan.registration.clouds import load_points, load_triangles
from waam_scan.registration.compare import top_heights
from waam_scan.registration.search import search_placement
from waam_scan.registration.solve import register
from waam_scan.registration.target import Cloud, MeshTarget

DATA = Path(__file__).resolve().parents[5] / 'shared/data'
WALL = DATA / 'wall_scan' / 'x_1610_cloud.pcd'
MESH = DATA / 'meshes' / 'distorted_v_closed_mid_res.stl'
needs_wall = pytest.mark.skipif(not WALL.is_file(), reason=f'no cloud at {WALL}')
needs_mesh = pytest.mark.skipif(not MESH.is_file(), reason=f'no mesh at {MESH}')


@needs_wall
@pytest.mark.parametrize('grown', [False, True])
def test_drift_is_recovered_on_a_real_wall(grown):
    """One half of the points against the other half, moved; with a new layer of 2 mm on half of the wall."""
    rng = np.random.default_rng(1)
    points = load_points(WALL)
    first = rng.random(len(points)) < 0.5
    middle = points.mean(axis=0)
    rotation, translation = sim.drift(rng, about=middle)
    new = points[~first].copy()
    if grown:
        new[(new[:, 2] > 8e-3) & (new[:, 0] < 0), 2] += 2e-3
    r = register(new @ rotation.T + translation, points[first])
    shift, turn = sim.error(r.rotation, r.translation, rotation, translation, middle)
    assert not r.unobserved
    assert np.linalg.norm(shift) < 30e-6 and np.linalg.norm(turn) < np.radians(0.03)


@needs_mesh
def test_a_real_part_is_found_anywhere_on_the_table():
    triangles = load_triangles(MESH)
    low, high = triangles.reshape(-1, 3).min(axis=0), triangles.reshape(-1, 3).max(axis=0)
    spec = GridSpec.covering(*low[:2], *high[:2], float(np.ptp(triangles[..., 0])) / 130)
    x, y = np.meshgrid(spec.x, spec.y)
    points = np.column_stack([x.ravel(), y.ravel(), top_heights(triangles, spec).ravel()])
    points = points[np.isfinite(points).all(axis=1)]
    rng = np.random.default_rng(2)
    points[:, 2] += 20e-6 * rng.standard_normal(len(points))
    c, s = np.cos(0.7), np.sin(0.7)
    turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    cloud = Cloud.of(points @ turn.T + [0.2, -0.1, 0.05])
    target = MeshTarget(triangles)
    start, _ = search_placement(cloud, target, triangles.reshape(-1, 3))
    r = register(cloud, target, 'any', start=start)
    error = r.apply(points @ turn.T + [0.2, -0.1, 0.05]) - points
    assert np.median(np.linalg.norm(error, axis=1)) < 50e-6
