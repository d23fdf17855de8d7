"""The calibration against simulated scans of an independent simulator (calibration_sim.py)."""

from dataclasses import replace

import calibration_sim as sim
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from waam_scan.calibration.artefact import Artefact, ArtefactError, Balls, Block
from waam_scan.calibration.artefact_file import artefact_of, load_artefact
from waam_scan.calibration.robust import turn_vector, turned
from waam_scan.calibration.solve import CalibrationError, calibrate
from waam_scan.calibration.words import sparse, unobserved
from waam_scan.transform import Mounting

PLACE, YAW = (0.10, 0.06, 0.0), 0.1
TOP, HEIGHT, SLOPES = (0.020, 0.014), 0.012, (np.radians(45), np.radians(40))
CENTERS = np.array([[0, 0, 0.010], [0.022, 0.004, 0.014], [0.004, 0.020, 0.018]])
RADIUS = 0.008


def block():
    world = sim.block_world(TOP, HEIGHT, SLOPES, PLACE, YAW)
    return world, Artefact(Block.of(TOP, HEIGHT, SLOPES), np.array(PLACE), yaw=YAW)


def balls():
    spheres = np.column_stack([CENTERS + PLACE, np.full(3, RADIUS)])
    artefact = Artefact(Balls(CENTERS, np.full(3, RADIUS)), np.array(PLACE))
    return sim.World(np.empty((0, 3, 3)), spheres), artefact


def truth(seed):
    """A mounting that differs from the drawing by up to 5 mm and 3 deg on every axis, and a time offset."""
    rng = np.random.default_rng(seed)
    offset = np.array([0.060, 0.0, 0.120]) + rng.uniform(-5e-3, 5e-3, 3)
    rpy = np.radians([0, 0, 90]) + np.radians(rng.uniform(-3, 3, 3))
    return offset, rpy, rng.uniform(-0.03, 0.03), rng


FEW = 30_000  # points: enough, and quick


def scans(world, seed, lines=None, **options):
    offset, rpy, delay, rng = truth(seed)
    passes = sim.passes_over(world, PLACE[:2], offset, rpy, delay, rng, lines=lines, **options)
    return passes, offset, sim.quaternion_matrix(rpy), delay


@pytest.mark.parametrize('make, seed', [(block, 0), (block, 1), (balls, 3)])
def test_an_unknown_pose_and_time_offset_are_recovered(make, seed):
    world, artefact = make()
    passes, offset, rotation, delay = scans(world, seed)
    result = calibrate(passes, artefact, limit=FEW)
    turn = turn_vector(result.mounting.rotation @ rotation.T)
    error = np.concatenate([result.mounting.offset - offset, turn, [result.mounting.delay - delay]])
    assert np.abs(error[:3]).max() < 20e-6
    assert np.linalg.norm(turn) < np.radians(0.02)
    assert abs(error[6]) < 0.5e-3
    assert (np.abs(error) < 5 * result.sigma).all()  # the stated uncertainty is of the right size
    assert result.observed
    assert 10e-6 < result.noise < 35e-6  # 30 um along z, seen across slopes


def test_stated_uncertainty_covers_the_errors_and_is_not_padded():
    world, artefact = block()
    ratios = []
    for seed in range(20, 24):
        passes, offset, rotation, delay = scans(world, seed, points=80)
        result = calibrate(passes, artefact, limit=FEW)
        turn = turn_vector(result.mounting.rotation @ rotation.T)
        error = [*(result.mounting.offset - offset), *turn, result.mounting.delay - delay]
        ratios.append(np.array(error) / result.sigma)
    assert 0.5 < np.sqrt(np.mean(np.square(ratios))) < 1.6


def test_shaking_widens_the_stated_uncertainty():
    world, artefact = block()
    still, *_ = scans(world, 5, points=80)
    shaking, *_ = scans(world, 5, points=80, pose_noise=20e-6)
    a, b = (calibrate(p, artefact, limit=FEW).sigma for p in (still, shaking))
    assert b[2] > 2 * a[2]


def test_one_way_cannot_tell_time_from_place():
    world, artefact = block()
    passes, *_ = scans(world, 6, sim.ONE_WAY)
    result = calibrate(passes, artefact, limit=FEW)
    assert len(result.unobserved) == 1
    text = result.unobserved[0]
    assert 'position along the travel axis (x)' in text and 'time offset' in text
    assert result.sigma[0] > 1e-3 and result.sigma[6] > 0.05


def test_one_ball_in_one_line_leaves_the_turn_about_the_travel_axis_open():
    centre, radius = CENTERS[:1], np.full(1, RADIUS)
    world = sim.World(np.empty((0, 3, 3)), np.column_stack([centre + PLACE, radius]))
    artefact = Artefact(Balls(centre, radius), np.array(PLACE))
    way = sim.STANDARD[0]
    passes, *_ = scans(world, 7, (way, (-way[0], *way[1:])))
    result = calibrate(passes, artefact, limit=FEW)
    assert any('rotation about the travel axis (x)' in text for text in result.unobserved)


