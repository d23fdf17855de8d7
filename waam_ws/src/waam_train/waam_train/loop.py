"""Where a training runs: device, processes of `torchrun`, learning rate."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping

import numpy as np
import torch
from torch import distributed

from .unet import UNet


class TrainingError(ValueError):
    """A training that cannot start or go on; the text says why."""


def device(name: str = 'auto') -> torch.device:
    """auto: a GPU where there is one, each process of `torchrun` its own; or what torch calls it (cpu, cuda, cuda:1).
    TrainingError where it is not there."""
    if name == 'auto':
        name = 'cuda' if torch.cuda.is_available() else 'cpu'
    try:
        chosen = torch.device(name)
    except RuntimeError as e:
        raise TrainingError(f'device {name}: {e}') from None
    if chosen.type != 'cuda':
        return chosen
    if not torch.cuda.is_available():
        raise TrainingError(f'device {name}: torch sees no GPU here')
    if chosen.index is None:
        local = int(os.environ.get('LOCAL_RANK', '0'))
        chosen = torch.device('cuda', local % torch.cuda.device_count())
    if chosen.index >= torch.cuda.device_count():
        raise TrainingError(f'device {name}: torch sees {torch.cuda.device_count()} GPU(s)')
    return chosen


def rank() -> int:
    """Of this process among those of `torchrun`; 0 alone."""
    return distributed.get_rank() if distributed.is_initialized() else 0


def processes() -> int:
    """How many train together."""
    return distributed.get_world_size() if distributed.is_initialized() else 1


def average(net: torch.nn.Module) -> None:
    """Mean of the gradients over all processes. No wrapper does it: a training may call its network many times a
    step."""
    if not distributed.is_initialized():
        return
    for p in net.parameters():
        if p.grad is not None:
            distributed.all_reduce(p.grad)
            p.grad /= distributed.get_world_size()


def schedule(step: int, steps: int) -> float:
    """Share of the learning rate: up over 50 steps, then down along a cosine to 2 %."""
    return min(1.0, (step + 1) / 50) * (0.51 + 0.49 * math.cos(math.pi * step / max(steps, 1)))


def put(network: UNet, weights: Mapping[str, np.ndarray]) -> None:
    """TrainingError when the weights are of another network."""
    try:
        network.load_state_dict({k: torch.from_numpy(np.array(v)) for k, v in weights.items()})
    except RuntimeError as e:
        raise TrainingError(f'weights do not fit the network: {e}') from None
