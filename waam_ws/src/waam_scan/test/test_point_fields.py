"""Clouds of scanner drivers: the layouts of the public scanCONTROL drivers, and anything else."""

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waam_scan.stream.point_fields import (
    DATATYPES,
    CloudLayout,
    profile_of_rays,
    profiles_of,
    read_fields,
)

F32, U16, U32 = 7, 4, 6
# PCL's PointXYZI: 32 bytes, z is the distance, points without return have z = +infinity
PCL = (('x', 0, F32, 1), ('y', 4, F32, 1), ('z', 8, F32, 1), ('intensity', 16, F32, 1))
# a packed point of 26 bytes, unaligned behind; without return z = 0
PACKED = (
    ('x', 0, F32, 1), ('y', 4, F32, 1), ('z', 8, F32, 1), ('m0', 12, U32, 1), ('m1', 16, U32, 1),
    ('width', 20, U16, 1), ('intensity', 22, U16, 1), ('threshold', 24, U16, 1),
)  # fmt: skip


def test_the_layout_of_pcl_points():
    points = [(0.001, 0, 0.1, 200.0), (0.002, 0, float('inf'), 0.0), (0.003, 0, 0.102, 1023.0)]
    data = b''.join(struct.pack('<fff4xf12x', *p) for p in points)
    x, z = profiles_of(CloudLayout(PCL, 3, 1, 32, 96), data, True)
    np.testing.assert_allclose(x, [[0.001, 0.002, 0.003]], rtol=1e-6)
    np.testing.assert_allclose(z, [[-0.1, -np.inf, -0.102]], rtol=1e-6)
    assert not np.isfinite(z[0, 1]), 'a drop-out for the fusion'


def test_the_packed_layout_without_marks():
    points = [(0.001, 0.0, 0.1, 7, 8, 5, 300, 9), (0.0, 0.0, 0.0, 0, 0, 0, 0, 0)]
    data = b''.join(struct.pack('<fffIIHHH', *p) for p in points)
    x, z = profiles_of(CloudLayout(PACKED, 2, 1, 26, 52), data, True)
    assert z[0, 0] == np.float32(-0.1) and np.isnan(z[0, 1]), 'z = 0 is no return'
    assert x.dtype == z.dtype == np.float32 and x.flags.c_contiguous


def test_rows_padding_byte_order_and_heights_that_point_up():
    fields = (('z', 0, 8, 1), ('x', 8, F32, 1))
    rows = [
        struct.pack('>dfdf', -0.1, 1.0, -0.2, 2.0) + b'pad!',
        struct.pack('>dfdf', -0.3, 3.0, -0.4, 4.0),
    ]
    layout = CloudLayout(fields, 2, 2, 12, 28, big_endian=True)
    x, z = profiles_of(layout, b''.join(rows), False)
    np.testing.assert_allclose(z, [[-0.1, -0.2], [-0.3, -0.4]], rtol=1e-6)
    assert x.tolist() == [[1.0, 2.0], [3.0, 4.0]]


def test_a_profile_lies_in_the_plane_of_its_frame():
    """Points without a return may be anywhere."""
    points = [(0.001, 0.0, 0.1, 0.0), (0.002, 7.0, float('inf'), 0.0)]
    data = b''.join(struct.pack('<fff4xf12x', *p) for p in points)
    assert np.isfinite(profiles_of(CloudLayout(PCL, 2, 1, 32, 64), data, True)[1]).sum() == 1
    beside = data + struct.pack('<fff4xf12x', 0.003, 2e-3, 0.1, 0.0)
    with pytest.raises(ValueError, match='2.000 mm: a profile lies in the plane y = 0'):
        profiles_of(CloudLayout(PCL, 3, 1, 32, 96), beside, True)


