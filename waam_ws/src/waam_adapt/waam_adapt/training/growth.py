"""Training of the growth network on layers of the laboratory (`samples`); deterministic by seed.

The loss is the mean logarithm of the mean square of the growth beside the model that the network did not predict,
mostly of its smoothed part: setpoints cannot make shorter waves. The level of a layer does not count; a regression
(`plan_level`) tells how it differs from that of the job's other layers.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch.nn import functional as F

from ..beads import plan_geometry
from ..grids import CELLS_PER_BEAD
from ..laws import net_file
from ..laws.unet_law import SMOOTH
from . import curves, loop, plan_level
from .growth_card import card_text
from .samples import Sample
from .unet import UNet, arrays

HELD_OUT = 8  # every eighth job is for validation
FINE = 0.15  # weight of what is not smoothed
FLOOR = 1e-3  # of a layer's loss: noise below this is not fought
SIGMA_FLOOR = 1e-4  # of the square that the uncertainty predicts
SHOWN = {  # of a validation, in the picture
    'explained': 'variance explained, smoothed growth',
    'explained_raw': 'variance explained, raw growth',
}
WIDTH_ROOM = 0.25  # of the bead width beyond those seen

Layer = tuple[torch.Tensor, torch.Tensor, torch.Tensor]
Batch = tuple[torch.Tensor, torch.Tensor, torch.Tensor]


@dataclass(frozen=True)
class Settings(loop.Settings):
    """Of one training run. batch: layers."""

    steps: int = 2500
    rate: float = 3e-3
    widths: tuple[int, int, int] = (16, 28, 48)
    check_every: int = 250


class Trainer(loop.Trainer):
    """One process of a training. start: weights to begin with; where: torch device of network and layers.

    ValueError when the layers are of too few jobs. Under `torchrun` every process takes other layers of the same
    order.
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
        self.held, self.used = ([on(s, where) for s in part] for part in (held, used))
        torch.manual_seed(settings.seed)
        net = UNet(settings.widths, plan_geometry.CHANNELS)
        torch.nn.init.normal_(net.head.weight, 0.0, 0.05)
        if start is not None:
            loop.put(net, start)
        super().__init__(settings, net.to(where))

    def loss(self) -> torch.Tensor:
        """Of a batch of layers, turned and mirrored at random."""
        n = self.progress.step
        rng = np.random.default_rng((self.settings.seed, n, self.rank))
        return loss(self.net, batch([turned(self.used[i], rng) for i in self._chosen(n)]))

    def _chosen(self, step: int) -> Iterator[int]:
        """Layers of this process: all are seen once, in another order every time, before any is seen again."""
        first = (step * loop.processes() + self.rank) * self.settings.batch
        for i in range(first, first + self.settings.batch):
            turn, place = divmod(i, len(self.used))
            yield _order(self.settings.seed, turn, len(self.used))[place]

    def validation(self) -> dict[str, float]:
        """On the jobs that are held out."""
        return validate(self.net, self.held)


def train(
    trainer: Trainer,
    folder: Path | None = None,
    tick: Callable[[Trainer], None] = lambda t: None,
) -> dict[str, float]:
    """Trains to the end of the settings; returns the last validation. folder: gets checkpoint.npz and curves.png with
    every validation. tick: called after every step."""
    p = trainer.progress
    while p.step < trainer.settings.steps:
        trainer.step()
        if trainer.due:
            trainer.check()
            if folder is not None:
                folder.mkdir(parents=True, exist_ok=True)
                trainer.save(folder / 'checkpoint.npz')
                curves.draw(p.loss, p.checks, SHOWN, folder / 'curves.png')
        tick(trainer)
    last = p.checks[-1] if p.checks else {}
    return {k: v for k, v in last.items() if k != 'step'}


@lru_cache(maxsize=2)
def _order(seed: int, turn: int, count: int) -> list[int]:
    return np.random.default_rng((seed, turn)).permutation(count).tolist()


def on(sample: Sample, where: torch.device) -> Layer:
    """x (CHANNELS, rows, cols), y and weight (rows, cols) of a layer on a device."""
    x, y, w = (
        torch.from_numpy(np.ascontiguousarray(a)).to(where)
        for a in (sample.x, sample.y, sample.weight)
    )
    return x, y, w


def turned(layer: Layer, rng: np.random.Generator) -> Layer:
    """The layer turned and mirrored at random; the channels keep their values."""
    x, y, w = layer
    for axis in (-1, -2):
        if rng.random() < 0.5:
            x, y, w = (torch.flip(a, (axis,)) for a in (x, y, w))
    if rng.random() < 0.5:
        x, y, w = (a.transpose(-1, -2) for a in (x, y, w))
    return x, y, w


