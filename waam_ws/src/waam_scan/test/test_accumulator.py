"""What the cells hold does not depend on order, batches, threads or copies; and no sum overflows."""

import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from waam_process.grid import GridSpec
from waam_scan.fusion import height_map as fusion_module
from waam_scan.fusion import heights as heights_module
from waam_scan.fusion.height_map import Fusion
from waam_scan.fusion.limits import FusionLimits
from waam_scan.transform import Mounting

SPEC = GridSpec(0.0, 0.0, 0.25e-3, 24, 40)
FLAT = Mounting(np.array([0.0, 0.0, 0.1]))


def profiles(seed, n=300, m=64, quantum=0.0):
    """tcp (n, 3), x, z (n, m): a slope with noise, 2 % spikes and 5 % drop-outs; quantum: m, heights are rounded."""
    rng = np.random.default_rng(seed)
    tcp = np.column_stack([rng.uniform(0, 10e-3, n), np.full(n, 3e-3), np.zeros(n)])
    x = np.tile(np.linspace(-3.2e-3, 3.2e-3, m), (n, 1)).astype(np.float32)
    z = 0.2 * x + rng.normal(0, 30e-6, x.shape)
    z[rng.random(x.shape) < 0.02] += 3e-3
    if quantum:
        z = np.round(z / quantum) * quantum
    z[rng.random(x.shape) < 0.05] = np.nan
    return tcp, x, (z - 0.1).astype(np.float32)


def same(a, b):
    for name in ('z', 'sigma', 'count', 'scatter'):
        assert getattr(a, name).tobytes() == getattr(b, name).tobytes(), name
    for name in ('coverage', 'residual', 'points_used', 'dropouts', 'outside', 'spikes'):
        assert getattr(a, name) == getattr(b, name), name


class Turned(Mounting):
    """The same scanner, whose map lies the other way round in memory."""

    along_rows = not FLAT.along_rows


TURNED = Turned(FLAT.offset)


def whole(scan, mounting=FLAT, **options):
    f = Fusion(SPEC, mounting, **options)
    f.add(*scan)
    return f


@settings(max_examples=12, deadline=None)
@given(st.integers(0, 2**31), st.integers(1, 60), st.integers(1, 3), st.sampled_from([0.0, 20e-6]))
def test_order_batches_threads_merges_and_looks_in_between_change_no_bit(
    seed, chunk, parts, quantum
):
    tcp, x, z = scan = profiles(seed, quantum=quantum)
    order = np.random.default_rng(seed + 1).permutation(len(tcp))
    pieces = [Fusion(SPEC, (FLAT, TURNED)[k % 2], threads=1 + k % 2) for k in range(parts)]
    for i in range(0, len(order), chunk):
        part = order[i : i + chunk]
        f = pieces[i // chunk % parts]
        f.add(tcp[part], x[part][:, ::-1], z[part][:, ::-1])
        if i % 3 == 0:
            f.result()
    for other in pieces[1:]:
        pieces[0].merge(other)
    same(whole(scan).result(), pieces[0].result())


def test_two_threads_share_a_large_batch(monkeypatch):
    monkeypatch.setattr(fusion_module, 'PARALLEL_FROM', 1000)
    scan = profiles(3)
    double = whole(scan, threads=2)
    assert len(double._parts) == 2
    same(whole(scan).result(), double.result())
    double.add(*profiles(4))
    single = whole(scan)
    single.add(*profiles(4))
    same(single.result(), double.result())


def test_how_the_cells_lie_in_memory_changes_no_bit_even_when_only_some_cells_tell_the_noise(
    monkeypatch,
):
    monkeypatch.setattr(heights_module, 'WITNESSES', 50)
    scan = profiles(8)
    one, other = whole(scan), whole(scan, TURNED)
    assert one._parts[0].turned != other._parts[0].turned
    same(one.result(), other.result())


def test_the_sample_holds_distinct_points_of_all_that_came():
    """What the slots hold is the set of points below a threshold: checked against all points of the cell."""
    scan = profiles(5, n=600)
    f = whole(scan)
    cells = f._parts[0]
    f.refresh()
    sizes, counts = cells.halves[:, 7], cells.words[:, 0]
    full = counts > 40
    assert full.sum() > 200
    assert (sizes[full] <= 16).all() and sizes[full].mean() > 9, 'between half full and full'
    assert (sizes[counts <= 16] == counts[counts <= 16]).all(), 'few points: all are there'
    rows = cells.rows[full]
    assert all(len(set(r[:k])) == k for r, k in zip(rows, sizes[full], strict=True))


def test_copies_of_a_point_do_not_crowd_out_the_others():
    tcp, x, z = profiles(6, n=40)
    f = whole((tcp, x, z))
    before = f.result()
    for _ in range(200):
        f.add(tcp[:2], x[:2], z[:2])
    after = f.result()
    known = np.isfinite(before.z)
    assert (np.isfinite(after.z) == known).all()
    assert np.nanmax(np.abs(after.z - before.z)) < 0.2e-3


def test_sums_beyond_32_bits_stay_exact():
    """A parked scanner: 300 000 points in one cell, four times what 32 bits of the place sums can hold."""
    rng = np.random.default_rng(7)
    tcp = np.tile([2.1e-3, 2.1e-3, 0.0], (300, 1))
    x = rng.uniform(0.0, 0.1e-3, (300, 1000)).astype(np.float32)
    z = (rng.normal(1e-3, 30e-6, x.shape) - 0.1).astype(np.float32)
    m = whole((tcp, x, z)).result()
    row, col = (int(v) for v in SPEC.cell(2.1e-3, 2.15e-3))
    assert m.count[row, col] == 65535 and m.points_used > 280_000
    assert abs(m.z[row, col] - 1e-3) < 1e-6
    assert m.sigma[row, col] < 0.2e-6


def test_memory_and_peak_do_not_grow_with_the_scan():
    f = whole(profiles(0))
    f.result()
    scans = [profiles(seed) for seed in range(4)]
    tracemalloc.start()
    peaks = []
    for count in (4, 40):
        tracemalloc.reset_peak()
        for k in range(count):
            f.add(*scans[k % 4])
        f.result()
        peaks.append(tracemalloc.get_traced_memory()[1])
    tracemalloc.stop()
    assert peaks[1] < 1.1 * peaks[0], 'ten times the points'


def test_only_equal_grids_merge_and_the_other_one_is_empty_then():
    a, b = whole(profiles(1)), whole(profiles(2))
    a.merge(b)
    assert b.points == 0 and b.result().points_used == 0
    with pytest.raises(ValueError, match='same grid'):
        a.merge(Fusion(GridSpec(0, 0, 1e-3, 5, 5), FLAT))
    with pytest.raises(ValueError, match='height_min'):
        Fusion(SPEC, FLAT, FusionLimits(height_min=0.1, height_max=0.1))
