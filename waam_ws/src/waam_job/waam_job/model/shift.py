"""Whether a part still lies where it lay: the shift between the surface that must be there and the one that is seen.

Pure. Heights beside the metal say nothing of a shift along a plane, so the shape is fitted: edges of the part, relief
and laid beads. What must be there is the stored map and the metal laid since, whose end the checkpoint leaves open
within limits. The fit is a robust one (Cauchy) of translation, turn about z and height, and of efficiency, end, trail
and width of the new metal: the pool lies behind the arc, so beads seem shifted against their direction at both of their
ends, and where nothing holds them they flow. Every residual is divided by its standard uncertainty, as in
point-to-plane registration: on a slope a height is as uncertain as its place.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import product

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates, maximum_filter
from scipy.optimize import OptimizeResult, least_squares

from waam_process.grid import GridSpec, HeightGrid
from waam_process.segment import Segment

LIMIT = 0.35e-3  # m, of the farthest place of the layer; a fit that finds more is refused
SEARCH = 6e-3  # m, largest shift that is looked for
STEP = 0.75e-3  # m, of the search
TURNS = (0.0, -1.5, 1.5, -3.0, 3.0)  # deg, of the search
SIDEWAYS = 0.2e-3  # m, standard uncertainty of the place of a height
HEIGHT = 0.06e-3  # m, of a height on a plane, both maps together
METAL = 0.25  # of the height of new metal, in its height
ROUND = 0.28  # bead widths, standard deviation of its cross-section
BLUR = 1.0  # cells
OUTLIER = 3.0  # standard uncertainties from which a residual counts less
NOISE_CORRELATION_CELLS = 50.0  # cells that err alike
SURE = 7.0  # by which the fit must be better than the part in its place, in half squares of standard uncertainties
SHOWN = 3.0  # standard uncertainties from which a displacement is one
OTHER = 0.25  # share of cells that fit nowhere, from which another part lies there
STRAY = 6.0  # standard uncertainties from which a cell fits nowhere
FEW, MANY, SOME = (
    100,
    20000,
    2500,
)  # cells that a fit needs, that it takes, and that the search takes
ENDS = 16  # places at most at which the new metal may end
TRAIL = 0.5  # bead widths that the pool may lie behind the arc
FLOWN = 1.5  # by which a bead may be wider
# of the unknowns: x, y, turn, up, efficiency, end of the new metal as a share of what is open, trail and width as
# shares of TRAIL and FLOWN
UNIT = np.array([1e-3, 1e-3, math.radians(1.0), 1e-4, 0.1, 0.1, 0.1, 0.1])
USUAL = np.array(
    [0.0, 0.0, 0.0, 0.0, 9.0, 5.0, 5.0, 3.0]
)  # of them, in UNIT, before anything is seen
LOOSE = np.array([5.0, 5.0, 1.0, 5.0, 1.5, 10.0, 5.0, 5.0])  # standard uncertainties of that


@dataclass(frozen=True)
class Expected:
    """What may be seen, m, NaN = nothing is known. metal: (ends, rows, cols) on `ground` (rows, cols), by where it may
    end, from the least to the most; modes: (2, ends, rows, cols) what changes when the pool lies TRAIL behind the arc,
    and when beads are FLOWN as wide."""

    spec: GridSpec
    ground: np.ndarray
    metal: np.ndarray
    modes: np.ndarray


@dataclass(frozen=True)
class Shift:
    """Where the part lies, seen from its place.

    x, y: m, of the middle of the layer; turn: rad about it; up: m. farthest, sigma: m, way of that place of the layer
    that moved most, and its standard uncertainty. blind: m and rad, the largest standard uncertainty of a place and
    its direction. gain: see SURE; misfit: share of cells that fit nowhere. moved, other_part: the verdict.
    """

    x: float = 0.0
    y: float = 0.0
    turn: float = 0.0
    up: float = 0.0
    farthest: float = 0.0
    sigma: float = math.inf
    blind: tuple[float, float] = (math.inf, 0.0)
    gain: float = 0.0
    misfit: float = 0.0

    @property
    def moved(self) -> bool:
        """The part lies farther than LIMIT from its place."""
        return self.farthest > LIMIT and self.gain > SURE

    @property
    def other_part(self) -> bool:
        """No shift explains what is seen."""
        return self.misfit > OTHER

    @property
    def words(self) -> str:
        """What was found."""
        x, y, turn = self.x * 1e3, self.y * 1e3, math.degrees(self.turn)
        return (
            f'{self.farthest * 1e3:.2f} mm (+- {2 * self.sigma * 1e3:.2f} mm) from its place: x {x:+.2f} mm, '
            f'y {y:+.2f} mm, turned by {turn:+.2f} deg'
        )

    @property
    def unseen(self) -> str:
        """What the shape does not show of a shift, in words; '' when it shows everything down to LIMIT."""
        size, angle = self.blind
        if math.isinf(self.sigma):
            return 'the shape shows no shift at all: nothing with an edge is known to lie there'
        if 2 * size <= LIMIT:
            return ''
        return (
            f'the shape hardly shows a shift along {math.degrees(angle):.0f} deg from x: '
            f'+- {min(2 * size * 1e3, 99):.1f} mm'
        )


def expected_of(
    before: HeightGrid, volume: float, deposits: list[Segment], least: int, most: int
) -> Expected:
    """The surface (m) after the first `least` to `most` of the deposits of a layer, laid on that of `before`.

    volume: m3 of metal of the whole layer. Beads reach beyond the cells that a plan gives them, so the metal is that of
    round beads along the path.
    """
    spec = before.spec
    whole = sum(s.length * s.height for s in deposits)
    share = volume / whole if whole > 0 else 0.0
    ends = np.unique(np.linspace(least, most, ENDS).round().astype(int))
    middles, metal, number = _melt(deposits, spec.resolution)
    width = max((s.width for s in deposits), default=0.0)
    pool = _behind(middles, TRAIL * width)
    places = (middles, width), (pool, width), (middles, FLOWN * width)
    under, behind, wide = (
        np.array([_beads(spec, at[number < end], share * metal[number < end], w) for end in ends])
        for at, w in places
    )
    return Expected(spec, smooth(before).z, under, np.array([behind, wide]) - under)


def _melt(deposits: list[Segment], step: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Where the arc is in pieces of half a step (m) of the path: (n, 2) m, their length times height (n,) m2, and the
    number (n,) of their segment."""
    places, metal, number = [np.zeros((0, 2))], [np.zeros(0)], [np.zeros(0, int)]
    for k, s in enumerate(deposits):
        n = 1 + int(2 * s.length / step)
        steps = (np.arange(n) + 0.5)[:, None] / n
        places.append(np.array(s.start[:2]) * (1 - steps) + np.array(s.end[:2]) * steps)
        metal.append(np.full(n, s.height * s.length / n))
        number.append(np.full(n, k))
    return np.concatenate(places), np.concatenate(metal), np.concatenate(number)


