"""A hand-held scanner: frames of a moving window without poses come together again."""

import argparse
import json

import numpy as np
import pytest
import registration_sim as sim

from waam_scan import cli
from waam_scan.registration.odometry import track


def frames(seed, count=3, step=3e-3, points=25_000, jump=2e-3, turn=0.03):
    """Windows of 70 mm over the surface in the axes of a scanner in unsteady motion; true poses to the first."""
    rng = np.random.default_rng(seed)
    found, poses = [], []
    rotation, translation = np.eye(3), np.zeros(3)
    steady = sim.drift(rng, jump, turn)
    for k in range(count):
        p = sim.scan(sim.shaped, rng, points)
        p = p[(p[:, 0] > k * step) & (p[:, 0] < 0.07 + k * step)]
        found.append((p - translation) @ rotation)  # seen from the scanner
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = rotation, translation
        poses.append(pose)
        for r, t in (steady, sim.drift(rng, 0.2 * jump, 0.2 * turn)):
            rotation, translation = r @ rotation, r @ translation + t
    return found, np.array(poses)


def worst(poses, truth):
    """Largest error (m) of the middle of the surface."""
    centre = np.array([0.05, 0.05, 0.01, 1.0])
    local = np.linalg.inv(truth) @ centre
    return max(np.linalg.norm(p @ q - centre) for p, q in zip(poses, local, strict=True))


def test_frames_without_poses_are_placed_and_refined():
    found, truth = frames(0)
    t = track(found)
    nothing = worst(np.array([np.eye(4)] * len(found)), truth)
    assert nothing > 3e-3  # there is something to find
    assert worst(t.coarse, truth) < 0.6 * nothing
    assert worst(t.poses, truth) < 0.03e-3
    assert t.refined.all() and not t.notes


def test_a_flat_plate_keeps_what_kiss_icp_says_and_tells():
    rng = np.random.default_rng(1)
    t = track([sim.scan(sim.flat, rng, 10_000) for _ in range(2)])
    assert any('sliding on the plane' in n and n.startswith('frame 1') for n in t.notes)


def test_frames_that_cannot_be_used_are_refused():
    cloud = np.random.default_rng(2).random((1000, 3))
    with pytest.raises(ValueError, match='at least two'):
        track([cloud])
    with pytest.raises(ValueError, match='frame 1'):
        track([cloud, cloud[:10]])


def test_the_command_writes_a_track(tmp_path, capsys):
    found, truth = frames(3, count=3, points=20_000)
    parser = argparse.ArgumentParser()
    cli.register(parser.add_subparsers())
    paths = []
    for k, frame in enumerate(found):
        paths.append(str(tmp_path / f'frame_{k}.npy'))
        np.save(paths[-1], frame * 1e3)
    args = parser.parse_args(
        ['scan', 'register', *paths, '--change', 'any', '--out', str(tmp_path / 'track')]
    )
    assert args.run_command(args) == 0
    assert 'frame_2.npy' in capsys.readouterr().out
    data = json.loads((tmp_path / 'track' / 'trajectory.json').read_text())
    assert worst(np.array([f['matrix_m'] for f in data['frames']]), truth) < 0.05e-3
    assert (tmp_path / 'track' / 'trajectory.png').stat().st_size > 10_000
    assert (tmp_path / 'track' / 'merged.ply').exists()
