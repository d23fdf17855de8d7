"""A laser line scanner beside the torch: profiles of the true surface with the faults that real ones have.

Frame `scanner`: x_s lateral (work +Y), z_s up, origin at torch_tcp + offset: P_work = tcp + offset + x_s lateral +
z_s up. As drawn the light is a fan in the plane x = const; one that was mounted badly (`delivered_scanner_*`) leans by
some degrees, and its shadows are those of the upright one. The camera looks at the fan from the side of larger x under
the triangulation angle. Points are missing where the camera's or the fan's line of sight is cut off (shadow), outside
the measuring range, often on steep slopes, and now and then anywhere. Lengths in m.

What a profile has of noise, outliers and lost points depends on the seed, on how many scans were made before and on
where the torch is, not on when it came there. So two jobs with one seed see the same, in the laboratory and in the
graph, whose clocks differ by what its computers take.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from waam_node.params import param

from .compiled import STRIDE, bilinear, jit, mixed, normal, random_state, record, uniform
from .placement import METAL, rise
from .variation import NODE, smooth

GRAIN = 0.5e-3  # torch positions nearer than this are one place to the noise
DRAWS = 8  # random numbers that are set aside for a point
NODES = 64  # of the error that scans share, along x and y; it repeats beyond
REFINED = 5  # times that the place of a point of a leaning fan is


@dataclass(frozen=True)
class ScannerParams:
    """Line scanner."""

    offset_x: float = 0.060  # of the scanner from the wire tip along x [m]
    offset_y: float = 0.0  # along y [m]
    offset_z: float = 0.120  # of the scanner above the wire tip [m]
    lateral_x: float = 0.0  # its axes in the work frame, unit vectors
    lateral_y: float = 1.0
    lateral_z: float = 0.0
    up_x: float = 0.0
    up_y: float = 0.0
    up_z: float = 1.0
    fan: float = 0.050  # width of a profile [m]
    points: int = 640  # points of a profile
    rate: float = 100.0  # profiles per second [1/s]
    batch: int = 10  # profiles of a message
    range_near: float = -0.085  # nearest measurable z_s [m]
    range_far: float = -0.165  # farthest measurable z_s [m]
    noise: float = param(3e-5, 'sigma of z on a flat surface', 'm', 0.0, 1e-2)
    noise_length: float = param(
        0.0,
        'along the profile, at which its autocorrelation falls to 1/e; 0 = points differ',
        'm',
        0.0,
        2e-3,
    )
    outliers: float = 0.002  # share of points that are wrong by millimetres
    outlier_size: float = 1.5e-3  # sigma of such an error [m]
    dropout: float = param(0.004, 'share of points lost on a flat surface', '', 0.0, 1.0)
    steep_dropout: float = 0.35  # share of points lost on slopes steeper than 1.5
    triangulation: float = 0.50  # angle between light and camera [rad]
    shared_error: float = param(
        0.0,
        'sigma of an error in z that depends on where the torch is, and returns',
        'm',
        0.0,
        2e-3,
    )
    shared_length: float = 0.04  # distance at which its autocorrelation falls to 1/e [m]
    shared_kept: float = 0.97  # its correlation from one scan to the next


class Scanner:
    """Parameters, lateral coordinates (points,) and where the random numbers come from."""

    def __init__(self, params: ScannerParams, seed: int) -> None:
        """The lateral coordinates span the fan evenly, m."""
        self.shared = np.zeros(
            (NODES, NODES)
        )  # the error that scans share, at its nodes, in sigmas
        self._kept = params.shared_kept if params.shared_error > 0.0 else math.nan
        self._slow = np.random.default_rng([seed & 0xFFFFFFFF, 29])
        self.params = record(params)
        self.lateral = np.linspace(-0.5 * params.fan, 0.5 * params.fan, params.points)
        self.place = np.zeros(3, np.int64)  # of the last profile, in GRAIN; profiles there before
        self.rng = random_state(seed, 2)
        self._seed, self._scans, self._on = seed, 0, False

    def switch(self, on: bool) -> None:
        """A scan begins when the scanner is switched on; its noise has nothing in common with that of other scans."""
        if on and not self._on:
            self._scans += 1
            self.rng = random_state(self._seed, 2, self._scans)
            self.place[:] = 0
            self._change_shared()
        self._on = on

    def _change_shared(self) -> None:
        """Most of the error that scans share stays."""
        if not math.isnan(self._kept):
            kept = self._kept if self._scans > 1 else 0.0
            new = self._slow.standard_normal(self.shared.shape)
            self.shared = kept * self.shared + math.sqrt(1.0 - kept * kept) * new


@jit
def _noise_of(rng, place, x, y):
    """Random state of a profile at a torch position (m) of a scan; `place` (3,) counts the profiles at one place."""
    u, v = round(x / GRAIN), round(y / GRAIN)
    same = u == place[0] and v == place[1]
    place[0], place[1], place[2] = u, v, place[2] + 1 if same else 0
    state = rng[0]
    for k in range(3):
        state = mixed(state + STRIDE + np.uint64(place[k]))
    return state


@jit
def _camera_blocked(z, origin_x, origin_y, cell, x, y, height, top, slope):
    """True when the surface rises into the line of sight from (x, y, height) to the camera on the side of larger x."""
    away = cell
    while height + away * slope < top:
        c = int(math.floor((x + away - origin_x) / cell))
        r = int(math.floor((y - origin_y) / cell))
        if r < 0 or r >= z.shape[0] or c >= z.shape[1]:
            return False
        if c >= 0 and z[r, c] > height + away * slope:
            return True
        away += cell
    return False


@jit
def _reach(heights, lateral, source, hidden, j, widest):
    ray = abs(lateral[j]) / max(source - heights[j], 1e-6)
    if ray < widest - 1e-9:
        hidden[j] = True
    return max(ray, widest)


@jit
def _fan_shadow(heights, lateral, source, hidden):
    """Marks points that the fan from its source cannot reach: nearer to the axis the surface reaches a steeper ray."""
    n = lateral.size
    middle = 0
    while middle < n and lateral[middle] < 0.0:
        middle += 1
    widest = 0.0
    for j in range(middle, n):
        widest = _reach(heights, lateral, source, hidden, j, widest)
    widest = 0.0
    for j in range(middle - 1, -1, -1):
        widest = _reach(heights, lateral, source, hidden, j, widest)


@jit
def _meet(z, origin_x, origin_y, cell, p, tcp_x, tcp_y, source, s, out):
    """Where the ray at the lateral coordinate s (m) meets the surface: x, y, height, z_s into `out` (4,); source:
    height of the scanner. A fan that leans is followed from the height under its last guess, REFINED times."""
    leans = p.up_x != 0.0 or p.up_y != 0.0
    z_s = -source if leans else 0.0
    for _ in range(REFINED if leans else 1):
        out[0] = tcp_x + p.offset_x + p.lateral_x * s + p.up_x * z_s
        out[1] = tcp_y + p.offset_y + p.lateral_y * s + p.up_y * z_s
        out[2] = bilinear(z, origin_x, origin_y, cell, out[0], out[1], 0.0)
        z_s = (out[2] - source - p.lateral_z * s) / p.up_z
    out[3] = z_s


@jit
def _read(p, z_s, steep, lost, point, sigma):
    """What a point at z_s (m) reads, NaN = lost; steep: slope; lost: share; point: (1,) random state of its own; sigma:
    of noise that differs from point to point, on a flat surface."""
    u = uniform(point)
    error = sigma * (1.0 + 0.5 * min(steep, 4.0)) * normal(point)
    if u < lost or z_s < p.range_far or z_s > p.range_near:
        return math.nan
    return z_s + error + (p.outlier_size * normal(point) if u > 1.0 - p.outliers else 0.0)


@jit
def _add_noise_along(p, noise, lateral, slopes, out):
    """Noise that is correlated along the profile; noise: random state of the profile; slopes (points,)."""
    for j in range(out.size):
        sigma = p.noise * (1.0 + 0.5 * min(slopes[j], 4.0))
        out[j] += sigma * smooth(noise, 0, lateral[j] - lateral[0], p.noise_length)


@jit
def shared_error(nodes, u, v):
    """Unit-variance smooth error of scans at node coordinates u (x), v (y); nodes: (64, 64)."""
    iu, iv = int(math.floor(u)), int(math.floor(v))
    fu, fv = u - iu, v - iv
    fu, fv = fu * fu * (3.0 - 2.0 * fu), fv * fv * (3.0 - 2.0 * fv)
    r0, r1, c0, c1 = iv & 63, (iv + 1) & 63, iu & 63, (iu + 1) & 63
    low = (1.0 - fu) * nodes[r0, c0] + fu * nodes[r0, c1]
    high = (1.0 - fu) * nodes[r1, c0] + fu * nodes[r1, c1]
    power = (fu * fu + (1.0 - fu) ** 2) * (fv * fv + (1.0 - fv) ** 2)
    return ((1.0 - fv) * low + fv * high) / math.sqrt(power)


@jit
def profile(
    z,
    origin_x,
    origin_y,
    cell,
    top,
    hot,
    kept,
    placed,
    placed_state,
    p,
    lateral,
    rng,
    place,
    shared,
    tcp_x,
    tcp_y,
    tcp_z,
    extra_dropout,
    out,
    intensity,
):
    """One profile at a torch position (m, work frame) into `out` (points,): z_s, NaN = no return; intensity 0..1.

    `top`: an upper bound of all heights; the table (height 0) goes on beyond the field. `hot` to `placed_state`: how
    the part lies (placement.py); shadows are those of a part that lies as scanned.
    """
    n = lateral.size
    noise, point = _noise_of(rng, place, tcp_x, tcp_y), np.empty(1, np.uint64)
    source = tcp_z + p.offset_z
    off = 0.0
    if p.shared_error > 0.0:
        nodes = NODE / p.shared_length
        off = p.shared_error * shared_error(shared, tcp_x * nodes, tcp_y * nodes)
    met = np.empty((n, 4))
    hidden = np.zeros(n, np.bool_)
    for j in range(n):
        _meet(
            z=z, origin_x=origin_x, origin_y=origin_y, cell=cell, p=p, tcp_x=tcp_x, tcp_y=tcp_y, source=source,
            s=lateral[j], out=met[j],
        )  # fmt: skip
    heights = met[:, 2].copy()
    _fan_shadow(heights, lateral, source, hidden)
    slope = 1.0 / math.tan(p.triangulation)
    smoothed = p.noise_length > 0.0
    slopes = np.empty(n if smoothed else 0)
    sigma = 0.0 if smoothed else p.noise
    for j in range(n):
        x, y = met[j, 0], met[j, 1]
        z_s = met[j, 3] + off
        if heights[j] > METAL:
            z_s += rise(hot, kept, placed, placed_state, x, y)
        a, b = max(j - 1, 0), min(j + 1, n - 1)
        across = (heights[b] - heights[a]) / (lateral[b] - lateral[a])
        ahead = bilinear(z, origin_x, origin_y, cell, x + cell, y, 0.0)
        along = (ahead - heights[j]) / cell
        steep = math.hypot(across, along)
        lost = (
            p.dropout + extra_dropout + (p.steep_dropout - p.dropout) * min(steep / 1.5, 1.0) ** 2
        )
        intensity[j] = 0.9 / (1.0 + steep * steep)
        point[0] = noise + np.uint64(DRAWS * j) * STRIDE
        out[j] = math.nan if hidden[j] else _read(p, z_s, steep, lost, point, sigma)
        if smoothed:
            slopes[j] = steep
        eye = heights[j] + 0.5 * cell * slope
        if not math.isnan(out[j]) and _camera_blocked(
            z=z, origin_x=origin_x, origin_y=origin_y, cell=cell, x=x, y=y, height=eye, top=top, slope=slope,
        ):  # fmt: skip
            out[j] = math.nan
    if smoothed:
        _add_noise_along(p, noise, lateral, slopes, out)