def _behind(arc: np.ndarray, trail: float) -> np.ndarray:
    """(n, 2) m: where the pool is that follows the arc (n, 2) at `trail` m; it begins under it after every jump."""
    found, pool = arc.copy(), None
    for i, place in enumerate(arc):
        jumped = i and math.dist(place, arc[i - 1]) > trail
        if pool is None or jumped:
            pool = place
        step = math.dist(place, arc[i - 1]) if i else 0.0
        pool = pool + (place - pool) * min(1.0, step / max(trail, 1e-9))
        found[i] = pool
    return found


def smooth(grid: HeightGrid) -> HeightGrid:
    """Without the scatter from cell to cell, which a shift by half a cell would average out: it looked better than
    none."""
    known = np.isfinite(grid.z)
    weight = gaussian_filter(known.astype(float), BLUR)
    z = gaussian_filter(np.where(known, grid.z, 0.0), BLUR) / np.maximum(weight, 1e-9)
    return grid.with_z(np.where(known, z, np.nan))


def _beads(spec: GridSpec, places: np.ndarray, metal: np.ndarray, width: float) -> np.ndarray:
    """(rows, cols) m of round beads of `width` m: metal (n,) m3 at places (n, 2) m; none beyond the grid."""
    found = np.zeros(spec.shape)
    inside = spec.contains(*places.T)
    np.add.at(found, spec.cell(*places[inside].T), metal[inside] / spec.resolution**2)
    return gaussian_filter(found, ROUND * width / spec.resolution)


