"""A simulated line scanner over simple bodies, for tests and benchmarks.

On purpose it shares nothing with the estimator: rays from the scanner's origin are cut with triangles and spheres,
poses come from a motion in closed form, the mounting is built from a quaternion.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from waam_scan.calibration.scan_pass import Pass


def quaternion_matrix(rpy) -> np.ndarray:
    """Rotation of roll, pitch, yaw (rad, fixed axes) by way of quaternions."""
    half = np.array(rpy) / 2
    (cr, cp, cy), (sr, sp, sy) = np.cos(half), np.sin(half)
    w, x = cr * cp * cy + sr * sp * sy, sr * cp * cy - cr * sp * sy
    y, z = cr * sp * cy + sr * cp * sy, cr * cp * sy - sr * sp * cy
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def pyramid_triangles(top, height, slopes) -> np.ndarray:
    """(n, 3, 3) m: truncated pyramid centred on the origin, foot on z = 0."""
    hx, hy = top[0] / 2, top[1] / 2
    gx, gy = hx + height / np.tan(slopes[0]), hy + height / np.tan(slopes[1])
    a = [np.array([sx * hx, sy * hy, height]) for sx, sy in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
    b = [np.array([sx * gx, sy * gy, 0.0]) for sx, sy in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
    faces = [(a[0], a[1], a[2]), (a[0], a[2], a[3])]
    for i in range(4):
        j = (i + 1) % 4
        faces += [(a[i], b[i], b[j]), (a[i], b[j], a[j])]
    return np.array(faces)


@dataclass(frozen=True)
class World:
    """triangles (n, 3, 3) and spheres (k, 4: centre, radius), m, work frame; the table is z = 0."""

    triangles: np.ndarray
    spheres: np.ndarray


def block_world(top, height, slopes, position, yaw) -> World:
    t = pyramid_triangles(top, height, slopes)
    c, s = np.cos(yaw), np.sin(yaw)
    return World(
        t @ np.array([[c, s, 0], [-s, c, 0], [0, 0, 1]]) + np.asarray(position), np.empty((0, 4))
    )


def nearest_hit(world: World, origin: np.ndarray, rays: np.ndarray) -> np.ndarray:
    """(m,) m along unit rays (m, 3) from origin to the first surface; inf = none."""
    best = np.where(rays[:, 2] < -1e-9, -origin[2] / np.minimum(rays[:, 2], -1e-9), np.inf)
    for a, b, c in world.triangles:  # Moeller and Trumbore 1997
        e1, e2 = b - a, c - a
        h = np.cross(rays, e2)
        det = h @ e1
        with np.errstate(divide='ignore', invalid='ignore'):
            f = 1.0 / det
            u = f * (h @ (origin - a))
            q = np.cross(origin - a, e1)
            v = f * (rays @ q)
            t = f * (e2 @ q)
        hit = (np.abs(det) > 1e-15) & (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)
        best = np.where(hit, np.minimum(best, np.where(hit, t, np.inf)), best)
    for x, y, z, r in world.spheres:
        m = origin - np.array([x, y, z])
        half = rays @ m
        disc = half**2 - (m @ m - r * r)
        t = -half - np.sqrt(np.maximum(disc, 0))
        best = np.where((disc > 0) & (t > 0), np.minimum(best, t), best)
    return best


def line(start, end, speed, quiet=0.3):
    """Positions over time of a straight motion with a rest before and after it; (function of t, duration)."""
    start, end = np.array(start, float), np.array(end, float)
    length = np.linalg.norm(end - start)
    duration = length / speed

    def at(t):
        share = np.clip((np.asarray(t) - quiet) / duration, 0, 1)
        return start + share[:, None] * (end - start)

    return at, duration + 2 * quiet


def scan(
    world: World,
    motion,
    offset,
    rpy,
    delay,
    rng,
    *,
    rate=100.0,
    points=160,
    fan=0.40,
    noise=30e-6,
    spikes=0.01,
    dropouts=0.05,
    pose_noise=0.0,
    name='pass',
) -> Pass:
    """One pass as a recording. The profile stamped s was really taken at s + delay."""
    at, duration = motion
    rotation = quaternion_matrix(rpy)
    taken = np.arange(0.15, duration - 0.15, 1 / rate)
    angles = np.linspace(-fan / 2, fan / 2, points)
    local = np.column_stack([np.sin(angles), np.zeros(points), -np.cos(angles)])
    rays = local @ rotation.T
    x, z = np.empty((2, len(taken), points))
    for i, tcp in enumerate(at(taken)):
        reach = nearest_hit(world, tcp + offset, rays)
        x[i], z[i] = reach * local[:, 0], reach * local[:, 2]
    z += noise * rng.standard_normal(z.shape)
    spiked = rng.random(z.shape) < spikes
    z[spiked] += rng.uniform(-5e-3, 5e-3, int(spiked.sum()))
    z[(rng.random(z.shape) < dropouts) | ~np.isfinite(z)] = np.nan
    x[~np.isfinite(z)] = np.nan
    base = 1_700_000_000_000_000_000
    pose_t = np.arange(0, duration + 1e-9, 0.01) + 0.0031
    poses = at(pose_t) + pose_noise * rng.standard_normal((len(pose_t), 3))
    stamps = base + np.round((taken - delay) * 1e9).astype(np.int64)
    return Pass(stamps, x, z, base + np.round(pose_t * 1e9).astype(np.int64), poses, name)


def passes_over(
    world: World, target, offset, rpy, delay, rng, *, lines=None, **options
) -> list[Pass]:
    """Passes over `target` (x, y; m): both ways along x and across, at two heights and speeds, as a shop would."""
    lines = STANDARD if lines is None else lines
    x0, y0 = target[0] - offset[0], target[1] - offset[1]
    found = []
    for k, (dx, dy, side_x, side_y, z, speed) in enumerate(lines):
        start = (x0 + side_x - dx / 2, y0 + side_y - dy / 2, z)
        end = (x0 + side_x + dx / 2, y0 + side_y + dy / 2, z)
        found.append(
            scan(
                world, line(start, end, speed), offset, rpy, delay, rng, name=f'pass_{k}', **options
            )
        )
    return found


# way along x and y (m), shift sideways (m), height of the wire tip (m), speed (m/s)
STANDARD = (
    (0.06, 0.0, 0.0, 0.0, 0.020, 0.020),
    (-0.06, 0.0, 0.0, 0.004, 0.035, 0.030),
    (0.0, 0.06, 0.0, 0.0, 0.025, 0.020),
    (0.0, -0.06, 0.003, 0.0, 0.035, 0.030),
    (0.06, 0.0, 0.0, -0.005, 0.045, 0.040),
)
ONE_WAY = (STANDARD[0],)
