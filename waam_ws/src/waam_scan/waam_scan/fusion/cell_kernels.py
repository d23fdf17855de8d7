"""Compiled loops from what a cell holds to its height. All cells are independent but for the slope of the surface.

Two estimates per cell. From the sample: median, then the mean of the inliers, reduced to the cell centre by the slope.
From all points: the phase of the summed unit vectors exp(2 pi i h / period). It solves sum sin(2 pi (h - m) /
period) = 0 and is thus the M-estimate of location with Andrews' sine as influence function (Andrews et al. 1972):
nearly the mean for the noise, and a point far away pulls by a bounded amount in a direction that averages out. The
period that is meant comes from the sample's median, the trust in it from the agreement of the two."""

from __future__ import annotations

import numpy as np
from numba import njit

from .kernels import AMPLITUDE, COUNT, OPEN, PHASE, PLACE, UNITS, distinct

MAD_TO_SIGMA = 1.4826  # median absolute deviation -> standard deviation of a normal distribution
MIN_SAMPLES_OF_SCATTER = 5  # samples from which the scatter of a cell says something about noise
WEAK = 4  # cells with fewer samples need a neighbour at a similar height
ALL_AROUND = 5  # known neighbours of a cell from which on they say whether it stands alone
PRIOR = 8.0  # degrees of freedom that the scatter of the whole map counts against that of a cell
MIN_RESULTANT = 0.3  # of the unit vectors; below, the points are spread over the period and the phase says nothing
AGREE = 4.0  # standard deviations that the two estimates may be apart


@njit(cache=True)
def sort_row(rows, cell, m):
    """rows[cell, :m] in rising order: by height."""
    for i in range(1, m):
        a = rows[cell, i]
        j = i - 1
        while j >= 0 and rows[cell, j] > a:
            rows[cell, j + 1] = rows[cell, j]
            j -= 1
        rows[cell, j + 1] = a


@njit(cache=True)
def height_of(record, low, unit):
    """Height (m) in the upper half of a record: middle of its unit above `low`."""
    return low + (np.float64(record >> np.uint64(32)) + 0.5) * unit


@njit(cache=True)
def place_of(half):
    """Cells from the centre, of a 16-bit place."""
    return (np.float64(half) + 0.5) / 65536.0 - 0.5


@njit(cache=True)
def mean_place(word, total, n):
    """Mean place along columns and rows (cells from the centre) from the 32-bit and 64-bit sums."""
    u = np.float64(np.int64(word & np.uint64(0xFFFFFFFF)) + total[2]) / n
    v = np.float64(np.int64(word >> np.uint64(32)) + total[3]) / n
    return (u + 0.5) / 65536.0 - 0.5, (v + 0.5) / 65536.0 - 0.5


@njit(cache=True)
def sine_estimate(word, total, n, low, unit, level):
    """Height (m) from the phase sums of n points, in the period of `level`; NaN when the phase says nothing."""
    shift = AMPLITUDE * np.int64(n)
    c = np.float64(np.int64(word & np.uint64(0xFFFFFFFF)) + total[0] - shift)
    s = np.float64(np.int64(word >> np.uint64(32)) + total[1] - shift)
    if c * c + s * s < (MIN_RESULTANT * AMPLITUDE * n) ** 2:
        return np.nan
    period = UNITS * unit
    h = low + np.arctan2(s, c) / (2 * np.pi) * period
    return h + np.round((level - h) / period) * period


