"""Layer by layer as the job does it: scan, correct, set, lay. And the oracles that know the plant but not its noise."""

from __future__ import annotations

import copy
from dataclasses import dataclass, field

import numpy as np

from waam_adapt.feed import feed_forward as ff
from waam_adapt.laws.checks import MapOrigin, error_figures
from waam_adapt.laws.corrector import CorrectionParams, Corrector
from waam_adapt.types import RATIO_HIGH, RATIO_LOW, CorrectionInput, LastLayer
from waam_process.heat import heat_factor

from .adapt_plants import Pad
from .adapt_wall import HOT_MODEL, Wall
from .cell_by_cell import Proportional

Plant = Pad | Wall


@dataclass
class Run:
    """figures: after every layer, see the plant's `figures` (m); confidence, missed: what was believed and what was
    then wrong (m), of all judged cells of pads; level: mean error of the surface, m.
    """

    figures: list[tuple[float, float, float]] = field(default_factory=list)
    level: list[float] = field(default_factory=list)
    exponent: list[float] = field(default_factory=list)
    confidence: list[np.ndarray] = field(default_factory=list)
    missed: list[np.ndarray] = field(default_factory=list)
    fallbacks: int = 0
    # for every layer but the last: whether the surface after it had an RMS inside of the stated 90 % interval
    foretold: list[bool] = field(default_factory=list)


@dataclass(frozen=True)
class Settings:
    """law and gain of the correction server; the switches of the ablation."""

    law: str = 'damped_inverse'
    gain: float = 0.9
    k_gain: float = 0.3
    identify: bool = True
    thermal: bool = True
    confidence: bool = True
    model: str = ''

    def corrector(self) -> Corrector:
        plain = self.law == Proportional.name  # of the benchmarks alone
        server = Corrector(
            CorrectionParams(
                law='zero' if plain else self.law, gain=self.gain, k_gain=self.k_gain, identify=self.identify,
                model=self.model,
            )
        )  # fmt: skip
        if plain:
            server.law = Proportional(self.gain)
        return server


def run(
    plant: Plant, settings: Settings, layers: int, ramp: tuple[float, float] | None = None
) -> Run:
    """The correction chain of the cell around a plant. ramp: degC of the first and last layer."""
    server, out, last, told = settings.corrector(), Run(), LastLayer(), None
    for n in range(1, layers + 1):
        if ramp is not None:
            plant.temperature = ramp[0] + (ramp[1] - ramp[0]) * (n - 1) / (layers - 1)
        z = plant.scan()
        request = _request(plant, settings, n, z)
        origin = MapOrigin(0.0, 'bench', 'bench', n - 1, n - 1, True)
        answer = server.answer(n, request, origin, last)
        if told is not None:
            out.foretold.append(told.low <= error_figures(request)[0] <= told.high)
        told = answer.outcome
        c = answer.correction
        path = ff.Path(**plant.path(n))
        heat = float(heat_factor(plant.temperature, plant.material)) if settings.thermal else 1.0
        f = ff.Field(plant.spec, c.psi, c.residual_height, c.k_gain, answer.flow_factor)
        s = ff.compute(path, plant.material, plant.limits, plant.material.voltage, f, True, heat)
        asked = np.where(plant.planned > 0, plant.planned / c.speed_factor + c.residual_height, 0.0)
        last = LastLayer(z, asked, answer.flow_factor)
        plant.deposit(path.start, path.end, s.wire_feed_speed, s.speed)
        out.figures.append(plant.figures(n))
        out.level.append(float(np.mean(plant.error(n))))
        out.exponent.append(answer.estimate.height_exponent)
        out.fallbacks += c.fallback
        if isinstance(plant, Pad):
            out.confidence.append(c.confidence[plant.judged])
            out.missed.append(np.abs(plant.error(n)[plant.judged]))
    return out


def _request(plant: Plant, settings: Settings, n: int, z: np.ndarray) -> CorrectionInput:
    sigma = np.full(z.shape, plant.physics.scan_sigma) if settings.confidence else None
    return CorrectionInput(
        z, plant.target(n - 1), plant.planned, plant.resolution, plant.believed_width,
        settings.k_gain, sigma, (1.0, 0.0), paths=plant.bead_paths(n),
        temperature=plant.temperature,
    )  # fmt: skip


