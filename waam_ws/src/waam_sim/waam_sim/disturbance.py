"""What no model knows: a fixed, spatially correlated random field. It depends on the place alone, never on when or how
fast metal is laid there, so an open-loop and a closed-loop job with one seed meet the same disturbances."""

from __future__ import annotations

import math

import numpy as np

from .compiled import jit

AREA_FIXED, AREA_LAYER, WIDTH = 0, 1, 2
_LAYERS, _SIDE = 64, 64


def lattice(seed: int) -> np.ndarray:
    """(3, 64, 64, 64) standard normal numbers: channel, layer, y, x; repeats beyond its ends."""
    rng = np.random.default_rng([seed & 0xFFFFFFFF, 17])
    return rng.standard_normal((3, _LAYERS, _SIDE, _SIDE))


@jit
def noise(values, channel, u, v, w):
    """Unit-variance smooth noise at lattice coordinates u (x), v (y), w (layer)."""
    iu, iv, iw = math.floor(u), math.floor(v), math.floor(w)
    fu, fv, fw = u - iu, v - iv, w - iw
    fu = fu * fu * (3.0 - 2.0 * fu)
    fv = fv * fv * (3.0 - 2.0 * fv)
    fw = fw * fw * (3.0 - 2.0 * fw)
    total, power = 0.0, 0.0
    for a in range(2):
        for b in range(2):
            for c in range(2):
                weight = (fw if a else 1.0 - fw) * (fv if b else 1.0 - fv) * (fu if c else 1.0 - fu)
                i, j, k = int(iw + a) & 63, int(iv + b) & 63, int(iu + c) & 63
                total += weight * values[channel, i, j, k]
                power += weight * weight
    return total / math.sqrt(power)
