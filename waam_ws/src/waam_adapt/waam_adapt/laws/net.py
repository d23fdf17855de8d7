"""The correction network without torch: weights with a hash, computed tile by tile. Its file: net_file.py.

Same input, same bits: nothing is random and the order of the sums is fixed.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from typing import Any

import numpy as np

from .convolution import conv3x3

HEAD_LIMIT = 0.6  # share of the planned height that is told at most
LOG_LIMITS = (-5.0, 1.0)  # of the predicted error in layer heights
TILE, HALO = 128, 24  # cells; the halo is wider than what an output cell sees: no seams
CONVS = (
    'enc1a', 'enc1b', 'enc2a', 'enc2b', 'mida', 'midb', 'dec2a', 'dec2b', 'dec1a', 'dec1b', 'head', 'doubt',
)  # fmt: skip


class ModelError(ValueError):
    """A model file that is missing, damaged or of another make; the text names file and reason."""


@dataclass(frozen=True, eq=False)
class Network:
    """Weights of the network and what is known about them."""

    weights: dict[str, np.ndarray]  # arrays by name: `CONVS` with .weight, .bias
    card: dict[str, Any]  # what the file says of its training
    digest: str  # sha256 of the file

    def __call__(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """x (channels, rows, cols) float32 -> share of the planned height by which the layer will end too high, and
        log of its standard uncertainty, (rows, cols).
        """
        rows, cols = x.shape[1:]
        x = np.pad(x, ((0, 0), (0, -rows % 4), (0, -cols % 4)))
        change, doubt = np.empty(x.shape[1:], np.float32), np.empty(x.shape[1:], np.float32)
        for r in range(0, rows, TILE):
            for c in range(0, cols, TILE):
                top, left = max(r - HALO, 0), max(c - HALO, 0)
                part = x[:, top : r + TILE + HALO, left : c + TILE + HALO]
                for out, tile in zip((change, doubt), self._tile(part), strict=True):
                    inner = tile[r - top : r - top + TILE, c - left : c - left + TILE]
                    out[r : r + TILE, c : c + TILE] = inner
        return change[:rows, :cols], doubt[:rows, :cols]

    def _tile(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        one = self._conv('enc1b', self._conv('enc1a', x))
        two = self._conv('enc2b', self._conv('enc2a', halve(one)))
        three = self._conv('midb', self._conv('mida', halve(two)))
        two = self._conv('dec2b', self._conv('dec2a', np.concatenate([double(three), two])))
        one = self._conv('dec1b', self._conv('dec1a', np.concatenate([double(two), one])))
        linear = np.tensordot(self.weights['skip.weight'][0, :, 0, 0], x, 1)
        change = HEAD_LIMIT * np.tanh(self._point('head', one) + linear)
        return change, np.clip(self._point('doubt', one), *LOG_LIMITS)

    def _conv(self, name: str, x: np.ndarray) -> np.ndarray:
        return conv3x3(x, self.weights[f'{name}.weight'], self.weights[f'{name}.bias'])

    def _point(self, name: str, x: np.ndarray) -> np.ndarray:
        w = self.weights[f'{name}.weight'][0, :, 0, 0]
        return np.tensordot(w, x, 1) + self.weights[f'{name}.bias'][0]


def halve(x: np.ndarray) -> np.ndarray:
    """Means of 2x2 cells."""
    top, bottom = x[:, ::2], x[:, 1::2]
    return np.float32(0.25) * (
        top[:, :, ::2] + top[:, :, 1::2] + bottom[:, :, ::2] + bottom[:, :, 1::2]
    )


def double(x: np.ndarray) -> np.ndarray:
    """Every cell twice along both axes."""
    return x.repeat(2, axis=1).repeat(2, axis=2)


def digest(weights: dict[str, np.ndarray], card: dict[str, Any]) -> str:
    """sha256 over names, shapes and bytes of the weights and over the card."""
    h = hashlib.sha256(json.dumps(card, sort_keys=True).encode())
    for name in sorted(weights):
        a = np.ascontiguousarray(weights[name], np.float32)
        h.update(f'{name}{a.shape}'.encode())
        h.update(a.tobytes())
    return h.hexdigest()
