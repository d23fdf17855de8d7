"""What a training makes small: what the base law left of a layer and the network did not tell.

The loss is the mean logarithm of the mean square of that, mostly of its smoothed part, since setpoints cannot make
shorter waves; and its Gaussian likelihood, for the uncertainty.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import torch
from torch.nn import functional as F

from waam_adapt.beads import features
from waam_adapt.laws.unet_law import SMOOTH

from .samples import Sample
from .unet import UNet

FINE = 0.1  # weight of what is not smoothed
LEVEL = 2.0  # weight of the square of a layer's mean beside that of its shape
FLOOR = 1e-3  # of a layer's loss: noise below this is not fought
SIGMA_FLOOR = 1e-4  # of the square that the uncertainty predicts

Layer = tuple[torch.Tensor, torch.Tensor, torch.Tensor]
Batch = tuple[torch.Tensor, torch.Tensor, torch.Tensor]


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
    """See the head of this file; y counts up to features.MAX_ERROR."""
    x, y, weight = data
    told, log_sigma = net(x)
    whole = (y.clamp(-features.MAX_ERROR, features.MAX_ERROR) - told) * weight
    rest, n = centred(whole, weight), weight.sum((1, 2))
    smooth, level = smoothed(rest), whole.sum((1, 2)) / n
    square = ((smooth**2).sum((1, 2)) + FINE * (rest**2).sum((1, 2))) / n + LEVEL * level**2
    outcome = (smoothed(whole).detach() ** 2 + SIGMA_FLOOR) * torch.exp(-2 * log_sigma)
    likelihood = ((0.5 * outcome + log_sigma) * weight).sum((1, 2)) / n
    return torch.log(square + FLOOR).mean() + likelihood.mean()


def centred(values: torch.Tensor, weight: torch.Tensor) -> torch.Tensor:
    """Less the weighted mean of every map, times the weight; values are 0 where the weight is."""
    mean = (values * (weight > 0)).sum((1, 2), keepdim=True) / weight.sum((1, 2), keepdim=True)
    return values - mean * weight


def smoothed(values: torch.Tensor) -> torch.Tensor:
    """(n, rows, cols) by a Gaussian of SMOOTH cells."""
    reach = math.ceil(3 * SMOOTH)
    kernel = torch.exp(-0.5 * (torch.arange(-reach, reach + 1, device=values.device) / SMOOTH) ** 2)
    kernel = kernel / kernel.sum()
    maps = F.conv2d(values[:, None], kernel[None, None, :, None], padding=(reach, 0))
    return F.conv2d(maps, kernel[None, None, None], padding=(0, reach))[:, 0]


@torch.no_grad()
def validate(net: UNet, held: Sequence[Layer], families: Sequence[str]) -> dict[str, float]:
    """explained, explained_level: share of the variance of the smoothed shape and of the levels that is told, of all
    layers; sigma_ratio: RMS of the smoothed rest over what the uncertainty says; weight_shape, weight_level: slope of
    what was left on what was told, 0 .. 1, in the worst family."""
    sums: dict[str, np.ndarray] = {}
    normal = cells = 0.0
    for layer, family in zip(held, families, strict=True):
        x, y, weight = batch([layer])
        told, log_sigma = net(x)
        y = y.clamp(-features.MAX_ERROR, features.MAX_ERROR) * weight
        told, n = told * weight, float(weight.sum())
        a, b = (smoothed(centred(v, weight)) for v in (told, y))
        la, lb = float(told.sum()) / n, float(y.sum()) / n
        found = [float((v * w).sum()) for v, w in ((a, a), (a, b), (b, b), (b - a, b - a))]
        found += [la * la, la * lb, lb * lb, (lb - la) ** 2]
        sums[family] = sums.get(family, np.zeros(8)) + np.array(found)
        known = weight > 0.9
        normal += float(((smoothed(y - told) / log_sigma.exp()) ** 2)[known].sum())
        cells += float(known.sum())
    total = np.sum(list(sums.values()), axis=0)
    slopes = np.array([[s[1] / max(s[0], 1e-9), s[5] / max(s[4], 1e-9)] for s in sums.values()])
    shape, level = np.clip(slopes.min(axis=0), 0.0, 1.0)
    return {
        'explained': float(1 - total[3] / total[2]),
        'explained_level': float(1 - total[7] / max(total[6], 1e-12)),
        'sigma_ratio': math.sqrt(normal / max(cells, 1.0)),
        'weight_shape': float(shape),
        'weight_level': float(level),
    }
