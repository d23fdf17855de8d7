"""Line scanner: geometry, noise, drop-outs, shadows, range, times."""

from __future__ import annotations

import numpy as np
import pytest

from waam_process.plant_port import SAMPLE
from waam_sim.drive import Drive
from waam_sim.scanner import ScannerParams

CLEAN = ScannerParams(noise=0.0, outliers=0.0, dropout=0.0, steep_dropout=0.0)
SOURCE = 0.120


def scan(plant, x: float, y: float, z: float, count: int = 1) -> np.ndarray:
    """Profiles (count, points) of z_s with the torch at rest."""
    plant.scanning = True
    drive = Drive(plant, (x, y, z), plant.time_us + 1_000_000)
    drive.wait(0.01 * count)
    return np.concatenate([p.z for p in drive.profiles])


def test_flat_plate_reads_its_height(make_cell):
    plant = make_cell(groups={'scanner': CLEAN})
    z = scan(plant, -0.01, 0.03, 0.03)[0] + SOURCE + 0.03
    assert np.isfinite(z).sum() > 500 and np.nanmax(np.abs(z - 0.02)) < 1e-6


def test_profile_lies_along_y_at_the_offset(make_cell):
    plant = make_cell(groups={'scanner': CLEAN})
    spec = plant.metal.spec
    plant.metal.z += (
        np.where((spec.x > 0.0496) & (spec.x < 0.0504), 1e-3, 0.0)[None] * (spec.y > 0.03)[:, None]
    )
    z = scan(plant, 0.05 - 0.06, 0.03, 0.03)[0] + SOURCE + 0.03 - 0.02
    lateral = plant.scanner.lateral
    assert z[(lateral > 1e-3) & (lateral < 0.02)].mean() == pytest.approx(1e-3, rel=0.01)
    assert np.abs(z[(lateral < -1e-3) & (lateral > -0.02)]).max() < 1e-5


def test_noise_outliers_and_dropouts_have_their_statistics(make_cell):
    plant = make_cell()
    z = scan(plant, -0.01, 0.03, 0.03, count=60)[:, 30:-30] + SOURCE + 0.03 - 0.02
    p = plant.params.scanner
    error = z[np.isfinite(z)]
    robust = 1.4826 * np.median(np.abs(error - np.median(error)))
    assert robust == pytest.approx(p.noise, rel=0.08)
    assert np.isnan(z).mean() == pytest.approx(p.dropout, rel=0.3)
    assert (np.abs(error) > 6 * p.noise).mean() == pytest.approx(p.outliers, rel=0.4)


def pass_over(plant, waited: float) -> np.ndarray:
    """Profiles (count, points) of a scan that is begun `waited` s later."""
    plant.scanning = False
    drive = Drive(plant, (-0.01, 0.03, 0.03), plant.time_us + 1_000_000)
    drive.wait(waited)
    plant.scanning = True
    drive.move((0.01, 0.03, 0.03), 0.05)
    return np.concatenate([p.z for p in drive.profiles])[:38]


def test_noise_belongs_to_seed_scan_and_place_not_to_the_time(make_cell):
    first, later, other = make_cell(seed=3), make_cell(seed=3), make_cell(seed=4)
    a, b = pass_over(first, 0.1), pass_over(later, 2.0)
    assert np.isnan(a).any() and np.array_equal(a, b, equal_nan=True)
    assert not np.array_equal(a, pass_over(other, 0.1), equal_nan=True)

    def alike(p, q) -> float:
        both = np.isfinite(p) & np.isfinite(q)
        p, q = np.clip(p[both] - 0.02, -1, 1), np.clip(q[both] - 0.02, -1, 1)
        small = (np.abs(p - np.median(p)) < 1e-4) & (np.abs(q - np.median(q)) < 1e-4)
        return float(np.corrcoef(p[small], q[small])[0, 1])

    again = pass_over(first, 0.1)
    assert alike(a, b) > 0.999 and abs(alike(a, again)) < 0.05, 'another scan of the same surface'
    assert abs(alike(a[:-1], a[1:])) < 0.05, 'profiles side by side'


def test_a_scan_ends_although_nobody_asks_for_profiles_between_two(make_cell):
    """As in the laboratory, which asks only while it scans."""
    plant, samples = make_cell(), np.zeros(10, SAMPLE)
    noise = []
    for on in (True, False, True):
        plant.scanning = on
        plant.step(samples, plant.time_us + 10_000)
        if on:
            plant.profiles(samples)
            noise.append(plant.scanner.rng.copy())
    assert noise[0] != noise[1]