def test_an_artefact_that_stands_anywhere_gives_everything_but_the_position():
    world, artefact = block()
    passes, _, rotation, delay = scans(world, 8)
    start = Mounting()
    result = calibrate(
        passes, replace(artefact, position_sigma=np.full(3, np.inf)), start, limit=FEW
    )
    assert sorted(t.split(' (')[0] for t in result.unobserved) == [
        f'position along {a}' for a in 'xyz'
    ]
    assert all('touch it off' in t for t in result.unobserved)
    assert np.linalg.norm(turn_vector(result.mounting.rotation @ rotation.T)) < np.radians(0.02)
    assert abs(result.mounting.delay - delay) < 0.5e-3
    assert np.abs(result.mounting.offset - start.offset).max() < 0.1e-3  # kept, not guessed


def test_the_uncertainty_of_the_touch_off_is_in_the_result():
    world, artefact = block()
    passes, *_ = scans(world, 9)
    result = calibrate(passes, replace(artefact, position_sigma=np.full(3, 50e-6)), limit=FEW)
    assert result.observed
    assert (result.sigma[:3] > 49e-6).all() and (result.sigma[:3] < 60e-6).all()


def test_a_wrong_artefact_is_not_fitted():
    world, _ = block()
    passes, *_ = scans(world, 10)
    wrong = Artefact(Block.of((0.045, 0.030), 0.020, SLOPES), np.array(PLACE), yaw=YAW)
    with pytest.raises(CalibrationError, match='artefact|body'):
        calibrate(passes, wrong, limit=FEW)


def test_an_empty_table_gives_no_calibration():
    _, artefact = block()
    passes, *_ = scans(sim.World(np.empty((0, 3, 3)), np.empty((0, 4))), 11)
    with pytest.raises(CalibrationError, match='artefact|body'):
        calibrate(passes, artefact, limit=FEW)


@given(st.lists(st.floats(-1.5, 1.5), min_size=3, max_size=3))
def test_rotation_vectors_round_trip(v):
    assert np.allclose(turn_vector(turned(np.array(v))), v, atol=1e-9)


def test_directions_are_named_once_each():
    free = np.zeros((7, 2))
    free[[3, 2], [0, 1]] = 1.0
    mixed = free @ np.array([[0.6, -0.8], [0.8, 0.6]])  # the same plane in another basis
    assert np.allclose(np.abs(sparse(mixed)).sum(axis=0), [0, 0, 1, 1, 0, 0, 0])
    words = unobserved(mixed, np.array([1.0, 0.0, 0.0]))
    assert {w.split(' (add')[0].split(' (no')[0] for w in words} == {
        'rotation about the travel axis (x)', 'position along z',
    }  # fmt: skip


@pytest.mark.parametrize('body', [block()[1], balls()[1], replace(block()[1], use_table=True)])
def test_distance_has_the_stated_normal_as_gradient(body):
    rng = np.random.default_rng(0)
    p = rng.uniform([-0.03, -0.03, 0.0005], [0.03, 0.03, 0.03], (3000, 3))
    c = body.contact(p)
    step = 1e-7
    gradient = np.column_stack(
        [(body.contact(p + step * e).distance - c.distance) / step for e in np.eye(3)]
    )
    assert np.allclose(gradient[c.good], c.normal[c.good], atol=1e-4)
    assert c.good.sum() > 300


@pytest.mark.parametrize(
    'data, word',
    [
        ({'kind': 'cone'}, 'kind'),
        ({'kind': 'block', 'top_mm': [20, 14], 'height_mm': 12}, 'position_mm is missing'),
        ({'kind': 'block', 'top_mm': [20, 14, 3], 'height_mm': 12, 'position_mm': [0, 0, 0]}, 'top_mm'),
        ({'kind': 'block', 'top_mm': 20, 'height_mm': 0.1, 'position_mm': [0, 0, 0]}, 'height_mm'),
        ({'kind': 'block', 'hight_mm': 1, 'position_mm': [0, 0, 0]}, 'unknown field hight_mm'),
        ({'kind': 'spheres', 'spheres': [], 'position_mm': [0, 0, 0]}, 'spheres'),
        ({'kind': 'spheres', 'spheres': [{'center_mm': [0, 0, 'a'], 'radius_mm': 5}], 'position_mm': [0, 0, 0]},
         'center_mm'),
        ([1, 2], 'kind'),
    ],
)  # fmt: skip
def test_bad_artefacts_are_refused_by_field(data, word):
    with pytest.raises(ArtefactError, match=word):
        artefact_of(data)


def test_artefact_files_are_read(tmp_path):
    path = tmp_path / 'block.yaml'
    path.write_text(
        'kind: block\ntop_mm: [20, 14]\nheight_mm: 12\nposition_mm: [100, 60, 0]\n'
        'position_sigma_mm: .inf\nyaw_deg: 5\n'
    )
    artefact = load_artefact(path)
    assert np.isinf(artefact.position_sigma).all() and np.isclose(artefact.yaw, np.radians(5))
    assert np.allclose(artefact.contact(np.array([[0, 0, 0.013]])).distance, 1e-3)
    with pytest.raises(ArtefactError, match='no such file'):
        load_artefact(tmp_path / 'none.yaml')
