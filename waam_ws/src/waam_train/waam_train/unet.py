"""The correction network in torch, for training; `net` computes the same in numpy.

A small U-Net: encoder and decoder with skips, 3x3 kernels, ReLU. It gives by which
share of the planned height a layer will end too high, and the logarithm of the error of that.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import nn
from torch.nn import functional as F

from waam_adapt.beads.features import CHANNELS
from waam_adapt.laws.net import HEAD_LIMIT, LOG_LIMITS


class UNet(nn.Module):
    """x (batch, channels, rows, cols), rows and cols divisible by 4 -> change (batch, rows, cols), log_error alike.

    The head starts at zero: an untrained network tells nothing.
    """

    def __init__(
        self, widths: tuple[int, int, int] = (12, 20, 32), channels: int = CHANNELS
    ) -> None:
        super().__init__()
        a, b, c = widths
        self.widths = widths
        self.enc1a, self.enc1b = _conv(channels, a), _conv(a, a)
        self.enc2a, self.enc2b = _conv(a, b), _conv(b, b)
        self.mida, self.midb = _conv(b, c), _conv(c, c)
        self.dec2a, self.dec2b = _conv(c + b, b), _conv(b, b)
        self.dec1a, self.dec1b = _conv(b + a, a), _conv(a, a)
        self.head = nn.Conv2d(a, 1, 1)
        self.doubt = nn.Conv2d(a, 1, 1)
        self.skip = nn.Conv2d(channels, 1, 1, bias=False)  # what is linear in the input
        nn.init.zeros_(self.skip.weight)
        for layer, bias in ((self.head, 0.0), (self.doubt, -1.5)):
            nn.init.zeros_(layer.weight)
            assert layer.bias is not None  # made by default
            nn.init.constant_(layer.bias, bias)

    def forward(self, x: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """x: (b, CHANNELS, rows, cols), rows and cols multiples of 4. Returns the change of the ratio, within
        HEAD_LIMIT, and the logarithm of its expected error, (b, rows, cols) each.
        """
        one = F.relu(self.enc1b(F.relu(self.enc1a(x))))
        two = F.relu(self.enc2b(F.relu(self.enc2a(F.avg_pool2d(one, 2)))))
        three = F.relu(self.midb(F.relu(self.mida(F.avg_pool2d(two, 2)))))
        two = F.relu(self.dec2b(F.relu(self.dec2a(torch.cat([_double(three), two], 1)))))
        one = F.relu(self.dec1b(F.relu(self.dec1a(torch.cat([_double(two), one], 1)))))
        change = HEAD_LIMIT * torch.tanh((self.head(one) + self.skip(x))[:, 0])
        # what the doubt learns must not bend the features that the correction needs
        return change, self.doubt(one.detach())[:, 0].clamp(*LOG_LIMITS)


def _conv(inputs: int, outputs: int) -> nn.Conv2d:
    return nn.Conv2d(inputs, outputs, 3, padding=1)


def _double(x: torch.Tensor) -> torch.Tensor:
    return F.interpolate(x, scale_factor=2, mode='nearest')


def arrays(net: UNet) -> dict[str, np.ndarray]:
    """Weights as float32 arrays by name, as `net.Network` takes them."""
    return {k: v.detach().cpu().numpy().copy() for k, v in net.state_dict().items()}
