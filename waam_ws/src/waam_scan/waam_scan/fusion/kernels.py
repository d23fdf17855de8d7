"""Compiled loops that sort points into cells; `accumulator.py` says what the arrays hold.

Everything that is kept per cell is an integer sum or a set, so neither order nor batching nor the number of threads can
change a bit of it. A point becomes three small integers: height in units of period / 16384 above the lower limit, and
its place in the cell in 1/65536. From them follow

* the count, the sums of cosine and sine of the height's phase in the period (for the sine M-estimator, see
  `cell_kernels.py`) and the sums of the place, two 32-bit sums to one 64-bit word;
* the sample: the distinct points of the cell whose hash is below a threshold that is lowered whenever they no longer
  fit into the slots (adaptive threshold sampling after Gibbons, VLDB 2001): a random sample that depends on the points
  only.
"""

from __future__ import annotations

import numpy as np
from numba import njit

CHUNK = 512  # points that are prepared at a time: vectorised, and still in the first-level cache for the second loop
UNITS = 16384  # height units per period
PHASES = 1024  # entries of the phase table
# of the table's cosine and sine, which are stored with this offset (never negative)
AMPLITUDE = 1 << 14
COUNT, PHASE, PLACE, SAMPLE = range(4)  # words of a cell
SPILL = 0xFFFF  # after so many points the 32-bit sums of a cell are emptied into 64-bit ones
OPEN = 0xFFFFFFFF  # threshold of a cell that still keeps every distinct point
OUTSIDE, DROPOUT = 0xFFFFFFFF, 0xFFFFFFFE  # instead of a cell number
EXPONENT = 0x7F800000  # of a float32: all ones for NaN and infinity


def phase_table() -> np.ndarray:
    """(PHASES,) uint64: offset cosine in the low and offset sine in the high 32 bits."""
    angle = (np.arange(PHASES) + 0.5) * (2 * np.pi / PHASES)
    c, s = (np.round(AMPLITUDE * f(angle) + AMPLITUDE).astype(np.uint64) for f in (np.cos, np.sin))
    return c | (s << np.uint64(32))


def read_only(values: np.ndarray) -> np.ndarray:
    """A view that cannot be written: the loops are compiled once, for what came over the wire and for all else."""
    view = values.view()
    view.flags.writeable = False
    return view


@njit(cache=True)
def key_of(height, place):
    """32-bit hash of a point (two rounds of multiply and shift, constants of xxHash and MurmurHash3)."""
    k = np.uint32(height * np.uint32(0x9E3779B1))
    k = np.uint32(k ^ (k >> np.uint32(15)))
    k = np.uint32(np.uint32(k ^ np.uint32(place * np.uint32(0x85EBCA77))) * np.uint32(0x2C1B3C6D))
    k = np.uint32(k ^ (k >> np.uint32(13)))
    k = np.uint32(k * np.uint32(0x297A2D39))
    return np.uint32(k ^ (k >> np.uint32(16)))


@njit(cache=True)
def record_key(record):
    """`key_of` the point in a record (height << 32 | place)."""
    return key_of(np.uint32(record >> np.uint64(32)), np.uint32(record))


@njit(cache=True, nogil=True, error_model='numpy')
def prepare(origin, axis, x, z, x_bits, z_bits, size, low, high, per_unit, cells, keys, heights, places):  # fmt: skip
    """One stretch of a profile to cell numbers, hashes, heights and places. Free of branches, so that it vectorises;
    no fused or reassociated arithmetic, so that vector and remainder loops agree to the last bit."""
    zero, one = np.float32(0), np.uint32(EXPONENT)
    cols, rows, per_col, per_row = size
    ou, ov, oh = origin[0], origin[1], origin[2]
    ux, vx, hx, uz, vz, hz = axis[0], axis[1], axis[2], axis[3], axis[4], axis[5]
    for k in range(len(x)):
        ok = ((x_bits[k] & one) != one) & ((z_bits[k] & one) != one)
        xs = x[k] if ok else zero
        zs = z[k] if ok else zero
        u = ou + ux * xs + uz * zs
        v = ov + vx * xs + vz * zs
        h = oh + hx * xs + hz * zs
        good = ok & (u >= zero) & (u < cols) & (v >= zero) & (v < rows) & (h >= low) & (h <= high)
        u = u if good else zero
        v = v if good else zero
        h = h if good else low
        col, row = np.int32(u), np.int32(v)
        cell = np.uint32(np.int32(np.int32(row * per_row) + np.int32(col * per_col)))
        cells[k] = cell if good else (np.uint32(OUTSIDE) if ok else np.uint32(DROPOUT))
        pu = np.uint32(np.int32((u - np.float32(col)) * np.float32(65536)))
        pv = np.uint32(np.int32((v - np.float32(row)) * np.float32(65536)))
        place = np.uint32(pu | np.uint32(pv << np.uint32(16)))
        height = np.uint32(np.int32((h - low) * per_unit))
        places[k], heights[k], keys[k] = place, height, key_of(height, place)


