"""Training of the U-Net on layers of the laboratory (`samples`); deterministic by seed.

Every eighth job is for validation; what is made small: `loss`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
from scipy.ndimage import gaussian_filter

from waam_adapt.beads import features, plan_geometry
from waam_adapt.grids import CELLS_PER_BEAD
from waam_adapt.laws import net_file
from waam_adapt.laws.net import HEAD_LIMIT
from waam_adapt.laws.unet_law import SMOOTH

from .card import card_text
from .loss import batch, loss, on, turned, validate
from .samples import Sample
from .unet import UNet, arrays

HELD_OUT = 8  # every eighth job is for validation
DECAY = 0.01  # of the weights, per step and rate
RIDGE = 3e-3  # of the regression that the training begins with, of the scale of every channel
CHECK_EVERY = 250  # steps between validations
WIDTH_ROOM = 0.25  # of the bead width beyond those seen


@dataclass(frozen=True)
class Settings:
    """batch: layers of a step; rate: largest learning rate of Adam; widths: channels of the U-Net's three levels."""

    steps: int = 2500
    seed: int = 1
    batch: int = 8
    rate: float = 2e-3
    widths: tuple[int, int, int] = (12, 20, 32)


@dataclass
class Progress:
    """How far a training has come. loss: of every step; checks: what every validation said, with its step."""

    step: int = 0
    loss: list[float] = field(default_factory=list)
    checks: list[dict[str, float]] = field(default_factory=list)


class Trainer:
    """start: weights to begin with; where: torch device of network and layers.

    ValueError when the layers are of too few jobs, or the weights of another network.
    """

    def __init__(
        self,
        layers: Sequence[Sample],
        settings: Settings,
        start: Mapping[str, np.ndarray] | None = None,
        where: torch.device | None = None,
    ) -> None:
        held = [s for s in layers if s.seed % HELD_OUT == 0]
        used = [s for s in layers if s.seed % HELD_OUT]
        if not held or not used:
            raise ValueError(
                f'{len(used)} layers to train on and {len(held)} to validate: too few jobs'
            )
        where = where or torch.device('cpu')
        self.families = [s.family for s in held]
        self.held, self.used = ([on(s, where) for s in part] for part in (held, used))
        torch.manual_seed(settings.seed)
        net = UNet(settings.widths)
        torch.nn.init.normal_(net.head.weight, 0.0, 0.05)
        if start is not None:
            put(net, start)
        else:
            first = torch.from_numpy(linear(used) / HEAD_LIMIT)
            net.skip.weight.data = first.float().reshape(net.skip.weight.shape)
        self.settings, self.net, self.progress = settings, net.to(where), Progress()
        self.optimizer = torch.optim.AdamW(
            self.net.parameters(), lr=settings.rate, weight_decay=DECAY
        )

    def step(self) -> float:
        """One batch of layers, turned and mirrored at random; returns its loss."""
        s, p = self.settings, self.progress
        for group in self.optimizer.param_groups:
            group['lr'] = s.rate * schedule(p.step, s.steps)
        rng = np.random.default_rng((s.seed, p.step, 0))
        value = loss(self.net, batch([turned(self.used[i], rng) for i in self._chosen(p.step)]))
        self.optimizer.zero_grad()
        value.backward()
        torch.nn.utils.clip_grad_norm_(self.net.parameters(), 1.0)
        self.optimizer.step()
        p.step += 1
        p.loss.append(float(value.detach()))
        return p.loss[-1]

    def _chosen(self, step: int) -> Iterator[int]:
        """All layers are seen once, in another order every time, before any is seen again."""
        first = step * self.settings.batch
        for i in range(first, first + self.settings.batch):
            turn, place = divmod(i, len(self.used))
            yield _order(self.settings.seed, turn, len(self.used))[place]

    def check(self) -> dict[str, float]:
        """A validation on the jobs that are held out, kept with its step."""
        self.progress.checks.append(
            {'step': self.progress.step, **validate(self.net, self.held, self.families)}
        )
        return self.progress.checks[-1]


