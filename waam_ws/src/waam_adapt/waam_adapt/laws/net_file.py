"""The file of a correction network: weights and model card with a hash, without pickle."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np

from waam_process.safe_files import parse_json, read_npz

from ..beads import features
from .net import CONVS, ModelError, Network, digest

PACKAGED = Path(__file__).parents[1] / 'models' / 'unet.npz'


def save(path: Path, weights: dict[str, np.ndarray], card: dict[str, Any]) -> str:
    """Writes an .npz without pickle, atomically; returns its hash, by which answers name the model."""
    code = digest(weights, card)
    text = json.dumps({'card': card, 'sha256': code}, sort_keys=True)
    data = io.BytesIO()
    content: dict[str, Any] = {**weights, 'meta': np.frombuffer(text.encode(), np.uint8)}
    np.savez(data, **content)
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_suffix('.part')
    part.write_bytes(data.getvalue())
    part.replace(path)
    return code


def load(path: Path, channels: int = features.CHANNELS) -> Network:
    """channels: of the input. ModelError when the file is missing, cannot be read, misses a layer or does not have the
    hash that it names."""
    try:
        content = read_npz(path)
        meta = parse_json(content.pop('meta').tobytes().decode(), 'meta')
        card, wanted = dict(meta['card']), str(meta['sha256'])
    except FileNotFoundError:
        raise ModelError(f'{path}: no such model file') from None
    except Exception as e:  # zipfile and numpy raise what their parsers raise
        raise ModelError(f'{path}: cannot be read as a model: {e}') from None
    weights = {k: _weight(path, k, a) for k, a in content.items()}
    if (got := digest(weights, card)) != wanted:
        raise ModelError(f'{path}: hash is {got[:12]}, the file says {wanted[:12]}: damaged')
    _check_layers(path, weights, channels)
    return Network(weights, card, wanted)


def _weight(path: Path, name: str, values: np.ndarray) -> np.ndarray:
    if values.dtype != np.float32 or not np.isfinite(values).all():
        raise ModelError(f'{path}: {name} is not a finite float32 array')
    return values


def _check_layers(path: Path, weights: dict[str, np.ndarray], channels: int) -> None:
    """Channels must fit from layer to layer, else the first request would fail instead of the start."""
    names = [f'{n}.{k}' for n in CONVS for k in ('weight', 'bias')] + ['skip.weight']
    missing = [name for name in names if name not in weights]
    if missing:
        raise ModelError(f'{path}: no {missing[0]} in it')
    a, b, c = (len(weights[f'{n}.bias']) for n in ('enc1a', 'enc2a', 'mida'))
    sizes = (
        (channels, a),
        (a, a),
        (a, b),
        (b, b),
        (b, c),
        (c, c),
        (c + b, b),
        (b, b),
        (b + a, a),
        (a, a),
    )
    shapes = [(o, i, 3, 3) for i, o in sizes] + [(1, a, 1, 1)] * 2
    for name, shape in zip(CONVS, shapes, strict=True):
        got = weights[f'{name}.weight'].shape
        if got != shape or weights[f'{name}.bias'].shape != shape[:1]:
            raise ModelError(f'{path}: {name} has shape {got}, not {shape}')
    if (got := weights['skip.weight'].shape) != (1, channels, 1, 1):
        raise ModelError(f'{path}: skip has shape {got}, not {(1, channels, 1, 1)}')
