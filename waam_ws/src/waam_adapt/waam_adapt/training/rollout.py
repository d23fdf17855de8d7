"""The closed loop in torch: scan, explicit law, network, deposition, what the layer taught; layer after layer.

Everything that the error of a later layer depends on is differentiable, the explicit law too. The explicit law and the
identification repeat `laws.DampedInverse` and `identification` on the training grid; a test holds the first equal.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from scipy.ndimage import distance_transform_edt

from .. import filters
from ..laws import features
from ..types import RATIO_HIGH, RATIO_LOW
from .deposit import along_bead, deposit, driven, sample
from .parts import BEAD, SIZE
from .scenes import Batch

LEARNING = 0.3  # of the shortfall, as correction_server's default
MAX_SHORTFALL = 0.5
REACH = 0.5 * BEAD  # cells from a known one over which the explicit law fades
FLOOR = 1e-4  # added to the mean square error, layer heights squared
PAD = torch.from_numpy(np.pad(np.arange(SIZE), 2 * BEAD, mode='symmetric'))


@dataclass
class State:
    """What the controller carries from layer to layer: shares that even and odd layers miss,
    efficiency (b,), layers learned from.
    """

    shares: list[torch.Tensor | None]
    efficiency: torch.Tensor
    layers: int = 0

    def share(self, layer: int) -> torch.Tensor:
        """As `shortfall.Shortfall.share`: of the same direction of travel, else half of the other."""
        own, other = self.shares[layer % 2], self.shares[1 - layer % 2]
        if own is None:
            return torch.zeros(1) if other is None else 0.5 * other
        return own


@dataclass(frozen=True)
class Layer:
    """What one simulated layer of b scenes gave."""

    z: torch.Tensor  # (b, rows, cols) surface after it
    square: torch.Tensor  # (b,) mean square error over the judged cells, layer heights
    # (b,) mean square difference between what was asked and the ideal control
    imitated: torch.Tensor
    error: torch.Tensor  # (b, rows, cols) layer heights
    log_error: torch.Tensor  # (b, rows, cols) logarithm of the error that the network expects


def height_request(b: Batch, error: torch.Tensor, known: np.ndarray, variant: int) -> torch.Tensor:
    """Relative change of layer height that the damped inverse asks for. error (b, rows, cols): missing metal."""
    index, fade = _nearest(b.trusted[variant] & known, known)
    missing = error.flatten(1).gather(1, index).reshape(error.shape)
    n = SIZE + 4 * BEAD
    padded = missing[:, PAD][:, :, PAD]
    t = b.transfer[variant]
    wanted = torch.fft.irfft2(torch.fft.rfft2(padded) * t, s=(n, n))
    wanted = wanted[:, 2 * BEAD : 2 * BEAD + SIZE, 2 * BEAD : 2 * BEAD + SIZE]
    sigma = b.sigma * torch.from_numpy(b.height).float()
    reliable = filters.ERROR_PRIOR**2 / (filters.ERROR_PRIOR**2 + sigma**2)
    planned = torch.where(b.footprint, b.planned, 1.0)
    return (b.gain * reliable)[:, None, None] * fade * wanted / planned


def _nearest(trusted: np.ndarray, known: np.ndarray) -> tuple[torch.Tensor, torch.Tensor]:
    """Flat index (b, cells) of the nearest trusted cell and the explicit law's fading from the known ones."""
    index = np.empty((len(known), SIZE * SIZE), np.int64)
    fade = np.empty(known.shape, np.float32)
    for i, (t, k) in enumerate(zip(trusted, known, strict=True)):
        rows, cols = distance_transform_edt(
            ~(t if t.any() else k), return_distances=False, return_indices=True
        )
        index[i] = (rows * SIZE + cols).ravel()
        fade[i] = np.clip(2 * (1 - distance_transform_edt(~k) / REACH), 0, 1)
    return torch.from_numpy(index), torch.from_numpy(fade)


def see(b: Batch, z: torch.Tensor) -> tuple[torch.Tensor, np.ndarray]:
    """Scanned surface and the cells that were seen; spikes are believed."""
    noise = torch.from_numpy(b.rng.standard_normal(z.shape)).float()
    spike = b.rng.random(z.shape) < b.spikes[:, None, None]
    spikes = torch.from_numpy(np.where(spike, b.rng.uniform(-1, 1, z.shape), 0.0)).float()
    known = b.footprint.numpy() & ~b.holes
    known |= b.footprint.numpy() & ~known.any(axis=(1, 2), keepdims=True)
    return z + noise * b.sigma[:, None, None] + spikes, known


