import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waam_scan.transform import Mounting, rotation_rpy

ANGLE = st.floats(-3.1, 3.1)


def test_the_default_scanner_looks_across_the_travel():
    p = Mounting().points(np.array([[0.1, 0.2, 0.03]]), np.array([[0.01]]), np.array([[-0.14]]))
    assert np.allclose(p, [[[0.16, 0.21, 0.01]]])


@given(ANGLE, ANGLE, ANGLE)
def test_rotation_is_roll_then_pitch_then_yaw_about_fixed_axes(roll, pitch, yaw):
    def about(axis, a):
        k = np.zeros((3, 3))
        i, j = (axis + 1) % 3, (axis + 2) % 3
        k[j, i], k[i, j] = 1, -1
        return np.eye(3) + np.sin(a) * k + (1 - np.cos(a)) * k @ k  # Rodrigues

    assert np.allclose(
        rotation_rpy(roll, pitch, yaw), about(2, yaw) @ about(1, pitch) @ about(0, roll)
    )


@given(ANGLE, ANGLE, ANGLE, st.floats(-0.05, 0.05), st.floats(-0.2, 0.0))
def test_a_mounting_keeps_distances(roll, pitch, yaw, x, z):
    mounting = Mounting.from_rpy((0.1, -0.2, 0.3), (roll, pitch, yaw))
    p = mounting.points(np.zeros((1, 3)), np.array([[x]]), np.array([[z]]))[0, 0]
    assert np.isclose(np.linalg.norm(p - [0.1, -0.2, 0.3]), np.hypot(x, z), atol=1e-12)


@pytest.mark.parametrize(
    'offset, rotation',
    [
        (np.zeros(2), np.eye(3)),
        (np.array([0, 0, np.nan]), np.eye(3)),
        (np.zeros(3), 2 * np.eye(3)),
        (np.zeros(3), np.diag([1.0, 1.0, -1.0])),
    ],
)
def test_a_mounting_that_is_none_is_refused(offset, rotation):
    with pytest.raises(ValueError, match='mounting'):
        Mounting(offset, rotation)
    with pytest.raises(ValueError, match='3 \\+ 3 numbers'):
        Mounting.from_rpy((0, 0), (0, 0, 0))
