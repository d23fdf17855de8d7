"""Training of the correction network through the differentiable deposition; deterministic by seed,
resumable to the bit.

A step makes new scenes from (seed, step, rank), lets the loop run some layers with the network as it is, and sends the
height error of the next ones back through the metal. Several processes (torchrun) average their gradients.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
import torch

from ..grids import CELLS_PER_BEAD
from ..laws import features, net_file
from . import curves, loop, parts, rollout, scenes
from .unet import UNet, arrays

SHOWN = {  # of a validation, in the picture
    'ratio': 'network / explicit law, RMS',
    'worse': 'share of scenes > 10 % worse',
    'doubt': 'rank correlation of the doubt',
}
HELD_OUT = 1_000_000_000  # seeds of the validation start here; no training step ever gets so far


@dataclass(frozen=True)
class Settings(loop.Settings):
    """Settings of a training. batch: scenes."""

    steps: int = 400
    unroll: int = 3  # layers that gradients go through
    warm: int = 12  # layers before them, at most
    check_batches: int = 4  # of a validation
    check_layers: int = 10  # of a validation
    loss: str = 'height'  # see `rollout.loss`


class Trainer(loop.Trainer):
    """One process of a training. start: weights to fine-tune; recorded: surfaces of real jobs to start from."""

    settings: Settings

    def __init__(
        self,
        settings: Settings,
        start: dict[str, np.ndarray] | None = None,
        recorded: Sequence[scenes.Recorded] = (),
    ) -> None:
        self.recorded = recorded
        torch.manual_seed(settings.seed)
        net = UNet(settings.widths)
        if start is not None:
            loop.put(net, start)
        super().__init__(settings, net)

    def loss(self) -> torch.Tensor:
        """Of new scenes after some layers with the network as it is."""
        s, n = self.settings, self.progress.step
        warm = int(np.random.default_rng([s.seed, n, 7]).integers(0, s.warm + 1))
        b = scenes.batch((s.seed, n, self.rank), s.batch, warm + s.unroll, self.recorded)
        layers = rollout.run(b, self.net, warm + s.unroll, begin=warm)
        return rollout.loss(layers[warm:], b.judged, s.loss)

    def validation(self) -> dict[str, float]:
        """On scenes that no training step sees."""
        s = self.settings
        return validate(self.net, s.check_batches, s.check_layers, s.batch)


@torch.no_grad()
def validate(network: UNet, batches: int, layers: int, size: int) -> dict[str, float]:
    """The network beside the explicit law on the same held-out scenes.

    rms_mm, explicit_mm: mean over scenes of the RMS of the last four layers. ratio: geometric mean of their quotient;
    worse: share of scenes that are more than 10 % worse; doubt: rank correlation of predicted and true error.
    """
    from scipy.stats import spearmanr

    rms, predicted, true = [], [], []
    for k in range(batches):
        b = scenes.batch((HELD_OUT, k), size, layers)
        run = rollout.run(b, network, layers, layers)
        rms.append(_settled(run, b))
        judged = b.judged.numpy()
        predicted.append(run[-1].log_error.numpy()[judged][::7])
        true.append(np.abs(run[-1].error.numpy())[judged][::7])
    a, e = np.concatenate(rms), _explicit(batches, layers, size)
    flat = np.concatenate(predicted)
    rank = spearmanr(flat, np.concatenate(true)).statistic if flat.std() > 0 else 0.0
    return {
        'rms_mm': float(a.mean()), 'explicit_mm': float(e.mean()),
        'ratio': float(np.exp(np.log(a / e).mean())), 'worse': float((a > 1.1 * e).mean()),
        'doubt': float(rank),
    }  # fmt: skip


def _settled(run: list[rollout.Layer], b: scenes.Batch) -> np.ndarray:
    """RMS over the last four layers in mm, per scene."""
    squares = torch.stack([x.square for x in run[-4:]]).mean(0)
    return np.sqrt(squares.numpy()) * b.height * 1e3


@lru_cache(maxsize=4)
def _explicit(batches: int, layers: int, size: int) -> np.ndarray:
    """The explicit law on the scenes of `validate`; the same every time."""
    out = []
    for k in range(batches):
        b = scenes.batch((HELD_OUT, k), size, layers)
        out.append(_settled(rollout.run(b, None, layers), b))
    return np.concatenate(out)


@torch.no_grad()
def seen_ranges(
    network: UNet, batches: int, layers: int, size: int
) -> dict[str, tuple[float, float]]:
    """Range of every figure of `features.summary` over whole jobs in the loop, widened by a tenth of it."""
    figures: list[np.ndarray] = []

    class Watch(torch.nn.Module):
        def forward(self, x: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
            figures.extend(features.summary(one) for one in x.numpy())
            return network(x)

    for k in range(batches):
        rollout.run(scenes.batch((HELD_OUT, 1000 + k), size, layers), Watch(), layers, layers)
    low, high = np.nanquantile(np.array(figures), [0.001, 0.999], axis=0)
    room = 0.1 * (high - low)
    return {
        name: (round(float(a), 6), round(float(z), 6))
        for name, a, z in zip(features.SUMMARIES, low - room, high + room, strict=True)
    }


def card(trainer: Trainer, metrics: dict[str, Any], note: str) -> dict[str, Any]:
    """What the exported file says of itself. note: data beside the synthetic ones."""
    s = trainer.settings
    return {
        'name': 'waam correction network', 'purpose': 'change of the relative layer height on top of damped_inverse',
        'parameters': sum(p.numel() for p in trainer.net.parameters()), 'widths': list(s.widths),
        'cells_per_bead': CELLS_PER_BEAD, 'channels': list(features.NAMES),
        'training': {'steps': trainer.progress.step, 'batch': s.batch, 'unroll': s.unroll, 'seed': s.seed,
                     'loss': s.loss, 'processes': loop.processes()},
        'data': note, 'ranges': {k: list(v) for k, v in parts.RANGES.items()},
        'seen': seen_ranges(trainer.net, 3, 8, s.batch), 'metrics': metrics,
    }  # fmt: skip


def train(
    trainer: Trainer, folder: Path, note: str, tick: Callable[[Trainer], None] = lambda t: None
) -> Path:
    """Trains to the end of the settings; `folder` gets checkpoint.npz, the best correction.npz and
    card.md on the way.
    """
    folder.mkdir(parents=True, exist_ok=True)
    s, p, out = trainer.settings, trainer.progress, folder / 'correction.npz'
    best = min((c['ratio'] for c in trainer.progress.checks), default=math.inf)
    while trainer.progress.step < s.steps:
        trainer.step()
        if trainer.due:
            result = trainer.check()
            if result['ratio'] < best:
                best = result['ratio']
                export(trainer, out, result, note)
            trainer.save(folder / 'checkpoint.npz')
            curves.draw(p.loss, p.checks, SHOWN, folder / 'curves.png')
        tick(trainer)
    return out


def export(trainer: Trainer, path: Path, metrics: dict[str, Any], note: str) -> str:
    """Weights with their card; the same card for people as .md beside them. Returns the hash."""
    content = card(trainer, metrics, note)
    code = net_file.save(path, arrays(trainer.net), content)
    path.with_suffix('.md').write_text(card_text(content, code))
    return code


def card_text(content: dict[str, Any], code: str) -> str:
    """The model card as Markdown."""
    m, t = content['metrics'], content['training']
    lines = [
        f'# {content["name"]}', '', f'{content["purpose"]}; {content["parameters"]} parameters; sha256 `{code}`.', '',
        f'Training: {t["steps"]} steps of {t["batch"]} scenes, {t["unroll"]} layers of gradient, '
        f'loss: {t["loss"]}, seed {t["seed"]}, '
        f'{t["processes"]} process(es). Data: {content["data"]}.', '',
        f'Held-out scenes of the same ranges, mean RMS of the last four of ten layers: {m["rms_mm"]:.3f} mm, '
        f'explicit law '
        f'{m["explicit_mm"]:.3f} mm (geometric mean of the quotient {m["ratio"]:.3f}; more than 10 % worse in '
        f'{m["worse"]:.1%} of the scenes). Rank correlation of predicted and true error: {m["doubt"]:.2f}. '
        'All without the last layer of the law, which solves for the beads: the training does not know it.', '',
        'Lengths in bead widths, heights in layer heights.', '', '| range | from | to |', '|---|---|---|',
        *(f'| {k} | {a:g} | {b:g} |' for k, (a, b) in content['ranges'].items()), '',
        'Inputs whose figures leave these ranges are answered by the explicit law:', '',
        '| figure of the input | from | to |', '|---|---|---|',
        *(f'| {k} | {a:.3g} | {b:.3g} |' for k, (a, b) in content['seen'].items()), '',
    ]  # fmt: skip
    return '\n'.join(lines)