@njit(cache=True, nogil=True)
def levels(start, stop, words, halves, rows, sums, low, unit, done, median, wave, mean_u, mean_v):
    """Median of the sample, sine estimate and mean place of the cells that got points since the last time."""
    for cell in range(start, stop):
        n = words[cell, COUNT]
        if n == done[cell]:
            continue
        done[cell] = n
        m = distinct(rows, cell, np.int64(halves[cell, 7]))
        halves[cell, 7] = m
        sort_row(rows, cell, m)
        a, b = (
            height_of(rows[cell, (m - 1) // 2], low, unit),
            height_of(rows[cell, m // 2], low, unit),
        )
        median[cell] = 0.5 * (a + b)
        wave[cell] = np.nan
        if halves[cell, 6] != np.uint32(OPEN):
            wave[cell] = sine_estimate(words[cell, PHASE], sums[cell], n, low, unit, median[cell])
            mean_u[cell], mean_v[cell] = mean_place(words[cell, PLACE], sums[cell], n)


@njit(cache=True)
def minmod(back, ahead):
    """The smaller of two slopes of equal sign, else 0: a slope that makes no new peak."""
    if not (np.isfinite(back) and np.isfinite(ahead)) or back * ahead <= 0:
        return 0.0
    return back if abs(back) < abs(ahead) else ahead


@njit(cache=True, nogil=True)
def slopes(start, stop, height, cols, gx, gy):
    """Height change per cell along and across the lines start .. stop of height (lines, stride); 0 if unknown."""
    rows = height.shape[0]
    for r in range(start, stop):
        for c in range(cols):
            m = height[r, c]
            left = m - height[r, c - 1] if c > 0 else np.nan
            right = height[r, c + 1] - m if c < cols - 1 else np.nan
            down = m - height[r - 1, c] if r > 0 else np.nan
            up = height[r + 1, c] - m if r < rows - 1 else np.nan
            gx[r, c] = minmod(left, right)
            gy[r, c] = minmod(down, up)


@njit(cache=True)
def median_of(values, n):
    """Median of values[:n]; sorts them in place."""
    for i in range(1, n):
        a = values[i]
        j = i - 1
        while j >= 0 and values[j] > a:
            values[j + 1] = values[j]
            j -= 1
        values[j + 1] = a
    return 0.5 * (values[(n - 1) // 2] + values[n // 2])


@njit(cache=True)
def reduced(record, low, unit, gx, gy):
    """Height (m) of a point, moved to the cell centre along the slope."""
    h = height_of(record, low, unit)
    place = record & np.uint64(0xFFFFFFFF)
    return h - gx * place_of(place & np.uint64(0xFFFF)) - gy * place_of(place >> np.uint64(16))


@njit(cache=True, nogil=True)
def scatters(start, stop, words, halves, rows, low, unit, gx, gy, done, level, scatter):
    """Median level and robust scatter (1.4826 MAD) of the samples, reduced to the cell centre. `done` (cells, 3)
    tells for which count and slopes they were computed before."""
    buffer = np.empty(rows.shape[1])
    for cell in range(start, stop):
        n, sx, sy = np.float64(words[cell, COUNT]), gx[cell], gy[cell]
        if n == done[cell, 0] and sx == done[cell, 1] and sy == done[cell, 2]:
            continue
        done[cell, 0], done[cell, 1], done[cell, 2] = n, sx, sy
        m = np.int64(halves[cell, 7])
        for i in range(m):
            buffer[i] = reduced(rows[cell, i], low, unit, sx, sy)
        middle = median_of(buffer, m)
        for i in range(m):
            buffer[i] = abs(buffer[i] - middle)
        level[cell] = middle
        scatter[cell] = MAD_TO_SIGMA * median_of(buffer, m)


@njit(cache=True)
def supported(height, cols, r, c, z, limit):
    """Whether a neighbour of cell (r, c) lies within `limit` of z."""
    for rr in range(max(0, r - 1), min(height.shape[0], r + 2)):
        for cc in range(max(0, c - 1), min(cols, c + 2)):
            if (rr != r or cc != c) and abs(height[rr, cc] - z) <= limit:
                return True
    return False


@njit(cache=True)
def alone(height, cols, r, c, z, limit):
    """Whether z is farther than `limit` from all neighbours of cell (r, c), of which at least ALL_AROUND are known."""
    known = 0
    for rr in range(max(0, r - 1), min(height.shape[0], r + 2)):
        for cc in range(max(0, c - 1), min(cols, c + 2)):
            if (rr != r or cc != c) and np.isfinite(height[rr, cc]):
                known += 1
    return known >= ALL_AROUND and not supported(height, cols, r, c, z, limit)


@njit(cache=True, nogil=True)
def inliers(
    start, stop, halves, rows, low, unit, height, cols, gx, gy, level, scatter, pooled, factor, support, needle,
    kept, mean, squares,
):  # fmt: skip
    """Number, mean (m, against the level) and sum of squared deviations (m²) of the samples that are no spikes.

    A cell with many samples can be a spike as a whole: a reflection that stays in place from profile to profile.
    """
    stride = height.shape[1]
    for cell in range(start, stop):
        m = np.int64(halves[cell, 7])
        limit = (
            factor * max(scatter[cell], pooled) if m >= MIN_SAMPLES_OF_SCATTER else factor * pooled
        )
        k, total, square = 0, 0.0, 0.0
        for i in range(m):
            d = reduced(rows[cell, i], low, unit, gx[cell], gy[cell]) - level[cell]
            if m < WEAK:
                h = height_of(rows[cell, i], low, unit)
                good = supported(height, cols, cell // stride, cell % stride, h, support)
            else:
                good = abs(d) <= limit
            if good:
                k += 1
                total += d
                square += d * d
        if m >= WEAK and alone(height, cols, cell // stride, cell % stride, level[cell], needle):
            k = 0
        kept[cell] = k
        mean[cell] = total / k if k else np.nan
        squares[cell] = max(0.0, square - total * total / k) if k else 0.0


@njit(cache=True, nogil=True)
def heights(
    start, stop, words, halves, wave, mean_u, mean_v, gx, gy, level, kept, mean, squares, pooled, pull, z,
    sigma, used,
):  # fmt: skip
    """The better of the two estimates per cell, its standard uncertainty, and the points it stands for.

    pooled: m, scatter of the points about their cells; pull: m², what outliers add to the variance of a point's phase.
    """
    for cell in range(start, stop):
        k, n = kept[cell], np.float64(words[cell, COUNT])
        z[cell] = sigma[cell] = np.nan
        used[cell] = 0
        if k == 0:
            continue
        spread = (PRIOR * pooled * pooled + squares[cell]) / (PRIOR + k - 1)
        z[cell], variance = level[cell] + mean[cell], spread / k
        if np.isfinite(wave[cell]):
            other = wave[cell] - gx[cell] * mean_u[cell] - gy[cell] * mean_v[cell]
            better = (spread + pull) / n
            if better < variance and abs(other - z[cell]) <= AGREE * np.sqrt(variance + better):
                z[cell], variance = other, better
        sigma[cell] = np.sqrt(variance)
        used[cell] = round(n * k / halves[cell, 7])