@njit(cache=True)
def lower(threshold):
    """The next threshold: five eighths of it, so that a sample that has become too large keeps that much of itself."""
    return np.uint32(np.uint64(threshold) * np.uint64(5) >> np.uint64(3))


@njit(cache=True, nogil=True)
def distinct(rows, cell, m):
    """Moves the distinct ones of rows[cell, :m] to the front and returns their number."""
    k = 0
    for i in range(m):
        record = rows[cell, i]
        new = True
        for j in range(k):
            if rows[cell, j] == record:
                new = False
        if new:
            rows[cell, k] = record
            k += 1
    return k


@njit(cache=True, nogil=True)
def thin(rows, cell, m, threshold):
    """Keeps those of rows[cell, :m] whose hash is not above the threshold; returns their number."""
    k = 0
    for i in range(m):
        record = rows[cell, i]
        if record_key(record) <= threshold:
            rows[cell, k] = record
            k += 1
    return k


@njit(cache=True, nogil=True)
def make_room(cell, record, key, halves, rows, own):
    """Puts a point into a full cell: repeats go first, then the threshold is lowered until there is room.
    own: buffer for two times the hashes of the cell's points."""
    slots, one = np.uint64(rows.shape[1]), np.uint64(1)
    for i in range(slots):
        at = np.uint64(i)
        own[at] = own[at + slots] = record_key(rows[cell, at])
    clash = False  # of hashes, as repeats have, and as others rarely have: looks at all pairs, which vectorises
    for shift in range(one, (slots >> one) + one):
        for i in range(slots):
            clash |= own[np.uint64(i)] == own[np.uint64(i) + np.uint64(shift)]
    m = slots
    if clash:
        m = np.uint64(distinct(rows, cell, np.int64(slots)))
        for i in range(m):
            own[np.uint64(i)] = record_key(rows[cell, np.uint64(i)])
    for i in range(m):
        if own[np.uint64(i)] == key and rows[cell, np.uint64(i)] == record:
            halves[cell, 7] = np.uint32(m)
            return
    threshold = halves[cell, 6]
    while m == slots and key <= threshold and threshold > 0:
        threshold = lower(threshold)
        m = np.uint64(0)
        for i in range(slots):
            rows[cell, m] = rows[cell, np.uint64(i)]
            m += np.uint64(own[np.uint64(i)] <= threshold)
    halves[cell, 6] = threshold
    if key <= threshold and m < slots:
        rows[cell, m] = record
        m += one
    halves[cell, 7] = np.uint32(m)


@njit(cache=True, nogil=True)
def spill(cell, words, sums):
    """Empties the 32-bit sums of a cell into its 64-bit ones."""
    low, shift = np.uint64(0xFFFFFFFF), np.uint64(32)
    for k in range(2):
        word = words[cell, PHASE + k]
        sums[cell, 2 * k] += np.int64(word & low)
        sums[cell, 2 * k + 1] += np.int64(word >> shift)
        words[cell, PHASE + k] = 0


@njit(cache=True, nogil=True, error_model='numpy')
def scatter(cells, keys, heights, places, table, words, halves, sums, late):
    """Adds prepared points to the sums of their cells; returns (drop-outs, points outside, number of points for the
    sample). late: where the indices of those go."""
    dropouts = outside = 0
    low16, waiting = np.uint64(0xFFFF), np.uint64(0)
    for k in range(len(cells)):
        cell = np.uint64(cells[k])
        if cell >= np.uint64(DROPOUT):
            outside += np.int64(cell & np.uint64(1))
            dropouts += np.int64(np.uint64(1) - (cell & np.uint64(1)))
            continue
        height, place = heights[k], np.uint64(places[k])
        n = words[cell, COUNT] + np.uint64(1)
        words[cell, COUNT] = n
        words[cell, PHASE] += table[np.uint64((height >> np.uint32(4)) & np.uint32(PHASES - 1))]
        words[cell, PLACE] += (place & low16) | ((place >> np.uint64(16)) << np.uint64(32))
        if (n & np.uint64(SPILL)) == 0:
            spill(cell, words, sums)
        late[waiting] = k
        waiting += np.uint64(keys[k] <= halves[cell, 6])
    return dropouts, outside, waiting