def find_shift(expected: Expected, seen: HeightGrid, places: np.ndarray) -> Shift:
    """The shift of `seen`, on the grid of `expected`; places: (n, 2) m of the layer, at least one."""
    fit = _Fit.of(expected, seen, places.mean(axis=0))
    if fit is None:
        return Shift()
    still = fit.refine(fit.ended(USUAL), fixed=True)
    best = min((fit.refine(p) for p in (still.x, *fit.search())), key=lambda r: float(r.cost))
    x, y, turn, up, *_ = (float(v) for v in best.x * UNIT)
    cov = _covariance(best)
    lever = places - fit.middle
    rows = np.zeros((len(places), 2, 3))
    rows[:, 0, 0] = rows[:, 1, 1] = 1.0
    rows[:, 0, 2], rows[:, 1, 2] = -lever[:, 1], lever[:, 0]
    way, covs = rows @ np.array([x, y, turn]), rows @ cov @ rows.transpose(0, 2, 1)
    variances, axes = np.linalg.eigh(covs)
    sigmas = np.sqrt(np.maximum(variances, 0.0))
    along = np.einsum('nij,ni->nj', axes, way)  # of the way, along the axes of its uncertainty
    shown = np.where((sigmas < LIMIT / SHOWN) | (np.abs(along) > SHOWN * sigmas), along, 0.0)
    lengths = np.hypot(shown[:, 0], shown[:, 1])
    most, worst = int(lengths.argmax()), int(sigmas[:, 1].argmax())
    direction = axes[worst, :, 1]
    return Shift(
        x=x,
        y=y,
        turn=turn,
        up=up,
        farthest=float(lengths[most]),
        sigma=float(sigmas[most, 1]),
        blind=(float(sigmas[worst, 1]), math.atan2(direction[1], direction[0]) % math.pi),
        gain=float(still.cost - best.cost),
        misfit=fit.misfit(best.x),
    )


def _covariance(found: OptimizeResult) -> np.ndarray:
    """(3, 3) of x, y (m) and turn (rad)."""
    inverse = np.linalg.inv(found.jac.T @ found.jac)
    return inverse[:3, :3] * np.outer(UNIT[:3], UNIT[:3])


