"""Ways between beads: from bead to bead, inside the limits, around what stands there."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from waam_robot.arm import AXES, forward, in_limits
from waam_robot.bead import make_bead
from waam_robot.clearance import plan_clear, plan_part
from waam_robot.joint_path import Machine, PlanError
from waam_robot.timing import part_pose

coal = pytest.importorskip('coal', reason='scripts/setup.sh --robot installs it')

from waam_robot import ways as module  # noqa: E402
from waam_robot.collision import Scene  # noqa: E402

MACHINE = Machine()
HIGH = 0.08  # m


def beads():
    """Two short ones, 120 mm apart."""
    ends = ([[x, -0.02, 0.03], [x, 0.02, 0.03]] for x in (-0.06, 0.06))
    return [make_bead(np.array(points), step=1e-3) for points in ends]


def walled():
    """A wall between them."""
    scene = Scene(MACHINE)
    scene.set_surface((0.0, -0.06), 2e-3, np.full((60, 3), HIGH))
    return scene


def test_a_way_leads_from_bead_to_bead():
    paths, (way,) = plan_part(beads(), Scene(MACHINE))
    assert np.array_equal(way[0], paths[0].joints[-1])
    assert np.array_equal(way[-1], paths[1].joints[0])
    assert in_limits(MACHINE.arm, way[:, :AXES]).all()
    first, last = (part_pose(some, MACHINE)[:, :3, 3] for some in (way[:2], way[-2:]))
    assert first[1] - first[0] == pytest.approx([0, 0, 5e-3], abs=1e-6)  # along the torch
    assert last[1] - last[0] == pytest.approx([0, 0, -5e-3], abs=1e-6)


def test_a_way_goes_around_what_stands_there():
    scene = walled()
    _, (way,) = plan_part(beads(), scene)
    assert scene.first(way) is None
    assert scene.first(way[[0, -1]]) is not None
    places = np.concatenate(
        [a + np.linspace(0, 1, 50)[:, None] * (b - a) for a, b in zip(way, way[1:], strict=False)]
    )
    x, y, z = part_pose(places, MACHINE)[:, :3, 3].T
    over = (x > 0) & (x < 6e-3) & (np.abs(y) < 0.06)
    assert (z[over] > HIGH).all()


def test_what_is_laid_later_is_not_in_the_way():
    up = np.arange(0, HIGH, 5e-3)
    wall = make_bead(np.array([(3e-3, y, z) for z in up for y in (-0.04, 0.04, -0.04)]), step=1e-3)
    scene = Scene(MACHINE)
    _, ways = plan_part([*beads(), wall], scene)
    pieces = scene.lay(wall.points, 6e-3)
    assert scene.first(ways[0], 20) is None
    assert scene.first(ways[0], pieces) is not None


def test_no_way_is_told_with_its_beads(monkeypatch):
    monkeypatch.setattr(module, '_across', lambda a, b, machine: [np.array([a, b])])
    monkeypatch.setattr(module, 'LIFTS', (20e-3,))
    assert len(plan_clear(beads(), walled())) == 2
    with pytest.raises(module.WayError, match='from bead 0 to bead 1: .* within 2 mm of part'):
        plan_part(beads(), walled())
    assert issubclass(module.WayError, PlanError)


def test_the_torch_goes_back_as_far_as_the_arm_does():
    path = plan_clear([make_bead(np.array([[0, 0, 0.3], [0, 0.01, 0.3]]))], Scene(MACHINE))[0]
    back = module._back(path.joints[-1], path.branch, 2.0, MACHINE)
    assert in_limits(MACHINE.arm, back[:, :AXES]).all()
    tips = forward(MACHINE.arm, back[:, :AXES])[:, :3, 3]
    rise = np.diff(tips, axis=0)
    assert 20 < len(back) < 400 and rise == pytest.approx(np.tile([0, 0, 5e-3], (len(rise), 1)))
    joint = int(np.argmax(np.abs(back[8, :AXES] - back[0, :AXES])))
    rising = back[8, joint] > back[0, joint]
    name, ends = ('high', MACHINE.arm.high) if rising else ('low', MACHINE.arm.low)
    limit = tuple(back[4, joint] if n == joint else v for n, v in enumerate(ends))
    arm = replace(MACHINE.arm, **{name: limit})
    held = module._back(path.joints[-1], path.branch, 2.0, replace(MACHINE, arm=arm))
    assert 4 <= len(held) <= 5 and in_limits(arm, held[:, :AXES]).all()
