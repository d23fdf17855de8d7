"""What every training shares: where it runs, its steps, gradients of several processes, the checkpoint."""

from __future__ import annotations

import json
import math
import os
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import distributed

from .unet import UNet, arrays


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


@dataclass(frozen=True)
class Settings:
    """Of any training. batch: of a step and process; rate: largest learning rate of Adam; widths: channels of the three
    levels of the U-Net; check_every: steps between validations."""

    steps: int
    seed: int = 1
    batch: int = 8
    rate: float = 2e-3
    widths: tuple[int, int, int] = (8, 16, 32)
    check_every: int = 100


@dataclass
class Progress:
    """How far a training has come. loss: of every step; checks: what every validation said, with its step."""

    step: int = 0
    loss: list[float] = field(default_factory=list)
    checks: list[dict[str, float]] = field(default_factory=list)


class Trainer(ABC):
    """One process of a training; under `torchrun` the processes average their gradients."""

    def __init__(self, settings: Settings, net: UNet) -> None:
        self.settings, self.net, self.progress = settings, net, Progress()
        self.rank = rank()
        self.optimizer = torch.optim.Adam(net.parameters(), lr=settings.rate)

    @abstractmethod
    def loss(self) -> torch.Tensor:
        """Of the network on what the next step is made of."""

    @abstractmethod
    def validation(self) -> dict[str, float]:
        """Of the network on what no step sees."""

    def step(self) -> float:
        """One batch; returns its loss."""
        s, p = self.settings, self.progress
        for group in self.optimizer.param_groups:
            group['lr'] = s.rate * schedule(p.step, s.steps)
        value = self.loss()
        self.optimizer.zero_grad()
        value.backward()
        average(self.net)
        torch.nn.utils.clip_grad_norm_(self.net.parameters(), 1.0)
        self.optimizer.step()
        p.step += 1
        p.loss.append(float(value.detach()))
        return p.loss[-1]

    @property
    def due(self) -> bool:
        """Whether this process validates now."""
        s, n = self.settings, self.progress.step
        return self.rank == 0 and (n % s.check_every == 0 or n == s.steps)

    def check(self) -> dict[str, float]:
        """A validation, kept with its step."""
        self.progress.checks.append({'step': self.progress.step, **self.validation()})
        return self.progress.checks[-1]

    def save(self, path: Path) -> None:
        """All that `resume` needs, without pickle, complete or not at all."""
        content: dict[str, Any] = {f'w.{k}': v for k, v in arrays(self.net).items()}
        for i, p in enumerate(self.net.parameters()):
            for name, value in self.optimizer.state.get(p, {}).items():
                content[f'o.{i}.{name}'] = value.cpu().numpy()
        text = json.dumps({'settings': asdict(self.settings), 'progress': asdict(self.progress)})
        content['meta'] = np.frombuffer(text.encode(), np.uint8)
        part = path.with_suffix('.part.npz')
        np.savez(part, **content)
        part.replace(path)

    def resume(self, path: Path) -> None:
        """Goes on where `save` was called. TrainingError when there is nothing, or when the settings differ in anything
        but the number of steps."""
        try:
            with np.load(path, allow_pickle=False) as file:
                content = {k: file[k] for k in file.files}
        except (OSError, ValueError) as e:
            raise TrainingError(f'{path}: nothing to resume ({e})') from None
        meta = json.loads(content['meta'].tobytes())
        mine, theirs = json.loads(json.dumps(asdict(self.settings))), meta['settings']
        for key in mine:
            if key != 'steps' and mine[key] != theirs.get(key):
                raise TrainingError(
                    f'{path}: was begun with {key} = {theirs.get(key)}, not {mine[key]}'
                )
        put(self.net, {k[2:]: v for k, v in content.items() if k.startswith('w.')})
        for i, p in enumerate(self.net.parameters()):
            names = [k for k in content if k.startswith(f'o.{i}.')]
            state = {k.split('.', 2)[2]: torch.from_numpy(content[k]) for k in names}
            # Adam counts its steps on the CPU
            self.optimizer.state[p] = {
                k: v if k == 'step' else v.to(p.device) for k, v in state.items()
            }
        self.progress = Progress(**meta['progress'])
