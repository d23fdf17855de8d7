"""Drift is recovered while metal is added, what cannot be seen is named, and nothing is guessed."""

import numpy as np
import pytest
import registration_sim as sim

from waam_scan.registration.result import RegistrationError
from waam_scan.registration.solve import register
from waam_scan.registration.target import Cloud, MeshTarget, evened, without_strays
from waam_scan.registration.words import direction_name, free_motions

POINTS = 40_000


def pair(seed, share, surface=sim.shaped, points=POINTS, **options):
    """Reference, drifted scan, and the drift."""
    rng = np.random.default_rng(seed)
    rotation, translation = sim.drift(rng)
    reference = sim.scan(surface, rng, points, **options)
    moved = sim.scan(surface, rng, points, share=share, **options) @ rotation.T + translation
    return reference, moved, rotation, translation


@pytest.mark.parametrize('share, seed', [(0.3, 1), (0.7, 3)])
def test_drift_is_recovered_while_two_millimetres_are_added(share, seed):
    reference, moved, rotation, translation = pair(seed, share, points=120_000)
    r = register(moved, reference, points=60_000)
    shift, turn = sim.error(r.rotation, r.translation, rotation, translation)
    assert r.converged and not r.unobserved
    assert np.linalg.norm(shift) < 30e-6
    assert np.linalg.norm(turn) < np.radians(0.01)
    assert (np.abs(shift) < 6 * r.sigma[:3]).all() and (r.sigma[:3] < 10e-6).all()
    assert abs(r.changed - 0.93 * share) < 0.1


def test_wear_is_not_motion_either():
    reference, moved, rotation, translation = pair(5, 0.7)
    r = register(reference, moved, change='wear', points=20_000)  # the other way round
    total = rotation.T @ r.rotation
    assert np.degrees(np.arccos(np.clip((np.trace(total) - 1) / 2, -1, 1))) < 0.01
    centre = np.array([0.05, 0.05, 0.01])
    assert np.linalg.norm(r.apply(centre[None]) - (rotation @ centre + translation)) < 30e-6


def test_growth_all_over_is_taken_for_motion_only_when_asked():
    """What a plain robust fit does with 70 % new metal: it follows the metal. The stated kind of change decides."""
    reference, moved, rotation, translation = pair(6, 0.7)
    lowest = register(moved, reference, points=20_000)
    commonest = register(moved, reference, change='any', points=20_000)
    assert abs(sim.error(lowest.rotation, lowest.translation, rotation, translation)[0][2]) < 30e-6
    assert sim.error(commonest.rotation, commonest.translation, rotation, translation)[0][2] < -1e-3


def test_a_flat_plate_shows_height_and_tilt_but_not_where_it_slid():
    reference, moved, rotation, translation = pair(7, 0.3, sim.flat)
    r = register(moved, reference, points=20_000)
    assert any('sliding on the plane with normal z' in t for t in r.unobserved)
    assert any('turning about z' in t for t in r.unobserved)
    assert np.isinf(r.sigma[[0, 1, 5]]).all()
    centre = np.array([0.05, 0.05, 0.0])
    shift, turn = sim.error(r.rotation, r.translation, rotation, translation, centre)
    assert abs(shift[2]) < 10e-6
    assert np.abs(turn[:2]).max() < np.radians(0.01)
    assert np.linalg.norm(r.shift[:2]) < 60e-6  # left where it was: the tilt alone moves it


def test_a_groove_shows_one_direction_more():
    def groove(x, y):
        return 0.004 * np.sin(60 * y)

    reference, moved, rotation, translation = pair(8, 0.0, groove)
    r = register(moved, reference, points=20_000)
    assert r.unobserved == ['sliding along x']
    shift, _ = sim.error(r.rotation, r.translation, rotation, translation)
    assert np.linalg.norm(shift[1:]) < 30e-6


def test_a_shaft_may_turn_and_slide():
    rng = np.random.default_rng(9)
    radius = 0.02

    def shaft():
        angle, x = rng.uniform(-1.2, 1.2, 30_000), rng.uniform(0, 0.1, 30_000)
        r = radius + 30e-6 * rng.standard_normal(30_000)
        return np.column_stack([x, r * np.sin(angle), r * np.cos(angle)])

    moved = shaft() + [0.0, 0.1e-3, 0.2e-3]
    r = register(moved, shaft(), points=20_000)
    text = ' / '.join(r.unobserved)
    assert 'sliding along x' in text and 'turning about x through' in text
    axis = r.apply(np.array([[0.0, 0.1e-3, 0.2e-3], [0.1, 0.1e-3, 0.2e-3]]))
    assert np.abs(axis[:, 1:]).max() < 30e-6