def inputs(
    b: Batch,
    share: torch.Tensor,
    error: torch.Tensor,
    known: torch.Tensor,
    explicit: torch.Tensor,
    layer: int,
) -> torch.Tensor:
    """The network's channels in the order of `features.NAMES`."""
    f = b.fixed[layer % 2]
    familiar = torch.full_like(error, features.experience_feature(layer // 2))
    inside = b.footprint.float()
    sigma = b.sigma[:, None, None] * known
    maps = (
        (error * known).clamp(-features.LIMIT, features.LIMIT), known, sigma, f[:, 0], f[:, 1],
        explicit * inside, share * known, f[:, 2], f[:, 3], f[:, 4], f[:, 5], f[:, 6], f[:, 7], f[:, 8],
        familiar,
    )  # fmt: skip
    return torch.stack(maps, 1)


def step(b: Batch, state: State, z: torch.Tensor, layer: int, net: torch.nn.Module | None) -> Layer:
    """One layer, from 0; net None: the explicit law alone. Changes the state."""
    variant = layer % 2
    seen, known = see(b, z)
    known_t = torch.from_numpy(known).float()
    share = state.share(layer) * b.footprint
    error = layer * b.planned + share * b.planned - seen
    explicit = height_request(b, error, known, variant)
    ratio, log_error = 1 + explicit, torch.zeros_like(z)
    if net is not None:
        change, log_error = net(inputs(b, share, error, known_t, explicit.clamp(-0.6, 0.8), layer))
        ratio = ratio.clamp(RATIO_LOW, RATIO_HIGH) + change
    ratio = ratio.clamp(RATIO_LOW, RATIO_HIGH)
    s = b.layers[variant]
    at = driven(b.pool, s, sample(ratio / state.efficiency[:, None, None], s))
    heat = (1 + b.heat * min(layer, 6))[s.scene]
    planned = sample(torch.where(b.footprint, b.planned, 1.0), s)
    volume = along_bead(b.pool, s, at.clamp_min(0.1), b.noise[layer]) * heat * planned
    after = deposit(z, b.pool, s, volume)
    left = (layer + 1) * b.planned - after
    learn(b, state, layer, seen, after, ratio, known)
    off = ratio - ideal(b, z, layer)
    square, imitated = ((x**2 * b.judged).sum((1, 2)) / b.judged.sum((1, 2)) for x in (left, off))
    return Layer(after, square, imitated, left, log_error)


def ideal(b: Batch, z: torch.Tensor, layer: int) -> torch.Tensor:
    """(b, rows, cols) relative layer height that the true surface z lacks after `layer` layers, no neighbours
    considered: the ideal control that imitation is shown."""
    planned = torch.where(b.footprint, b.planned, 1.0)
    return (((layer + 1) * planned - z.detach()) / planned).clamp(RATIO_LOW, RATIO_HIGH)


@torch.no_grad()
def learn(
    b: Batch,
    state: State,
    layer: int,
    before: torch.Tensor,
    after: torch.Tensor,
    ratio: torch.Tensor,
    known: np.ndarray,
) -> None:
    """Efficiency of the layer and share that is missing at every cell; as `identification` does."""
    measured, seen = see(b, after)
    asked = b.planned * ratio / state.efficiency[:, None, None]
    usable = torch.from_numpy(known & seen) & b.footprint
    inner = usable & torch.from_numpy(b.trusted[layer % 2])
    growth = torch.where(b.footprint, (measured - before) / asked.clamp_min(0.1), torch.nan)
    measure = torch.where(inner, growth, torch.nan).flatten(1).nanmedian(1).values.nan_to_num(1.0)
    measure = measure.clamp(0.7, 1.3)
    weight = 0.9 if state.layers == 0 else 0.6
    state.efficiency = state.efficiency + weight * (measure - state.efficiency)
    missing = (1 - growth / measure[:, None, None]).clamp(-MAX_SHORTFALL, MAX_SHORTFALL)
    before_share = state.share(layer) * b.footprint
    news = torch.where(usable, missing - before_share, 0.0)
    weight = max(1 / (layer // 2 + 2), LEARNING)
    smooth = _mean3(news) / _mean3(usable.float()).clamp_min(1e-3) * usable
    state.shares[layer % 2] = before_share + weight * smooth
    state.layers += 1


def _mean3(x: torch.Tensor) -> torch.Tensor:
    """Gaussian mean of about one cell."""
    kernel = torch.tensor([0.23, 0.54, 0.23])
    x = torch.nn.functional.conv2d(x[:, None], kernel.view(1, 1, 3, 1), padding=(1, 0))
    return torch.nn.functional.conv2d(x, kernel.view(1, 1, 1, 3), padding=(0, 1))[:, 0]


def run(b: Batch, net: torch.nn.Module | None, layers: int, begin: int = 0) -> list[Layer]:
    """`layers` layers, of which gradients go through those from `begin` on."""
    z, state, out = b.z, State([None, None], torch.ones(len(b.z))), []
    for n in range(layers):
        with torch.set_grad_enabled(n >= begin and net is not None):
            result = step(b, state, z, n, net)
        z = result.z
        out.append(result)
    return out


def loss(
    layers: list[Layer], judged: torch.Tensor, kind: str = 'height', doubt: float = 0.05
) -> torch.Tensor:
    """What a training makes small, and how well the doubt predicted the error.

    kind 'height': mean logarithm of the mean square error of the layers, so that every scene counts alike; 'imitation':
    mean square difference from the ideal control (2.22), which knows nothing of what the metal then does.
    """
    if kind == 'imitation':
        value = torch.stack([x.imitated for x in layers]).mean()
    else:
        value = torch.stack([torch.log(x.square + FLOOR) for x in layers]).mean()
    for x in layers:
        square = (x.error.detach() ** 2).clamp_max(1.0)
        blurred = torch.nn.functional.avg_pool2d(square[:, None], 5, 1, 2)[:, 0]
        nll = x.log_error + 0.5 * blurred * torch.exp(-2 * x.log_error)
        value = value + doubt / len(layers) * (nll * judged).sum() / judged.sum()
    return value