def open_loop(plant: Plant, layers: int) -> Run:
    """The plan as it is."""
    out = Run()
    for n in range(1, layers + 1):
        path = ff.Path(**plant.path(n))
        s = ff.compute(path, plant.material, plant.limits, plant.material.voltage)
        plant.deposit(path.start, path.end, s.wire_feed_speed, s.speed)
        out.figures.append(plant.figures(n))
    return out


def log_log(wall: Wall, layers: int, model: tuple[float, float] = HOT_MODEL) -> Run:
    """What the recorded cell did: speed from the inverse of one fixed model, 3 .. 17 mm/s, constant feed."""
    out = Run()
    for n in range(1, layers + 1):
        path = ff.Path(**wall.path(n))
        seen = np.nanmean(wall.scan()[wall.rows, wall.cols], axis=0).reshape(-1, 2).mean(axis=1)
        order = slice(None) if n % 2 else slice(None, None, -1)
        need = np.clip(n * wall.nominal[::2] - seen, 0.3e-3, 4e-3)[order]
        speed = 1e-3 * np.exp((np.log(need * 1e3) - model[1]) / model[0])
        feed = ff.compute(path, wall.material, wall.limits, 19.0).wire_feed_base
        wall.deposit(path.start, path.end, feed, np.clip(speed, 3e-3, 17e-3))
        out.figures.append(wall.figures(n))
    return out


def wall_oracle(wall: Wall, layers: int, seen: bool = False) -> Run:
    """Inverts the wall's own law for every segment; knows all but the noise of the layer that it lays (`seen`: and the
    scanner's, of which it has the same map as the laws)."""
    out = Run()
    for n in range(1, layers + 1):
        path = ff.Path(**wall.path(n))
        h = np.nanmean(wall.scan()[wall.rows, wall.cols], axis=0) if seen else wall.h
        need, forth = n * wall.nominal - h, path.end[0, 0] > path.start[0, 0]
        base = ff.compute(path, wall.material, wall.limits, 19.0).wire_feed_base
        speed = path.speed.copy()
        for _ in range(12):
            grown = wall.growth(base, speed, forth)
            ratio = need.reshape(-1, 2).mean(axis=1) / grown.reshape(-1, 2).mean(axis=1)
            ratio = np.clip(ratio if forth else ratio[::-1], 0.3, 3)
            speed = np.clip(speed * ratio ** (1 / wall.physics.a), 2e-3, 40e-3)
        wall.deposit(path.start, path.end, base, speed)
        out.figures.append(wall.figures(n))
    return out


def pad_oracle(plant: Pad, layers: int, rounds: int = 3) -> Run:
    """Sees the true surface and knows all of the plant but its noise: least squares on a copy of it, layer by layer.

    Same segments, same range of relative layer height as the laws; the feed does what speed could not, at once.
    """
    out = Run()
    for n in range(1, layers + 1):
        path = ff.Path(**plant.path(n))
        base = ff.compute(path, plant.material, plant.limits, 22.0).wire_feed_speed
        factor = np.ones(len(base))
        for _ in range(rounds):
            model = copy.deepcopy(plant)
            model.deposit(path.start, path.end, base * factor, path.speed, noisy=False)
            missing = np.where(plant.judged, n * plant.height - model.z, 0.0)
            step = _best_step(model, path, base * factor, missing)
            factor = np.clip(factor * (1 + step), RATIO_LOW, 2 * RATIO_HIGH)
        plant.deposit(path.start, path.end, base * factor, path.speed)
        out.figures.append(plant.figures(n))
    return out


def _best_step(model: Pad, path: ff.Path, feed: np.ndarray, missing: np.ndarray) -> np.ndarray:
    """Relative change of every segment's metal that removes `missing` best, by the weights of the model's layer."""
    n = len(feed) // len(model.beads)
    columns = []
    for i in range(n):
        pick = np.zeros(len(feed))
        pick[i::n] = 1.0  # the same segment of every bead at once: beads have weights of their own
        columns.append(model.metal(path.start, path.end, feed * pick, path.speed, noisy=False))
    rows = []
    for b in range(len(model.beads)):
        (first, k), w = model.weights[b]
        for i in range(n):
            a = np.zeros(missing.shape)
            a[first : first + k] = (columns[i][b][2] / model.resolution * w.T)[:, :]
            rows.append(a[model.judged])
    a = np.array(rows)
    normal = a @ a.T
    normal[np.diag_indices_from(normal)] += 0.02 * np.trace(normal) / len(normal)
    return np.linalg.solve(normal, a @ missing[model.judged])
