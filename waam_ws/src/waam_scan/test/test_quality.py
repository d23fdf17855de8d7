import numpy as np

from waam_process.grid import GridSpec
from waam_scan.fusion.height_map import Fusion
from waam_scan.fusion.quality import assess, enclosed, steep_cells
from waam_scan.transform import Mounting

CELL = 0.5e-3


def plane(rows=30, cols=40):
    y, x = np.mgrid[:rows, :cols] * CELL
    return 1e-3 + 0.1 * x - 0.05 * y


def test_holes_are_enclosed_and_the_border_is_not_a_hole():
    known = np.ones((20, 20), bool)
    known[5:7, 5:8] = False
    known[10, 10] = known[11, 11] = False  # touch by a corner
    known[:, 0] = known[0:3, 18:] = False
    label, count = enclosed(known)
    assert count == 2
    assert sorted(np.bincount(label.ravel())[1:].tolist()) == [2, 6]
    assert not label[:, 0].any() and not label[0:3, 18:].any()


def test_steep_cells_are_those_beside_a_wall():
    z = plane()
    z[:, 20:] += 3e-3
    steep = steep_cells(z, CELL)
    assert steep[:, 19:21].all() and steep.sum() == 2 * 30
    assert not steep_cells(plane(), CELL).any()


def scanned(surface, seen):
    """A map of `surface` (x, y) with points wherever seen (x, y)."""
    rng = np.random.default_rng(0)
    xs, ys = rng.uniform(0, 20e-3, 60_000), rng.uniform(0, 15e-3, 60_000)
    good = seen(xs, ys)
    h = surface(xs, ys)[good] + rng.normal(0, 20e-6, good.sum())
    tcp = np.column_stack([xs[good], ys[good], h])
    f = Fusion(GridSpec(0, 0, CELL, 30, 40), Mounting(np.zeros(3), np.eye(3)))
    f.add(tcp, np.zeros((len(tcp), 1)), np.zeros((len(tcp), 1)))
    return f.result()


def test_a_shadowed_wall_is_reported():
    m = scanned(
        lambda x, y: np.where(x > 12e-3, 4e-3, 0.0),
        lambda x, y: ~((np.abs(x - 5e-3) < 1e-3) & (np.abs(y - 5e-3) < 1e-3)) & (y < 13e-3),
    )
    q = assess(m)
    assert q.holes == 1 and abs(q.hole_area - 4e-6) < 1.5e-6
    assert q.largest_hole == q.hole_area
    assert abs(q.unseen - 2 / 15) < 0.02
    assert 0.03 < q.steep < 0.08, 'the two columns at the wall'
    assert abs(q.sigma - 20e-6 / np.sqrt(q.points)) < 3e-6
    assert '1 holes' in q.lines()[0]
    assert assess(scanned(lambda x, y: 0 * x, lambda x, y: x >= 0)).steep == 0


def test_cells_on_a_wall_hold_two_levels():
    m = scanned(lambda x, y: np.where(x > 12.2e-3, 4e-3, 0.0), lambda x, y: x >= 0)
    assert 0.015 < assess(m).edges < 0.04, 'one column of forty'