def test_more_points_are_lost_on_slopes_and_by_a_fault(make_cell):
    plant = make_cell()
    y = plant.metal.spec.y - 0.03
    plant.metal.z += (1.5 * np.clip(0.004 - np.abs(y), 0.0, 0.003))[:, None]
    z = scan(plant, -0.01, 0.03, 0.03, count=60)
    lateral = plant.scanner.lateral
    flank = (np.abs(lateral) > 0.0015) & (np.abs(lateral) < 0.0035)
    flat = (np.abs(lateral) > 0.006) & (np.abs(lateral) < 0.02)
    assert np.isnan(z[:, flank]).mean() > 10 * np.isnan(z[:, flat]).mean()
    plant.faults.inject('scanner_dropout', 0.3, plant.now)
    assert np.isnan(scan(plant, -0.01, 0.03, 0.03, count=30)[:, flat]).mean() == pytest.approx(
        0.3, abs=0.04
    )


def test_shadow_behind_a_step(make_cell):
    plant = make_cell(groups={'scanner': CLEAN})
    spec = plant.metal.spec
    height, angle = 0.010, plant.params.scanner.triangulation
    plant.metal.z += np.where(spec.x > 0.05, height, 0.0)[None]
    shadow = height * np.tan(angle)

    def visible(x: float) -> bool:
        return bool(np.isfinite(scan(plant, x - 0.06, 0.03, 0.03)[0][320]))

    assert not visible(0.05 - 0.5 * shadow) and not visible(0.05 - 0.8 * shadow)
    assert visible(0.05 - 1.3 * shadow), 'beyond the shadow'
    assert visible(0.053), 'on top of the step'


def test_fan_does_not_see_behind_a_lateral_wall(make_cell):
    plant = make_cell(groups={'scanner': CLEAN})
    y = plant.metal.spec.y - 0.03
    plant.metal.z[(y > 0.010) & (y < 0.012)] += 0.015
    z = scan(plant, -0.01, 0.03, 0.03)[0]
    lateral = plant.scanner.lateral
    assert np.isnan(z[(lateral > 0.0125) & (lateral < 0.0128)]).all()
    assert np.isfinite(z[(lateral > -0.0128) & (lateral < -0.0125)]).all()


def test_nothing_outside_the_measuring_range(make_cell):
    plant = make_cell()
    assert np.isnan(scan(plant, -0.01, 0.03, 0.09)).all(), 'too far'
    assert np.isnan(scan(plant, -0.01, 0.03, -0.02)).all(), 'too near'


def test_table_is_seen_beside_the_part(make_cell):
    plant = make_cell(groups={'scanner': CLEAN})
    z = scan(plant, 0.3, 0.03, 0.02)[0] + SOURCE + 0.02
    assert np.nanmax(np.abs(z)) < 1e-6


@pytest.mark.parametrize('rate', [100.0, 250.0, 333.0])
def test_times_are_exact_and_poses_interpolated(make_cell, rate):
    plant = make_cell(
        groups={'scanner': ScannerParams(rate=rate, noise=0.0, outliers=0.0, dropout=0.0)}
    )
    spec = plant.metal.spec
    plant.metal.z[:] = 0.005 + 0.1 * (spec.x + 0.02)[None]
    plant.scanning = True
    start, speed = -0.05, 0.05
    drive = Drive(plant, (start, 0.03, 0.03))
    drive.move((0.03, 0.03, 0.03), speed)
    times = np.concatenate([p.time_us for p in drive.profiles])
    z = np.concatenate([p.z for p in drive.profiles])
    assert set(np.diff(times)) == {round(1e6 / rate)}
    x = start + 0.06 + speed * (times - 1_000_000) * 1e-6
    inside = (x > 0.0) & (x < 0.08)
    height = np.nanmean(z[:, 300:340], axis=1) + SOURCE + 0.03
    assert np.abs(height - (0.005 + 0.1 * (x + 0.02)))[inside].max() < 1e-6


def test_no_profiles_when_off_or_dead(make_cell):
    plant = make_cell()
    samples = np.zeros(10, SAMPLE)
    plant.step(samples, 1_000_000)
    assert plant.profiles(samples) is None
    plant.scanning = True
    plant.step(samples, 1_010_000)
    assert plant.profiles(samples) is not None
    plant.faults.inject('scanner_dead', 0.0, plant.now)
    plant.step(samples, 1_020_000)
    assert plant.profiles(samples) is None
