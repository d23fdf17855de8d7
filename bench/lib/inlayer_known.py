"""What could be known of a layer's metal while it is laid, and what that would be worth.

`Knowing` is a cell of the laboratory that takes out of the metal's disturbance what somebody could know of it by then:
the disturbance is a lattice of independent numbers (waam_sim.disturbance), and every place of a bead that was seen is
an exact linear sum of eight of them. A Kalman filter over the lattice tells what follows for the metal still to come,
and that much less of the disturbance is left there: as if setpoints could take out all that is known, at once. So its
RMS is a bound for every estimator with the same sight, the filter's own noise (SIGMA) apart.

`Foretold` looks at the growth itself, misfit of the bead model included: how much of a layer's deviation from the metal
asked for follows from its neighbours that were finished before.
"""

from __future__ import annotations

import itertools
import math
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.ndimage import gaussian_filter
from scipy.spatial import cKDTree

from waam_job.model.seen import NEAR, Reach
from waam_lab.cell import LabCell
from waam_process.segment import Kind, Segment

LAST_LAYER = 7  # of the demo's jaw
# of the disturbance, what a place that was seen is uncertain by; profiles beside the arc: 1 % of the height
SIGMA = 0.2
NOTE, LEARN = 10, 100  # exchanges (10 ms) between two places of a bead, and between two answers
ABREAST = 2e-3  # m along x within which a place is on the scanner's line
OFFSET, FAN = 0.060, 0.050  # m, of PlanSettings: scanner_offset along x, scanner_fov
STEP = 1e-3  # m between the points of a path
CHANNELS = 3  # area that returns in every layer, area of the layer, width
SPREADS = (0.6, 1.2, 2.4)  # bead widths over which neighbours are asked


@dataclass(frozen=True)
class Sight:
    """Who looks at the layer. everything: knows all of it before it is laid. at_once: sees a bead as soon as it is
    laid; otherwise metal is seen once no later bead comes near it. mounted: only where the
    cell's scanner passes over it. delay: s from seeing to the metal that can still be set. first: layer from
    which somebody looks at all."""

    everything: bool = False
    at_once: bool = False
    mounted: bool = False
    delay: float = 0.0
    first: int = 1


@dataclass(frozen=True)
class Known:
    """One job. rms: m at the end; by_layer: m; share: 0..1 of the variance of the bead area that was known."""

    seed: int
    rms: float
    by_layer: tuple[float, ...]
    share: float


class Lattice:
    """What is known of the disturbance's numbers: mean (3, n) and covariance (n, n) of those that were met."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        self.shape, self.nodes = shape, np.zeros(0, np.int64)
        self.mean, self.cov = np.zeros((CHANNELS, 0)), np.zeros((0, 0))

    def weights(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Numbers of the nodes (n, 8) and their weights (n, 8) of places (n, 3) in lattice coordinates u, v, w."""
        low = np.floor(places)
        part = places - low
        part = part * part * (3 - 2 * part)
        nodes, weights = [], []
        for k in range(8):
            up = np.array([k & 1, k >> 1 & 1, k >> 2])
            at = (low.astype(np.int64) + up) & (self.shape[0] - 1)
            nodes.append((at[:, 2] * self.shape[1] + at[:, 1]) * self.shape[2] + at[:, 0])
            weights.append(np.prod(np.where(up, part, 1 - part), axis=1))
        w = np.stack(weights, axis=1)
        return np.stack(nodes, axis=1), w / np.sqrt((w**2).sum(axis=1, keepdims=True))

    def learn(self, places: np.ndarray, true: np.ndarray) -> None:
        """Places (n, 3) were seen. true: (3, nodes) the disturbance's numbers."""
        nodes, weights = self.weights(places)
        new = np.setdiff1d(nodes, self.nodes)
        self.nodes = np.concatenate([self.nodes, new])
        self.mean = np.pad(self.mean, ((0, 0), (0, len(new))))
        n = len(self.nodes)
        cov = np.eye(n)
        cov[: n - len(new), : n - len(new)] = self.cov
        where = np.argsort(self.nodes)
        index = where[np.searchsorted(self.nodes, nodes, sorter=where)]
        for i, node, w in zip(index, nodes, weights, strict=True):
            gain = cov[:, i] @ w
            gain /= gain[i] @ w + SIGMA**2
            self.mean += np.outer(true[:, node] @ w - self.mean[:, i] @ w, gain)
            cov -= np.outer(gain, w @ cov[i])
        self.cov = cov