def batch(layers: Sequence[Layer]) -> Batch:
    """x (n, CHANNELS, rows, cols), y and weight (n, rows, cols), filled up to a common size divisible by 4."""
    rows, cols = (max(y.shape[i] for _, y, _ in layers) for i in (0, 1))
    size = rows + -rows % 4, cols + -cols % 4

    def filled(values: torch.Tensor) -> torch.Tensor:
        return F.pad(values, (0, size[1] - values.shape[-1], 0, size[0] - values.shape[-2]))

    x, y, w = (torch.stack([filled(a) for a in kind]) for kind in zip(*layers, strict=True))
    return x, y, w


def loss(net: UNet, data: Batch) -> torch.Tensor:
    """The loss of the growth plus that of the uncertainty (Gaussian likelihood of the smoothed rest)."""
    x, y, weight = data
    predicted, log_sigma = net(x)
    rest = centred(y - predicted, weight)
    smooth, n = smoothed(rest), weight.sum((1, 2))
    square = (smooth**2).sum((1, 2)) + FINE * (rest**2).sum((1, 2))
    likelihood = 0.5 * (smooth.detach() ** 2 + SIGMA_FLOOR) * torch.exp(-2 * log_sigma) + log_sigma
    return torch.log(square / n + FLOOR).mean() + ((likelihood * weight).sum((1, 2)) / n).mean()


def centred(values: torch.Tensor, weight: torch.Tensor) -> torch.Tensor:
    """Less the weighted mean of every map, times the weight."""
    mean = (values * weight).sum((1, 2), keepdim=True) / weight.sum((1, 2), keepdim=True)
    return (values - mean) * weight


def smoothed(values: torch.Tensor) -> torch.Tensor:
    """(n, rows, cols) by a Gaussian of SMOOTH cells."""
    reach = math.ceil(3 * SMOOTH)
    kernel = torch.exp(-0.5 * (torch.arange(-reach, reach + 1, device=values.device) / SMOOTH) ** 2)
    kernel = kernel / kernel.sum()
    maps = F.conv2d(values[:, None], kernel[None, None, :, None], padding=(reach, 0))
    return F.conv2d(maps, kernel[None, None, None], padding=(0, reach))[:, 0]


@torch.no_grad()
def validate(net: UNet, held: Sequence[Layer]) -> dict[str, float]:
    """explained, explained_raw: share of the variance that is predicted, smoothed and not, of all layers; sigma_ratio:
    RMS of the smoothed rest over what the uncertainty says."""
    left = all_ = left_raw = raw = normal = cells = 0.0
    for layer in held:
        x, y, weight = batch([layer])
        predicted, log_sigma = net(x)
        rest, whole = centred(y - predicted, weight), centred(y, weight)
        smooth = smoothed(rest)
        left, all_ = left + float((smooth**2).sum()), all_ + float((smoothed(whole) ** 2).sum())
        left_raw, raw = left_raw + float((rest**2).sum()), raw + float((whole**2).sum())
        known = weight > 0.9
        normal += float(((smooth / log_sigma.exp()) ** 2)[known].sum())
        cells += float(known.sum())
    return {
        'explained': 1 - left / all_,
        'explained_raw': 1 - left_raw / raw,
        'sigma_ratio': math.sqrt(normal / max(cells, 1.0)),
    }


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
    """Weights with their card, and the card for people as .md beside them. Returns the hash. The level of a layer
    (`plan_level`) is fitted to the same layers; where they are too few the network tells none."""
    net, settings = trainer.net, trainer.settings
    level, worth = plan_level.fit(layers)
    seeds = sorted({s.seed for s in layers})
    card: dict[str, Any] = {
        'name': 'waam growth network',
        'purpose': 'growth of a layer beside the bead model, from the geometry of its plan',
        'parameters': sum(p.numel() for p in net.parameters()),
        'cells_per_bead': CELLS_PER_BEAD,
        'channels': list(plan_geometry.NAMES),
        'training': {
            **asdict(settings),
            'widths': list(settings.widths),
            'processes': loop.processes(),
        },
        'data': {'layers': len(layers), 'jobs': len(seeds), 'seeds': [seeds[0], seeds[-1]]},
        'seen': {k: list(v) for k, v in seen_ranges(layers).items()},
        'metrics': {**metrics, **worth},
    }
    code = net_file.save(path, {**arrays(net), **level}, card)
    path.with_suffix('.md').write_text(card_text(card, code))
    return code
