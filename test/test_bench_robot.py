"""What judges the joint paths of bench_robot.py a second way: it finds flips and contacts where there are some."""

from __future__ import annotations

import sys
from dataclasses import replace
from itertools import permutations
from pathlib import Path

import numpy as np
import pytest

from waam_robot.arm import M20IB25, forward
from waam_robot.bead import make_bead
from waam_robot.inverse import solve
from waam_robot.joint_path import Machine, plan

sys.path.insert(0, str(Path(__file__).parents[1] / 'bench'))
from lib.robot_parts import flips  # noqa: E402


@pytest.fixture(scope='module')
def machine():
    return Machine()


def bead(z, lean=0.0):
    """60 mm over the faceplate, torch axis leaning to -x."""
    axis = [-np.sin(lean), 0.0, np.cos(lean)]
    return make_bead(np.array([[0.0, 0.0, z], [0.06, 0.0, z]]), np.tile(axis, (2, 1)), step=1e-3)


def test_every_change_of_branch_is_a_flip(machine):
    (path,) = plan([bead(0.05)], machine)
    assert flips([path], machine) == 0
    theta = path.joints[:, :6]
    found = solve(M20IB25, forward(M20IB25, theta)).theta
    branches = np.moveaxis(found.reshape(len(theta), -1, 6), 1, 0)
    assert len(branches) == 8
    half = len(theta) // 2
    for a, b in permutations(branches, 2):
        one = np.concatenate([a[:half], b[half:]])
        changed = replace(path, joints=np.concatenate([one, path.joints[:, 6:]], axis=1))
        assert flips([changed], machine) == 1


def test_contacts_are_found(machine):
    pytest.importorskip('pinocchio', reason='requirements-robot.txt is not installed')
    pytest.importorskip('coal', reason='scripts/setup.sh --robot installs it')
    from lib.robot_collisions import Judge, pushed

    from waam_robot.clearance import plan_part
    from waam_robot.collision import Scene

    judge = Judge(machine)
    free, what = judge.least(plan([bead(0.05)], machine))
    assert 0.01 < free < 0.07, what
    touching, what = judge.least(plan([bead(-0.03)], machine))
    assert touching < 0 and 'positioner' in what
    low = plan([bead(0.03), bead(0.0)], machine)  # the second one below what was laid
    touching, what = judge.least(low)
    assert touching < 0 and 'part' in what
    paths, ways = plan_part([bead(0.0), bead(0.03)], Scene(machine))
    free, what = judge.least_between(paths, ways)
    assert 0.002 < free < 0.012, what
    touching, what = judge.least_between(paths, pushed(paths, ways, machine))
    assert touching < 0 and 'nozzle and part' in what
    elsewhere, what = judge.least_between(paths, [ways[0][1:]])
    assert elsewhere == -np.inf and 'does not lead' in what


def test_a_wall_between_two_beads_is_found_and_gone_around(machine):
    """By the judge on the straight line, of which both ends are free; the planned way is free for it."""
    pytest.importorskip('pinocchio', reason='requirements-robot.txt is not installed')
    pytest.importorskip('coal', reason='scripts/setup.sh --robot installs it')
    from lib.robot_collisions import Judge

    from waam_robot.clearance import plan_part
    from waam_robot.collision import Scene

    scene = Scene(machine)
    scene.set_surface((0.0, -0.06), 2e-3, np.full((60, 3), 0.08))
    parts = [
        make_bead(np.array([[x, -0.02, 0.03], [x, 0.02, 0.03]]), step=1e-3) for x in (-0.06, 0.06)
    ]
    paths, (way,) = plan_part(parts, scene)
    steps = np.array([(3e-3, y, z) for z in np.arange(0, 0.08, 5e-3) for y in (-0.06, 0.06, -0.06)])
    standing = [replace(paths[0], bead=make_bead(steps, step=1e-3, corner=0.0)), paths[1]]
    judge = Judge(machine)
    free, what = judge.least_between(standing, [way])
    assert free > 0.001, what
    touching, what = judge.least_between(standing, [way[[0, -1]]])
    assert touching < 0 and 'part' in what
