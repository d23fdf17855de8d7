"""What could be known of a layer's metal while it is laid, and what that would be worth.

`known_share` asks what is known of the disturbance by somebody who looks. The disturbance is a lattice of independent
numbers (waam_sim.disturbance), and every place of a bead is an exact linear sum of eight of them. So a Kalman filter
over the lattice tells how uncertain the metal still to come is: no estimator with the same sight knows more, and the
answer depends on path and times alone, not on a seed.

`Foretold` looks at the growth itself, misfit of the bead model included: how much of a layer's deviation follows from
its neighbours that were finished before. `Calm` is a cell whose last layer has no disturbance.
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

from waam_job.model.seen import NEAR, Reach
from waam_lab.cell import LabCell
from waam_process.grid import GridSpec
from waam_process.segment import Kind, Segment

from .jaw import jaw_job

LAST_LAYER = 7  # of the demo's jaw
# of the disturbance, what a place that was seen is uncertain by; profiles beside the arc: 1 % of the height
SIGMA = 0.2
# m, of the lattice: noise_length, noise_length, noise_height of the cell
UNIT = np.array([9e-3, 9e-3, 2e-3])
SIDE = 64  # nodes after which it repeats
OFFSET, FAN = 0.060, 0.050  # m, of PlanSettings: scanner_offset along x, scanner_fov
STEP = 1e-3  # m between the points of a path
PERIOD = 1.0  # s between two looks
SPREADS = (0.6, 1.2, 2.4)  # bead widths over which neighbours are asked


@dataclass(frozen=True)
class Sight:
    """Who looks. at_once: sees a bead as soon as it is laid; otherwise metal is seen once no later bead comes near it.
    mounted: only where the cell's scanner passes over it. delay: s from seeing to the metal that can still be set."""

    at_once: bool = False
    mounted: bool = False
    delay: float = 0.0


