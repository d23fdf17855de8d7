"""URDFs of gantry and robot, and where the frames of the machine hang in the robot's."""

from pathlib import Path

import numpy as np
import pytest

from waam_bridge.frame_tree import MACHINE, TORCH, Tree, gantry_urdf, in_root
from waam_node.params import ParameterError
from waam_robot.urdf_text import check_urdf
from waam_robot_bridge.description import description, fixed_frames
from waam_robot_bridge.params import NAMES, RobotParams
from waam_robot_bridge.station_file import station_of

SMALL_ARM = Path(__file__).parents[2] / 'waam_sim' / 'urdf' / 'small_arm.urdf'
GANTRY = gantry_urdf((0.0, 0.0, 0.0), (0.4, 0.3, 0.2), 0.5)
POSTURE = (0.0, 0.46, 0.40, 0.0, 1.09, 3.14)  # of the small arm, rad
TIPS = np.array([[0.1, 0.05, 0.03], [0.3, 0.25, 0.15]])


@pytest.fixture
def pinocchio():
    return pytest.importorskip('pinocchio', reason='requirements-robot.txt is not installed')


def tip_in_machine(params):
    """(N, 4, 4): torch_tcp in machine for TIPS, by the tree; and the joints."""
    station = station_of(params)
    tree, joints = Tree(description(params, station)), station.joints(TIPS)
    found = []
    for q in joints:
        named = dict(zip(params.joint_names, q.tolist(), strict=True))
        placed = [*tree.fixed, *tree.at(named), *fixed_frames(station)]
        children = [p.child for p in placed]
        assert len(children) == len(set(children))
        assert len({p.parent for p in placed} - set(children)) == 1
        found.append(np.linalg.inv(in_root(placed, MACHINE)) @ in_root(placed, TORCH))
    return np.array(found)


@pytest.mark.parametrize('more', [{}, {'tilt': 0.6}, {'turning': (0.2, 1.5, 0.0)}], ids=str)
def test_the_tree_has_the_torch_where_the_cell_has_it(more):
    found = tip_in_machine(RobotParams(**more))
    assert found[:, :3, 3] == pytest.approx(TIPS, abs=1e-9)
    assert found[:, :3, :3] == pytest.approx(np.stack([np.eye(3)] * 2), abs=1e-9)


def test_an_arm_from_a_file_too(pinocchio):
    names = tuple(Tree(SMALL_ARM.read_text()).joints)
    limits = {f'joint_{n}_max': (5.0,) * len(names) for n in ('speed', 'acceleration', 'jerk')}
    params = RobotParams(urdf=str(SMALL_ARM), joint_names=names, posture=POSTURE, **limits)
    found = tip_in_machine(params)
    assert found[:, :3, 3] == pytest.approx(TIPS, abs=1e-6)
    assert found[:, :3, :3] == pytest.approx(np.stack([np.eye(3)] * 2), abs=1e-6)


def test_a_link_that_has_the_name_of_a_frame_is_refused():
    class Station:
        text = GANTRY

    with pytest.raises(ParameterError, match="link 'machine'"):
        description(RobotParams(), Station())


def test_the_descriptions_are_sound_and_the_library_reads_them_alike(pinocchio):
    robot = RobotParams()
    rng = np.random.default_rng(0)
    for text in (GANTRY, description(robot, station_of(robot))):
        model = pinocchio.buildModelFromXML(check_urdf(text))
        tree = Tree(text)
        assert tuple(model.names[1:]) == tree.joints
        q = rng.uniform(0.0, 1.0, model.nq)
        data = model.createData()
        pinocchio.framesForwardKinematics(model, data, q)
        placed = [*tree.fixed, *tree.at(dict(zip(tree.joints, q.tolist(), strict=True)))]
        for name in tree.frames:
            wanted = data.oMf[model.getFrameId(name)].homogeneous
            assert in_root(placed, name) == pytest.approx(wanted, abs=1e-12)
    assert pinocchio.buildModelFromXML(GANTRY).upperPositionLimit == pytest.approx([0.4, 0.3, 0.2])
    assert tree.joints == NAMES