def test_a_scan_is_placed_on_its_nominal_mesh():
    n = 81
    g = np.linspace(0, sim.SIZE, n)
    x, y = np.meshgrid(g, g, indexing='ij')
    v = np.stack([x, y, sim.shaped(x, y)], axis=-1)
    a, b, c, d = v[:-1, :-1], v[1:, :-1], v[1:, 1:], v[:-1, 1:]
    triangles = np.concatenate(
        [np.stack(t, axis=2).reshape(-1, 3, 3) for t in ((a, b, c), (a, c, d))]
    )

    def facetted(px, py):
        """The mesh itself, evaluated triangle by triangle."""
        i, j = (
            np.minimum((px / g[1]).astype(int), n - 2),
            np.minimum((py / g[1]).astype(int), n - 2),
        )
        fx, fy = px / g[1] - i, py / g[1] - j
        z = sim.shaped(x, y)
        first = z[i, j] + fx * (z[i + 1, j] - z[i, j]) + fy * (z[i + 1, j + 1] - z[i + 1, j])
        other = z[i, j] + fy * (z[i, j + 1] - z[i, j]) + fx * (z[i + 1, j + 1] - z[i, j + 1])
        return np.where(fx >= fy, first, other)

    rng = np.random.default_rng(10)
    rotation, translation = sim.drift(rng)
    cloud = sim.scan(
        lambda px, py: facetted(np.clip(px, 0, sim.SIZE), np.clip(py, 0, sim.SIZE)), rng, POINTS
    )
    r = register(
        cloud @ rotation.T + translation, MeshTarget(triangles), change='any', points=20_000
    )
    shift, turn = sim.error(r.rotation, r.translation, rotation, translation)
    assert np.linalg.norm(shift) < 30e-6 and np.linalg.norm(turn) < np.radians(0.01)
    assert not r.unobserved


def test_clouds_that_do_not_meet_are_refused():
    rng = np.random.default_rng(11)
    reference = Cloud.of(sim.scan(sim.shaped, rng, 10_000))
    moved = sim.scan(sim.shaped, rng, 10_000)
    with pytest.raises(RegistrationError, match='partner'):
        register(moved + [1.0, 0, 0], reference)
    with pytest.raises(RegistrationError, match='within'):
        register(moved + [0, 0, 0.02], reference, reach=2e-3)
    with pytest.raises(ValueError, match='too small'):
        register(moved[:20], reference)
    with pytest.raises(RegistrationError, match='change'):
        register(moved, reference, change='melt')


def test_profiles_with_distant_lines_are_evened_out():
    rng = np.random.default_rng(12)
    x, y = np.meshgrid(np.arange(60) * 0.5e-3, np.arange(2000) * 0.02e-3)
    p = np.column_stack([x.ravel(), y.ravel(), 20e-6 * rng.standard_normal(x.size)])
    cloud = Cloud.of(evened(p))
    # along single lines the normals would point anywhere
    assert np.median(cloud.normals[:, 2]) > 0.999
    assert len(cloud.points) < len(p) / 3


def test_strays_are_left_out():
    rng = np.random.default_rng(13)
    p = sim.scan(sim.flat, rng, 60_000, spikes=0.0)
    spikes = np.column_stack([rng.uniform(0, sim.SIZE, (60, 2)), rng.uniform(3e-3, 5e-3, 60)])
    kept = without_strays(np.vstack([p, spikes]))
    assert (kept[:, 2] > 1e-3).sum() < 5 and len(kept) > 0.99 * len(p)


def test_motions_are_named_by_what_they_are():
    unit = np.array([1e-5] * 3 + [1e-4] * 3)
    assert direction_name(np.array([0, -1.0, 0.01])) == 'y'
    assert direction_name(np.array([1.0, 1.0, 0])) == '(0.71, 0.71, 0.00)'
    everything = free_motions(np.eye(6)[:, :3], unit, np.zeros(3))
    assert everything == ['position in every direction']
    assert free_motions(np.empty((6, 0)), unit, np.zeros(3)) == []
    turn = np.zeros((6, 1))  # about the axis y through x = 10 mm: the centre moves along z
    turn[4], turn[2] = 1.0, 0.01 * unit[4] / unit[2]
    name = free_motions(turn / np.linalg.norm(turn), unit, np.zeros(3))[0]
    assert name == 'turning about y through (10.0, 0.0, 0.0) mm'
