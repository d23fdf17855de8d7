"""The compiled loops beside their definition, written with NumPy."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest
from scipy import sparse
from scipy.ndimage import correlate

from waam_adapt.beads import kernels
from waam_adapt.laws.convolution import conv3x3

ROWS, COLS, REACH, ALONG, ACROSS, TINY = 14, 11, 3, 0.8, 1.3, 5e-3


def pieces(seed: int, n: int = 30):
    rng = np.random.default_rng(seed)
    place = rng.uniform(-2, 16, (n, 2))  # some off the grid
    angle = rng.uniform(0, 6.3, n)
    return place, np.stack([np.cos(angle), np.sin(angle)], 1), rng.uniform(0.5, 1.5, n)


@pytest.mark.parametrize('seed', range(3))
def test_shares_of_a_piece_are_a_gaussian_about_it(seed):
    place, tangent, step = pieces(seed)
    metal, cell, first = kernels.shares(
        place=place, tangent=tangent, step=step, rows=ROWS, cols=COLS, reach=REACH, along=ALONG, across=ACROSS,
        tiny=TINY,
    )  # fmt: skip
    for p in range(len(step)):
        row, col = (np.floor(place[p, i]) + np.arange(-REACH, REACH + 1) for i in (0, 1))
        y, x = np.meshgrid(row + 0.5 - place[p, 0], col + 0.5 - place[p, 1], indexing='ij')
        along = x * tangent[p, 0] + y * tangent[p, 1]
        across = x * tangent[p, 1] - y * tangent[p, 0]
        weight = np.exp(-0.5 * ((along / ALONG) ** 2 + (across / ACROSS) ** 2))
        i, j = np.mgrid[-REACH : REACH + 1, -REACH : REACH + 1]
        weight[np.hypot(i, j) > REACH + 0.5] = 0.0
        weight /= weight.sum()
        rows, cols = np.meshgrid(row, col, indexing='ij')
        kept = (weight > TINY) & (rows >= 0) & (rows < ROWS) & (cols >= 0) & (cols < COLS)
        mine = slice(first[p], first[p + 1])
        assert (cell[mine] == (rows * COLS + cols)[kept]).all()
        assert metal[mine] == pytest.approx(step[p] * weight[kept], rel=1e-12)


def test_pieces_off_the_grid_give_nothing():
    place, tangent, step = np.array([[-40.0, 3.0]]), np.array([[1.0, 0.0]]), np.ones(1)
    metal, cell, first = kernels.shares(
        place=place, tangent=tangent, step=step, rows=ROWS, cols=COLS, reach=REACH, along=ALONG, across=ACROSS,
        tiny=TINY,
    )  # fmt: skip
    assert not len(metal) and not len(cell) and (first == 0).all()
    nearest = np.zeros((ROWS, COLS), np.int64)
    assert not kernels.neighbours(
        place=place, step=step, run=step, nearest=nearest, reach=5.0, narrow=1.0, wide=2.0, apart=1.5, fade=8.0,
    ).any()  # fmt: skip


def test_gradient_and_curvature_of_the_least_squares():
    rng = np.random.default_rng(4)
    a = sparse.random_array((9, 6), density=0.4, rng=rng, format='csr')
    weight, need, x = rng.uniform(0, 1, 9), rng.normal(size=9), rng.normal(size=6)
    weight[3] = 0.0
    entries = a.data, a.indices.astype(np.uint32), a.indptr.astype(np.uint32), weight
    full = a.toarray()
    normal = full.T @ np.diag(weight) @ full
    found = kernels.gradient(*entries, need, x)
    assert found == pytest.approx(normal @ x - full.T @ (weight * need), abs=1e-12)
    diagonal, total = kernels.curvature(*entries, 6)
    assert diagonal == pytest.approx(np.diag(normal), abs=1e-12)
    assert total == pytest.approx(normal.sum(axis=1), abs=1e-12)


@pytest.mark.parametrize(('inputs', 'outputs'), [(3, 4), (1, 5), (7, 11)])
def test_a_convolution_sees_zeros_around_and_gives_nothing_below_zero(inputs, outputs):
    rng = np.random.default_rng(outputs)
    x = rng.standard_normal((inputs, ROWS, COLS)).astype(np.float32)
    weight = rng.standard_normal((outputs, inputs, 3, 3)).astype(np.float32)
    bias = rng.standard_normal(outputs).astype(np.float32)
    wanted = [
        sum(correlate(a, w, mode='constant') for a, w in zip(x, some, strict=True)) + b
        for some, b in zip(weight, bias, strict=True)
    ]
    assert conv3x3(x, weight, bias) == pytest.approx(np.maximum(wanted, 0.0), abs=1e-4)


def test_the_server_has_loaded_all_that_it_needs_before_the_first_layer():
    """A node that loads compiled loops or modules in its first answer gives no heartbeat for seconds on a busy core."""
    code = """
import sys
import rclpy
from waam_adapt.beads import kernels
from waam_adapt.correction_server_node import CorrectionServer
from waam_adapt.laws import convolution
from waam_adapt.laws.corrector import warm_up
loops = kernels.shares, kernels.neighbours, kernels.curvature, kernels.gradient, convolution._conv3x3
assert not any(loop.signatures for loop in loops)
rclpy.init()
server = CorrectionServer()
assert all(len(loop.signatures) == 1 for loop in loops)
modules = set(sys.modules)
warm_up(server.params)
assert all(len(loop.signatures) == 1 for loop in loops)
assert set(sys.modules) == modules
"""
    subprocess.run([sys.executable, '-c', code], check=True)
