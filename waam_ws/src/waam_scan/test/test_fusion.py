import numpy as np
import pytest

from waam_process.grid import GridSpec
from waam_scan.fusion.height_map import Fusion
from waam_scan.fusion.limits import FusionLimits
from waam_scan.transform import Mounting

SPEC = GridSpec(0.0, 0.0, 0.5e-3, 80, 100)  # 50 x 40 mm
NOISE = 30e-6


def worn(x, y):
    """A surface with hollows of 2 mm and slopes up to 0.35, m."""
    return 2e-3 * np.sin(x / 8e-3) * np.cos(y / 6e-3) + 0.5e-3 * np.sin(y / 4e-3)


def profiles(
    seed=0, step=0.25e-3, points=640, surface=worn, noise=NOISE, spikes=0.01, dropouts=0.05
):
    """A pass of the default scanner along x over SPEC: tcp (n, 3), x, z (n, m), and which are spikes and holes."""
    rng = np.random.default_rng(seed)
    n = int(60e-3 / step)
    tcp = np.zeros((n, 3))
    tcp[:, 0] = np.arange(n) * step - 0.0651  # off the cell edges
    tcp[:, 1:] = 20e-3, 15e-3
    x = np.broadcast_to(np.linspace(-25e-3, 25e-3, points), (n, points)).astype(np.float32)
    z = surface(tcp[:, :1] + 0.060, tcp[:, 1:2] + x) - 0.135 + rng.normal(0, noise, x.shape)
    spike = rng.random(x.shape) < spikes
    z[spike] += rng.choice([-1, 1], spike.sum()) * rng.uniform(1e-3, 5e-3, spike.sum())
    hole = rng.random(x.shape) < dropouts
    z[hole] = np.nan
    return tcp, x, z.astype(np.float32), spike & ~hole, hole


def fused(*passes, spec=SPEC, **limits):
    fusion = Fusion(spec, Mounting(), FusionLimits(**limits))
    for tcp, x, z, *_ in passes:
        fusion.add(tcp, x, z)
    return fusion.result()


def error_of(m, surface=worn):
    x, y = np.meshgrid(m.spec.x, m.spec.y)
    return (m.z - surface(x, y))[np.isfinite(m.z)]


def test_spikes_are_counted_about_right_and_every_point_is_accounted_for():
    tcp, x, z, spike, hole = profiles()
    m = fused((tcp, x, z))
    inside = m.spec.contains((tcp[:, :1] + 0.060).astype(float) + 0 * x, tcp[:, 1:2] + x)
    assert m.dropouts == hole.sum()
    assert m.outside == (~inside & ~hole).sum()
    assert m.points_used + m.points_rejected == z.size
    assert 0.8 * (spike & inside).sum() < m.spikes < 1.6 * (spike & inside).sum()


def test_infinite_values_are_dropouts():
    tcp, x, z, *_ = profiles(points=50)
    z = z.copy()
    holes = int(np.isnan(z).sum())
    z[0, :5] = np.inf
    assert fused((tcp, x, z)).dropouts >= holes + 1
    assert np.isfinite(fused((tcp, x, z)).z[np.isfinite(fused((tcp, x, z)).sigma)]).all()


def test_cells_that_no_point_fell_into_stay_unknown():
    tcp, x, z, *_ = profiles(step=1.5e-3)  # three cells from profile to profile
    m = fused((tcp, x, z))
    seen = np.zeros(SPEC.shape, bool)
    good = np.isfinite(z)
    px, py = (tcp[:, :1] + 0.060 + 0 * x)[good], (tcp[:, 1:2] + x)[good]
    inside = SPEC.contains(px, py)
    row, col = SPEC.cell(px[inside], py[inside])
    seen[row, col] = True
    assert not np.isfinite(m.z[~seen]).any()
    assert (m.count[~seen] == 0).all()
    assert 0.2 < m.coverage < 0.4


def test_a_lone_spike_beside_known_cells_is_refused():
    tcp, x, z, *_ = profiles(spikes=0, dropouts=0, points=80)  # about two points in a cell
    z = z.copy()
    z[60, 40] += 4e-3
    m = fused((tcp, x, z))
    assert np.abs(error_of(m)).max() < 0.3e-3
    assert m.spikes >= 1


def reflection(height, cells, points=640):
    """Profiles over the worn surface with every point of some cells (row, col) moved by `height`, m."""
    tcp, x, z, *_ = profiles(spikes=0, dropouts=0, points=points)
    col = np.floor((tcp[:, :1] + 0.060) / SPEC.resolution) + np.zeros_like(x)
    row = np.floor((tcp[:, 1:2] + x) / SPEC.resolution)
    z = z.copy()
    for r, c in cells:
        z[(row == r) & (col == c)] += height
    return tcp, x, z


@pytest.mark.parametrize('height', [23e-3, 3.5e-3, -10e-3])
@pytest.mark.parametrize('points', [160, 640])  # 4 and 12 of them in the cell
def test_a_reflection_that_fills_a_cell_is_a_spike_as_a_whole(height, points):
    m = fused(reflection(height, [(40, 50)], points))
    assert np.isnan(m.z[40, 50]) and m.count[40, 50] == 0
    assert np.abs(error_of(m)).max() < 0.3e-3 and m.spikes >= 4


def test_what_is_real_is_no_reflection():
    """A knob of 2.5 mm in one cell, a pin two cells wide, a wall one cell wide."""
    pin, wall = [(20, 30), (20, 31)], [(r, 70) for r in range(30, 50)]
    for height, cells in ((2.5e-3, [(40, 50)]), (10e-3, pin), (10e-3, wall)):
        m = fused(reflection(height, cells))
        assert all(m.z[r, c] > worn(SPEC.x[c], SPEC.y[r]) + 0.9 * height for r, c in cells)


def test_height_limits_are_outside():
    m = fused(profiles(spikes=0), height_min=0.0, height_max=1e-3)
    assert m.outside > 0
    assert np.nanmin(m.z) > -0.2e-3 and np.nanmax(m.z) < 1.2e-3


def test_a_tilted_scanner_gives_the_same_surface():
    tilt = Mounting.from_rpy((0.05, 0.01, 0.13), (0.1, -0.2, np.pi / 2 + 0.05))
    rng = np.random.default_rng(1)
    tcp = np.column_stack(
        [np.arange(400) * 0.25e-3 - 0.08, np.full(400, 10e-3), np.full(400, 10e-3)]
    )
    x = np.broadcast_to(np.linspace(-25e-3, 25e-3, 400), (400, 400))
    axis_x, axis_z = tilt.rotation[:, 0], tilt.rotation[:, 2]
    z = (2e-3 - (tilt.origins(tcp)[:, 2:] + axis_x[2] * x)) / axis_z[2]  # the plane at 2 mm
    m = fused_with(tilt, tcp, x, z + rng.normal(0, 10e-6, z.shape))
    assert m.coverage > 0.4
    assert abs(np.nanmean(m.z) - 2e-3) < 2e-6


def fused_with(mounting, tcp, x, z):
    fusion = Fusion(SPEC, mounting)
    fusion.add(tcp, x, z)
    return fusion.result()


@pytest.mark.parametrize('case', ['shape', 'pose'])
def test_what_does_not_fit_is_refused(case):
    tcp, x, z, *_ = profiles(points=20)
    with pytest.raises(ValueError, match='do not fit' if case == 'shape' else 'pose'):
        Fusion(SPEC).add(tcp[1:] if case == 'shape' else tcp * np.nan, x, z)