@njit(cache=True, nogil=True, error_model='numpy')
def admit(late, cells, keys, heights, places, halves, rows, own):
    """Puts the points `late` into the samples of their cells.

    The samples of a whole grid do not fit into a cache: the first loop fetches all that is needed, at once."""
    slots, fetched = np.uint64(rows.shape[1]), np.uint64(0)
    for k in late:
        cell = np.uint64(cells[np.uint64(k)])
        fetched |= rows[cell, 0] | rows[cell, slots >> np.uint64(1)]
    own[0] = np.uint32(fetched)  # or the compiler would leave it out
    for i in late:
        k = np.uint64(i)
        cell, key = np.uint64(cells[k]), keys[k]
        if key <= halves[cell, 6]:
            record = (np.uint64(heights[k]) << np.uint64(32)) | np.uint64(places[k])
            m = np.uint64(halves[cell, 7])
            if m < slots:
                rows[cell, m] = record
                halves[cell, 7] = np.uint32(m + np.uint64(1))
            else:
                make_room(cell, record, key, halves, rows, own)


@njit(cache=True, nogil=True, error_model='numpy')
def add_profiles(
    origins, axis, x, z, x_bits, z_bits, size, low, high, per_unit, table, words, halves, rows, sums,
):  # fmt: skip
    """Adds profiles x, z (n, m) float32 with origins (n, 3) float32 (columns, rows, m); returns (drop-outs,
    outside)."""
    cells, keys = np.empty(CHUNK, np.uint32), np.empty(CHUNK, np.uint32)
    heights, places = np.empty(CHUNK, np.uint32), np.empty(CHUNK, np.uint32)
    late, own = np.empty(CHUNK, np.uint32), np.empty(2 * rows.shape[1], np.uint32)
    dropouts = outside = 0
    for i in range(x.shape[0]):
        for j in range(0, x.shape[1], CHUNK):
            end = min(j + CHUNK, x.shape[1])
            m = end - j
            prepare(
                origin=origins[i], axis=axis, x=x[i, j:end], z=z[i, j:end], x_bits=x_bits[i, j:end],
                z_bits=z_bits[i, j:end], size=size, low=low, high=high, per_unit=per_unit, cells=cells, keys=keys,
                heights=heights, places=places,
            )  # fmt: skip
            d, o, waiting = scatter(
                cells=cells[:m], keys=keys[:m], heights=heights[:m], places=places[:m], table=table, words=words,
                halves=halves, sums=sums, late=late,
            )  # fmt: skip
            admit(late[:waiting], cells, keys, heights, places, halves, rows, own)
            dropouts += d
            outside += o
    return dropouts, outside


@njit(cache=True, nogil=True)
def merge_sample(cell, halves, rows, other, m_other, threshold, buffer):
    """Unites the sample of a cell with `other` (m_other records), thinned to a common threshold."""
    slots = rows.shape[1]
    m = np.int64(halves[cell, 7])
    buffer[0, :m] = rows[cell, :m]
    buffer[0, m : m + m_other] = other[:m_other]
    k = thin(buffer, 0, distinct(buffer, 0, m + m_other), threshold)
    while k > slots and threshold > 0:
        threshold = lower(threshold)
        k = thin(buffer, 0, k, threshold)
    k = min(k, slots)
    rows[cell, :k] = buffer[0, :k]
    halves[cell, 6], halves[cell, 7] = threshold, k


@njit(cache=True, nogil=True)
def merge(start, stop, words, halves, rows, sums, words2, halves2, rows2, sums2):
    """Moves what the second accumulator holds of the cells start .. stop into the first one and empties it."""
    buffer = np.empty((1, 2 * rows.shape[1]), np.uint64)
    for cell in range(start, stop):
        n = words2[cell, COUNT]
        if n == 0:
            continue
        spill(cell, words, sums)
        spill(cell, words2, sums2)
        words[cell, COUNT] += n
        for k in range(4):
            sums[cell, k] += sums2[cell, k]
            sums2[cell, k] = 0
        threshold = min(halves[cell, 6], halves2[cell, 6])
        m = np.int64(halves2[cell, 7])
        merge_sample(cell, halves, rows, rows2[cell], m, threshold, buffer)
        words2[cell, COUNT] = 0
        halves2[cell, 6], halves2[cell, 7] = OPEN, 0


@njit(cache=True, nogil=True)
def rows_seen(x, z):
    """Whether each profile (n, m) has a point with finite x and z; stops at the first one."""
    seen = np.zeros(len(x), np.bool_)
    for i in range(len(x)):
        for j in range(x.shape[1]):
            if np.isfinite(x[i, j]) and np.isfinite(z[i, j]):
                seen[i] = True
                break
    return seen
