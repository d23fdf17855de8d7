"""Compiled loops of the fusion. Everything here works on plain arrays; `fusion.py` says what they mean.

Per cell a fixed number of slots keeps the points with the smallest hash of their own coordinates ("bottom-k sampling",
Cohen and Kaplan 2007): a random sample of all points of the cell that does not depend on the order in which they came
and needs no memory beyond the slots. While a cell has no more points than slots, the sample is all of them.
"""

from __future__ import annotations

import numpy as np
from numba import njit

MAD_TO_SIGMA = 1.4826  # median absolute deviation -> standard deviation of a normal distribution
ENOUGH = 5  # samples from which the scatter of a cell says something about noise
WEAK = 4  # cells with fewer samples need a neighbour at a similar height


@njit(cache=True, inline='always')
def mix(h):
    """Finaliser of MurmurHash3, 64 bit: every input bit changes every output bit with probability one half."""
    h ^= h >> np.uint64(33)
    h *= np.uint64(0xFF51AFD7ED558CCD)
    h ^= h >> np.uint64(33)
    h *= np.uint64(0xC4CEB9FE1A85EC53)
    return h ^ (h >> np.uint64(33))


@njit(cache=True)
def keep_sample(cell, key, u, v, z, count, top, keys, samples):
    """Puts one point into the slots of its cell when there is room or its key is below the largest one kept."""
    slots = keys.shape[1]
    n = count[cell]
    if n < slots:
        slot = n
    else:
        if key >= top[cell]:
            return
        slot = 0
        for i in range(1, slots):
            if keys[cell, i] > keys[cell, slot]:
                slot = i
    keys[cell, slot] = key
    samples[cell, slot, 0] = u
    samples[cell, slot, 1] = v
    samples[cell, slot, 2] = z
    if n + 1 >= slots:
        largest = keys[cell, 0]
        for i in range(1, slots):
            largest = max(largest, keys[cell, i])
        top[cell] = largest


@njit(cache=True, nogil=True, error_model='numpy')
def add_profiles(
    origins, origin_keys, axis_x, axis_z, x, z, x_bits, z_bits, corner, resolution, rows, cols,
    height_min, height_max, count, top, keys, samples,
):  # fmt: skip
    """Adds profiles x, z (n, m) with scanner origins (n, 3); returns (drop-outs, points outside grid or heights)."""
    dropouts = outside = 0
    inv = 1.0 / resolution
    for i in range(x.shape[0]):
        ox = (origins[i, 0] - corner[0]) * inv
        oy = (origins[i, 1] - corner[1]) * inv
        oz = origins[i, 2]
        ux, uz = axis_x[0] * inv, axis_z[0] * inv
        vx, vz = axis_x[1] * inv, axis_z[1] * inv
        for j in range(x.shape[1]):
            xs, zs = np.float64(x[i, j]), np.float64(z[i, j])
            if not (np.isfinite(xs) and np.isfinite(zs)):
                dropouts += 1
                continue
            u = ox + ux * xs + uz * zs
            v = oy + vx * xs + vz * zs
            h = oz + axis_x[2] * xs + axis_z[2] * zs
            if not (0.0 <= u < cols and 0.0 <= v < rows and height_min <= h <= height_max):
                outside += 1
                continue
            col, row = int(u), int(v)
            cell = row * cols + col
            bits = (np.uint64(x_bits[i, j]) << np.uint64(32)) | np.uint64(z_bits[i, j])
            key = mix(bits ^ origin_keys[i])
            n = count[cell]
            if n < keys.shape[1] or key < top[cell]:
                keep_sample(cell, key, u - col - 0.5, v - row - 0.5, h, count, top, keys, samples)
            count[cell] = n + 1
    return dropouts, outside