class Lattice:
    """How uncertain the disturbance's numbers are: covariance (n, n) of the nodes that were met; the others are 1."""

    def __init__(self) -> None:
        self.nodes, self.cov = np.zeros(0, np.int64), np.zeros((0, 0))

    @staticmethod
    def weights(places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Numbers of the nodes (n, 8) and their weights (n, 8) of places (n, 3) in lattice coordinates u, v, w."""
        low = np.floor(places)
        part = places - low
        part = part * part * (3 - 2 * part)
        nodes, weights = [], []
        for corner in itertools.product((0, 1), repeat=3):
            up = np.array(corner)
            at = (low.astype(np.int64) + up) & (SIDE - 1)
            nodes.append((at[:, 2] * SIDE + at[:, 1]) * SIDE + at[:, 0])
            weights.append(np.prod(np.where(up, part, 1 - part), axis=1))
        w = np.stack(weights, axis=1)
        return np.stack(nodes, axis=1), w / np.sqrt((w**2).sum(axis=1, keepdims=True))

    def learn(self, places: np.ndarray) -> None:
        """Places (n, 3) were seen."""
        nodes, weights = self.weights(places)
        for index, w in zip(self._index(nodes), weights, strict=True):
            gain = self.cov[:, index] @ w
            self.cov -= np.outer(gain, gain) / (gain[index] @ w + SIGMA**2)

    def variance(self, places: np.ndarray) -> np.ndarray:
        """(n,) of the disturbance at places (n, 3); 1 where nothing is known."""
        nodes, weights = self.weights(places)
        index = self._index(nodes)
        return np.einsum(
            'ni,nij,nj->n', weights, self.cov[index[:, :, None], index[:, None]], weights
        )

    def _index(self, nodes: np.ndarray) -> np.ndarray:
        """Rows of the covariance; nodes that are new get theirs."""
        new = np.setdiff1d(nodes, self.nodes)
        n = len(self.nodes)
        cov = np.eye(n + len(new))
        cov[:n, :n] = self.cov
        self.nodes, self.cov = np.concatenate([self.nodes, new]), cov
        order = np.argsort(self.nodes)
        return order[np.searchsorted(self.nodes, nodes, sorter=order)]


@dataclass(frozen=True)
class LaidPath:
    """Points of the beads of a layer in the order of laying: place (n, 3) m, laid and finished (n,) s, and torch (m, 2)
    m with its times (m,) s."""

    place: np.ndarray
    laid: np.ndarray
    finished: np.ndarray
    torch: np.ndarray
    times: np.ndarray

    @classmethod
    def of(cls, segments: Sequence[Segment]) -> LaidPath:
        """Of the segments of a layer, travel included. A point is finished when no later bead comes nearer than NEAR
        bead widths."""
        from scipy.spatial import cKDTree

        ends = np.cumsum([s.duration for s in segments])
        place, laid, owner, torch, times = [], [], [], [], []
        for k, s in enumerate(segments):
            n = max(1, math.ceil(s.length / STEP))
            part = (np.arange(n) + 0.5) / n
            a, b = np.array(s.start), np.array(s.end)
            at, when = a + part[:, None] * (b - a), ends[k] - s.duration * (1 - part)
            torch.append(at[:, :2])
            times.append(when)
            if s.kind == Kind.DEPOSIT:
                place.append(at)
                laid.append(when)
                owner.append(np.full(n, k))
        points, who = np.concatenate(place), np.concatenate(owner)
        width = next(s.width for s in segments if s.kind == Kind.DEPOSIT)
        tree = cKDTree(points[:, :2])
        near = tree.query_ball_point(points[:, :2], NEAR * width)
        finished = np.array([ends[who[n].max()] for n in near])
        return cls(
            points, np.concatenate(laid), finished, np.concatenate(torch), np.concatenate(times)
        )

    def seen(self, sight: Sight) -> np.ndarray:
        """(n,) s at which a point is seen; inf = never."""
        if sight.at_once:
            return self.laid
        if not sight.mounted:
            return self.finished
        out = np.full(len(self.place), np.inf)
        for (x, y), t in zip(self.torch, self.times, strict=True):
            over = np.abs(self.place[:, 0] - x - OFFSET) <= STEP
            over &= (np.abs(self.place[:, 1] - y) <= FAN / 2) & (self.finished <= t)
            out[over & np.isinf(out)] = t
        return out


def known_share(segments: Sequence[Segment], sight: Sight) -> float:
    """0..1 of the variance of a layer's disturbance that is known of the metal when it is laid, mean along the path."""
    path, lattice = LaidPath.of(segments), Lattice()
    known_at, places = path.seen(sight) + sight.delay, path.place / UNIT
    unknown, learned = 0.0, np.zeros(len(places), bool)
    for t in np.arange(0.0, path.laid.max() + PERIOD, PERIOD):
        fresh = (known_at <= t) & ~learned
        lattice.learn(places[fresh])
        learned |= fresh
        now = (path.laid > t) & (path.laid <= t + PERIOD)
        unknown += float(lattice.variance(places[now]).sum())
    return 1 - unknown / len(places)


class Calm(LabCell):
    """A cell whose last layer is laid without any disturbance. `layers`: number -> segments as they were placed."""

    def __init__(self, calm: bool, *args) -> None:
        self.calm, self.layers = calm, {}
        super().__init__(*args)

    def plan(self, job_id, layer, segments):
        super().plan(job_id, layer, segments)
        self.layers[layer] = list(segments)
        if self.calm and layer == LAST_LAYER:
            for name in ('area_noise_fixed', 'area_noise_layer', 'width_noise'):
                self.device.plant.metal.params[name] = 0.0


def rail(folder: Path, seed: int, **options):
    """Three layers of the rail of inlayer_regimes, which the scanner sees much of."""
    from waam_lab import restore

    from .inlayer_regimes import trough

    files = trough(folder, 'rail')
    return restore(*files, seed, tolerance=0.2e-3, layers=3, strategy='zigzag', **options)


def run(job, calm: bool = False, kind: type[Calm] = Calm) -> tuple[Calm, object]:
    """The cell, of a `kind`, and the result of a job in it. RuntimeError with the message of a job that failed."""
    from waam_lab import laboratory

    made = []

    def cell(*args):
        made.append(kind(calm, *args))
        return made[-1]

    kept, laboratory.LabCell = laboratory.LabCell, cell
    try:
        result = laboratory.run(job)
    finally:
        laboratory.LabCell = kept
    if result.failed:
        raise RuntimeError(f'seed {job.seed}: {result.message}')
    return made[0], result


def calm_rms(seed: int) -> float:
    """m, of the jaw of a seed whose last layer has no disturbance."""
    return run(jaw_job(seed=seed), calm=True)[1].rms


@dataclass(frozen=True)
class Foretold:
    """Sums over the cells of a layer, m2: of the squares of d, what its surface is off by from what it should be then
    (against target) or its growth from the metal asked for (against asked), less the mean of either; and by (against,
    mounted, spread) of p d and p2, p: what finished neighbours say of d."""

    layer: int
    squares: dict[str, float]
    said: dict[tuple[str, bool, float], tuple[float, float]]


@dataclass(frozen=True)
class Usual:
    """A job in which nobody looks. rms: m at the end."""

    rms: float
    layers: list[list[Segment]]
    foretold: list[Foretold]


def usual(seed: int, delay: float, part: str = 'jaw') -> Usual:
    """The jaw (or rail) of a seed. delay: s from finished metal to metal that can be set by it."""
    from waam_job.store.folder import JobFolder

    with tempfile.TemporaryDirectory() as scratch:
        own = {'keep': True, 'jobs_dir': Path(scratch)}
        job = jaw_job(seed=seed, **own) if part == 'jaw' else rail(Path(scratch), seed, **own)
        cell, result = run(job)
        folder = JobFolder.open(result.folder)
        maps = [folder.read_map(n) for n in range(folder.last_map() + 1)]
    pairs = enumerate(zip(maps, maps[1:], strict=False), start=1)
    foretold = [_of_layer(n, cell.layers[n], *pair, delay) for n, pair in pairs]
    return Usual(result.rms, [cell.layers[n] for n in sorted(cell.layers)], foretold)


def _of_layer(number: int, segments: list[Segment], before, after, delay: float) -> Foretold:
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