class Knowing(LabCell):
    """Lays every layer without what `sight` could know of its disturbance."""

    def __init__(self, sight: Sight, *args) -> None:
        self.sight, self.layers, self._layer, self._ticks = sight, {}, 0, 0
        self.sums = np.zeros(2)  # of the squares of area: disturbance, and what was not known of it
        super().__init__(*args)
        plant = self.device.plant
        self._values = plant._lattice
        self._true = self._values.reshape(CHANNELS, -1).copy()
        p = plant.params.metal
        self._unit = np.array([p.noise_length, p.noise_length, p.noise_height])
        self._area = np.array([p.area_noise_fixed, p.area_noise_layer, 0.0])

    def plan(self, job_id, layer, segments):
        super().plan(job_id, layer, segments)
        self.layers[layer] = list(segments)
        self._begin(layer)

    def status(self, status):
        super().status(status)
        if self._layer and not self._stats.layer:
            self._layer = 0
            self._left(self._true)

    def _begin(self, layer: int) -> None:
        """Nothing is known of a new layer, unless everything is."""
        self._layer, looked = layer, layer >= self.sight.first
        self._left(self._true * (0 if looked and self.sight.everything else 1))
        self._looks = looked and not self.sight.everything
        self._lattice, self._places = Lattice(self._values.shape[1:]), np.zeros((0, 3))
        self._last, self._seen = np.zeros(0, np.int64), np.zeros(0)
        points, self._index = points_of(self.layers[layer])
        self._paths = cKDTree(points)
        self._near = NEAR * next(s for s in self.layers[layer] if s.kind == Kind.DEPOSIT).width

    def _left(self, values: np.ndarray) -> None:
        self._values[:] = values.reshape(self._values.shape)

    def _on_exchange(self, samples, plant):
        super()._on_exchange(samples, plant)
        self._ticks += 1
        if not self._layer or self._ticks % NOTE:
            return
        x, y, z = plant._last
        if plant.arc_on:
            self._note(plant.metal.state[0], z)
        if self._looks:
            self._look(x, y)
            if self._ticks % LEARN == 0:
                self._learn()

    def _note(self, pool, z: float) -> None:
        place = np.array([pool['pool_x'], pool['pool_y'], z])
        near = self._index[self._paths.query_ball_point(place[:2], self._near)]
        self._places = np.vstack([self._places, place])
        self._last = np.append(self._last, near.max() if len(near) else 0)
        self._seen = np.append(self._seen, self.now() if self.sight.at_once else np.inf)
        nodes, weights = Lattice(self._values.shape[1:]).weights((place / self._unit)[None])
        now = self._values.reshape(CHANNELS, -1)
        for k, values in enumerate((self._true, now)):
            self.sums[k] += float(self._area @ (values[:, nodes[0]] @ weights[0])) ** 2

    def _look(self, x: float, y: float) -> None:
        fresh = np.isinf(self._seen) & (self._last <= self._view.executed)
        if self.sight.mounted:
            fresh &= np.abs(self._places[:, 0] - x - OFFSET) <= ABREAST
            fresh &= np.abs(self._places[:, 1] - y) <= FAN / 2
        self._seen[fresh] = self.now()

    def _learn(self) -> None:
        known = self._seen + self.sight.delay <= self.now()
        if not known.any():
            return
        self._lattice.learn(self._places[known] / self._unit, self._true)
        self._places, self._last, self._seen = (
            a[~known] for a in (self._places, self._last, self._seen)
        )
        left = self._true.copy()
        left[:, self._lattice.nodes] -= self._lattice.mean
        self._left(left)


def points_of(segments: Sequence[Segment]) -> tuple[np.ndarray, np.ndarray]:
    """(n, 2) m on the paths of the deposits and the index (n,) of the segment that each belongs to."""
    points, index = [], []
    for s in (s for s in segments if s.kind == Kind.DEPOSIT):
        n = max(1, math.ceil(s.length / STEP))
        a, b = np.array(s.start[:2]), np.array(s.end[:2])
        points.append(a + (np.arange(n)[:, None] + 0.5) / n * (b - a))
        index += [s.index] * n
    return np.concatenate(points), np.array(index, np.int64)


def jaw(seed: int, **options):
    """The demo's jaw as bench_shape.jaw_jobs has it."""
    from waam_bringup.paths import share
    from waam_lab import restore

    parts = share('waam_bringup') / 'parts'
    files = parts / 'jaw_nominal.stl', parts / 'jaw_worn.stl'
    return restore(*files, seed, tolerance=0.2e-3, **options)