@njit(cache=True, nogil=True)
def sort_samples(count, keys, samples):
    """Orders the samples of every cell by key, so that sums do not depend on the order of arrival either."""
    slots = keys.shape[1]
    for cell in range(count.shape[0]):
        n = min(count[cell], slots)
        for i in range(1, n):
            key = keys[cell, i]
            u, v, z = samples[cell, i, 0], samples[cell, i, 1], samples[cell, i, 2]
            j = i - 1
            while j >= 0 and keys[cell, j] > key:
                keys[cell, j + 1] = keys[cell, j]
                for a in range(3):
                    samples[cell, j + 1, a] = samples[cell, j, a]
                j -= 1
            keys[cell, j + 1] = key
            samples[cell, j + 1, 0], samples[cell, j + 1, 1], samples[cell, j + 1, 2] = u, v, z


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
    return values[n // 2] if n % 2 else 0.5 * (values[n // 2 - 1] + values[n // 2])


@njit(cache=True, nogil=True)
def cell_medians(count, samples, medians):
    """Median height per cell into medians (cells,); NaN where there is no point."""
    slots = samples.shape[1]
    buffer = np.empty(slots)
    for cell in range(count.shape[0]):
        n = min(count[cell], slots)
        for i in range(n):
            buffer[i] = samples[cell, i, 2]
        medians[cell] = median_of(buffer, n) if n else np.nan


@njit(cache=True)
def minmod(back, ahead):
    """The smaller of two slopes of equal sign, else 0: a slope that makes no new peak."""
    if not (np.isfinite(back) and np.isfinite(ahead)) or back * ahead <= 0:
        return 0.0
    return back if abs(back) < abs(ahead) else ahead


@njit(cache=True, nogil=True)
def slopes(medians, gx, gy):
    """Height change per cell along columns and rows, from the neighbours' medians (rows, cols); 0 where not known."""
    rows, cols = medians.shape
    for r in range(rows):
        for c in range(cols):
            m = medians[r, c]
            left = m - medians[r, c - 1] if c > 0 else np.nan
            right = medians[r, c + 1] - m if c < cols - 1 else np.nan
            down = m - medians[r - 1, c] if r > 0 else np.nan
            up = medians[r + 1, c] - m if r < rows - 1 else np.nan
            gx[r, c] = minmod(left, right)
            gy[r, c] = minmod(down, up)


@njit(cache=True)
def supported(medians, r, c, z, limit):
    """Whether a neighbour of cell (r, c) lies within `limit` of z."""
    rows, cols = medians.shape
    for rr in range(max(0, r - 1), min(rows, r + 2)):
        for cc in range(max(0, c - 1), min(cols, c + 2)):
            if (rr != r or cc != c) and abs(medians[rr, cc] - z) <= limit:
                return True
    return False


@njit(cache=True, nogil=True)
def cell_scatter(count, samples, gx, gy, levels, scatter):
    """Median level and robust scatter (1.4826 MAD) of every cell's samples, reduced to the cell centre by the slope."""
    slots = samples.shape[1]
    buffer = np.empty(slots)
    for cell in range(count.shape[0]):
        n = min(count[cell], slots)
        levels[cell] = scatter[cell] = np.nan
        if n == 0:
            continue
        for i in range(n):
            s = samples[cell, i]
            buffer[i] = s[2] - gx[cell] * s[0] - gy[cell] * s[1]
        level = median_of(buffer, n)
        for i in range(n):
            buffer[i] = abs(buffer[i] - level)
        levels[cell] = level
        scatter[cell] = MAD_TO_SIGMA * median_of(buffer, n)


@njit(cache=True, nogil=True)
def cell_means(
    count, samples, medians, gx, gy, levels, scatter, pooled, factor, support_limit, z, sigma, used
):
    """Mean of the inliers per cell with its standard uncertainty and how many points it stands for."""
    rows, cols = medians.shape
    slots = samples.shape[1]
    for cell in range(count.shape[0]):
        n = min(count[cell], slots)
        z[cell] = sigma[cell] = np.nan
        used[cell] = 0
        if n == 0:
            continue
        limit = factor * max(scatter[cell], pooled)
        k, total, squares = 0, 0.0, 0.0
        for i in range(n):
            s = samples[cell, i]
            if n < WEAK:
                good = supported(medians, cell // cols, cell % cols, s[2], support_limit)
            else:
                good = abs(s[2] - gx[cell] * s[0] - gy[cell] * s[1] - levels[cell]) <= limit
            if good:
                d = s[2] - gx[cell] * s[0] - gy[cell] * s[1] - levels[cell]
                k += 1
                total += d
                squares += d * d
        if k == 0:
            continue
        z[cell] = levels[cell] + total / k
        spread = pooled
        if k >= ENOUGH:
            spread = max(np.sqrt(max(0.0, squares - total * total / k) / (k - 1)), 0.25 * pooled)
        sigma[cell] = spread / np.sqrt(k)
        used[cell] = round(count[cell] * k / n)