def test_rays_look_down_from_the_scanner_and_count_from_its_lateral_axis():
    r = np.array([0.2, 0.1, np.sqrt(2) * 0.1, np.inf, np.nan, -np.inf, 0.04, 0.31, 0.0], np.float32)
    x, z = profile_of_rays(r[:3], -np.pi / 4, np.pi / 4, 0.05, 0.3)
    np.testing.assert_allclose(x, [[-0.2 * np.sqrt(0.5), 0.0, 0.1]], atol=1e-8)
    np.testing.assert_allclose(z, [[-0.2 * np.sqrt(0.5), -0.1, -0.1]], atol=1e-8)
    assert x.dtype == z.dtype == np.float32
    x, z = profile_of_rays(r, 0.0, 0.01, 0.05, 0.3)
    assert np.isfinite(x[0]).tolist() == np.isfinite(z[0]).tolist() == [True] * 3 + [False] * 6
    assert not np.isfinite(profile_of_rays(r[[3, 8]], 0.0, 0.01, 0.0, np.inf)[1]).any()


@pytest.mark.parametrize(
    'n, first, step, nearest, farthest, word',
    [
        (0, 0.0, 0.1, 0.1, 1.0, 'no ranges'),
        (3, np.nan, 0.1, 0.1, 1.0, 'are no scan'),
        (3, 0.0, np.inf, 0.1, 1.0, 'are no scan'),
        (3, 0.0, 0.0, 0.1, 1.0, 'are no scan'),
        (9, 0.0, 1.0, 0.1, 1.0, 'are no scan'),
        (3, 0.0, 0.1, 0.0, 0.0, 'no range lies between'),
        (3, 0.0, 0.1, np.nan, 1.0, 'no range lies between'),
    ],
)
def test_scans_that_cannot_be_are_refused(n, first, step, nearest, farthest, word):
    with pytest.raises(ValueError, match=word):
        profile_of_rays(np.ones(n, np.float32), first, step, nearest, farthest)


@pytest.mark.parametrize(
    'layout, data, word',
    [
        (CloudLayout(PCL, 3, 1, 32, 96), bytes(95), '95 bytes of data'),
        (CloudLayout(PCL, 0, 1, 32, 0), b'', 'empty cloud'),
        (CloudLayout(PCL[:2], 1, 1, 32, 32), bytes(32), 'no field z'),
        (CloudLayout(PCL, 1, 1, 10, 10), bytes(10), 'does not fit'),
        (CloudLayout((('x', 0, 99, 1),), 1, 1, 4, 4), bytes(4), 'unknown datatype'),
        (CloudLayout(PCL, 4, 2, 32, 64), bytes(1000), 'row_step'),
    ],
)
def test_what_does_not_fit_is_refused_with_the_reason(layout, data, word):
    with pytest.raises(ValueError, match=word):
        profiles_of(layout, data, True)


field = st.tuples(
    st.sampled_from(['x', 'z', 'intensity', 'y', '']), st.integers(0, 80), st.integers(0, 10), st.integers(0, 3)
)  # fmt: skip


@given(
    st.lists(field, max_size=6), st.integers(0, 6), st.integers(0, 4), st.integers(0, 70),
    st.integers(0, 200), st.booleans(), st.binary(max_size=600),
)  # fmt: skip
def test_any_layout_and_any_bytes_give_arrays_or_a_reason(fields, w, h, step, row, big, data):
    layout = CloudLayout(tuple(fields), w, h, step, row, big)
    try:
        x, z = profiles_of(layout, data, True)
    except ValueError:
        return
    assert x.shape == z.shape == (h, w)


@given(
    st.lists(st.floats(-1, 1, width=32), min_size=1, max_size=20),
    st.sampled_from(sorted(DATATYPES)),
)
def test_values_come_back_in_their_own_type(values, datatype):
    kind = np.dtype('<' + DATATYPES[datatype])
    a = np.array(values).astype(kind)
    layout = CloudLayout((('x', 0, datatype, 1),), len(a), 1, kind.itemsize, 0)
    assert read_fields(layout, a.tobytes(), ('x',))['x'][0].tolist() == a.tolist()