def run(sight: Sight, job) -> tuple[Knowing, object]:
    """The cell and the result of a job in it. RuntimeError with the message of a job that failed."""
    from waam_lab import laboratory

    made = []

    def cell(*args):
        made.append(Knowing(sight, *args))
        return made[-1]

    kept, laboratory.LabCell = laboratory.LabCell, cell
    try:
        result = laboratory.run(job)
    finally:
        laboratory.LabCell = kept
    if result.failed:
        raise RuntimeError(f'seed {job.seed}: {result.message}')
    return made[0], result


def of_seed(sight: Sight, seed: int) -> Known:
    """The jaw of a seed."""
    cell, result = run(sight, jaw(seed))
    disturbed, unknown = cell.sums
    return Known(seed, result.rms, result.layer_rms, 1 - unknown / disturbed)


@dataclass(frozen=True)
class Foretold:
    """Sums over the cells of a layer, m2: of the squares of d, what its surface is off by from what it should be then
    (against target) or its growth from the metal asked for (against asked), less the mean of either; and by (against,
    mounted, spread) of p d and p2, p: what finished neighbours say of d."""

    layer: int
    squares: dict[str, float]
    said: dict[tuple[str, bool, float], tuple[float, float]]


def usual(seed: int, delay: float) -> tuple[Known, list[Foretold]]:
    """The jaw of a seed where nobody looks, and every layer of it. delay: s from finished metal to metal that can be
    set by it."""
    from waam_job.store.folder import JobFolder

    with tempfile.TemporaryDirectory() as scratch:
        cell, result = run(Sight(first=99), jaw(seed, keep=True, jobs_dir=Path(scratch)))
        folder = JobFolder.open(result.folder)
        maps = [folder.read_map(n) for n in range(folder.last_map() + 1)]
    layers = [
        _of_layer(n, cell.layers[n], *pair, delay)
        for n, pair in enumerate(zip(maps, maps[1:], strict=False), start=1)
    ]
    return Known(seed, result.rms, result.layer_rms, 0.0), layers


def _of_layer(number: int, segments: list[Segment], before, after, delay: float) -> Foretold:
    from waam_process.grid import GridSpec

    x0, y0 = (float(v) for v in before['origin'])
    spec = GridSpec(x0, y0, float(before['resolution']), *before['z'].shape)
    width = next(s.width for s in segments if s.kind == Kind.DEPOSIT)
    reach = Reach.of(segments, spec, width)
    inside = (before['planned'] > 0) & after['interior']
    first = segments[0].index
    end = np.cumsum([s.duration for s in segments])
    laid, finished = (end[np.maximum(i - first, 0)] for i in (reach.nearest, reach.last))
    seen = {False: finished, True: _passed(segments, end, spec, finished)}
    wanted = {'target': after['target'], 'asked': before['z'] + before['asked']}
    squares, said = {}, {}
    for against, surface in wanted.items():
        d = after['z'] - surface
        d = np.where(np.isfinite(d) & (reach.last >= 0), d, 0.0)
        d -= d[inside].mean()
        squares[against] = float((d[inside] ** 2).sum())
        for mounted, spread in itertools.product((False, True), SPREADS):
            sigma = spread * width / spec.resolution
            p = _neighbours(d, inside, laid, seen[mounted] + delay, sigma)
            sums = float((p * d)[inside].sum()), float((p**2)[inside].sum())
            said[against, mounted, spread] = sums
    return Foretold(number, squares, said)


def _passed(segments, end, spec, finished: np.ndarray) -> np.ndarray:
    """(rows, cols) s at which the mounted scanner first passes over a cell that is finished; inf = never."""
    out = np.full(spec.shape, np.inf)
    x, y = spec.x[None], spec.y[:, None]
    for s, t in zip(segments, end, strict=True):
        low, high = sorted((s.start[0] + OFFSET, s.end[0] + OFFSET))
        over = (x >= low - 5e-4) & (x <= high + 5e-4) & (np.abs(y - s.midpoint[1]) <= FAN / 2)
        over &= (finished <= t) & np.isinf(out)
        out[over] = t
    return out


def _neighbours(deviation, inside, laid, known, sigma: float) -> np.ndarray:
    """(rows, cols) m: mean of the deviation around a cell that was known when the cell was laid, less where little
    was."""
    out = np.zeros(deviation.shape)
    times = np.unique(np.quantile(laid[inside], np.linspace(0, 1, 41)))
    for t0, t1 in zip(times, times[1:], strict=False):
        now = inside & (laid > t0) & (laid <= t1)
        have = inside & (known <= t0)
        if not now.any() or not have.any():
            continue
        share = gaussian_filter(have.astype(float), sigma)
        total = gaussian_filter(np.where(have, deviation, 0.0), sigma)
        out[now] = (total / np.maximum(share, 1e-9) * share / (share + 0.25))[now]
    return out
