"""The parameter file, the dataclass and the README agree; impossible values are refused by name."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import yaml

from waam_node.params import ParameterError, from_dict, markdown
from waam_robot_bridge.params import LIMITS, NAMES, RobotParams

PACKAGE = Path(__file__).parents[1]


def test_the_yaml_lists_every_parameter_with_its_default():
    text = (PACKAGE / 'config/bridge.yaml').read_text()
    loaded = yaml.safe_load(text)['/**/bridge']['ros__parameters']
    assert repr(from_dict(RobotParams, loaded)) == repr(RobotParams())  # NaN differs from NaN
    assert list(loaded) == [f.name for f in dataclasses.fields(RobotParams)]


def test_the_readme_has_the_parameter_table():
    assert markdown(RobotParams) in (PACKAGE / 'README.md').read_text()


@pytest.mark.parametrize(
    ('values', 'named'),
    [
        ({'joint_names': ('a', 'b')}, "'joint_names' has 2 values, needs 8"),
        ({'standoff_source': 'arc'}, "unknown parameter 'standoff_source'"),  # the gantry's alone
        ({'origin': (0.0,)}, "'origin' has 1 values, needs 3"),
        ({'joint_speed_max': (1.0,) * 7 + (0.0,)}, "'joint_speed_max'"),
        ({'joint_jerk_max': (1.0,) * 7 + (0.0,)}, "'joint_jerk_max'"),
        ({'joint_names': ('a',) * 8}, "'joint_names'"),
        (
            {'joint_names': ('joint_1', 'joint_3', 'joint_2', *NAMES[3:])},
            "has 'joint_3' in the place of 'joint_2'",
        ),
        (
            {'urdf': 'arm.urdf', 'joint_names': ('a', 'b')},
            "'joint_speed_max' has 8 values, needs 2",
        ),
        ({'urdf': 'arm.urdf', 'posture': (0.1, 0.2)}, "'posture' has 2 values, needs 8"),
    ],
)
def test_impossible_values_are_refused(values, named):
    with pytest.raises(ParameterError, match=named):
        from_dict(RobotParams, values)


def test_the_box_of_the_robot_narrows_the_limits():
    params = RobotParams(work_low=(0.05, 0.0, -1.0), work_high=(0.35, 0.9, 0.2))
    limits = params.limits((0.0, 0.0, 0.0, 400.0, 300.0, 200.0))
    assert limits.low == (0.05, 0.0, 0.0)
    assert limits.high == pytest.approx((0.35, 0.3, 0.2))


def test_an_arm_of_a_urdf_may_have_other_joints():
    names, speeds = tuple('abcdefg'), (1.0,) * 7
    limits = {name: speeds for name in LIMITS}
    params = RobotParams(urdf='arm.urdf', joint_names=names, **limits)
    assert params.limits_of_joints().names == names
    assert params.urdf_place().joint_names == names
    assert params.urdf_place().posture == ()  # NaN: one is searched for


@pytest.mark.parametrize(
    ('text', 'said'),
    [
        (None, 'No such file'),
        ('<robot name="r"><link name="a"/></robot>', 'arm.urdf: '),
        ('<!DOCTYPE x><robot/>', 'line 1: document types'),
    ],
)
def test_a_urdf_that_cannot_be_used_is_named(tmp_path, text, said):
    from waam_robot_bridge.station_file import station_of

    pytest.importorskip('pinocchio', reason='requirements-robot.txt is not installed')
    file = tmp_path / 'arm.urdf'
    if text is not None:
        file.write_text(text)
    with pytest.raises(ParameterError, match=f"parameter 'urdf': .*{said}"):
        station_of(RobotParams(urdf=str(file)))


def test_the_arm_of_a_urdf_is_taken(tmp_path):
    from waam_robot.positioner import Machine
    from waam_robot.timing import Drives
    from waam_robot.urdf_text import write_urdf
    from waam_robot_bridge.station_file import station_of

    pytest.importorskip('pinocchio', reason='requirements-robot.txt is not installed')
    usual = station_of(RobotParams())
    tip = np.array([[0.2, 0.15, 0.1]])
    (tmp_path / 'arm.urdf').write_text(write_urdf(Machine(), Drives().speed))
    names = (*(f'joint{n}' for n in range(1, 7)), 'tilt', 'turn')
    posture = tuple(usual.joints(tip)[0].tolist())
    params = RobotParams(urdf=str(tmp_path / 'arm.urdf'), joint_names=names, posture=posture)
    assert np.abs(station_of(params).joints(tip) - usual.joints(tip)).max() < 1e-7


def test_a_robot_has_no_gantry():
    """The gantry's settings and the board's inputs are no parameters of its bridge."""
    for name in ('envelope_x', 'steps_per_mm_z', 'home_direction_x', 'temperature_input'):
        with pytest.raises(ParameterError, match=f"unknown parameter '{name}'"):
            from_dict(RobotParams, {name: 1.0})