@dataclass(frozen=True)
class _Fit:
    """Cells (n,) that take part, and the surface that was seen."""

    x: np.ndarray
    y: np.ndarray
    ground: np.ndarray
    metal: np.ndarray  # (ends, n)
    modes: np.ndarray  # (2, ends, n)
    sigma: np.ndarray
    middle: np.ndarray
    seen: HeightGrid
    filled: np.ndarray  # seen, 0 where nothing was
    known: np.ndarray  # where it was, as numbers

    @classmethod
    def of(cls, expected: Expected, seen: HeightGrid, middle: np.ndarray) -> _Fit | None:
        """None when too little is known."""
        spec, most = expected.spec, expected.metal[-1]
        slope = np.hypot(*np.gradient(expected.ground + most, spec.resolution))
        slope = maximum_filter(np.nan_to_num(slope), 3)
        sigma = np.sqrt(
            HEIGHT**2 + (SIDEWAYS * slope) ** 2 + (METAL * maximum_filter(most, 5)) ** 2
        )
        rows, cols = np.nonzero(np.isfinite(expected.ground))
        if len(rows) < FEW:
            return None
        take = slice(None, None, 1 + len(rows) // MANY)
        at = rows[take], cols[take]
        seen = smooth(seen)
        known = np.isfinite(seen.z)
        return cls(
            x=spec.x[at[1]],
            y=spec.y[at[0]],
            ground=expected.ground[at],
            metal=expected.metal[:, *at],
            modes=expected.modes[:, :, *at],
            sigma=sigma[at],
            middle=middle,
            seen=seen,
            filled=np.where(known, seen.z, 0.0),
            known=known.astype(float),
        )

    def heights(self, p: np.ndarray, cells: slice = slice(None)) -> np.ndarray:
        """(n,) m that are seen on a part that lies as p says, NaN = none. p: unknowns in UNIT."""
        dx, dy, turn, up, *_ = p * UNIT
        u, v = self.x[cells] - self.middle[0], self.y[cells] - self.middle[1]
        c, s, spec = math.cos(turn), math.sin(turn), self.seen.spec
        x, y = c * u - s * v + self.middle[0] + dx, s * u + c * v + self.middle[1] + dy
        at = [(y - spec.y[0]) / spec.resolution, (x - spec.x[0]) / spec.resolution]
        known = map_coordinates(self.known, at, order=1) > 0.999
        return np.where(known, map_coordinates(self.filled, at, order=1) - up, np.nan)

    def residuals(self, p: np.ndarray) -> np.ndarray:
        """(n,) in standard uncertainties, NaN where nothing was seen."""
        share, end, *modes = p[4:] * UNIT[4:]
        last = len(self.metal) - 1
        place = min(max(end, 0.0), 1.0) * last
        k = min(int(place), max(last - 1, 0))
        after, part = min(k + 1, last), place - k
        metal = (1 - part) * self.metal[k] + part * self.metal[after]
        for mode, size in zip(self.modes, modes, strict=True):
            metal = metal + min(max(size, -0.5), 1.5) * ((1 - part) * mode[k] + part * mode[after])
        return (self.heights(p) - self.ground - share * metal) / self.sigma

    def search(self, best: int = 3) -> list[np.ndarray]:
        """Unknowns of the shifts that fit best on a coarse grid, wherever the new metal ends."""
        cells = slice(None, None, 1 + len(self.x) // SOME)
        low = (self.ground + USUAL[4] * UNIT[4] * self.metal[0])[cells]
        high = (self.ground + 1.2 * self.metal[-1])[cells]
        steps = np.arange(-SEARCH, SEARCH + STEP / 2, STEP) / UNIT[0]
        found = []
        for turn, x, y in product(TURNS, steps, steps):
            p = np.array([x, y, turn, *USUAL[3:]])
            z = self.heights(p, cells)
            r = (z - np.clip(z, low, high)) / self.sigma[cells]
            r = r[np.isfinite(r)]
            if r.size > 0.6 * len(low):
                found.append((float(np.log1p((r / OUTLIER) ** 2).mean()), p))
        found.sort(key=lambda pair: pair[0])
        return [self.ended(p) for _, p in found[:best]]

    def ended(self, p: np.ndarray) -> np.ndarray:
        """The unknowns with the end of the new metal that fits best."""
        ends = np.linspace(0, 1, len(self.metal)) / UNIT[5]
        tried = [np.array([*p[:5], end, *p[6:]]) for end in ends]
        return min(
            tried, key=lambda q: float(np.nansum(np.log1p((self.residuals(q) / OUTLIER) ** 2)))
        )

    def refine(self, start: np.ndarray, fixed: bool = False) -> OptimizeResult:
        """The best fit near `start`; fixed: of the part in its place. `cost` is in half squares of uncertainties."""
        n, c2 = len(self.x), OUTLIER**2
        still = 3 if fixed else 0

        def whole(p: np.ndarray) -> np.ndarray:
            return np.concatenate([np.zeros(still), p])

        def errors(p: np.ndarray) -> np.ndarray:
            p = whole(p)
            return np.concatenate([np.nan_to_num(self.residuals(p)), (p - USUAL) / LOOSE])

        def loss(z: np.ndarray) -> np.ndarray:
            """Cauchy over NOISE_CORRELATION_CELLS for the cells; what is usual counts in full."""
            data = z[:n]
            cauchy = c2 * np.log1p(data / c2), 1 / (1 + data / c2), -1 / c2 / (1 + data / c2) ** 2
            usual = z[n:], np.ones(len(z) - n), np.zeros(len(z) - n)
            return np.array(
                [
                    np.concatenate([a / NOISE_CORRELATION_CELLS, b])
                    for a, b in zip(cauchy, usual, strict=True)
                ]
            )

        found = least_squares(errors, start[still:], loss=loss, max_nfev=40)
        found.x = whole(found.x)
        return found

    def misfit(self, p: np.ndarray) -> float:
        """Share of the cells that lie more than STRAY from where they must."""
        r = self.residuals(p)
        r = r[np.isfinite(r)]
        return float((np.abs(r) > STRAY).mean()) if r.size else 1.0
