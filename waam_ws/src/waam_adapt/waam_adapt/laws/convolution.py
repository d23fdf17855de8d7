"""The layers of the correction network as compiled loops: a 3x3 convolution with zeros around, and ReLU."""

from __future__ import annotations

import numpy as np
from numba import njit

TOGETHER = (
    4  # output channels that are summed in one pass over the input, so that it is read less often
)


def conv3x3(x: np.ndarray, weight: np.ndarray, bias: np.ndarray) -> np.ndarray:
    """ReLU of a 3x3 convolution with zeros around; x (in, rows, cols), weight (out, in, 3, 3), bias (out,), all
    float32 -> (out, rows, cols). Sums are always taken in the same order."""
    spare = -len(bias) % TOGETHER
    if spare:
        weight = np.pad(weight, ((0, spare), (0, 0), (0, 0), (0, 0)))
        bias = np.pad(bias, (0, spare))
    rows, cols = x.shape[1:]
    padded = np.zeros((len(x), rows + 2, cols + 2), np.float32)
    padded[:, 1:-1, 1:-1] = x
    out = _conv3x3(padded, weight, bias)
    return out[: len(out) - spare]


@njit(cache=True, fastmath={'contract'})
def _conv3x3(padded, weight, bias):
    """padded (in, rows + 2, cols + 2) -> (out, rows, cols), out a multiple of TOGETHER."""
    channels, rows, cols = padded.shape[0], padded.shape[1] - 2, padded.shape[2] - 2
    out = np.empty((len(bias), rows, cols), np.float32)
    zero = np.float32(0)
    for r in range(rows):
        for o in range(0, len(bias), TOGETHER):
            a, b, c, d = out[o, r], out[o + 1, r], out[o + 2, r], out[o + 3, r]
            a[:], b[:], c[:], d[:] = bias[o], bias[o + 1], bias[o + 2], bias[o + 3]
            for i in range(channels):
                for k in range(3):
                    x = padded[i, r + k]
                    f = weight[o, i, k]
                    a0, a1, a2 = f[0], f[1], f[2]
                    f = weight[o + 1, i, k]
                    b0, b1, b2 = f[0], f[1], f[2]
                    f = weight[o + 2, i, k]
                    c0, c1, c2 = f[0], f[1], f[2]
                    f = weight[o + 3, i, k]
                    d0, d1, d2 = f[0], f[1], f[2]
                    for j in range(cols):
                        u, v, w = x[j], x[j + 1], x[j + 2]
                        a[j] += a0 * u + a1 * v + a2 * w
                        b[j] += b0 * u + b1 * v + b2 * w
                        c[j] += c0 * u + c1 * v + c2 * w
                        d[j] += d0 * u + d1 * v + d2 * w
            for j in range(cols):
                a[j], b[j] = max(a[j], zero), max(b[j], zero)
                c[j], d[j] = max(c[j], zero), max(d[j], zero)
    return out


def warm_up() -> None:
    """Compiles the loop for the arrays that the network passes."""
    one = np.ones((TOGETHER, TOGETHER, 3, 3), np.float32)
    conv3x3(one[0], one, np.ones(TOGETHER, np.float32))