def train(trainer: Trainer, tick: Callable[[Trainer], None] = lambda t: None) -> dict[str, float]:
    """Trains to the end of the settings; returns the last validation. tick: called after every step."""
    p, steps = trainer.progress, trainer.settings.steps
    while p.step < steps:
        trainer.step()
        if p.step % CHECK_EVERY == 0 or p.step == steps:
            trainer.check()
        tick(trainer)
    last = p.checks[-1] if p.checks else {}
    return {k: v for k, v in last.items() if k != 'step'}


def schedule(step: int, steps: int) -> float:
    """Share of the learning rate: up over 50 steps, then down along a cosine to 2 %."""
    return min(1.0, (step + 1) / 50) * (0.51 + 0.49 * math.cos(math.pi * step / max(steps, 1)))


def put(network: UNet, weights: Mapping[str, np.ndarray]) -> None:
    """ValueError when the weights are of another network."""
    try:
        network.load_state_dict({k: torch.from_numpy(np.array(v)) for k, v in weights.items()})
    except RuntimeError as e:
        raise ValueError(f'weights do not fit the network: {e}') from None


@lru_cache(maxsize=2)
def _order(seed: int, turn: int, count: int) -> list[int]:
    return np.random.default_rng((seed, turn)).permutation(count).tolist()


def linear(layers: Sequence[Sample]) -> np.ndarray:
    """(CHANNELS,) weights of a ridge regression of the smoothed shape on the channels: what the training begins with.
    Means over a layer are taken off."""
    moments = np.zeros((features.CHANNELS + 1, features.CHANNELS + 1))
    for s in layers:
        known = s.weight > 0
        w = s.weight[known].astype(float)
        y = np.clip(s.y, -features.MAX_ERROR, features.MAX_ERROR)
        y = gaussian_filter((y - np.average(y, weights=s.weight)) * s.weight, SMOOTH)
        both = np.concatenate([s.x[:, known], y[None, known]]).astype(float)
        both -= np.average(both, axis=1, weights=w)[:, None]
        moments += (both * w) @ both.T
    square, product = moments[:-1, :-1], moments[:-1, -1]
    scale = np.sqrt(np.maximum(np.diag(square), 1e-9))
    ridge = square / np.outer(scale, scale) + RIDGE * np.eye(len(scale))
    found: np.ndarray = np.linalg.solve(ridge, product / scale) / scale
    return found


def seen_ranges(layers: Sequence[Sample]) -> dict[str, tuple[float, float]]:
    """Range of every figure of `plan_geometry.summary`, widened by a tenth of it; the bead width by WIDTH_ROOM."""
    figures = np.array([s.figures for s in layers])
    low, high = np.nanmin(figures, axis=0), np.nanmax(figures, axis=0)
    room = 0.1 * (high - low) + 0.01
    width = plan_geometry.SUMMARIES.index('width')
    room[width] = WIDTH_ROOM * low[width]
    return {
        name: (round(float(a), 6), round(float(z), 6))
        for name, a, z in zip(plan_geometry.SUMMARIES, low - room, high + room, strict=True)
    }


def export(
    trainer: Trainer,
    layers: Sequence[Sample],
    metrics: dict[str, float],
    path: Path,
) -> str:
    """Weights with their card, and the card for people as .md beside them. Returns the hash."""
    net, settings = trainer.net, trainer.settings
    seeds = sorted({s.seed for s in layers})
    card: dict[str, Any] = {
        'name': 'waam U-Net',
        'purpose': 'what the base law would leave of a layer, from its plan, its surface and the layers of the job',
        'parameters': sum(p.numel() for p in net.parameters()),
        'cells_per_bead': CELLS_PER_BEAD,
        'channels': list(features.NAMES),
        'training': {
            **asdict(settings),
            'widths': list(settings.widths),
        },
        'data': {
            'layers': len(layers),
            'jobs': len(seeds),
            'seeds': [seeds[0], seeds[-1]],
            'families': sorted({s.family for s in layers}),
        },
        'weights': {k: metrics.get(f'weight_{k}', 0.0) for k in ('shape', 'level')},
        'seen': {k: list(v) for k, v in seen_ranges(layers).items()},
        'metrics': metrics,
    }
    code = net_file.save(path, arrays(net), card)
    path.with_suffix('.md').write_text(card_text(card, code))
    return code
